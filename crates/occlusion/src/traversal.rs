//! The state machine.

use crate::adaptive::{Mode, Switch, Yield};
use crate::hierarchy::Hierarchy;
use crate::policy::{Algorithm, Backend, Options, OptionsError, Order, Policy, Reentry, Schedule, Unknown};
use crate::state::{Entry, NONE, NodeState, Slots};
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
    /// Open work, for [`Order::Distance`] and [`Order::Stack`].
    heap: BinaryHeap<Entry>,
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
/// Most doublings of the time that a node is kept open.
const MOST_REOPENED: u8 = 4;

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

    // --- Open work ---

    fn pop(&mut self) -> Option<Entry> {
        match self.options.order {
            Order::Distance => self.heap.pop(),
            Order::Stack => self.stack.pop(),
        }
    }

    /// Takes up a node below `above`.
    #[inline]
    fn push<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, node: NodeId, above: &Entry, verified: u32) {
        let Some(view) = &self.view else { return };
        let Some(placed) = view.place(&hierarchy.bounds(node), above.crosses) else { return };
        let entry = Entry {
            key: placed.key.to_bits(),
            node: node.0,
            parent: above.node,
            verified,
            crosses: placed.crosses,
            unbounded: placed.unbounded,
            assumed: above.assumed,
            skip: above.skip,
        };
        match self.options.order {
            Order::Distance => self.heap.push(entry),
            Order::Stack => self.stack.push(entry),
        }
    }

    fn push_children<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, e: &Entry, verified: u32) {
        let first = self.stack.len();
        let mut index = 0;
        while let Some(child) = hierarchy.child(NodeId(e.node), index) {
            self.push(hierarchy, child, e, verified);
            index += 1;
        }
        if self.options.order == Order::Stack {
            // The nearest comes off first: it goes last.
            self.stack[first..].sort_unstable();
        }
    }

    fn state(&mut self, node: u32) -> &mut NodeState {
        let needed = node as usize + 1;
        if self.nodes.len() < needed {
            self.nodes.resize(needed.next_power_of_two(), NodeState::NEW);
        }
        &mut self.nodes[node as usize]
    }

    // --- Visits ---

    /// The baselines wait for each answer before anything else.
    fn blocked(&self) -> bool {
        matches!(self.options.algorithm, Algorithm::Naive | Algorithm::StopAndWait) && self.awaited > 0
    }

    fn visit<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, e: Entry) {
        self.stats.visited += 1;
        let is_leaf = hierarchy.child(NodeId(e.node), 0).is_none();
        match self.options.algorithm {
            Algorithm::Coherent => self.visit_coherent(hierarchy, e, is_leaf),
            algorithm => {
                let frame = self.frame;
                let state = self.state(e.node);
                (state.visited, state.parent, state.visible) = (frame, e.parent, false);
                let asks = match algorithm {
                    Algorithm::FrustumOnly => false,
                    Algorithm::Naive => is_leaf,
                    _ => true,
                };
                if asks && !e.unbounded {
                    self.issue(hierarchy, &[e.node], true, false);
                } else {
                    self.pull_up(e.node);
                    self.expand(hierarchy, &e, 0, is_leaf);
                }
            }
        }
    }

    fn visit_coherent<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, e: Entry, is_leaf: bool) {
        let (frame, mode) = (self.frame, self.switch.mode());
        let was_visible = self.was_visible(&e);
        let asks_again = !is_leaf && self.asks_about_opening(e.node, was_visible);
        let bounded = match self.options.policy {
            Policy::Exact => None,
            Policy::Bounded { frames } => Some(frames),
        };
        let below = match bounded {
            Some(_) if !was_visible && !is_leaf => self.verified_below(hierarchy, e.node),
            _ => 0,
        };
        let state = self.state(e.node);
        (state.visited, state.parent, state.visible) = (frame, e.parent, false);
        let verified = state.verified.max(e.verified).max(below);
        state.verified = verified;
        let open = state.open_until >= frame;
        if e.unbounded || mode != Mode::Culling {
            state.hidden_streak = 0;
            self.pull_up(e.node);
            self.expand(hierarchy, &e, 0, is_leaf);
            if is_leaf && mode == Mode::Probing && !e.unbounded && self.is_probed(e.node) {
                self.ask_about_leaf(hierarchy, e.node);
            }
            return;
        }
        let recently_hidden = bounded.is_some_and(|frames| verified != 0 && frame - verified <= frames);
        if asks_again {
            self.ask_about_opening(hierarchy, e.node);
            self.take_for_visible(hierarchy, &e, false);
        } else if was_visible || (bounded.is_some() && !recently_hidden) {
            if open && !is_leaf {
                self.pull_up(e.node);
            }
            self.take_for_visible(hierarchy, &e, is_leaf);
        } else if e.skip > 0 && !is_leaf {
            self.ask_about_opening(hierarchy, e.node);
            self.expand(hierarchy, &Entry { skip: e.skip - 1, ..e }, verified, false);
        } else {
            self.take_for_hidden(hierarchy, e.node, bounded.is_some());
        }
    }

    /// Whether an inner node is asked about although it is descended into in this frame: when the time runs out for which
    /// it was kept open, and after a first frame, whose answers were against a nearly empty depth buffer. The answer
    /// changes the next frame only.
    fn asks_about_opening(&self, node: u32, was_visible: bool) -> bool {
        if self.options.keep_open_frames == 0 || self.switch.mode() != Mode::Culling {
            return false;
        }
        let state = &self.nodes[node as usize];
        let expanded = state.expanded == self.frame - 1;
        let runs_out = !was_visible && state.open_until != 0;
        let second = self.frame == self.first_frame + 1 && self.options.unknown == Unknown::Ask;
        let in_flight = state.slot != NONE && self.slots.in_use(state.slot);
        expanded && (runs_out || (second && was_visible)) && !in_flight
    }

    /// The frame since which everything below a node has been found occluded, child by child; 0 when that is not known. So a
    /// node whose children are all hidden is hidden as a whole, without an answer of its own.
    fn verified_below<H: Hierarchy + ?Sized>(&self, hierarchy: &H, node: u32) -> u32 {
        let (mut least, mut index) = (u32::MAX, 0);
        while let Some(child) = hierarchy.child(NodeId(node), index) {
            match self.nodes.get(child.0 as usize) {
                Some(state) if state.visited == self.frame - 1 => least = least.min(state.verified),
                _ => return 0,
            }
            index += 1;
        }
        least
    }

    fn ask_about_opening<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, node: u32) {
        let slot = self.issue(hierarchy, &[node], false, false);
        self.slots.get_mut(slot).about_opening = true;
        self.stats.retests += 1;
        self.deferred.push(slot);
    }

    fn was_visible(&mut self, e: &Entry) -> bool {
        let (frame, unknown, reentry) = (self.frame, self.options.unknown, self.options.reentry);
        let state = self.state(e.node);
        let last_frame = state.visited == frame - 1;
        let remembered = match (state.visited, unknown, reentry) {
            (0, Unknown::Draw, _) => true,
            (0, Unknown::Ask, _) | (_, _, Reentry::Ask) => false,
            (_, _, Reentry::Remember) => state.visible,
        };
        // What was hidden and comes to light has no memory worth trusting: its memory is from before it was hidden.
        state.open_until >= frame || (last_frame && state.visible) || (!last_frame && e.assumed && remembered)
    }

    fn take_for_visible<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, e: &Entry, is_leaf: bool) {
        let (frame, every) = (self.frame, self.options.query_leaves_every);
        let state = &mut self.nodes[e.node as usize];
        state.hidden_streak = 0;
        if !is_leaf {
            let verified = state.verified;
            self.expand(hierarchy, e, verified, false);
            return;
        }
        // Hashed, so that neighbours do not all come at once.
        let turn = every <= 1 || (hash(e.node).wrapping_add(frame)).is_multiple_of(every);
        let slot = state.slot;
        let in_flight = slot != NONE && self.slots.in_use(slot);
        if in_flight && frame - self.slots.get(slot).frame > LOST_AFTER {
            self.slots.release(slot);
            self.nodes[e.node as usize].slot = NONE;
        }
        if !turn || in_flight {
            self.stats.assumed += 1;
            self.pull_up(e.node);
            self.expand(hierarchy, e, 0, true);
        } else if self.options.query_with_geometry {
            let must_resolve = !self.options.defer && !self.is_bounded();
            let asked = self.issue(hierarchy, &[e.node], must_resolve, true);
            let state = &mut self.nodes[e.node as usize];
            state.expanded = frame;
            self.deferred.push(asked);
            self.stats.rendered += 1;
            self.rendered.push(NodeId(e.node));
        } else if self.options.schedule == Schedule::Waves {
            self.expand(hierarchy, e, 0, true);
            self.leaves.push(e.node);
        } else {
            self.ask_about_leaf(hierarchy, e.node);
            self.expand(hierarchy, e, 0, true);
        }
    }

    fn take_for_hidden<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, node: u32, bounded: bool) {
        let state = self.nodes[node as usize];
        if bounded && state.slot != NONE && self.slots.in_use(state.slot) {
            if self.frame - self.slots.get(state.slot).frame <= LOST_AFTER {
                return;
            }
            self.slots.release(state.slot);
        }
        let shares = self.options.nodes_per_query > 1 && state.hidden_streak >= SETTLED;
        if shares || self.options.schedule == Schedule::Waves {
            self.hidden.push(node);
            if self.options.schedule == Schedule::Polling
                && self.hidden.len() >= self.options.nodes_per_query as usize
            {
                self.issue_hidden(hierarchy);
            }
        } else {
            self.issue(hierarchy, &[node], !bounded, false);
        }
    }

    fn is_probed(&self, node: u32) -> bool {
        let one_in = self.options.adaptive.map_or(1, |a| a.probe_one_in);
        self.switch.asks() && hash(node.wrapping_add(self.frame)).is_multiple_of(one_in)
    }

    /// Draws a leaf or takes up the children of an inner node.
    fn expand<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, e: &Entry, verified: u32, is_leaf: bool) {
        let frame = self.frame;
        let state = &mut self.nodes[e.node as usize];
        if state.expanded == frame {
            return;
        }
        state.expanded = frame;
        if is_leaf {
            self.stats.rendered += 1;
            self.rendered.push(NodeId(e.node));
            self.out.push_back(Command::Render(NodeId(e.node)));
        } else {
            self.push_children(hierarchy, e, verified);
        }
    }

    /// Marks a node and what is above as visible. Ends at the first that is marked, or past the root.
    fn pull_up(&mut self, mut node: u32) {
        while let Some(state) = self.nodes.get_mut(node as usize)
            && !state.visible
        {
            state.visible = true;
            node = state.parent;
        }
    }

    // --- Queries ---

    fn issue<H: Hierarchy + ?Sized>(
        &mut self,
        hierarchy: &H,
        nodes: &[u32],
        must_resolve: bool,
        geometry: bool,
    ) -> u32 {
        let (slot, serial) = self.slots.issue(self.frame, must_resolve, nodes);
        for &node in nodes {
            self.nodes[node as usize].slot = slot;
        }
        let view = self.view.expect("a frame has begun");
        let proxy_of = |node: u32| view.proxy(&hierarchy.bounds(NodeId(node)), self.options.inflate_px);
        let proxy = match nodes {
            _ if geometry => Proxy::Geometry,
            [node] => Proxy::Box(proxy_of(*node)),
            _ => {
                self.boxes.clear();
                self.boxes.extend(nodes.iter().map(|&n| proxy_of(n)));
                Proxy::Boxes
            }
        };
        self.stats.queries += 1;
        self.stats.must_resolve += u64::from(must_resolve);
        self.stats.shared += u64::from(nodes.len() > 1);
        self.awaited += u32::from(must_resolve);
        self.issued_since_flush = true;
        let id = QueryId { slot, serial };
        self.out.push_back(Command::Query { id, node: NodeId(nodes[0]), proxy, must_resolve });
        slot
    }

    fn ask_about_leaf<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, node: u32) {
        let culling = self.switch.mode() == Mode::Culling;
        let slot =
            self.issue(hierarchy, &[node], culling && !self.options.defer && !self.is_bounded(), false);
        self.deferred.push(slot);
    }

    fn is_bounded(&self) -> bool {
        self.options.policy != Policy::Exact
    }

    /// Issues queries that waited for the end of the wave. One shared query at a time, as its boxes are handed out with it.
    fn issue_waiting<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H) -> bool {
        if !self.hidden.is_empty() {
            self.issue_hidden(hierarchy);
            return true;
        }
        let any = !self.leaves.is_empty();
        let mut leaves = std::mem::take(&mut self.leaves);
        for node in leaves.drain(..) {
            self.ask_about_leaf(hierarchy, node);
        }
        self.leaves = leaves;
        any
    }

    /// One query for the last of the hidden nodes, and for others that are as settled.
    fn issue_hidden<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H) {
        let most = self.options.nodes_per_query as usize;
        let settled = |s: &Self, node: u32| s.nodes[node as usize].hidden_streak >= SETTLED;
        let mut group = std::mem::take(&mut self.scratch);
        group.clear();
        while let Some(&node) = self.hidden.last() {
            let fits = group.is_empty() || (settled(self, node) && settled(self, group[0]));
            if group.len() >= most || !fits {
                break;
            }
            group.push(node);
            self.hidden.pop();
        }
        self.issue(hierarchy, &group, !self.is_bounded(), false);
        self.scratch = group;
    }

    // --- Answers ---

    fn may_act_on_answers(&self) -> bool {
        if self.options.schedule == Schedule::Polling {
            return !self.answered.is_empty();
        }
        let idle =
            self.heap.is_empty() && self.stack.is_empty() && self.hidden.is_empty() && self.leaves.is_empty();
        idle && self.awaited > 0 && self.at_hand == self.awaited
    }

    /// Acts on the answers at hand; `false` when there was none to act on.
    fn act_on_answers<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H) -> bool {
        let mut answered = std::mem::take(&mut self.answered);
        if self.options.schedule == Schedule::Waves {
            // The order of arrival must not matter, nor whether answers that could wait have come.
            answered.sort_unstable_by_key(|&slot| self.slots.get(slot).serial);
        }
        let mut kept = 0;
        for i in 0..answered.len() {
            let slot = answered[i];
            let waits = self.options.schedule == Schedule::Waves && !self.slots.get(slot).must_resolve;
            if waits {
                answered[kept] = slot;
                kept += 1;
            } else {
                self.settle(slot, hierarchy);
            }
        }
        let any = kept < answered.len();
        answered.truncate(kept);
        debug_assert!(self.answered.is_empty());
        self.answered = answered;
        any
    }

    /// Makes last frame's open ends part of the history.
    fn settle_last_frame<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H) {
        let mut answered = std::mem::take(&mut self.answered);
        answered.sort_unstable_by_key(|&slot| self.slots.get(slot).serial);
        for slot in answered.drain(..) {
            self.settle(slot, hierarchy);
        }
        self.answered = answered;
        let mut deferred = std::mem::take(&mut self.deferred);
        for slot in deferred.drain(..) {
            // Without an answer the node stays visible.
            if self.slots.in_use(slot) && self.slots.get(slot).frame == self.frame - 1 {
                let node = self.slots.get(slot).nodes[0];
                if self.nodes[node as usize].slot == slot {
                    self.pull_up(node);
                }
            }
        }
        self.deferred = deferred;
    }

    /// Acts on an answer, of this frame or an earlier one.
    fn settle<H: Hierarchy + ?Sized>(&mut self, slot: u32, hierarchy: &H) {
        let s = self.slots.get(slot);
        let Some(visible) = s.answer.filter(|_| s.in_use) else { return };
        let (issued, must_resolve, shared, about_opening) =
            (s.frame, s.must_resolve, s.nodes.len() > 1, s.about_opening);
        self.stats.answers += 1;
        self.stats.occluded += u64::from(!visible);
        self.gained.answers += 1;
        self.gained.occluded += u64::from(!visible);
        if must_resolve && issued == self.frame {
            self.awaited -= 1;
            self.at_hand -= 1;
        }
        for i in 0..self.slots.get(slot).nodes.len() {
            let node = self.slots.get(slot).nodes[i];
            // A newer query has taken the place of this one.
            if self.nodes[node as usize].slot != slot {
                continue;
            }
            self.nodes[node as usize].slot = NONE;
            match (visible, shared) {
                (false, _) => self.found_occluded(hierarchy, node, issued),
                (true, false) => self.found_visible(hierarchy, node, about_opening),
                (true, true) => self.ask_again(hierarchy, node),
            }
        }
        self.slots.release(slot);
    }

    fn found_occluded<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, node: u32, issued: u32) {
        let frame = self.frame;
        let state = &mut self.nodes[node as usize];
        state.verified = state.verified.max(issued);
        state.hidden_streak = state.hidden_streak.saturating_add(1);
        // Visible at a later visit was an assumption, which had been handed up.
        let handed_up = state.visible && state.visited != frame;
        state.visible = false;
        state.open_until = 0;
        if handed_up {
            self.close_above(hierarchy, node);
        }
    }

    /// Takes back what was handed up from a node: nodes above with no other visible child.
    fn close_above<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, node: u32) {
        let last = self.frame - 1;
        let mut above = self.nodes[node as usize].parent;
        while let Some(state) = self.nodes.get(above as usize)
            && state.visible
            && state.open_until < self.frame
        {
            let mut index = 0;
            while let Some(child) = hierarchy.child(NodeId(above), index) {
                let sees = self.nodes.get(child.0 as usize).is_some_and(|c| c.visible && c.visited == last);
                if sees {
                    return;
                }
                index += 1;
            }
            let state = &mut self.nodes[above as usize];
            state.visible = false;
            above = state.parent;
        }
    }

    fn found_visible<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, node: u32, about_opening: bool) {
        let frame = self.frame;
        let state = &mut self.nodes[node as usize];
        state.hidden_streak = 0;
        let parent = state.parent;
        self.pull_up(node);
        if about_opening {
            self.keep_open(node);
        }
        let state = &self.nodes[node as usize];
        if state.expanded == frame || state.visited != frame {
            return;
        }
        self.stats.discoveries += 1;
        let id = NodeId(node);
        let is_leaf = hierarchy.child(id, 0).is_none();
        let settled = frame != self.first_frame || self.options.unknown == Unknown::Draw;
        if settled && (!is_leaf || self.options.query_with_geometry) {
            self.keep_open(node);
        }
        let Some(view) = self.view else { return };
        let Some(placed) = view.place(&hierarchy.bounds(id), view.all_planes()) else { return };
        let entry = Entry {
            node,
            parent,
            crosses: placed.crosses,
            unbounded: placed.unbounded,
            skip: self.options.skip_levels as u8,
            ..Entry::ROOT
        };
        let verified = self.nodes[node as usize].verified;
        self.expand(hierarchy, &entry, verified, is_leaf);
    }

    /// A node whose box is seen and nothing in it would otherwise be closed by its children and opened by its box in turn.
    fn keep_open(&mut self, node: u32) {
        let (frame, frames) = (self.frame, self.options.keep_open_frames);
        if frames == 0 {
            return;
        }
        let state = &mut self.nodes[node as usize];
        let again = state.open_until != 0;
        state.reopened = if again { (state.reopened + 1).min(MOST_REOPENED) } else { 0 };
        state.open_until = frame + (frames << state.reopened);
    }

    /// A node of a query that saw something: which of them it was, each has to say for itself.
    fn ask_again<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, node: u32) {
        self.nodes[node as usize].hidden_streak = 0;
        let state = self.nodes[node as usize];
        if state.visited == self.frame && state.expanded != self.frame {
            self.issue(hierarchy, &[node], !self.is_bounded(), false);
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

/// Spreads ids (the finaliser of splitmix32).
fn hash(x: u32) -> u32 {
    let x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    let x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}
