//! One frame of a recording on a picture.

use selvedge_math::DVec3;

use crate::picture::camera::{Camera, Screen};
use crate::picture::raster::{Corner, Raster, samples};
use crate::picture::{Colour, Picture};
use crate::surface::normals;
use crate::volume::volumes;
use crate::{Error, Recording};

const BACKGROUND: Colour = Colour::rgb(255, 255, 255);
const GRID: Colour = Colour::rgb(148, 160, 176);
const SHADOW: Colour = Colour::rgb(52, 62, 84);
const FRONT: Colour = Colour::rgb(84, 134, 190);
const BACK: Colour = Colour::rgb(228, 176, 104);
const THREAD: Colour = Colour::rgb(18, 30, 52);
const GRASPED: Colour = Colour::rgb(214, 30, 42);
const GRIPPER: Colour = Colour::rgb(40, 44, 52);
const PATH: Colour = Colour::rgb(110, 60, 150);

/// Towards the light, not of length 1.
const LIGHT: DVec3 = DVec3::new(0.35, -0.25, 0.9);
/// Distance of the table's lines [m].
const CELL: f64 = 0.1;
/// The table is drawn so far beyond the cloth [m], and has so many lines at most.
const MARGIN: f64 = 0.12;
const MOST_LINES: f64 = 200.0;
/// Pixels of a picture at most: 8192 by 4096.
const MOST_PIXELS: u64 = 1 << 25;

impl Recording {
    /// The camera that sees all of the recording, cloth and grippers in every frame.
    pub fn camera(&self, width: u32, height: u32) -> Camera {
        let frames = 0..self.frame_count();
        let nodes = frames
            .clone()
            .flat_map(|frame| self.positions(frame).iter().copied());
        let hands = frames.flat_map(|frame| self.grippers(frame));
        let hands = hands.map(|gripper| gripper.command.pose.position());
        Camera::around(nodes.chain(hands), width, height)
    }

    /// The camera that sees the cloth in one frame.
    ///
    /// # Panics
    /// When there is no such frame.
    pub fn close_camera(&self, frame: usize, width: u32, height: u32) -> Camera {
        Camera::around(self.positions(frame).iter().copied(), width, height)
    }

    /// A picture of a frame: the cloth with its threads and its shadow, held nodes red, the grasping
    /// volumes where the grippers are (thick lines when the jaws are closed) and the way that each
    /// gripper went while closed, on a table with a line every 0.1 m.
    ///
    /// # Errors
    /// [`Error::Draw`] for a picture without or with more than 2^25 pixels, [`Error::Value`] when
    /// `meta` describes the grasping volumes otherwise than documented.
    ///
    /// # Panics
    /// When there is no such frame.
    pub fn picture(
        &self,
        frame: usize,
        camera: &Camera,
        width: u32,
        height: u32,
    ) -> Result<Picture, Error> {
        let pixels = u64::from(width) * u64::from(height);
        if pixels == 0 || pixels > MOST_PIXELS {
            let reason = format!("{width} by {height} pixels, must be 1 to {MOST_PIXELS} together");
            return Err(Error::Draw(reason));
        }
        let mut drawing = Drawing {
            recording: self,
            positions: self.positions(frame),
            raster: Raster::new(width, height, BACKGROUND),
            screen: Screen::new(camera, samples(width), samples(height)),
            // Lines look the same on pictures of any size.
            pixel: f64::from(width.min(height)) / 480.0,
        };
        drawing.table();
        drawing.cloth();
        drawing.grippers(frame)?;
        Ok(Picture {
            width,
            height,
            pixels: drawing.raster.pixels(),
        })
    }
}

struct Drawing<'a> {
    recording: &'a Recording,
    positions: &'a [DVec3],
    raster: Raster,
    screen: Screen,
    /// A line's width [pixels].
    pixel: f64,
}

impl Drawing<'_> {
    fn line(&mut self, ends: [DVec3; 2], width: f64, colour: Colour, opacity: f32) {
        let [a, b] = ends.map(|end| self.screen.project(end));
        if let (Some(a), Some(b)) = (a, b) {
            let width = (width * self.pixel).max(0.6);
            self.raster.line([a, b], width, colour, opacity);
        }
    }

    /// Lines below all that the cloth covers in any frame.
    fn table(&mut self) {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for frame in 0..self.recording.frame_count() {
            for p in self.recording.positions(frame) {
                (low, high) = (low.min(*p), high.max(*p));
            }
        }
        (low.z, high.z) = (0.0, 0.0);
        let cell = CELL.max((high - low).max_element() / MOST_LINES);
        let low = ((low - MARGIN) / cell).floor();
        let high = ((high + MARGIN) / cell).ceil();
        let [columns, rows] = [high.x - low.x, high.y - low.y].map(|count| count as u32);
        for k in 0..=columns {
            let x = (low.x + f64::from(k)) * cell;
            let end = |y: f64| DVec3::new(x, y * cell, 0.0);
            self.line([end(low.y), end(high.y)], 1.0, GRID, 0.5);
        }
        for k in 0..=rows {
            let y = (low.y + f64::from(k)) * cell;
            let end = |x: f64| DVec3::new(x * cell, y, 0.0);
            self.line([end(low.x), end(high.x)], 1.0, GRID, 0.5);
        }
    }

    fn cloth(&mut self) {
        let sheet = self.recording.sheet();
        let triangles = sheet.all_triangles();
        let corners = |screen: &Screen, positions: &[DVec3]| -> Vec<Option<Corner>> {
            positions.iter().map(|p| screen.project(*p)).collect()
        };

        // Shadow
        let on_table = |p: &DVec3| (p - LIGHT * (p.z / LIGHT.z)).with_z(0.0);
        let cast: Vec<DVec3> = self.positions.iter().map(on_table).collect();
        let shadow = corners(&self.screen, &cast);
        for triangle in &triangles {
            if let [Some(a), Some(b), Some(c)] = triangle.map(|node| shadow[node as usize]) {
                self.raster.shade([a, b, c]);
            }
        }
        self.raster.cast(SHADOW, 0.2);

        // Faces
        let light = LIGHT.normalize();
        let normals = normals(self.positions, &triangles);
        let seen = corners(&self.screen, self.positions);
        for triangle in &triangles {
            let nodes = triangle.map(|node| node as usize);
            let [Some(a), Some(b), Some(c)] = nodes.map(|node| seen[node]) else {
                continue;
            };
            let [p, q, r] = nodes.map(|node| self.positions[node]);
            let front = self.screen.sees_front(p, (q - p).cross(r - p));
            let (colour, side) = if front { (FRONT, 1.0) } else { (BACK, -1.0) };
            let colours = nodes.map(|node| {
                let lit = side * normals[node].dot(light);
                colour.times(0.72 + 0.34 * lit.max(0.0) - 0.22 * (-lit).max(0.0))
            });
            self.raster.triangle([a, b, c], colours);
        }

        // Threads
        for side in sheet.sides() {
            let ends = side.map(|node| self.positions[node as usize]);
            self.line(ends, 0.9, THREAD, 0.25);
        }
    }

    fn grippers(&mut self, frame: usize) -> Result<(), Error> {
        // The way while closed, as far as it has been gone
        for number in 0..self.recording.gripper_count() {
            for k in 1..=frame {
                let [before, now] = [k - 1, k].map(|k| self.recording.grippers(k)[number].command);
                if before.jaw.is_closed() && now.jaw.is_closed() {
                    let ends = [before, now].map(|command| command.pose.position());
                    self.line(ends, 1.6, PATH, 0.8);
                }
            }
        }

        // Held nodes
        for (node, &holder) in self.recording.grasped(frame).iter().enumerate() {
            if let (1.., Some(centre)) = (holder, self.screen.project(self.positions[node])) {
                self.raster
                    .disc(centre, (4.0 * self.pixel).max(1.5), GRASPED);
            }
        }

        // Volumes
        let states = self.recording.grippers(frame);
        for (volume, state) in volumes(self.recording)?.iter().zip(states) {
            let width = if state.command.jaw.is_closed() {
                2.6
            } else {
                1.3
            };
            for edge in &volume.edges {
                let ends = edge.map(|k| state.command.pose.transform(volume.corners[k]));
                self.line(ends, width, GRIPPER, 0.9);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GripperState, Rest, Sheet};
    use selvedge_math::{Command, Jaw, Pose};

    /// A square above the table, its front up or down, and a gripper with a box.
    fn square(up: bool, held: u8) -> Recording {
        let points =
            [[0., 0.], [0.2, 0.], [0.2, 0.2], [0., 0.2]].map(|[x, y]| DVec3::new(x, y, 0.05));
        let sheet = Sheet {
            quads: vec![if up { [0, 1, 2, 3] } else { [3, 2, 1, 0] }],
            triangles: vec![],
            rest: Rest::Positions(points.to_vec()),
        };
        let meta = r#"{"grippers":[{"type":"box","size_m":[0.03,0.03,0.03]}]}"#;
        let mut recording = Recording::new(sheet, 1, meta.into()).unwrap();
        let command = Command {
            pose: Pose::from_translation(DVec3::new(0.2, 0.2, 0.05)),
            jaw: if held > 0 { Jaw::Closed } else { Jaw::Open },
        };
        let state = GripperState {
            command,
            alpha: 0.0,
        };
        recording
            .push(0.0, &points, &[state], &[0, 0, held, 0])
            .unwrap();
        recording
    }

    fn near(pixel: &[u8], colour: Colour) -> bool {
        let apart = |(a, b): (&u8, f32)| (f32::from(*a) - 255.0 * b).abs() < 28.0;
        pixel.iter().zip(colour.0).all(apart)
    }

    #[test]
    fn front_and_back_shadow_held_nodes_and_volume_are_seen() {
        let drawn = |up, held| {
            let recording = square(up, held);
            let camera = recording.camera(240, 180);
            recording.picture(0, &camera, 240, 180).unwrap()
        };
        let count = |picture: &Picture, colour| {
            picture
                .pixels
                .chunks(3)
                .filter(|pixel| near(pixel, colour))
                .count()
        };
        let (front, back) = (drawn(true, 0), drawn(false, 0));
        assert!(count(&front, FRONT) > 1000 && count(&front, BACK) == 0);
        assert!(count(&back, BACK) > 1000 && count(&back, FRONT) == 0);
        let shadow = Colour([0.84, 0.85, 0.87]);
        assert!(count(&front, shadow) > 30);
        assert_eq!(count(&front, GRASPED), 0);
        let held = drawn(true, 1);
        assert!(count(&held, GRASPED) >= 3);
        assert!(2 * count(&held, GRIPPER) > 3 * count(&front, GRIPPER));
        assert_eq!(held, drawn(true, 1));
    }

    #[test]
    fn a_size_that_cannot_be_drawn_is_refused() {
        let recording = square(true, 0);
        let camera = recording.close_camera(0, 10, 10);
        for [width, height] in [[0, 10], [1 << 20, 1 << 20]] {
            let error = recording.picture(0, &camera, width, height).unwrap_err();
            assert!(error.to_string().contains("pixels"), "{error}");
        }
    }
}
