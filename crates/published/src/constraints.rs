//! One regularised solve of a family of constraints, with the grasp rows travelling along.

use selvedge_cloth::linear::Cholesky;
use selvedge_math::DVec3;

use crate::Error;

/// The gradients of a family of constraints and the factor of their dual matrix
/// `S = G A^-1 G^T + c I`, where `A` holds the area share of each node, without density.
///
/// Held nodes add three rows `x - u = 0` each, regularised by the same `c`. They touch one node
/// only, so they are eliminated exactly: with `w = 1/m` the node acts in the other rows with the
/// inverse area `w c / (w + c)`, and the pattern of `S` never changes.
pub(crate) struct Family {
    /// Entry `t` is the gradient of row `row[t]` with respect to node `node[t]`; rows ascend.
    row: Vec<u32>,
    node: Vec<u32>,
    gradient: Vec<DVec3>,
    /// The gradients times `inverse_areas`.
    weighted: Vec<DVec3>,
    /// The entries at node `n` are `at_node[node_start[n]..node_start[n + 1]]`.
    node_start: Vec<u32>,
    at_node: Vec<u32>,
    /// Products of two entries at one node that are summed into `S`.
    products: Vec<Product>,
    /// `1/m`, reduced at held nodes as told above.
    inverse_areas: Vec<f64>,
    cholesky: Cholesky,
    /// The values of `S`, by pair of rows, and which of them are on the diagonal.
    values: Vec<f64>,
    diagonal: Vec<u32>,
    compliance: f64,
    /// Right hand side, then the change of the multipliers.
    change: Vec<f64>,
    /// Per node `sum_e g_e d_e`, then moved.
    push: Vec<DVec3>,
}

struct Product {
    entry: u32,
    first: u32,
    second: u32,
}

/// What the gripper asks for in one substep, by held node.
pub(crate) struct Grasp<'a> {
    pub(crate) nodes: &'a [u32],
    pub(crate) targets: &'a [DVec3],
    /// Accumulated multipliers of the grasp rows of this family.
    pub(crate) multipliers: &'a mut [DVec3],
}

impl Family {
    /// A family of `row_count` constraints; `entries` are the `(row, node)` pairs with a gradient,
    /// by ascending row.
    pub(crate) fn new(
        node_count: usize,
        row_count: usize,
        entries: &[(u32, u32)],
    ) -> Result<Self, Error> {
        let mut at_node = vec![Vec::new(); node_count];
        for (t, &(_, node)) in entries.iter().enumerate() {
            at_node[node as usize].push(t as u32);
        }
        // The pairs of rows that meet at a node, sorted so that each becomes one entry of S.
        let mut meetings = Vec::new();
        for entries_here in &at_node {
            for (index, &a) in entries_here.iter().enumerate() {
                for &b in &entries_here[index..] {
                    let rows = (entries[a as usize].0, entries[b as usize].0);
                    meetings.push((rows.0.min(rows.1), rows.0.max(rows.1), a, b));
                    if rows.0 == rows.1 && a != b {
                        // A row with two entries at one node: both orders are on the diagonal.
                        meetings.push((rows.0, rows.1, b, a));
                    }
                }
            }
        }
        meetings.sort_unstable();
        let mut pattern: Vec<(u32, u32)> = Vec::new();
        let mut which = Vec::with_capacity(meetings.len());
        for &(low, high, _, _) in &meetings {
            if pattern.last() != Some(&(low, high)) {
                pattern.push((low, high));
            }
            which.push(pattern.len() - 1);
        }
        let mut node_start = vec![0];
        for entries_here in &at_node {
            node_start.push(node_start[node_start.len() - 1] + entries_here.len() as u32);
        }
        let cholesky = Cholesky::analyse(row_count, &pattern)?;
        let products = meetings
            .iter()
            .zip(&which)
            .map(|(&(_, _, first, second), &k)| Product {
                entry: k as u32,
                first,
                second,
            })
            .collect();
        let diagonal = (0..)
            .zip(&pattern)
            .filter(|(_, (low, high))| low == high)
            .map(|(k, _)| k)
            .collect();
        Ok(Self {
            node_start,
            at_node: at_node.concat(),
            inverse_areas: vec![0.0; node_count],
            row: entries.iter().map(|e| e.0).collect(),
            node: entries.iter().map(|e| e.1).collect(),
            gradient: vec![DVec3::ZERO; entries.len()],
            weighted: vec![DVec3::ZERO; entries.len()],
            products,
            cholesky,
            values: vec![0.0; pattern.len()],
            diagonal,
            compliance: 0.0,
            change: vec![0.0; row_count],
            push: vec![DVec3::ZERO; node_count],
        })
    }

    pub(crate) fn compliance(&self) -> f64 {
        self.compliance
    }

    pub(crate) fn set_compliance(&mut self, compliance: f64) {
        self.compliance = compliance;
    }

    /// The gradients, to be filled in the order of the entries; then [`Family::factor`].
    pub(crate) fn gradients_mut(&mut self) -> &mut [DVec3] {
        &mut self.gradient
    }

    /// Builds and factors `S` from the present gradients. `inverse_areas` are `1/m`; those of the
    /// held nodes are replaced as told above.
    pub(crate) fn factor(&mut self, inverse_areas: &[f64], held: &[u32]) -> Result<(), Error> {
        let c = self.compliance;
        self.inverse_areas.copy_from_slice(inverse_areas);
        for &node in held {
            let w = &mut self.inverse_areas[node as usize];
            *w *= c / (*w + c);
        }
        for ((weighted, &gradient), &node) in
            self.weighted.iter_mut().zip(&self.gradient).zip(&self.node)
        {
            *weighted = gradient * self.inverse_areas[node as usize];
        }
        self.values.fill(0.0);
        for product in &self.products {
            let (first, second) = (product.first as usize, product.second as usize);
            self.values[product.entry as usize] += self.gradient[first].dot(self.weighted[second]);
        }
        for &entry in &self.diagonal {
            self.values[entry as usize] += c;
        }
        Ok(self.cholesky.factor(&self.values)?)
    }

    /// One solve: `S d = -C - c lambda`, `lambda += d`, `x += A^-1 G^T d`, the grasp rows included.
    /// `values` are `C(x)` by row.
    pub(crate) fn solve(
        &mut self,
        values: &[f64],
        multipliers: &mut [f64],
        grasp: &mut Grasp<'_>,
        inverse_areas: &[f64],
        positions: &mut [DVec3],
    ) {
        let c = self.compliance;
        for ((change, &value), &lambda) in self.change.iter_mut().zip(values).zip(&*multipliers) {
            *change = -value - c * lambda;
        }
        for (h, &node) in grasp.nodes.iter().enumerate() {
            let w = inverse_areas[node as usize];
            let wanted = self.grasp_rhs(grasp, h, positions);
            let share = wanted * (w / (w + c));
            let entries = self.node_start[node as usize] as usize
                ..self.node_start[node as usize + 1] as usize;
            for &t in &self.at_node[entries] {
                self.change[self.row[t as usize] as usize] -= self.gradient[t as usize].dot(share);
            }
        }
        self.cholesky.solve(&mut self.change);
        for (lambda, &change) in multipliers.iter_mut().zip(&self.change) {
            *lambda += change;
        }
        self.push.fill(DVec3::ZERO);
        for ((&row, &node), &gradient) in self.row.iter().zip(&self.node).zip(&self.gradient) {
            self.push[node as usize] += gradient * self.change[row as usize];
        }
        for (h, &node) in grasp.nodes.iter().enumerate() {
            let w = inverse_areas[node as usize];
            let wanted = self.grasp_rhs(grasp, h, positions);
            let change = (wanted - w * self.push[node as usize]) / (w + c);
            grasp.multipliers[h] += change;
            self.push[node as usize] += change;
        }
        for ((x, &push), &w) in positions.iter_mut().zip(&self.push).zip(inverse_areas) {
            *x += push * w;
        }
    }

    /// `-(x - u) - c lambda` of held node number `h`.
    fn grasp_rhs(&self, grasp: &Grasp<'_>, h: usize, positions: &[DVec3]) -> DVec3 {
        let x = positions[grasp.nodes[h] as usize];
        grasp.targets[h] - x - self.compliance * grasp.multipliers[h]
    }
}
