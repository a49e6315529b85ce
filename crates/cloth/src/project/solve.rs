//! The method of multipliers with Newton steps.
//!
//! Every constraint `C = c mu` gets a further compliance `d` around its multiplier `y`: with
//! `mu = (C + d y)/(c + d)` the positions minimise
//!
//! ```text
//! 1/2 sum m |x - p|^2 + sum (C + d y)^2 / (2 (c + d))  (+ the same for z >= table, mu >= 0)
//! ```
//!
//! without constraints; then `y` becomes `mu`, and `d` falls. At the end `y = mu`, so `C = c mu`
//! whatever `d` is, and dependent rows do no harm: the answer is not regularised, the way to it is.
//! The second derivatives of the constraints are part of the matrix, since moves of several
//! millimetres over edges of centimetres make them as large as the masses; where they make it
//! indefinite those that may do so are left out. That couples neighbouring nodes, so the system is
//! solved for the coordinates, not for the multipliers.

use selvedge_math::DVec3;

use super::newton::{Newton, Share};
use super::row::Row;
use super::{Projected, Projection};
use crate::Error;

/// The compliance around the multipliers, in the compliance of the nodes themselves, falls from 1 by
/// this factor until it is enough; then only where the residual falls no faster.
const FALL: f64 = 0.1;
const ENOUGH: f64 = 1e-6;
const LEAST: f64 = 1e-12;
/// Newton steps in all.
const STEPS: u32 = 3000;
/// Updates of the multipliers at the least compliance without progress.
const STALLS: u32 = 5;
/// Residual [m] below which further steps are worth it only as long as they are quick.
const GOOD: f64 = 1e-10;
/// First bound on the imbalance [m].
const COARSE: f64 = 1e-4;

pub(super) struct Solver<'a> {
    problem: &'a Projection<'a>,
    rows: &'a [Row],
    fixed: &'a [bool],
    newton: Newton,
    /// Compliance around the multipliers, in those of the nodes.
    soft: f64,
    /// Multipliers of the rows and of the table.
    multipliers: Vec<f64>,
    support: Vec<f64>,
    /// Those of the present positions, `mu`.
    shares: Vec<Share>,
    lift: Vec<f64>,
    gradient: Vec<DVec3>,
    diagonal: Vec<DVec3>,
    direction: Vec<DVec3>,
    correction: Vec<DVec3>,
    trial: Vec<DVec3>,
    minimum: bool,
    iterations: u32,
}

impl<'a> Solver<'a> {
    pub(super) fn new(
        problem: &'a Projection<'a>,
        rows: &'a [Row],
        fixed: &'a [bool],
    ) -> Result<Self, Error> {
        let n = fixed.len();
        let share = Share {
            multiplier: 0.0,
            weight: 0.0,
        };
        Ok(Self {
            newton: Newton::new(rows, fixed)?,
            problem,
            rows,
            fixed,
            soft: 1.0,
            multipliers: vec![0.0; rows.len()],
            support: vec![0.0; n],
            shares: vec![share; rows.len()],
            lift: vec![0.0; n],
            gradient: vec![DVec3::ZERO; n],
            diagonal: vec![DVec3::ZERO; n],
            direction: vec![DVec3::ZERO; n],
            correction: vec![DVec3::ZERO; n],
            trial: vec![DVec3::ZERO; n],
            minimum: false,
            iterations: 0,
        })
    }

    pub(super) fn run(mut self, mut x: Vec<DVec3>) -> Result<Projected, Error> {
        let size = x.iter().map(|x| x.abs().max_element());
        let size = size.fold(0.0, f64::max);
        let (mut before, mut goal) = (f64::INFINITY, COARSE);
        let mut best: Option<Projected> = None;
        let mut stalls = 0;
        loop {
            // What the rounding of the positions leaves of the imbalance
            let rounding = 4.0 * f64::EPSILON * size / self.soft;
            self.minimise(&mut x, f64::max(goal, rounding))?;
            let improved = self.update(&mut x)?;
            let (miss, what) = self.miss(&x);
            let imbalance = self.imbalance();
            // Not a number if any of the positions is not
            let residual = miss + imbalance;
            let bound = best
                .as_ref()
                .map_or(Projected::TOLERANCE, |best| best.miss + best.imbalance);
            if residual < bound {
                best = Some(self.finish(&x));
            }
            let slow = residual >= FALL * before;
            stalls += u32::from(slow && (self.soft == LEAST || !improved));
            let fine = residual <= GOOD && slow;
            if fine || stalls > STALLS || self.iterations >= STEPS || !residual.is_finite() {
                return best.ok_or(Error::Unreachable {
                    what,
                    miss,
                    imbalance,
                });
            }
            if improved && (slow || self.soft > ENOUGH) {
                self.soft = (self.soft * FALL).max(LEAST);
            }
            goal = (FALL * miss).clamp(FALL * GOOD, COARSE);
            before = residual;
        }
    }

    /// The answer, with the last rounding below the table taken away.
    fn finish(&mut self, x: &[DVec3]) -> Projected {
        let mut positions = x.to_vec();
        if let Some(table) = self.problem.table {
            for x in &mut positions {
                x.z = x.z.max(table);
            }
        }
        self.balance(&positions);
        Projected {
            miss: self.miss(&positions).0,
            imbalance: self.imbalance(),
            positions,
            minimum: self.minimum,
            iterations: self.iterations,
        }
    }

    /// Takes the present multipliers over and does a Newton step for positions and multipliers
    /// together, whose residuals are not multiplied by the hardness of the constraints as those of
    /// positions alone are; false when the step makes them no smaller and is not done.
    fn update(&mut self, x: &mut [DVec3]) -> Result<bool, Error> {
        self.evaluate(x);
        self.direct(x)?;
        self.trial.copy_from_slice(x);
        self.take_over();
        self.balance(x);
        let residual = self.miss(x).0 + self.imbalance();
        for ((row, y), share) in self
            .rows
            .iter()
            .zip(&mut self.multipliers)
            .zip(&self.shares)
        {
            let shares = row.nodes().into_iter().zip(row.gradients(x));
            let change = shares.map(|(node, g)| g.dot(self.direction[node as usize]));
            *y += share.weight * change.sum::<f64>();
        }
        for node in 0..x.len() {
            if self.lift[node] > 0.0 {
                let change = self.direction[node].z / self.table_compliance(node);
                self.support[node] = (self.lift[node] - change).max(0.0);
            }
        }
        for (x, d) in x.iter_mut().zip(&self.direction) {
            *x += *d;
        }
        self.balance(x);
        if self.miss(x).0 + self.imbalance() < residual {
            return Ok(true);
        }
        x.copy_from_slice(&self.trial);
        self.take_over();
        self.balance(x);
        Ok(false)
    }

    fn take_over(&mut self) {
        for (y, share) in self.multipliers.iter_mut().zip(&self.shares) {
            *y = share.multiplier;
        }
        self.support.copy_from_slice(&self.lift);
    }

    /// Newton steps at fixed multipliers until no node is out of balance by more than `goal` [m], or
    /// no step leads further down.
    fn minimise(&mut self, x: &mut Vec<DVec3>, goal: f64) -> Result<(), Error> {
        while self.iterations < STEPS {
            self.evaluate(x);
            if self.imbalance() <= goal {
                break;
            }
            self.direct(x)?;
            let descent = self.gradient.iter().zip(&self.direction);
            let slope: f64 = descent.map(|(g, d)| g.dot(*d)).sum();
            let value = self.value(x);
            // Near the end the value is known to rounding only.
            let bound = |step: f64| value * (1.0 + 1e-13) + 1e-4 * step * slope;
            let mut step = 1.0;
            let mut trial = std::mem::take(&mut self.trial);
            loop {
                for ((trial, &x), &d) in trial.iter_mut().zip(&*x).zip(&self.direction) {
                    *trial = x + step * d;
                }
                if self.value(&trial) <= bound(step) {
                    break;
                }
                // Back to the constraints, which curve away from the straight step
                self.evaluate(&trial);
                self.newton.direction(&self.gradient, &mut self.correction);
                for (trial, &d) in trial.iter_mut().zip(&self.correction) {
                    *trial += d;
                }
                if self.value(&trial) <= bound(step) {
                    break;
                }
                step *= 0.5;
                if step < 1e-10 {
                    self.trial = trial;
                    return Ok(());
                }
            }
            self.trial = trial;
            std::mem::swap(x, &mut self.trial);
        }
        Ok(())
    }

    /// The direction of a Newton step.
    fn direct(&mut self, x: &[DVec3]) -> Result<(), Error> {
        self.iterations += 1;
        self.minimum = self.factor(x, true).is_ok();
        if !self.minimum {
            self.factor(x, false)?;
        }
        self.newton.direction(&self.gradient, &mut self.direction);
        Ok(())
    }

    fn factor(&mut self, x: &[DVec3], exact: bool) -> Result<(), Error> {
        let (rows, shares, diagonal) = (self.rows, &self.shares, &self.diagonal);
        self.newton.factor(x, rows, shares, diagonal, exact)
    }

    /// The compliance around the multiplier of the table at a node.
    fn table_compliance(&self, node: usize) -> f64 {
        self.soft / self.problem.masses[node]
    }

    /// The function that is minimised.
    fn value(&self, x: &[DVec3]) -> f64 {
        let mut value = 0.0;
        let nodes = x.iter().zip(self.problem.predicted);
        for ((x, p), m) in nodes.zip(self.problem.masses) {
            value += 0.5 * m * x.distance_squared(*p);
        }
        for (row, y) in self.rows.iter().zip(&self.multipliers) {
            let d = self.soft * row.give;
            value += (row.value(x) + d * y).powi(2) / (2.0 * (row.compliance + d));
        }
        if let Some(table) = self.problem.table {
            for (node, x) in x.iter().enumerate() {
                let d = self.table_compliance(node);
                let push = (d * self.support[node] + table - x.z).max(0.0);
                value += push * push / (2.0 * d);
            }
        }
        value
    }

    /// Present multipliers, the gradient with them, and the diagonal of the matrix.
    fn evaluate(&mut self, x: &[DVec3]) {
        for ((share, row), y) in self.shares.iter_mut().zip(self.rows).zip(&self.multipliers) {
            let d = self.soft * row.give;
            share.weight = 1.0 / (row.compliance + d);
            share.multiplier = (row.value(x) + d * y) * share.weight;
        }
        for (node, (x, &mass)) in x.iter().zip(self.problem.masses).enumerate() {
            self.diagonal[node] = DVec3::splat(mass);
            if let Some(table) = self.problem.table {
                let d = self.table_compliance(node);
                self.lift[node] = (self.support[node] + (table - x.z) / d).max(0.0);
                if self.lift[node] > 0.0 {
                    self.diagonal[node].z += 1.0 / d;
                }
            }
        }
        let multipliers = self.shares.iter().map(|share| share.multiplier);
        gradient(
            self.problem,
            self.rows,
            x,
            multipliers,
            &self.lift,
            &mut self.gradient,
        );
    }

    /// The gradient with the multipliers taken over.
    fn balance(&mut self, x: &[DVec3]) {
        let multipliers = self.multipliers.iter().copied();
        gradient(
            self.problem,
            self.rows,
            x,
            multipliers,
            &self.support,
            &mut self.gradient,
        );
    }

    fn imbalance(&self) -> f64 {
        let nodes = self.gradient.iter().zip(self.problem.masses);
        nodes
            .zip(self.fixed)
            .filter(|(_, fixed)| !**fixed)
            .map(|((g, m), _)| g.length() / m)
            .max_by(f64::total_cmp)
            .unwrap_or(0.0)
    }

    /// The largest distance from a constraint, and which.
    fn miss(&self, x: &[DVec3]) -> (f64, String) {
        let (mut worst, mut what) = (0.0, String::new());
        for (row, y) in self.rows.iter().zip(&self.multipliers) {
            let miss = (row.value(x) - row.compliance * y).abs() / row.slope;
            if miss > worst {
                worst = miss;
                what = match row.is_square() {
                    true => format!("edge {:?}", row.a),
                    false => format!("shear of nodes {:?} and {:?}", row.a, row.b),
                };
            }
        }
        if let Some(table) = self.problem.table {
            for (node, x) in x.iter().enumerate() {
                let gap = x.z - table;
                let miss = if self.support[node] > 0.0 {
                    gap.abs()
                } else {
                    -gap
                };
                if miss > worst && !self.fixed[node] {
                    worst = miss;
                    what = format!("table at node {node}");
                }
            }
        }
        (worst, what)
    }
}

/// `M (x - p) + J^T mu`.
fn gradient(
    problem: &Projection<'_>,
    rows: &[Row],
    x: &[DVec3],
    multipliers: impl Iterator<Item = f64>,
    lift: &[f64],
    gradient: &mut [DVec3],
) {
    let nodes = x.iter().zip(problem.predicted).zip(problem.masses);
    for ((gradient, ((x, p), &mass)), &lift) in gradient.iter_mut().zip(nodes).zip(lift) {
        *gradient = mass * (x - p) - lift * DVec3::Z;
    }
    for (row, multiplier) in rows.iter().zip(multipliers) {
        for (node, share) in row.nodes().into_iter().zip(row.gradients(x)) {
            gradient[node as usize] += multiplier * share;
        }
    }
}
