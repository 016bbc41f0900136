//! The file: `magic, payload of the nodes in post-order, index, footer`, little-endian.
//!
//! Post-order puts every subtree in one range and the root next to the index, so that one read of the file's end gives all
//! that a first picture needs. A file without a whole footer is unfinished.

use crate::Grid;
use crate::frame::{Cell, Frame};
use crate::input::LONGEST_NAME;
use crate::node::Node;
use farsight_geometry::streaming::{FOOTER, Sealed};

/// First bytes of a file.
pub(crate) const MAGIC: &[u8; 16] = b"farsight-points1";
/// Bytes of a node's record.
pub(super) const NODE: usize = 32;
/// Bytes of the index before the attributes' name.
const HEAD: usize = 8 + 2 * 12 + 7 * 8 + 8 + 8;

/// How a file is closed.
pub(super) const SEALED: Sealed = Sealed {
    kind: "a file of points",
    magic: MAGIC,
    end: b"fs-end-1",
    least_index: HEAD,
    checksum: crc32fast::hash,
};

/// What the index says about the whole.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Head {
    pub grid: Grid,
    pub frame: Frame,
    pub hi: [i32; 3],
    pub inner: u32,
    pub attribute_bytes: usize,
    pub attributes: String,
    pub rounding: f64,
}

/// Index and footer for a payload that ends at `offset`.
pub(crate) fn tail(head: &Head, nodes: &[Node], counts: &[u32], offset: u64) -> Vec<u8> {
    let name = head.attributes.as_bytes();
    debug_assert!(name.len() <= LONGEST_NAME, "inputs check their names");
    let mut out = Vec::with_capacity(HEAD + name.len() + nodes.len() * NODE + counts.len() * 4 + FOOTER);
    out.extend([
        head.frame.bits as u8,
        head.inner as u8,
        head.attribute_bytes as u8,
        name.len() as u8,
        0,
        0,
        0,
        0,
    ]);
    head.frame.lo.iter().chain(&head.hi).for_each(|v| out.extend(v.to_le_bytes()));
    let floats =
        head.grid.scale.to_array().into_iter().chain(head.grid.offset.to_array()).chain([head.rounding]);
    floats.for_each(|v| out.extend(v.to_le_bytes()));
    let points: u64 = nodes.iter().map(|n| u64::from(n.points)).sum();
    out.extend(points.to_le_bytes());
    out.extend((nodes.len() as u32).to_le_bytes());
    out.extend((counts.len() as u32).to_le_bytes());
    out.extend(name);
    nodes.iter().for_each(|n| record(n, head.frame.bits, &mut out));
    counts.iter().for_each(|c| out.extend(c.to_le_bytes()));
    SEALED.close(&mut out, offset);
    out
}

fn record(node: &Node, bits: u32, out: &mut Vec<u8>) {
    let below = bits - node.cell.level;
    for v in node.cell.min {
        out.extend(v.checked_shr(below).unwrap_or(0).to_le_bytes());
    }
    out.extend([node.cell.level as u8, node.first as u8, node.counts.len() as u8, 0]);
    out.extend(node.points.to_le_bytes());
    out.extend(node.crc.to_le_bytes());
    for corner in [node.box_min, node.box_max] {
        out.extend([0, 1, 2].map(|k| to_256ths(corner[k] - node.cell.min[k], below)));
    }
    out.extend([0, 0]);
}

/// A coordinate inside a cell of 2^`below` steps, in 256ths of the cell, rounded down.
fn to_256ths(inside: u32, below: u32) -> u8 {
    if below >= 8 { (inside >> (below - 8)) as u8 } else { (inside << (8 - below)) as u8 }
}

/// The coordinates that [`to_256ths`] may have come from: least and greatest.
pub(super) fn from_256ths(part: u8, below: u32) -> [u64; 2] {
    let part = u64::from(part);
    if below >= 8 { [part << (below - 8), ((part + 1) << (below - 8)) - 1] } else { [part >> (8 - below); 2] }
}

/// Whether one cell lies in another, or is it.
pub(super) fn contains(outer: &Cell, inner: &Cell, bits: u32) -> bool {
    outer.level <= inner.level && Cell::around(inner.min, outer.level, bits) == *outer
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantised_boxes_contain() {
        for below in [0u32, 1, 5, 8, 9, 20, 32] {
            for i in 0..200u64 {
                let inside = (i * 7_919_111 % (1u64 << below)) as u32;
                let [lo, hi] = from_256ths(to_256ths(inside, below), below);
                assert!(lo <= u64::from(inside) && u64::from(inside) <= hi && hi < 1 << below);
            }
        }
    }
}
