//! Others that say where the tip is: a topic of poses, and the tree of frames.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use selvedge_math::{DQuat, DVec3, Pose};

use crate::arm::Measured;
use crate::dds::{Bus, Kept};
use crate::error::Error;
use crate::messages::{self, PoseStamped, TfMessage};

/// Longest way from a frame up to the root.
const DEPTH: usize = 64;

/// A source of the tip's pose in the base.
pub(crate) struct Witness {
    /// What it is called.
    pub(crate) name: String,
    source: Source,
}

type Newest = Arc<Mutex<Option<(Pose, Instant)>>>;

enum Source {
    Topic(Newest),
    Frames(Arc<Mutex<Frames>>, String, String),
}

impl Witness {
    /// A topic of `geometry_msgs/PoseStamped` in the base's frame; others are not looked at.
    pub(crate) fn topic(bus: &mut Bus, topic: &str, base: &str) -> Result<Self, Error> {
        let newest: Newest = Arc::default();
        let (shared, base) = (Arc::clone(&newest), base.to_owned());
        let take = move |message: PoseStamped| {
            if *message.header.frame_id.0 == *base
                && let Some(pose) = message.pose.rigid()
            {
                let mut newest = shared.lock().unwrap_or_else(|e| e.into_inner());
                *newest = Some((pose, Instant::now()));
            }
        };
        bus.subscribe(topic, ("geometry_msgs", "PoseStamped"), Kept::No, take)?;
        Ok(Self {
            name: bus.resolve(topic)?,
            source: Source::Topic(newest),
        })
    }

    /// `/tf` and `/tf_static`, from the base to the tip.
    pub(crate) fn frames(bus: &mut Bus, base: &str, tip: &str) -> Result<Self, Error> {
        let frames: Arc<Mutex<Frames>> = Arc::default();
        for (topic, kept, fixed) in [("/tf", Kept::No, false), ("/tf_static", Kept::Last, true)] {
            let shared = Arc::clone(&frames);
            let take = move |message: TfMessage| {
                let mut frames = shared.lock().unwrap_or_else(|e| e.into_inner());
                for transform in message.transforms {
                    let pose = messages::Pose {
                        position: transform.translation,
                        orientation: transform.rotation,
                    };
                    if let Some(pose) = pose.rigid() {
                        let at = (!fixed).then(Instant::now);
                        let parent = transform.header.frame_id.0.to_string();
                        frames.put(&parent, &transform.child_frame_id, pose, at);
                    }
                }
            };
            bus.subscribe(topic, ("tf2_msgs", "TFMessage"), kept, take)?;
        }
        Ok(Self {
            name: format!("/tf from {base} to {tip}"),
            source: Source::Frames(frames, base.into(), tip.into()),
        })
    }

    /// The newest pose.
    pub(crate) fn measured(&self) -> Measured {
        let found = match &self.source {
            Source::Topic(newest) => {
                let newest = newest.lock().unwrap_or_else(|e| e.into_inner());
                newest.map(|(pose, at)| (pose, Some(at)))
            }
            Source::Frames(frames, base, tip) => {
                let frames = frames.lock().unwrap_or_else(|e| e.into_inner());
                frames.between(base, tip)
            }
        };
        found.map_or(Measured::NEVER, |(pose, at)| Measured {
            pose,
            age: at.map_or(0.0, |at| at.elapsed().as_secs_f64()),
        })
    }
}

/// Each frame's parent, its pose in it, and when that came; never old when it is fixed.
#[derive(Default)]
struct Frames(BTreeMap<String, (String, Pose, Option<Instant>)>);

impl Frames {
    fn put(&mut self, parent: &str, child: &str, pose: Pose, at: Option<Instant>) {
        // Old programs write a slash before a frame.
        let plain = |name: &str| name.trim_start_matches('/').to_owned();
        self.0.insert(plain(child), (plain(parent), pose, at));
    }

    /// The pose of `tip` in `base`, and when the oldest part of it came. The base must be above the
    /// tip, as it is in every arm.
    fn between(&self, base: &str, tip: &str) -> Option<(Pose, Option<Instant>)> {
        let mut pose = Pose::from_unit(DVec3::ZERO, DQuat::IDENTITY);
        let (mut frame, mut oldest) = (tip, None);
        for _ in 0..DEPTH {
            if frame == base {
                return Some((pose, oldest));
            }
            let (parent, up, at) = self.0.get(frame)?;
            pose = *up * pose;
            oldest = match (oldest, *at) {
                (Some(a), Some(b)) if b > a => Some(a),
                (a, None) => a,
                (_, b) => b,
            };
            frame = parent;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn frames_are_chained_and_as_old_as_their_oldest() {
        let mut frames = Frames::default();
        let now = Instant::now();
        let before = now.checked_sub(Duration::from_millis(300)).unwrap_or(now);
        let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let at = |p: DVec3, q: DQuat| Pose::from_unit(p, q);
        frames.put("base", "/link", at(DVec3::X, turn), Some(now));
        frames.put("link", "hand", at(DVec3::X, DQuat::IDENTITY), Some(before));
        frames.put("hand", "tip", at(DVec3::Z, DQuat::IDENTITY), None);
        let (pose, oldest) = frames.between("base", "tip").unwrap();
        assert!(pose.position().distance(DVec3::new(1.0, 1.0, 1.0)) < 1e-15);
        assert_eq!(oldest, Some(before));
        assert!(frames.between("base", "elsewhere").is_none());
        assert!(frames.between("tip", "base").is_none());
        // A ring has no end.
        frames.put("tip", "base", Pose::IDENTITY, None);
        assert!(frames.between("nowhere", "tip").is_none());
    }
}
