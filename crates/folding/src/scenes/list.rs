//! The scenes, one a function.

use std::f64::consts::PI;

use selvedge_cloth::{Material, Mesh, Settings};
use selvedge_math::DVec3;
use selvedge_view::Recording;

use super::{Quantity, Scene};
use crate::Error;

/// First positive zero of the Bessel function J0.
const BESSEL_ZERO: f64 = 2.404825557695773;

/// The node at the tip of a cantilever.
const TIP: usize = 27;

pub(super) fn all() -> Result<Vec<Scene>, Error> {
    Ok(vec![
        free_fall()?,
        hanging_strip()?,
        catenary()?,
        slide()?,
        incline(Side::Below)?,
        incline(Side::Above)?,
        cantilever("cantilever_1", 1.0, [0.991246, 0.123471])?,
        cantilever("cantilever_10", 10.0, [0.656354, 0.700200])?,
        cantilever("cantilever_100", 100.0, [0.159223, 0.937524])?,
        drape()?,
    ])
}

/// A sheet at rest that nothing acts on, for `seconds`.
fn still(mesh: Mesh, seconds: usize) -> Scene {
    let zero = vec![DVec3::ZERO; mesh.node_count()];
    Scene {
        name: "",
        about: "",
        material: Material::default(),
        settings: Settings::default(),
        positions: mesh.rest().to_vec(),
        velocities: zero.clone(),
        pinned: Vec::new(),
        forces: zero,
        steps: 60 * seconds,
        quantities: Vec::new(),
        mesh,
    }
}

fn in_air() -> Settings {
    Settings {
        table: false,
        ..Settings::default()
    }
}

fn without_drag() -> Material {
    Material {
        damping: 0.0,
        ..Material::default()
    }
}

/// `delta g/rho`, the acceleration of a free fall [m/s^2].
fn fall(scene: &Scene) -> f64 {
    scene.material.gravitational_density * scene.settings.gravity / scene.material.density
}

/// Columns of a strip along x on a line of edges of its own length, each rising at an angle [rad].
fn bend(scene: &mut Scene, angles: impl Iterator<Item = f64>) {
    let rest = scene.mesh.rest();
    let mut point = DVec3::ZERO;
    let mut line = vec![point];
    for (column, angle) in angles.enumerate() {
        let side = rest[column].distance(rest[column + 1]);
        point += side * DVec3::new(angle.cos(), 0.0, angle.sin());
        line.push(point);
    }
    for (k, position) in scene.positions.iter_mut().enumerate() {
        *position = line[k % line.len()] + DVec3::Y * rest[k].y;
    }
}

/// Nodes of these columns of a grid with `columns` in all.
fn columns(scene: &Scene, columns: usize, wanted: &[usize]) -> Vec<u32> {
    let nodes = 0..scene.mesh.node_count();
    nodes
        .filter(|k| wanted.contains(&(k % columns)))
        .map(|k| k as u32)
        .collect()
}

/// How far the mean of the nodes is from where it started [m].
fn mean_way(_: &Scene, recording: &Recording) -> f64 {
    let mean = |x: &[DVec3]| x.iter().sum::<DVec3>() / x.len() as f64;
    let last = recording.frame_count() - 1;
    mean(recording.positions(last)).distance(mean(recording.positions(0)))
}

fn lowest(_: &Scene, recording: &Recording) -> f64 {
    let x = recording.positions(recording.frame_count() - 1);
    -x.iter().map(|x| x.z).fold(0.0, f64::min)
}

fn free_fall() -> Result<Scene, Error> {
    let mut scene = still(Mesh::grid([23, 28], [0.42, 0.59])?, 2);
    scene.name = "free_fall";
    scene.about = "A flat sheet falls for two seconds, with drag.";
    scene.settings = in_air();
    let rate = scene.material.damping / scene.material.density;
    let terminal = fall(&scene) / rate;
    scene.quantities = vec![Quantity {
        name: "way [m]",
        formula: "(delta g/alpha) (t - (rho/alpha) (1 - exp(-alpha t/rho)))",
        reference: Some(terminal * (2.0 - (1.0 - (-2.0 * rate).exp()) / rate)),
        measure: mean_way,
    }];
    Ok(scene)
}

/// From an angle that grows towards the free end, near the shape of the first mode.
fn hanging_strip() -> Result<Scene, Error> {
    let cells = 60;
    let length = 0.59;
    let mut scene = still(Mesh::grid([cells + 1, 4], [length, 0.03])?, 10);
    scene.name = "hanging_strip";
    scene.about = "A strip that hangs from one end swings, without drag or bending stiffness.";
    scene.material = Material {
        bending: 0.0,
        ..without_drag()
    };
    scene.settings = in_air();
    // The first mode is J0(j sqrt(s/L)), s from the free end; this is its slope to second order.
    let slope = |k: usize| {
        let s = 1.0 - (k as f64 + 0.5) / cells as f64;
        let z = 0.25 * BESSEL_ZERO * BESSEL_ZERO * s;
        0.03 * (1.0 - z / 2.0 + z * z / 12.0 - z * z * z / 144.0)
    };
    bend(&mut scene, (0..cells).map(|k| -PI / 2.0 + slope(k)));
    scene.pinned = columns(&scene, cells + 1, &[0]);
    scene.quantities = vec![Quantity {
        name: "angular frequency [1/s]",
        formula: "(j_01/2) sqrt(delta g/(rho L))",
        reference: Some(BESSEL_ZERO / 2.0 * (fall(&scene) / length).sqrt()),
        measure: |_, recording| {
            let mean = |frame| recording.positions(frame).iter().map(|x| x.x).sum::<f64>();
            let mut crossings = Vec::new();
            for frame in 1..recording.frame_count() {
                let (before, now) = (mean(frame - 1), mean(frame));
                if (before < 0.0) != (now < 0.0) {
                    let times = [frame - 1, frame].map(|k| recording.times()[k]);
                    crossings.push(times[0] + (times[1] - times[0]) * before / (before - now));
                }
            }
            match crossings[..] {
                [first, .., last] => PI * (crossings.len() - 1) as f64 / (last - first),
                _ => f64::NAN,
            }
        },
    }];
    Ok(scene)
}

fn catenary() -> Result<Scene, Error> {
    let cells = 100;
    let mut scene = still(Mesh::grid([cells + 1, 2], [1.0, 0.01])?, 10);
    scene.name = "catenary";
    scene.about = "A strip of 1 m between two pins 0.7 m apart comes to rest.";
    scene.material = Material {
        bending: 0.0,
        damping: 2.0,
        ..Material::default()
    };
    scene.settings = Settings {
        settled: 1e-8,
        ..in_air()
    };
    let angle = f64::acos(0.7);
    let half = cells / 2;
    bend(
        &mut scene,
        (0..cells).map(|k| if k < half { -angle } else { angle }),
    );
    scene.pinned = columns(&scene, cells + 1, &[0, cells]);
    scene.quantities = vec![Quantity {
        name: "sag [m]",
        formula: "a (cosh(d/2a) - 1), 2a sinh(d/2a) = L",
        reference: Some(0.319720),
        measure: lowest,
    }];
    Ok(scene)
}

fn slide() -> Result<Scene, Error> {
    let mut scene = still(Mesh::grid([23, 28], [0.42, 0.59])?, 1);
    scene.name = "slide";
    scene.about = "A flat sheet slides over the table from 0.3 m/s to rest, without drag.";
    scene.material = without_drag();
    scene.velocities.fill(DVec3::X * 0.3);
    scene.quantities = vec![Quantity {
        name: "way [m]",
        formula: "v^2/(2 mu g'), g' = delta g/rho",
        reference: Some(0.09 / (2.0 * scene.material.friction_table * fall(&scene))),
        measure: mean_way,
    }];
    Ok(scene)
}

#[derive(Clone, Copy)]
enum Side {
    Below,
    Above,
}

/// Gravity is turned instead of the table: `g cos(theta)` down, the rest a force along x.
fn incline(side: Side) -> Result<Scene, Error> {
    let (nodes, sides) = ([23, 28], [0.42, 0.59]);
    let mut scene = still(Mesh::grid(nodes, sides)?, 2);
    scene.material = Material {
        friction_table: 0.4,
        ..without_drag()
    };
    let g = fall(&scene);
    let friction = scene.material.friction_table;
    let tangent = match side {
        Side::Below => 0.95 * friction,
        Side::Above => 1.05 * friction,
    };
    let cosine = 1.0 / f64::hypot(1.0, tangent);
    scene.settings.gravity *= cosine;
    let weight = scene.material.gravitational_density * scene.settings.gravity;
    let cell = sides[0] / (nodes[0] - 1) as f64 * sides[1] / (nodes[1] - 1) as f64;
    let share = |k: usize, n: usize| if k == 0 || k + 1 == n { 0.5 } else { 1.0 };
    for (k, force) in scene.forces.iter_mut().enumerate() {
        let area = cell * share(k % nodes[0], nodes[0]) * share(k / nodes[0], nodes[1]);
        *force = DVec3::X * weight * area * tangent;
    }
    let (name, about, formula, reference) = match side {
        Side::Below => (
            "incline_below",
            "A sheet lies on a plane inclined by 95 % of what friction holds.",
            "0: tan(theta) < mu",
            0.0,
        ),
        Side::Above => (
            "incline_above",
            "A sheet slides down a plane inclined by 105 % of what friction holds.",
            "g' (sin(theta) - mu cos(theta)) t^2/2",
            2.0 * g * cosine * (tangent - friction),
        ),
    };
    (scene.name, scene.about) = (name, about);
    scene.quantities = vec![Quantity {
        name: "way [m]",
        formula,
        reference: Some(reference),
        measure: mean_way,
    }];
    Ok(scene)
}

/// Three columns are pinned; the clamp is in the middle of the last pinned edge, as the second
/// difference there is the first that bends and stands for the cell around it.
fn cantilever(name: &'static str, gamma: f64, tip: [f64; 2]) -> Result<Scene, Error> {
    let nodes = TIP + 1;
    let side = 1.0 / (nodes as f64 - 2.5);
    let mesh = Mesh::grid([nodes, 4], [side * (nodes - 1) as f64, 3.0 * side])?;
    let mut scene = still(mesh, 6);
    scene.name = name;
    scene.about = "A strip of 1 m, clamped level at one end, bends under its weight.";
    scene.settings = Settings {
        substep: 1.0 / 480.0,
        settled: 1e-8,
        iterations: 200,
        ..in_air()
    };
    // Near the critical damping of the slowest mode, sagging little or much
    let slowest = fall(&scene).sqrt() * (3.516 / gamma.sqrt()).max(1.2);
    let weight = scene.material.gravitational_density * scene.settings.gravity;
    scene.material.bending = weight / gamma;
    scene.material.damping = 2.0 * scene.material.density * slowest;
    scene.pinned = columns(&scene, nodes, &[0, 1, 2]);
    let formula = "theta'' = -Gamma (1 - s) cos(theta), Gamma = delta g L^3/kappa";
    scene.quantities = vec![
        Quantity {
            name: "tip forward [m]",
            formula,
            reference: Some(tip[0]),
            measure: |scene, recording| {
                let rest = scene.mesh.rest();
                let clamp = 0.5 * (rest[1].x + rest[2].x);
                recording.positions(recording.frame_count() - 1)[TIP].x - clamp
            },
        },
        Quantity {
            name: "tip down [m]",
            formula,
            reference: Some(tip[1]),
            measure: |_, recording| -recording.positions(recording.frame_count() - 1)[TIP].z,
        },
    ];
    Ok(scene)
}

fn drape() -> Result<Scene, Error> {
    let mut scene = still(Mesh::grid([31, 31], [0.4, 0.4])?, 5);
    scene.name = "drape";
    scene.about = "A sheet hangs down around a disc of 0.2 m, on which its middle is pinned.";
    scene.settings = in_air();
    let nodes = scene.mesh.rest().iter().enumerate();
    scene.pinned = nodes
        .filter(|(_, p)| p.length() < 0.1)
        .map(|(k, _)| k as u32)
        .collect();
    scene.quantities = vec![Quantity {
        name: "lowest point [m]",
        formula: "none",
        reference: None,
        measure: lowest,
    }];
    Ok(scene)
}
