//! The file: `magic, coded meshes, index, footer`, little-endian. A file without a whole footer is unfinished.

use crate::cell::Cube;
use crate::piece::Attributes;
use crate::tree::{Node, Steps, Stored};
use farsight_geometry::streaming::{FOOTER, Sealed};

/// First bytes of a file.
pub(crate) const MAGIC: &[u8; 16] = b"farsight-hlod-2\n";
/// Bytes of the index before the nodes: attributes, steps, cube, resolution, input triangles, nodes.
const HEAD: usize = 4 + 4 * 8 + 8 + 8 + 4;
/// Bytes of a node without its meshes: level, children, meshes, a spare one, cell, box, cone.
pub(super) const NODE: usize = 4 + 12 + 24 + 16;
/// Bytes of a stored mesh.
pub(super) const MESH: usize = 8 + 7 * 4 + 16;

/// How a file is closed.
pub(super) const SEALED: Sealed = Sealed {
    kind: "a hierarchy",
    magic: MAGIC,
    end: b"fs-hlod2",
    least_index: HEAD,
    checksum: crc32fast::hash,
};

/// What the index says about the whole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Head {
    pub cube: Cube,
    pub attributes: Attributes,
    pub resolution: f64,
    pub steps: Steps,
    pub input_triangles: u64,
}

/// Index and footer for meshes that end at `offset`. Nodes come level by level.
pub(crate) fn tail(head: &Head, nodes: &[Node], offset: u64) -> Vec<u8> {
    let mut out = Vec::with_capacity(HEAD + nodes.len() * (NODE + MESH) + FOOTER);
    out.extend([head.attributes.bits(), head.steps.inner as u8, head.steps.leaf_most as u8, 0]);
    let min = head.cube.min.to_array();
    [min[0], min[1], min[2], head.cube.unit].iter().for_each(|v| out.extend(v.to_le_bytes()));
    out.extend(head.resolution.to_le_bytes());
    out.extend(head.input_triangles.to_le_bytes());
    out.extend((nodes.len() as u32).to_le_bytes());
    nodes.iter().for_each(|n| record(n, &mut out));
    SEALED.close(&mut out, offset);
    out
}

fn record(node: &Node, out: &mut Vec<u8>) {
    let meshes = if node.meshes[0] == node.meshes[1] { 1 } else { 2 };
    out.extend([node.cell.level as u8, node.children, meshes, 0]);
    node.cell.at.iter().for_each(|v| out.extend(v.to_le_bytes()));
    node.bounds.min.iter().chain(&node.bounds.max).for_each(|v| out.extend(v.to_le_bytes()));
    node.cone.axis.to_array().iter().for_each(|v| out.extend(v.to_le_bytes()));
    out.extend(node.cone.angle.to_le_bytes());
    node.meshes[..meshes as usize].iter().for_each(|m| mesh(m, out));
}

fn mesh(m: &Stored, out: &mut Vec<u8>) {
    out.extend(m.offset.to_le_bytes());
    let numbers =
        [m.shape_bytes, m.looks_bytes, m.shape_crc, m.looks_crc, m.positions, m.vertices, m.triangles];
    numbers.iter().for_each(|v| out.extend(v.to_le_bytes()));
    out.extend(m.error.to_le_bytes());
    out.extend(m.look_error.to_le_bytes());
}
