//! Visits: what happens to a node when it comes off the list of open work.

use super::{Command, Culler, LOST_AFTER, SETTLED};
use crate::adaptive::Mode;
use crate::hierarchy::Hierarchy;
use crate::policy::{Algorithm, Order, Policy, Reentry, Schedule, Unknown};
use crate::state::{Entry, NONE, NodeState};
use farsight_geometry::bvh::NodeId;

impl Culler {
    pub(super) fn pop(&mut self) -> Option<Entry> {
        match self.options.order {
            Order::Distance => self.heap.pop(),
            Order::Stack => self.stack.pop(),
        }
    }

    /// Takes up a node below `above`.
    #[inline]
    pub(super) fn push<H: Hierarchy + ?Sized>(
        &mut self,
        hierarchy: &H,
        node: NodeId,
        above: &Entry,
        verified: u32,
    ) {
        let Some(view) = &self.view else { return };
        let Some(placed) = view.place(&hierarchy.bounds(node), above.crosses) else { return };
        let entry = Entry {
            place: Entry::place_of(placed.key, node.0),
            parent: above.node(),
            verified,
            crosses: placed.crosses,
            unbounded: placed.unbounded,
            is_leaf: hierarchy.child(node, 0).is_none(),
            assumed: above.assumed,
            skip: above.skip,
        };
        match self.options.order {
            Order::Distance => self.heap.push(entry),
            Order::Stack => self.stack.push(entry),
        }
    }

    pub(super) fn push_children<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, e: &Entry, verified: u32) {
        let first = self.stack.len();
        let mut index = 0;
        while let Some(child) = hierarchy.child(NodeId(e.node()), index) {
            self.push(hierarchy, child, e, verified);
            index += 1;
        }
        if self.options.order == Order::Stack {
            // The nearest comes off first: it goes last.
            self.stack[first..].sort_unstable();
        }
    }

    pub(super) fn state(&mut self, node: u32) -> &mut NodeState {
        let needed = node as usize + 1;
        if self.nodes.len() < needed {
            self.nodes.resize(needed.next_power_of_two(), NodeState::NEW);
        }
        &mut self.nodes[node as usize]
    }

    /// The baselines wait for each answer before anything else.
    pub(super) fn blocked(&self) -> bool {
        matches!(self.options.algorithm, Algorithm::Naive | Algorithm::StopAndWait) && self.awaited > 0
    }

    pub(super) fn visit<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, e: Entry) {
        self.stats.visited += 1;
        match self.options.algorithm {
            Algorithm::Coherent => self.visit_coherent(hierarchy, e),
            algorithm => {
                let frame = self.frame;
                let state = self.state(e.node());
                (state.visited, state.parent, state.visible) = (frame, e.parent, false);
                let asks = match algorithm {
                    Algorithm::FrustumOnly => false,
                    Algorithm::Naive => e.is_leaf,
                    _ => true,
                };
                if asks && !e.unbounded {
                    self.issue(hierarchy, &[e.node()], true, false);
                } else {
                    self.pull_up(e.node());
                    self.expand(hierarchy, &e, 0, e.is_leaf);
                }
            }
        }
    }

    fn visit_coherent<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, e: Entry) {
        let (frame, mode, is_leaf) = (self.frame, self.switch.mode(), e.is_leaf);
        let was_visible = self.was_visible(&e);
        let asks_again = !is_leaf && self.asks_about_opening(e.node(), was_visible);
        let bounded = match self.options.policy {
            Policy::Exact => None,
            Policy::Bounded { frames } => Some(frames),
        };
        let below = match bounded {
            Some(_) if !was_visible && !is_leaf => self.verified_below(hierarchy, e.node()),
            _ => 0,
        };
        let state = self.state(e.node());
        (state.visited, state.parent, state.visible) = (frame, e.parent, false);
        let verified = state.verified.max(e.verified).max(below);
        state.verified = verified;
        let open = state.open_until >= frame;
        if e.unbounded || mode != Mode::Culling {
            state.hidden_streak = 0;
            self.pull_up(e.node());
            self.expand(hierarchy, &e, 0, is_leaf);
            if is_leaf && mode == Mode::Probing && !e.unbounded && self.is_probed(e.node()) {
                self.ask_about_leaf(hierarchy, e.node());
            }
            return;
        }
        let recently_hidden = bounded.is_some_and(|frames| verified != 0 && frame - verified <= frames);
        if asks_again {
            self.ask_about_opening(hierarchy, e.node());
            self.take_for_visible(hierarchy, &e, false);
        } else if was_visible || (bounded.is_some() && !recently_hidden) {
            if open && !is_leaf {
                self.pull_up(e.node());
            }
            self.take_for_visible(hierarchy, &e, is_leaf);
        } else if e.skip > 0 && !is_leaf {
            self.ask_about_opening(hierarchy, e.node());
            self.expand(hierarchy, &Entry { skip: e.skip - 1, ..e }, verified, false);
        } else {
            self.take_for_hidden(hierarchy, e.node(), bounded.is_some());
        }
    }

    /// Whether an inner node is asked about although it is descended into in this frame: when the time runs out for which
    /// it was kept open, and after a first frame, whose answers were against a nearly empty depth buffer. The answer
    /// changes the next frame only.
    pub(super) fn asks_about_opening(&self, node: u32, was_visible: bool) -> bool {
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
    pub(super) fn verified_below<H: Hierarchy + ?Sized>(&self, hierarchy: &H, node: u32) -> u32 {
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

    pub(super) fn ask_about_opening<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, node: u32) {
        let slot = self.issue(hierarchy, &[node], false, false);
        self.slots.get_mut(slot).about_opening = true;
        self.stats.retests += 1;
        self.deferred.push(slot);
    }

    pub(super) fn was_visible(&mut self, e: &Entry) -> bool {
        let (frame, unknown, reentry) = (self.frame, self.options.unknown, self.options.reentry);
        let state = self.state(e.node());
        let last_frame = state.visited == frame - 1;
        let remembered = match (state.visited, unknown, reentry) {
            (0, Unknown::Draw, _) => true,
            (0, Unknown::Ask, _) | (_, _, Reentry::Ask) => false,
            (_, _, Reentry::Remember) => state.visible,
        };
        // What was hidden and comes to light has no memory worth trusting: its memory is from before it was hidden.
        state.open_until >= frame || (last_frame && state.visible) || (!last_frame && e.assumed && remembered)
    }

    pub(super) fn take_for_visible<H: Hierarchy + ?Sized>(
        &mut self,
        hierarchy: &H,
        e: &Entry,
        is_leaf: bool,
    ) {
        let (frame, every) = (self.frame, self.options.query_leaves_every);
        let state = &mut self.nodes[e.node() as usize];
        state.hidden_streak = 0;
        if !is_leaf {
            let verified = state.verified;
            self.expand(hierarchy, e, verified, false);
            return;
        }
        // Hashed, so that neighbours do not all come at once.
        let turn = every <= 1 || (hash(e.node()).wrapping_add(frame)).is_multiple_of(every);
        let slot = state.slot;
        let in_flight = slot != NONE && self.slots.in_use(slot);
        if in_flight && frame - self.slots.get(slot).frame > LOST_AFTER {
            self.slots.release(slot);
            self.nodes[e.node() as usize].slot = NONE;
        }
        if !turn || in_flight {
            self.stats.assumed += 1;
            self.pull_up(e.node());
            self.expand(hierarchy, e, 0, true);
        } else if self.options.query_with_geometry {
            let must_resolve = !self.options.defer && !self.is_bounded();
            let asked = self.issue(hierarchy, &[e.node()], must_resolve, true);
            let state = &mut self.nodes[e.node() as usize];
            state.expanded = frame;
            self.deferred.push(asked);
            self.stats.rendered += 1;
            self.rendered.push(NodeId(e.node()));
        } else if self.options.schedule == Schedule::Waves {
            self.expand(hierarchy, e, 0, true);
            self.leaves.push(e.node());
        } else {
            self.ask_about_leaf(hierarchy, e.node());
            self.expand(hierarchy, e, 0, true);
        }
    }

    pub(super) fn take_for_hidden<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, node: u32, bounded: bool) {
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

    pub(super) fn is_probed(&self, node: u32) -> bool {
        let one_in = self.options.adaptive.map_or(1, |a| a.probe_one_in);
        self.switch.asks() && hash(node.wrapping_add(self.frame)).is_multiple_of(one_in)
    }

    /// Draws a leaf or takes up the children of an inner node.
    pub(super) fn expand<H: Hierarchy + ?Sized>(
        &mut self,
        hierarchy: &H,
        e: &Entry,
        verified: u32,
        is_leaf: bool,
    ) {
        let frame = self.frame;
        let state = &mut self.nodes[e.node() as usize];
        if state.expanded == frame {
            return;
        }
        state.expanded = frame;
        if is_leaf {
            self.stats.rendered += 1;
            self.rendered.push(NodeId(e.node()));
            self.out.push_back(Command::Render(NodeId(e.node())));
        } else {
            self.push_children(hierarchy, e, verified);
        }
    }

    /// Marks a node and what is above as visible. Ends at the first that is marked, or past the root.
    pub(super) fn pull_up(&mut self, mut node: u32) {
        while let Some(state) = self.nodes.get_mut(node as usize)
            && !state.visible
        {
            state.visible = true;
            node = state.parent;
        }
    }
}

/// Spreads ids (the finaliser of splitmix32).
fn hash(x: u32) -> u32 {
    let x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    let x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}
