//! The loop that sends poses allocates nothing while the arm moves, and waits for nobody.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

#[path = "interop/run.rs"]
#[allow(dead_code, reason = "not every test needs all of it")]
mod run;

mod peer;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use selvedge_math::Pose;
use selvedge_ros2::arm::{Arm, Measured, Sink, Stream};
use selvedge_ros2::error::Cause;
use selvedge_ros2::gripper::RecordedJaws;
use selvedge_ros2::journal::Journal;
use selvedge_ros2::play::{Settings, play};
use selvedge_ros2::segment::Segment;
use selvedge_ros2::state::State;
use serde_json::json;

/// Counts the allocations of each thread.
struct Counting;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

#[allow(unsafe_code, reason = "an allocator cannot be written without")]
// SAFETY: everything is passed on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: as above.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// An arm whose loop is counted: what its thread allocates from the first poll of a motion to the last,
/// whoever does it.
struct Counted<'a> {
    arm: &'a mut dyn Arm,
    /// The count at the last poll, while it moves.
    before: Option<u64>,
    allocated: u64,
    polls: usize,
}

impl<'a> Counted<'a> {
    fn new(arm: &'a mut dyn Arm) -> Self {
        Self {
            arm,
            before: None,
            allocated: 0,
            polls: 0,
        }
    }
}

impl Arm for Counted<'_> {
    fn prepare(&mut self) -> Result<(), Cause> {
        self.arm.prepare()
    }
    fn measured(&mut self) -> Result<Measured, Cause> {
        self.arm.measured()
    }
    fn joints(&self) -> &[f64] {
        self.arm.joints()
    }
    fn path(&mut self, segments: &mut [Arc<Segment>], brake: f64) -> Result<(), Cause> {
        self.arm.path(segments, brake)
    }
    fn hold(&mut self, now: f64, pose: &Pose) -> Result<(), Cause> {
        self.arm.hold(now, pose)
    }
    fn start(&mut self, now: f64, segment: &Arc<Segment>) -> Result<(), Cause> {
        self.before = None;
        self.arm.start(now, segment)
    }
    fn poll(&mut self, now: f64) -> Result<bool, Cause> {
        let rest = self.arm.poll(now);
        let count = COUNT.get();
        if let Some(before) = self.before {
            self.allocated += count - before;
            self.polls += 1;
        }
        // What the end of a motion brings with it is told once, not every period.
        self.before = matches!(rest, Ok(false)).then_some(count);
        rest
    }
    fn stop(&mut self, now: f64) {
        self.before = None;
        self.arm.stop(now);
    }
}

/// A robot that is where it was sent.
struct Obedient(Pose);

impl Sink for Obedient {
    fn prepare(&mut self) -> Result<(), Cause> {
        Ok(())
    }
    fn measured(&mut self) -> Result<Measured, Cause> {
        let (pose, age) = (self.0, 0.0);
        Ok(Measured { pose, age })
    }
    fn send(&mut self, pose: &Pose) -> Result<(), Cause> {
        self.0 = *pose;
        Ok(())
    }
    fn watch(&mut self) -> Result<(), Cause> {
        Ok(())
    }
}

#[test]
fn the_count_counts() {
    let before = COUNT.get();
    drop(std::hint::black_box(vec![0u8; 100]));
    assert_eq!(COUNT.get() - before, 1);
}

#[test]
fn a_motion_with_its_journal_allocates_nothing() {
    let plan = run::plan(1.0);
    let folder = tempfile::tempdir().unwrap();
    let (journal, writer) = Journal::create(&folder.path().join("run.jsonl"), None).unwrap();
    let mut stream = Stream::new(Obedient(plan.start()), plan.limits, journal.clone());
    let mut arm = Counted::new(&mut stream);
    let settings = Settings {
        real_time: false,
        ..Settings::default()
    };
    let stop = AtomicBool::new(false);
    let end = play(
        &plan,
        &mut arm,
        &mut RecordedJaws::default(),
        &settings,
        &stop,
        &journal,
    );
    assert_eq!(end, State::Finished);
    assert!(arm.polls > 300, "{}", arm.polls);
    assert_eq!(arm.allocated, 0);
    writer.finish().unwrap();
}

#[test]
fn a_motion_on_the_network_allocates_nothing_in_its_loop() {
    let name = "a_motion_on_the_network_allocates_nothing_in_its_loop";
    let mut job = run::Job::new(name, "cartesian", "gripper-command");
    job.settings.period = 0.002;
    let counted = Cell::new(None);
    let played = job.told(json!({})).play_with(|arm, play| {
        let mut arm = Counted::new(arm);
        let end = play(&mut arm);
        counted.set(Some((arm.polls, arm.allocated)));
        end
    });
    let Some(played) = played else { return };
    assert_eq!(played.end, State::Finished);
    let (polls, allocated) = counted.get().unwrap();
    assert!(polls > 600, "{polls}");
    assert_eq!(allocated, 0, "in {polls} periods");
}
