//! Least recently used nodes, without hashing or allocating: lists run through arrays indexed by node.

use crate::tree::NodeId;

const NONE: u32 = u32::MAX;

/// Nodes that are held somewhere, by last use, and how many bytes they take.
#[derive(Clone, Debug)]
pub(crate) struct Lru {
    links: Vec<Link>,
    newest: u32,
    oldest: u32,
    used: u64,
    budget: u64,
    /// Number of the current frame; what was used in it stays.
    frame: u64,
}

#[derive(Clone, Copy, Debug)]
struct Link {
    newer: u32,
    older: u32,
    bytes: u64,
    last_use: u64,
    held: bool,
}

impl Lru {
    pub fn new(nodes: usize, budget: u64) -> Self {
        let unused = Link { newer: NONE, older: NONE, bytes: 0, last_use: 0, held: false };
        Self { links: vec![unused; nodes], newest: NONE, oldest: NONE, used: 0, budget, frame: 1 }
    }

    pub fn next_frame(&mut self) {
        self.frame += 1;
    }

    pub fn used(&self) -> u64 {
        self.used
    }

    pub fn holds(&self, node: NodeId) -> bool {
        self.links[node.0 as usize].held
    }

    /// Whether it was used in this frame.
    pub fn was_touched(&self, node: NodeId) -> bool {
        let link = &self.links[node.0 as usize];
        link.held && link.last_use == self.frame
    }

    /// Notes a use.
    pub fn touch(&mut self, node: NodeId) {
        if self.newest != node.0 {
            self.unlink(node.0);
            self.link(node.0);
        }
        self.links[node.0 as usize].last_use = self.frame;
    }

    /// Makes room by giving up nodes that were not used in this frame, oldest first; each goes to `release`. False when there is
    /// not enough to give up, in which case nothing is.
    pub fn make_room(&mut self, bytes: u64, mut release: impl FnMut(NodeId)) -> bool {
        let mut free = self.budget.saturating_sub(self.used);
        let mut at = self.oldest;
        while free < bytes {
            let Some(link) = self.links.get(at as usize).filter(|l| l.last_use < self.frame) else {
                return false;
            };
            (free, at) = (free + link.bytes, link.newer);
        }
        while self.oldest != at {
            let node = NodeId(self.oldest);
            self.remove(node);
            release(node);
        }
        true
    }

    /// Adds a node, for which room was made, as used now.
    pub fn insert(&mut self, node: NodeId, bytes: u64) {
        let link = &mut self.links[node.0 as usize];
        (link.bytes, link.held, link.last_use) = (bytes, true, self.frame);
        self.used += bytes;
        self.link(node.0);
    }

    fn remove(&mut self, node: NodeId) {
        self.unlink(node.0);
        let link = &mut self.links[node.0 as usize];
        link.held = false;
        self.used -= link.bytes;
    }

    fn link(&mut self, node: u32) {
        let before = std::mem::replace(&mut self.newest, node);
        let link = &mut self.links[node as usize];
        (link.newer, link.older) = (NONE, before);
        match self.links.get_mut(before as usize) {
            Some(link) => link.newer = node,
            None => self.oldest = node,
        }
    }

    fn unlink(&mut self, node: u32) {
        let Link { newer, older, .. } = self.links[node as usize];
        match self.links.get_mut(newer as usize) {
            Some(link) => link.older = older,
            None => self.newest = older,
        }
        match self.links.get_mut(older as usize) {
            Some(link) => link.newer = newer,
            None => self.oldest = newer,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same by a plain list.
    #[test]
    fn the_least_recently_used_go_first_and_this_frame_stays() {
        let (nodes, budget) = (40, 100u64);
        let mut lru = Lru::new(nodes, budget);
        let mut list: Vec<(u32, u64, u64)> = Vec::new(); // node, bytes, frame of last use; oldest first
        let mut seed = 5u64;
        let mut frame = 1;
        for step in 0..20_000 {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let (node, bytes) = ((seed >> 40) as u32 % nodes as u32, (seed >> 20) % 30);
            if step % 7 == 0 {
                lru.next_frame();
                frame += 1;
            }
            if let Some(i) = list.iter().position(|e| e.0 == node) {
                assert!(lru.holds(NodeId(node)));
                lru.touch(NodeId(node));
                let (node, bytes, _) = list.remove(i);
                list.push((node, bytes, frame));
                continue;
            }
            assert!(!lru.holds(NodeId(node)));
            let used = |l: &[(u32, u64, u64)]| l.iter().map(|e| e.1).sum::<u64>();
            let mut after = list.clone();
            let mut gone = Vec::new();
            while used(&after) + bytes > budget && after.first().is_some_and(|e| e.2 < frame) {
                gone.push(after.remove(0).0);
            }
            let fits = used(&after) + bytes <= budget;
            let mut released = Vec::new();
            assert_eq!(lru.make_room(bytes, |n| released.push(n.0)), fits);
            if fits {
                assert_eq!(released, gone);
                lru.insert(NodeId(node), bytes);
                list = after;
                list.push((node, bytes, frame));
            } else {
                assert!(released.is_empty());
            }
            assert_eq!(lru.used(), used(&list));
        }
    }
}
