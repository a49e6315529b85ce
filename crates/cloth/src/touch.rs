//! Edges and faces of the cloth on edges, corners and round sides of an obstacle, in its own frame.
//!
//! A part of the cloth is an edge, given as three points of which the last two are the same, or a
//! triangle. Its nodes are not looked at here: they have planes of their own, see `shape`.

use selvedge_math::DVec3;

use crate::broad::Bounds;
use crate::distance::{
    Course, Kind, advance, nearest_on_segment, nearest_on_segments, nearest_on_triangle,
};
use crate::shape::Shape;
use crate::solid::{DEPTH, Feature, SLACK, Solid};

/// Touches are looked for so near a part's way [m].
const REACH: f64 = 1e-3;
/// A touch that is so deep is a mistake unless the point is inside [m].
const SHALLOW: f64 = 2.0 * DEPTH;
/// A touch so near an end of the part is its node's, in weights.
const END: f64 = 1e-3;
/// Edges that are nearly parallel have no common normal.
const CROSSING: f64 = 0.02;
/// The distance from what is moved inwards may shrink to this share.
const LEAST_SHARE: f64 = 0.1;

/// A part that is near an obstacle: `normal . sum w x >= normal . point`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Touch {
    pub(crate) weights: [f64; 3],
    pub(crate) normal: DVec3,
    pub(crate) point: DVec3,
    /// At the positions that it was found at, negative inside [m].
    pub(crate) distance: f64,
    /// Which feature of the obstacle it is.
    pub(crate) feature: u32,
}

impl Touch {
    fn new(weights: [f64; 3], normal: DVec3, point: DVec3, x: &[DVec3; 3]) -> Self {
        Self {
            weights,
            normal,
            point,
            distance: normal.dot(mix(&weights, x) - point),
            feature: 0,
        }
    }
}

/// `sum w x`.
pub(crate) fn mix(weights: &[f64; 3], x: &[DVec3; 3]) -> DVec3 {
    x[0] * weights[0] + x[1] * weights[1] + x[2] * weights[2]
}

impl Shape {
    /// Calls `each` with every touch of a part on its way from `start` to `ahead`.
    pub(crate) fn touches(
        &self,
        is_edge: bool,
        start: &[DVec3; 3],
        ahead: &[DVec3; 3],
        mut each: impl FnMut(Touch),
    ) {
        match self {
            Self::HalfSpace { .. } => {}
            Self::Round { core, radius } => {
                let places: &[[DVec3; 2]] = match is_edge {
                    true => &[*core],
                    false if core[0] == core[1] => &[[core[0]; 2]],
                    false => &[[core[0]; 2], [core[1]; 2]],
                };
                for (feature, place) in (0..).zip(places) {
                    let at = |x| on_core(is_edge, x, *place, *radius);
                    if let Some(touch) = at(ahead).or_else(|| at(start)) {
                        each(Touch { feature, ..touch });
                    }
                }
            }
            Self::Solid(solid) => {
                let (mut shallow, mut deep) = (false, None::<Touch>);
                for feature in solid.near(&way(start, ahead, REACH)) {
                    let at = |x| on_feature(is_edge, x, solid.feature(feature));
                    let Some(touch) =
                        at(start).or_else(|| at(ahead).filter(|b| b.distance > -REACH))
                    else {
                        continue;
                    };
                    let touch = Touch { feature, ..touch };
                    if touch.distance >= -SHALLOW {
                        shallow = true;
                        each(touch);
                    } else if deep.is_none_or(|d| d.distance < touch.distance)
                        && is_inside(solid, &touch, start)
                    {
                        deep = Some(touch);
                    }
                }
                if let (false, Some(touch)) = (shallow, deep) {
                    each(touch);
                }
            }
        }
    }

    /// The share of a part's way from `start` to `end` on which it gets no deeper than `DEPTH` into
    /// the obstacle: 1 for the whole way, never too much. A part that is deeper at the start is not
    /// held back.
    pub(crate) fn free_way(&self, is_edge: bool, start: &[DVec3; 3], end: &[DVec3; 3]) -> f64 {
        match self {
            Self::HalfSpace { .. } => 1.0,
            // A face has its edges.
            Self::Round { .. } if is_edge => 1.0,
            Self::Round { core, radius } => {
                let longest = [0, 1, 2].map(|k| start[k].distance(end[k]));
                let bound = longest.into_iter().fold(0.0, f64::max);
                let distance = |t| {
                    let x = [0, 1, 2].map(|k| start[k].lerp(end[k], t));
                    distance_from_core(&x, core)
                };
                let (at_start, least) = (distance(0.0), radius - DEPTH);
                match at_start > least {
                    true => advance(bound, at_start, least + LEAST_SHARE * DEPTH, distance),
                    false => 1.0,
                }
            }
            Self::Solid(solid) => {
                let mut free = 1.0_f64;
                for k in solid.near(&way(start, end, 2.0 * DEPTH)) {
                    let feature = solid.feature(k);
                    let sunk = |touch: &Touch| {
                        let touch = Touch {
                            feature: k,
                            ..*touch
                        };
                        touch.distance < -DEPTH && is_inside(solid, &touch, start)
                    };
                    if on_feature(is_edge, start, feature).is_some_and(|touch| sunk(&touch)) {
                        return 1.0;
                    }
                    let way = match (is_edge, feature) {
                        (true, Feature::Edge { inner: [p, q], .. }) => {
                            let with = |x: &[DVec3; 3]| [x[0], x[1], *p, *q];
                            Course::new(Kind::EdgeEdge, &with(start), &with(end)).free(LEAST_SHARE)
                        }
                        (false, Feature::Corner { inner, .. }) => {
                            let with = |x: &[DVec3; 3]| [*inner, x[0], x[1], x[2]];
                            Course::new(Kind::NodeTriangle, &with(start), &with(end))
                                .free(LEAST_SHARE)
                        }
                        _ => 1.0,
                    };
                    free = free.min(way);
                }
                free
            }
        }
    }
}

/// The box around the way of a part.
fn way(start: &[DVec3; 3], end: &[DVec3; 3], reach: f64) -> Bounds {
    let all = [start[1], start[2], end[0], end[1], end[2]];
    Bounds {
        low: all.iter().fold(start[0], |a, b| a.min(*b)) - reach,
        high: all.iter().fold(start[0], |a, b| a.max(*b)) + reach,
    }
}

/// Whether the touching point of the part is behind the feature and inside the solid.
fn is_inside(solid: &Solid, touch: &Touch, x: &[DVec3; 3]) -> bool {
    let (Feature::Edge { outward, .. } | Feature::Corner { outward, .. }) =
        solid.feature(touch.feature);
    solid
        .foot(mix(&touch.weights, x) - *outward * (0.1 * DEPTH))
        .distance
        < 0.0
}

fn on_core(is_edge: bool, x: &[DVec3; 3], core: [DVec3; 2], radius: f64) -> Option<Touch> {
    let (weights, centre) = if is_edge {
        let (s, centre) = if core[0] == core[1] {
            (nearest_on_segment(core[0], [x[0], x[1]]), core[0])
        } else {
            let [s, t] = nearest_on_segments([x[0], x[1]], core);
            (s, core[0].lerp(core[1], t))
        };
        ([1.0 - s, s, 0.0], centre)
    } else {
        (nearest_on_triangle(core[0], *x), core[0])
    };
    let count = if is_edge { 2 } else { 3 };
    if weights[..count].iter().any(|w| *w < END) {
        return None;
    }
    let normal = (mix(&weights, x) - centre).try_normalize()?;
    Some(Touch::new(weights, normal, centre + normal * radius, x))
}

fn on_feature(is_edge: bool, x: &[DVec3; 3], feature: &Feature) -> Option<Touch> {
    match feature {
        Feature::Edge {
            ends,
            outward,
            least,
            ..
        } if is_edge => {
            let (u, v) = (x[1] - x[0], ends[1] - ends[0]);
            let cross = u.cross(v);
            let sine_squared = cross.length_squared() / (u.length_squared() * v.length_squared());
            let normal = cross.try_normalize()?;
            if sine_squared < CROSSING * CROSSING {
                return None;
            }
            let along = normal.dot(*outward);
            if along.abs() < least - SLACK {
                return None;
            }
            let [s, t] = nearest_on_segments([x[0], x[1]], *ends);
            if !(END..=1.0 - END).contains(&s) || t <= 0.0 || t >= 1.0 {
                return None;
            }
            let normal = normal * along.signum();
            Some(Touch::new(
                [1.0 - s, s, 0.0],
                normal,
                ends[0].lerp(ends[1], t),
                x,
            ))
        }
        Feature::Corner {
            point,
            outward,
            arms,
            ..
        } if !is_edge => {
            let normal = (x[1] - x[0]).cross(x[2] - x[0]).try_normalize()?;
            let normal = normal * normal.dot(*outward).signum();
            if arms.iter().any(|arm| arm.dot(normal) > SLACK) {
                return None;
            }
            let foot = *point + normal * normal.dot(x[0] - *point);
            let weights = nearest_on_triangle(foot, *x);
            // Outside the triangle the nearest point is another one than the foot.
            let inside = mix(&weights, x).distance_squared(foot) < 1e-16;
            inside.then(|| Touch::new(weights, normal, *point, x))
        }
        _ => None,
    }
}

fn distance_from_core(x: &[DVec3; 3], core: &[DVec3; 2]) -> f64 {
    let to_end = |p: DVec3| mix(&nearest_on_triangle(p, *x), x).distance(p);
    if core[0] == core[1] {
        return to_end(core[0]);
    }
    let sides = [[x[0], x[1]], [x[1], x[2]], [x[2], x[0]]];
    let to_side = |side: [DVec3; 2]| {
        let [s, t] = nearest_on_segments(side, *core);
        side[0].lerp(side[1], s).distance(core[0].lerp(core[1], t))
    };
    let ends = to_end(core[0]).min(to_end(core[1]));
    sides.into_iter().map(to_side).fold(ends, f64::min)
}
