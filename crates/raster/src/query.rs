//! Occlusion queries that answer late, as hardware does.

use crate::draw::{DepthTest, Draw, Rasteriser, State};
use crate::{Cull, Target};
use farsight_geometry::DAabb;
use glam::{DMat4, DVec3, Vec3};
use std::collections::VecDeque;

/// Names a query.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct QueryId(pub u64);

/// An answered query.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answer {
    /// Which query.
    pub query: QueryId,
    /// Pixels that passed the depth test when the query was issued.
    pub samples: u64,
}

/// A queue of occlusion queries: exact counts, handed out in order after a latency.
///
/// Time is whatever the caller counts with [`tick`](Self::tick): draw calls, triangles, microseconds of a cost model.
/// The count is that of the moment of issue; only the answer is late.
#[derive(Clone, Debug)]
pub struct OcclusionQueries {
    latency: u64,
    now: u64,
    next: u64,
    pending: VecDeque<(Answer, u64)>,
}

impl OcclusionQueries {
    /// An empty queue whose answers come `latency` ticks after the question.
    pub fn new(latency: u64) -> Self {
        Self { latency, now: 0, next: 0, pending: VecDeque::new() }
    }

    /// Asks how many pixels of `draw` would pass the depth test. Nothing is written; the draw's own culling and depth test apply.
    ///
    /// # Panics
    /// When an index of `draw` leads nowhere.
    pub fn issue(&mut self, rasteriser: &mut Rasteriser, target: &Target, draw: &Draw) -> QueryId {
        let query = QueryId(self.next);
        self.next += 1;
        let samples = rasteriser.count_samples(target, draw);
        self.pending.push_back((Answer { query, samples }, self.now + self.latency));
        query
    }

    /// Asks how many pixels of a box would pass: nearer than the buffer, or equal. No pixel counts twice.
    ///
    /// `clip_from_relative` takes world coordinates minus `origin`. A box that contains the eye or crosses the near plane
    /// shows none or only some of its front faces; callers treat such boxes as visible without asking.
    pub fn issue_box(
        &mut self,
        rasteriser: &mut Rasteriser,
        target: &Target,
        clip_from_relative: DMat4,
        origin: DVec3,
        b: &DAabb,
    ) -> QueryId {
        let center = if b.is_empty() { origin } else { b.center() };
        let positions = if b.is_empty() {
            [Vec3::ZERO; 8]
        } else {
            // Rounding outward keeps the proxy around what it stands for.
            let local = b.to_local(center);
            local.corners()
        };
        let state = State { cull: Cull::Back, depth_test: DepthTest::NearerOrEqual, ..State::default() };
        let clip_from_local = clip_from_relative * DMat4::from_translation(center - origin);
        let draw = Draw { positions: &positions, triangles: &DAabb::TRIANGLES, clip_from_local, state };
        self.issue(rasteriser, target, &draw)
    }

    /// Lets time pass.
    pub fn tick(&mut self, ticks: u64) {
        self.now += ticks;
    }

    /// Ticks so far.
    pub fn now(&self) -> u64 {
        self.now
    }

    /// Queries without an answer yet.
    pub fn pending(&self) -> usize {
        self.pending.len()
    }

    /// The next answer in order of issue, if it is due.
    pub fn poll(&mut self) -> Option<Answer> {
        let &(answer, due) = self.pending.front()?;
        (due <= self.now).then(|| {
            self.pending.pop_front();
            answer
        })
    }

    /// The next answer in order of issue, however long it takes: time moves to when it is due. Also returns the ticks
    /// that were lost. `None` when nothing is pending.
    pub fn wait(&mut self) -> Option<(Answer, u64)> {
        let (answer, due) = self.pending.pop_front()?;
        let stall = due.saturating_sub(self.now);
        self.now += stall;
        Some((answer, stall))
    }
}
