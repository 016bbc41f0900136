//! The least recently used of numbered things, without hashing or allocating: lists run through arrays.

const NONE: u32 = u32::MAX;

/// Which of some numbered things are held, by last use, and how many bytes they take. What they are is the caller's.
///
/// # Cost
/// 32 bytes for each number that there may be. Everything is done in constant time, making room in the number of things given up.
///
/// # Panics
/// All methods, for a number that is not below the count given at first.
#[derive(Clone, Debug)]
pub struct Lru {
    links: Vec<Link>,
    newest: u32,
    oldest: u32,
    used: u64,
    budget: u64,
    /// Bytes of what was used in this frame.
    pinned: u64,
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
    /// Holds nothing yet, of numbers below `count`; up to `budget` bytes.
    pub fn new(count: usize, budget: u64) -> Self {
        let unused = Link { newer: NONE, older: NONE, bytes: 0, last_use: 0, held: false };
        Self { links: vec![unused; count], newest: NONE, oldest: NONE, used: 0, budget, pinned: 0, frame: 1 }
    }

    /// Begins a frame: what was used before may be given up, what is used from now on stays until the next.
    pub fn next_frame(&mut self) {
        self.frame += 1;
        self.pinned = 0;
    }

    /// Bytes that there could be room for: all but what was used in this frame.
    pub fn room(&self) -> u64 {
        self.budget.saturating_sub(self.pinned)
    }

    /// Bytes of everything that is held.
    pub fn used(&self) -> u64 {
        self.used
    }

    /// Whether it is held.
    pub fn holds(&self, number: u32) -> bool {
        self.links[number as usize].held
    }

    /// Whether it was used in this frame.
    pub fn was_touched(&self, number: u32) -> bool {
        let link = &self.links[number as usize];
        link.held && link.last_use == self.frame
    }

    /// Notes a use of what is held.
    ///
    /// # Panics
    /// When it is not held.
    pub fn touch(&mut self, number: u32) {
        assert!(self.holds(number), "{number} is touched and not held");
        if self.newest != number {
            self.unlink(number);
            self.link(number);
        }
        let link = &mut self.links[number as usize];
        if link.last_use != self.frame {
            self.pinned += link.bytes;
        }
        link.last_use = self.frame;
    }

    /// Makes room by giving up what was not used in this frame, oldest first; each goes to `release`. False when there is
    /// not enough to give up, in which case nothing is.
    #[must_use]
    pub fn make_room(&mut self, bytes: u64, mut release: impl FnMut(u32)) -> bool {
        let mut free = self.budget.saturating_sub(self.used);
        let mut at = self.oldest;
        while free < bytes {
            let Some(link) = self.links.get(at as usize).filter(|l| l.last_use < self.frame) else {
                return false;
            };
            (free, at) = (free + link.bytes, link.newer);
        }
        while self.oldest != at {
            let number = self.oldest;
            self.remove(number);
            release(number);
        }
        true
    }

    /// Adds what is not held yet, and for which room was made, as used now.
    ///
    /// # Panics
    /// When it is held already.
    pub fn insert(&mut self, number: u32, bytes: u64) {
        assert!(!self.holds(number), "{number} is inserted and held already");
        let link = &mut self.links[number as usize];
        (link.bytes, link.held, link.last_use) = (bytes, true, self.frame);
        self.used += bytes;
        self.pinned += bytes;
        self.link(number);
    }

    fn remove(&mut self, number: u32) {
        self.unlink(number);
        let link = &mut self.links[number as usize];
        link.held = false;
        self.used -= link.bytes;
    }

    fn link(&mut self, number: u32) {
        let before = std::mem::replace(&mut self.newest, number);
        let link = &mut self.links[number as usize];
        (link.newer, link.older) = (NONE, before);
        match self.links.get_mut(before as usize) {
            Some(link) => link.newer = number,
            None => self.oldest = number,
        }
    }

    fn unlink(&mut self, number: u32) {
        let Link { newer, older, .. } = self.links[number as usize];
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
                assert!(lru.holds(node));
                lru.touch(node);
                let (node, bytes, _) = list.remove(i);
                list.push((node, bytes, frame));
                continue;
            }
            assert!(!lru.holds(node));
            let used = |l: &[(u32, u64, u64)]| l.iter().map(|e| e.1).sum::<u64>();
            let mut after = list.clone();
            let mut gone = Vec::new();
            while used(&after) + bytes > budget && after.first().is_some_and(|e| e.2 < frame) {
                gone.push(after.remove(0).0);
            }
            let fits = used(&after) + bytes <= budget;
            let mut released = Vec::new();
            assert_eq!(lru.make_room(bytes, |n| released.push(n)), fits);
            if fits {
                assert_eq!(released, gone);
                lru.insert(node, bytes);
                list = after;
                list.push((node, bytes, frame));
            } else {
                assert!(released.is_empty());
            }
            assert_eq!(lru.used(), used(&list));
            let pinned: u64 = list.iter().filter(|e| e.2 == frame).map(|e| e.1).sum();
            assert_eq!(lru.room(), budget - pinned);
        }
    }
}
