//! Descriptions of arms: other shapes, and what cannot be used.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use std::f64::consts::FRAC_PI_2;

use selvedge_franka::{Arm, Error, JointKind};
use selvedge_math::DVec3;

/// A turning joint about a slanted axis, a fixed one, and a sliding one.
const SMALL: &str = r#"<robot name="small">
  <link name="base"/> <link name="arm"/> <link name="bracket"/> <link name="slide"/> <link name="tip"/>
  <joint name="turn" type="revolute">
    <parent link="base"/> <child link="arm"/> <origin xyz="0 0 1" rpy="0 0 0"/> <axis xyz="0 2 0"/>
    <limit lower="-1" upper="2" velocity="3" effort="4"/>
  </joint>
  <joint name="fixed" type="fixed">
    <parent link="arm"/> <child link="bracket"/> <origin xyz="0.5 0 0" rpy="0 0 1.5707963267948966"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="bracket"/> <child link="slide"/> <axis xyz="1 0 0"/>
    <limit lower="0" upper="0.2" velocity="1" effort="1"/>
  </joint>
  <joint name="tool" type="fixed"><parent link="slide"/><child link="tip"/><origin xyz="0 0 0.1"/></joint>
</robot>"#;

#[test]
fn an_arm_of_another_shape() {
    let arm = Arm::from_urdf(SMALL, "base", "tip").unwrap();
    assert_eq!(arm.name(), "small");
    assert_eq!(
        arm.links().collect::<Vec<_>>(),
        ["base", "arm", "bracket", "slide", "tip"]
    );
    let joints = arm.joints();
    assert_eq!(
        (joints[0].kind, joints[1].kind),
        (JointKind::Revolute, JointKind::Prismatic)
    );
    assert_eq!((joints[0].axis, joints[0].limits.upper), (DVec3::Y, 2.0));
    // At zero the bracket turns the slide's x to the base's y.
    let pose = arm.forward(&[0.0, 0.2]);
    assert!(pose.position().distance(DVec3::new(0.5, 0.2, 1.1)) < 1e-15);
    // A quarter about y: x goes down, z goes forward.
    let pose = arm.forward(&[FRAC_PI_2, 0.2]);
    assert!(pose.position().distance(DVec3::new(0.1, 0.2, 0.5)) < 1e-15);
    let bracket = arm.link_pose(&[FRAC_PI_2, 0.2], "bracket").unwrap();
    assert!(bracket.position().distance(DVec3::new(0.0, 0.0, 0.5)) < 1e-15);
    let mut columns = [[0.0; 6]; 2];
    arm.jacobian(&[0.0, 0.2], &mut columns);
    let expected = [
        [0.1, 0.0, -0.5, 0.0, 1.0, 0.0],
        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
    ];
    for (column, expected) in columns.iter().zip(expected) {
        for (a, b) in column.iter().zip(expected) {
            assert!((a - b).abs() < 1e-15);
        }
    }
    let refused = arm.inverse(&pose, 0.0, 0.0).unwrap_err();
    assert!(
        refused
            .to_string()
            .starts_with("small has not the shape of a Franka")
    );
    // From a link in the middle.
    let part = Arm::from_urdf(SMALL, "bracket", "tip").unwrap();
    assert!(
        part.forward(&[0.1])
            .position()
            .distance(DVec3::new(0.1, 0.0, 0.1))
            < 1e-15
    );
}

/// The message for the small arm with one text replaced by another.
fn refusal(old: &str, new: &str) -> String {
    assert!(SMALL.contains(old), "{old}");
    Arm::from_urdf(&SMALL.replacen(old, new, 1), "base", "tip")
        .expect_err(new)
        .to_string()
}

#[test]
fn what_cannot_be_used_is_named() {
    let cases = [
        ("</robot>", "", "not URDF"),
        ("<link name=\"tip\"/>", "", "no link tip"),
        ("<link name=\"arm\"/>", "", "no link arm"),
        (
            "<parent link=\"base\"/>",
            "<parent link=\"slide\"/>",
            "closes a loop",
        ),
        (
            "<child link=\"tip\"/>",
            "<child link=\"arm\"/>",
            "not carried by link base",
        ),
        (
            "type=\"prismatic\"",
            "type=\"floating\"",
            "joint slide has a type",
        ),
        (
            "<axis xyz=\"0 2 0\"/>",
            "<axis xyz=\"0 0 0\"/>",
            "joint turn has an axis that is zero",
        ),
        (
            "<axis xyz=\"0 2 0\"/>",
            "<axis xyz=\"0 NaN 0\"/>",
            "joint turn has an axis",
        ),
        (
            "<origin xyz=\"0 0 1\"",
            "<origin xyz=\"0 0 inf\"",
            "joint turn has an origin",
        ),
        (
            "lower=\"-1\" upper=\"2\"",
            "lower=\"3\" upper=\"2\"",
            "joint turn has limits from 3 to 2",
        ),
        (
            "<axis xyz=\"1 0 0\"/>",
            "<axis xyz=\"1 0 0\"/><mimic joint=\"turn\"/>",
            "joint slide mimics",
        ),
        ("<link name=\"arm\"/>", "<xacro:arm/>", "expand them first"),
    ];
    for (old, new, words) in cases {
        let message = refusal(old, new);
        assert!(message.contains(words), "{new}: {message}");
    }
    let huge = format!("{SMALL}{}", " ".repeat(17 << 20));
    assert!(matches!(
        Arm::from_urdf(&huge, "base", "tip"),
        Err(Error::Urdf(_))
    ));
    let error = Arm::load("nowhere/arm.urdf", "base", "tip").unwrap_err();
    assert!(error.to_string().starts_with("nowhere/arm.urdf: "));
    assert!(matches!(
        Arm::from_urdf(SMALL, "tip", "base"),
        Err(Error::NoChain { .. })
    ));
    assert!(matches!(
        Arm::from_urdf(SMALL, "slide", "tip"),
        Err(Error::NoChain { .. })
    ));
}

/// The maker's own expansion is not kept here; with its folder in `SELVEDGE_FRANKA_DESCRIPTION`
/// the joints are compared number by number.
#[test]
fn the_kept_descriptions_are_the_makers() {
    let Some(folder) = std::env::var_os("SELVEDGE_FRANKA_DESCRIPTION") else {
        println!("skipped: SELVEDGE_FRANKA_DESCRIPTION is not set");
        return;
    };
    for (ours, name) in [(Arm::fr3(), "fr3"), (Arm::fer(), "fer")] {
        let path = std::path::Path::new(&folder).join(format!("{name}.urdf"));
        let tip = format!("{name}_hand_tcp");
        let theirs = Arm::load(path, &format!("{name}_link0"), &tip).unwrap();
        assert_eq!(ours.joints().len(), theirs.joints().len());
        for (a, b) in ours.joints().iter().zip(theirs.joints()) {
            assert_eq!((&a.name, a.limits, a.axis), (&b.name, b.limits, b.axis));
            assert_eq!(a.origin.position(), b.origin.position());
            // Quarter turns are printed with 16 digits there.
            let apart = (a.origin.rotation() - b.origin.rotation()).length();
            assert!(apart < 1e-15, "{}: {apart:e}", a.name);
        }
        assert!(ours.tool().position().distance(theirs.tool().position()) < 1e-15);
    }
}
