//! The projection of predicted positions onto what a cloth keeps.

mod newton;
mod row;
mod solve;

use selvedge_math::DVec3;

use crate::{Error, Mesh};
use row::Row;
use solve::Solver;

/// What is projected onto what: the nearest positions to `predicted`, in the norm of the masses,
/// that keep the constraints.
///
/// ```text
/// min  1/2 sum_i m_i |x_i - p_i|^2 + sum_k C_k^2 / (2 c)
/// with |x_q - x_p| = rest length on every edge, z_i >= table, x_i = target of grasped nodes
/// ```
///
/// `C_k = U_k . V_k - rest` is the shear at node `k` of a grid, `U` and `V` the differences of its
/// neighbours along x and y; on the border the node itself stands in for the missing one.
#[derive(Clone, Copy, Debug)]
pub struct Projection<'a> {
    /// The rest shape.
    pub mesh: &'a Mesh,
    /// Mass `m` of each node, in any unit; area shares [m^2] give `c` the unit of the papers.
    pub masses: &'a [f64],
    /// Where the nodes would be without constraints, `p` [m].
    pub predicted: &'a [DVec3],
    /// Grasped nodes and their targets [m]. Constraints between grasped nodes only are left out.
    pub grasp: &'a [(u32, DVec3)],
    /// Compliance `c` of the shear rows [m^4 a unit of mass and m^2]: 0 keeps them exactly, `None`
    /// leaves them out.
    pub shear_compliance: Option<f64>,
    /// Height of the table [m].
    pub table: Option<f64>,
}

/// Positions that keep the constraints, with the residuals measured on them.
#[derive(Clone, Debug, PartialEq)]
pub struct Projected {
    /// The positions [m].
    pub positions: Vec<DVec3>,
    /// Largest distance from a constraint [m]: its value over its gradient at rest.
    pub miss: f64,
    /// Largest `|m (x - p) + J^T lambda| / m` of a node [m], `J` at these positions.
    pub imbalance: f64,
    /// Whether the second derivatives say that this is a minimum, and no saddle.
    pub minimum: bool,
    /// Newton steps taken.
    pub iterations: u32,
}

impl Projected {
    /// Bound on [`Projected::miss`] and [`Projected::imbalance`] [m].
    pub const TOLERANCE: f64 = 1e-8;
}

/// Projects predicted positions onto the constraints.
///
/// The problem is not convex. The answer is the stationary point at the end of the path that begins
/// at the predicted positions, where every constraint is soft, and on which all of them harden
/// together. Where it ends the first-order conditions hold to [`Projected::TOLERANCE`], with the
/// gradients at the answer itself, and to rounding as a rule. `c = 0` on a grid of more than a few
/// cells leaves hardly any motion but bending about one of the two axes: then multipliers are large
/// and steps many.
///
/// # Errors
/// [`Error::Node`], [`Error::Count`], [`Error::NoGrid`] and others when the problem is not well posed;
/// [`Error::Unreachable`] when no positions were found that keep the constraints, as for a grasp
/// that pulls the cloth apart.
///
/// ```
/// use selvedge_cloth::{Mesh, Projection, project};
/// use selvedge_math::DVec3;
///
/// // A square of 0.1 m whose right side was pulled away by 0.02 m: both sides give half.
/// let mesh = Mesh::grid([2, 2], [0.1, 0.1])?;
/// let predicted = [0, 1, 2, 3].map(|k| mesh.rest()[k] + DVec3::X * 0.02 * (k % 2) as f64);
/// let projected = project(&Projection {
///     mesh: &mesh,
///     masses: &[1.0; 4],
///     predicted: &predicted,
///     grasp: &[],
///     shear_compliance: None,
///     table: Some(0.0),
/// })?;
/// assert!(projected.positions[1].distance(DVec3::new(0.06, -0.05, 0.0)) < 1e-9);
/// # Ok::<(), selvedge_cloth::Error>(())
/// ```
pub fn project(problem: &Projection<'_>) -> Result<Projected, Error> {
    problem.check()?;
    let mut fixed = vec![false; problem.masses.len()];
    let mut x = problem.predicted.to_vec();
    for &(node, target) in problem.grasp {
        fixed[node as usize] = true;
        x[node as usize] = target;
    }
    let mut rows = problem.rows()?;
    rows.retain(|row| row.nodes().iter().any(|&node| !fixed[node as usize]));
    Solver::new(problem, &rows, &fixed)?.run(x)
}

impl Projection<'_> {
    fn check(&self) -> Result<(), Error> {
        let n = self.mesh.node_count();
        for (field, given) in [
            ("masses", self.masses.len()),
            ("predicted positions", self.predicted.len()),
        ] {
            if given != n {
                return Err(Error::Count {
                    field,
                    given,
                    wanted: n,
                });
            }
        }
        for (node, &mass) in self.masses.iter().enumerate() {
            if !(mass > 0.0 && mass.is_finite()) {
                return Err(Error::Node {
                    node,
                    field: "mass",
                    value: mass,
                    bound: "positive and finite",
                });
            }
        }
        if let Some(table) = self.table
            && !table.is_finite()
        {
            return Err(Error::Value {
                field: "height of the table [m]",
                value: table,
                bound: "finite",
            });
        }
        if let Some(compliance) = self.shear_compliance {
            Error::check_not_negative("shear compliance", compliance)?;
        }
        for (node, &p) in self.predicted.iter().enumerate() {
            check_finite("predicted position [m]", node, p)?;
        }
        let mut held = vec![false; n];
        for &(node, target) in self.grasp {
            let node = node as usize;
            if node >= n || held[node] {
                return Err(Error::Node {
                    node,
                    field: "index",
                    value: node as f64,
                    bound: "that of a node of the mesh, and grasped once",
                });
            }
            held[node] = true;
            check_finite("target [m]", node, target)?;
            if self.table.is_some_and(|table| target.z < table) {
                return Err(Error::Node {
                    node,
                    field: "height of the target [m]",
                    value: target.z,
                    bound: "not below the table",
                });
            }
        }
        Ok(())
    }

    /// Edges, then shear rows.
    fn rows(&self) -> Result<Vec<Row>, Error> {
        let row = |pairs, compliance| Row::new(pairs, compliance, self.mesh.rest(), self.masses);
        let edges = self.mesh.edges().iter();
        let mut rows: Vec<Row> = edges.map(|&edge| row([edge, edge], 0.0)).collect();
        if let Some(compliance) = self.shear_compliance {
            let grid = self.mesh.as_grid().ok_or(Error::NoGrid("a shear row"))?;
            let [na, nb] = grid.nodes;
            for j in 0..nb {
                for i in 0..na {
                    let at = |i: usize, j: usize| (j * na + i) as u32;
                    let along_x = [at(i.saturating_sub(1), j), at((i + 1).min(na - 1), j)];
                    let along_y = [at(i, j.saturating_sub(1)), at(i, (j + 1).min(nb - 1))];
                    rows.push(row([along_x, along_y], compliance));
                }
            }
        }
        Ok(rows)
    }
}

fn check_finite(field: &'static str, node: usize, point: DVec3) -> Result<(), Error> {
    match point.to_array().into_iter().find(|c| !c.is_finite()) {
        Some(value) => Err(Error::Node {
            node,
            field,
            value,
            bound: "finite",
        }),
        None => Ok(()),
    }
}
