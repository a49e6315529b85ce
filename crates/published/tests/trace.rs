//! Single frames of the original, replayed.
//!
//! `fixtures/published/traced_frames.npz` holds measurements of the original scheme at eight frames
//! of C8 and C3: closing, free lift, first self-contact, heavy self-contact, release, and frames
//! with several passes in a substep. Shear matrices are fresh at the start of a frame, so each can
//! be replayed from its start alone; candidates are searched for anew, which changes nothing.

#![allow(
    clippy::unwrap_used,
    reason = "a file that cannot be read fails the test"
)]

use std::collections::HashMap;
use std::fs::File;
use std::io::Read;

use selvedge_cloth::{Material, Mesh};
use selvedge_math::{ClothSimulator, DVec3, Held};
use selvedge_published::{Settings, Simulator};

struct Traces {
    floats: HashMap<String, Vec<f64>>,
    integers: HashMap<String, Vec<u32>>,
}

fn read_traces() -> Traces {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../fixtures/published/traced_frames.npz"
    );
    let mut archive = zip::ZipArchive::new(File::open(path).unwrap()).unwrap();
    let mut traces = Traces {
        floats: HashMap::new(),
        integers: HashMap::new(),
    };
    for index in 0..archive.len() {
        let mut entry = archive.by_index(index).unwrap();
        let name = entry.name().unwrap().trim_end_matches(".npy").to_owned();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).unwrap();
        let array = npyz::NpyFile::new(&bytes[..]).unwrap();
        if name.ends_with("grasped") || name.ends_with("passes") {
            traces.integers.insert(name, array.into_vec().unwrap());
        } else {
            traces.floats.insert(name, array.into_vec().unwrap());
        }
    }
    traces
}

fn vectors(flat: &[f64]) -> Vec<DVec3> {
    flat.chunks_exact(3).map(DVec3::from_slice).collect()
}

fn largest_distance(a: &[DVec3], b: &[DVec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .map(|(a, b)| a.distance(*b))
        .fold(0.0, f64::max)
}

#[test]
fn every_traced_frame_is_replayed_to_rounding() {
    let traces = read_traces();
    let mesh = Mesh::grid([23, 28], [0.42, 0.59]).unwrap();
    let frames = [
        "c8_f060", "c8_f180", "c8_f240", "c8_f290", "c8_f300", "c3_f060", "c3_f131", "c3_f214",
    ];
    for frame in frames {
        let array = |key: &str| vectors(&traces.floats[&format!("{frame}_{key}")]);
        let grasped = &traces.integers[&format!("{frame}_grasped")];
        let passes: u32 = traces.integers[&format!("{frame}_passes")].iter().sum();
        let targets = array("frame_target");
        let mut cloth = Simulator::new(&mesh, Material::default(), Settings::default()).unwrap();
        cloth
            .reset(&array("start"), &array("start_velocity"))
            .unwrap();
        let velocities = vec![DVec3::ZERO; targets.len()];
        let held = Held {
            nodes: grasped,
            targets: &targets,
            velocities: &velocities,
        };
        let report = cloth.step(held, 1.0 / 60.0).unwrap();
        assert_eq!(report.iterations, passes, "{frame}: passes");
        let off = largest_distance(cloth.positions(), &array("end"));
        assert!(off < 1e-13, "{frame}: positions are off by {off:e} m");
        let off = largest_distance(cloth.velocities(), &array("velocity_end"));
        assert!(off < 1e-11, "{frame}: velocities are off by {off:e} m/s");
    }
}
