//! The grasping volume of a recorded gripper, from the description of the recording.

use selvedge_math::DVec3;
use serde::Deserialize;

use crate::{Error, Recording};

/// Corners of a box or a pyramid in the gripper frame [m], and its edges.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Volume {
    pub(crate) corners: Vec<DVec3>,
    pub(crate) edges: Vec<[usize; 2]>,
}

/// An entry of `grippers` in `meta`.
#[derive(Deserialize)]
struct Entry {
    #[serde(flatten)]
    shape: Shape,
    #[serde(default)]
    tip_offset_m: [f64; 3],
}

#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
enum Shape {
    Box { size_m: [f64; 3] },
    Pyramid { side_m: f64, height_m: f64 },
}

/// Edges of a square whose corners are numbered around it from `first`.
fn square(first: usize) -> [[usize; 2]; 4] {
    [0, 1, 2, 3].map(|k| [first + k, first + (k + 1) % 4])
}

/// Corners of the rectangle `x = +-a`, `y = +-b` at `z`.
fn rectangle(a: f64, b: f64, z: f64) -> [DVec3; 4] {
    [(-a, -b), (a, -b), (a, b), (-a, b)].map(|(x, y)| DVec3::new(x, y, z))
}

impl Entry {
    fn volume(&self) -> Volume {
        let (mut corners, edges) = match self.shape {
            Shape::Box { size_m: [x, y, z] } => {
                let (a, b, c) = (0.5 * x, 0.5 * y, 0.5 * z);
                let corners = [rectangle(a, b, -c), rectangle(a, b, c)].concat();
                let upright = [0, 1, 2, 3].map(|k| [k, k + 4]);
                (corners, [square(0), square(4), upright].concat())
            }
            Shape::Pyramid { side_m, height_m } => {
                let mut corners = rectangle(0.5 * side_m, 0.5 * side_m, 0.0).to_vec();
                corners.push(DVec3::Z * height_m);
                let slanted = [0, 1, 2, 3].map(|k| [k, 4]);
                (corners, [square(0), slanted].concat())
            }
        };
        for corner in &mut corners {
            *corner += DVec3::from_array(self.tip_offset_m);
        }
        Volume { corners, edges }
    }
}

/// The volume of each gripper; none where `meta` has no `grippers`.
///
/// # Errors
/// [`Error::Value`] when `grippers` is there but not as the crate's documentation says.
pub(crate) fn volumes(recording: &Recording) -> Result<Vec<Volume>, Error> {
    let found = recording.meta_field("grippers");
    let Some(found) = found.filter(|found| !found.is_null()) else {
        return Ok(Vec::new());
    };
    let entries: Vec<Entry> = serde_json::from_value(found)
        .map_err(|error| Error::value("meta: grippers", error.to_string(), "as documented"))?;
    if entries.len() != recording.gripper_count() {
        let value = format!("{} entries", entries.len());
        let bound = format!("{}, one a gripper", recording.gripper_count());
        return Err(Error::value("meta: grippers", value, bound));
    }
    let volumes: Vec<Volume> = entries.iter().map(Entry::volume).collect();
    for volume in &volumes {
        if !volume.corners.iter().all(|corner| corner.is_finite()) {
            return Err(Error::value(
                "meta: grippers",
                "not finite",
                "finite lengths",
            ));
        }
    }
    Ok(volumes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Rest, Sheet};

    fn found(meta: &str) -> Result<Vec<Volume>, Error> {
        let sheet = Sheet {
            quads: vec![],
            triangles: vec![[0, 1, 2]],
            rest: Rest::Positions(vec![DVec3::ZERO, DVec3::X, DVec3::Y]),
        };
        volumes(&Recording::new(sheet, 1, meta.into()).unwrap())
    }

    #[test]
    fn box_and_pyramid_stand_where_the_tip_is() {
        let text = r#"{"grippers":[{"type":"box","size_m":[2,4,6],"tip_offset_m":[1,0,0]}]}"#;
        let cuboid = &found(text).unwrap()[0];
        let length = |&[a, b]: &[usize; 2]| cuboid.corners[a].distance(cuboid.corners[b]);
        let lengths: f64 = cuboid.edges.iter().map(length).sum();
        assert_eq!((cuboid.edges.len(), lengths), (12, 4.0 * (2.0 + 4.0 + 6.0)));
        let middle: DVec3 = cuboid.corners.iter().sum::<DVec3>() / 8.0;
        assert_eq!(middle, DVec3::X);
        let text = r#"{"grippers":[{"type":"pyramid","side_m":2,"height_m":-3}]}"#;
        let pyramid = &found(text).unwrap()[0];
        assert_eq!(pyramid.corners[4], DVec3::new(0.0, 0.0, -3.0));
        assert_eq!(pyramid.edges.len(), 8);
    }

    #[test]
    fn what_is_not_there_is_left_out_and_what_is_wrong_is_named() {
        assert_eq!(found("{}").unwrap(), []);
        let error = |meta| found(meta).unwrap_err().to_string();
        assert!(error(r#"{"grippers":[]}"#).contains("0 entries"));
        assert!(error(r#"{"grippers":[{"type":"cone"}]}"#).contains("cone"));
        assert!(error(r#"{"grippers":3}"#).contains("meta: grippers"));
    }
}
