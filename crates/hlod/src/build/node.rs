//! Making the meshes of one node.

use super::{Plan, thin};
use crate::HlodError;
use crate::cell::{Cell, LocalFrame, rounding};
use crate::codec::{Encoded, NORMAL_ROUNDING, encode};
use crate::cut::Polygons;
use crate::gather::{Gathered, Part, gather};
use crate::piece::{Attributes, Piece};
use crate::roles::Walls;
use crate::simplify::simplify_between;
use crate::tree::{Cone, LatticeBox, Mesh};

/// A mesh, coded.
#[derive(Clone, Debug)]
pub(super) struct Made {
    pub coded: Encoded,
    pub error: f64,
    pub look_error: f64,
    pub bounds: LatticeBox,
    pub cone: Cone,
    /// Vertices moved to close cracks.
    pub joined: u64,
}

impl Made {
    fn new(
        piece: &Piece,
        cell: &Cell,
        step: i32,
        attributes: Attributes,
        error: f64,
        look_error: f64,
    ) -> Self {
        Self {
            coded: encode(piece, cell.corner(), step, attributes),
            error,
            look_error,
            bounds: LatticeBox::of(&piece.at),
            cone: Cone::of(&piece.at, &piece.triangles),
            joined: 0,
        }
    }
}

/// A mesh below the node, decoded.
pub(super) struct Below {
    pub piece: Piece,
    pub error: f64,
    pub look_error: f64,
}

/// The input in a leaf.
pub(super) fn leaf(plan: &Plan, cell: &Cell, polygons: &Polygons) -> Made {
    let step = plan.steps.of(cell, true);
    let piece = Piece::of_polygons(polygons, step);
    let cone = Cone::of_polygons(polygons);
    let error = plan.cube.slack() + rounding(step) * plan.cube.unit;
    let mut made = Made::new(&piece, cell, step, plan.attributes, error, error);
    made.cone = Cone::around(&[made.cone, cone]);
    made
}

/// The simplified surface of an inner node: what lies two levels below is joined and simplified as long as the error of both steps together is
/// at most the cell's edge over the resolution.
pub(super) fn inner(plan: &Plan, cell: &Cell, mesh: Mesh, below: Vec<Below>) -> Result<Made, HlodError> {
    let unit = plan.cube.unit;
    let attributes = if mesh == Mesh::Full { plan.attributes } else { Attributes::default() };
    let look_before = below.iter().map(|b| b.look_error).fold(0.0, f64::max);
    let parts = below.into_iter().map(|b| Part { piece: b.piece, error: b.error / unit }).collect();
    let budget = f64::from(cell.edge()) * unit / plan.resolution;
    let Gathered { piece, error, joined } = gather(cell, 2, parts, JOIN_SHARE * budget / unit);
    if piece.triangles.len() > MOST_GATHERED {
        return Err(HlodError::TooLarge { triangles: piece.triangles.len(), limit: MOST_GATHERED });
    }
    let before = (error * unit).next_up();
    let step = plan.steps.of(cell, false);
    let rounded = (rounding(step) * unit).next_up();
    let spent = if attributes.any() { before.max(look_before) } else { before };
    let tolerance = budget - spent - rounded;
    let frame = LocalFrame::of(cell, &plan.cube);
    let (piece, cloud) = thin::part(piece, cell, tolerance / unit - 2.0);
    let whole = piece.to_mesh(&frame, plan.cube.leave(cell.middle()), attributes)?;
    drop(piece);
    // Where the levels below have used up the tolerance, nothing is simplified.
    let (mesh, mut geometric, mut appearance) = if tolerance > budget / 64.0 && !whole.is_empty() {
        let walls = Walls {
            min: frame.local(cell.corner()),
            max: frame.local(cell.corner().map(|m| m + cell.edge())),
            tolerance: RIM_SHARE * budget,
            normal_rounding: NORMAL_ROUNDING,
        };
        let simple = simplify_between(&whole, tolerance, &plan.simplify(attributes), Some(&walls))?;
        (simple.mesh, simple.geometric.value, simple.appearance.map_or(0.0, |a| a.value))
    } else {
        (whole, 0.0, 0.0)
    };
    let mut piece = Piece::of_mesh(&mesh, &frame, step, attributes);
    if let Some(cloud) = cloud {
        let thinned = cloud.thinned(cell);
        piece = piece.joined(&thinned.piece, step);
        geometric = geometric.max(thinned.error * unit);
        appearance = appearance.max(thinned.error * unit);
    }
    let error = (before + geometric + rounded).next_up().next_up();
    let look_error = if attributes.any() { look_before + appearance + rounded } else { error };
    Ok(Made { joined, ..Made::new(&piece, cell, step, attributes, error, look_error) })
}

/// Triangles that a node may be made of. Surfaces stay far below it; millions of loose triangles, which nothing can stand for, do not.
const MOST_GATHERED: usize = 1 << 22;

/// How far anything may be moved to close cracks, over the tolerance of the node. Rims of two levels below are within twice their share of each other.
const JOIN_SHARE: f64 = 0.2;

/// How far rims may move, over the tolerance of the node: enough to leave few vertices, little enough that surfaces can follow.
const RIM_SHARE: f64 = 0.25;

impl Cone {
    fn of_polygons(polygons: &Polygons) -> Self {
        // Of three corners each, as rounding and degenerate corners would spoil others: the first triangle of a fan that has an area.
        let mut triangles = Vec::with_capacity(polygons.len());
        for r in polygons.iter() {
            let first = r.start as u32;
            triangles.extend((r.start as u32 + 1..r.end as u32 - 1).map(|i| [first, i, i + 1]));
        }
        Self::of(&polygons.at, &triangles)
    }
}
