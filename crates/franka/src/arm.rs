//! An arm read from URDF: the only file that names urdf-rs.

use std::path::Path;

use selvedge_math::{DMat3, DQuat, DVec3, Pose, PoseError};
use urdf_rs::JointType;

use crate::body::{Body, Solid, mark_envelopes};
use crate::inverse::Geometry;
use crate::{Error, Limits};

/// Longest URDF text that is read [bytes].
const MAX_TEXT: usize = 16 << 20;
/// Longest chain of joints, fixed ones included.
const MAX_CHAIN: usize = 1000;

/// A serial arm from a base link to a tip link.
///
/// Fixed joints are merged, so there is one joint for each number of a configuration. Metres,
/// radians; poses are those of a link in the base link.
///
/// ```
/// use selvedge_franka::Arm;
/// let arm = Arm::fr3();
/// assert_eq!(arm.joints().len(), 7);
/// // Straight up but for the offset of the wrist, hand pointing down.
/// let pose = arm.forward(&[0.0; 7]);
/// assert!((pose.position() - selvedge_math::DVec3::new(0.088, 0.0, 0.8226)).length() < 1e-12);
/// ```
#[derive(Clone, Debug)]
pub struct Arm {
    name: String,
    joints: Vec<Joint>,
    links: Vec<Link>,
    /// From the last joint's frame to the tip.
    tool: Pose,
    geometry: Option<Geometry>,
    bodies: Vec<Body>,
    /// Collision shapes that are meshes, which are not read.
    meshes: usize,
}

/// A joint that moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Its name in the URDF.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// Its frame at zero in the frame of the joint before it, or in the base link.
    pub origin: Pose,
    /// Unit axis in its own frame.
    pub axis: DVec3,
    /// How far and how fast it goes.
    pub limits: Limits,
    /// `origin` as a matrix.
    pub(crate) rotation: DMat3,
}

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Turns within limits [rad].
    Revolute,
    /// Turns without limits [rad].
    Continuous,
    /// Slides within limits [m].
    Prismatic,
}

/// A link on the way, fixed to the frame of a joint.
#[derive(Clone, Debug)]
struct Link {
    name: String,
    /// How many joints come before it.
    joints: usize,
    /// From the frame of the last of them.
    offset: Pose,
}

impl Arm {
    /// The Franka Research 3 from `fr3_link0` to `fr3_hand_tcp`.
    pub fn fr3() -> Self {
        let text = include_str!("../../../fixtures/franka/fr3.urdf");
        built_in(text, "fr3_link0", "fr3_hand_tcp")
    }

    /// The Franka Emika Robot ("Panda") from `fer_link0` to `fer_hand_tcp`.
    pub fn fer() -> Self {
        let text = include_str!("../../../fixtures/franka/fer.urdf");
        built_in(text, "fer_link0", "fer_hand_tcp")
    }

    /// Reads a URDF file; as [`Arm::from_urdf`].
    ///
    /// # Errors
    /// [`Error::Read`], and those of [`Arm::from_urdf`].
    pub fn load(path: impl AsRef<Path>, base: &str, tip: &str) -> Result<Self, Error> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(|reason| Error::Read {
            path: path.to_owned(),
            reason,
        })?;
        Self::from_urdf(&text, base, tip)
    }

    /// The serial arm from link `base` to link `tip` of a URDF text.
    ///
    /// # Errors
    /// [`Error::Urdf`] for text that is not URDF or too long, [`Error::Xacro`] for macros that were
    /// not expanded, [`Error::NoLink`], [`Error::NoChain`] when the tip does not hang on the base,
    /// [`Error::Loop`], and [`Error::Joint`] for a joint of the chain that cannot be used.
    pub fn from_urdf(text: &str, base: &str, tip: &str) -> Result<Self, Error> {
        if text.len() > MAX_TEXT {
            let reason = format!("{} bytes, at most {MAX_TEXT} are read", text.len());
            return Err(Error::Urdf(reason));
        }
        if text.contains("<xacro:") {
            return Err(Error::Xacro);
        }
        let robot =
            urdf_rs::read_from_string(text).map_err(|error| Error::Urdf(error.to_string()))?;
        for link in [base, tip] {
            if !robot.links.iter().any(|other| other.name == link) {
                return Err(Error::NoLink(link.to_owned()));
            }
        }
        let chain = chain(&robot, base, tip)?;

        let mut joints = Vec::new();
        let mut offset = Pose::IDENTITY;
        let mut links = vec![Link {
            name: base.to_owned(),
            joints: 0,
            offset,
        }];
        for joint in chain {
            let refuse = |reason: &str| Error::Joint {
                joint: joint.name.clone(),
                reason: reason.to_owned(),
            };
            offset = offset * origin(joint).map_err(|reason| refuse(&reason))?;
            let kind = match joint.joint_type {
                JointType::Fixed => None,
                JointType::Revolute => Some(JointKind::Revolute),
                JointType::Continuous => Some(JointKind::Continuous),
                JointType::Prismatic => Some(JointKind::Prismatic),
                _ => {
                    return Err(refuse(
                        "has a type that is not fixed, revolute, continuous or prismatic",
                    ));
                }
            };
            if let Some(kind) = kind {
                if joint.mimic.is_some() {
                    return Err(refuse(
                        "mimics another joint; a serial arm has none that do",
                    ));
                }
                let axis = DVec3::from_array(*joint.axis.xyz);
                if !axis.is_finite() || axis.length() < 1e-9 {
                    return Err(refuse("has an axis that is zero or not finite"));
                }
                joints.push(Joint {
                    name: joint.name.clone(),
                    kind,
                    origin: offset,
                    axis: axis.normalize(),
                    limits: limits(joint, kind).map_err(|reason| refuse(&reason))?,
                    rotation: offset.rotation_matrix(),
                });
                offset = Pose::IDENTITY;
            }
            links.push(Link {
                name: joint.child.link.clone(),
                joints: joints.len(),
                offset,
            });
        }
        if joints.is_empty() {
            return Err(Error::NoChain {
                base: base.to_owned(),
                tip: tip.to_owned(),
            });
        }
        let geometry = Geometry::of(&joints);
        let (bodies, meshes) = bodies(&robot, &links)?;
        Ok(Self {
            name: robot.name,
            joints,
            links,
            tool: offset,
            geometry,
            bodies,
            meshes,
        })
    }

    /// The base and the tip of a URDF text that follows the maker's names: `*_link0` and
    /// `*_hand_tcp`. None when there is not exactly one of each.
    ///
    /// # Errors
    /// [`Error::Urdf`] for text that is not URDF.
    pub fn ends(text: &str) -> Result<Option<(String, String)>, Error> {
        let robot =
            urdf_rs::read_from_string(text).map_err(|error| Error::Urdf(error.to_string()))?;
        let only = |end: &str| {
            let mut names = robot.links.iter().filter(|link| link.name.ends_with(end));
            let first = names.next()?.name.clone();
            names.next().is_none().then_some(first)
        };
        Ok(only("_link0").zip(only("_hand_tcp")))
    }

    /// The robot's name in the URDF.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The joints that move, from the base on.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// From the frame of the last joint to the tip link.
    pub fn tool(&self) -> Pose {
        self.tool
    }

    /// The links on the way from base to tip.
    pub fn links(&self) -> impl Iterator<Item = &str> {
        self.links.iter().map(|link| link.name.as_str())
    }

    /// How many joints come before a link, and the link's pose in the frame of the last of them.
    pub(crate) fn link(&self, name: &str) -> Option<(usize, Pose)> {
        let link = self.links.iter().find(|link| link.name == name)?;
        Some((link.joints, link.offset))
    }

    /// What the arm and all that hangs on it is made of.
    pub(crate) fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// How many collision shapes of the description are meshes, which distances leave out.
    pub fn mesh_count(&self) -> usize {
        self.meshes
    }

    /// The lengths that the exact inverse needs, if the arm has the shape of a Franka.
    pub(crate) fn geometry(&self) -> Option<&Geometry> {
        self.geometry.as_ref()
    }
}

/// Reads a description that the tests have read before.
fn built_in(text: &str, base: &str, tip: &str) -> Arm {
    match Arm::from_urdf(text, base, tip) {
        Ok(arm) => arm,
        Err(error) => unreachable!("a built-in description is sound: {error}"),
    }
}

/// The joints from base to tip.
fn chain<'a>(
    robot: &'a urdf_rs::Robot,
    base: &str,
    tip: &str,
) -> Result<Vec<&'a urdf_rs::Joint>, Error> {
    let mut chain = Vec::new();
    let mut link = tip;
    while link != base {
        let mut parents = robot.joints.iter().filter(|joint| joint.child.link == link);
        let Some(joint) = parents.next() else {
            return Err(Error::NoChain {
                base: base.to_owned(),
                tip: tip.to_owned(),
            });
        };
        if parents.next().is_some() || chain.len() >= MAX_CHAIN.min(robot.joints.len()) {
            return Err(Error::Loop(link.to_owned()));
        }
        if !robot
            .links
            .iter()
            .any(|other| other.name == joint.parent.link)
        {
            return Err(Error::NoLink(joint.parent.link.clone()));
        }
        chain.push(joint);
        link = &joint.parent.link;
    }
    chain.reverse();
    Ok(chain)
}

fn origin(joint: &urdf_rs::Joint) -> Result<Pose, String> {
    pose(&joint.origin).map_err(|error| format!("has an origin that cannot be used: {error}"))
}

/// URDF's fixed-axis angles: `R = Rz(yaw) Ry(pitch) Rx(roll)`.
fn pose(origin: &urdf_rs::Pose) -> Result<Pose, PoseError> {
    let [roll, pitch, yaw] = *origin.rpy;
    let rotation =
        DQuat::from_rotation_z(yaw) * DQuat::from_rotation_y(pitch) * DQuat::from_rotation_x(roll);
    Pose::new(DVec3::from_array(*origin.xyz), rotation)
}

// ---- Collision shapes

/// The bodies of every link that is on the chain or hangs on it, and how many meshes were left out.
fn bodies(robot: &urdf_rs::Robot, chain: &[Link]) -> Result<(Vec<Body>, usize), Error> {
    let (mut bodies, mut meshes) = (Vec::new(), 0);
    for link in &robot.links {
        if link.collision.is_empty() {
            continue;
        }
        let Some((joints, poses)) = hangs(robot, chain, &link.name)? else {
            continue;
        };
        for solid in solids(link, &mut meshes)? {
            bodies.push(Body {
                link: link.name.clone(),
                joints,
                solids: poses.map(|pose| solid.moved(&pose)),
                envelope: false,
            });
        }
    }
    mark_envelopes(&mut bodies);
    Ok((bodies, meshes))
}

/// How many joints of the chain move a link, and its pose behind them with the joints that are not
/// of the chain (those of the fingers) at their lower and at their upper limit.
fn hangs(
    robot: &urdf_rs::Robot,
    chain: &[Link],
    name: &str,
) -> Result<Option<(usize, [Pose; 2])>, Error> {
    let mut poses = [Pose::IDENTITY; 2];
    let mut at = name;
    for _ in 0..=robot.joints.len().min(MAX_CHAIN) {
        if let Some(link) = chain.iter().find(|link| link.name == at) {
            return Ok(Some((link.joints, poses.map(|pose| link.offset * pose))));
        }
        let Some(joint) = robot.joints.iter().find(|joint| joint.child.link == at) else {
            return Ok(None);
        };
        let refuse = |reason: String| Error::Joint {
            joint: joint.name.clone(),
            reason,
        };
        let origin = origin(joint).map_err(refuse)?;
        let range =
            joint
                .mimic
                .as_ref()
                .map_or(Ok([joint.limit.lower, joint.limit.upper]), |m| {
                    let other = robot.joints.iter().find(|other| other.name == m.joint);
                    let limit = &other
                        .ok_or_else(|| refuse(format!("mimics {}, which is not there", m.joint)))?
                        .limit;
                    let (factor, offset) = (m.multiplier.unwrap_or(1.0), m.offset.unwrap_or(0.0));
                    Ok([limit.lower, limit.upper].map(|q| factor * q + offset))
                })?;
        let axis = DVec3::from_array(*joint.axis.xyz).normalize_or_zero();
        for (pose, q) in poses.iter_mut().zip(range) {
            let motion = match joint.joint_type {
                JointType::Prismatic => Pose::new(q * axis, DQuat::IDENTITY),
                JointType::Revolute if axis != DVec3::ZERO => {
                    Pose::new(DVec3::ZERO, DQuat::from_axis_angle(axis, q))
                }
                _ => Ok(Pose::IDENTITY),
            };
            let motion = motion.map_err(|error| refuse(format!("cannot be placed: {error}")))?;
            *pose = origin * motion * *pose;
        }
        at = &joint.parent.link;
    }
    Err(Error::Loop(name.to_owned()))
}

/// The shapes of one link in its frame. A cylinder with a sphere of its radius at both ends is one
/// capsule, which is how URDF says capsule.
fn solids(link: &urdf_rs::Link, meshes: &mut usize) -> Result<Vec<Solid>, Error> {
    let refuse = |reason: String| Error::Urdf(format!("collision of link {} {reason}", link.name));
    let size = |what: &str, value: f64| match value.is_finite() && value >= 0.0 {
        true => Ok(value),
        false => Err(refuse(format!("has {what} {value}, must be 0 or more"))),
    };
    let (mut solids, mut spheres) = (Vec::new(), Vec::new());
    for collision in &link.collision {
        let pose =
            pose(&collision.origin).map_err(|error| refuse(format!("has an origin: {error}")))?;
        let ends = |length: f64| [-0.5, 0.5].map(|k| pose.transform(DVec3::Z * (k * length)));
        match &collision.geometry {
            urdf_rs::Geometry::Box { size: edges } => {
                for edge in edges.iter() {
                    size("an edge of", *edge)?;
                }
                solids.push(Solid::Box {
                    centre: pose.position(),
                    halves: pose.rotation_matrix()
                        * DMat3::from_diagonal(0.5 * DVec3::from_array(**edges)),
                });
            }
            urdf_rs::Geometry::Cylinder { radius, length } => solids.push(Solid::Cylinder {
                ends: ends(size("length", *length)?),
                radius: size("radius", *radius)?,
            }),
            urdf_rs::Geometry::Capsule { radius, length } => solids.push(Solid::Capsule {
                ends: ends(size("length", *length)?),
                radius: size("radius", *radius)?,
            }),
            urdf_rs::Geometry::Sphere { radius } => {
                spheres.push((pose.position(), size("radius", *radius)?));
            }
            urdf_rs::Geometry::Mesh { .. } => *meshes += 1,
        }
    }
    let mut alone = vec![true; spheres.len()];
    for solid in &mut solids {
        if let Solid::Cylinder { ends, radius } = *solid {
            let at = ends.map(|end| {
                let near =
                    |s: &(DVec3, f64)| s.0.distance(end) < 1e-6 && (s.1 - radius).abs() < 1e-6;
                spheres.iter().position(near)
            });
            if let [Some(a), Some(b)] = at {
                (alone[a], alone[b]) = (false, false);
                *solid = Solid::Capsule { ends, radius };
            }
        }
    }
    for (&(centre, radius), _) in spheres.iter().zip(alone).filter(|(_, alone)| *alone) {
        let ends = [centre; 2];
        solids.push(Solid::Capsule { ends, radius });
    }
    Ok(solids)
}

fn limits(joint: &urdf_rs::Joint, kind: JointKind) -> Result<Limits, String> {
    let limit = &joint.limit;
    let (lower, upper) = match kind {
        JointKind::Continuous => (f64::NEG_INFINITY, f64::INFINITY),
        JointKind::Revolute | JointKind::Prismatic => (limit.lower, limit.upper),
    };
    if lower.is_nan() || upper.is_nan() || lower > upper {
        return Err(format!(
            "has limits from {lower} to {upper}, lower must not be above upper"
        ));
    }
    let velocity = if limit.velocity > 0.0 {
        limit.velocity
    } else {
        f64::INFINITY
    };
    let effort = if limit.effort > 0.0 {
        limit.effort
    } else {
        f64::INFINITY
    };
    if velocity.is_nan() || effort.is_nan() {
        return Err("has a velocity or effort limit that is not a number".to_owned());
    }
    Ok(Limits {
        lower,
        upper,
        velocity,
        effort,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The maker's own expansion is not kept here; with its folder in
    /// `SELVEDGE_FRANKA_DESCRIPTION` inertias and collision shapes are compared number by number.
    /// Shapes are on links of their own there (`*_sc`), rounder by a safety distance of 30 mm.
    #[test]
    fn bodies_and_inertias_are_the_makers() {
        let Some(folder) = std::env::var_os("SELVEDGE_FRANKA_DESCRIPTION") else {
            println!("skipped: SELVEDGE_FRANKA_DESCRIPTION is not set");
            return;
        };
        const SAFETY: f64 = 0.03;
        for (name, ours) in [
            ("fr3", include_str!("../../../fixtures/franka/fr3.urdf")),
            ("fer", include_str!("../../../fixtures/franka/fer.urdf")),
        ] {
            let path = Path::new(&folder).join(format!("{name}.urdf"));
            let theirs = std::fs::read_to_string(path).unwrap();
            let [ours, theirs] = [ours, &theirs].map(|text| {
                let ends = [format!("{name}_link0"), format!("{name}_hand_tcp")];
                let arm = Arm::from_urdf(text, &ends[0], &ends[1]).unwrap();
                (urdf_rs::read_from_string(text).unwrap(), arm.bodies)
            });
            // Bodies, in the order of the links
            let link = |body: &Body| body.link.trim_end_matches("_sc").to_owned();
            let of = |bodies: &[Body], name: &str| {
                let of_link = bodies.iter().filter(|body| link(body) == name);
                of_link.cloned().collect::<Vec<_>>()
            };
            let names: Vec<String> = ours.1.iter().map(link).collect();
            assert_eq!(ours.1.len(), theirs.1.len());
            for name in &names {
                let pairs = of(&ours.1, name).into_iter().zip(of(&theirs.1, name));
                assert_eq!(of(&ours.1, name).len(), of(&theirs.1, name).len(), "{name}");
                for (a, b) in pairs {
                    assert_eq!(a.joints, b.joints);
                    for pair in a.solids.into_iter().zip(b.solids) {
                        match pair {
                            (
                                Solid::Capsule { ends: p, radius: r },
                                Solid::Capsule { ends: q, radius: s },
                            ) => {
                                let same = p[0].distance(q[0]) + p[1].distance(q[1]);
                                let turned = p[0].distance(q[1]) + p[1].distance(q[0]);
                                assert!(same.min(turned) < 1e-9, "{name} {p:?} {q:?}");
                                assert!((r + SAFETY - s).abs() < 1e-12, "{name}");
                            }
                            (
                                Solid::Box {
                                    centre: c,
                                    halves: h,
                                },
                                Solid::Box {
                                    centre: d,
                                    halves: g,
                                },
                            ) => {
                                assert!(c.distance(d) < 1e-12, "{name}");
                                // Half edges may point either way.
                                for (a, b) in [
                                    (h.x_axis, g.x_axis),
                                    (h.y_axis, g.y_axis),
                                    (h.z_axis, g.z_axis),
                                ] {
                                    let apart = a.distance(b).min(a.distance(-b));
                                    assert!(apart < 1e-12, "{name} {a} {b}");
                                }
                            }
                            pair => panic!("{name}: {pair:?}"),
                        }
                    }
                }
            }
            // Inertias
            let mut compared = 0;
            for link in &ours.0.links {
                let mut others = theirs.0.links.iter();
                let other = others.find(|other| other.name == link.name).unwrap();
                let numbers = |link: &urdf_rs::Link| {
                    let (i, at) = (&link.inertial.inertia, &link.inertial.origin);
                    let [x, y, z] = *at.xyz;
                    let mass = link.inertial.mass.value;
                    [mass, x, y, z, i.ixx, i.ixy, i.ixz, i.iyy, i.iyz, i.izz]
                };
                assert_eq!(numbers(link), numbers(other), "{}", link.name);
                assert_eq!(*link.inertial.origin.rpy, [0.0; 3]);
                compared += usize::from(numbers(link)[0] > 0.0);
            }
            assert_eq!(compared, 11, "{name}");
        }
    }
}
