//! Meshes of nodes in few bytes: connectivity as letters, positions and attributes as what a prediction misses.
//!
//! The *shape* (positions and triangles) and the *looks* (attributes) are apart, so that who needs no looks reads none. Positions are whole steps of the
//! node's lattice, relative to its cell.

mod bits;
mod connectivity;
mod looks;

pub(crate) use looks::{Looks, NORMAL_ROUNDING, decode_looks};

use crate::cell::Lattice;
use crate::piece::{Attributes, Piece};
use bits::{BitReader, BitWriter, Numbers, put_block, take_block};
use connectivity::{Origin, Scratch};

/// A coded mesh.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Encoded {
    pub shape: Vec<u8>,
    /// Empty without attributes.
    pub looks: Vec<u8>,
    /// Vertices of the shape: one a position.
    pub positions: u32,
    /// Vertices that also differ in their looks; those of the shape come first.
    pub vertices: u32,
    pub triangles: u32,
}

/// A decoded shape; its buffers are reused.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shape {
    /// In steps, relative to the cell.
    pub at: Vec<Lattice>,
    pub indices: Vec<u32>,
    /// Sides with nothing beyond whose ends are on the same wall of the cell.
    pub rims: Vec<[u32; 2]>,
    origins: Vec<Origin>,
    scratch: Scratch,
}

/// Codes a mesh whose vertices are multiples of `step` from `corner`.
pub(crate) fn encode(piece: &Piece, corner: Lattice, step: i32, attributes: Attributes) -> Encoded {
    let at = |v: u32| {
        let p = piece.at[v as usize];
        [0, 1, 2].map(|k| (p[k] - corner[k]) / step)
    };
    // Vertices at one position are one for the shape.
    let (mut first, mut position_of) = (Vec::new(), vec![0u32; piece.at.len()]);
    let mut sorted: Vec<u32> = (0..piece.at.len() as u32).collect();
    sorted.sort_unstable_by_key(|&v| (piece.at[v as usize], v));
    for same in sorted.chunk_by(|&a, &b| piece.at[a as usize] == piece.at[b as usize]) {
        same.iter().for_each(|&v| position_of[v as usize] = first.len() as u32);
        first.push(same[0]);
    }
    let triangles: Vec<[u32; 3]> =
        piece.triangles.iter().map(|t| t.map(|v| position_of[v as usize])).collect();
    let walk = connectivity::encode(first.len(), &triangles);
    let positions: Vec<Lattice> = walk.order.iter().map(|&p| at(first[p as usize])).collect();
    let (mut writer, mut numbers) = (BitWriter::default(), [Numbers::default(); 3]);
    for (v, origin) in walk.origins.iter().enumerate() {
        let guess = predicted(&positions[..v], *origin);
        let off = [0, 1, 2].map(|k| positions[v][k].wrapping_sub(guess[k]));
        Numbers::put(&mut numbers, &mut writer, off);
    }
    let mut shape = Vec::new();
    put_block(&walk.bytes, &mut shape);
    shape.extend(writer.finish());
    let (looks, vertices) = if attributes.any() && !piece.looks.is_empty() {
        looks::encode(piece, &position_of, &walk, &positions, attributes)
    } else {
        (Vec::new(), positions.len() as u32)
    };
    Encoded { shape, looks, positions: positions.len() as u32, vertices, triangles: triangles.len() as u32 }
}

/// Where a new vertex is expected: the parallelogram over the side.
#[inline(always)]
fn predicted(at: &[Lattice], origin: Origin) -> Lattice {
    let place = |v: u32| at.get(v as usize).copied().unwrap_or_default();
    let (a, b, c) = (place(origin.from), place(origin.to), place(origin.apex));
    let one = |a: i32, b: i32, c: i32| a.wrapping_add(b).wrapping_sub(c);
    [one(a[0], b[0], c[0]), one(a[1], b[1], c[1]), one(a[2], b[2], c[2])]
}

/// Decodes a shape of so many positions and triangles in a cell of `edge` steps; `false` for what no encoder wrote.
pub(crate) fn decode_shape(
    bytes: &[u8],
    positions: u32,
    triangles: u32,
    edge: i32,
    into: &mut Shape,
) -> bool {
    // A letter has a bit at least, and a vertex three.
    let plausible =
        u64::from(triangles) <= 8 * bytes.len() as u64 && u64::from(positions) <= 8 * bytes.len() as u64;
    plausible && decode(bytes, positions as usize, triangles as usize, edge, into).is_some()
}

fn decode(mut bytes: &[u8], positions: usize, triangles: usize, edge: i32, into: &mut Shape) -> Option<()> {
    let Shape { at, indices, rims, origins, scratch } = into;
    indices.clear();
    indices.resize(3 * triangles, 0);
    origins.clear();
    origins.resize(positions, Origin::default());
    at.clear();
    at.resize(positions, [0; 3]);
    rims.clear();
    let walk = take_block(&mut bytes)?;
    connectivity::decode(walk, scratch, indices.as_chunks_mut::<3>().0, origins, rims)?;
    let (mut reader, mut numbers) = (BitReader::new(bytes), [Numbers::default(); 3]);
    for (v, &origin) in origins.iter().enumerate() {
        let [x, y, z] = predicted(at, origin);
        let off = Numbers::take(&mut numbers, &mut reader);
        at[v] = [x.wrapping_add(off[0]), y.wrapping_add(off[1]), z.wrapping_add(off[2])];
    }
    // Of all sides with nothing beyond, those on a wall.
    rims.retain(|&side| {
        let [a, b] = side.map(|v| at.get(v as usize).copied().unwrap_or_default());
        (0..3).any(|k| a[k] == b[k] && (a[k] == 0 || a[k] == edge))
    });
    (!reader.overran()).then_some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::appearance::Look;
    use farsight_geometry::hard_cases;
    use glam::{Vec2, Vec3, Vec4};

    fn corners(piece: &Piece) -> Vec<[(Lattice, Option<[i32; 9]>); 3]> {
        let look = |v: usize| piece.looks.get(v).map(|l| l.to_array().map(|x| (x * 200.0).round() as i32));
        let mut all: Vec<_> = piece
            .triangles
            .iter()
            .map(|t| {
                let mut c = t.map(|v| (piece.at[v as usize], look(v as usize)));
                let first = (0..3).min_by_key(|&i| c[i]).unwrap();
                c.rotate_left(first);
                c
            })
            .collect();
        all.sort_unstable();
        all
    }

    fn piece(mesh: &farsight_geometry::TriangleMesh, with_looks: bool, seams: bool) -> Piece {
        let scale = 1000.0 / mesh.bounds().diagonal().max(1e-30);
        let at = |p: &Vec3| (*p * scale).to_array().map(|x| (x.clamp(-1e6, 1e6)) as i32 * 4 + 4096);
        let mut piece = Piece {
            at: mesh.positions().iter().map(at).collect(),
            looks: vec![],
            triangles: mesh.triangles().to_vec(),
        };
        if seams {
            let t = piece.triangles.clone();
            piece.at = t.iter().flatten().map(|&v| piece.at[v as usize]).collect();
            piece.triangles = (0..t.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        }
        if with_looks {
            piece.looks = (0..piece.at.len())
                .map(|i| Look {
                    // Rounded as the codec does, so that all comes back as it is.
                    normal: Vec3::new((i as f32).sin(), (i as f32 * 0.3).cos(), 0.4).normalize(),
                    uv: Vec2::new(i as f32 * 0.25, -1.5),
                    colour: Vec4::new((i % 256) as f32, 7.0, 255.0, 255.0) / 255.0,
                })
                .map(|look| looks::rounded_look(&look))
                .collect();
        }
        piece.compacted()
    }

    #[test]
    fn pieces_come_back_with_their_looks() {
        let all = Attributes { normals: true, uvs: true, colours: true };
        let meshes = hard_cases::meshes().into_iter().map(|h| h.mesh);
        for mesh in meshes.chain([hard_cases::bumpy_ball(12)]) {
            for (with_looks, seams) in [(false, false), (true, false), (true, true)] {
                let attributes = if with_looks { all } else { Attributes::default() };
                let piece = piece(&mesh, with_looks, seams);
                let coded = encode(&piece, [4096 - 40_000, 0, 0], 4, attributes);
                let mut shape = Shape::default();
                let (p, t) = (coded.positions, coded.triangles);
                assert!(decode_shape(&coded.shape, p, t, 1 << 20, &mut shape));
                let mut looks = Looks::default();
                if with_looks && coded.vertices > 0 {
                    assert!(decode_looks(&coded.looks, coded.vertices, attributes, &mut shape, &mut looks));
                }
                let mut vertices: Vec<Look> = Vec::new();
                if with_looks {
                    vertices = (0..looks.normals.len()).map(|v| looks.look(v)).collect();
                }
                let back = Piece {
                    at: shape.at.iter().map(|p| [p[0] * 4 + 4096 - 40_000, p[1] * 4, p[2] * 4]).collect(),
                    looks: vertices,
                    triangles: shape.indices.as_chunks::<3>().0.to_vec(),
                };
                assert_eq!(corners(&piece), corners(&back));
            }
        }
    }

    #[test]
    fn rims_are_open_sides_on_walls() {
        // Two triangles: a square whose left side is at 0 and right side at the wall 100.
        let at = vec![[0, 10, 10], [100, 10, 10], [100, 90, 10], [0, 90, 10]];
        let piece = Piece { at, looks: vec![], triangles: vec![[0, 1, 2], [0, 2, 3]] };
        let coded = encode(&piece, [0; 3], 1, Attributes::default());
        let mut shape = Shape::default();
        assert!(decode_shape(&coded.shape, 4, 2, 100, &mut shape));
        let mut rims: Vec<i32> = shape.rims.iter().map(|r| shape.at[r[0] as usize][0]).collect();
        rims.sort_unstable();
        assert_eq!(rims, [0, 100]);
    }
}
