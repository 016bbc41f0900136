//! Reading and decoding in the background, the most wanted first.

use crate::tree::{Mesh, NodeId};
use crate::{HlodError, NodeMesh, Store};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

/// What was read.
pub(crate) type Loaded = (NodeId, Result<NodeMesh, HlodError>);

struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    /// Least wanted first.
    wanted: Vec<NodeId>,
    loading: Vec<NodeId>,
    loaded: Vec<Loaded>,
    /// Buffers to use again.
    spare: Vec<NodeMesh>,
    stop: bool,
}

/// Threads that read.
pub(crate) struct Loader {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
}

impl Loader {
    pub fn new(store: &Arc<Store>, mesh: Mesh, threads: usize) -> Self {
        let shared = Arc::new(Shared { state: Mutex::default(), changed: Condvar::new() });
        let spawn = |_| {
            let (shared, store) = (Arc::clone(&shared), Arc::clone(store));
            std::thread::spawn(move || shared.work(&store, mesh))
        };
        let threads = (0..threads.max(1)).map(spawn).collect();
        Self { shared, threads }
    }

    /// Replaces all requests that no thread has begun with others, the most wanted first; `limit` bounds how many are
    /// under way or waiting.
    pub fn request(&self, nodes: impl Iterator<Item = NodeId>, limit: usize) {
        let mut state = self.shared.lock();
        let State { wanted, loading, loaded, .. } = &mut *state;
        wanted.clear();
        let under_way = |n: &NodeId| loading.contains(n) || loaded.iter().any(|l| l.0 == *n);
        wanted.extend(nodes.take(limit).filter(|n| !under_way(n)));
        wanted.reverse();
        drop(state);
        self.shared.changed.notify_all();
    }

    /// Takes what has been read since.
    pub fn take(&self, into: &mut Vec<Loaded>) {
        into.append(&mut self.shared.lock().loaded);
    }

    /// Whether nothing is waiting, under way, or read and not taken.
    pub fn is_idle(&self) -> bool {
        let state = self.shared.lock();
        state.wanted.is_empty() && state.loading.is_empty() && state.loaded.is_empty()
    }

    /// Gives buffers back.
    pub fn recycle(&self, data: NodeMesh) {
        let mut state = self.shared.lock();
        if state.spare.len() < 16 {
            state.spare.push(data);
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn work(&self, store: &Store, mesh: Mesh) {
        let mut state = self.lock();
        while !state.stop {
            let Some(node) = state.wanted.pop() else {
                state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
                continue;
            };
            state.loading.push(node);
            let mut data = state.spare.pop().unwrap_or_default();
            drop(state);
            let outcome = store.read(node, mesh, &mut data).map(|()| data);
            state = self.lock();
            state.loading.retain(|&n| n != node);
            state.loaded.push((node, outcome));
        }
    }
}

impl Drop for Loader {
    fn drop(&mut self) {
        self.shared.lock().stop = true;
        self.shared.changed.notify_all();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}
