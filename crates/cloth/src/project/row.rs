//! One constraint of the projection: the product of two differences of nodes.

use selvedge_math::DVec3;

/// `C = (x_a1 - x_a0) . (x_b1 - x_b0) - rest`, and `C = compliance * multiplier` wanted.
///
/// An edge is the product of one difference with itself, a shear row that of the two differences
/// around a node; so both have constant second derivatives, the same along x, y and z.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub(super) a: [u32; 2],
    pub(super) b: [u32; 2],
    /// Value of the product in the rest shape [m^2].
    rest: f64,
    pub(super) compliance: f64,
    /// `|grad C|` in the rest shape [m]: `C` over it is a distance.
    pub(super) slope: f64,
    /// `grad C . M^-1 grad C` in the rest shape: the compliance of the nodes themselves.
    pub(super) give: f64,
}

impl Row {
    pub(super) fn new(
        [a, b]: [[u32; 2]; 2],
        compliance: f64,
        rest: &[DVec3],
        masses: &[f64],
    ) -> Self {
        let mut row = Self {
            a,
            b,
            rest: 0.0,
            compliance,
            slope: 0.0,
            give: 0.0,
        };
        row.rest = row.value(rest);
        let (nodes, gradients) = (row.nodes(), row.gradients(rest));
        for (s, &node) in nodes.iter().enumerate() {
            // A node may stand on several places.
            if nodes[..s].contains(&node) {
                continue;
            }
            let same = (s..4).filter(|&t| nodes[t] == node);
            let squared = same.map(|t| gradients[t]).sum::<DVec3>().length_squared();
            row.slope += squared;
            row.give += squared / masses[node as usize];
        }
        row.slope = row.slope.sqrt();
        row
    }

    /// True for an edge.
    pub(super) fn is_square(&self) -> bool {
        self.a == self.b
    }

    pub(super) fn nodes(&self) -> [u32; 4] {
        [self.a[0], self.a[1], self.b[0], self.b[1]]
    }

    fn differences(&self, x: &[DVec3]) -> [DVec3; 2] {
        [self.a, self.b].map(|[from, to]| x[to as usize] - x[from as usize])
    }

    pub(super) fn value(&self, x: &[DVec3]) -> f64 {
        let [u, v] = self.differences(x);
        u.dot(v) - self.rest
    }

    /// Shares of the gradient, in the order of [`Row::nodes`].
    pub(super) fn gradients(&self, x: &[DVec3]) -> [DVec3; 4] {
        let [u, v] = self.differences(x);
        [-v, v, -u, u]
    }

    /// Second derivatives with respect to the nodes at places `s` and `t`, a multiple of the
    /// identity.
    pub(super) fn second(s: usize, t: usize) -> f64 {
        match (s / 2 == t / 2, s % 2 == t % 2) {
            (true, _) => 0.0,
            (false, true) => 1.0,
            (false, false) => -1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_are_the_central_differences_of_the_value() {
        let x = [
            DVec3::new(0.0, 0.1, -0.2),
            DVec3::new(1.0, 0.3, 0.2),
            DVec3::new(0.2, 1.1, 0.5),
        ];
        for pairs in [[[0, 1], [0, 1]], [[0, 1], [0, 2]], [[2, 1], [0, 2]]] {
            let row = Row::new(pairs, 0.0, &x, &[1.0, 2.0, 3.0]);
            for node in 0..3 {
                let places = (0..4).filter(|&s| row.nodes()[s] == node);
                let gradient: DVec3 = places.map(|s| row.gradients(&x)[s]).sum();
                for axis in 0..3 {
                    let moved = |step: f64| {
                        let mut x = x;
                        x[node as usize][axis] += step;
                        row.value(&x)
                    };
                    // The value is quadratic, so this is exact but for rounding.
                    let difference = (moved(0.5) - moved(-0.5)) / 1.0;
                    assert!((difference - gradient[axis]).abs() < 1e-14);
                }
            }
        }
    }

    /// An edge of length 2 between masses 1 and 4: the gradient is -+ 2 * 2 at its ends.
    #[test]
    fn slope_and_give_by_hand() {
        let x = [DVec3::ZERO, DVec3::new(2.0, 0.0, 0.0)];
        let row = Row::new([[0, 1], [0, 1]], 0.0, &x, &[1.0, 4.0]);
        assert_eq!(row.slope, 32f64.sqrt());
        assert_eq!(row.give, 16.0 + 4.0);
        assert!(row.is_square());
    }
}
