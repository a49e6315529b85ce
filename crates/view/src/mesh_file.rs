//! One frame as a mesh file: Wavefront OBJ and PLY.

use std::fmt::Write;

use selvedge_math::DVec3;

use crate::Recording;

impl Recording {
    /// The text of a Wavefront OBJ file with a frame's nodes [m, z up] and faces.
    ///
    /// # Panics
    /// When there is no such frame, as for [`ply`](Self::ply).
    pub fn obj(&self, frame: usize) -> String {
        let mut text = format!("# t = {} s, metres, z up\n", self.times()[frame]);
        for DVec3 { x, y, z } in self.positions(frame) {
            put(&mut text, format_args!("v {x} {y} {z}\n"));
        }
        for face in self.faces() {
            text.push('f');
            for node in face {
                put(&mut text, format_args!(" {}", node + 1));
            }
            text.push('\n');
        }
        text
    }

    /// The text of a PLY file (ASCII 1.0) with a frame's nodes [m, z up], the number of the gripper
    /// that holds each, from 1, or 0, and the faces.
    pub fn ply(&self, frame: usize) -> String {
        let (nodes, faces) = (self.node_count(), self.faces().count());
        let mut text = format!(
            "ply\nformat ascii 1.0\ncomment t = {} s, metres, z up\nelement vertex {nodes}\n\
             property double x\nproperty double y\nproperty double z\nproperty uchar grasped\n\
             element face {faces}\nproperty list uchar uint vertex_indices\nend_header\n",
            self.times()[frame]
        );
        for (DVec3 { x, y, z }, holder) in self.positions(frame).iter().zip(self.grasped(frame)) {
            put(&mut text, format_args!("{x} {y} {z} {holder}\n"));
        }
        for face in self.faces() {
            put(&mut text, format_args!("{}", face.len()));
            for node in face {
                put(&mut text, format_args!(" {node}"));
            }
            text.push('\n');
        }
        text
    }

    fn faces(&self) -> impl Iterator<Item = &[u32]> {
        let sheet = self.sheet();
        let quads = sheet.quads.iter().map(|quad| &quad[..]);
        quads.chain(sheet.triangles.iter().map(|triangle| &triangle[..]))
    }
}

/// Writing to a text cannot fail.
fn put(text: &mut String, what: std::fmt::Arguments<'_>) {
    let written = text.write_fmt(what);
    debug_assert!(written.is_ok());
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GripperState, Rest, Sheet};
    use selvedge_math::{Command, Jaw, Pose};

    fn recording() -> Recording {
        let points =
            [[0., 0.], [1., 0.], [1., 1.], [0., 1.], [2., 0.]].map(|[x, y]| DVec3::new(x, y, 0.5));
        let sheet = Sheet {
            quads: vec![[0, 1, 2, 3]],
            triangles: vec![[1, 4, 2]],
            rest: Rest::Positions(points.to_vec()),
        };
        let mut recording = Recording::new(sheet, 1, "{}".into()).unwrap();
        let command = Command {
            pose: Pose::IDENTITY,
            jaw: Jaw::Closed,
        };
        let state = GripperState {
            command,
            alpha: 1.0,
        };
        recording
            .push(0.25, &points, &[state], &[0, 0, 0, 0, 1])
            .unwrap();
        recording
    }

    #[test]
    fn an_obj_counts_from_1() {
        let expected = "# t = 0.25 s, metres, z up\nv 0 0 0.5\nv 1 0 0.5\nv 1 1 0.5\nv 0 1 0.5\n\
                        v 2 0 0.5\nf 1 2 3 4\nf 2 5 3\n";
        assert_eq!(recording().obj(0), expected);
    }

    #[test]
    fn a_ply_counts_from_0_and_tells_what_is_held() {
        let text = recording().ply(0);
        let (header, body) = text.split_once("end_header\n").unwrap();
        assert!(header.contains("element vertex 5\n") && header.contains("element face 2\n"));
        let expected =
            "0 0 0.5 0\n1 0 0.5 0\n1 1 0.5 0\n0 1 0.5 0\n2 0 0.5 1\n4 0 1 2 3\n3 1 4 2\n";
        assert_eq!(body, expected);
    }
}
