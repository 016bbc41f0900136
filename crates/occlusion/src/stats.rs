//! What a frame took.

use farsight_geometry::Counters;

/// Work of a frame, complete at [`Command::Done`](crate::Command::Done). Deterministic, but for the effects of answers that come late.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct FrameStats {
    /// Nodes taken up: in the view volume, not below a hidden one.
    pub visited: u64,
    /// Leaves drawn.
    pub rendered: u64,
    /// Queries issued, shared ones counted once.
    pub queries: u64,
    /// Queries, of these, that this frame had to wait for.
    pub must_resolve: u64,
    /// Queries, of all, that several nodes shared.
    pub shared: u64,
    /// Answers of this frame's and earlier queries that were acted on.
    pub answers: u64,
    /// Answers that found something occluded.
    pub occluded: u64,
    /// Nodes taken for hidden that an answer of the same frame found visible: what makes a frame wait.
    pub discoveries: u64,
    /// Queries about inner nodes that are descended into anyway: the price of looking whether they can be closed.
    pub retests: u64,
    /// Leaves drawn without a query of their own in this frame: it was not their turn, or an earlier query has no answer yet.
    pub assumed: u64,
    /// Flushes after which new answers were needed.
    pub waves: u64,
}

impl FrameStats {
    /// The main ones as named counters.
    pub fn counters(&self) -> Counters {
        let mut counters = Counters::default();
        for (name, count) in [
            ("visited", self.visited),
            ("rendered", self.rendered),
            ("queries", self.queries),
            ("discoveries", self.discoveries),
            ("waves", self.waves),
        ] {
            counters.add(name, count);
        }
        counters
    }
}
