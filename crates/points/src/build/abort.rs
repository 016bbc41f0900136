//! The first error ends the work of all threads.

use super::{Progress, Stage};
use crate::PointsError;
use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Shared by the threads of a build: whether to stop, and how far it is.
pub(super) struct Abort<'a> {
    stop: AtomicBool,
    first: Mutex<Option<PointsError>>,
    progress: &'a (dyn Fn(Progress) -> ControlFlow<()> + Sync),
    done: AtomicU64,
}

impl<'a> Abort<'a> {
    pub fn new(progress: &'a (dyn Fn(Progress) -> ControlFlow<()> + Sync)) -> Self {
        Self { stop: AtomicBool::new(false), first: Mutex::new(None), progress, done: AtomicU64::new(0) }
    }

    /// Keeps the first error and makes everyone stop.
    pub fn fail(&self, error: PointsError) {
        let mut first = self.first.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        first.get_or_insert(error);
        self.stop.store(true, Ordering::Release);
    }

    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Acquire)
    }

    /// Fails when someone else has.
    pub fn check(&self) -> Result<(), PointsError> {
        if self.stopped() { Err(PointsError::Cancelled) } else { Ok(()) }
    }

    /// The error to report after all threads have ended.
    pub fn outcome(&self) -> Result<(), PointsError> {
        let first = self.first.lock().unwrap_or_else(std::sync::PoisonError::into_inner).take();
        first.map_or_else(|| self.check(), Err)
    }

    pub fn begin(&self) {
        self.done.store(0, Ordering::Relaxed);
    }

    /// Counts points as done, and asks whether to go on.
    pub fn advance(&self, stage: Stage, points: u64, total: u64) -> Result<(), PointsError> {
        let done = self.done.fetch_add(points, Ordering::Relaxed) + points;
        if (self.progress)(Progress { stage, done, total }).is_break() {
            self.fail(PointsError::Cancelled);
        }
        self.check()
    }

    /// Runs `work` on some threads and waits for all; the first error is returned, a panic stops the others as well.
    pub fn on_threads(
        &self,
        threads: usize,
        work: impl Fn() -> Result<(), PointsError> + Sync,
    ) -> Result<(), PointsError> {
        let guarded = || {
            let guard = StopOnPanic(self);
            if let Err(error) = work() {
                self.fail(error);
            }
            std::mem::forget(guard);
        };
        std::thread::scope(|scope| {
            for _ in 1..threads {
                scope.spawn(guarded);
            }
            guarded();
        });
        self.outcome()
    }
}

/// Dropped only while a panic unwinds.
struct StopOnPanic<'a, 'b>(&'a Abort<'b>);

impl Drop for StopOnPanic<'_, '_> {
    fn drop(&mut self) {
        self.0.stop.store(true, Ordering::Release);
    }
}
