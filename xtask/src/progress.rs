//! How far an experiment is.

use std::collections::HashMap;
use std::io::IsTerminal;
use std::sync::Mutex;

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use selvedge_folding::{Event, FoldName};

/// A bar a fold on a terminal; otherwise a line a case and a line when its ensemble is done.
pub(crate) struct Progress {
    bars: MultiProgress,
    running: Mutex<Running>,
    lines: bool,
    ensemble: usize,
}

/// Bars of running folds, and finished members by case and solver.
#[derive(Default)]
struct Running {
    bars: HashMap<String, ProgressBar>,
    members: HashMap<String, usize>,
}

/// Steps a second, whole ones.
fn rate(state: &ProgressState, text: &mut dyn std::fmt::Write) {
    // What cannot be written to a terminal is not shown.
    write!(text, "{:.0}/s", state.per_sec()).ok();
}

impl Progress {
    pub(crate) fn new(quiet: bool, ensemble: usize) -> Self {
        let bars = MultiProgress::new();
        if quiet {
            bars.set_draw_target(ProgressDrawTarget::hidden());
        }
        Self {
            bars,
            running: Mutex::default(),
            lines: !quiet && !std::io::stderr().is_terminal(),
            ensemble,
        }
    }

    pub(crate) fn clear(&self) -> std::io::Result<()> {
        self.bars.clear()
    }

    pub(crate) fn show(&self, event: Event<'_>) {
        let Ok(mut running) = self.running.lock() else {
            return;
        };
        match event {
            Event::Started { fold, steps } => {
                let bar = self.bars.add(ProgressBar::new(steps as u64));
                let style = "{prefix:>16} {bar:32} {pos:>4}/{len} steps  {rate}  {eta} left";
                if let Ok(style) = ProgressStyle::with_template(style) {
                    bar.set_style(style.with_key("rate", rate));
                }
                bar.set_prefix(self.name(fold));
                running.bars.insert(fold.to_string(), bar);
            }
            Event::Step { fold, step } => {
                if let Some(bar) = running.bars.get(&fold.to_string()) {
                    bar.set_position(step as u64 + 1);
                }
            }
            Event::Reused { fold } => {
                if self.lines && fold.member == 0 {
                    eprintln!("{fold} was done before");
                }
            }
            Event::Finished { fold, failure } => {
                if let Some(bar) = running.bars.remove(&fold.to_string()) {
                    bar.finish_and_clear();
                }
                if self.lines {
                    self.line(fold, failure, &mut running.members);
                }
            }
        }
    }

    fn name(&self, fold: FoldName<'_>) -> String {
        match fold.member {
            0 => fold.to_string(),
            _ => format!("{fold}/{}", self.ensemble),
        }
    }

    fn line(
        &self,
        fold: FoldName<'_>,
        failure: Option<&str>,
        members: &mut HashMap<String, usize>,
    ) {
        match (fold.member, failure) {
            (0, None) => eprintln!("{fold} done"),
            (0, Some(reason)) => eprintln!("{fold} failed: {reason}"),
            _ => {
                let case = FoldName { member: 0, ..fold }.to_string();
                let done = members.entry(case.clone()).or_default();
                *done += 1;
                if *done == self.ensemble {
                    eprintln!("{case}: {done} perturbed starts done");
                }
            }
        }
    }
}
