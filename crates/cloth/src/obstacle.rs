//! Bodies that the cloth cannot enter.

use selvedge_math::{DVec3, Pose};

use crate::Error;
use crate::shape::Shape;
use crate::solid::{DEPTH, Solid};

/// The least half width of an obstacle [m]: what is thinner than edges may sink in could be passed.
const LEAST: f64 = 2.5 * DEPTH;
const LEAST_BOUND: &str = "at least 0.00025 and finite";

/// A body that the cloth cannot enter, at rest or moved by its user.
///
/// Shapes are given in the obstacle's own frame, in metres; [`at`](Self::at) says where that frame is.
/// The friction coefficient is Coulomb's, between cloth and obstacle. The cloth acts at its
/// mid-surface, as on the table.
///
/// ```
/// use selvedge_cloth::Obstacle;
/// use selvedge_math::{DVec3, Pose};
///
/// let ball = Obstacle::sphere(0.1, 0.3)?.at(Pose::from_translation(DVec3::Z * 0.1));
/// assert_eq!(ball.friction(), 0.3);
/// assert!(Obstacle::cuboid(DVec3::new(0.1, 0.1, 0.0), 0.3).is_err());
/// # Ok::<(), selvedge_cloth::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Obstacle {
    pub(crate) shape: Shape,
    pub(crate) pose: Pose,
    friction: f64,
}

impl Obstacle {
    /// The half space behind a plane, `normal . (x - point) <= 0`; the normal can have any length.
    ///
    /// # Errors
    /// [`Error`] when a value is out of its bounds.
    pub fn plane(point: DVec3, normal: DVec3, friction: f64) -> Result<Self, Error> {
        check_point("point of the plane [m]", point)?;
        let length = normal.length();
        Error::check_positive("length of the plane's normal", length)?;
        let normal = normal / length;
        Self::new(Shape::HalfSpace { point, normal }, friction)
    }

    /// A sphere around the origin.
    ///
    /// # Errors
    /// [`Error`] when a value is out of its bounds; the radius is at least 0.25 mm.
    pub fn sphere(radius: f64, friction: f64) -> Result<Self, Error> {
        Self::capsule([DVec3::ZERO; 2], radius, friction)
    }

    /// All points within `radius` of a segment: a cylinder with half a sphere on each end.
    ///
    /// # Errors
    /// [`Error`] when a value is out of its bounds; the radius is at least 0.25 mm.
    pub fn capsule(ends: [DVec3; 2], radius: f64, friction: f64) -> Result<Self, Error> {
        check_point("first end [m]", ends[0])?;
        check_point("second end [m]", ends[1])?;
        check_width("radius [m]", radius)?;
        Self::new(Shape::Round { core: ends, radius }, friction)
    }

    /// A box around the origin with edges along the axes, of twice these lengths.
    ///
    /// # Errors
    /// [`Error`] when a value is out of its bounds; half an extent is at least 0.25 mm.
    pub fn cuboid(half_extents: DVec3, friction: f64) -> Result<Self, Error> {
        for half in half_extents.to_array() {
            check_width("half extent [m]", half)?;
        }
        let corner = |k: u32| {
            let sign = |bit: u32| if k & bit == 0 { -1.0 } else { 1.0 };
            half_extents * DVec3::new(sign(1), sign(2), sign(4))
        };
        Self::convex(&[0, 1, 2, 3, 4, 5, 6, 7].map(corner), friction)
    }

    /// The convex hull of points.
    ///
    /// # Errors
    /// [`Error`] when a point is not finite or the hull is flat. It should nowhere be thinner than
    /// half a millimetre.
    pub fn convex(points: &[DVec3], friction: f64) -> Result<Self, Error> {
        Self::new(Shape::Solid(Box::new(Solid::hull(points)?)), friction)
    }

    /// The body within closed surfaces of triangles, which need not be convex.
    ///
    /// A point is inside when it is behind the nearest point of the surface, as its pseudonormal says
    /// (Baerentzen and Aanaes 2005). Triangles may be turned either way, but all the same. Sheets
    /// with a border have no inside; give them a thickness, of half a millimetre at least.
    ///
    /// # Errors
    /// [`Error`] when a point is not finite, a triangle has no area, or a side is not that of two
    /// triangles.
    pub fn mesh(points: &[DVec3], triangles: &[[u32; 3]], friction: f64) -> Result<Self, Error> {
        let solid = Solid::new(points.to_vec(), triangles.to_vec())?;
        Self::new(Shape::Solid(Box::new(solid)), friction)
    }

    fn new(shape: Shape, friction: f64) -> Result<Self, Error> {
        Error::check_not_negative("friction of the obstacle", friction)?;
        Ok(Self {
            shape,
            pose: Pose::IDENTITY,
            friction,
        })
    }

    /// The same obstacle with its frame at a pose.
    #[must_use]
    pub fn at(self, pose: Pose) -> Self {
        Self { pose, ..self }
    }

    /// Where the obstacle's frame is: from the obstacle to the world.
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// Coulomb coefficient between cloth and obstacle.
    pub fn friction(&self) -> f64 {
        self.friction
    }

    /// Distance of a point of the world from the surface [m], negative inside.
    pub fn distance(&self, point: DVec3) -> f64 {
        self.shape.foot(self.pose.inverse_transform(point)).distance
    }
}

fn check_point(field: &'static str, point: DVec3) -> Result<(), Error> {
    match point.to_array().into_iter().find(|x| !x.is_finite()) {
        None => Ok(()),
        Some(value) => Err(Error::Value {
            field,
            value,
            bound: "finite",
        }),
    }
}

fn check_width(field: &'static str, value: f64) -> Result<(), Error> {
    if value >= LEAST && value.is_finite() {
        Ok(())
    } else {
        Err(Error::Value {
            field,
            value,
            bound: LEAST_BOUND,
        })
    }
}
