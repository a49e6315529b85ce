//! What several tests record.

use selvedge_math::{Command, DVec3, Jaw, Pose};

use crate::{GripperState, Recording, Rest, Sheet};

/// A triangle that rises by 0.1 m/s, a frame every `period` [s], above it an open gripper at rest.
pub(crate) fn rising(frame_count: u32, period: f64) -> Recording {
    let points = [DVec3::ZERO, 0.1 * DVec3::X, 0.1 * DVec3::Y];
    let sheet = Sheet {
        quads: vec![],
        triangles: vec![[0, 1, 2]],
        rest: Rest::Positions(points.to_vec()),
    };
    let mut recording = Recording::new(sheet, 1, "{}".into()).unwrap();
    let command = Command {
        pose: Pose::IDENTITY,
        jaw: Jaw::Open,
    };
    let state = GripperState {
        command,
        alpha: 0.0,
    };
    for k in 0..frame_count {
        let time = period * f64::from(k);
        let positions = points.map(|p| p + 0.1 * time * DVec3::Z);
        recording.push(time, &positions, &[state], &[0; 3]).unwrap();
    }
    recording
}
