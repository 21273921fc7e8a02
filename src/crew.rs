//! The threads of a run.
//!
//! Windows are segmented side by side on the crew's threads while the caller's thread reads, hands out, and looks up now
//! and then: even a crew of one leaves it free to answer an interrupt. Only what has to stay on the caller's own thread,
//! such as code in Python, is done there.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::awaited::Waiter;
use crate::error::{Error, Result, at_least_one};

/// How often a wait for a job looks up, so that an interrupt is answered at once.
const LOOK_UP: Duration = Duration::from_millis(50);

/// More threads than this are a slip.
const MOST_THREADS: usize = 1024;

/// A number of threads that work together.
pub struct Crew {
    pool: Option<ThreadPool>,
    threads: usize,
    /// The process that has the threads: one that was forked from it has not.
    process: u32,
}

impl Drop for Crew {
    fn drop(&mut self) {
        if std::process::id() != self.process {
            std::mem::forget(self.pool.take());
        }
    }
}

impl Crew {
    /// A crew of `threads` threads.
    ///
    /// # Errors
    /// If there is none, or the system gives none.
    pub fn new(threads: usize) -> Result<Self> {
        if threads > MOST_THREADS {
            return Err(Error::parameter("threads", threads, "1 to 1024; more than there are cores brings nothing"));
        }
        let threads = at_least_one("threads", threads)?;
        let pool = ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("streamseg-{i}")).build();
        let pool = Some(pool.map_err(|e| Error::Foreign(e.into()))?);
        Ok(Self { pool, threads, process: std::process::id() })
    }

    /// The caller's own thread: what it starts is done before it goes on.
    pub fn of_one() -> Self {
        Self { pool: None, threads: 1, process: std::process::id() }
    }

    /// How many threads there are.
    pub fn threads(&self) -> usize {
        self.threads
    }

    /// Does `work` for each item, on all threads; results in the order of the items.
    pub fn map<T: Send, R: Send>(&self, items: Vec<T>, work: impl Fn(T) -> R + Sync + Send) -> Vec<R> {
        match &self.pool {
            Some(pool) if items.len() > 1 && self.threads > 1 => {
                pool.install(|| items.into_par_iter().map(work).collect())
            }
            _ => items.into_iter().map(work).collect(),
        }
    }

    /// Starts a job, or does it right here if there is no other thread.
    pub fn start<R: Send + 'static>(&self, job: impl FnOnce() -> R + Send + 'static) -> Job<R> {
        // A panicking job must neither end the process nor leave its waiter waiting.
        let job = move || catch_unwind(AssertUnwindSafe(job)).map_err(|panic| message(&*panic));
        match &self.pool {
            None => Job::Done(job()),
            Some(pool) => {
                let (sender, receiver) = channel();
                let waiter = Waiter::default();
                let awaited = waiter.awaited();
                pool.spawn(move || {
                    // Nobody listens when the run was given up in the meantime.
                    let _ = sender.send(awaited.during(job));
                });
                Job::Under(receiver, waiter)
            }
        }
    }
}

fn message(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(ToString::to_string);
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "unknown cause".into())
}

/// A job under way; its failure is the message of a panic. Dropped before it is done, it is given up.
pub enum Job<R> {
    /// It was done at once.
    Done(std::result::Result<R, String>),
    /// Another thread does it.
    Under(Receiver<std::result::Result<R, String>>, Waiter),
}

impl<R> Job<R> {
    /// Waits for the job, calling `look_up` now and then; gives up the wait, not the job, if that fails.
    ///
    /// # Errors
    /// What `look_up` returns; the job can be waited for again.
    pub fn wait(&mut self, look_up: &mut dyn FnMut() -> Result<()>) -> Result<std::result::Result<R, String>> {
        self.wait_until(&|| None, look_up)?.map_or_else(|| Ok(Err("it was not waited for".into())), Ok)
    }

    /// As [`wait`](Self::wait), but not beyond `deadline`, which may come while it waits: nothing if the job is not done by
    /// then.
    ///
    /// # Errors
    /// What `look_up` returns; the job can be waited for again.
    pub fn wait_until(
        &mut self,
        deadline: &dyn Fn() -> Option<Instant>,
        look_up: &mut dyn FnMut() -> Result<()>,
    ) -> Result<Option<std::result::Result<R, String>>> {
        let (receiver, waiter) = match std::mem::replace(self, Job::Done(Err("the job was waited for twice".into()))) {
            Job::Done(result) => return Ok(Some(result)),
            Job::Under(receiver, waiter) => (receiver, waiter),
        };
        loop {
            match receiver.recv_timeout(LOOK_UP) {
                Ok(result) => return Ok(Some(result)),
                Err(RecvTimeoutError::Disconnected) => return Ok(Some(Err("its thread ended".into()))),
                Err(RecvTimeoutError::Timeout) => {
                    let looked_up = look_up();
                    if looked_up.is_err() || deadline().is_some_and(|deadline| Instant::now() >= deadline) {
                        *self = Job::Under(receiver, waiter);
                        return looked_up.map(|()| None);
                    }
                }
            }
        }
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn results_keep_the_order_of_the_items() {
        for threads in [1, 4] {
            let crew = Crew::new(threads).unwrap();
            assert_eq!(crew.map((0..100).collect(), |i| i * i), (0..100).map(|i| i * i).collect::<Vec<_>>());
        }
        assert!(Crew::new(0).is_err());
    }

    #[test]
    fn a_panic_is_an_answer_and_an_interrupt_only_ends_the_wait() {
        for threads in [1, 2] {
            let crew = Crew::new(threads).unwrap();
            let mut job = crew.start(|| -> i32 { panic!("oh") });
            assert_eq!(job.wait(&mut || Ok(())).unwrap(), Err("oh".to_string()));
        }
        for threads in [1, 2] {
            let crew = Crew::new(threads).unwrap();
            let (tell, told) = channel();
            drop(crew.start(move || {
                while !crate::awaited::is_given_up() {
                    std::thread::yield_now();
                }
                tell.send(()).unwrap();
            }));
            told.recv().unwrap();
            let (let_go, held) = channel::<()>();
            let mut job = crew.start(move || held.recv().is_ok());
            assert!(job.wait(&mut || Err(Error::parameter("test", 1, "nothing"))).is_err());
            assert_eq!(job.wait_until(&|| Some(Instant::now()), &mut || Ok(())).unwrap(), None);
            let_go.send(()).unwrap();
            assert_eq!(job.wait(&mut || Ok(())).unwrap(), Ok(true));
        }
    }
}
