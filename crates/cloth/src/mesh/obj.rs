//! Meshes from OBJ files.

use std::path::Path;

use selvedge_math::DVec3;

use super::Mesh;
use super::faces::Element;
use crate::Error;

impl Mesh {
    /// Reads a mesh from a Wavefront OBJ file, in metres.
    ///
    /// # Errors
    /// [`Error::File`] when the file cannot be read, otherwise as [`Mesh::parse_obj`].
    pub fn from_obj(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(|error| Error::File {
            path: path.to_owned(),
            message: error.to_string(),
        })?;
        Self::parse_obj(&text, &path.display().to_string())
    }

    /// Reads a mesh from the text of an OBJ file, in metres; `name` is what errors call it.
    ///
    /// Vertices (`v`) are nodes in the order of the file; faces (`f`) have three or four corners.
    /// Texture coordinates and normals of corners are read over, and so are all other lines: groups,
    /// materials, smoothing.
    ///
    /// # Errors
    /// [`Error::Mesh`] names the line of what cannot be read, and of what [`Mesh::new`] refuses.
    ///
    /// ```
    /// use selvedge_cloth::Mesh;
    ///
    /// let text = "v 0 0 0\nv 0.1 0 0\nv 0.1 0.1 0\nv 0 0.1 0\nv 0.2 0 0\nf 1 2 3 4\nf 2 5 3";
    /// let mesh = Mesh::parse_obj(text, "flag.obj")?;
    /// assert_eq!((mesh.quads(), mesh.triangles()), (&[[0, 1, 2, 3]][..], &[[1, 4, 2]][..]));
    /// # Ok::<(), selvedge_cloth::Error>(())
    /// ```
    pub fn parse_obj(text: &str, name: &str) -> Result<Self, Error> {
        let (mut rest, mut quads, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        // The line of each of them
        let (mut rest_at, mut quads_at, mut triangles_at) = (Vec::new(), Vec::new(), Vec::new());
        for (number, line) in (1..).zip(text.lines()) {
            let refuse = |what: String, bound: &str| Error::Mesh {
                place: format!("{name}: line {number}"),
                what,
                bound: bound.into(),
            };
            // A comment may follow on the line.
            let line = line.split('#').next().unwrap_or_default();
            let mut words = line.split_whitespace();
            match words.next() {
                Some("v") => {
                    let mut position = [0.0; 3];
                    for (axis, coordinate) in position.iter_mut().enumerate() {
                        let word = words.next().unwrap_or("missing");
                        *coordinate = word.parse().map_err(|_| {
                            refuse(format!("coordinate {axis} is {word}"), "a number")
                        })?;
                    }
                    rest.push(DVec3::from_array(position));
                    rest_at.push(number);
                }
                Some("f") => {
                    let mut corners = Vec::with_capacity(4);
                    for word in words {
                        let node = corner(word, rest.len());
                        corners.push(node.ok_or_else(|| {
                            let bound =
                                "the number of a vertex above, from 1 or, backwards, from -1";
                            refuse(format!("corner {word}"), bound)
                        })?);
                    }
                    match corners[..] {
                        [a, b, c, d] => {
                            quads.push([a, b, c, d]);
                            quads_at.push(number);
                        }
                        [a, b, c] => {
                            triangles.push([a, b, c]);
                            triangles_at.push(number);
                        }
                        _ => {
                            let what = format!("number of corners is {}", corners.len());
                            return Err(refuse(what, "3 or 4"));
                        }
                    }
                }
                _ => {}
            }
        }
        let place = |element| match element {
            Element::Node(k) => (rest_at[k], "node", k),
            Element::Quad(k) => (quads_at[k], "quad", k),
            Element::Triangle(k) => (triangles_at[k], "triangle", k),
        };
        let mesh = Self::checked(rest, quads, triangles, |element| {
            let (line, kind, k) = place(element);
            format!("line {line}, {kind} {k}")
        });
        mesh.map_err(|error| match error {
            Error::Mesh { place, what, bound } => Error::Mesh {
                place: format!("{name}: {place}"),
                what,
                bound,
            },
            other => other,
        })
    }
}

/// The node of a corner `v`, `v/vt`, `v//vn` or `v/vt/vn`, counted from 1, or from -1 backwards.
fn corner(word: &str, node_count: usize) -> Option<u32> {
    let number: i64 = word.split('/').next()?.parse().ok()?;
    let node = match number {
        1.. => number - 1,
        _ => node_count as i64 + number,
    };
    let exists = number != 0 && (0..node_count as i64).contains(&node);
    exists.then_some(node as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

    #[test]
    fn the_ways_to_write_a_corner() {
        for face in [
            "f 1 2 3 4",
            "f 1/1 2/2 3/3 4/4",
            "f 1//7 2//7 3//7 4//7",
            "f 1/1/1 2/2/1 3/3/1 4/4/1",
            "f -4 -3 -2 -1",
            "  f  1 2 3 4  # all of it\r",
        ] {
            let text = format!("# a square\no cloth\n{SQUARE}vt 0 0\nvn 0 0 1\ns off\n{face}");
            let mesh = Mesh::parse_obj(&text, "square.obj").unwrap();
            assert_eq!(mesh.quads(), [[0, 1, 2, 3]], "{face}");
        }
        let text = format!("{SQUARE}v 2 0 0 1.0\nf 1 2 3 4\nf 2 5 3");
        let mesh = Mesh::parse_obj(&text, "flag.obj").unwrap();
        assert_eq!(
            (mesh.quads().len(), mesh.triangles()),
            (1, &[[1, 4, 2]][..])
        );
    }

    #[test]
    fn errors_name_file_and_line() {
        let corner = "must be the number of a vertex above, from 1 or, backwards, from -1";
        for (end, message) in [
            ("f 1 2 5", format!("c.obj: line 5: corner 5, {corner}")),
            ("f 0 1 2", format!("c.obj: line 5: corner 0, {corner}")),
            ("f -5 1 2", format!("c.obj: line 5: corner -5, {corner}")),
            ("f 1 2 x", format!("c.obj: line 5: corner x, {corner}")),
            (
                "f 1 2",
                "c.obj: line 5: number of corners is 2, must be 3 or 4".into(),
            ),
            (
                "f 1 2 3 4 1",
                "c.obj: line 5: number of corners is 5, must be 3 or 4".into(),
            ),
            (
                "v 0 1",
                "c.obj: line 5: coordinate 2 is missing, must be a number".into(),
            ),
            (
                "v 0 1 zwei",
                "c.obj: line 5: coordinate 2 is zwei, must be a number".into(),
            ),
            (
                "f 1 2 3 4\nv 0 1 inf",
                "c.obj: line 6, node 4: position is [0, 1, inf] m, must be finite".into(),
            ),
            (
                "f 1 2 3 4\n\nf 1 3 1",
                "c.obj: line 7, triangle 0: corner 2 is node 0 again, must be another node".into(),
            ),
            (
                "f 1 2 3",
                "c.obj: line 4, node 3: number of faces is 0, must be at least 1".into(),
            ),
            (
                "",
                "c.obj: mesh: face count is 0, must be at least 1".into(),
            ),
        ] {
            let error = Mesh::parse_obj(&format!("{SQUARE}{end}"), "c.obj").unwrap_err();
            assert_eq!(error.to_string(), message);
        }
        let error = Mesh::from_obj("no such file.obj").unwrap_err();
        assert!(
            error.to_string().starts_with("no such file.obj: "),
            "{error}"
        );
    }
}
