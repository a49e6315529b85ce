//! From the world to the picture.

use selvedge_math::DVec3;

/// A perspective camera that looks at a point, z up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// What is in the middle of the picture [m, world].
    pub target: DVec3,
    /// Direction from the target to the camera, as an angle about z from x [rad].
    pub azimuth: f64,
    /// The same, above the horizon [rad]: within half a turn, less than straight up or down.
    pub elevation: f64,
    /// From the target to the camera [m].
    pub distance: f64,
}

/// Half the angle that the shorter side of the picture sees [rad].
const HALF_ANGLE: f64 = 0.22;
/// Where a camera stands if nothing else is said [rad].
const AZIMUTH: f64 = -1.05;
const ELEVATION: f64 = 0.62;
/// Share of the picture that what is shown may fill.
const FILL: f64 = 0.92;

impl Camera {
    /// The camera that sees all of the points as large as a picture of `width` by `height` allows,
    /// from the front right and above.
    pub fn around(points: impl IntoIterator<Item = DVec3>, width: u32, height: u32) -> Self {
        let outermost = outermost(points);
        let middle = 0.5 * (outermost[0] + outermost[1]);
        let radius = |p: &DVec3| p.distance(middle);
        let radius = outermost.iter().map(radius).fold(1e-3, f64::max);
        let mut camera = Self {
            target: middle,
            azimuth: AZIMUTH,
            elevation: ELEVATION,
            distance: 10.0 * radius,
        };
        // Perspective makes this no formula; a few turns are exact to the pixel.
        for _ in 0..12 {
            let screen = Screen::new(&camera, width, height);
            let (mut left, mut right, mut far) = (f64::INFINITY, f64::NEG_INFINITY, 0.0_f64);
            let (mut top, mut bottom) = (f64::INFINITY, f64::NEG_INFINITY);
            for point in &outermost {
                let Some([x, y, _]) = screen.project(*point) else {
                    continue;
                };
                (left, right) = (left.min(x), right.max(x));
                (top, bottom) = (top.min(y), bottom.max(y));
                far = far.max(point.distance(camera.target));
            }
            let [w, h] = [f64::from(width), f64::from(height)];
            let share = ((right - left) / w).max((bottom - top) / h);
            let pixel = camera.distance / screen.scale;
            let shift = [0.5 * (left + right - w), 0.5 * (top + bottom - h)];
            camera.target += pixel * (shift[0] * screen.right - shift[1] * screen.up);
            let nearest = (1.2 * far).max(2.0 * radius);
            camera.distance = (camera.distance * share / FILL).max(nearest);
        }
        camera
    }
}

/// The points that lie farthest in each of 26 directions, opposite ones beside each other; some if
/// there are none.
fn outermost(points: impl IntoIterator<Item = DVec3>) -> Vec<DVec3> {
    let signs = [-1.0, 0.0, 1.0];
    let all = signs.map(|x| signs.map(|y| signs.map(|z| DVec3::new(x, y, z))));
    // The first 13 of 27; the middle one is no direction.
    let half: Vec<DVec3> = all.as_flattened().as_flattened()[..13].to_vec();
    let directions: Vec<DVec3> = half.iter().flat_map(|d| [*d, -*d]).collect();
    let mut best = vec![(f64::NEG_INFINITY, DVec3::ZERO); directions.len()];
    for point in points {
        for ((far, at), direction) in best.iter_mut().zip(&directions) {
            let along = point.dot(*direction);
            if along > *far {
                (*far, *at) = (along, point);
            }
        }
    }
    best.into_iter().map(|(_, at)| at).collect()
}

/// The camera's axes, and where a picture's pixels are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Screen {
    eye: DVec3,
    pub(crate) right: DVec3,
    pub(crate) up: DVec3,
    back: DVec3,
    /// Pixels a unit at depth 1.
    scale: f64,
    middle: [f64; 2],
}

impl Screen {
    pub(crate) fn new(camera: &Camera, width: u32, height: u32) -> Self {
        let (sin, cos) = camera.azimuth.sin_cos();
        let (rise, run) = camera.elevation.sin_cos();
        let back = DVec3::new(cos * run, sin * run, rise);
        let right = DVec3::Z.cross(back).try_normalize().unwrap_or(DVec3::X);
        Self {
            eye: camera.target + camera.distance * back,
            right,
            up: back.cross(right),
            back,
            scale: 0.5 * f64::from(width.min(height)) / HALF_ANGLE.tan(),
            middle: [0.5 * f64::from(width), 0.5 * f64::from(height)],
        }
    }

    /// The pixel of a point, y downwards, and how near it is as one over its depth; none for a point
    /// that is not in front of the camera.
    pub(crate) fn project(&self, point: DVec3) -> Option<[f64; 3]> {
        let to = point - self.eye;
        let near = 1.0 / -to.dot(self.back);
        let in_front = near > 0.0 && near < 1e3;
        in_front.then(|| {
            let x = self.middle[0] + self.scale * near * to.dot(self.right);
            let y = self.middle[1] - self.scale * near * to.dot(self.up);
            [x, y, near]
        })
    }

    /// Whether a surface with this normal turns its front to the camera.
    pub(crate) fn sees_front(&self, point: DVec3, normal: DVec3) -> bool {
        (self.eye - point).dot(normal) > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_target_is_in_the_middle_and_up_is_up() {
        let camera = Camera {
            target: DVec3::new(1.0, 2.0, 3.0),
            azimuth: -1.0,
            elevation: 0.5,
            distance: 2.0,
        };
        let screen = Screen::new(&camera, 400, 300);
        let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
        let middle = screen.project(camera.target).unwrap();
        assert!(near(middle, [200.0, 150.0, 0.5]), "{middle:?}");
        let above = screen.project(camera.target + 0.1 * DVec3::Z).unwrap();
        assert!((above[0] - 200.0).abs() < 1e-9 && above[1] < 150.0);
        assert_eq!(screen.project(camera.target + 10.0 * screen.back), None);
    }

    #[test]
    fn what_it_stands_around_fills_the_picture_and_no_more() {
        let points: Vec<DVec3> = (0..100)
            .map(|k| {
                let (sin, cos) = f64::from(k).sin_cos();
                DVec3::new(0.4 * cos, 0.2 * sin, 0.003 * f64::from(k))
            })
            .collect();
        for [width, height] in [[640, 480], [300, 700]] {
            let camera = Camera::around(points.iter().copied(), width, height);
            let screen = Screen::new(&camera, width, height);
            let mut most = 0.0_f64;
            for point in &points {
                let [x, y, _] = screen.project(*point).unwrap();
                let share = |x: f64, of: u32| (2.0 * x / f64::from(of) - 1.0).abs();
                most = most.max(share(x, width)).max(share(y, height));
            }
            assert!((0.88..1.0).contains(&most), "{most}");
        }
        // Nothing, and a single point, are looked at from near.
        for points in [vec![], vec![DVec3::ONE]] {
            let camera = Camera::around(points, 640, 480);
            assert!(camera.target.is_finite() && camera.distance > 0.0);
        }
    }
}
