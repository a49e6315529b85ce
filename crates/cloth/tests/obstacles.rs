//! Cloth on obstacles: nothing gets inside, and friction is Coulomb's.

#![allow(clippy::unwrap_used, reason = "a failed set-up fails the test")]

use selvedge_cloth::{Error, Material, Mesh, Obstacle, Settings, Simulator};
use selvedge_math::{ClothSimulator, DQuat, DVec3, Held, Pose, StepReport};

const DT: f64 = 1.0 / 60.0;
/// Bounds of the penetration of nodes, and of points of edges and faces [m].
const NODES: f64 = 1e-6;
const PARTS: f64 = 1e-4;

const NOTHING: Held<'static> = Held {
    nodes: &[],
    targets: &[],
    velocities: &[],
};

fn at(x: f64, y: f64, z: f64) -> Pose {
    Pose::from_translation(DVec3::new(x, y, z))
}

fn no_table() -> Settings {
    Settings {
        table: false,
        ..Settings::default()
    }
}

/// A square sheet of cells of 2 cm, its nodes mapped by `place`.
fn sheet(cells: usize, settings: Settings, place: impl Fn(DVec3) -> DVec3) -> (Mesh, Simulator) {
    sheet_of([cells, cells], Material::default(), settings, place)
}

fn sheet_of(
    cells: [usize; 2],
    material: Material,
    settings: Settings,
    place: impl Fn(DVec3) -> DVec3,
) -> (Mesh, Simulator) {
    let sides = cells.map(|n| 0.02 * n as f64);
    let mesh = Mesh::grid(cells.map(|n| n + 1), sides).unwrap();
    let mut cloth = Simulator::new(&mesh, material, settings).unwrap();
    let x: Vec<DVec3> = mesh.rest().iter().map(|p| place(*p)).collect();
    cloth.reset(&x, &vec![DVec3::ZERO; x.len()]).unwrap();
    (mesh, cloth)
}

/// The deepest node, and the deepest point of edges and faces [m], zero at least.
fn depths(mesh: &Mesh, x: &[DVec3], obstacle: &Obstacle) -> [f64; 2] {
    let nodes = x.iter().map(|p| -obstacle.distance(*p)).fold(0.0, f64::max);
    let mut parts = 0.0_f64;
    const N: usize = 6;
    for &[a, b, c, d] in mesh.quads() {
        for [a, b, c] in [[a, b, c], [a, c, d]].map(|t| t.map(|k| x[k as usize])) {
            let r = (b - a).length().max((c - a).length());
            if obstacle.distance(a) > 1.5 * r {
                continue;
            }
            for i in 0..=N {
                for j in 0..=N - i {
                    let [s, t] = [i, j].map(|k| k as f64 / N as f64);
                    parts = parts.max(-obstacle.distance(a + s * (b - a) + t * (c - a)));
                }
            }
        }
    }
    [nodes, parts]
}

#[derive(Debug, Default)]
struct Watched {
    nodes: f64,
    parts: f64,
    strain: f64,
    iterations: u32,
    misses: u32,
    seconds: f64,
    least_gap: f64,
}

/// Runs and checks the bounds at every step.
fn run(
    mesh: &Mesh,
    cloth: &mut Simulator,
    seconds: f64,
    mut move_it: impl FnMut(&mut Simulator, u32),
) -> Watched {
    let mut watched = Watched::default();
    for step in 0..(seconds / DT) as u32 {
        move_it(cloth, step);
        let clock = std::time::Instant::now();
        let report: StepReport = cloth.step(NOTHING, DT).unwrap();
        watched.seconds += clock.elapsed().as_secs_f64();
        watched.iterations += report.iterations;
        watched.strain = watched.strain.max(report.strain.unwrap());
        watched.least_gap = watched.least_gap.min(report.gap.unwrap_or(0.0));
        watched.misses += u32::from(report.status != Default::default());
        for obstacle in cloth.obstacles() {
            let [nodes, parts] = depths(mesh, cloth.positions(), obstacle);
            watched.nodes = watched.nodes.max(nodes);
            watched.parts = watched.parts.max(parts);
        }
    }
    watched
}

fn check(name: &str, watched: &Watched) {
    println!("{name}: {watched:?}");
    assert!(watched.nodes <= NODES, "{name}: {watched:?}");
    assert!(watched.parts <= PARTS, "{name}: {watched:?}");
    assert!(watched.strain <= 1e-3, "{name}: {watched:?}");
}

/// A sheet falls flat from 2 cm above the obstacle, a little turned, and drapes.
fn drop_on(name: &str, top: f64, obstacle: Obstacle) {
    let turn = DQuat::from_rotation_z(0.3);
    let shift = DVec3::new(0.013, -0.007, top + 0.02);
    let (mesh, mut cloth) = sheet(14, Settings::default(), |p| turn * p + shift);
    cloth.add_obstacle(obstacle).unwrap();
    let watched = run(&mesh, &mut cloth, 2.0, |_, _| {});
    check(name, &watched);
    let low = cloth.positions().iter().map(|p| p.z).fold(1.0, f64::min);
    assert!(low > -1e-6, "{name}: {low}");
}

#[test]
fn dropped_on_a_sphere() {
    drop_on(
        "sphere",
        0.2,
        Obstacle::sphere(0.1, 0.4).unwrap().at(at(0.0, 0.0, 0.1)),
    );
}

#[test]
fn dropped_on_a_capsule() {
    let ends = [DVec3::new(-0.1, 0.0, 0.0), DVec3::new(0.1, 0.02, 0.0)];
    drop_on(
        "capsule",
        0.15,
        Obstacle::capsule(ends, 0.05, 0.4)
            .unwrap()
            .at(at(0.0, 0.0, 0.1)),
    );
}

/// A rod thinner than a cell: edges touch it whose nodes are far from it.
#[test]
fn dropped_on_a_rod() {
    let ends = [DVec3::new(-0.2, 0.01, 0.0), DVec3::new(0.2, -0.01, 0.0)];
    drop_on(
        "rod",
        0.106,
        Obstacle::capsule(ends, 0.006, 0.4)
            .unwrap()
            .at(at(0.0, 0.0, 0.1)),
    );
}

#[test]
fn dropped_on_a_box() {
    let half = DVec3::new(0.07, 0.05, 0.04);
    drop_on(
        "box",
        0.14,
        Obstacle::cuboid(half, 0.4).unwrap().at(at(0.0, 0.0, 0.1)),
    );
}

#[test]
fn dropped_on_a_hull() {
    // An octahedron on its tip
    let points = [
        DVec3::X,
        -DVec3::X,
        DVec3::Y,
        -DVec3::Y,
        DVec3::Z,
        -DVec3::Z,
    ]
    .map(|p| 0.1 * p);
    drop_on(
        "hull",
        0.2,
        Obstacle::convex(&points, 0.4)
            .unwrap()
            .at(at(0.0, 0.0, 0.1)),
    );
}

/// A prism whose section is an L: a step with a reentrant edge.
fn step_mesh() -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let section = [
        [-0.1, 0.0],
        [0.1, 0.0],
        [0.1, 0.05],
        [0.0, 0.05],
        [0.0, 0.1],
        [-0.1, 0.1],
    ];
    let mut points = Vec::new();
    for y in [-0.08, 0.08] {
        points.extend(section.map(|[x, z]| DVec3::new(x, y, z)));
    }
    let mut triangles = Vec::new();
    for k in 0..6u32 {
        let next = (k + 1) % 6;
        triangles.extend([[k, next, 6 + next], [k, 6 + next, 6 + k]]);
    }
    for t in [[0, 1, 3], [1, 2, 3], [0, 3, 5], [3, 4, 5]] {
        triangles.push([t[0], t[2], t[1]]);
        triangles.push(t.map(|k| k + 6));
    }
    (points, triangles)
}

#[test]
fn dropped_on_a_mesh() {
    let (points, triangles) = step_mesh();
    drop_on(
        "mesh",
        0.1,
        Obstacle::mesh(&points, &triangles, 0.4).unwrap(),
    );
}

/// A sheet on a plane of slope `angle`; velocity down the slope, of every node, at 0.1 s and at the end.
fn slide(friction: f64, angle: f64, seconds: f64) -> ([f64; 2], f64) {
    let material = Material {
        damping: 0.0,
        ..Material::default()
    };
    let turn = DQuat::from_rotation_y(angle);
    let (_, mut cloth) = sheet_of([6, 6], material, no_table(), |p| turn * p);
    let plane = Obstacle::plane(DVec3::ZERO, turn * DVec3::Z, friction).unwrap();
    cloth.add_obstacle(plane).unwrap();
    let down = turn * DVec3::X;
    let mut speeds = [0.0; 2];
    let steps = (seconds / DT).round() as u32;
    for step in 0..steps {
        cloth.step(NOTHING, DT).unwrap();
        let v: Vec<f64> = cloth.velocities().iter().map(|v| v.dot(down)).collect();
        let mean = v.iter().sum::<f64>() / v.len() as f64;
        if step == 5 {
            speeds[0] = mean;
        }
        speeds[1] = mean;
    }
    let creep = cloth
        .velocities()
        .iter()
        .map(|v| v.length())
        .fold(0.0, f64::max);
    let acceleration = (speeds[1] - speeds[0]) / (DT * f64::from(steps - 6));
    (
        speeds,
        acceleration.max(if acceleration > 1e-3 { 0.0 } else { creep }),
    )
}

/// `tan theta = mu`; `a = g' (sin theta - mu cos theta)` with `g' = g delta / rho`.
#[test]
fn an_inclined_plane() {
    for friction in [0.1_f64, 0.4, 1.3] {
        let material = Material::default();
        let g = 9.8 * material.gravitational_density / material.density;
        let (_, creep) = slide(friction, (0.99 * friction).atan(), 4.0);
        println!("mu {friction}: creep {creep:.1e} m/s");
        assert!(creep < 1e-6, "mu {friction}: {creep}");
        let angle = (1.01 * friction).atan();
        let (speeds, _) = slide(friction, angle, 1.0);
        println!("mu {friction}: just above, {speeds:?}");
        assert!(
            speeds[1] > 0.3 * g * (angle.sin() - friction * angle.cos()),
            "{speeds:?}"
        );
        let angle = friction.atan() + 0.2;
        let wanted = g * (angle.sin() - friction * angle.cos());
        let (_, acceleration) = slide(friction, angle, 1.0);
        println!("mu {friction}: {acceleration} against {wanted}");
        assert!(
            (acceleration / wanted - 1.0).abs() < 0.01,
            "{acceleration} {wanted}"
        );
    }
}

#[test]
fn bad_input_is_named() {
    let text = |result: Result<Obstacle, Error>| result.unwrap_err().to_string();
    assert_eq!(
        text(Obstacle::sphere(-1.0, 0.1)),
        "radius [m] is -1, must be at least 0.00025 and finite"
    );
    assert_eq!(
        text(Obstacle::sphere(1.0, f64::NAN)),
        "friction of the obstacle is NaN, must be at least 0 and finite"
    );
    assert_eq!(
        text(Obstacle::plane(DVec3::ZERO, DVec3::ZERO, 0.1)),
        "length of the plane's normal is 0, must be positive and finite"
    );
    assert_eq!(
        text(Obstacle::capsule([DVec3::ZERO, DVec3::INFINITY], 0.1, 0.1)),
        "second end [m] is inf, must be finite"
    );
    assert!(
        text(Obstacle::cuboid(DVec3::new(0.1, 0.0, 0.1), 0.1)).starts_with("half extent [m] is 0")
    );
    let flat = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::X + DVec3::Y];
    assert_eq!(
        text(Obstacle::convex(&flat, 0.1)),
        "obstacle: the hull of 4 points is flat, must be a body with a volume"
    );
    let (mut points, mut triangles) = step_mesh();
    triangles.pop();
    let open = text(Obstacle::mesh(&points, &triangles, 0.1));
    assert!(open.contains("must be part of a closed surface"), "{open}");
    triangles.push([0, 1, 99]);
    let beyond = text(Obstacle::mesh(&points, &triangles, 0.1));
    assert!(
        beyond.contains("has the corner 99 of 12 points"),
        "{beyond}"
    );
    points[3].y = f64::NAN;
    let nan = text(Obstacle::mesh(&points, &triangles, 0.1));
    assert!(nan.contains("point 3 is"), "{nan}");

    let (_, mut cloth) = sheet(2, no_table(), |p| p);
    assert_eq!(
        cloth
            .move_obstacle(0, Pose::IDENTITY)
            .unwrap_err()
            .to_string(),
        "obstacle 0 must be below the number of obstacles, 0"
    );
}

/// The corner of a sheet, thrown at 5 m/s against a plate 2 mm thick: from above, and edge on.
fn throw(name: &str, plate: impl Fn() -> Obstacle) {
    for edge_on in [false, true] {
        let turn = match edge_on {
            false => DQuat::IDENTITY,
            true => DQuat::from_rotation_y(1.5),
        };
        // The sheet stands on its corner.
        let stand = DQuat::from_rotation_x(1.2) * DQuat::from_rotation_z(0.8);
        let (mesh, mut cloth) = sheet(10, no_table(), |p| stand * p + DVec3::Z * 0.36);
        let x = cloth.positions().to_vec();
        let v = vec![DVec3::new(0.3, 0.2, -5.0); x.len()];
        cloth.reset(&x, &v).unwrap();
        let pose = Pose::new(DVec3::new(0.003, 0.001, 0.0), turn).unwrap();
        cloth.add_obstacle(plate().at(pose)).unwrap();
        let watched = run(&mesh, &mut cloth, 0.5, |_, _| {});
        check(&format!("{name}, edge on: {edge_on}"), &watched);
        if !edge_on {
            let low = cloth
                .positions()
                .iter()
                .filter(|p| p.x.abs().max(p.y.abs()) < 0.1);
            let low = low.map(|p| p.z).fold(1.0, f64::min);
            assert!(low > 0.0, "{name}: {low}");
        }
    }
}

#[test]
fn thrown_against_a_thin_box() {
    throw("thin box", || {
        Obstacle::cuboid(DVec3::new(0.2, 0.2, 0.001), 0.3).unwrap()
    });
}

/// A plate of triangles, four by four cells, bent a little.
fn plate_mesh() -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let (n, mut points, mut triangles) = (5u32, Vec::new(), Vec::new());
    for side in [-0.001, 0.001] {
        for j in 0..n {
            for i in 0..n {
                let [x, y] = [i, j].map(|k| 0.1 * f64::from(k) - 0.2);
                points.push(DVec3::new(x, y, side + 0.1 * x * x));
            }
        }
    }
    let top = n * n;
    let mut quad = |a: u32, b: u32, c: u32, d: u32| triangles.extend([[a, b, c], [a, c, d]]);
    for j in 0..n - 1 {
        for i in 0..n - 1 {
            let k = j * n + i;
            quad(top + k, top + k + 1, top + k + 1 + n, top + k + n);
            quad(k, k + n, k + 1 + n, k + 1);
        }
    }
    for i in 0..n - 1 {
        let (a, b) = (i, i + 1);
        quad(a, b, top + b, top + a);
        let (a, b) = (n * (n - 1) + i + 1, n * (n - 1) + i);
        quad(a, b, top + b, top + a);
        let (a, b) = ((i + 1) * n, i * n);
        quad(a, b, top + b, top + a);
        let (a, b) = (i * n + n - 1, (i + 1) * n + n - 1);
        quad(a, b, top + b, top + a);
    }
    (points, triangles)
}

#[test]
fn thrown_against_a_thin_mesh() {
    throw("thin mesh", || {
        let (points, triangles) = plate_mesh();
        Obstacle::mesh(&points, &triangles, 0.3).unwrap()
    });
}

/// A box slides over the table at 0.1 m/s into a sheet that lies there.
#[test]
fn a_moving_box_pushes_a_sheet() {
    let (mesh, mut cloth) = sheet(8, Settings::default(), |p| p);
    let half = DVec3::new(0.05, 0.15, 0.02);
    let place = |step: u32| at(-0.15 + 0.1 * DT * f64::from(step), 0.0, 0.02);
    let k = cloth
        .add_obstacle(Obstacle::cuboid(half, 0.3).unwrap().at(place(0)))
        .unwrap();
    let watched = run(&mesh, &mut cloth, 1.5, |cloth, step| {
        cloth.move_obstacle(k, place(step + 1)).unwrap();
    });
    check("pushed", &watched);
    let x = cloth.positions();
    // The front of the box is at 5 cm, the sheet began at -8 cm.
    assert!(x.iter().all(|p| p.x > 0.05 - 1e-6 && p.z > -1e-6));
    let mean = x.iter().map(|p| p.x).sum::<f64>() / x.len() as f64;
    assert!(mean > 0.08, "{mean}");
}

/// On a plate that speeds up, turns and tilts below the threshold of friction, a sheet stays where it is.
#[test]
fn a_plate_carries_a_sheet() {
    let (mesh, mut cloth) = sheet(8, no_table(), |p| p);
    let plate = Obstacle::cuboid(DVec3::new(0.2, 0.2, 0.01), 0.8).unwrap();
    let place = |step: u32| {
        let t = DT * f64::from(step);
        let s = if t < 1.0 { 0.5 * t * t } else { t - 0.5 };
        let turn = DQuat::from_rotation_z(0.4 * s) * DQuat::from_rotation_x(0.1 * s);
        let way = DVec3::new(0.2 * s, 0.1 * s, 0.3 * s);
        Pose::new(way, turn).unwrap() * at(0.0, 0.0, -0.01)
    };
    let k = cloth.add_obstacle(plate.at(place(0))).unwrap();
    let watched = run(&mesh, &mut cloth, 2.0, |cloth, step| {
        cloth.move_obstacle(k, place(step + 1)).unwrap();
    });
    check("carried", &watched);
    let pose = cloth.obstacles()[k].pose();
    assert!((pose.position() - place(120).position()).length() < 1e-15);
    let local = |p: &DVec3| pose.inverse_transform(*p) - DVec3::Z * 0.01;
    let moved = cloth.positions().iter().zip(mesh.rest());
    let moved = moved
        .map(|(x, rest)| local(x).distance(*rest))
        .fold(0.0, f64::max);
    println!("moved by {moved:.1e} m on the plate");
    assert!(moved < 1e-4, "{moved}");
}

/// What starts inside is moved out gently, and reported.
fn leaves(name: &str, obstacle: Obstacle, depth: f64) {
    let weightless = Settings {
        gravity: 0.0,
        ..no_table()
    };
    let (mesh, mut cloth) = sheet(8, weightless, |p| p);
    cloth.add_obstacle(obstacle).unwrap();
    let first = cloth.step(NOTHING, DT).unwrap();
    assert!(first.gap.unwrap() < -0.9 * depth, "{name}: {first:?}");
    let mut fastest = 0.0_f64;
    for _ in 0..60 {
        cloth.step(NOTHING, DT).unwrap();
        let speeds = cloth.velocities().iter().map(|v| v.length());
        fastest = speeds.fold(fastest, f64::max);
    }
    println!("{name}: out at {fastest} m/s");
    assert!(fastest < 0.2, "{name}: {fastest}");
    check(name, &run(&mesh, &mut cloth, 0.5, |_, _| {}));
}

#[test]
fn a_start_inside_is_resolved() {
    let half = DVec3::new(0.2, 0.2, 0.1);
    let desk = Obstacle::cuboid(half, 0.5).unwrap().at(at(0.0, 0.0, -0.09));
    leaves("out of a box", desk, 0.01);
    let ball = Obstacle::sphere(0.05, 0.5)
        .unwrap()
        .at(at(0.0, 0.0, -0.045));
    leaves("out of a ball", ball, 0.005);
}

/// How far a strip of 60 cm by 8 cm slides within 3 s that hangs by so many of its 30 cells over the
/// end of a desk at `x = 0`. Each row of nodes is ahead of the one before by the share `phase` of a
/// cell. It is held at its other end until it hangs still.
fn slides(desk: &[Obstacle], hanging: f64, phase: f64) -> f64 {
    let (columns, rows) = (31, 5);
    let node = |i: usize, j: usize| (j * columns + i) as u32;
    let place = |i: usize, j: usize| {
        let ahead = phase * (j as f64 - 2.0);
        DVec3::new(i as f64 - 30.0 + hanging + ahead, j as f64 - 2.0, 0.0) * 0.02
    };
    let nodes = (0..rows).flat_map(|j| (0..columns).map(move |i| place(i, j)));
    let quads = (1..rows).flat_map(|j| {
        (1..columns).map(move |i| {
            [
                node(i - 1, j - 1),
                node(i, j - 1),
                node(i, j),
                node(i - 1, j),
            ]
        })
    });
    let mesh = Mesh::new(nodes.collect(), quads.collect(), Vec::new()).unwrap();
    let material = Material {
        bending: 1e-7,
        damping: 4.0,
        ..Material::default()
    };
    let mut cloth = Simulator::new(&mesh, material, no_table()).unwrap();
    for obstacle in desk {
        cloth.add_obstacle(obstacle.clone()).unwrap();
    }
    let last: Vec<u32> = (0..rows).map(|j| node(0, j)).collect();
    cloth.pin(&last).unwrap();
    let settled = run(&mesh, &mut cloth, 3.0, |_, _| {});
    let middle = node(0, 2) as usize;
    let before = cloth.positions()[middle].x;
    cloth.pin(&[]).unwrap();
    let watched = run(&mesh, &mut cloth, 3.0, |_, _| {});
    let way = cloth.positions()[middle].x - before;
    println!("{hanging:.2} cells hang: slid {way:.1e} m, {settled:?} {watched:?}");
    for watched in [settled, watched] {
        assert!(
            watched.nodes <= NODES && watched.parts <= PARTS,
            "{watched:?}"
        );
    }
    way
}

fn desk(friction: f64) -> Obstacle {
    let half = DVec3::new(0.5, 0.3, 0.5);
    let box_ = Obstacle::cuboid(half, friction).unwrap();
    box_.at(at(-half.x, 0.0, -half.z))
}

/// A strip slides off a desk when what hangs pulls harder than friction on top can hold. With an edge
/// rounded by the radius `R` and without friction, what is in front of the desk's end pulls with the
/// weight of its height, so that `mu (L - s) = s + R (1 - pi/2)` for the length `s` in front of it; with
/// `R = 0` that is the share `mu/(1 + mu)`. Half a cell less stays, half a cell more slides.
#[test]
fn an_overhanging_strip() {
    let (length, radius) = (0.6, 0.04);
    let ends = [-0.3, 0.3].map(|y| DVec3::new(0.0, y, -radius));
    for friction in [0.2, 0.3, 0.4] {
        let edge = Obstacle::capsule(ends, radius, 0.0).unwrap();
        let desk = [desk(friction), edge];
        let round = radius * (1.0 - std::f64::consts::FRAC_PI_2);
        let cells = (friction * length - round) / (1.0 + friction) / 0.02;
        let (less, more) = [-0.5, 0.5]
            .map(|more| slides(&desk, cells + more, 0.25))
            .into();
        assert!(less < 1e-4, "friction {friction}: {less}");
        assert!(more > 0.04, "friction {friction}: {more}");
    }
}

/// Over the sharp edge of a box, with the box's friction, a rope slides off when
/// `f = (1 - f) mu exp(mu pi/2)` of it hangs, the last factor from the edge.
///
/// A chain of rigid edges has another threshold in each phase of its nodes about the edge: with a node
/// just past it the edge behind lies flat and those in front hang straight, so that nothing pulls along
/// until the node is a cell's length over the number of hanging cells past the edge. So the rows of this
/// strip are in four phases. Below the threshold they still shift by a tenth of a cell, since contacts
/// of cloth edges with the box's are swept and not solved with the rows.
#[test]
fn an_overhanging_strip_on_a_sharp_edge() {
    let friction = 0.23165_f64;
    let pull = friction * (friction * std::f64::consts::FRAC_PI_2).exp();
    let cells = 30.0 * pull / (1.0 + pull);
    let desk = [desk(friction)];
    let (less, more) = [-0.5, 0.5]
        .map(|more| slides(&desk, cells + more, 0.25))
        .into();
    assert!(less < 2e-3, "{less}");
    assert!(more > 0.02, "{more}");
}

/// A strip over half a cylinder, drawn over it at a constant speed by a hand on one end, while a known
/// force pulls at the other: `T_2 = T_1 exp(mu pi)` (Euler and Eytelwein).
#[test]
fn a_capstan() {
    let (friction, radius, cells) = (0.3, 0.05, 24);
    let material = Material {
        bending: 1e-7,
        damping: 0.0,
        gravitational_density: 1e-9,
        ..Material::default()
    };
    let mesh = Mesh::grid([cells + 1, 3], [0.01 * cells as f64, 0.02]).unwrap();
    let mut cloth = Simulator::new(&mesh, material, no_table()).unwrap();
    // Nodes on a cylinder whose chords of 1 cm are outside of the obstacle
    let r = f64::hypot(radius, 0.005);
    let turn = 2.0 * (0.005 / r).asin() / 0.01;
    let quarter = std::f64::consts::FRAC_PI_2 / turn;
    let place = |p: &DVec3| match p.x.abs() <= quarter {
        true => DVec3::new(r * (p.x * turn).sin(), p.y, r * (p.x * turn).cos()),
        false => DVec3::new(r * p.x.signum(), p.y, quarter - p.x.abs()),
    };
    let x: Vec<DVec3> = mesh.rest().iter().map(place).collect();
    cloth.reset(&x, &vec![DVec3::ZERO; x.len()]).unwrap();
    let ends = [DVec3::Y * -0.1, DVec3::Y * 0.1];
    cloth
        .add_obstacle(Obstacle::capsule(ends, radius, friction).unwrap())
        .unwrap();
    let tension = 0.2;
    let hand: Vec<u32> = (0..3)
        .map(|row| (row * (cells + 1) + cells) as u32)
        .collect();
    for (row, share) in [0.25, 0.5, 0.25].into_iter().enumerate() {
        cloth.forces_mut()[row * (cells + 1)] = DVec3::Z * -tension * share;
    }
    let velocities = [DVec3::Z * -0.1; 3];
    let (mut sum, mut count) = (0.0, 0);
    let mut worst = [0.0_f64; 2];
    for step in 0..24 {
        let way = DVec3::Z * -0.1 * DT * f64::from(step + 1);
        let targets: Vec<DVec3> = hand.iter().map(|&k| x[k as usize] + way).collect();
        let held = Held {
            nodes: &hand,
            targets: &targets,
            velocities: &velocities,
        };
        cloth.step(held, DT).unwrap();
        let [nodes, parts] = depths(&mesh, cloth.positions(), &cloth.obstacles()[0]);
        worst = [worst[0].max(nodes), worst[1].max(parts)];
        let pull: f64 = hand.iter().map(|&k| -cloth.reactions()[k as usize].z).sum();
        if step >= 8 {
            (sum, count) = (sum + pull, count + 1);
        }
    }
    let (ratio, wanted) = (
        sum / f64::from(count) / tension,
        (friction * std::f64::consts::PI).exp(),
    );
    println!("capstan: {ratio} against {wanted}, {worst:?}");
    assert!(worst[0] <= NODES && worst[1] <= PARTS, "{worst:?}");
    assert!((ratio / wanted - 1.0).abs() < 0.03, "{ratio} {wanted}");
}
