//! The state machine: its face, and a frame from beginning to end.

mod answers;
mod queries;
mod visits;

use crate::adaptive::{Switch, Yield};
use crate::hierarchy::Hierarchy;
use crate::policy::{Backend, Options, OptionsError};
use crate::state::{Entry, NodeState, Slots};
use crate::stats::FrameStats;
use crate::view::View;
use farsight_geometry::DAabb;
use farsight_geometry::bvh::NodeId;
use std::collections::{BinaryHeap, VecDeque};

/// Names a query. Names are not used twice, so a late answer never meets the wrong query.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct QueryId {
    slot: u32,
    serial: u32,
}

impl QueryId {
    /// A small number without gaps among the queries in flight, for a place in a query pool.
    pub fn slot(self) -> u32 {
        self.slot
    }
}

/// What a query found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answer {
    /// Whether any sample passed. When in doubt: `true`.
    pub visible: bool,
    /// How many did, where the backend counts.
    pub samples: Option<u64>,
}

impl Answer {
    /// Something passed.
    pub const VISIBLE: Self = Self { visible: true, samples: None };
    /// Nothing passed.
    pub const OCCLUDED: Self = Self { visible: false, samples: None };

    /// From a count.
    pub fn counted(samples: u64) -> Self {
        Self { visible: samples > 0, samples: Some(samples) }
    }
}

/// What a query draws, without writing colour or depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Proxy {
    /// A box. Depth test "nearer or equal", no face culling needed (the eye is never inside).
    Box(DAabb),
    /// The boxes of [`Culler::boxes`], all in the one query.
    Boxes,
    /// The node itself, drawn for good: no [`Command::Render`] follows for it.
    Geometry,
}

/// What the caller does next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Draw the leaf. At most once per frame.
    Render(NodeId),
    /// Start a query, now, against the depth so far.
    Query {
        /// Name for the answer.
        id: QueryId,
        /// Node that it is about; the first of several for [`Proxy::Boxes`].
        node: NodeId,
        /// What to draw in it.
        proxy: Proxy,
        /// Whether this frame cannot end without the answer.
        must_resolve: bool,
    },
    /// Nothing is left to do without answers: submit, and call [`resolve`](Culler::resolve) before going on. Asking again
    /// without new answers gives `Flush` again.
    Flush,
    /// The frame is complete.
    Done,
}

/// Coherent hierarchical culling for one view; keep one per camera, cascade or eye, over the same tree.
///
/// It does no input or output: [`next`](Self::next) says what to draw or query, [`resolve`](Self::resolve) takes answers in any
/// order and at any time, in later frames too.
///
/// # Cost
/// 28 bytes per node id. A few tens of nanoseconds per visited node; no allocation once tables have grown to a scene's needs.
///
/// # References
/// [Wimmer 2007, chapter 4]. Differs: see docs/occlusion.md for what the pseudocode leaves open.
#[derive(Clone, Debug)]
pub struct Culler {
    options: Options,
    view: Option<View>,
    frame: u32,
    hierarchy_generation: u64,
    nodes: Vec<NodeState>,
    slots: Slots,
    /// Open work where the nearest comes first.
    heap: BinaryHeap<Entry>,
    /// Open work where the deepest comes first.
    stack: Vec<Entry>,
    out: VecDeque<Command>,
    /// Slots with answers that have not been acted on.
    answered: Vec<u32>,
    /// Slots of leaves that are drawn anyway, to be settled when the next frame begins.
    deferred: Vec<u32>,
    /// Hidden nodes whose queries wait for company or for the end of a wave.
    hidden: Vec<u32>,
    /// Visible leaves whose queries wait for the end of a wave.
    leaves: Vec<u32>,
    boxes: Vec<DAabb>,
    scratch: Vec<u32>,
    rendered: Vec<NodeId>,
    /// Queries of this frame without an answer that it needs.
    awaited: u32,
    /// Of these, answers at hand.
    at_hand: u32,
    issued_since_flush: bool,
    begun: bool,
    switch: Switch,
    gained: Yield,
    /// First frame after a reset.
    first_frame: u32,
    stats: FrameStats,
}

/// The first frame's number leaves room for "some frames ago".
const FIRST_FRAME: u32 = 1 << 10;
/// A query without an answer for so many frames is taken for lost.
const LOST_AFTER: u32 = 64;
/// Frames of being hidden after which nodes share queries.
const SETTLED: u8 = 4;

impl Culler {
    /// A culler without history.
    ///
    /// # Errors
    /// [`OptionsError`] when a number is out of range, or the options need counts that `backend` does not have.
    pub fn new(options: Options, backend: Backend) -> Result<Self, OptionsError> {
        options.check(backend)?;
        Ok(Self {
            options,
            view: None,
            frame: FIRST_FRAME,
            hierarchy_generation: 0,
            nodes: Vec::new(),
            slots: Slots::new(options.nodes_per_query),
            heap: BinaryHeap::new(),
            stack: Vec::new(),
            out: VecDeque::new(),
            answered: Vec::new(),
            deferred: Vec::new(),
            hidden: Vec::new(),
            leaves: Vec::new(),
            boxes: Vec::new(),
            scratch: Vec::new(),
            rendered: Vec::new(),
            awaited: 0,
            at_hand: 0,
            issued_since_flush: false,
            begun: false,
            switch: Switch::default(),
            gained: Yield::default(),
            first_frame: FIRST_FRAME + 1,
            stats: FrameStats::default(),
        })
    }

    /// The options.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Memory held, in bytes. Stays the same from frame to frame once a scene has been walked through, as nothing is then
    /// allocated.
    pub fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<NodeState>()
            + self.slots.bytes()
            + (self.heap.capacity() + self.stack.capacity()) * size_of::<Entry>()
            + self.out.capacity() * size_of::<Command>()
            + self.boxes.capacity() * size_of::<DAabb>()
            + [&self.answered, &self.deferred, &self.hidden, &self.leaves, &self.scratch]
                .map(|list| list.capacity() * size_of::<u32>())
                .into_iter()
                .sum::<usize>()
            + self.rendered.capacity() * size_of::<NodeId>()
    }

    /// Starts a frame; one that was not finished is dropped.
    pub fn begin_frame(&mut self, view: View) {
        if self.frame > u32::MAX - 2 * LOST_AFTER {
            self.reset();
            self.frame = FIRST_FRAME;
        }
        self.view = Some(view);
        self.frame += 1;
        self.heap.clear();
        self.stack.clear();
        self.out.clear();
        self.hidden.clear();
        self.leaves.clear();
        self.rendered.clear();
        (self.awaited, self.at_hand) = (0, 0);
        self.issued_since_flush = false;
        self.stats = FrameStats::default();
        self.begun = false;
    }

    /// Forgets everything about the past: after a cut, a teleport, another scene. Answers to queries from before are ignored.
    pub fn reset(&mut self) {
        self.nodes.fill(NodeState::NEW);
        self.slots.clear();
        self.answered.clear();
        self.deferred.clear();
        self.heap.clear();
        self.stack.clear();
        self.out.clear();
        self.hidden.clear();
        self.leaves.clear();
        (self.awaited, self.at_hand) = (0, 0);
        (self.switch, self.gained) = (Switch::default(), Yield::default());
        self.first_frame = self.frame + u32::from(self.begun || self.view.is_none());
        self.stats = FrameStats::default();
        self.view = None;
    }

    /// Takes the answer to a query. `false` when the query is not in flight: answered, given up or from before a
    /// [`reset`](Self::reset).
    pub fn resolve(&mut self, id: QueryId, answer: Answer) -> bool {
        let threshold = self.options.lossy_threshold;
        let frame = self.frame;
        let Some(slot) = self.slots.awaiting(id.slot, id.serial) else { return false };
        let visible = match answer.samples {
            Some(samples) if threshold > 0 => samples > threshold,
            _ => answer.visible,
        };
        slot.answer = Some(visible);
        if slot.must_resolve && slot.frame == frame {
            self.at_hand += 1;
        }
        self.answered.push(id.slot);
        true
    }

    /// The next thing to do. Without a frame begun, [`Command::Done`].
    pub fn next<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H) -> Command {
        if !self.begun {
            self.start(hierarchy);
        }
        loop {
            if let Some(command) = self.out.pop_front() {
                return command;
            }
            if self.may_act_on_answers() && self.act_on_answers(hierarchy) {
                continue;
            }
            if !self.blocked()
                && let Some(entry) = self.pop()
            {
                self.visit(hierarchy, entry);
                continue;
            }
            if self.issue_waiting(hierarchy) {
                continue;
            }
            if self.awaited > 0 {
                self.stats.waves += u64::from(self.issued_since_flush);
                self.issued_since_flush = false;
                return Command::Flush;
            }
            return Command::Done;
        }
    }

    /// Boxes of the shared query that was returned last.
    pub fn boxes(&self) -> &[DAabb] {
        &self.boxes
    }

    /// Work of this frame so far.
    pub fn stats(&self) -> &FrameStats {
        &self.stats
    }

    /// Leaves drawn in this frame so far, in order.
    pub fn rendered(&self) -> &[NodeId] {
        &self.rendered
    }

    /// Of [`rendered`](Self::rendered), the leaves that no answer of this frame found occluded. After a depth-only first
    /// pass run to [`Command::Done`] with [`defer`](Options::defer) off, what later passes have to draw; the depth test
    /// "equal" then keeps the image.
    pub fn visible(&self) -> impl Iterator<Item = NodeId> + '_ {
        let seen = |n: &&NodeId| {
            let state = &self.nodes[n.0 as usize];
            state.verified != self.frame || state.visible
        };
        self.rendered.iter().filter(seen).copied()
    }

    /// How a node stands after this frame.
    pub fn classification(&self, node: NodeId) -> Classification {
        match self.nodes.get(node.0 as usize) {
            Some(s) if s.visited == self.frame => match (s.expanded == self.frame, s.visible) {
                (true, true) => Classification::Visible,
                (true, false) => Classification::Taken,
                (false, _) => Classification::Hidden,
            },
            _ => Classification::Unvisited,
        }
    }

    fn start<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H) {
        self.begun = true;
        let Some(view) = self.view else { return };
        if hierarchy.generation() != self.hierarchy_generation {
            self.reset();
            (self.view, self.first_frame) = (Some(view), self.frame);
            self.hierarchy_generation = hierarchy.generation();
        }
        self.settle_last_frame(hierarchy);
        if let Some(adaptive) = &self.options.adaptive {
            self.switch.advance(adaptive, &std::mem::take(&mut self.gained));
        }
        if let Some(root) = hierarchy.root() {
            self.push(
                hierarchy,
                root,
                &Entry { crosses: view.all_planes(), assumed: true, ..Entry::ROOT },
                0,
            );
        }
    }
}

/// How a node stands after a frame, for pictures such as figure 4.7.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Classification {
    /// Outside the view volume or below a hidden node.
    Unvisited,
    /// Drawn or descended into, and visible as far as is known.
    Visible,
    /// Drawn or descended into, but hidden next time.
    Taken,
    /// Culled.
    Hidden,
}
