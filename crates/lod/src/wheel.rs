//! A timer wheel: nodes that wait for the eye to have travelled far enough.
//!
//! Waiting and coming up cost a few nanoseconds whatever the number of nodes, where a heap would go through the caches at each step. Ticks are
//! lengths of path; a node comes up early by at most one.

/// Slots of a level; each level's are as long as all of the one below together.
const SLOTS: u32 = 64;
const LEVELS: u32 = 5;
/// "Not waiting."
const NEVER: u32 = u32::MAX;

#[derive(Clone, Debug, Default)]
pub(crate) struct Wheel {
    now: u32,
    slots: Vec<Vec<u32>>,
    /// When each node is due. Entries that say otherwise are left over and count for nothing.
    due: Vec<u32>,
    /// Due within the tick that is now: looked at whenever the eye moves at all.
    soon: Vec<u32>,
}

impl Wheel {
    /// One past the last tick that can be reached.
    pub(crate) const END: u32 = 1 << (6 * LEVELS);

    /// Starts anew for so many nodes, none of them waiting.
    pub(crate) fn reset(&mut self, nodes: usize) {
        self.now = 0;
        self.slots.resize_with((LEVELS * SLOTS) as usize, Vec::new);
        self.slots.iter_mut().for_each(Vec::clear);
        self.soon.clear();
        self.due.clear();
        self.due.resize(nodes, NEVER);
    }

    pub(crate) fn bytes(&self) -> usize {
        let lists = self.slots.iter().map(Vec::capacity).sum::<usize>() + self.soon.capacity();
        lists * size_of::<u32>() + self.due.capacity() * size_of::<u32>()
    }

    /// The tick that has been reached.
    pub(crate) fn now(&self) -> u32 {
        self.now
    }

    /// A node no longer waits.
    pub(crate) fn forget(&mut self, node: u32) {
        self.due[node as usize] = NEVER;
    }

    /// A node waits for a tick.
    pub(crate) fn wait(&mut self, node: u32, tick: u32) {
        // What is farther than the wheel is long comes up early.
        let tick = tick.clamp(self.now, Self::END - 1);
        self.due[node as usize] = tick;
        self.put(node, tick);
    }

    fn put(&mut self, node: u32, tick: u32) {
        if tick == self.now {
            self.soon.push(node);
            return;
        }
        // The level is that of the highest digit in which the tick differs from now.
        let level = (31 - (tick ^ self.now).leading_zeros()) / 6;
        let digit = tick >> (6 * level) & (SLOTS - 1);
        self.slots[(level * SLOTS + digit) as usize].push(node);
    }

    /// Goes on to a tick and moves the nodes that are due, those due soon included, to `out`; they no longer wait.
    pub(crate) fn advance(&mut self, to: u32, out: &mut Vec<u32>) {
        self.drain_soon(out);
        while self.now < to {
            self.now += 1;
            // At the end of a level's round the next slot of the level above is dealt out.
            for level in (1..LEVELS).rev() {
                if self.now & ((1 << (6 * level)) - 1) == 0 {
                    let digit = self.now >> (6 * level) & (SLOTS - 1);
                    self.deal((level * SLOTS + digit) as usize);
                }
            }
            self.deal((self.now & (SLOTS - 1)) as usize);
            self.drain_soon(out);
        }
    }

    fn deal(&mut self, slot: usize) {
        if self.slots[slot].is_empty() {
            return;
        }
        let mut list = std::mem::take(&mut self.slots[slot]);
        for node in list.drain(..) {
            let due = self.due[node as usize];
            // Left over from an earlier wait otherwise.
            if due != NEVER && due >= self.now {
                self.put(node, due);
            }
        }
        // Nothing is put back into the slot that is being dealt out, so its list can be used again.
        self.slots[slot] = list;
    }

    fn drain_soon(&mut self, out: &mut Vec<u32>) {
        for node in self.soon.drain(..) {
            if self.due[node as usize] <= self.now {
                self.due[node as usize] = NEVER;
                out.push(node);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::Random;

    #[test]
    fn nodes_come_up_when_they_are_due_and_once() {
        let mut random = Random::new(8);
        let mut wheel = Wheel::default();
        wheel.reset(500);
        let mut expected = vec![NEVER; 500];
        let mut out = Vec::new();
        for _ in 0..3000 {
            for _ in 0..4 {
                let node = random.below(500) as u32;
                if random.unit() < 0.1 {
                    wheel.forget(node);
                    expected[node as usize] = NEVER;
                } else {
                    let tick = wheel.now() + (17.0 * random.unit()).exp2() as u32 - 1;
                    wheel.wait(node, tick);
                    expected[node as usize] = tick;
                }
            }
            let to = wheel.now() + random.below(90) as u32;
            out.clear();
            wheel.advance(to, &mut out);
            out.sort_unstable();
            let due: Vec<u32> = (0..500).filter(|&n| expected[n as usize] <= to).collect();
            assert_eq!(out, due);
            due.iter().for_each(|&n| expected[n as usize] = NEVER);
        }
    }

    #[test]
    fn what_is_beyond_the_wheel_comes_up_early() {
        let mut wheel = Wheel::default();
        wheel.reset(1);
        wheel.wait(0, u32::MAX - 1);
        let mut out = Vec::new();
        wheel.advance(100_000, &mut out);
        assert!(out.is_empty());
    }
}
