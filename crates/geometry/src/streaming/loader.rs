//! Reading and decoding in the background, the most wanted first.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

struct Shared<N, T, E> {
    state: Mutex<State<N, T, E>>,
    changed: Condvar,
}

struct State<N, T, E> {
    /// Least wanted first.
    wanted: Vec<N>,
    loading: Vec<N>,
    loaded: Vec<(N, Result<T, E>)>,
    /// Buffers to use again.
    spare: Vec<T>,
    /// What `read` panicked with.
    panic: Option<Box<dyn Any + Send>>,
    stop: bool,
}

/// Threads that read things named `N` into buffers `T`. They end when it is dropped.
///
/// ```
/// use farsight_geometry::streaming::Loader;
///
/// let loader = Loader::new(1, |number: u32, into: &mut Vec<u32>| {
///     into.push(number * number);
///     Ok::<(), std::io::Error>(())
/// });
/// loader.request([7].into_iter(), 10);
/// let mut read = Vec::new();
/// while !loader.is_idle() {
///     loader.take(&mut read); // once a frame, say: nothing waits
/// }
/// loader.take(&mut read);
/// assert!(matches!(&read[..], [(7, Ok(squares))] if squares == &[49]));
/// ```
pub struct Loader<N, T, E> {
    shared: Arc<Shared<N, T, E>>,
    threads: Vec<JoinHandle<()>>,
}

impl<N, T, E> Loader<N, T, E>
where
    N: Copy + PartialEq + Send + 'static,
    T: Default + Send + 'static,
    E: Send + 'static,
{
    /// Starts threads (at least one) that call `read` for what is requested. Its buffer may hold what was read into it before.
    pub fn new(threads: usize, read: impl Fn(N, &mut T) -> Result<(), E> + Send + Sync + 'static) -> Self {
        let state = State {
            wanted: Vec::new(),
            loading: Vec::new(),
            loaded: Vec::new(),
            spare: Vec::new(),
            panic: None,
            stop: false,
        };
        let shared = Arc::new(Shared { state: Mutex::new(state), changed: Condvar::new() });
        let read = Arc::new(read);
        let spawn = |_| {
            let (shared, read) = (Arc::clone(&shared), Arc::clone(&read));
            std::thread::spawn(move || shared.work(&*read))
        };
        let threads = (0..threads.max(1)).map(spawn).collect();
        Self { shared, threads }
    }

    /// Replaces all requests that no thread has begun with others, the most wanted first; `limit` bounds how many are
    /// under way or waiting.
    pub fn request(&self, names: impl Iterator<Item = N>, limit: usize) {
        let mut state = self.shared.lock();
        let State { wanted, loading, loaded, .. } = &mut *state;
        wanted.clear();
        let under_way = |n: &N| loading.contains(n) || loaded.iter().any(|l| l.0 == *n);
        wanted.extend(names.take(limit).filter(|n| !under_way(n)));
        wanted.reverse();
        drop(state);
        self.shared.changed.notify_all();
    }

    /// Appends what has been read since the last call to `into`, in the order in which it was finished. Does not wait.
    ///
    /// # Panics
    /// When `read` has: with what it panicked with. Its thread goes on with other things.
    pub fn take(&self, into: &mut Vec<(N, Result<T, E>)>) {
        let mut state = self.shared.lock();
        into.append(&mut state.loaded);
        let panic = state.panic.take();
        drop(state);
        if let Some(panic) = panic {
            resume_unwind(panic);
        }
    }

    /// Whether nothing is waiting, under way, or read and not taken.
    pub fn is_idle(&self) -> bool {
        let state = self.shared.lock();
        state.wanted.is_empty() && state.loading.is_empty() && state.loaded.is_empty()
    }

    /// Gives a buffer back, to be read into again; a few are kept.
    pub fn recycle(&self, data: T) {
        let mut state = self.shared.lock();
        if state.spare.len() < 16 {
            state.spare.push(data);
        }
    }
}

impl<N, T, E> Shared<N, T, E> {
    fn lock(&self) -> MutexGuard<'_, State<N, T, E>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn work(&self, read: &impl Fn(N, &mut T) -> Result<(), E>)
    where
        N: Copy + PartialEq,
        T: Default,
    {
        let mut state = self.lock();
        while !state.stop {
            let Some(name) = state.wanted.pop() else {
                state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
                continue;
            };
            state.loading.push(name);
            let mut data = state.spare.pop().unwrap_or_default();
            drop(state);
            // A buffer that a panic left half filled is not used again.
            let outcome = catch_unwind(AssertUnwindSafe(|| read(name, &mut data).map(|()| data)));
            state = self.lock();
            state.loading.retain(|&n| n != name);
            match outcome {
                Ok(outcome) => state.loaded.push((name, outcome)),
                Err(panic) => state.panic = Some(panic),
            }
        }
    }
}

impl<N, T, E> Drop for Loader<N, T, E> {
    fn drop(&mut self) {
        self.shared.lock().stop = true;
        self.shared.changed.notify_all();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_comes_to_who_takes_and_nothing_hangs() {
        let loader = Loader::new(1, |number: u32, into: &mut u32| {
            assert!(number != 3, "number three");
            *into = 10 * number;
            Ok::<(), ()>(())
        });
        loader.request([3, 4].into_iter(), 10);
        while loader.shared.lock().loaded.is_empty() {
            std::thread::yield_now();
        }
        let mut read = Vec::new();
        let taken = catch_unwind(AssertUnwindSafe(|| loader.take(&mut read)));
        let message = taken.unwrap_err();
        assert_eq!(message.downcast_ref::<&str>(), Some(&"number three"));
        assert_eq!(read, [(4, Ok(40))]);
        assert!(loader.is_idle());
    }
}
