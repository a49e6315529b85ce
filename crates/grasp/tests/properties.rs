//! What must hold for any gripper on any cloth, tried on many random ones.

#![allow(clippy::unwrap_used, reason = "a failed set-up fails the test")]

use std::collections::{BTreeMap, BTreeSet};

use selvedge_grasp::{
    ClothView, Command, DQuat, DVec3, Event, GraspVolume, Gripper, Grippers, Jaw, Options, Pose,
    Shape, Squeeze,
};

const DT: f64 = 0.01;

/// Distances of the order of 1 m and a handful of operations: a hundred roundings.
const ROUNDING: f64 = 1e-13;

// ---- Random cases

/// Steele, Lea and Flood 2014: `SplitMix64`.
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, count: u32) -> u32 {
        (self.bits() % u64::from(count)) as u32
    }

    fn chance(&mut self, part: f64) -> bool {
        self.uniform(0.0, 1.0) < part
    }

    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.bits() >> 11) as f64 / (1_u64 << 53) as f64)
    }

    fn vector(&mut self, reach: f64) -> DVec3 {
        DVec3::from_array([(); 3].map(|()| self.uniform(-reach, reach)))
    }

    fn pose(&mut self, reach: f64) -> Pose {
        loop {
            let q = DQuat::from_array([(); 4].map(|()| self.uniform(-1.0, 1.0)));
            if q.length() > 0.1 {
                return Pose::new(self.vector(reach), q).unwrap();
            }
        }
    }

    fn shuffle<T>(&mut self, items: &mut [T]) {
        for k in (1..items.len()).rev() {
            items.swap(k, self.below(k as u32 + 1) as usize);
        }
    }
}

/// A crumpled cloth of quadrilaterals and triangles, its nodes in no order.
struct Cloth {
    positions: Vec<DVec3>,
    edges: Vec<[u32; 2]>,
    quads: Vec<[u32; 4]>,
    triangles: Vec<[u32; 3]>,
}

impl Cloth {
    fn random(random: &mut Random) -> Self {
        let [nx, ny] = [2 + random.below(4), 2 + random.below(4)];
        let cell = random.uniform(0.02, 0.2);
        let mut order: Vec<u32> = (0..nx * ny).collect();
        random.shuffle(&mut order);
        let node = |i: u32, j: u32| order[(j * nx + i) as usize];
        let mut positions = vec![DVec3::ZERO; order.len()];
        let (mut edges, mut quads, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        for j in 0..ny {
            for i in 0..nx {
                positions[node(i, j) as usize] =
                    DVec3::new(f64::from(i), f64::from(j), 0.0) * cell + random.vector(0.3 * cell);
                if i > 0 {
                    edges.push([node(i - 1, j), node(i, j)]);
                }
                if j > 0 {
                    edges.push([node(i, j), node(i, j - 1)]);
                }
                if i > 0 && j > 0 {
                    let [a, b] = [node(i - 1, j - 1), node(i, j - 1)];
                    let [c, d] = [node(i, j), node(i - 1, j)];
                    if random.chance(0.5) {
                        quads.push([a, b, c, d]);
                    } else {
                        triangles.extend([[a, b, c], [a, c, d]]);
                    }
                }
            }
        }
        random.shuffle(&mut edges);
        random.shuffle(&mut quads);
        random.shuffle(&mut triangles);
        Self {
            positions,
            edges,
            quads,
            triangles,
        }
    }

    fn view(&self) -> ClothView<'_> {
        ClothView {
            positions: &self.positions,
            edges: &self.edges,
            quads: &self.quads,
            triangles: &self.triangles,
        }
    }

    /// A pose near a random node.
    fn near(&self, random: &mut Random) -> Pose {
        let node = random.below(self.positions.len() as u32);
        let pose = random.pose(0.05);
        let position = pose.position() + self.positions[node as usize];
        Pose::new(position, pose.rotation()).unwrap()
    }

    fn moved(&self, motion: &Pose) -> Self {
        Self {
            positions: self
                .positions
                .iter()
                .map(|&x| motion.transform(x))
                .collect(),
            edges: self.edges.clone(),
            quads: self.quads.clone(),
            triangles: self.triangles.clone(),
        }
    }
}

fn random_volume(random: &mut Random) -> GraspVolume {
    let mut length = || random.uniform(0.01, 0.25);
    let (a, b, c) = (length(), length(), length());
    let shape = match random.below(3) {
        0 => Shape::Box {
            size: DVec3::new(a, b, c),
        },
        1 => Shape::Pyramid { side: a, height: b },
        _ => Shape::Pyramid {
            side: a,
            height: -b,
        },
    };
    let offset = if random.chance(0.5) {
        random.vector(0.05)
    } else {
        DVec3::ZERO
    };
    GraspVolume::new(shape, offset).unwrap()
}

fn random_squeeze(random: &mut Random) -> Squeeze {
    Squeeze {
        amount: random.uniform(0.0, 1.0),
        lift: random.uniform(0.0, 0.01),
        steps: 1 + random.below(5),
    }
}

fn random_jaw(random: &mut Random) -> Jaw {
    if random.chance(0.7) {
        Jaw::Closed
    } else {
        Jaw::Open
    }
}

// ---- A slow gripper, word by word from the paper

/// How deep a point lies in the volume [m], negative outside. For a pyramid the distances to the
/// slanted sides are taken along x and y.
fn depth(volume: &GraspVolume, p_g: DVec3) -> f64 {
    let p = p_g - volume.offset();
    match volume.shape() {
        Shape::Box { size } => (size / 2.0 - p.abs()).min_element(),
        Shape::Pyramid { side, height } => {
            let z = p.z * height.signum();
            let half = side / 2.0 * (1.0 - z / height.abs());
            z.min(height.abs() - z)
                .min(half - p.x.abs())
                .min(half - p.y.abs())
        }
    }
}

struct Slow {
    volume: GraspVolume,
    squeeze: Squeeze,
    closed_steps: u32,
    p0: BTreeMap<u32, DVec3>,
    targets: BTreeMap<u32, DVec3>,
    velocities: BTreeMap<u32, DVec3>,
}

impl Slow {
    fn new(volume: GraspVolume, squeeze: Squeeze) -> Self {
        Self {
            volume,
            squeeze,
            closed_steps: 0,
            p0: BTreeMap::new(),
            targets: BTreeMap::new(),
            velocities: BTreeMap::new(),
        }
    }

    /// The support, and the distance [m] of the nearest node or centre to the boundary.
    fn support(&self, pose: &Pose, cloth: ClothView<'_>) -> (BTreeSet<u32>, f64) {
        let mut elements: Vec<Vec<u32>> = Vec::new();
        elements.extend((0..cloth.positions.len() as u32).map(|node| vec![node]));
        elements.extend(cloth.edges.iter().map(|edge| edge.to_vec()));
        elements.extend(cloth.quads.iter().map(|face| face.to_vec()));
        elements.extend(cloth.triangles.iter().map(|face| face.to_vec()));
        let (mut support, mut margin) = (BTreeSet::new(), f64::INFINITY);
        for nodes in elements {
            let local = |&node: &u32| pose.inverse_transform(cloth.positions[node as usize]);
            let mean = nodes.iter().map(local).sum::<DVec3>() / nodes.len() as f64;
            let depth = depth(&self.volume, mean);
            margin = margin.min(depth.abs());
            if depth >= 0.0 {
                support.extend(nodes);
            }
        }
        (support, margin)
    }

    /// Gives the margin of a closing step, infinity in others.
    fn step(&mut self, command: Command, cloth: ClothView<'_>, options: Options<'_>) -> f64 {
        self.velocities.clear();
        if command.jaw == Jaw::Open {
            self.closed_steps = 0;
            self.p0.clear();
            self.targets.clear();
            return f64::INFINITY;
        }
        let mut margin = f64::INFINITY;
        self.closed_steps += 1;
        if self.closed_steps == 1 {
            let (support, nearest) = self.support(&command.pose, cloth);
            margin = nearest;
            let anchors = options.anchors.unwrap_or(cloth.positions);
            for node in support {
                let anchor = anchors[node as usize];
                self.p0.insert(node, command.pose.inverse_transform(anchor));
                self.targets.insert(node, cloth.positions[node as usize]);
            }
        }
        let counted = f64::from(self.closed_steps) / f64::from(self.squeeze.steps);
        let alpha = options.alpha.unwrap_or(counted.min(1.0));
        for (&node, &p0) in &self.p0 {
            let squeeze = self.squeeze.amount * (self.volume.offset().x - p0.x);
            let squeezed = p0 + squeeze * DVec3::X + self.squeeze.lift * DVec3::Z;
            let p = (1.0 - alpha) * p0 + alpha * squeezed;
            let target = command.pose.transform(p);
            let previous = self.targets.insert(node, target).unwrap();
            self.velocities.insert(node, (target - previous) / DT);
        }
        margin
    }
}

fn close_to(a: DVec3, b: DVec3, tolerance: f64) -> bool {
    (a - b).abs().max_element() <= tolerance
}

#[test]
fn agrees_with_the_slow_gripper() {
    let mut random = Random(1);
    let (mut captures, mut held_steps, mut undecided) = (0, 0, 0);
    for case in 0..100_000 {
        let mut cloth = Cloth::random(&mut random);
        let volume = random_volume(&mut random);
        let squeeze = random_squeeze(&mut random);
        let mut gripper = Gripper::new(volume, squeeze).unwrap();
        let mut slow = Slow::new(volume, squeeze);
        for _ in 0..6 {
            let command = Command {
                pose: cloth.near(&mut random),
                jaw: random_jaw(&mut random),
            };
            let anchors: Vec<DVec3> = cloth.positions.iter().map(|x| *x * 1.01).collect();
            let options = Options {
                alpha: random.chance(0.3).then(|| random.uniform(0.0, 1.0)),
                anchors: random.chance(0.1).then_some(&anchors),
            };
            let view = cloth.view();
            let margin = slow.step(command, view, options);
            let held = gripper.step_with(command, DT, view, options).unwrap();
            if margin < ROUNDING {
                undecided += 1;
                break;
            }
            let nodes: Vec<u32> = slow.p0.keys().copied().collect();
            assert_eq!(held.nodes, nodes, "case {case}");
            assert_eq!(held.check(view.positions.len()), Ok(()));
            for (k, node) in nodes.iter().enumerate() {
                assert!(close_to(held.targets[k], slow.targets[node], ROUNDING));
                let tolerance = 2.0 * ROUNDING / DT;
                assert!(close_to(
                    held.velocities[k],
                    slow.velocities[node],
                    tolerance
                ));
            }
            held_steps += usize::from(!nodes.is_empty());
            captures += usize::from(gripper.event() == Event::Captured);
            if random.chance(0.5) {
                cloth = cloth.moved(&random.pose(0.1));
            }
        }
    }
    println!("{captures} captures, {held_steps} steps with held nodes, {undecided} undecided");
    assert!(captures > 50_000 && held_steps > 100_000 && undecided < 10);
}

// ---- Symmetries

#[test]
fn a_common_motion_of_cloth_and_gripper_changes_nothing() {
    let mut random = Random(2);
    let mut held_nodes = 0;
    for _ in 0..10_000 {
        let cloth = Cloth::random(&mut random);
        let mut gripper =
            Gripper::new(random_volume(&mut random), random_squeeze(&mut random)).unwrap();
        let mut other = gripper.clone();
        let motion = random.pose(2.0);
        let moved = cloth.moved(&motion);
        let close = cloth.near(&mut random);
        let slow = Slow::new(gripper.volume(), gripper.squeeze());
        if slow.support(&close, cloth.view()).1 < 1e-12 {
            continue;
        }
        for pose in [close, cloth.near(&mut random)] {
            let jaw = Jaw::Closed;
            let held = gripper
                .step(Command { pose, jaw }, DT, cloth.view())
                .unwrap();
            let pose = motion * pose;
            let same = other.step(Command { pose, jaw }, DT, moved.view()).unwrap();
            assert_eq!(held.nodes, same.nodes);
            for k in 0..held.nodes.len() {
                let expected = motion.transform(held.targets[k]);
                assert!(close_to(same.targets[k], expected, 1e-12));
                let expected = motion.rotation() * held.velocities[k];
                assert!(close_to(same.velocities[k], expected, 1e-12 / DT));
            }
            held_nodes += held.nodes.len();
        }
        assert_eq!(gripper.rules(), other.rules());
    }
    assert!(held_nodes > 10_000);
}

#[test]
fn both_signs_of_a_quaternion_are_one_rotation() {
    let mut random = Random(3);
    for _ in 0..10_000 {
        let cloth = Cloth::random(&mut random);
        let mut gripper =
            Gripper::new(random_volume(&mut random), random_squeeze(&mut random)).unwrap();
        let mut other = gripper.clone();
        for _ in 0..3 {
            let near = cloth.near(&mut random);
            let q = near.rotation();
            let [pose, opposite] = [q, -q].map(|q| Pose::new(near.position(), q).unwrap());
            let jaw = random_jaw(&mut random);
            let held = gripper
                .step(Command { pose, jaw }, DT, cloth.view())
                .unwrap();
            let pose = opposite;
            let same = other.step(Command { pose, jaw }, DT, cloth.view()).unwrap();
            assert_eq!(held.nodes, same.nodes);
            assert_eq!(
                (held.targets, held.velocities),
                (same.targets, same.velocities)
            );
        }
    }
}

#[test]
fn the_order_of_the_nodes_does_not_matter() {
    let mut random = Random(4);
    for _ in 0..10_000 {
        let cloth = Cloth::random(&mut random);
        let mut order: Vec<u32> = (0..cloth.positions.len() as u32).collect();
        random.shuffle(&mut order);
        let mut shuffled = Cloth {
            positions: cloth.positions.clone(),
            edges: cloth
                .edges
                .iter()
                .map(|e| e.map(|n| order[n as usize]))
                .collect(),
            quads: cloth
                .quads
                .iter()
                .map(|f| f.map(|n| order[n as usize]))
                .collect(),
            triangles: cloth
                .triangles
                .iter()
                .map(|f| f.map(|n| order[n as usize]))
                .collect(),
        };
        for (&new, &position) in order.iter().zip(&cloth.positions) {
            shuffled.positions[new as usize] = position;
        }
        let mut gripper =
            Gripper::new(random_volume(&mut random), random_squeeze(&mut random)).unwrap();
        let mut other = gripper.clone();
        let close = Command {
            pose: cloth.near(&mut random),
            jaw: Jaw::Closed,
        };
        let held = gripper.step(close, DT, cloth.view()).unwrap();
        let same = other.step(close, DT, shuffled.view()).unwrap();
        assert_eq!(held.nodes.len(), same.nodes.len());
        for (k, &node) in held.nodes.iter().enumerate() {
            let there = same.nodes.binary_search(&order[node as usize]).unwrap();
            assert_eq!(held.targets[k], same.targets[there]);
            assert_eq!(held.velocities[k], same.velocities[there]);
        }
    }
}

#[test]
fn opening_forgets() {
    let mut random = Random(5);
    for _ in 0..10_000 {
        let cloth = Cloth::random(&mut random);
        let fresh = Gripper::new(random_volume(&mut random), random_squeeze(&mut random)).unwrap();
        let mut used = fresh.clone();
        for _ in 0..3 {
            let pose = cloth.near(&mut random);
            let jaw = random_jaw(&mut random);
            used.step(Command { pose, jaw }, DT, cloth.view()).unwrap();
        }
        if random.chance(0.5) {
            let pose = cloth.near(&mut random);
            let jaw = Jaw::Open;
            let held = used.step(Command { pose, jaw }, DT, cloth.view()).unwrap();
            assert!(held.nodes.is_empty() && held.targets.is_empty());
        } else {
            used.reset();
        }
        let mut fresh = fresh;
        for _ in 0..3 {
            let pose = cloth.near(&mut random);
            let jaw = random_jaw(&mut random);
            let expected = fresh.step(Command { pose, jaw }, DT, cloth.view()).unwrap();
            let held = used.step(Command { pose, jaw }, DT, cloth.view()).unwrap();
            assert_eq!(held.nodes, expected.nodes);
            assert_eq!(held.targets, expected.targets);
            assert_eq!(held.velocities, expected.velocities);
            assert_eq!((used.alpha(), used.rules()), (fresh.alpha(), fresh.rules()));
        }
    }
}

// ---- Several grippers

#[test]
fn one_of_one_gripper_is_that_gripper() {
    let mut random = Random(6);
    for _ in 0..10_000 {
        let cloth = Cloth::random(&mut random);
        let mut gripper =
            Gripper::new(random_volume(&mut random), random_squeeze(&mut random)).unwrap();
        let mut grippers = Grippers::new(vec![gripper.clone()]);
        for _ in 0..6 {
            let pose = cloth.near(&mut random);
            let jaw = random_jaw(&mut random);
            let alone = gripper
                .step(Command { pose, jaw }, DT, cloth.view())
                .unwrap();
            let joined = grippers
                .step(&[Command { pose, jaw }], DT, cloth.view())
                .unwrap();
            assert_eq!(alone.nodes, joined.nodes);
            assert_eq!(
                (alone.targets, alone.velocities),
                (joined.targets, joined.velocities)
            );
            assert_eq!(gripper.event(), grippers.grippers()[0].event());
        }
    }
}

#[test]
fn each_node_has_one_gripper_at_most() {
    let mut random = Random(7);
    let mut refused = 0;
    for _ in 0..10_000 {
        let cloth = Cloth::random(&mut random);
        let members: Vec<Gripper> = (0..1 + random.below(4))
            .map(|_| Gripper::new(random_volume(&mut random), random_squeeze(&mut random)).unwrap())
            .collect();
        let mut grippers = Grippers::new(members);
        for _ in 0..6 {
            let before = grippers.clone();
            let commands: Vec<Command> = (0..before.grippers().len())
                .map(|_| Command {
                    pose: cloth.near(&mut random),
                    jaw: random_jaw(&mut random),
                })
                .collect();
            let held = grippers.step(&commands, DT, cloth.view()).unwrap();
            assert_eq!(held.check(cloth.positions.len()), Ok(()));
            let merged = held.nodes.to_vec();
            let mut all = Vec::new();
            for (number, gripper) in grippers.grippers().iter().enumerate() {
                all.extend_from_slice(gripper.nodes());
                let was = &before.grippers()[number];
                if was.jaw().is_closed() || !commands[number].jaw.is_closed() {
                    continue;
                }
                // What it would have caught alone, it holds or was refused; and what it was
                // refused is held by one that was closed before or has a lower number.
                let mut alone = Gripper::new(gripper.volume(), gripper.squeeze()).unwrap();
                let support = alone
                    .step(commands[number], DT, cloth.view())
                    .unwrap()
                    .nodes;
                let mut parts = [gripper.nodes(), gripper.refused()].concat();
                parts.sort_unstable();
                assert_eq!(parts, support);
                for node in gripper.refused() {
                    let holder = grippers
                        .grippers()
                        .iter()
                        .position(|g| g.nodes().contains(node));
                    let holder = holder.unwrap();
                    assert!(holder < number || before.grippers()[holder].nodes().contains(node));
                    refused += 1;
                }
            }
            all.sort_unstable();
            assert_eq!(all, merged);
        }
    }
    assert!(refused > 1_000);
}
