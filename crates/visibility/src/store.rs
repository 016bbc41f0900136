//! The sets of a grid of cells as bytes: sections that concatenate.
//!
//! A section holds a run of cells. It begins with a header (magic, members, grid, first cell, number of cells, checksum), then
//! comes a record a cell: length, base, number of members, checksum, bits. A record holds its set, or how it differs from that of
//! a cell before in the same section, whichever is shorter. So the sections of a bake in parts give the
//! whole when they are put one after the other. All numbers are little-endian.

use crate::VisibilityError;
use crate::codec::{decode, encode};
use crate::grid::CellGrid;
use crate::pvs::Pvs;
use farsight_geometry::DAabb;
use glam::{DVec3, UVec3};
use std::collections::BTreeMap;
use std::ops::Range;

const MAGIC: [u8; 8] = *b"FSPVS\0\0\x01";
const HEADER: usize = 8 + 4 + 6 * 8 + 3 * 4 + 2 * 4 + 8;
const RECORD: usize = 4 * 3 + 8;

/// Differences that lead to a set at most, so that a look-up never decodes more.
const LONGEST_CHAIN: u32 = 8;

/// Writes one section, cell by cell.
#[derive(Clone, Debug)]
pub struct PvsWriter {
    grid: CellGrid,
    members: u32,
    cells: Range<u32>,
    next: u32,
    bytes: Vec<u8>,
    /// Sets of the last cells, up to one layer of x back, with the length of their chains.
    recent: std::collections::VecDeque<(Pvs, u32)>,
}

impl PvsWriter {
    /// Begins the section of the given cells of a grid.
    ///
    /// # Errors
    /// [`VisibilityError::CellRange`] when the grid does not have them.
    pub fn new(grid: CellGrid, members: u32, cells: Range<u32>) -> Result<Self, VisibilityError> {
        if cells.start > cells.end || cells.end > grid.len() {
            let Range { start, end } = cells;
            return Err(VisibilityError::CellRange { start, end, cells: grid.len() });
        }
        let mut bytes = Vec::with_capacity(HEADER);
        bytes.extend(MAGIC);
        bytes.extend(members.to_le_bytes());
        for corner in [grid.bounds().min, grid.bounds().max] {
            bytes.extend(corner.to_array().iter().flat_map(|x| x.to_le_bytes()));
        }
        let counts = grid.counts().to_array();
        let ends = [cells.start, cells.end - cells.start];
        bytes.extend(counts.iter().chain(&ends).flat_map(|n| n.to_le_bytes()));
        bytes.extend(checksum(&bytes).to_le_bytes());
        let next = cells.start;
        Ok(Self { grid, members, cells, next, bytes, recent: Default::default() })
    }

    /// Takes up a section that was broken off: keeps its whole records. `None` when the bytes do not begin such a section.
    pub(crate) fn resume(self, bytes: &[u8]) -> Option<Self> {
        if bytes.get(..HEADER)? != self.bytes {
            return None;
        }
        let mut writer = self;
        let (mut at, mut sets): (_, Vec<Pvs>) = (HEADER, Vec::new());
        while let Some((record, end)) = Record::read(bytes, at) {
            let index = sets.len() as u32;
            let base = record.base.checked_sub(1).and_then(|back| index.checked_sub(back + 1));
            if writer.next == writer.cells.end || (record.base != 0 && base.is_none()) {
                break;
            }
            let base = base.map(|i| &sets[i as usize]);
            let Some(set) = record.set(base, writer.members) else { break };
            // Written again: the same record, and the writer knows what later ones may lean on.
            writer.add(&set).ok()?;
            if writer.bytes.get(at..end) != bytes.get(at..end) {
                return None;
            }
            sets.push(set);
            at = end;
        }
        Some(writer)
    }

    /// Appends the set of the next cell.
    ///
    /// # Errors
    /// [`VisibilityError::CellRange`] when the section is full; [`VisibilityError::NotAMember`] when the set holds a number that
    /// is no member.
    pub fn add(&mut self, set: &Pvs) -> Result<(), VisibilityError> {
        if self.next == self.cells.end {
            let Range { start, end } = self.cells;
            return Err(VisibilityError::CellRange { start, end, cells: self.grid.len() });
        }
        if set.bound() > self.members {
            return Err(VisibilityError::NotAMember { number: set.bound() - 1, members: self.members });
        }
        let mut best = (0u32, encode(set), set.len(), 0);
        // The neighbours before on x and on y.
        for back in [1, self.grid.counts().x] {
            let Some(at) = self.recent.len().checked_sub(back as usize) else { continue };
            let (base, chain) = &self.recent[at];
            if *chain < LONGEST_CHAIN {
                let change = base.symmetric_difference(set);
                let bits = encode(&change);
                if bits.len() < best.1.len() {
                    best = (back, bits, change.len(), chain + 1);
                }
            }
        }
        let (back, bits, len, chain) = best;
        let head = [bits.len() as u32, back, len];
        let start = self.bytes.len();
        self.bytes.extend(head.iter().flat_map(|n| n.to_le_bytes()));
        let sum = checksum_of([&self.bytes[start..], &bits]);
        self.bytes.extend(sum.to_le_bytes());
        self.bytes.extend(bits);
        self.recent.push_back((set.clone(), chain));
        if self.recent.len() > self.grid.counts().x as usize {
            self.recent.pop_front();
        }
        self.next += 1;
        Ok(())
    }

    /// The cell whose set comes next; the end of the range when the section is full.
    pub fn next_cell(&self) -> u32 {
        self.next
    }

    pub(crate) fn last_cell(&self) -> u32 {
        self.cells.end
    }

    /// The section so far: header and whole records.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

/// A record of one cell, as it stands in the bytes.
#[derive(Clone, Debug)]
struct Record {
    /// How many cells back the base is; zero for none.
    base: u32,
    /// Numbers in the set or the difference.
    len: u32,
    bits: Vec<u8>,
    /// Where the record stands.
    offset: u64,
}

impl Record {
    /// The record at `at` and where it ends; `None` when it is not whole.
    fn read(bytes: &[u8], at: usize) -> Option<(Self, usize)> {
        let head = bytes.get(at..at.checked_add(RECORD)?)?;
        let number = |i: usize| u32::from_le_bytes([0, 1, 2, 3].map(|j| head[4 * i + j]));
        let start = at + RECORD;
        let end = start.checked_add(number(0) as usize)?;
        let bits = bytes.get(start..end)?;
        let sum = u64::from_le_bytes([0, 1, 2, 3, 4, 5, 6, 7].map(|j| head[12 + j]));
        let whole = sum == checksum_of([&head[..12], bits]);
        let record = Self { base: number(1), len: number(2), bits: bits.to_vec(), offset: at as u64 };
        whole.then_some((record, end))
    }

    fn set(&self, base: Option<&Pvs>, members: u32) -> Option<Pvs> {
        let stored = decode(&self.bits, self.len, members)?;
        Some(base.map_or(stored.clone(), |base| base.symmetric_difference(&stored)))
    }
}

/// The sets of a grid, kept as they were written.
#[derive(Clone, Debug)]
pub struct PvsStore {
    grid: CellGrid,
    members: u32,
    /// By cell: its record and the first cell of its section.
    records: BTreeMap<u32, (Record, u32)>,
    bytes: u64,
}

impl PvsStore {
    /// Reads one or several sections of one grid, in any order. Cells may be missing.
    ///
    /// # Errors
    /// [`VisibilityError::Format`] says where the bytes stop making sense. Nothing is allocated on the word of a count.
    pub fn read(bytes: &[u8]) -> Result<Self, VisibilityError> {
        let mut store: Option<Self> = None;
        let mut at = 0;
        while at < bytes.len() || store.is_none() {
            let bad = |what: &'static str, at: usize| VisibilityError::Format { what, offset: at as u64 };
            let header = bytes.get(at..at + HEADER).ok_or(bad("a header that is cut off", at))?;
            let section = Header::read(header).map_err(|what| bad(what, at))?;
            let store = store.get_or_insert_with(|| Self {
                grid: section.grid,
                members: section.members,
                records: BTreeMap::new(),
                bytes: bytes.len() as u64,
            });
            if (store.grid, store.members) != (section.grid, section.members) {
                return Err(bad("a section of another grid or scene", at));
            }
            at += HEADER;
            for cell in section.cells.clone() {
                let (record, end) =
                    Record::read(bytes, at).ok_or(bad("a record that is cut off or damaged", at))?;
                if record.base > cell - section.cells.start {
                    return Err(bad("a difference to a cell outside the section", at));
                }
                if store.records.insert(cell, (record, section.cells.start)).is_some() {
                    return Err(bad("a cell that was there already", at));
                }
                at = end;
            }
        }
        let store = store.ok_or(VisibilityError::Format { what: "nothing", offset: 0 })?;
        store.check()?;
        Ok(store)
    }

    /// Decodes every set once, so that later look-ups cannot fail.
    fn check(&self) -> Result<(), VisibilityError> {
        for (&cell, (record, _)) in &self.records {
            if self.decode(cell, LONGEST_CHAIN).is_none() {
                let (what, offset) = ("a set that cannot be decoded", record.offset);
                return Err(VisibilityError::Format { what, offset });
            }
        }
        Ok(())
    }

    fn decode(&self, cell: u32, chain: u32) -> Option<Pvs> {
        let (record, first) = self.records.get(&cell)?;
        let base = match record.base {
            0 => None,
            back => {
                let base = cell.checked_sub(back).filter(|base| base >= first && chain > 0)?;
                Some(self.decode(base, chain - 1)?)
            }
        };
        record.set(base.as_ref(), self.members)
    }

    /// The grid.
    pub fn grid(&self) -> &CellGrid {
        &self.grid
    }

    /// Members that sets are made of.
    pub fn members(&self) -> u32 {
        self.members
    }

    /// Bytes that were read.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The first cell without a set.
    pub fn missing(&self) -> Option<u32> {
        (0..self.grid.len()).find(|cell| !self.records.contains_key(cell))
    }

    /// The set of a cell; `None` when it is not there.
    ///
    /// # Cost
    /// Decoding at most nine records.
    pub fn get(&self, cell: u32) -> Option<Pvs> {
        self.decode(cell, LONGEST_CHAIN)
    }

    /// The set for a viewpoint: that of its cell; `None` outside the grid.
    pub fn at(&self, viewpoint: DVec3) -> Option<Pvs> {
        self.get(self.grid.cell_at(viewpoint)?)
    }

    /// What is seen from a cell or its neighbours within `radius`: hides what sampling missed, and lasts while the viewpoint moves
    /// on. Neighbours without a set are skipped.
    ///
    /// # Panics
    /// When there is no such cell.
    pub fn dilated(&self, cell: u32, radius: u32) -> Pvs {
        self.grid
            .around(cell, radius)
            .filter_map(|c| self.get(c))
            .fold(Pvs::new(), |all, set| all.union(&set))
    }
}

struct Header {
    grid: CellGrid,
    members: u32,
    cells: Range<u32>,
}

impl Header {
    fn read(bytes: &[u8]) -> Result<Self, &'static str> {
        if bytes[..8] != MAGIC {
            return Err("no section of visible sets");
        }
        let (content, sum) = bytes.split_at(HEADER - 8);
        if sum != checksum(content).to_le_bytes() {
            return Err("a damaged header");
        }
        let word = |at: usize| u32::from_le_bytes([0, 1, 2, 3].map(|i| bytes[at + i]));
        let real = |at: usize| f64::from_le_bytes([0, 1, 2, 3, 4, 5, 6, 7].map(|i| bytes[at + i]));
        let corner = |at: usize| DVec3::new(real(at), real(at + 8), real(at + 16));
        let counts = UVec3::new(word(60), word(64), word(68));
        let grid = CellGrid::new(DAabb::new(corner(12), corner(36)), counts);
        let grid = grid.map_err(|_| "an impossible grid")?;
        let (first, count) = (word(72), word(76));
        match first.checked_add(count) {
            Some(end) if end <= grid.len() => Ok(Self { grid, members: word(8), cells: first..end }),
            _ => Err("cells outside the grid"),
        }
    }
}

pub(crate) fn checksum(bytes: &[u8]) -> u64 {
    checksum_of([bytes, &[]])
}

/// FNV-1a in 64 bits: against accidents, not against intent.
fn checksum_of(parts: [&[u8]; 2]) -> u64 {
    let step = |sum: u64, byte: &u8| (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    parts.into_iter().flatten().fold(0xcbf2_9ce4_8422_2325, step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::Random;

    fn grid() -> CellGrid {
        CellGrid::new(DAabb::new(DVec3::ZERO, DVec3::new(4.0, 3.0, 2.0)), UVec3::new(4, 3, 2)).unwrap()
    }

    /// Sets that change little from cell to cell.
    fn sets() -> Vec<Pvs> {
        let mut random = Random::new(9);
        let mut current: Vec<bool> = (0..5000).map(|_| random.unit() < 0.3).collect();
        (0..24)
            .map(|_| {
                (0..40).for_each(|_| current[random.below(5000) as usize] ^= true);
                Pvs::from_sorted((0..5000).filter(|&n| current[n as usize]))
            })
            .collect()
    }

    fn section(cells: Range<u32>) -> Vec<u8> {
        let sets = sets();
        let mut writer = PvsWriter::new(grid(), 5000, cells.clone()).unwrap();
        cells.for_each(|c| writer.add(&sets[c as usize]).unwrap());
        writer.bytes().to_vec()
    }

    #[test]
    fn sections_concatenate_in_any_order_and_differences_are_small() {
        let whole = PvsStore::read(&section(0..24)).unwrap();
        let parts = [section(0..7), section(15..24), section(7..15), section(3..3)].concat();
        let joined = PvsStore::read(&parts).unwrap();
        for (cell, set) in sets().iter().enumerate() {
            assert_eq!(whole.get(cell as u32).as_ref(), Some(set));
            assert_eq!(joined.get(cell as u32).as_ref(), Some(set));
        }
        assert_eq!((whole.missing(), joined.missing()), (None, None));
        let alone: usize = sets().iter().map(|s| encode(s).len()).sum();
        assert!(whole.bytes() < alone as u64 / 3, "{} of {alone}", whole.bytes());
        let partial = PvsStore::read(&section(2..5)).unwrap();
        assert_eq!((partial.missing(), partial.get(1), partial.get(23)), (Some(0), None, None));
        let viewpoint = DVec3::new(2.5, 0.5, 0.5);
        assert_eq!(whole.at(viewpoint), whole.get(2));
        let around = whole.dilated(2, 1);
        assert!((1..4).all(|c| whole.get(c).unwrap().is_subset(&around)));
    }

    #[test]
    fn broken_off_sections_are_taken_up_where_they_end() {
        let bytes = section(4..20);
        let fresh = || PvsWriter::new(grid(), 5000, 4..20).unwrap();
        for cut in [HEADER, HEADER + 5, bytes.len() / 2, bytes.len() - 1, bytes.len()] {
            let mut writer = fresh().resume(&bytes[..cut]).unwrap();
            assert!(bytes.starts_with(writer.bytes()) && writer.bytes().len() <= cut);
            for cell in writer.next_cell()..20 {
                writer.add(&sets()[cell as usize]).unwrap();
            }
            assert_eq!(writer.bytes(), bytes);
        }
        assert!(fresh().resume(&bytes[..HEADER - 1]).is_none());
        assert!(PvsWriter::new(grid(), 5001, 4..20).unwrap().resume(&bytes).is_none());
    }

    #[test]
    fn wrong_use_is_refused() {
        assert!(matches!(PvsWriter::new(grid(), 9, 3..25), Err(VisibilityError::CellRange { .. })));
        let mut writer = PvsWriter::new(grid(), 9, 3..4).unwrap();
        let too_large = writer.add(&Pvs::from_sorted([9])).unwrap_err();
        assert_eq!(too_large, VisibilityError::NotAMember { number: 9, members: 9 });
        writer.add(&Pvs::new()).unwrap();
        assert!(matches!(writer.add(&Pvs::new()), Err(VisibilityError::CellRange { .. })));
    }

    #[test]
    fn hostile_bytes_give_errors() {
        let bytes = section(0..24);
        assert!(PvsStore::read(&[]).is_err());
        for cut in 0..bytes.len() {
            assert!(PvsStore::read(&bytes[..cut]).is_err(), "cut at {cut}");
        }
        let mut random = Random::new(10);
        let mut damaged = 0;
        for _ in 0..12_000 {
            let mut other = bytes.clone();
            for _ in 0..1 + random.below(4) {
                let at = random.below(other.len() as u64) as usize;
                other[at] = random.bits() as u8;
            }
            damaged += i32::from(PvsStore::read(&other).is_err());
        }
        assert!(damaged > 11_900, "{damaged}");
    }

    /// Damage that keeps the checksums: what a forger would write.
    #[test]
    fn forged_records_give_errors_or_other_sets_but_nothing_worse() {
        let mut random = Random::new(11);
        let bytes = section(0..24);
        for _ in 0..6000 {
            let mut other = bytes[..HEADER].to_vec();
            if random.unit() < 0.2 {
                let at = 8 + random.below(HEADER as u64 - 16) as usize;
                other[at] ^= 1 << random.below(8);
            }
            let sum = checksum(&other[..HEADER - 8]).to_le_bytes();
            other[HEADER - 8..].copy_from_slice(&sum);
            for _ in 0..24 {
                let mut bits: Vec<u8> = (0..random.below(30)).map(|_| random.bits() as u8).collect();
                if let Some(first) = bits.first_mut() {
                    *first %= 40;
                }
                let head = [bits.len() as u32, random.below(4) as u32, random.below(60) as u32 * 100];
                let head: Vec<u8> = head.iter().flat_map(|n| n.to_le_bytes()).collect();
                let sum = checksum_of([&head, &bits]);
                other.extend(head);
                other.extend(sum.to_le_bytes());
                other.extend(bits);
            }
            if let Ok(store) = PvsStore::read(&other) {
                assert!((0..24).filter_map(|c| store.get(c)).all(|s| s.bound() <= store.members()));
            }
        }
    }
}
