//! Threads for parts of a matrix that do not meet: the only file that names rayon.

use std::sync::{Arc, Mutex};

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::Error;

/// Threads that factor and solve together. With any number of them the results are the same to the bit.
#[derive(Clone, Debug, Default)]
pub struct Threads(Option<Arc<ThreadPool>>);

impl Threads {
    /// So many threads; with one, everything runs on the thread that calls.
    ///
    /// # Errors
    /// [`Error::Threads`] when there are none, or the system has no more.
    pub fn new(count: usize) -> Result<Self, Error> {
        match count {
            0 => Err(Error::Threads("0, must be at least 1".into())),
            1 => Ok(Self(None)),
            // The thread that calls is one of them.
            _ => match ThreadPoolBuilder::new().num_threads(count - 1).build() {
                Ok(pool) => Ok(Self(Some(Arc::new(pool)))),
                Err(error) => Err(Error::Threads(error.to_string())),
            },
        }
    }

    /// Does the same to each part, of which every thread takes the next as it gets free.
    pub(super) fn each<T: Send>(&self, parts: &mut [T], work: impl Fn(&mut T) + Sync) {
        let others = self.0.as_ref().filter(|_| parts.len() > 1);
        let Some(pool) = others else {
            return parts.iter_mut().for_each(work);
        };
        let helpers = pool.current_num_threads().min(parts.len() - 1);
        let open = Mutex::new(parts.iter_mut());
        let next = || open.lock().ok().and_then(|mut open| open.next());
        let run = || std::iter::from_fn(next).for_each(&work);
        pool.in_place_scope(|scope| {
            for _ in 0..helpers {
                scope.spawn(|_| run());
            }
            run();
        });
    }
}
