//! Equal input gives equal bits, and a step that fails has not been.

#![allow(clippy::unwrap_used, reason = "a failed set-up fails the test")]

use selvedge_cloth::{Material, Mesh};
use selvedge_math::{ClothSimulator, DVec3, Held};
use selvedge_published::{Settings, Simulator};

const DT: f64 = 1.0 / 60.0;

struct Fold {
    cloth: Simulator,
    rest: DVec3,
}

impl Fold {
    fn new() -> Self {
        let mesh = Mesh::grid([9, 11], [0.16, 0.2]).unwrap();
        let cloth = Simulator::new(&mesh, Material::default(), Settings::default()).unwrap();
        Self {
            cloth,
            rest: mesh.rest()[98],
        }
    }

    /// Folds a corner over, one frame at a time; returns the contacts.
    fn step(&mut self, frame: u32) -> u32 {
        let share = (f64::from(frame) / 60.0).min(1.0);
        let height = 0.3 * share * (1.0 - share) + 0.01;
        let target = self.rest + DVec3::new(-0.08 * share, -0.12 * share, height);
        let held = Held {
            nodes: &[98],
            targets: &[target],
            velocities: &[DVec3::ZERO],
        };
        let held = if frame < 70 { held } else { Held::NONE };
        self.cloth.step(held, DT).unwrap().contacts
    }

    fn bits(&self) -> Vec<u64> {
        let state = self.cloth.positions().iter().chain(self.cloth.velocities());
        state.flat_map(|v| v.to_array()).map(f64::to_bits).collect()
    }
}

#[test]
fn equal_input_gives_equal_bits() {
    let (mut one, mut two) = (Fold::new(), Fold::new());
    let mut contacts = 0;
    for frame in 0..100 {
        contacts += one.step(frame);
        two.step(frame);
        assert_eq!(one.bits(), two.bits(), "frame {frame}");
    }
    assert!(contacts > 0);
}

#[test]
fn a_failed_step_leaves_no_trace() {
    let (mut one, mut two) = (Fold::new(), Fold::new());
    for frame in 0..100 {
        one.step(frame);
        two.step(frame);
        if frame % 10 == 5 {
            let nan = [DVec3::NAN];
            let held = Held {
                nodes: &[3],
                targets: &nan,
                velocities: &[DVec3::ZERO],
            };
            assert!(two.cloth.step(held, DT).is_err());
            assert!(two.cloth.step(Held::NONE, f64::NAN).is_err());
            // Refused by no check: the square of the substep overflows.
            let held = Held {
                nodes: &[3],
                targets: &[DVec3::Z],
                velocities: &[DVec3::ZERO],
            };
            assert!(two.cloth.step(held, 1e200).is_err());
        }
        assert_eq!(one.bits(), two.bits(), "frame {frame}");
    }
}

#[test]
fn a_diverging_state_is_kept_and_can_be_left() {
    let (mut one, mut two) = (Fold::new(), Fold::new());
    let n = one.cloth.positions().len();
    let start = one.cloth.positions().to_vec();
    let far: Vec<DVec3> = (0..n).map(|k| DVec3::splat(1e200 * k as f64)).collect();
    for (positions, velocity) in [(&far, 0.0), (&start, 1e308)] {
        let velocities = vec![DVec3::splat(velocity); n];
        two.cloth.reset(positions, &velocities).unwrap();
        let before = two.bits();
        assert!(two.cloth.step(Held::NONE, DT).is_err());
        assert_eq!(two.bits(), before);
        for fold in [&mut one, &mut two] {
            fold.cloth.reset(&start, &vec![DVec3::ZERO; n]).unwrap();
            for frame in 0..30 {
                fold.step(frame);
            }
        }
        assert_eq!(one.bits(), two.bits());
    }
}
