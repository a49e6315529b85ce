//! Closest points of the pairs that can touch: a node and a triangle, two edges (Ericson 2004,
//! chapter 5).

use selvedge_math::DVec3;

/// Weights of the point of the triangle `a b c` that is nearest to `p`.
pub(crate) fn nearest_on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = d1 / (d1 - d3);
        return [1.0 - t, t, 0.0];
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = d2 / (d2 - d6);
        return [1.0 - t, 0.0, t];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - t, t];
    }
    let scale = 1.0 / (va + vb + vc);
    let (v, w) = (vb * scale, vc * scale);
    [1.0 - v - w, v, w]
}

/// Parameters in `[0, 1]` of the nearest points of the segments `a` and `b`.
pub(crate) fn nearest_on_segments([a0, a1]: [DVec3; 2], [b0, b1]: [DVec3; 2]) -> [f64; 2] {
    let (u, v, r) = (a1 - a0, b1 - b0, a0 - b0);
    let (a, e, f) = (u.length_squared(), v.length_squared(), v.dot(r));
    let (b, c) = (u.dot(v), u.dot(r));
    let area = a * e - b * b;
    // Parallel segments: any point of the first will do.
    let mut s = match area > 1e-14 * a * e {
        true => ((b * f - c * e) / area).clamp(0.0, 1.0),
        false => 0.0,
    };
    let mut t = (b * s + f) / e;
    if t < 0.0 {
        t = 0.0;
        s = (-c / a).clamp(0.0, 1.0);
    } else if t > 1.0 {
        t = 1.0;
        s = ((b - c) / a).clamp(0.0, 1.0);
    }
    [s, t]
}

/// Parameter in `[0, 1]` of the nearest point of a segment, which may be a point.
pub(crate) fn nearest_on_segment(p: DVec3, [a, b]: [DVec3; 2]) -> f64 {
    let along = b - a;
    let squared = along.length_squared();
    match squared > 0.0 {
        true => ((p - a).dot(along) / squared).clamp(0.0, 1.0),
        false => 0.0,
    }
}

/// Two features that may touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Kind {
    /// The first node and the triangle of the other three.
    NodeTriangle,
    /// The edge of the first two nodes and that of the others.
    EdgeEdge,
}

/// How far the two features at most move towards each other when their nodes go these ways [m]: what
/// they have in common does not count.
#[inline]
pub(crate) fn approach(kind: Kind, ways: [DVec3; 4]) -> f64 {
    let mean = 0.25 * (ways[0] + ways[1] + ways[2] + ways[3]);
    let [a, b, c, d] = ways.map(|way| way.distance_squared(mean));
    let [first, second] = match kind {
        Kind::NodeTriangle => [a, b.max(c).max(d)],
        Kind::EdgeEdge => [a.max(b), c.max(d)],
    };
    first.sqrt() + second.sqrt()
}

/// Distance of the two features.
#[inline]
pub(crate) fn distance(kind: Kind, x: &[DVec3; 4]) -> f64 {
    combine(&weights(kind, x), x).length()
}

/// Weights `w` with `sum w x` the vector from the second feature's nearest point to the first's.
#[inline]
pub(crate) fn weights(kind: Kind, x: &[DVec3; 4]) -> [f64; 4] {
    match kind {
        Kind::NodeTriangle => {
            let [a, b, c] = nearest_on_triangle(x[0], [x[1], x[2], x[3]]);
            [1.0, -a, -b, -c]
        }
        Kind::EdgeEdge => {
            let [s, t] = nearest_on_segments([x[0], x[1]], [x[2], x[3]]);
            [1.0 - s, s, t - 1.0, -t]
        }
    }
}

/// `sum w x`.
#[inline]
pub(crate) fn combine(weights: &[f64; 4], x: &[DVec3; 4]) -> DVec3 {
    x[0] * weights[0] + x[1] * weights[1] + x[2] * weights[2] + x[3] * weights[3]
}

/// A pair whose nodes go straight from `start` to `end`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Course<'a> {
    kind: Kind,
    start: &'a [DVec3; 4],
    way: [DVec3; 4],
    /// Distance at the start, and by how much it changes at most [m].
    pub(crate) at_start: f64,
    pub(crate) bound: f64,
}

impl<'a> Course<'a> {
    #[inline]
    pub(crate) fn new(kind: Kind, start: &'a [DVec3; 4], end: &[DVec3; 4]) -> Self {
        let way = [0, 1, 2, 3].map(|k| end[k] - start[k]);
        Self {
            kind,
            start,
            way,
            at_start: distance(kind, start),
            bound: approach(kind, way),
        }
    }

    /// How far the pair can go before its distance has shrunk to `share` of that at the start: 1 for the
    /// whole way, never too much.
    ///
    /// Conservative advancement (Li et al. 2021, additive CCD): in the remaining way the distance cannot
    /// shrink by more than the two features move towards each other.
    #[inline]
    pub(crate) fn free(&self, share: f64) -> f64 {
        advance(self.bound, self.at_start, share * self.at_start, |t| {
            let at = [0, 1, 2, 3].map(|k| self.start[k] + t * self.way[k]);
            distance(self.kind, &at)
        })
    }
}

/// How far one can go in `[0, 1]` before a distance that changes by `bound` at most on the whole way
/// falls from that at the start to `least`: 1 for the whole way, never too much.
pub(crate) fn advance(bound: f64, at_start: f64, least: f64, distance: impl Fn(f64) -> f64) -> f64 {
    if at_start - least > bound {
        return 1.0;
    }
    let (mut t, mut d) = (0.0, at_start);
    for _ in 0..100 {
        let step = 0.9 * (d - least) / bound;
        // The whole way is free, or the rest of it is too short to matter.
        if t + step / 0.9 >= 1.0 {
            return 1.0;
        }
        t += step;
        d = distance(t);
        if d - least < 0.05 * (at_start - least) {
            return t;
        }
    }
    t
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(state: &mut u64) -> f64 {
        *state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (*state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    }

    fn point(state: &mut u64) -> DVec3 {
        DVec3::new(random(state), random(state), random(state))
    }

    /// Nothing on a fine raster of either feature is nearer than the nearest points.
    #[test]
    fn nearest_points_against_a_raster() {
        let mut state = 7;
        for _ in 0..300 {
            let x = [0; 4].map(|_| point(&mut state));
            for kind in [Kind::NodeTriangle, Kind::EdgeEdge] {
                let nearest = combine(&weights(kind, &x), &x).length();
                let mut least = f64::INFINITY;
                for i in 0..=20 {
                    for j in 0..=20 {
                        let (s, t) = (f64::from(i) / 20.0, f64::from(j) / 20.0);
                        let between = match kind {
                            Kind::NodeTriangle => {
                                x[0] - (x[1] + s * (x[2] - x[1]) + (1.0 - s) * t * (x[3] - x[1]))
                            }
                            Kind::EdgeEdge => x[0] + s * (x[1] - x[0]) - x[2] - t * (x[3] - x[2]),
                        };
                        least = least.min(between.length());
                    }
                }
                assert!(
                    nearest <= least + 1e-12 && nearest > least - 0.06,
                    "{kind:?}"
                );
            }
        }
    }

    /// Along the free way the distance stays above its share; where the way is cut, it ends near.
    #[test]
    fn a_free_way_is_free() {
        let mut state = 11;
        let mut cut = 0;
        for _ in 0..2000 {
            let start = [0; 4].map(|_| point(&mut state));
            let end = start.map(|x| x + 2.0 * point(&mut state));
            for kind in [Kind::NodeTriangle, Kind::EdgeEdge] {
                let at = |t: f64| [0, 1, 2, 3].map(|k| start[k].lerp(end[k], t));
                let course = Course::new(kind, &start, &end);
                let free = course.free(0.1);
                cut += usize::from(free < 1.0);
                for k in 0..=50 {
                    let d = distance(kind, &at(free * f64::from(k) / 50.0));
                    assert!(d >= 0.1 * course.at_start - 1e-12, "{kind:?} {d}");
                    let any = distance(kind, &at(f64::from(k) / 50.0));
                    assert!((any - course.at_start).abs() <= course.bound + 1e-12);
                }
            }
        }
        assert!(cut > 200, "{cut}");
    }
}
