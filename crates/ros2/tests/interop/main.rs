//! Against a robot of another make: `peer/peer.py`, on Cyclone DDS, on 127.0.0.1 only, each test on a domain
//! of its own. Skipped by name where there is no Python with `cyclonedds`: the program in
//! `SELVEDGE_PYTHON`, else `python3`.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

#[path = "../peer/mod.rs"]
mod peer;

mod arms;
mod fastdds;
mod faults;
mod grippers;
mod network;
mod run;
mod state;
