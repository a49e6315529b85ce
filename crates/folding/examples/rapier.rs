//! A scenario on the soft body of rapier3d, a simulator that knows nothing of grippers: the same file
//! in, the same recording and error out.
//!
//! ```sh
//! cargo run --release --example rapier -- fixtures/scenarios/corner_fold.toml C4 --out target/rapier
//! ```
//!
//! Left out: nothing resists bending.

use std::collections::BTreeMap;
use std::fs;
use std::ops::ControlFlow;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use rapier3d_f64::prelude::*;
use selvedge_folding::{Run, Scenario, fold_error, half_fold, run_on};
use selvedge_math::{ClothSimulator, DVec3, Held, SimulatorError, StepReport};

// The adapter

/// Longest step of the world [s]; each has four of rapier's solver.
const STEP: f64 = 1.0 / 480.0;

/// A cloth of rapier3d on the table z = 0.
struct Rapier {
    world: PhysicsWorld,
    sheet: SoftBodyHandle,
    positions: Vec<DVec3>,
    velocities: Vec<DVec3>,
}

impl Rapier {
    /// Lays the scenario's cloth into a world.
    fn new(mut world: PhysicsWorld, scenario: &Scenario) -> Result<Self> {
        let (mesh, material) = (&scenario.mesh, scenario.material);
        let grid = mesh.as_grid().context("cloth: must be a rectangle")?;
        let ([columns, rows], [dx, dy]) = (grid.nodes, grid.spacing());
        let (corner, mass) = (mesh.rest()[0], material.density * dx * dy);
        // Threads are as stiff as the step lets them be.
        let thread = SpringCoefficients::new(1e4, 1.0);
        let hertz = (2.0 * material.shear / mass).sqrt() / std::f64::consts::TAU;
        let shear = SpringCoefficients::new(hertz, 1.0);
        let (dx, dy) = (dx * DVec3::X, dy * DVec3::Y);
        let sheet = SoftBodyBuilder::cloth_anisotropic(
            corner, dy, dx, rows, columns, thread, thread, shear,
        );
        let radius = material.thickness / 2.0;
        let sheet = sheet
            .bend_edges(Vec::new())
            .particle_mass(mass)
            .particle_radius(radius)
            .surface_collider(ColliderBuilder::ball(radius).friction(material.friction_cloth))
            .self_contacts(true)
            .linear_damping(material.damping / material.density)
            .can_sleep(false);
        Ok(Self {
            sheet: world.insert_soft_body(sheet),
            world,
            positions: mesh.rest().to_vec(),
            velocities: vec![DVec3::ZERO; mesh.node_count()],
        })
    }
}

impl ClothSimulator for Rapier {
    fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    fn velocities(&self) -> &[DVec3] {
        &self.velocities
    }

    fn step(&mut self, held: Held<'_>, dt: f64) -> Result<StepReport, SimulatorError> {
        held.check(self.positions.len())?;
        let steps = (dt / STEP - 1e-9).ceil();
        self.world.integration_parameters.dt = dt / steps;
        let nodes = held.nodes.iter().map(|&node| node as usize);
        let sheet = &mut self.world.soft_bodies[self.sheet];
        // A released node keeps its velocity.
        for node in 0..self.positions.len() {
            let pinned = held.nodes.binary_search(&(node as u32)).is_ok();
            sheet.set_particle_pinned(node, pinned);
        }
        for step in 1..=steps as u32 {
            let sheet = &mut self.world.soft_bodies[self.sheet];
            for (node, &target) in nodes.clone().zip(held.targets) {
                let way = self.positions[node].lerp(target, f64::from(step) / steps);
                sheet.set_particle_kinematic_target(node, way);
            }
            self.world.step();
        }
        let sheet = &mut self.world.soft_bodies[self.sheet];
        for (node, &velocity) in nodes.zip(held.velocities) {
            sheet.set_particle_velocity(node, velocity);
        }
        self.positions = sheet.particle_positions().collect();
        self.velocities = sheet.particle_velocities().collect();
        SimulatorError::check_state(self.positions.len(), &self.positions, &self.velocities)?;
        Ok(StepReport::default())
    }

    fn reset(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<(), SimulatorError> {
        SimulatorError::check_state(self.positions.len(), positions, velocities)?;
        (self.positions, self.velocities) = (positions.to_vec(), velocities.to_vec());
        let sheet = &mut self.world.soft_bodies[self.sheet];
        for (node, (&at, &velocity)) in positions.iter().zip(velocities).enumerate() {
            sheet.set_particle_position(node, at);
            sheet.set_particle_velocity(node, velocity);
        }
        Ok(())
    }
}

// The fold

/// A table at half the cloth's thickness below z = 0, and the weight of the cloth.
fn world(scenario: &Scenario) -> PhysicsWorld {
    let material = scenario.material;
    let mut world = PhysicsWorld::new();
    let table = ColliderBuilder::new(SharedShape::halfspace(DVec3::Z))
        .translation(-material.thickness / 2.0 * DVec3::Z)
        .friction(material.friction_table)
        .friction_combine_rule(CoefficientCombineRule::Min);
    world.insert_collider(table, None);
    let weight = material.gravitational_density / material.density;
    world.gravity = -scenario.default.gravity * weight * DVec3::Z;
    world.integration_parameters.length_unit = 0.02; // the size of a cell
    world
}

fn main() -> Result<()> {
    let mut wanted: Vec<String> = std::env::args().skip(1).collect();
    if wanted.is_empty() {
        return checked();
    }
    let usage = "rapier SCENARIO [CASE...] --out FOLDER";
    let Some(at @ 1..) = wanted.iter().position(|word| word == "--out") else {
        bail!(usage);
    };
    let out = wanted.drain(at..).nth(1).context(usage)?;
    let (scenario, out) = (Scenario::load(wanted.remove(0))?, Path::new(&out));
    if wanted.is_empty() {
        wanted.extend(scenario.cases.iter().map(|case| case.name.clone()));
    }
    fs::create_dir_all(out.join("rapier"))?;
    let mut runs = BTreeMap::new();
    for name in &wanted {
        let case = scenario
            .case(name)
            .with_context(|| format!("no case {name}"))?;
        for name in [Some(&case.name), case.reference.as_ref()]
            .into_iter()
            .flatten()
        {
            if !runs.contains_key(name) {
                runs.insert(name.clone(), fold(&scenario, name, scenario.steps)?);
            }
        }
    }
    let mut table = String::from("case,support,E [%],strain [%],speed\n");
    for name in &wanted {
        let run = &runs[name];
        let reference = match scenario.case(name).and_then(|case| case.reference.as_ref()) {
            Some(reference) => end(&runs[reference]),
            None => half_fold(&scenario.mesh, scenario.material.thickness),
        };
        let error = fold_error(&end(run), &reference, scenario.mesh.diagonal());
        let support: Vec<String> = run
            .support
            .iter()
            .map(|held| held.len().to_string())
            .collect();
        let timing = run.timing.context("a run has times")?;
        let speed = scenario.frame / timing.solver_step.as_secs_f64();
        let (error, strain) = (100.0 * error, 100.0 * run.worst.strain);
        table += &format!(
            "{name},{},{error:.3},{strain:.3},{speed:.2}\n",
            support.join("+")
        );
        run.recording
            .write(out.join(format!("rapier/{name}.npz")))?;
    }
    print!("{table}");
    fs::write(out.join("table.csv"), table)?;
    Ok(())
}

/// The first steps of a case.
fn fold(scenario: &Scenario, name: &str, steps: usize) -> Result<Run> {
    let case = scenario
        .case(name)
        .with_context(|| format!("no case {name}"))?;
    let scenario = Scenario {
        steps,
        ..scenario.clone()
    };
    let cloth = Box::new(Rapier::new(world(&scenario), &scenario)?);
    Ok(run_on(&scenario, case, "rapier", cloth, |_| {
        ControlFlow::Continue(())
    })?)
}

fn end(run: &Run) -> Vec<DVec3> {
    run.recording
        .positions(run.recording.frame_count() - 1)
        .to_vec()
}

/// Without arguments: the start of a fold, checked.
fn checked() -> Result<()> {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../fixtures/scenarios/corner_fold.toml"
    );
    let run = fold(&Scenario::load(path)?, "C4", 160)?;
    let (support, worst) = (run.support[0].len(), &run.worst);
    println!("C4: {support} nodes held, {worst:?}");
    ensure!(
        support == 4 && worst.held_error < 1e-12,
        "the held nodes are at their targets"
    );
    ensure!(
        worst.height[1] > 0.02 && worst.height[0] > -1e-3,
        "the corner is up, nothing below"
    );
    ensure!(worst.strain < 0.1, "the sheet is whole");
    Ok(())
}
