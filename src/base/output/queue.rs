//! Background writing of output files on other threads.

use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};

use super::OutputError;

/// A file to write, with all that it takes.
pub type Job = Box<dyn FnOnce() -> Result<(), OutputError> + Send>;

/// Threads that do jobs from a bounded queue: those of a queue with one thread in the order in which they were put.
pub struct Queue {
    /// `None` where the caller's own thread does the jobs.
    jobs: Option<SyncSender<Job>>,
    threads: Vec<JoinHandle<()>>,
    outcome: Arc<Mutex<Outcome>>,
}

/// Success of all jobs so far, or the first error; `None` once it has been returned to the caller.
type Outcome = Result<(), Option<OutputError>>;

impl Queue {
    /// Starts up to `threads` threads; without any, each job is done when it is put. Twice as many jobs wait at most.
    pub fn new(threads: usize) -> Self {
        let (sender, receiver) = sync_channel(2 * threads);
        let receiver = Arc::new(Mutex::new(receiver));
        let outcome = Arc::new(Mutex::new(Ok(())));
        let start = |_| {
            let (receiver, outcome) = (Arc::clone(&receiver), Arc::clone(&outcome));
            let thread = thread::Builder::new().name("insonify-writer".to_owned());
            thread.spawn(move || work(&receiver, &outcome)).ok()
        };
        let threads: Vec<_> = (0..threads).map_while(start).collect();
        Self {
            jobs: (!threads.is_empty()).then_some(sender),
            threads,
            outcome,
        }
    }

    /// Adds a job, and waits while the queue is full.
    ///
    /// # Errors
    /// The error of a failed job; the jobs behind it are not done.
    pub fn put(&self, job: Job) -> Result<(), OutputError> {
        taken_error(&self.outcome)?;
        match &self.jobs {
            None => job(),
            // Nobody takes jobs after a panic, which `finish` passes on.
            Some(jobs) => jobs.send(job).or(Ok(())),
        }
    }

    /// Waits until all jobs are done.
    ///
    /// # Errors
    /// The error of a failed job.
    pub fn finish(mut self) -> Result<(), OutputError> {
        self.jobs = None;
        for thread in self.threads.drain(..) {
            thread.join().unwrap_or_else(|panic| resume_unwind(panic));
        }
        taken_error(&self.outcome)
    }
}

impl Drop for Queue {
    /// Gives up the jobs that wait.
    fn drop(&mut self) {
        if !self.threads.is_empty() {
            *lock(&self.outcome) = Err(None);
        }
        self.jobs = None;
        for thread in self.threads.drain(..) {
            // A panic has been reported on that thread.
            let _ = thread.join();
        }
    }
}

fn work(jobs: &Mutex<Receiver<Job>>, outcome: &Mutex<Outcome>) {
    loop {
        let next = lock(jobs).recv();
        let Ok(job) = next else { return };
        if lock(outcome).is_err() {
            continue;
        }
        if let Err(error) = job() {
            let mut outcome = lock(outcome);
            if outcome.is_ok() {
                *outcome = Err(Some(error));
            }
        }
    }
}

fn taken_error(outcome: &Mutex<Outcome>) -> Result<(), OutputError> {
    match &mut *lock(outcome) {
        Err(error) => error.take().map_or(Ok(()), Err),
        Ok(()) => Ok(()),
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::mpsc::channel;

    use super::*;

    fn wrong(text: &str) -> OutputError {
        OutputError::contents(Path::new("a.png"), text.to_owned())
    }

    #[test]
    fn one_thread_keeps_the_order_and_many_do_every_job() {
        for threads in [0, 1, 3] {
            let queue = Queue::new(threads);
            let (done, seen) = channel();
            for at in 0..50 {
                let done = done.clone();
                queue
                    .put(Box::new(move || done.send(at).map_err(|_| wrong("nobody listens"))))
                    .unwrap();
            }
            queue.finish().unwrap();
            drop(done);
            let mut seen: Vec<i32> = seen.iter().collect();
            if threads > 1 {
                seen.sort_unstable();
            }
            assert!(seen.into_iter().eq(0..50), "{threads} threads");
        }
    }

    #[test]
    fn a_failed_job_ends_the_others_and_is_told_once() {
        for threads in [0, 1, 2] {
            let queue = Queue::new(threads);
            let (done, seen) = channel();
            let mut errors = Vec::new();
            for at in 0..100 {
                let done = done.clone();
                let put = queue.put(Box::new(move || match at {
                    3 => Err(wrong("full")),
                    _ => done.send(at).map_err(|_| wrong("nobody listens")),
                }));
                errors.extend(put.err());
                if !errors.is_empty() {
                    break;
                }
            }
            errors.extend(queue.finish().err());
            assert_eq!(errors.len(), 1, "{threads} threads");
            assert_eq!(errors[0].to_string(), "a.png: full");
            drop(done);
            assert!(seen.iter().count() < 99, "{threads} threads");
        }
    }

    #[test]
    fn a_queue_that_is_dropped_gives_up_its_jobs() {
        let queue = Queue::new(1);
        let (go, wait) = channel::<()>();
        let (start, started) = channel();
        let (done, seen) = channel();
        let first = done.clone();
        let waiting = move || {
            start.send(()).map_err(|_| wrong("nobody waits"))?;
            // Ends when the sender is dropped.
            let _ = wait.recv();
            first.send(0).map_err(|_| wrong("nobody listens"))
        };
        queue.put(Box::new(waiting)).unwrap();
        queue
            .put(Box::new(move || done.send(1).map_err(|_| wrong("nobody listens"))))
            .unwrap();
        started.recv().unwrap();
        *lock(&queue.outcome) = Err(None);
        drop(go);
        drop(queue);
        assert_eq!(seen.iter().collect::<Vec<_>>(), [0]);
    }
}
