//! The loop that joins grippers and cloth.

use std::time::{Duration, Instant};

use selvedge_grasp::{ClothView, Event, Grippers, Options};
use selvedge_math::{ClothSimulator, Command, DVec3, StepReport};

use crate::{Case, Error, Scenario, Solver};

/// A case under way on a solver.
pub(crate) struct Fold<'a> {
    scenario: &'a Scenario,
    case: &'a Case,
    /// Ours, or none for a simulator from elsewhere.
    solver: Option<Solver>,
    pub(crate) cloth: Box<dyn ClothSimulator + Send>,
    pub(crate) grippers: Grippers,
    /// Those of the last step; before the first, those of `t = 0`.
    pub(crate) commands: Vec<Command>,
    /// Time in the cloth's steps.
    pub(crate) spent: Duration,
}

impl<'a> Fold<'a> {
    /// Cloth at rest and grippers open.
    pub(crate) fn new(
        scenario: &'a Scenario,
        case: &'a Case,
        solver: Solver,
    ) -> Result<Self, Error> {
        Ok(Self {
            solver: Some(solver),
            ..Self::on(scenario, case, solver.build(scenario)?)
        })
    }

    /// Grippers open, on a cloth from elsewhere.
    pub(crate) fn on(
        scenario: &'a Scenario,
        case: &'a Case,
        cloth: Box<dyn ClothSimulator + Send>,
    ) -> Self {
        Self {
            scenario,
            case,
            solver: None,
            cloth,
            grippers: grippers(case),
            commands: commands_at(case, 0.0).collect(),
            spent: Duration::ZERO,
        }
    }

    /// Step number `step`, from 0: a command for each gripper, its targets for the cloth.
    ///
    /// # Errors
    /// [`Error::Empty`] and [`Error::Taken`] when jaws close on nothing, [`Error::Gripper`],
    /// [`Error::Simulator`].
    pub(crate) fn step(&mut self, step: usize) -> Result<StepReport, Error> {
        let scenario = self.scenario;
        let time = scenario.time(step);
        self.commands.clear();
        self.commands.extend(commands_at(self.case, time));

        // Grippers
        let positions = self.cloth.positions();
        let anchors = match any_closes(&self.grippers, &self.commands) {
            true => self
                .solver
                .and_then(|solver| solver.anchors(scenario, positions)),
            false => None,
        };
        let options = Options {
            anchors: anchors.as_deref(),
            ..Options::default()
        };
        let cloth = view(scenario, positions);
        let held = self
            .grippers
            .step_with(&self.commands, scenario.frame, cloth, options)
            .map_err(|reason| Error::Gripper { time, reason })?;

        // Cloth
        let before = Instant::now();
        let report = self
            .cloth
            .step(held, scenario.frame)
            .map_err(|reason| Error::Simulator { time, reason })?;
        self.spent += before.elapsed();

        for (number, gripper) in self.grippers.grippers().iter().enumerate() {
            if gripper.event() == Event::Empty {
                return Err(match gripper.refused() {
                    [] => self.nothing_grasped(number, time),
                    nodes => Error::Taken {
                        gripper: number + 1,
                        time,
                        nodes: nodes.to_vec(),
                    },
                });
            }
        }
        Ok(report)
    }

    fn nothing_grasped(&self, number: usize, time: f64) -> Error {
        let plan = &self.case.grippers[number];
        let centre = plan.commands.command(time).pose.transform(plan.tip_offset);
        let positions = self.cloth.positions();
        let nearest = positions
            .iter()
            .map(|p| p.distance(centre))
            .enumerate()
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((positions.len(), f64::INFINITY));
        Error::Empty {
            gripper: number + 1,
            time,
            nearest: nearest.0,
            distance: nearest.1,
        }
    }
}

/// The case's grippers, open.
pub(crate) fn grippers(case: &Case) -> Grippers {
    let grippers = case.grippers.iter().map(|plan| plan.gripper.clone());
    Grippers::new(grippers.collect())
}

/// The cloth as the grippers see it.
pub(crate) fn view<'a>(scenario: &'a Scenario, positions: &'a [DVec3]) -> ClothView<'a> {
    let mesh = &scenario.mesh;
    ClothView {
        positions,
        edges: mesh.edges(),
        quads: mesh.quads(),
        triangles: mesh.triangles(),
    }
}

pub(crate) fn commands_at(case: &Case, time: f64) -> impl Iterator<Item = Command> {
    case.grippers
        .iter()
        .map(move |plan| plan.commands.command(time))
}

/// Whether one of the grippers closes with these commands.
pub(crate) fn any_closes(grippers: &Grippers, commands: &[Command]) -> bool {
    let mut pairs = grippers.grippers().iter().zip(commands);
    pairs.any(|(gripper, command)| !gripper.jaw().is_closed() && command.jaw.is_closed())
}
