//! Stretch and shear: the rows that are solved together in every iteration.
//!
//! Stretch has one row for each edge, shear one for each quad:
//!
//! `C_e = (|x_q - x_p|^2 - l^2) / (2 l)` [m], kept at zero;
//! `C_q = u . v / (|u_0| |v_0|)` [1], the sine of the shear angle, with `u` and `v` the mean edges of
//! the quad along its two directions; a spring of energy `G/2 A C_q^2`.
//!
//! Both are quadratic in the positions. So the gradient at the middle of a substep,
//! `(x_0 + x_1)/2`, times the displacement is exactly the change of the row, forces along it do the
//! work that the row's energy loses, and they have no moment: linear and angular momentum are kept
//! (Gonzalez 1999).

use selvedge_math::DVec3;

use crate::linear::{Cholesky, Threads};
use crate::nodes::Nodes;
use crate::{Error, Mesh};

/// Regularisation of a row, as a share of its diagonal when all nodes are free. It limits how far
/// the multiplier of a row without free nodes moves in one iteration, and vanishes with the residual.
const PROXIMAL: f64 = 1e-5;

/// Stiffness of an edge against stretch, per width of cloth [N/m]: some thousand times that of a
/// fabric, so that a tension of 1 N on an edge of 2 cm is a strain of 2e-5. Without it a straight row
/// between two pins, with any load across it, has no finite tension.
const STIFFNESS: f64 = 2.5e6;

/// An edge at whose end a node sticks may keep so many times as much strain as others: to make the node
/// slide for less takes many iterations, in which nothing moves.
const STUCK: f64 = 1.8;

/// Values, gradients and multipliers of all rows: first the edges, then the quads.
#[derive(Debug)]
pub(crate) struct Rows {
    edges: Vec<[u32; 2]>,
    quads: Vec<[u32; 4]>,
    /// Lengths that the edges are to have now [m].
    lengths: Vec<f64>,
    /// `|u_0| |v_0|` of each quad [m^2], and its area.
    products: Vec<f64>,
    areas: Vec<f64>,
    shear_rest: Vec<f64>,
    /// What an edge gives to a force [m/N].
    give: Vec<f64>,
    /// Rows that are not imposed now.
    exempt: Vec<bool>,
    /// Tension [N] of each edge, shear force times length [N m] of each quad.
    pub(crate) multipliers: Vec<f64>,
    /// Stiffness across each edge [N/m] that its tension gives at the start of a substep.
    tautness: Vec<f64>,
    /// Gradients with respect to the second node of each edge, and to the second and third of each quad:
    /// with respect to the other half of the nodes they are opposite.
    of_edges: Vec<DVec3>,
    of_quads: Vec<[DVec3; 2]>,
    /// All of them, two an edge and four a quad, and what the nodes do with each as a force.
    gradients: Vec<DVec3>,
    weighted: Vec<DVec3>,
    /// The node of each gradient.
    node: Vec<u32>,
    meetings: Vec<Meeting>,
    /// The matrix `S = J W J^T + c`, by pair of rows; where its diagonal is.
    values: Vec<f64>,
    diagonal: Vec<u32>,
    cholesky: Cholesky,
    change: Vec<f64>,
}

/// Two gradients at one node, whose product is summed into an entry of `S`.
#[derive(Clone, Copy, Debug)]
struct Meeting {
    entry: u32,
    first: u32,
    second: u32,
}

/// The largest strains `|length/l - 1|` of all edges.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Strain {
    pub(crate) largest: f64,
    /// What is not due to the tension.
    pub(crate) unsolved: f64,
    /// The same with edges of sticking nodes counting less, see [`STUCK`].
    pub(crate) open: f64,
}

/// How the shear springs act in one substep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ShearLaw {
    /// Stiffness [N/m] on the sine at the end of the substep, and on that at its start.
    pub(crate) end: f64,
    pub(crate) start: f64,
}

impl Rows {
    pub(crate) fn new(mesh: &Mesh) -> Result<Self, Error> {
        let rest = mesh.rest();
        let (edges, quads) = (mesh.edges().to_vec(), mesh.quads().to_vec());
        let mut node = Vec::with_capacity(2 * edges.len() + 4 * quads.len());
        let mut row_of = Vec::with_capacity(node.capacity());
        for (row, edge) in edges.iter().enumerate() {
            node.extend_from_slice(edge);
            row_of.extend([row as u32; 2]);
        }
        for (k, quad) in quads.iter().enumerate() {
            node.extend_from_slice(quad);
            row_of.extend([(edges.len() + k) as u32; 4]);
        }
        let row_count = edges.len() + quads.len();
        let mut at_node = vec![Vec::new(); mesh.node_count()];
        for (entry, &node) in node.iter().enumerate() {
            at_node[node as usize].push(entry as u32);
        }
        let mut pairs = Vec::new();
        for entries in &at_node {
            for (k, &a) in entries.iter().enumerate() {
                for &b in &entries[k..] {
                    let (p, q) = (row_of[a as usize], row_of[b as usize]);
                    pairs.push((p.min(q), p.max(q), a, b));
                }
            }
        }
        pairs.sort_unstable();
        let mut pattern: Vec<(u32, u32)> = Vec::new();
        let mut meetings = Vec::with_capacity(pairs.len());
        for (p, q, first, second) in pairs {
            if pattern.last() != Some(&(p, q)) {
                pattern.push((p, q));
            }
            let entry = pattern.len() as u32 - 1;
            meetings.push(Meeting {
                entry,
                first,
                second,
            });
        }
        let diagonal = (0u32..)
            .zip(&pattern)
            .filter(|(_, (p, q))| p == q)
            .map(|(k, _)| k)
            .collect();
        let point = |k: u32| rest[k as usize];
        let ends = edges.iter().map(|e| 0.5 * (point(e[0]) + point(e[1])));
        let middles = quads
            .iter()
            .map(|q| 0.25 * q.map(point).iter().sum::<DVec3>());
        let places: Vec<DVec3> = ends.chain(middles).collect();
        let frames = quads.iter().map(|q| tangents(q, rest));
        Ok(Self {
            lengths: edges
                .iter()
                .map(|e| point(e[0]).distance(point(e[1])))
                .collect(),
            products: frames
                .clone()
                .map(|(u, v)| u.length() * v.length())
                .collect(),
            areas: frames.clone().map(|(u, v)| u.cross(v).length()).collect(),
            shear_rest: frames
                .map(|(u, v)| u.dot(v) / (u.length() * v.length()))
                .collect(),
            give: {
                let length = |e: &[u32; 2]| point(e[0]).distance(point(e[1]));
                let mean = edges.iter().map(length).sum::<f64>() / edges.len() as f64;
                edges
                    .iter()
                    .map(|e| length(e) / (STIFFNESS * mean))
                    .collect()
            },
            exempt: vec![false; row_count],
            multipliers: vec![0.0; row_count],
            tautness: vec![0.0; edges.len()],
            of_edges: vec![DVec3::ZERO; edges.len()],
            of_quads: vec![[DVec3::ZERO; 2]; quads.len()],
            gradients: vec![DVec3::ZERO; node.len()],
            weighted: vec![DVec3::ZERO; node.len()],
            values: vec![0.0; pattern.len()],
            cholesky: Cholesky::analyse_in_space(&pattern, &places)?.single_if_large(),
            change: vec![0.0; row_count],
            edges,
            quads,
            node,
            meetings,
            diagonal,
        })
    }

    pub(crate) fn edges(&self) -> &[[u32; 2]] {
        &self.edges
    }

    pub(crate) fn quads(&self) -> &[[u32; 4]] {
        &self.quads
    }

    pub(crate) fn set_threads(&mut self, threads: &Threads) {
        self.cholesky.set_threads(threads);
    }

    /// Tension is looked at anew.
    pub(crate) fn forget(&mut self) {
        self.tautness.fill(f64::NAN);
    }

    /// Says which length every edge must have [m].
    pub(crate) fn set_lengths(&mut self, lengths: &[f64]) {
        self.lengths.copy_from_slice(lengths);
    }

    /// Says which length an edge must have [m].
    pub(crate) fn set_length(&mut self, edge: usize, length: f64) {
        self.lengths[edge] = length;
    }

    /// Says whether a row is not imposed; an exempt row has no force.
    pub(crate) fn set_exempt(&mut self, row: usize, exempt: bool) {
        self.exempt[row] = exempt;
        if exempt {
            self.multipliers[row] = 0.0;
        }
    }

    /// Gradients at the positions `(start + end)/2`.
    pub(crate) fn set_gradients(&mut self, start: &[DVec3], end: &[DVec3]) {
        let middle = |k: u32| 0.5 * (start[k as usize] + end[k as usize]);
        let of_edges = self.of_edges.iter_mut().zip(&self.edges);
        for ((gradient, edge), length) in of_edges.zip(&self.lengths) {
            *gradient = (middle(edge[1]) - middle(edge[0])) * (1.0 / *length);
        }
        let of_quads = self.of_quads.iter_mut().zip(&self.quads);
        for ((gradient, quad), product) in of_quads.zip(&self.products) {
            let [a, b, c, d] = quad.map(middle);
            let scale = 0.5 / product;
            let (u, v) = (0.5 * scale * (b - a + c - d), 0.5 * scale * (d - a + c - b));
            *gradient = [v - u, u + v];
        }
        let (exempt_edges, exempt_quads) = self.exempt.split_at(self.edges.len());
        for (gradient, exempt) in self.of_edges.iter_mut().zip(exempt_edges) {
            if *exempt {
                *gradient = DVec3::ZERO;
            }
        }
        for (gradient, exempt) in self.of_quads.iter_mut().zip(exempt_quads) {
            if *exempt {
                *gradient = [DVec3::ZERO; 2];
            }
        }
    }

    /// The stiffness that tension gives: an edge under the force `T` resists a displacement `u` of
    /// its ends with `T (u_q - u_p)/(2 l)`, half since the force points along the middle of the way.
    /// Edges under pressure have none. It is a matter of convergence only, so it is kept until it is
    /// off by `slack` [N/m]; true when it is new.
    pub(crate) fn tauten(&mut self, slack: f64) -> bool {
        let edges = self.lengths.iter().zip(&self.multipliers);
        let now = |(length, multiplier): (&f64, &f64)| (-multiplier).max(0.0) / (2.0 * length);
        if edges
            .clone()
            .map(now)
            .zip(&self.tautness)
            .all(|(a, b): (f64, &f64)| (a - b).abs() <= slack)
        {
            return false;
        }
        for (tautness, edge) in self.tautness.iter_mut().zip(edges) {
            *tautness = now(edge);
        }
        true
    }

    /// Stiffness across each edge [N/m] that its tension gives.
    pub(crate) fn tautness(&self) -> &[f64] {
        &self.tautness
    }

    /// Adds what [`tauten`](Self::tauten) resists to the way from `start` to `x`.
    pub(crate) fn add_tautness(&self, start: &[DVec3], x: &[DVec3], forces: &mut [DVec3]) {
        for (edge, tautness) in self.edges.iter().zip(&self.tautness) {
            let [p, q] = edge.map(|k| k as usize);
            let force = (x[q] - start[q] - (x[p] - start[p])) * *tautness;
            forces[p] -= force;
            forces[q] += force;
        }
    }

    /// Adds the forces of the rows [N].
    pub(crate) fn add_forces(&self, forces: &mut [DVec3]) {
        self.add_forces_of(&self.multipliers, forces);
    }

    /// The same for these multipliers.
    fn add_forces_of(&self, multipliers: &[f64], forces: &mut [DVec3]) {
        let (of_edges, of_quads) = multipliers.split_at(self.edges.len());
        let edges = self.edges.iter().zip(&self.of_edges);
        for ((edge, gradient), &multiplier) in edges.zip(of_edges) {
            // A stretched edge pulls its ends together: its multiplier is negative then.
            let force = gradient * multiplier;
            forces[edge[0] as usize] -= force;
            forces[edge[1] as usize] += force;
        }
        let quads = self.quads.iter().zip(&self.of_quads);
        for ((quad, gradients), &multiplier) in quads.zip(of_quads) {
            let [a, b, c, d] = quad.map(|node| node as usize);
            let [second, third] = gradients.map(|gradient| gradient * multiplier);
            forces[a] -= third;
            forces[b] += second;
            forces[c] += third;
            forces[d] -= second;
        }
    }

    /// Builds and factors `S` for the present gradients.
    pub(crate) fn factor(&mut self, nodes: &Nodes, law: ShearLaw) -> Result<(), Error> {
        let (of_edges, of_quads) = self.gradients.split_at_mut(2 * self.edges.len());
        for (all, &gradient) in of_edges.as_chunks_mut().0.iter_mut().zip(&self.of_edges) {
            *all = [-gradient, gradient];
        }
        for (all, &[b, c]) in of_quads.as_chunks_mut().0.iter_mut().zip(&self.of_quads) {
            *all = [-c, b, c, -b];
        }
        for ((weighted, &gradient), &node) in self
            .weighted
            .iter_mut()
            .zip(&self.gradients)
            .zip(&self.node)
        {
            *weighted = nodes.prospect(node as usize, gradient);
        }
        self.values.fill(0.0);
        for meeting in &self.meetings {
            let product =
                self.gradients[meeting.first as usize].dot(self.weighted[meeting.second as usize]);
            self.values[meeting.entry as usize] += product;
        }
        let edges = self.edges.len();
        for (row, &entry) in self.diagonal.iter().enumerate() {
            let value = &mut self.values[entry as usize];
            if self.exempt[row] {
                *value = 1.0;
            } else if row < edges {
                let free: f64 = self.edges[row]
                    .iter()
                    .map(|&n| nodes.inverse(n as usize))
                    .sum();
                // An edge whose ends are both kept pulls as hard as if they were free, until one gives.
                *value += self.give[row];
                *value += if *value < 1e-3 * free {
                    free
                } else {
                    PROXIMAL * free
                };
            } else {
                *value += compliance(law, self.areas[row - edges]);
            }
        }
        self.cholesky.factor(&self.values)
    }

    /// One Newton correction of the rows at the positions `x`: changes the multipliers and puts the
    /// change of the forces [N] into `forces`.
    pub(crate) fn correct(
        &mut self,
        x: &[DVec3],
        start_sines: &[f64],
        law: ShearLaw,
        forces: &mut [DVec3],
    ) {
        let edges = self.edges.len();
        for (row, edge) in self.edges.iter().enumerate() {
            self.change[row] = match self.exempt[row] {
                true => 0.0,
                false => {
                    -stretch(edge, self.lengths[row], x) - self.give[row] * self.multipliers[row]
                }
            };
        }
        for (k, quad) in self.quads.iter().enumerate() {
            let row = edges + k;
            self.change[row] = match self.exempt[row] || law.end == 0.0 {
                true => 0.0,
                false => {
                    let sine = self.sine(k, quad, x);
                    -(sine + law.start / law.end * start_sines[k])
                        - compliance(law, self.areas[k]) * self.multipliers[row]
                }
            };
        }
        self.cholesky.solve(&mut self.change);
        for (multiplier, change) in self.multipliers.iter_mut().zip(&self.change) {
            *multiplier += change;
        }
        forces.fill(DVec3::ZERO);
        self.add_forces_of(&self.change, forces);
    }

    /// One correction of velocities that lengthen edges, with the present gradients: puts the impulses
    /// into `impulses`, in units in which a node responds as to a force.
    pub(crate) fn correct_velocities(
        &mut self,
        velocities: &[DVec3],
        length_rates: &[f64],
        impulses: &mut [DVec3],
    ) {
        self.change.fill(0.0);
        for (row, edge) in self.edges.iter().enumerate() {
            if !self.exempt[row] {
                let [p, q] = edge.map(|n| velocities[n as usize]);
                self.change[row] = length_rates[row] - (q - p).dot(self.of_edges[row]);
            }
        }
        self.cholesky.solve(&mut self.change);
        impulses.fill(DVec3::ZERO);
        self.add_forces_of(&self.change, impulses);
    }

    /// Sines of the shear angles less those at rest, one a quad; 0 where exempt.
    pub(crate) fn sines(&self, x: &[DVec3], sines: &mut [f64]) {
        for (k, (quad, sine)) in self.quads.iter().zip(sines).enumerate() {
            *sine = match self.exempt[self.edges.len() + k] {
                true => 0.0,
                false => self.sine(k, quad, x),
            };
        }
    }

    #[inline]
    fn sine(&self, k: usize, quad: &[u32; 4], x: &[DVec3]) -> f64 {
        let (u, v) = tangents(quad, x);
        u.dot(v) / self.products[k] - self.shear_rest[k]
    }

    /// Strain of the edges that are imposed.
    pub(crate) fn strain(&self, x: &[DVec3], nodes: &Nodes) -> Strain {
        let (mut shortest, mut longest) = (0.0_f64, 0.0_f64);
        let (mut unsolved, mut open) = (0.0_f64, 0.0_f64);
        for (row, (edge, &length)) in self.edges.iter().zip(&self.lengths).enumerate() {
            if !self.exempt[row] {
                let value = stretch(edge, length, x);
                let per_length = 1.0 / length;
                shortest = shortest.min(value * per_length);
                longest = longest.max(value * per_length);
                // C/l is the strain up to its square.
                let left = (value + self.give[row] * self.multipliers[row]).abs() * per_length;
                let sticks = edge.iter().any(|&node| nodes.sticks(node as usize));
                let weight = if sticks { 1.0 / STUCK } else { 1.0 };
                unsolved = unsolved.max(left);
                open = open.max(weight * left);
            }
        }
        let of_value = |c: f64| ((1.0 + 2.0 * c).max(0.0).sqrt() - 1.0).abs();
        Strain {
            largest: of_value(shortest).max(of_value(longest)),
            unsolved,
            open,
        }
    }

    /// Largest rate at which an edge that is imposed gets longer than it should [m/s].
    pub(crate) fn stretch_rate(&self, velocities: &[DVec3], length_rates: &[f64]) -> f64 {
        let rates = self
            .edges
            .iter()
            .enumerate()
            .filter(|(row, _)| !self.exempt[*row]);
        rates
            .map(|(row, edge)| {
                let [p, q] = edge.map(|n| velocities[n as usize]);
                ((q - p).dot(self.of_edges[row]) - length_rates[row]).abs()
            })
            .fold(0.0, f64::max)
    }
}

/// The inverse of a spring's stiffness, seen from its row.
#[inline]
fn compliance(law: ShearLaw, area: f64) -> f64 {
    match law.end > 0.0 {
        true => 1.0 / (law.end * area),
        // No spring: its row never moves.
        false => 1e30,
    }
}

#[inline]
fn stretch(&[p, q]: &[u32; 2], length: f64, x: &[DVec3]) -> f64 {
    let squared = x[p as usize].distance_squared(x[q as usize]);
    (squared - length * length) / (2.0 * length)
}

/// Mean edges of a quad along its two directions.
#[inline]
fn tangents(quad: &[u32; 4], x: &[DVec3]) -> (DVec3, DVec3) {
    let [a, b, c, d] = quad.map(|k| x[k as usize]);
    (0.5 * (b - a + c - d), 0.5 * (d - a + c - b))
}
