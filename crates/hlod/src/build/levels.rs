//! Nodes in the order that they are written in: leaves along a Z curve, then level after level up to the root.

use super::journal::{Entry, Journal};
use super::node::{self, Below, Made};
use super::partition::Leaves;
use super::{BuildReport, LevelReport, Plan, Stage, Watch};
use crate::HlodError;
use crate::cell::Cell;
use crate::codec::{Looks, Shape};
use crate::piece::Piece;
use crate::store::{decode, piece_of};
use crate::tree::{Cone, LatticeBox, Mesh, NO_NODE, Node, Stored};
use farsight_geometry::accuracy::{Cost, Counters};
use farsight_geometry::streaming::read_exact_at;
use std::collections::{BTreeSet, HashMap};
use std::fs::File;
use std::io::Write;
use std::path::PathBuf;

/// Nodes that are made before any of them is written, for each thread.
const BATCH: usize = 8;

/// A node that is written.
#[derive(Clone, Copy, Debug)]
struct Written {
    bounds: LatticeBox,
    cone: Cone,
    meshes: [Stored; 2],
    is_leaf: bool,
}

/// Writes nodes, and makes the inner ones from them.
pub(super) struct Levels<'a> {
    plan: &'a Plan,
    file: File,
    path: PathBuf,
    length: u64,
    written: HashMap<Cell, Written>,
    leaf_hash: crc32fast::Hasher,
    cut: u64,
}

/// What the work came to.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Counts {
    pub joined: u64,
    pub resumed: u64,
}

impl<'a> Levels<'a> {
    pub(super) fn new(plan: &'a Plan, file: File, path: PathBuf) -> Self {
        let leaf_hash = crc32fast::Hasher::new();
        Self { plan, file, path, length: 0, written: HashMap::new(), leaf_hash, cut: 0 }
    }

    pub(super) fn length(&self) -> u64 {
        self.length
    }

    pub(super) fn write(&mut self, bytes: &[u8]) -> Result<(), HlodError> {
        self.file.write_all(bytes).map_err(HlodError::io(&self.path))?;
        self.length += bytes.len() as u64;
        Ok(())
    }

    pub(super) fn sync(&self) -> Result<(), HlodError> {
        self.file.sync_all().map_err(HlodError::io(&self.path))
    }

    /// Codes and writes leaves that were cut together.
    pub(super) fn add_leaves(
        &mut self,
        leaves: Leaves,
        watch: &Watch<'_>,
        total: u64,
    ) -> Result<(), HlodError> {
        let plan = self.plan;
        let mut leaves = leaves.into_iter().peekable();
        while leaves.peek().is_some() {
            let some: Leaves = leaves.by_ref().take(64 * plan.threads.count).collect();
            let made = plan.threads.map(some, |(cell, p)| (cell, node::leaf(plan, &cell, &p)));
            for (cell, made) in made {
                let before = self.cut * total / self.expected_leaf_triangles(total);
                self.cut += u64::from(made.coded.triangles);
                self.leaf_hash.update(&made.coded.shape);
                self.leaf_hash.update(&made.coded.looks);
                let stored = self.store(&made)?;
                let written =
                    Written { bounds: made.bounds, cone: made.cone, meshes: [stored; 2], is_leaf: true };
                self.written.insert(cell, written);
                let after = (self.cut * total / self.expected_leaf_triangles(total)).min(total);
                watch.advance(Stage::Cut, after.saturating_sub(before), total)?;
            }
        }
        Ok(())
    }

    /// Cutting makes more triangles of the input; progress should not go past its end.
    fn expected_leaf_triangles(&self, total: u64) -> u64 {
        (total + total / 6).max(1)
    }

    /// What tells this build's inner nodes from another's.
    pub(super) fn identity(&self) -> [u64; 4] {
        let tier = match self.plan.tier {
            crate::Tier::Guaranteed => 0,
            crate::Tier::Verified => 1,
            crate::Tier::Fast => 2,
        };
        [
            u64::from(self.leaf_hash.clone().finalize()) << 8 | tier,
            self.length,
            self.plan.resolution.to_bits(),
            self.written.len() as u64,
        ]
    }

    fn store(&mut self, made: &Made) -> Result<Stored, HlodError> {
        let c = &made.coded;
        let stored = Stored {
            offset: self.length,
            shape_bytes: c.shape.len() as u32,
            looks_bytes: c.looks.len() as u32,
            shape_crc: crc32fast::hash(&c.shape),
            looks_crc: crc32fast::hash(&c.looks),
            positions: c.positions,
            vertices: c.vertices,
            triangles: c.triangles,
            error: made.error,
            look_error: made.look_error,
        };
        self.write(&c.shape)?;
        self.write(&c.looks)?;
        Ok(stored)
    }

    /// Makes all inner nodes; returns all nodes level by level.
    pub(super) fn simplify(
        &mut self,
        mut journal: Option<Journal>,
        watch: &Watch<'_>,
    ) -> Result<(Vec<Node>, Counts), HlodError> {
        let inner = self.inner_cells();
        let total: u64 = inner.iter().map(|l| l.len() as u64).sum();
        let mut counts = Counts::default();
        watch.begin();
        let meshes: &[Mesh] =
            if self.plan.attributes.any() { &[Mesh::Full, Mesh::Shape] } else { &[Mesh::Full] };
        for cells in side_by_side(inner) {
            for cells in cells.chunks(BATCH * self.plan.threads.count) {
                let mut known = Vec::new();
                if let Some(journal) = &mut journal {
                    while known.len() < cells.len() {
                        let Some(entry) = journal.next(cells[known.len()], meshes.len())? else { break };
                        known.push(entry);
                    }
                }
                counts.resumed += known.len() as u64;
                let rest = cells[known.len()..].to_vec();
                let this = &*self;
                let made: Vec<Result<Entry, HlodError>> = this.plan.threads.map(rest, |cell| {
                    let made = meshes.iter().map(|&mesh| {
                        let below = this.below(&cell, mesh)?;
                        node::inner(this.plan, &cell, mesh, below)
                    });
                    Ok(Entry { cell, meshes: made.collect::<Result<_, HlodError>>()? })
                });
                let first_new = known.len();
                let made = known.into_iter().map(Ok).chain(made);
                for (i, entry) in made.enumerate() {
                    let entry = entry?;
                    if let Some(journal) = journal.as_mut().filter(|_| i >= first_new) {
                        journal.add(&entry)?;
                    }
                    counts.joined += entry.meshes.iter().map(|m| m.joined).sum::<u64>();
                    self.add_inner(&entry)?;
                    watch.advance(Stage::Simplify, 1, total)?;
                }
            }
        }
        Ok((self.nodes(), counts))
    }

    /// Cells above leaves, by level, along a Z curve each.
    fn inner_cells(&self) -> Vec<Vec<Cell>> {
        let deepest = self.written.keys().map(|c| c.level).max().unwrap_or(0) as usize;
        let mut sets: Vec<BTreeSet<(u64, Cell)>> = vec![BTreeSet::new(); deepest];
        for leaf in self.written.keys() {
            let mut cell = *leaf;
            while cell.level > 0 {
                cell = Cell { level: cell.level - 1, at: cell.at.map(|a| a >> 1) };
                if !sets[cell.level as usize].insert((z_order(&cell), cell)) {
                    break;
                }
            }
        }
        sets.into_iter().map(|s| s.into_iter().map(|(_, c)| c).collect()).collect()
    }

    fn children(&self, cell: &Cell) -> impl Iterator<Item = Cell> + '_ {
        let cell = *cell;
        (0..8).map(move |o| cell.child(o)).filter(|c| self.written.contains_key(c))
    }

    /// Meshes two levels below a cell, or one where that is a leaf.
    fn below(&self, cell: &Cell, mesh: Mesh) -> Result<Vec<Below>, HlodError> {
        let mut cells = Vec::new();
        // Inner nodes one level below need not be there yet.
        for child in (0..8).map(|octant| cell.child(octant)) {
            match self.written.get(&child) {
                Some(leaf) if leaf.is_leaf => cells.push(child),
                _ => cells.extend(self.children(&child)),
            }
        }
        let (mut shape, mut looks, mut raw) = (Shape::default(), Looks::default(), Vec::new());
        let mut below = Vec::with_capacity(cells.len());
        for c in cells {
            let written = &self.written[&c];
            let stored = &written.meshes[mesh.index()];
            let piece = self.read(&c, written.is_leaf, stored, mesh, (&mut shape, &mut looks, &mut raw))?;
            below.push(Below { piece, error: stored.error, look_error: stored.look_error });
        }
        Ok(below)
    }

    fn read(
        &self,
        cell: &Cell,
        is_leaf: bool,
        stored: &Stored,
        mesh: Mesh,
        (shape, looks, raw): (&mut Shape, &mut Looks, &mut Vec<u8>),
    ) -> Result<Piece, HlodError> {
        let attributes = self.plan.attributes;
        let with_looks = mesh == Mesh::Full && attributes.any() && stored.looks_bytes > 0;
        let size = stored.shape_bytes + if with_looks { stored.looks_bytes } else { 0 };
        raw.resize(size as usize, 0);
        read_exact_at(&self.file, raw, stored.offset).map_err(HlodError::io(&self.path))?;
        let step = self.plan.steps.of(cell, is_leaf);
        decode(raw, stored, cell.edge() / step, with_looks, attributes, shape, looks).map_err(|problem| {
            let (path, problem) = (self.path.clone(), problem.to_owned());
            HlodError::Damaged { path, offset: stored.offset, problem }
        })?;
        Ok(piece_of(shape, looks, cell.corner(), step))
    }

    fn add_inner(&mut self, entry: &Entry) -> Result<(), HlodError> {
        let mut meshes = [Stored::default(); 2];
        for (slot, made) in meshes.iter_mut().zip(&entry.meshes) {
            *slot = self.store(made)?;
        }
        if entry.meshes.len() == 1 {
            meshes[1] = meshes[0];
        }
        let (mut bounds, mut cones) = (LatticeBox::EMPTY, Vec::new());
        for made in &entry.meshes {
            bounds = bounds.union(made.bounds);
            cones.push(made.cone);
        }
        for child in self.children(&entry.cell) {
            bounds = bounds.union(self.written[&child].bounds);
            cones.push(self.written[&child].cone);
        }
        let written = Written { bounds, cone: Cone::around(&cones), meshes, is_leaf: false };
        self.written.insert(entry.cell, written);
        Ok(())
    }

    /// All nodes, level by level, children in the order of their parents.
    fn nodes(&self) -> Vec<Node> {
        let mut nodes = Vec::with_capacity(self.written.len());
        let mut cells: Vec<(Cell, u32)> = Vec::new();
        cells.extend(self.written.contains_key(&Cell::ROOT).then_some((Cell::ROOT, NO_NODE)));
        let mut next = 0;
        while let Some(&(cell, parent)) = cells.get(next) {
            let written = &self.written[&cell];
            let first_child = cells.len() as u32;
            let mut children = 0;
            if !written.is_leaf {
                for child in self.children(&cell) {
                    children |= 1u8 << child.octant();
                    cells.push((child, next as u32));
                }
            }
            let Written { bounds, cone, meshes, .. } = *written;
            nodes.push(Node { cell, children, first_child, parent, bounds, cone, meshes });
            next += 1;
        }
        nodes
    }
}

/// Cells by level as lists that need nothing of one another, deepest first: of two levels each, since nodes are made of what is two levels below. The root has company, as it would
/// keep all threads but one waiting.
fn side_by_side(mut levels: Vec<Vec<Cell>>) -> Vec<Vec<Cell>> {
    levels.reverse();
    let (alone, pairs) = levels.split_at(levels.len() % 2);
    alone.iter().cloned().chain(pairs.chunks(2).map(<[_]>::concat)).collect()
}

/// Place along a Z curve through the cells of a level.
fn z_order(cell: &Cell) -> u64 {
    (0..cell.level).fold(0, |z, bit| {
        let octant = (0..3).map(|k| u64::from(cell.at[k] >> bit & 1) << k).sum::<u64>();
        z | octant << (3 * bit)
    })
}

/// Sums up what was built.
pub(super) fn report(nodes: &[Node], triangles: u64, bytes: u64, counts: &Counts) -> BuildReport {
    let mut levels: Vec<LevelReport> = Vec::new();
    let mut shape_bytes = 0;
    for n in nodes {
        let level = n.cell.level as usize;
        levels.resize(levels.len().max(level + 1), LevelReport::default());
        let l = &mut levels[level];
        let size = |m: &Stored| u64::from(m.shape_bytes) + u64::from(m.looks_bytes);
        l.nodes += 1;
        l.leaves += u64::from(n.children == 0);
        l.triangles += u64::from(n.meshes[0].triangles);
        l.shape_triangles += u64::from(n.meshes[1].triangles);
        l.bytes += size(&n.meshes[0]);
        l.error = l.error.max(n.meshes[0].error);
        if n.meshes[0] != n.meshes[1] {
            l.bytes += size(&n.meshes[1]);
            shape_bytes += size(&n.meshes[1]);
        }
    }
    let mut counters = Counters::new();
    counters.add("triangles", triangles);
    counters.add("nodes", nodes.len() as u64);
    counters.add("leaves", nodes.iter().filter(|n| n.children == 0).count() as u64);
    counters.add("joined", counts.joined);
    BuildReport {
        triangles,
        levels,
        bytes,
        shape_bytes,
        joined: counts.joined,
        resumed: counts.resumed,
        cost: Cost { counters, ..Cost::default() },
    }
}
