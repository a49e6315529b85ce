//! The time that messages are stamped with: that of the day, or that of `/clock`.

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crate::dds::{Bus, Kept};
use crate::error::{Cause, Error};
use crate::messages::{Clock as ClockMessage, Time};

/// Where stamps come from; clones share it.
#[derive(Clone)]
pub(crate) struct Clock(Option<Sim>);

#[derive(Clone)]
struct Sim {
    topic: String,
    /// The newest time that was not told before, and when it came.
    newest: Arc<Mutex<Option<(Time, Instant)>>>,
    stale: f64,
}

impl Clock {
    /// The time of day.
    pub(crate) fn day() -> Self {
        Self(None)
    }

    /// The time of a simulation: `rosgraph_msgs/Clock`, which must go on at least every `stale`
    /// seconds.
    pub(crate) fn simulated(bus: &mut Bus, topic: &str, stale: f64) -> Result<Self, Error> {
        let newest: Arc<Mutex<Option<(Time, Instant)>>> = Arc::default();
        let shared = Arc::clone(&newest);
        let take = move |message: ClockMessage| {
            let mut newest = shared.lock().unwrap_or_else(|e| e.into_inner());
            // A clock that stands still or jumps back is none.
            let later = |(time, _): &(Time, Instant)| {
                (message.clock.sec, message.clock.nanosec) > (time.sec, time.nanosec)
            };
            if newest.as_ref().is_none_or(later) {
                *newest = Some((message.clock, Instant::now()));
            }
        };
        bus.subscribe(topic, ("rosgraph_msgs", "Clock"), Kept::No, take)?;
        Ok(Self(Some(Sim {
            topic: topic.into(),
            newest,
            stale,
        })))
    }

    /// The stamp of what is sent now; never zero.
    pub(crate) fn now(&self) -> Result<Time, Cause> {
        self.within(self.0.as_ref().map_or(0.0, |sim| sim.stale))
    }

    /// The same when the clock may stand still: what brings a robot to rest must go out.
    pub(crate) fn last(&self) -> Result<Time, Cause> {
        self.within(f64::INFINITY)
    }

    fn within(&self, most: f64) -> Result<Time, Cause> {
        let Some(sim) = &self.0 else {
            return Ok(Time::now());
        };
        let newest = sim.newest.lock().unwrap_or_else(|e| e.into_inner());
        let stale = |age| Cause::Stale {
            what: sim.topic.clone(),
            age,
            bound: sim.stale,
        };
        match &*newest {
            Some((time, at)) if (time.sec, time.nanosec) > (0, 0) => {
                let age = at.elapsed().as_secs_f64();
                if age > most {
                    return Err(stale(age));
                }
                Ok(time.clone())
            }
            _ => Err(stale(f64::INFINITY)),
        }
    }

    /// Waits for a first time.
    pub(crate) fn wait(&self, seconds: f64) -> Result<(), Cause> {
        let until = Instant::now() + Duration::from_secs_f64(seconds);
        loop {
            match self.now() {
                Err(cause) if Instant::now() > until => return Err(cause),
                Err(_) => std::thread::sleep(Duration::from_millis(10)),
                Ok(_) => return Ok(()),
            }
        }
    }
}
