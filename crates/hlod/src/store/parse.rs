//! The index of a file that may hold anything.

use super::format::{Head, MAGIC, MESH, NODE, SEALED};
use crate::HlodError;
use crate::cell::{BITS, Cell, Cube, DEEPEST};
use crate::piece::Attributes;
use crate::tree::{Cone, LatticeBox, NO_NODE, Node, Steps, Stored, Tree};
use farsight_geometry::streaming::Cursor;
use glam::{DVec3, Vec3};
use std::path::Path;

/// Reads some bytes at an offset.
type Read<'a> = &'a dyn Fn(u64, usize) -> Result<Vec<u8>, HlodError>;

/// Reads and checks footer and index.
pub(super) fn tree(path: &Path, length: u64, read: Read<'_>) -> Result<Tree, HlodError> {
    let damaged = |offset: u64, problem: &str| HlodError::Damaged {
        path: path.to_owned(),
        offset,
        problem: problem.to_owned(),
    };
    let (offset, index) = SEALED.index(length, read, damaged)?;
    parse(&index, offset).map_err(|problem| damaged(offset, &problem))
}

fn parse(index: &[u8], payload_end: u64) -> Result<Tree, String> {
    let mut cursor = Cursor(index);
    let (head, count) = head(&mut cursor).ok_or("the head makes no sense")?;
    if u64::from(count) * (NODE + MESH) as u64 > cursor.0.len() as u64 {
        return Err(format!("{count} nodes do not fit in an index of {} bytes", index.len()));
    }
    let mut nodes = Vec::with_capacity(count as usize);
    for number in 0..count {
        let node = node(&mut cursor, payload_end).ok_or_else(|| format!("node {number} makes no sense"))?;
        nodes.push(node);
    }
    if !cursor.0.is_empty() {
        return Err("more bytes than nodes".into());
    }
    link(&mut nodes)?;
    let world = nodes.iter().map(|n| Tree::world_box(&head.cube, &n.bounds)).collect();
    Ok(Tree {
        cube: head.cube,
        nodes,
        world,
        attributes: head.attributes,
        resolution: head.resolution,
        steps: head.steps,
        input_triangles: head.input_triangles,
    })
}

fn head(cursor: &mut Cursor<'_>) -> Option<(Head, u32)> {
    let [attributes, inner, leaf_most, _] = cursor.array()?;
    let (min, unit) = (DVec3::from_array(cursor.triple(Cursor::f64)?), cursor.f64()?);
    let resolution = cursor.f64()?;
    let (input_triangles, count) = (cursor.u64()?, cursor.u32()?);
    let steps = Steps { inner: inner.into(), leaf_most: leaf_most.into() };
    let attributes = Attributes::from_bits(attributes)?;
    let power_of_two = unit > 1e-60 && unit < 1e40 && unit.to_bits().trailing_zeros() >= 52;
    let sensible = min.is_finite()
        && power_of_two
        && resolution >= 1.0
        && resolution.is_finite()
        && steps.inner <= 24
        && steps.leaf_most <= BITS;
    let cube = Cube { min, unit };
    sensible.then_some((Head { cube, attributes, resolution, steps, input_triangles }, count))
}

fn node(cursor: &mut Cursor<'_>, payload_end: u64) -> Option<Node> {
    let [level, children, meshes, _] = cursor.array()?;
    let cell = Cell { level: level.into(), at: cursor.triple(Cursor::u32)? };
    let bounds = LatticeBox { min: cursor.triple(Cursor::i32)?, max: cursor.triple(Cursor::i32)? };
    let cone = Cone { axis: Vec3::from_array(cursor.triple(Cursor::f32)?), angle: cursor.f32()? };
    let first = mesh(cursor, payload_end)?;
    let second = match meshes {
        1 => first,
        2 => mesh(cursor, payload_end)?,
        _ => return None,
    };
    let sensible = cell.level <= DEEPEST
        && cell.at.iter().all(|&a| a >> cell.level == 0)
        && (0..3).all(|k| bounds.min[k] <= bounds.max[k])
        && cone.axis.is_finite()
        && cone.angle >= 0.0;
    sensible.then_some(Node {
        cell,
        children,
        first_child: NO_NODE,
        parent: NO_NODE,
        bounds,
        cone,
        meshes: [first, second],
    })
}

fn mesh(cursor: &mut Cursor<'_>, payload_end: u64) -> Option<Stored> {
    let m = Stored {
        offset: cursor.u64()?,
        shape_bytes: cursor.u32()?,
        looks_bytes: cursor.u32()?,
        shape_crc: cursor.u32()?,
        looks_crc: cursor.u32()?,
        positions: cursor.u32()?,
        vertices: cursor.u32()?,
        triangles: cursor.u32()?,
        error: cursor.f64()?,
        look_error: cursor.f64()?,
    };
    let end = m.offset.checked_add(u64::from(m.shape_bytes) + u64::from(m.looks_bytes))?;
    let bits = 8 * u64::from(m.shape_bytes);
    let sensible = m.offset >= MAGIC.len() as u64
        && end <= payload_end
        && u64::from(m.triangles) <= bits
        && m.positions <= m.vertices
        && u64::from(m.positions) <= bits
        && [m.error, m.look_error].iter().all(|e| *e >= 0.0 && e.is_finite());
    sensible.then_some(m)
}

/// Finds children and parents; checks that nodes come level by level and children in the order of their parents.
fn link(nodes: &mut [Node]) -> Result<(), String> {
    let mut next = 1usize;
    for i in 0..nodes.len() {
        let (cell, children) = (nodes[i].cell, nodes[i].children);
        if i == 0 && cell != Cell::ROOT {
            return Err("the first node is not the root".into());
        }
        if i >= next {
            return Err(format!("node {i} has no parent"));
        }
        nodes[i].first_child = next as u32;
        for octant in (0..8).filter(|o| children >> o & 1 == 1) {
            let expected =
                cell.level < DEEPEST && nodes.get(next).is_some_and(|n| n.cell == cell.child(octant));
            if !expected {
                return Err(format!("a child of node {i} is missing"));
            }
            nodes[next].parent = i as u32;
            next += 1;
        }
    }
    if next != nodes.len().max(1) {
        return Err("nodes without parents".into());
    }
    Ok(())
}
