//! How far a run strays from an ideal cloth.

use selvedge_cloth::Mesh;
use selvedge_math::{DVec3, Held, Status, StepReport};
use serde::{Deserialize, Serialize};

use crate::metric::edge_strain;

/// Released edges are not counted in the strain for so long [s]: the squeeze shortened them.
const RECOVERY: f64 = 0.5;

/// The worst of each measure over the steps of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Worst {
    /// Largest edge strain `|length/rest - 1|`, at the end of any substep if the solver measures
    /// it, else at the end of any step. Edges with both ends held do not count, nor do those for
    /// half a second after their release.
    pub strain: f64,
    /// Largest root mean square strain of the same edges, at the end of any step.
    pub strain_rms: f64,
    /// Largest sine of the angle that a face is sheared by; none if the solver does not measure it.
    pub shear: Option<f64>,
    /// Smallest distance between two layers, or a layer and the table, less what it must be [m];
    /// none if the solver does not measure it, or nothing was near.
    pub gap: Option<f64>,
    /// Lowest and highest z of any node at the end of any step [m].
    pub height: [f64; 2],
    /// Largest distance between a held node and its target at the end of any step [m].
    pub held_error: f64,
    /// Steps in which a solve ended at its iteration limit.
    pub unconverged_steps: usize,
}

/// Keeps the worst while a run goes on.
pub(crate) struct Watch {
    /// For each node the end of the time for which edges between such nodes do not count [s].
    exempt_until: Vec<f64>,
    pub(crate) worst: Worst,
}

impl Watch {
    pub(crate) fn new(mesh: &Mesh) -> Self {
        Self {
            exempt_until: vec![f64::NEG_INFINITY; mesh.node_count()],
            worst: Worst::default(),
        }
    }

    /// Looks at the end of the step that began at `time`.
    pub(crate) fn see(
        &mut self,
        mesh: &Mesh,
        time: f64,
        positions: &[DVec3],
        held: Held<'_>,
        report: &StepReport,
    ) {
        let worst = &mut self.worst;
        for (&node, target) in held.nodes.iter().zip(held.targets) {
            let lag = positions[node as usize].distance(*target);
            worst.held_error = worst.held_error.max(lag);
            self.exempt_until[node as usize] = time + RECOVERY;
        }
        let exempt = &self.exempt_until;
        let counts = |edge: [u32; 2]| edge.iter().any(|&node| exempt[node as usize] < time);
        let (largest, rms) = edge_strain(mesh, positions, counts);
        worst.strain = worst.strain.max(report.strain.unwrap_or(largest));
        worst.strain_rms = worst.strain_rms.max(rms);
        worst.shear = merge(worst.shear, report.shear, f64::max);
        worst.gap = merge(worst.gap, report.gap, f64::min);
        for position in positions {
            worst.height[0] = worst.height[0].min(position.z);
            worst.height[1] = worst.height[1].max(position.z);
        }
        worst.unconverged_steps += usize::from(report.status != Status::Converged);
    }
}

fn merge(a: Option<f64>, b: Option<f64>, choose: fn(f64, f64) -> f64) -> Option<f64> {
    match (a, b) {
        (Some(a), Some(b)) => Some(choose(a, b)),
        _ => a.or(b),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_solver_measures_stands_before_what_is_seen_at_the_end_of_a_step() {
        let mesh = Mesh::grid([3, 3], [1.0, 1.0]).unwrap();
        let stretched: Vec<DVec3> = mesh.rest().iter().map(|p| *p * 1.02).collect();
        let mut watch = Watch::new(&mesh);
        let mut see = |report: StepReport| {
            watch.see(&mesh, 0.0, &stretched, Held::NONE, &report);
            watch.worst.clone()
        };
        let silent = see(StepReport::default());
        assert!((silent.strain - 0.02).abs() < 1e-14);
        assert_eq!((silent.shear, silent.gap), (None, None));
        let report = |strain, shear, gap| StepReport {
            strain: Some(strain),
            shear: Some(shear),
            gap: Some(gap),
            ..StepReport::default()
        };
        see(report(0.5, 0.1, 2e-4));
        see(report(0.3, 0.2, -1e-4));
        let worst = see(StepReport::default());
        assert_eq!(worst.strain, 0.5);
        assert_eq!((worst.shear, worst.gap), (Some(0.2), Some(-1e-4)));
    }

    #[test]
    fn held_edges_do_not_count_until_half_a_second_after_their_release() {
        let mesh = Mesh::grid([2, 2], [1.0, 1.0]).unwrap();
        let mut squeezed = mesh.rest().to_vec();
        squeezed[1].x = squeezed[0].x + 0.7;
        squeezed[3].x = squeezed[2].x + 1.0;
        let held = Held {
            nodes: &[0, 1],
            targets: &[squeezed[0], squeezed[1] + DVec3::Z],
            velocities: &[DVec3::ZERO; 2],
        };
        let mut watch = Watch::new(&mesh);
        watch.see(&mesh, 1.0, &squeezed, held, &StepReport::default());
        assert_eq!(watch.worst.held_error, 1.0);
        let others = watch.worst.strain;
        assert!(others < 0.1, "{others}"); // the edge from 1 to 3 leans
        watch.see(&mesh, 1.5, &squeezed, Held::NONE, &StepReport::default());
        assert_eq!(watch.worst.strain, others);
        watch.see(&mesh, 1.6, &squeezed, Held::NONE, &StepReport::default());
        assert!((watch.worst.strain - 0.3).abs() < 1e-12);
    }
}
