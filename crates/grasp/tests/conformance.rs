//! The reference cases of `fixtures/grasp`, replayed.

use selvedge_grasp::{Event, Gripper};
use serde_json::Value;

#[path = "../examples/conformance/replay.rs"]
mod replay;

const FILE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../fixtures/grasp/cases.json.gz"
);

/// Largest difference of a target [m]: positions are of the order of 1 m, so this is some thousand
/// roundings of a double.
const TOLERANCE: f64 = 1e-12;

fn compare(expected: &Value, gripper: &Gripper) -> Result<(), String> {
    let transition = match gripper.event() {
        Event::None => "none",
        Event::Captured | Event::Empty => "close",
        Event::Opened { .. } => "open",
        Event::Reset => "reset",
    };
    if expected["transition"] != transition {
        let expected = &expected["transition"];
        return Err(format!("transition {transition}, expected {expected}"));
    }
    if expected["indices"] != Value::from(gripper.nodes()) {
        let expected = &expected["indices"];
        return Err(format!("nodes {:?}, expected {expected}", gripper.nodes()));
    }
    for (field, got) in [
        ("local", gripper.local()),
        ("world", gripper.held().targets),
    ] {
        let expected = replay::points(expected, field)?;
        if expected.len() != got.len() {
            return Err(format!(
                "{} {field}, expected {}",
                got.len(),
                expected.len()
            ));
        }
        for (&got, &expected) in got.iter().zip(&expected) {
            if (got - expected).abs().max_element() > TOLERANCE {
                return Err(format!("{field} {got}, expected {expected}"));
            }
        }
    }
    Ok(())
}

#[test]
fn all_reference_cases_agree() {
    let bytes = std::fs::read(FILE).expect("the fixture is there");
    let cases = replay::read(&bytes).expect("the fixture is well formed");
    assert_eq!(cases.len(), 300);
    let mut steps = 0;
    for case in &cases {
        let result = case.replay(|expected, gripper| {
            steps += 1;
            compare(expected.expect("every step has an answer"), gripper)
        });
        assert_eq!(result, Ok(()));
    }
    assert_eq!(steps, 1511);
}

#[test]
fn bad_cases_are_named_by_case_and_field() {
    let case = |change: &str, by: &str| {
        let text = r#"{"schema":"grasp-cases/1","cases":[{"id":"one","sigma":0.5,"epsilon":0,
            "volume":{"type":"box","size":[1,1,1],"center":[0,0,0]},
            "mesh":{"positions":[[0,0,0]],"edges":[[0,0]],"triangles":[[0,0,0]]},
            "steps":[{"pose":{"p":[0,0,0],"q_xyzw":[0,0,0,1]},"jaw":1,"alpha":1}]}]}"#;
        assert!(text.contains(change));
        let cases = replay::read(text.replace(change, by).as_bytes())?;
        cases[0].replay(|_, gripper| {
            assert_eq!(gripper.nodes(), [0]);
            Ok(())
        })
    };
    assert_eq!(case("one", "two"), Ok(()));
    for (change, by, message) in [
        ("[1,1,1]", "[1,0,1]", "case one: volume: box size y 0 m"),
        (
            "[1,1,1]",
            "[1,1]",
            "case one: volume: size must be a list of 3",
        ),
        ("\"sigma\"", "\"s\"", "case one: field sigma is missing"),
        ("0.5", "5", "case one: squeeze amount 5 must be"),
        ("[[0,0]]", "[[0,-1]]", "case one: mesh: edges[0] must be"),
        ("[[0,0]]", "[[0,7]]", "case one: steps[0]: node 7 of edge 0"),
        (
            "[0,0,0,1]",
            "[0,0,0,0]",
            "case one: steps[0]: pose: quaternion",
        ),
        (
            "\"jaw\":1",
            "\"jaw\":2",
            "case one: steps[0]: jaw must be 0 or 1",
        ),
        (
            "\"alpha\":1",
            "\"alpha\":2",
            "case one: steps[0]: alpha 2 must be",
        ),
        ("cases/1", "cases/2", "schema \"grasp-cases/2\" must be"),
        ("\"cases\"", "cases", "not JSON"),
    ] {
        let error = case(change, by).expect_err(message);
        assert!(error.starts_with(message), "{error}");
    }
}
