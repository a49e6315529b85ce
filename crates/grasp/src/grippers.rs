//! Several grippers on one cloth.

use alloc::boxed::Box;
use alloc::vec::Vec;

use selvedge_math::{Command, DVec3, Held};

use crate::{ClothView, Error, Gripper, Options};

/// Several grippers on one cloth, with each node held by one of them at most.
///
/// Within a step, grippers that open let go first; then those that close take their supports in
/// order. So the first to close keeps a node, in the same step the gripper with the lower number,
/// and the other one finds it in [`Gripper::refused`]. A single gripper does the same here as alone,
/// to the last bit.
///
/// ```
/// use selvedge_grasp::*;
/// let volume = GraspVolume::new(Shape::Box { size: DVec3::splat(0.1) }, DVec3::ZERO)?;
/// let gripper = Gripper::new(volume, Squeeze { amount: 0.0, lift: 0.0, steps: 1 })?;
/// let mut grippers = Grippers::new(vec![gripper.clone(), gripper]);
/// let cloth = ClothView { positions: &[DVec3::ZERO, DVec3::X], ..ClothView::default() };
/// let close = |x: f64| Command { pose: Pose::from_translation(DVec3::X * x), jaw: Jaw::Closed };
/// let held = grippers.step(&[close(1.0), close(0.0)], 0.1, cloth)?;
/// assert_eq!(held.nodes, [0, 1]);
/// assert_eq!(grippers.grippers()[1].nodes(), [0]);
/// # Ok::<(), Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Grippers {
    grippers: Vec<Gripper>,
    nodes: Vec<u32>,
    targets: Vec<DVec3>,
    velocities: Vec<DVec3>,
    /// How many nodes of each gripper have been merged.
    merged: Vec<usize>,
}

impl Grippers {
    /// Joins grippers, which are reset.
    pub fn new(mut grippers: Vec<Gripper>) -> Self {
        for gripper in &mut grippers {
            gripper.reset();
        }
        Self {
            merged: Vec::with_capacity(grippers.len()),
            grippers,
            nodes: Vec::new(),
            targets: Vec::new(),
            velocities: Vec::new(),
        }
    }

    /// Takes one step of `dt` \[s\] with one command a gripper, as [`Gripper::step`] does, and gives
    /// what all of them hold together.
    ///
    /// # Errors
    /// [`Error::CommandCount`], or [`Error::Gripper`] with the error of the first gripper that
    /// cannot take the step. All grippers are then as they were before the call.
    pub fn step(
        &mut self,
        commands: &[Command],
        dt: f64,
        cloth: ClothView<'_>,
    ) -> Result<Held<'_>, Error> {
        self.step_with(commands, dt, cloth, Options::default())
    }

    /// [`Grippers::step`] with options, the same for all grippers.
    ///
    /// # Errors
    /// Those of [`Grippers::step`].
    pub fn step_with(
        &mut self,
        commands: &[Command],
        dt: f64,
        cloth: ClothView<'_>,
        options: Options<'_>,
    ) -> Result<Held<'_>, Error> {
        if commands.len() != self.grippers.len() {
            return Err(Error::CommandCount {
                commands: commands.len(),
                grippers: self.grippers.len(),
            });
        }
        for (number, (gripper, command)) in self.grippers.iter_mut().zip(commands).enumerate() {
            if let Err(error) = gripper.prepare(command, dt, cloth, &options) {
                let error = Box::new(error);
                return Err(Error::Gripper { number, error });
            }
        }

        // Those that open let go.
        for (gripper, command) in self.grippers.iter_mut().zip(commands) {
            if !command.jaw.is_closed() {
                gripper.commit(command, dt, cloth, &options);
            }
        }

        // Those that close take what nobody holds; the others carry on.
        for (number, command) in commands.iter().enumerate() {
            if !command.jaw.is_closed() {
                continue;
            }
            let (before, rest) = self.grippers.split_at_mut(number);
            let Some((gripper, after)) = rest.split_first_mut() else {
                break;
            };
            if !gripper.jaw().is_closed() {
                gripper.refuse(|node| {
                    let others = || before.iter().chain(after.iter());
                    others().any(|other| other.nodes().binary_search(&node).is_ok())
                });
            }
            gripper.commit(command, dt, cloth, &options);
        }

        self.merge();
        Ok(self.held())
    }

    /// Opens all jaws and forgets everything but volumes and squeezes, as [`Gripper::reset`] does.
    pub fn reset(&mut self) {
        for gripper in &mut self.grippers {
            gripper.reset();
        }
        self.merge();
    }

    /// What the last step asked for, ascending by node.
    pub fn held(&self) -> Held<'_> {
        Held {
            nodes: &self.nodes,
            targets: &self.targets,
            velocities: &self.velocities,
        }
    }

    /// The grippers, in the order of the commands.
    pub fn grippers(&self) -> &[Gripper] {
        &self.grippers
    }

    /// Merges what the grippers hold; no node occurs twice.
    fn merge(&mut self) {
        self.nodes.clear();
        self.targets.clear();
        self.velocities.clear();
        self.merged.clear();
        self.merged.resize(self.grippers.len(), 0);
        loop {
            let next = self.grippers.iter().zip(&mut self.merged);
            let next = next.filter(|(gripper, merged)| **merged < gripper.nodes().len());
            let Some((gripper, merged)) =
                next.min_by_key(|(gripper, merged)| gripper.nodes()[**merged])
            else {
                return;
            };
            let held = gripper.held();
            self.nodes.push(held.nodes[*merged]);
            self.targets.push(held.targets[*merged]);
            self.velocities.push(held.velocities[*merged]);
            *merged += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use alloc::string::ToString;
    use alloc::vec;

    use selvedge_math::{Jaw, Pose};

    use super::*;
    use crate::{Event, GraspVolume, Shape, Squeeze};

    const DT: f64 = 0.125;
    /// Nodes 1 m apart; a volume reaches 1 m to each side.
    const X: [DVec3; 4] = [
        DVec3::new(0.0, 0.0, 0.0),
        DVec3::new(1.0, 0.0, 0.0),
        DVec3::new(2.0, 0.0, 0.0),
        DVec3::new(3.0, 0.0, 0.0),
    ];

    fn two() -> Grippers {
        let size = DVec3::splat(2.0);
        let volume = GraspVolume::new(Shape::Box { size }, DVec3::ZERO).unwrap();
        let squeeze = Squeeze {
            amount: 0.0,
            lift: 0.0,
            steps: 1,
        };
        Grippers::new(vec![Gripper::new(volume, squeeze).unwrap(); 2])
    }

    fn cloth() -> ClothView<'static> {
        ClothView {
            positions: &X,
            ..ClothView::default()
        }
    }

    fn at(x: f64, jaw: Jaw) -> Command {
        Command {
            pose: Pose::from_translation(DVec3::X * x),
            jaw,
        }
    }

    #[test]
    fn the_lower_number_wins_in_one_step() {
        let mut grippers = two();
        let close = [at(2.0, Jaw::Closed), at(1.0, Jaw::Closed)];
        let held = grippers.step(&close, DT, cloth()).unwrap();
        assert_eq!(held.nodes, [0, 1, 2, 3]);
        assert_eq!(held.targets, X);
        let [first, second] = grippers.grippers() else {
            unreachable!()
        };
        assert_eq!((first.nodes(), first.refused()), (&[1, 2, 3][..], &[][..]));
        assert_eq!((second.nodes(), second.refused()), (&[0][..], &[1, 2][..]));
    }

    #[test]
    fn the_first_to_close_keeps_what_it_has() {
        let mut grippers = two();
        let step = [at(0.0, Jaw::Open), at(1.0, Jaw::Closed)];
        grippers.step(&step, DT, cloth()).unwrap();
        let step = [at(1.0, Jaw::Closed), at(1.0, Jaw::Closed)];
        grippers.step(&step, DT, cloth()).unwrap();
        let first = &grippers.grippers()[0];
        assert_eq!((first.nodes(), first.refused()), (&[][..], &[0, 1, 2][..]));
        assert_eq!(first.event(), Event::Empty);
        // What was refused is not caught later, and the list is kept until the jaws open.
        let step = [at(1.0, Jaw::Closed), at(1.0, Jaw::Open)];
        assert!(grippers.step(&step, DT, cloth()).unwrap().nodes.is_empty());
        assert_eq!(grippers.grippers()[0].refused(), [0, 1, 2]);
        let step = [at(1.0, Jaw::Open), at(1.0, Jaw::Open)];
        grippers.step(&step, DT, cloth()).unwrap();
        assert!(grippers.grippers()[0].refused().is_empty());
    }

    #[test]
    fn releases_come_before_captures() {
        let mut grippers = two();
        let step = [at(0.0, Jaw::Open), at(1.0, Jaw::Closed)];
        grippers.step(&step, DT, cloth()).unwrap();
        let step = [at(1.0, Jaw::Closed), at(1.0, Jaw::Open)];
        grippers.step(&step, DT, cloth()).unwrap();
        let [first, second] = grippers.grippers() else {
            unreachable!()
        };
        assert_eq!(first.nodes(), [0, 1, 2]);
        assert!(first.refused().is_empty());
        assert_eq!(second.event(), Event::Opened { released: 3 });
    }

    #[test]
    fn one_failure_stops_all() {
        let mut grippers = two();
        let lost = Command {
            pose: Pose::from_translation(DVec3::NAN),
            jaw: Jaw::Open,
        };
        let close = at(1.0, Jaw::Closed);
        let error = grippers.step(&[close, lost], DT, cloth()).unwrap_err();
        assert!(error.to_string().starts_with("gripper 1: commanded"));
        assert!(grippers.held().nodes.is_empty());
        assert_eq!(grippers.grippers()[0].jaw(), Jaw::Open);
        let error = grippers.step(&[close], DT, cloth()).unwrap_err();
        assert!(error.to_string().contains("each of the 2 grippers, got 1"));
        grippers.step(&[close, close], DT, cloth()).unwrap();
        grippers.reset();
        assert!(grippers.held().nodes.is_empty());
    }
}
