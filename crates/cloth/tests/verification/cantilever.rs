//! Strips clamped at one end that bend under their own weight.

use selvedge_cloth::{Material, Mesh, Settings};
use selvedge_math::{ClothSimulator, Held, Status};

use crate::scene::{FRAME, air, along, column, fall, polyline, put, simulator, speed};

/// A bending wave crosses a cell of side `d` in `sqrt(rho d^4/kappa)`, here 0.4 ms at worst. The solver
/// corrects forces by the masses and leaves what bending makes of them to the next iteration, so it
/// wants substeps that are not much longer.
const SUBSTEP: f64 = 1.0 / 480.0;

/// Tip of a strip of `nodes` columns, over the length: `[forward, down]`, and what it took.
///
/// The first three columns are pinned. The second difference at the third is the first that bends; it
/// stands for the cell around it, so the clamp is at that cell's start, in the middle of the last
/// pinned edge: the strip is `nodes - 2.5` cells long.
///
fn tip(nodes: usize, gamma: f64) -> [f64; 2] {
    let length = 1.0;
    let side = length / (nodes as f64 - 2.5);
    let mesh = Mesh::grid([nodes, 2], [side * (nodes - 1) as f64, side]).unwrap();
    let weight = Material::default().gravitational_density * air().gravity;
    let bending = weight * length.powi(3) / gamma;
    // Near the critical damping of the slowest mode, sagging little or much
    let swing = (fall(&Material::default(), &air()) / length).sqrt();
    let slowest = swing * (3.516 / gamma.sqrt()).max(1.2);
    let density = Material::default().density;
    let material = Material {
        bending,
        damping: 2.0 * density * slowest,
        ..Material::default()
    };
    let settings = Settings {
        substep: SUBSTEP,
        settled: 1e-8,
        iterations: 200,
        ..air()
    };
    let mut cloth = simulator(&mesh, material, settings);
    put(
        &mut cloth,
        &along(&mesh, &polyline(side, (1..nodes).map(|_| 0.0))),
    );
    cloth
        .pin(&[0, 1, 2].map(|i| column(&mesh, i)).concat())
        .unwrap();
    let (mut iterations, mut limited) = (0, 0);
    let steps = (16.0 / slowest / FRAME) as usize;
    for _ in 0..steps {
        let report = cloth.step(Held::NONE, FRAME).unwrap();
        iterations += report.iterations;
        limited += usize::from(report.status != Status::Converged);
    }
    let end = cloth.positions()[nodes - 1];
    println!(
        "cantilever {gamma}, {nodes} nodes: tip {:.5} {:.5}, {:.1} iterations a substep, {limited} of {steps} steps at their limit, still {:.1e} m/s",
        end.x - 1.5 * side,
        -end.z,
        f64::from(iterations) * SUBSTEP / FRAME / steps as f64,
        speed(&cloth)
    );
    [(end.x - 1.5 * side) / length, -end.z / length]
}

/// `theta'' = -Gamma (1 - s) cos theta`, `theta(0) = 0`, `theta'(1) = 0`, `Gamma = delta g L^3/kappa`:
/// the heavy elastica. Tip over length from its boundary value problem, solved to 1e-10.
const REFERENCES: [(f64, [f64; 2]); 3] = [
    (1.0, [0.991246, 0.123471]),
    (10.0, [0.656354, 0.700200]),
    (100.0, [0.159223, 0.937524]),
];

fn error(nodes: usize, (gamma, reference): (f64, [f64; 2])) -> f64 {
    let tip = tip(nodes, gamma);
    (tip[0] - reference[0]).hypot(tip[1] - reference[1])
}

/// Within 1.5 % of the sag at 28 nodes.
#[test]
fn tips_are_where_the_heavy_elastica_has_them() {
    for case in REFERENCES {
        let error = error(28, case) / case.1[1];
        assert!(error < 0.015, "{error}");
    }
}

/// The cell is of second order: errors at 14, 28 and 56 nodes, against a length in cells that grows
/// from 11.5 to 53.5.
fn check_order(case: (f64, [f64; 2])) {
    let errors = [14, 28, 56].map(|nodes| error(nodes, case));
    let orders = [
        (errors[0] / errors[1]).ln() / (25.5_f64 / 11.5).ln(),
        (errors[1] / errors[2]).ln() / (53.5_f64 / 25.5).ln(),
    ];
    println!(
        "cantilever {}: errors {errors:.5?}, orders {orders:.2?}",
        case.0
    );
    assert!(orders.iter().all(|order| *order > 1.7), "{orders:?}");
}

#[test]
fn refinement_is_of_second_order_for_a_strip_that_bends() {
    check_order(REFERENCES[1]);
}

#[test]
fn refinement_is_of_second_order_for_a_strip_that_hangs() {
    check_order(REFERENCES[2]);
}

#[test]
fn refinement_is_of_second_order_for_a_stiff_strip() {
    check_order(REFERENCES[0]);
}
