//! Everything that a simulation goes on from.

use selvedge_math::{DVec3, Pose};

use crate::contact::Contact;
use crate::simulator::PATIENCE;
use crate::support::Supports;

/// A simulation at one instant, to go back to: positions and velocities, and the forces and contacts
/// that the next solve starts from. A simulator that is given it goes on to the same bits as one that
/// was not.
#[derive(Clone, Debug)]
pub struct State {
    pub(crate) instant: Instant,
    pub(crate) contacts: Vec<Contact>,
    /// Of the obstacles, at the start and at the end of the next step.
    pub(crate) poses: Vec<[Pose; 2]>,
}

impl State {
    /// Time since the start [s].
    pub fn time(&self) -> f64 {
        self.instant.time
    }

    /// Node positions [m].
    pub fn positions(&self) -> &[DVec3] {
        &self.instant.positions
    }

    /// Node velocities [m/s].
    pub fn velocities(&self) -> &[DVec3] {
        &self.instant.velocities
    }
}

/// What a substep changes, the contacts apart.
#[derive(Clone, Debug)]
pub(crate) struct Instant {
    pub(crate) time: f64,
    /// How much too near layers are [m], not above zero.
    pub(crate) gap: f64,
    /// How often a substep is cut in two before it is tried, how many were easy since that last
    /// changed, and how many must be until longer ones are tried.
    pub(crate) cuts: u32,
    pub(crate) easy: u32,
    pub(crate) patience: u32,
    /// How often substeps were cut after the last hard one.
    pub(crate) hard: u32,
    pub(crate) positions: Vec<DVec3>,
    pub(crate) velocities: Vec<DVec3>,
    /// Forces of the rows and of the ties, see `Rows` and `Nodes`.
    pub(crate) multipliers: Vec<f64>,
    pub(crate) reactions: Vec<DVec3>,
    pub(crate) supports: Supports,
    /// Length of each edge when it was released and when that was; not a number for an edge that has
    /// its rest length.
    pub(crate) released: Vec<[f64; 2]>,
}

impl Instant {
    pub(crate) fn new(rest: &[DVec3], edge_count: usize, row_count: usize) -> Self {
        let n = rest.len();
        Self {
            time: 0.0,
            gap: 0.0,
            cuts: 0,
            easy: 0,
            patience: PATIENCE,
            hard: 0,
            positions: rest.to_vec(),
            velocities: vec![DVec3::ZERO; n],
            multipliers: vec![0.0; row_count],
            reactions: vec![DVec3::ZERO; n],
            supports: Supports::new(n),
            released: vec![[f64::NAN; 2]; edge_count],
        }
    }

    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.time = other.time;
        self.gap = other.gap;
        (self.cuts, self.easy) = (other.cuts, other.easy);
        (self.patience, self.hard) = (other.patience, other.hard);
        self.positions.copy_from_slice(&other.positions);
        self.velocities.copy_from_slice(&other.velocities);
        self.multipliers.copy_from_slice(&other.multipliers);
        self.reactions.copy_from_slice(&other.reactions);
        self.supports.copy_from(&other.supports);
        self.released.copy_from_slice(&other.released);
    }
}
