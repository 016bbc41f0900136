//! The octree in one pass over sorted points: who represents which cell, and which node stores whom.
//!
//! A cell shows one of its own points: the one whose colour is nearest to the mean colour of *all* points below. A point's
//! **level** is the first one at which it represents a cell; so the points of levels up to L are one per occupied cell
//! of level L, and no cell is doubled anywhere. Equal positions are told apart on one level of their own below the
//! deepest.
//!
//! **Nodes** of the outer octree share the points out: level L belongs to the node of outer level max(0, L − D) above it.
//! A node with few points and nothing stored below joins its parent.

use crate::record::{Item, Record, unpack};

/// What does not change while a tree is assembled.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    /// Bits of a coordinate: the deepest level that can tell positions apart.
    pub bits: u32,
    /// Deepest level wanted, at most `bits`; what it does not separate lies one level below.
    pub deepest: u32,
    /// Levels that the root holds below level 0 (D); beyond `deepest` for a single tree.
    pub inner: u32,
    /// Nodes with fewer points join their parent.
    pub merge: usize,
}

impl Shape {
    /// The first level that separates points whose smallest common cell has this height.
    #[inline]
    pub fn division(&self, height: u32) -> u32 {
        (self.bits + 1 - height).min(self.deepest + 1)
    }

    /// Number of levels, the one for equal positions included.
    pub fn levels(&self) -> usize {
        self.deepest as usize + 2
    }

    /// First level that a node of an outer level stores.
    #[inline]
    pub fn first(&self, outer: usize) -> usize {
        if outer == 0 { 0 } else { outer + self.inner as usize }
    }
}

/// A representative and what it stands for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Member<T> {
    pub item: T,
    /// Sums of red, green, blue over all points below.
    pub sums: [u64; 3],
    /// Number of points below.
    pub count: u64,
}

impl<T: Item> Member<T> {
    #[inline]
    fn one(item: T) -> Self {
        Self { item, sums: unpack(item.rgb()).map(u64::from), count: 1 }
    }

    /// Distance of the item's colour from a mean, up to terms equal for all items and a positive factor: `n·|c|² − 2·S·c`.
    #[inline]
    fn distance(item: T, sums: &[u64; 3], count: u64) -> i64 {
        let c = unpack(item.rgb());
        (0..3).map(|k| i64::from(c[k]) * (count as i64 * i64::from(c[k]) - 2 * sums[k] as i64)).sum()
    }
}

/// Cells of one level below a common parent, still being collected.
#[derive(Clone, Copy, Debug)]
struct Group<T> {
    level: u32,
    len: usize,
    members: [Member<T>; 8],
}

/// Takes finished nodes.
pub(crate) trait Sink<T> {
    /// A node of an outer level; `lists[i]` are its points of level `first + i`, each in Morton order.
    fn store(&mut self, outer: usize, first: usize, lists: &[Vec<T>]);
}

/// Points of one level on their way to a node that is still open.
#[derive(Debug)]
pub(crate) struct OpenList<T> {
    pub outer: usize,
    pub level: usize,
    pub points: Vec<T>,
}

/// Builds the tree from items in Morton order.
#[derive(Debug)]
pub(crate) struct Assembler<T> {
    shape: Shape,
    /// A stack: the first `depth` are in use.
    groups: Vec<Group<T>>,
    depth: usize,
    current: Option<Member<T>>,
    /// `lists[k][i]`: points of level `first(k) + i` of the open node of outer level k.
    lists: Vec<Vec<Vec<T>>>,
    counts: Vec<usize>,
    /// Whether the open node of an outer level has a stored node below.
    stored_below: Vec<bool>,
    /// One more than the deepest outer level with anything in it.
    open: usize,
}

impl<T: Item> Assembler<T> {
    pub fn new(shape: Shape) -> Self {
        let outer = (shape.levels() - 1).saturating_sub(shape.inner as usize) + 1;
        Self {
            shape,
            groups: Vec::with_capacity(shape.levels()),
            depth: 0,
            current: None,
            lists: (0..outer).map(|k| empty_lists(shape.levels() - shape.first(k))).collect(),
            counts: vec![0; outer],
            stored_below: vec![false; outer],
            open: 0,
        }
    }

    /// The next points, which are one cell of the deepest level; `division` is the level that separates them from those
    /// before.
    #[inline]
    pub fn push(&mut self, division: u32, run: &[T], sink: &mut impl Sink<T>) {
        self.leave(division, sink);
        let member = if let [item] = run { Member::one(*item) } else { self.condense(run) };
        self.current = Some(member);
    }

    /// A cell that was assembled elsewhere.
    #[inline]
    pub fn push_member(&mut self, division: u32, member: Member<T>, sink: &mut impl Sink<T>) {
        self.leave(division, sink);
        self.current = Some(member);
    }

    /// Finishes the cells of a level and below that hold what came last: nothing more comes into them.
    #[inline]
    fn leave(&mut self, division: u32, sink: &mut impl Sink<T>) {
        self.close_groups(division);
        if let Some(current) = self.current.take() {
            self.join_group(division, current);
        }
        self.close_nodes(division as usize, sink);
    }

    #[inline]
    fn join_group(&mut self, level: u32, member: Member<T>) {
        if let Some(top) = self.groups[..self.depth].last_mut().filter(|top| top.level == level) {
            top.members[top.len] = member;
            top.len += 1;
            return;
        }
        match self.groups.get_mut(self.depth) {
            Some(unused) => (unused.level, unused.len, unused.members[0]) = (level, 1, member),
            None => self.groups.push(Group { level, len: 1, members: [member; 8] }),
        }
        self.depth += 1;
    }

    /// One representative for points of one cell; the others go to the level below the deepest.
    fn condense(&mut self, run: &[T]) -> Member<T> {
        let mut sums = [0; 3];
        for item in run {
            let c = unpack(item.rgb());
            (0..3).for_each(|k| sums[k] += u64::from(c[k]));
        }
        let count = run.len() as u64;
        let best = (0..run.len()).min_by_key(|&i| Member::distance(run[i], &sums, count)).unwrap_or(0);
        let level = self.shape.deepest + 1;
        if run.len() > 1024 {
            // Exactly as much as is needed: there may be millions.
            let outer = (level as usize).saturating_sub(self.shape.inner as usize);
            let place = level as usize - self.shape.first(outer);
            self.lists[outer][place].reserve_exact(run.len() - 1);
        }
        for (i, item) in run.iter().enumerate() {
            if i != best {
                self.emit(level, *item);
            }
        }
        Member { item: run[best], sums, count }
    }

    /// Closes groups below the level that separates what comes next.
    #[inline]
    fn close_groups(&mut self, division: u32) {
        while self.depth > 0 && self.groups[self.depth - 1].level > division {
            self.close_group();
        }
    }

    /// Lets one of a group and the current item represent all; the others keep the group's level.
    #[inline]
    fn close_group(&mut self) {
        let Some(current) = self.current else { return };
        self.depth -= 1;
        let group = &mut self.groups[self.depth];
        group.members[group.len] = current;
        let (level, len) = (group.level, group.len + 1);
        let mut sums = [0; 3];
        let mut count = 0;
        for m in &group.members[..len] {
            (0..3).for_each(|k| sums[k] += m.sums[k]);
            count += m.count;
        }
        let (mut best, mut least) = (0, i64::MAX);
        for (i, m) in group.members[..len].iter().enumerate() {
            let distance = Member::distance(m.item, &sums, count);
            if distance < least {
                (best, least) = (i, distance);
            }
        }
        for i in 0..len {
            let item = self.groups[self.depth].members[i].item;
            if i == best {
                self.current = Some(Member { item, sums, count });
            } else {
                self.emit(level, item);
            }
        }
    }

    /// Gives a point to the node that stores its level.
    #[inline]
    pub fn emit(&mut self, level: u32, item: T) {
        let level = level as usize;
        let outer = level.saturating_sub(self.shape.inner as usize);
        let list = &mut self.lists[outer][if outer == 0 { level } else { 0 }];
        if list.len() == list.capacity() {
            grow(list, 1);
        }
        list.push(item);
        self.counts[outer] += 1;
        self.open = self.open.max(outer + 1);
    }

    /// Gives points that were assembled elsewhere to an open node.
    pub fn append<U: Copy>(&mut self, list: &OpenList<U>, convert: impl Fn(&U) -> T) {
        let place = list.level - self.shape.first(list.outer);
        let into = &mut self.lists[list.outer][place];
        if into.capacity() - into.len() < list.points.len() {
            grow(into, list.points.len());
        }
        into.extend(list.points.iter().map(convert));
        self.counts[list.outer] += list.points.len();
        self.open = self.open.max(list.outer + 1);
    }

    /// Notes that a node was stored right below an outer level.
    pub fn note_stored_below(&mut self, outer: usize) {
        self.stored_below[outer] = true;
        self.open = self.open.max(outer + 1);
    }

    /// Memory of the lists.
    pub fn bytes(&self) -> u64 {
        let items: usize = self.lists.iter().flatten().map(Vec::capacity).sum();
        (items * size_of::<T>()) as u64
    }

    /// Closes nodes from the deepest up to an outer level.
    #[inline]
    pub fn close_nodes(&mut self, from: usize, sink: &mut impl Sink<T>) {
        while self.open > from {
            self.open -= 1;
            self.close_node(self.open, sink);
        }
    }

    fn close_node(&mut self, k: usize, sink: &mut impl Sink<T>) {
        let count = std::mem::take(&mut self.counts[k]);
        let below = std::mem::take(&mut self.stored_below[k]);
        if count == 0 {
            if below && k > 0 {
                self.note_stored_below(k - 1);
                self.open = k;
            }
            return;
        }
        let first = self.shape.first(k);
        if k > 0 && count < self.shape.merge && !below {
            let (upper, lower) = self.lists.split_at_mut(k);
            let shift = first - self.shape.first(k - 1);
            for (i, list) in lower[0].iter_mut().enumerate().filter(|(_, l)| !l.is_empty()) {
                upper[k - 1][i + shift].append(list);
            }
            self.counts[k - 1] += count;
            self.open = k;
            return;
        }
        sink.store(k, first, &self.lists[k]);
        self.lists[k].iter_mut().for_each(Vec::clear);
        if k > 0 {
            self.stored_below[k - 1] = true;
            self.open = k;
        }
    }

    /// Closes all groups; what is left represents everything. `None` when nothing was pushed.
    pub fn representative(&mut self) -> Option<Member<T>> {
        while self.depth > 0 {
            self.close_group();
        }
        self.current.take()
    }

    /// Empties the open nodes above an outer level, and says whether a node was stored right below them.
    pub fn take_open<U>(
        &mut self,
        below: usize,
        mut convert: impl FnMut(&T) -> U,
    ) -> (Vec<OpenList<U>>, bool) {
        let mut open = Vec::new();
        for (outer, lists) in self.lists.iter_mut().enumerate().take(below) {
            let first = self.shape.first(outer);
            for (i, list) in lists.iter_mut().enumerate().filter(|(_, l)| !l.is_empty()) {
                open.push(OpenList {
                    outer,
                    level: first + i,
                    points: list.iter().map(&mut convert).collect(),
                });
                list.clear();
            }
            self.counts[outer] = 0;
        }
        let stored = below > 0 && self.stored_below.get_mut(below - 1).is_some_and(std::mem::take);
        self.open = 0;
        (open, stored)
    }

    /// Points of each level in the root so far.
    pub fn root(&self) -> &[Vec<T>] {
        &self.lists[0]
    }

    /// The root's points by level, for a tree that has no other node.
    pub fn take_root(mut self) -> Vec<Vec<T>> {
        std::mem::take(&mut self.lists[0])
    }
}

/// Pushes sorted records of a cell.
pub(crate) fn push_sorted<const W: usize, R: Record<W>>(
    assembler: &mut Assembler<R>,
    shape: Shape,
    records: &[R],
    cell_level: u32,
    sink: &mut impl Sink<R>,
) {
    let mut division = cell_level;
    let mut start = 0;
    while start < records.len() {
        let (mut end, mut next) = (start + 1, cell_level);
        while end < records.len() {
            next = shape.division(records[end - 1].height(&records[end]));
            if next <= shape.deepest {
                break;
            }
            end += 1;
        }
        assembler.push(division, &records[start..end], sink);
        (start, division) = (end, next);
    }
}

/// Makes room; long lists grow by an eighth, since half of the memory would otherwise lie idle.
#[cold]
fn grow<T>(list: &mut Vec<T>, more: usize) {
    const LONG: usize = 1 << 16;
    if list.len() < LONG { list.reserve(more) } else { list.reserve_exact(more.max(list.len() / 8)) }
}

fn empty_lists<T>(count: usize) -> Vec<Vec<T>> {
    (0..count).map(|_| Vec::new()).collect()
}
