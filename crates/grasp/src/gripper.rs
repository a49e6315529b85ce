//! The gripper: capture on closing, carry while closed, forget on opening.

use alloc::vec::Vec;

use selvedge_math::{Command, DVec3, Held, Jaw};

use crate::select::{Rules, Support, select};
use crate::{ClothView, Error, GraspVolume, Squeeze};

/// A gripper with a grasping volume, and what it holds.
///
/// It starts open. In the step in which the jaws close it takes the support of [`select`] and
/// stores its positions in the gripper frame, `p0 = R^T (p_i - p_g)`. In that and each further
/// closed step it asks for `u_i = p_g + R p_i` (eq. `desired_world` of the paper), where `p_i` is
/// the squeezed `p0` ([`Squeeze::squeezed`]). When the jaws open it forgets all. What drifts into
/// the volume of closed jaws is not caught, also when they closed on nothing.
///
/// ```
/// use selvedge_grasp::{ClothView, Command, DVec3, Event, GraspVolume, Gripper, Jaw, Pose, Shape, Squeeze};
/// let volume = GraspVolume::new(Shape::Box { size: DVec3::splat(0.1) }, DVec3::ZERO)?;
/// let mut gripper = Gripper::new(volume, Squeeze { amount: 0.0, lift: 0.0, steps: 1 })?;
/// let cloth = ClothView { positions: &[DVec3::ZERO, DVec3::X], ..ClothView::default() };
/// let close = Command { pose: Pose::IDENTITY, jaw: Jaw::Closed };
/// assert_eq!(gripper.step(close, 0.1, cloth)?.nodes, [0]);
/// assert_eq!(gripper.event(), Event::Captured);
///
/// let lift = Command { pose: Pose::from_translation(DVec3::Z), ..close };
/// let held = gripper.step(lift, 0.1, cloth)?;
/// assert_eq!((held.targets[0], held.velocities[0]), (DVec3::Z, DVec3::Z * 10.0));
/// # Ok::<(), selvedge_grasp::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Gripper {
    volume: GraspVolume,
    squeeze: Squeeze,
    jaw: Jaw,
    /// Steps since the jaws closed, the closing step included.
    closed_steps: u32,
    alpha: f64,
    event: Event,
    nodes: Vec<u32>,
    rules: Vec<Rules>,
    refused: Vec<u32>,
    /// `p0` of each held node \[m\], gripper frame.
    captured: Vec<DVec3>,
    /// The squeezed `p0` at `alpha` \[m\], gripper frame.
    local: Vec<DVec3>,
    targets: Vec<DVec3>,
    velocities: Vec<DVec3>,
    /// What a closing step found, before it is taken over.
    support: Support,
}

/// What happened in the last step of a gripper.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Event {
    /// Nothing: the jaws stayed as they were, or there has been no step yet.
    #[default]
    None,
    /// The jaws closed and hold at least one node.
    Captured,
    /// The jaws closed and hold nothing.
    Empty,
    /// The jaws opened.
    Opened {
        /// How many nodes were let go.
        released: usize,
    },
    /// [`Gripper::reset`] was called and there has been no step since.
    Reset,
}

/// What may be said about a step beside its command; nothing by default.
///
/// ```
/// use selvedge_grasp::Options;
/// let options = Options { alpha: Some(0.3), ..Options::default() };
/// assert!(options.anchors.is_none());
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct Options<'a> {
    /// `alpha` of this step, in [0, 1], in place of the count of [`Squeeze::steps`]. The count goes
    /// on underneath.
    pub alpha: Option<f64>,
    /// Positions \[m\], world frame, one a node, from which the captured positions are stored, for
    /// instance filtered measurements. The support is still that of [`ClothView::positions`]. Only
    /// those of captured nodes are read, and only in a closing step.
    pub anchors: Option<&'a [DVec3]>,
}

impl Gripper {
    /// An open gripper.
    ///
    /// # Errors
    /// Those of [`Squeeze::check`].
    pub fn new(volume: GraspVolume, squeeze: Squeeze) -> Result<Self, Error> {
        squeeze.check()?;
        Ok(Self {
            volume,
            squeeze,
            jaw: Jaw::Open,
            closed_steps: 0,
            alpha: 0.0,
            event: Event::None,
            nodes: Vec::new(),
            rules: Vec::new(),
            refused: Vec::new(),
            captured: Vec::new(),
            local: Vec::new(),
            targets: Vec::new(),
            velocities: Vec::new(),
            support: Support::default(),
        })
    }

    /// Takes one step of `dt` \[s\] and says where the held nodes must be at its end.
    ///
    /// `command` holds at the end of the step, `cloth` at its beginning. Velocities are
    /// `(target - previous target) / dt`; in the closing step the node's own position stands for
    /// the previous target.
    ///
    /// # Errors
    /// [`Error::TimeStep`]; [`Error::Pose`]; [`Error::HeldNodeGone`] when the cloth has fewer nodes
    /// than at the capture; in a closing step those of [`select`]. The gripper is then as it was
    /// before the call.
    #[inline]
    pub fn step(
        &mut self,
        command: Command,
        dt: f64,
        cloth: ClothView<'_>,
    ) -> Result<Held<'_>, Error> {
        self.step_with(command, dt, cloth, Options::default())
    }

    /// [`Gripper::step`] with options.
    ///
    /// # Errors
    /// Those of [`Gripper::step`], and [`Error::Alpha`], [`Error::AnchorCount`], [`Error::Anchor`].
    pub fn step_with(
        &mut self,
        command: Command,
        dt: f64,
        cloth: ClothView<'_>,
        options: Options<'_>,
    ) -> Result<Held<'_>, Error> {
        self.prepare(&command, dt, cloth, &options)?;
        self.commit(&command, dt, cloth, &options);
        Ok(self.held())
    }

    /// Opens the jaws and forgets everything but the volume and the squeeze.
    pub fn reset(&mut self) {
        self.release();
        self.event = Event::Reset;
    }

    /// What the last step asked for.
    pub fn held(&self) -> Held<'_> {
        Held {
            nodes: &self.nodes,
            targets: &self.targets,
            velocities: &self.velocities,
        }
    }

    /// What happened in the last step.
    pub const fn event(&self) -> Event {
        self.event
    }

    /// The jaw state of the last step; open before the first.
    pub const fn jaw(&self) -> Jaw {
        self.jaw
    }

    /// `alpha` of the last step; 0 while the jaws are open.
    pub const fn alpha(&self) -> f64 {
        self.alpha
    }

    /// The held nodes, ascending and each once.
    pub fn nodes(&self) -> &[u32] {
        &self.nodes
    }

    /// Through which rules of the selection each held node came.
    pub fn rules(&self) -> &[Rules] {
        &self.rules
    }

    /// Where each held node is asked to be \[m\], gripper frame: `p_i` at the last step's `alpha`.
    pub fn local(&self) -> &[DVec3] {
        &self.local
    }

    /// The nodes, ascending, that were in the support of the last closing but that another gripper
    /// of the same [`crate::Grippers`] held. Forgotten on opening.
    pub fn refused(&self) -> &[u32] {
        &self.refused
    }

    /// The grasping volume.
    pub const fn volume(&self) -> GraspVolume {
        self.volume
    }

    /// The squeeze.
    pub const fn squeeze(&self) -> Squeeze {
        self.squeeze
    }

    /// Checks all that can fail in a step and, when the jaws close, finds the support. Nothing that
    /// can be seen from outside changes.
    // A carrying step takes some ten nanoseconds; handing the arguments on takes as long again.
    #[inline(always)]
    pub(crate) fn prepare(
        &mut self,
        command: &Command,
        dt: f64,
        cloth: ClothView<'_>,
        options: &Options<'_>,
    ) -> Result<(), Error> {
        let node_count = cloth.positions.len();
        if !(dt > 0.0 && dt.is_finite() && (1.0 / dt).is_finite()) {
            return Err(Error::TimeStep(dt));
        }
        if !command.pose.position().is_finite() {
            return Err(Error::Pose(command.pose.position()));
        }
        match options.alpha {
            Some(alpha) if !(0.0..=1.0).contains(&alpha) => return Err(Error::Alpha(alpha)),
            _ => {}
        }
        match options.anchors.map(<[DVec3]>::len) {
            Some(anchors) if anchors != node_count => {
                return Err(Error::AnchorCount {
                    anchors,
                    node_count,
                });
            }
            _ => {}
        }
        match (self.jaw, command.jaw) {
            (_, Jaw::Open) => {}
            (Jaw::Closed, Jaw::Closed) => match self.nodes.last() {
                Some(&node) if node as usize >= node_count => {
                    return Err(Error::HeldNodeGone { node, node_count });
                }
                _ => {}
            },
            (Jaw::Open, Jaw::Closed) => {
                select(&self.volume, &command.pose, cloth, &mut self.support)?;
                if let Some(anchors) = options.anchors {
                    for &node in self.support.nodes() {
                        let position = anchors[node as usize];
                        if !position.is_finite() {
                            return Err(Error::Anchor { node, position });
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// Leaves the nodes to others for which `taken` is true; between `prepare` and `commit` of a
    /// closing step.
    pub(crate) fn refuse(&mut self, taken: impl Fn(u32) -> bool) {
        let refused = &mut self.refused;
        self.support.refuse(|node| {
            let taken = taken(node);
            if taken {
                refused.push(node);
            }
            taken
        });
    }

    /// Takes the step that `prepare` has checked.
    // Inlined for the reason given at `prepare`.
    #[inline(always)]
    pub(crate) fn commit(
        &mut self,
        command: &Command,
        dt: f64,
        cloth: ClothView<'_>,
        options: &Options<'_>,
    ) {
        if !command.jaw.is_closed() {
            let was_closed = self.jaw.is_closed();
            let released = self.nodes.len();
            self.release();
            if was_closed {
                self.event = Event::Opened { released };
            }
            return;
        }

        let closing = !self.jaw.is_closed();
        self.event = Event::None;
        if closing {
            self.capture(command, cloth, options.anchors);
        }
        self.closed_steps = self.closed_steps.saturating_add(1);

        // Squeeze
        let alpha = options
            .alpha
            .unwrap_or_else(|| self.squeeze.progress(self.closed_steps));
        if closing || alpha != self.alpha {
            self.alpha = alpha;
            let centre_x = self.volume.offset().x;
            for (local, &p0) in self.local.iter_mut().zip(&self.captured) {
                *local = self.squeeze.squeezed(p0, centre_x, alpha);
            }
        }

        // Targets and velocities
        let position = command.pose.position();
        let rotation = command.pose.rotation_matrix();
        let per_second = 1.0 / dt;
        for ((target, velocity), &local) in self
            .targets
            .iter_mut()
            .zip(&mut self.velocities)
            .zip(&self.local)
        {
            let previous = *target;
            *target = position + rotation * local;
            *velocity = (*target - previous) * per_second;
        }
    }

    /// Takes the support over and stores its positions in the gripper frame.
    #[inline(never)]
    fn capture(&mut self, command: &Command, cloth: ClothView<'_>, anchors: Option<&[DVec3]>) {
        self.jaw = Jaw::Closed;
        self.nodes.extend_from_slice(self.support.nodes());
        self.rules.extend_from_slice(self.support.rules());
        let rotation = command.pose.rotation_matrix();
        let p_w = command.pose.position();
        for &node in &self.nodes {
            self.captured.push(match anchors {
                Some(anchors) => rotation.mul_transpose_vec3(anchors[node as usize] - p_w),
                None => self.support.local(node),
            });
            // The previous target, from which the velocity of the closing step is taken.
            self.targets.push(cloth.positions[node as usize]);
        }
        self.local.resize(self.nodes.len(), DVec3::ZERO);
        self.velocities.resize(self.nodes.len(), DVec3::ZERO);
        self.event = if self.nodes.is_empty() {
            Event::Empty
        } else {
            Event::Captured
        };
    }

    #[inline(never)]
    fn release(&mut self) {
        self.jaw = Jaw::Open;
        self.closed_steps = 0;
        self.alpha = 0.0;
        self.event = Event::None;
        self.nodes.clear();
        self.rules.clear();
        self.refused.clear();
        self.captured.clear();
        self.local.clear();
        self.targets.clear();
        self.velocities.clear();
    }
}

#[cfg(test)]
mod tests {
    use alloc::string::ToString;
    use alloc::vec;
    use core::f64::consts::FRAC_PI_2;

    use selvedge_math::{DQuat, Pose};

    use super::*;
    use crate::Shape;

    const DT: f64 = 0.125;

    fn gripper(squeeze: Squeeze) -> Gripper {
        let size = DVec3::splat(1.0);
        let volume = GraspVolume::new(Shape::Box { size }, DVec3::ZERO).unwrap();
        Gripper::new(volume, squeeze).unwrap()
    }

    const FIRM: Squeeze = Squeeze {
        amount: 0.0,
        lift: 0.0,
        steps: 1,
    };

    fn at(x: f64, jaw: Jaw) -> Command {
        Command {
            pose: Pose::from_translation(DVec3::X * x),
            jaw,
        }
    }

    fn nodes(positions: &[DVec3]) -> ClothView<'_> {
        ClothView {
            positions,
            ..ClothView::default()
        }
    }

    #[test]
    fn holds_from_closing_to_opening() {
        let mut gripper = gripper(FIRM);
        let x = [DVec3::ZERO, DVec3::X * 2.0];
        let cloth = nodes(&x);
        assert!(
            gripper
                .step(at(0.0, Jaw::Open), DT, cloth)
                .unwrap()
                .nodes
                .is_empty()
        );
        assert_eq!(gripper.event(), Event::None);
        assert_eq!(
            gripper.step(at(0.0, Jaw::Closed), DT, cloth).unwrap().nodes,
            [0]
        );
        assert_eq!(gripper.event(), Event::Captured);
        assert!(gripper.rules()[0].node && !gripper.rules()[0].edge);

        // Node 1 is inside the volume now, but the jaws are closed already.
        let held = gripper.step(at(2.0, Jaw::Closed), DT, cloth).unwrap();
        assert_eq!(held.nodes, [0]);
        assert_eq!(held.targets, [DVec3::X * 2.0]);
        assert_eq!(held.velocities, [DVec3::X * 16.0]);
        assert_eq!(gripper.event(), Event::None);

        assert!(
            gripper
                .step(at(2.0, Jaw::Open), DT, cloth)
                .unwrap()
                .nodes
                .is_empty()
        );
        assert_eq!(gripper.event(), Event::Opened { released: 1 });
        assert_eq!(
            gripper.step(at(2.0, Jaw::Closed), DT, cloth).unwrap().nodes,
            [1]
        );
    }

    #[test]
    fn an_empty_closing_stays_empty() {
        let mut gripper = gripper(FIRM);
        let far = [DVec3::X * 9.0];
        gripper.step(at(0.0, Jaw::Closed), DT, nodes(&far)).unwrap();
        assert_eq!(gripper.event(), Event::Empty);
        let near = [DVec3::ZERO];
        assert!(
            gripper
                .step(at(0.0, Jaw::Closed), DT, nodes(&near))
                .unwrap()
                .nodes
                .is_empty()
        );
        assert_eq!(gripper.event(), Event::None);
        gripper.step(at(0.0, Jaw::Open), DT, nodes(&near)).unwrap();
        assert_eq!(gripper.event(), Event::Opened { released: 0 });
    }

    #[test]
    fn squeezes_over_its_steps() {
        let mut gripper = gripper(Squeeze {
            amount: 1.0,
            lift: 0.5,
            steps: 2,
        });
        let x = [DVec3::X * 0.5];
        // The gripper's z points along the world's -x, its x along the world's z.
        let pose = Pose::new(DVec3::ZERO, DQuat::from_rotation_y(-FRAC_PI_2)).unwrap();
        let close = Command {
            pose,
            jaw: Jaw::Closed,
        };
        let held = gripper.step(close, DT, nodes(&x)).unwrap();
        assert!((held.targets[0] - DVec3::X * 0.25).length() < 1e-15);
        assert!((held.velocities[0] - DVec3::X * -2.0).length() < 1e-14);
        assert_eq!(gripper.alpha(), 0.5);
        gripper.step(close, DT, nodes(&x)).unwrap();
        assert!((gripper.local()[0] - DVec3::ZERO).length() < 1e-15);
        let held = gripper.step(close, DT, nodes(&x)).unwrap();
        assert_eq!(held.velocities, [DVec3::ZERO]);
        assert_eq!(gripper.alpha(), 1.0);
    }

    #[test]
    fn alpha_may_be_given() {
        let mut gripper = gripper(Squeeze {
            amount: 1.0,
            lift: 0.0,
            steps: 2,
        });
        let x = [DVec3::X * 0.5];
        for alpha in [0.0, 1.0, 0.25] {
            let options = Options {
                alpha: Some(alpha),
                ..Options::default()
            };
            let held = gripper.step_with(at(0.0, Jaw::Closed), DT, nodes(&x), options);
            assert_eq!(held.unwrap().targets, [DVec3::X * (0.5 - 0.5 * alpha)]);
        }
        gripper.step(at(0.0, Jaw::Closed), DT, nodes(&x)).unwrap();
        assert_eq!(gripper.alpha(), 1.0, "the count has gone on");
    }

    #[test]
    fn anchors_are_carried_but_do_not_select() {
        let mut gripper = gripper(FIRM);
        let x = [DVec3::ZERO, DVec3::X * 9.0];
        let anchors = [DVec3::Y * 0.25, DVec3::NAN];
        let options = Options {
            anchors: Some(&anchors),
            ..Options::default()
        };
        let close = at(0.0, Jaw::Closed);
        let held = gripper.step_with(close, DT, nodes(&x), options).unwrap();
        assert_eq!(held.nodes, [0]);
        assert_eq!(held.targets, [DVec3::Y * 0.25]);
        assert_eq!(held.velocities, [DVec3::Y * 2.0]);

        gripper.reset();
        let short = Options {
            anchors: Some(&anchors[..1]),
            ..Options::default()
        };
        let error = gripper.step_with(close, DT, nodes(&x), short).unwrap_err();
        assert!(error.to_string().contains("each of the 2 nodes, got 1"));
        let x = [DVec3::X * 9.0, DVec3::ZERO];
        let error = gripper
            .step_with(close, DT, nodes(&x), options)
            .unwrap_err();
        assert!(error.to_string().contains("captured node 1"));
        assert_eq!((gripper.jaw(), gripper.event()), (Jaw::Open, Event::Reset));
    }

    #[test]
    fn reset_forgets() {
        let mut gripper = gripper(Squeeze { steps: 3, ..FIRM });
        let x = [DVec3::ZERO];
        gripper.step(at(0.0, Jaw::Closed), DT, nodes(&x)).unwrap();
        gripper.reset();
        assert_eq!(gripper.event(), Event::Reset);
        assert!(gripper.nodes().is_empty() && !gripper.jaw().is_closed());
        // Closed right after the reset is a closing step again, with its squeeze from the start.
        gripper.step(at(0.0, Jaw::Closed), DT, nodes(&x)).unwrap();
        assert_eq!(gripper.event(), Event::Captured);
        assert_eq!(gripper.alpha(), 1.0 / 3.0);
    }

    #[test]
    fn a_failed_step_changes_nothing() {
        let x = vec![DVec3::ZERO, DVec3::X * 0.25];
        let bad_position = [DVec3::ZERO, DVec3::new(0.0, f64::NAN, 0.0)];
        let bad_edges = ClothView {
            edges: &[[0, 1], [1, 2]],
            ..nodes(&x)
        };
        let close = at(0.0, Jaw::Closed);
        let nowhere = Command {
            pose: Pose::from_translation(DVec3::NAN),
            ..close
        };
        let mut open = gripper(FIRM);
        for (command, dt, cloth, text) in [
            (close, 0.0, nodes(&x), "time step 0 s"),
            (close, 1e-310, nodes(&x), "time step"),
            (nowhere, DT, nodes(&x), "commanded position (NaN"),
            (close, DT, nodes(&bad_position), "of node 1 must be finite"),
            (
                close,
                DT,
                bad_edges,
                "node 2 of edge 1 must be below the node count 2",
            ),
        ] {
            let error = open.step(command, dt, cloth).unwrap_err().to_string();
            assert!(error.contains(text), "{error}");
            assert_eq!((open.jaw(), open.event()), (Jaw::Open, Event::None));
            assert!(open.held().nodes.is_empty());
        }
        let options = Options {
            alpha: Some(1.5),
            ..Options::default()
        };
        assert_eq!(
            open.step_with(close, DT, nodes(&x), options).unwrap_err(),
            Error::Alpha(1.5)
        );

        let mut closed = gripper(FIRM);
        closed.step(close, DT, nodes(&x)).unwrap();
        let error = closed
            .step(at(1.0, Jaw::Closed), DT, nodes(&x[..1]))
            .unwrap_err();
        assert!(error.to_string().contains("held node 1"));
        assert_eq!(closed.event(), Event::Captured);
        assert_eq!(closed.held().targets, x);
    }
}
