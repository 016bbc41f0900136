//! What is remembered of nodes and of queries in flight.

/// "No node", "no slot".
pub(crate) const NONE: u32 = u32::MAX;

/// History of a node in one view. Frame numbers are never 0; 0 stands for "never".
#[derive(Clone, Copy, Debug)]
pub(crate) struct NodeState {
    /// Frame of the last visit.
    pub(crate) visited: u32,
    /// Frame in which it was last drawn, or its children taken up.
    pub(crate) expanded: u32,
    /// Issue frame of the newest query that found it occluded.
    pub(crate) verified: u32,
    /// Descended into up to this frame although nothing below is seen.
    pub(crate) open_until: u32,
    /// Node above at the last visit.
    pub(crate) parent: u32,
    /// Query in flight.
    pub(crate) slot: u32,
    /// Frames in a row in which a query found it occluded, saturating.
    pub(crate) hidden_streak: u8,
    /// How often it closed and opened again in a row.
    pub(crate) reopened: u8,
    /// Visible at the last visit, as far as is known.
    pub(crate) visible: bool,
}

impl NodeState {
    pub(crate) const NEW: Self = Self {
        visited: 0,
        expanded: 0,
        verified: 0,
        open_until: 0,
        parent: NONE,
        slot: NONE,
        hidden_streak: 0,
        reopened: 0,
        visible: false,
    };
}

/// A node to visit, ordered so that the largest is the nearest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Entry {
    /// Bits of a distance that is not negative, so that they compare like it, above those of the node.
    pub(crate) place: u64,
    pub(crate) parent: u32,
    /// Issue frame of the newest query that found a box around this node occluded.
    pub(crate) verified: u32,
    /// Planes of the view volume that it may cross.
    pub(crate) crosses: u8,
    pub(crate) unbounded: bool,
    /// Without children. Told when its box is at hand: later the tree's node would have to come from memory again.
    pub(crate) is_leaf: bool,
    /// Reached from the root by assumption alone, not by an answer of this frame.
    pub(crate) assumed: bool,
    /// Levels to go down before asking.
    pub(crate) skip: u8,
}

impl Entry {
    /// What stands above the root.
    pub(crate) const ROOT: Self = Self {
        place: NONE as u64,
        parent: NONE,
        verified: 0,
        crosses: 0,
        unbounded: false,
        is_leaf: false,
        assumed: false,
        skip: 0,
    };
}

impl Entry {
    /// `place` of a node at a distance.
    pub(crate) fn place_of(distance: f32, node: u32) -> u64 {
        u64::from(distance.to_bits()) << 32 | u64::from(node)
    }

    pub(crate) fn node(&self) -> u32 {
        self.place as u32
    }
}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        other.place.cmp(&self.place)
    }
}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// A query in flight, or a place for one.
#[derive(Clone, Debug)]
pub(crate) struct Slot {
    pub(crate) serial: u32,
    pub(crate) frame: u32,
    pub(crate) must_resolve: bool,
    /// About a node that is descended into anyway: whether that should go on.
    pub(crate) about_opening: bool,
    pub(crate) in_use: bool,
    pub(crate) answer: Option<bool>,
    pub(crate) nodes: Vec<u32>,
}

/// Queries in flight; freed slots and their lists are used again.
#[derive(Clone, Debug, Default)]
pub(crate) struct Slots {
    all: Vec<Slot>,
    free: Vec<u32>,
    next_serial: u32,
    /// Most nodes of a query: room for them is made once.
    per_query: usize,
}

impl Slots {
    pub(crate) fn new(nodes_per_query: u32) -> Self {
        Self { per_query: nodes_per_query as usize, ..Self::default() }
    }

    pub(crate) fn issue(&mut self, frame: u32, must_resolve: bool, nodes: &[u32]) -> (u32, u32) {
        self.next_serial = self.next_serial.wrapping_add(1);
        let serial = self.next_serial;
        let index = self.free.pop().unwrap_or_else(|| {
            self.all.push(Slot {
                serial: 0,
                frame: 0,
                must_resolve: false,
                about_opening: false,
                in_use: false,
                answer: None,
                nodes: Vec::with_capacity(self.per_query),
            });
            self.all.len() as u32 - 1
        });
        let slot = &mut self.all[index as usize];
        (slot.serial, slot.frame, slot.must_resolve) = (serial, frame, must_resolve);
        (slot.in_use, slot.answer, slot.about_opening) = (true, None, false);
        slot.nodes.clear();
        slot.nodes.extend_from_slice(nodes);
        (index, serial)
    }

    pub(crate) fn bytes(&self) -> usize {
        let lists: usize = self.all.iter().map(|slot| slot.nodes.capacity() * size_of::<u32>()).sum();
        self.all.capacity() * size_of::<Slot>() + self.free.capacity() * size_of::<u32>() + lists
    }

    /// The query with this name, unless it is answered or forgotten.
    pub(crate) fn awaiting(&mut self, index: u32, serial: u32) -> Option<&mut Slot> {
        let slot = self.all.get_mut(index as usize)?;
        (slot.in_use && slot.serial == serial && slot.answer.is_none()).then_some(slot)
    }

    pub(crate) fn get(&self, index: u32) -> &Slot {
        &self.all[index as usize]
    }

    pub(crate) fn get_mut(&mut self, index: u32) -> &mut Slot {
        &mut self.all[index as usize]
    }

    pub(crate) fn in_use(&self, index: u32) -> bool {
        self.all.get(index as usize).is_some_and(|slot| slot.in_use)
    }

    pub(crate) fn release(&mut self, index: u32) {
        self.all[index as usize].in_use = false;
        self.free.push(index);
    }

    /// Forgets all queries; their names are never used again.
    pub(crate) fn clear(&mut self) {
        self.free.clear();
        for (index, slot) in self.all.iter_mut().enumerate() {
            slot.in_use = false;
            self.free.push(index as u32);
        }
    }
}
