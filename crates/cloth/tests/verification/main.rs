//! The default solver against closed forms and conservation laws. The reference formula stands above
//! each test; tolerances come from the order of the method and of the mesh, as said there.

#![allow(clippy::unwrap_used, reason = "a failed set-up fails the test")]

mod cantilever;
mod free_flight;
mod friction;
mod hands;
mod hanging;
mod layers;
mod layers_stay_apart;
mod order;
mod scene;
mod state;
