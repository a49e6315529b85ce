//! How far and how fast a joint goes.

/// Limits of one joint: radians and newton metres, or metres and newtons for a prismatic joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Lowest position, minus infinity for a continuous joint.
    pub lower: f64,
    /// Highest position.
    pub upper: f64,
    /// Highest speed, infinity where the URDF gives none.
    pub velocity: f64,
    /// Highest torque or force, infinity where the URDF gives none.
    pub effort: f64,
}

impl Limits {
    /// Whether a position is within the limits, both included.
    pub fn contain(&self, position: f64) -> bool {
        position >= self.lower && position <= self.upper
    }

    /// The distance to the nearer limit, negative outside.
    pub fn margin(&self, position: f64) -> f64 {
        (position - self.lower).min(self.upper - position)
    }
}
