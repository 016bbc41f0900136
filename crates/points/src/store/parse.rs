//! The index of a file that may hold anything.

use super::format::{Head, MAGIC, NODE, SEALED, contains, from_256ths};
use super::octree::{Octree, Record};
use crate::frame::{Cell, Frame};
use crate::layout::MOST_ATTRIBUTE_BYTES;
use crate::morton;
use crate::node::POINT_BYTES;
use crate::{Grid, PointsError};
use farsight_geometry::streaming::Cursor;
use glam::DVec3;
use std::path::Path;

/// Reads some bytes at an offset.
type Read<'a> = &'a dyn Fn(u64, usize) -> Result<Vec<u8>, PointsError>;

/// Reads and checks footer and index.
pub(super) fn octree(path: &Path, length: u64, read: Read<'_>) -> Result<Octree, PointsError> {
    let damaged = |offset: u64, problem: &str| PointsError::Damaged {
        path: path.to_owned(),
        offset,
        problem: problem.to_owned(),
    };
    let (offset, index) = SEALED.index(length, read, damaged)?;
    let parsed = parse(&index, offset - MAGIC.len() as u64);
    let (head, records) = parsed.map_err(|problem| damaged(offset, &problem))?;
    Octree::new(head, records).map_err(|problem| damaged(offset, &problem))
}

fn parse(index: &[u8], payload: u64) -> Result<(Head, Vec<Record>), String> {
    let mut cursor = Cursor(index);
    let (head, points, nodes, counts) = head(&mut cursor).ok_or("the index is too short")??;
    let needed = u64::from(nodes) * NODE as u64 + u64::from(counts) * 4;
    if needed != cursor.0.len() as u64 {
        return Err(format!(
            "{nodes} nodes and {counts} counts do not fill an index of {} bytes",
            index.len()
        ));
    }
    let mut counts = Cursor(cursor.0.get(nodes as usize * NODE..).ok_or("the index is too short")?);
    let mut records = Vec::with_capacity(nodes as usize);
    let mut offset = MAGIC.len() as u64;
    let each = (POINT_BYTES + head.attribute_bytes) as u64;
    for number in 0..nodes {
        let record = node(&mut cursor, &mut counts, &head, offset)
            .ok_or_else(|| format!("node {number} makes no sense"))?;
        offset += u64::from(record.points) * each;
        records.push(record);
    }
    let all: u64 = records.iter().map(|r| u64::from(r.points)).sum();
    if all != points || offset - MAGIC.len() as u64 != payload {
        return Err(format!("{all} points in nodes, {points} declared, {payload} bytes of payload"));
    }
    if !counts.0.is_empty() {
        return Err("more counts than the nodes have levels".into());
    }
    Ok((head, records))
}

/// Head, and the numbers of points, nodes and counts.
type Beginning = (Head, u64, u32, u32);

fn head(cursor: &mut Cursor<'_>) -> Option<Result<Beginning, String>> {
    let [bits, inner, attribute_bytes, name, ..] = cursor.array::<8>()?;
    let int = |c: &mut Cursor<'_>| c.u32().map(|v| v as i32);
    let (lo, hi) = (cursor.triple(int)?, cursor.triple(int)?);
    let (scale, offset) = (cursor.triple(Cursor::f64)?, cursor.triple(Cursor::f64)?);
    let rounding = cursor.f64()?;
    let (points, nodes, counts) = (cursor.u64()?, cursor.u32()?, cursor.u32()?);
    let attributes = String::from_utf8_lossy(cursor.take(name as usize)?).into_owned();
    let grid = Grid { scale: DVec3::from_array(scale), offset: DVec3::from_array(offset) };
    let frame = Frame { lo, bits: bits.into() };
    let attribute_bytes = attribute_bytes as usize;
    let sensible = frame == Frame::around(lo, hi)
        && (0..3).all(|k| lo[k] <= hi[k])
        && (1..=12).contains(&inner)
        && attribute_bytes <= MOST_ATTRIBUTE_BYTES
        && rounding >= 0.0
        && rounding.is_finite()
        && grid.check("file").is_ok();
    if !sensible {
        return Some(Err("box, depth, grid or attributes make no sense".into()));
    }
    let head = Head { grid, frame, hi, inner: inner.into(), attribute_bytes, attributes, rounding };
    Some(Ok((head, points, nodes, counts)))
}

fn node(cursor: &mut Cursor<'_>, counts: &mut Cursor<'_>, head: &Head, offset: u64) -> Option<Record> {
    let bits = head.frame.bits;
    let place = cursor.triple(Cursor::u32)?;
    let [level, first, levels, _] = cursor.array::<4>()?.map(u32::from);
    let (points, crc) = (cursor.u32()?, cursor.u32()?);
    let [x0, y0, z0, x1, y1, z1, ..] = cursor.array::<8>()?;
    if level > bits || place.iter().any(|&v| u64::from(v) >> level != 0) {
        return None;
    }
    let below = bits - level;
    let cell = Cell { min: place.map(|v| v.checked_shl(below).unwrap_or(0)), level };
    let least = if level == 0 { 0 } else { level + head.inner };
    if levels == 0 || first < least || first + levels > bits + 2 {
        return None;
    }
    let mut sum = 0u64;
    let per_level = counts.take(4 * levels as usize)?;
    let per_level = per_level.chunks_exact(4).map(|c| u32::from_le_bytes([c[0], c[1], c[2], c[3]]));
    let per_level: Vec<u32> = per_level.inspect(|&c| sum += u64::from(c)).collect();
    if sum != u64::from(points) || points == 0 {
        return None;
    }
    let corner = |parts: [u8; 3], end: usize| {
        [0, 1, 2].map(|k| u64::from(cell.min[k]) + from_256ths(parts[k], below)[end])
    };
    let (box_min, box_max) = (corner([x0, y0, z0], 0), corner([x1, y1, z1], 1));
    let ordered = (0..3).all(|k| box_min[k] <= box_max[k]);
    ordered.then_some(Record { cell, first, per_level, points, crc, offset, box_min, box_max })
}

/// Parents of nodes in post-order, checked: children lie in their parents, and siblings follow each other in Morton order.
pub(super) fn parents(records: &[Record], bits: u32) -> Result<Vec<Option<u32>>, String> {
    let mut parents = vec![None; records.len()];
    let mut open: Vec<u32> = Vec::new();
    let first_key = |c: &Cell| morton::key96(c.min);
    let end_key = |c: &Cell| first_key(c) + (1u128 << (3 * (bits - c.level)));
    for (i, record) in records.iter().enumerate() {
        let wrong = || format!("node {i} is out of order");
        while let Some(&last) = open.last() {
            let before = &records[last as usize].cell;
            if before.level > record.cell.level && contains(&record.cell, before, bits) {
                parents[last as usize] = Some(i as u32);
                open.pop();
            } else if end_key(before) <= first_key(&record.cell) {
                break;
            } else {
                return Err(wrong());
            }
        }
        open.push(i as u32);
    }
    match open[..] {
        [] => Ok(parents),
        [root] if records[root as usize].cell.level == 0 => Ok(parents),
        _ => Err("the nodes are not one tree".into()),
    }
}
