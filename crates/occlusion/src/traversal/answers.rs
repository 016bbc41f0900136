//! Answers: what they change, of this frame's queries and of earlier ones.

use super::Culler;
use crate::hierarchy::Hierarchy;
use crate::policy::{Schedule, Unknown};
use crate::state::{Entry, NONE};
use farsight_geometry::bvh::NodeId;

/// Most doublings of the time that a node is kept open.
const MOST_REOPENED: u8 = 4;

impl Culler {
    pub(super) fn may_act_on_answers(&self) -> bool {
        if self.options.schedule == Schedule::Polling {
            return !self.answered.is_empty();
        }
        let idle =
            self.heap.is_empty() && self.stack.is_empty() && self.hidden.is_empty() && self.leaves.is_empty();
        idle && self.awaited > 0 && self.at_hand == self.awaited
    }

    /// Acts on the answers at hand; `false` when there was none to act on.
    pub(super) fn act_on_answers<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H) -> bool {
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
    pub(super) fn settle_last_frame<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H) {
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
    pub(super) fn settle<H: Hierarchy + ?Sized>(&mut self, slot: u32, hierarchy: &H) {
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

    pub(super) fn found_occluded<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, node: u32, issued: u32) {
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
    pub(super) fn close_above<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, node: u32) {
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

    pub(super) fn found_visible<H: Hierarchy + ?Sized>(
        &mut self,
        hierarchy: &H,
        node: u32,
        about_opening: bool,
    ) {
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
            place: Entry::place_of(placed.key, node),
            parent,
            crosses: placed.crosses,
            unbounded: placed.unbounded,
            is_leaf,
            skip: self.options.skip_levels as u8,
            ..Entry::ROOT
        };
        let verified = self.nodes[node as usize].verified;
        self.expand(hierarchy, &entry, verified, is_leaf);
    }

    /// A node whose box is seen and nothing in it would otherwise be closed by its children and opened by its box in turn.
    pub(super) fn keep_open(&mut self, node: u32) {
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
    pub(super) fn ask_again<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, node: u32) {
        self.nodes[node as usize].hidden_streak = 0;
        let state = self.nodes[node as usize];
        if state.visited == self.frame && state.expanded != self.frame {
            self.issue(hierarchy, &[node], !self.is_bounded(), false);
        }
    }
}
