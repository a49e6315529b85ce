//! Where the time of a run goes.

use std::hint::black_box;
use std::time::{Duration, Instant};

use selvedge_math::Command;
use selvedge_view::Recording;

use crate::fold::{any_closes, commands_at, grippers, view};
use crate::{Case, Error, Scenario};

/// Measured times; the only part of a run that differs from one run to the next.
#[derive(Clone, Copy, Debug, Default)]
pub struct Timing {
    /// Commands and targets: mean over the closed steps after the closing one, median of several
    /// repeats.
    pub gripper_step: Duration,
    /// Selection at closing: mean over the closings, median of several repeats.
    pub selection: Duration,
    /// Cloth, mean over the steps.
    pub solver_step: Duration,
    /// Cloth, mean over the substeps.
    pub solver_substep: Duration,
    /// Simulated time per time spent in gripper and cloth.
    pub real_time_factor: f64,
}

/// Plays the grippers' part of a run again, without the cloth, often enough for a clock.
pub(crate) fn time_gripper(
    scenario: &Scenario,
    case: &Case,
    recording: &Recording,
) -> Result<Timing, Error> {
    const REPEATS: u32 = 20;
    let mut grippers = grippers(case);
    let mut commands: Vec<Command> = Vec::with_capacity(case.grippers.len());
    let (mut selections, mut gripper_steps) = (Vec::new(), Vec::new());
    let failed = |step| {
        move |reason| Error::Gripper {
            time: scenario.time(step),
            reason,
        }
    };
    for _ in 0..REPEATS {
        grippers.reset();
        let (mut closing, mut closings) = (Duration::ZERO, 0);
        let (mut carrying, mut carried) = (Duration::ZERO, 0);
        let mut step = 0;
        while step < scenario.steps {
            commands.clear();
            commands.extend(commands_at(case, scenario.time(step)));
            let cloth = view(scenario, recording.positions(step));
            if any_closes(&grippers, &commands) {
                let before = Instant::now();
                black_box(
                    grippers
                        .step(&commands, scenario.frame, cloth)
                        .map_err(failed(step))?,
                );
                closing += before.elapsed();
                closings += 1;
                step += 1;
                // All closed steps in one measurement: a clock is slower than a step.
                let first = step;
                let closed = |step: &usize| {
                    let jaws = case.grippers.iter().map(|plan| &plan.commands);
                    jaws.into_iter()
                        .all(|jaw| jaw.jaw(scenario.time(*step)).is_closed())
                };
                let end = first + (first..scenario.steps).take_while(closed).count();
                let before = Instant::now();
                while step < end {
                    commands.clear();
                    commands.extend(commands_at(case, scenario.time(step)));
                    let held = grippers.step(&commands, scenario.frame, cloth);
                    black_box(held.map_err(failed(step))?);
                    step += 1;
                }
                carrying += before.elapsed();
                carried += (step - first) as u32;
            } else {
                grippers
                    .step(&commands, scenario.frame, cloth)
                    .map_err(failed(step))?;
                step += 1;
            }
        }
        selections.push(closing / u32::max(closings, 1));
        gripper_steps.push(carrying / u32::max(carried, 1));
    }
    Ok(Timing {
        selection: median(selections),
        gripper_step: median(gripper_steps),
        ..Timing::default()
    })
}

/// The middle one, or the mean of the two middle ones; zero if there is none.
pub(crate) fn median(mut times: Vec<Duration>) -> Duration {
    times.sort_unstable();
    let n = times.len();
    let middle = |k: usize| times.get(k).copied().unwrap_or_default();
    (middle(n / 2) + middle(n.saturating_sub(1) / 2)) / 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_that_of_the_middle_two() {
        let of = |ms: &[u64]| median(ms.iter().map(|&ms| Duration::from_millis(ms)).collect());
        assert_eq!(of(&[]), Duration::ZERO);
        assert_eq!(of(&[9, 1, 2]), Duration::from_millis(2));
        assert_eq!(of(&[9, 1, 2, 4]), Duration::from_millis(3));
    }
}
