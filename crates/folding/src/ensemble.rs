//! The same fold again from starts that differ by next to nothing: how far its error can be
//! trusted.

use std::ops::ControlFlow;

use selvedge_math::DVec3;

use crate::fold::Fold;
use crate::{Case, Error, Scenario, Solver};

/// The folding errors of a case run from perturbed starts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ensemble {
    /// Of the members that ran to the end, ascending.
    pub errors: Vec<f64>,
    /// The other members.
    pub failures: usize,
    /// Why the first of them failed.
    pub reason: Option<String>,
}

impl Ensemble {
    /// The middle error, or the mean of the two middle ones; none if there is none.
    pub fn median(&self) -> Option<f64> {
        let (n, errors) = (self.errors.len(), &self.errors);
        let upper = errors.get(n / 2)?;
        let lower = errors.get((n - 1) / 2)?;
        Some(0.5 * (lower + upper))
    }

    /// The smallest and the largest error; none if there is none.
    pub fn range(&self) -> Option<[f64; 2]> {
        Some([*self.errors.first()?, *self.errors.last()?])
    }
}

/// The node positions at the end of a member of a case's ensemble, counted from 1.
///
/// # Errors
/// As [`crate::run`].
pub(crate) fn run_member(
    scenario: &Scenario,
    case: &Case,
    solver: Solver,
    member: usize,
    noise: f64,
    observe: &mut dyn FnMut(usize) -> ControlFlow<()>,
) -> Result<Vec<DVec3>, Error> {
    let rest = scenario.mesh.rest();
    let number = scenario
        .cases
        .iter()
        .position(|other| other.name == case.name)
        .unwrap_or_default();
    let seed = (number as u64) << 32 | member as u64;
    let mut fold = Fold::new(scenario, case, solver)?;
    fold.cloth
        .reset(
            &perturbed(rest, noise, seed),
            &vec![DVec3::ZERO; rest.len()],
        )
        .map_err(|reason| Error::Simulator { time: 0.0, reason })?;
    for step in 0..scenario.steps {
        fold.step(step)?;
        if observe(step).is_break() {
            return Err(Error::Stopped);
        }
    }
    Ok(fold.cloth.positions().to_vec())
}

/// Positions with each coordinate moved by up to `noise` [m] to either side, the height only
/// upwards: below is the table.
fn perturbed(positions: &[DVec3], noise: f64, seed: u64) -> Vec<DVec3> {
    let mut random = SplitMix64(seed);
    let mut coordinate = || noise * (2.0 * random.unit() - 1.0);
    let mut moved = |p: &DVec3| {
        let [x, y, z] = [coordinate(), coordinate(), coordinate()];
        p + DVec3::new(x, y, z.abs())
    };
    positions.iter().map(&mut moved).collect()
}

/// The generator of Steele, Lea and Flood (2014), figure 17: the same numbers on every machine.
struct SplitMix64(u64);

impl SplitMix64 {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1): the upper 53 bits.
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_generator_is_the_published_one() {
        // The first numbers for the seed 1234567, as in the test vectors of its implementations.
        let mut random = SplitMix64(1_234_567);
        assert_eq!(random.next(), 6_457_827_717_110_365_317);
        assert_eq!(random.next(), 3_203_168_211_198_807_973);
        assert_eq!(random.next(), 9_817_491_932_198_370_423);
    }

    #[test]
    fn noise_stays_in_its_bounds_and_above_the_table() {
        let rest = vec![DVec3::X; 1000];
        let moved = perturbed(&rest, 1e-3, 7);
        let offset = |k: usize| moved[k] - rest[k];
        let largest = (0..1000).map(|k| offset(k).abs().max_element());
        let largest = largest.fold(0.0, f64::max);
        assert!(largest > 0.99e-3 && largest < 1.000_001e-3, "{largest}");
        let mean = (0..1000).map(offset).sum::<DVec3>() / 1000.0;
        assert!(mean.x.abs() < 1e-4 && mean.y.abs() < 1e-4 && (mean.z - 5e-4).abs() < 5e-5);
        assert!(moved.iter().all(|p| p.z >= 0.0));
        assert_eq!(moved, perturbed(&rest, 1e-3, 7));
        assert_ne!(moved, perturbed(&rest, 1e-3, 8));
        assert_eq!(perturbed(&rest, 0.0, 7), rest);
    }

    #[test]
    fn median_and_range() {
        let of = |errors: &[f64]| Ensemble {
            errors: errors.to_vec(),
            ..Ensemble::default()
        };
        assert_eq!(of(&[]).median(), None);
        assert_eq!(of(&[]).range(), None);
        assert_eq!(of(&[1.0, 2.0, 9.0]).median(), Some(2.0));
        assert_eq!(of(&[1.0, 2.0, 4.0, 9.0]).median(), Some(3.0));
        assert_eq!(of(&[1.0, 9.0]).range(), Some([1.0, 9.0]));
    }
}
