//! Points in place of small triangles.
//!
//! A triangle whose corners are within 2ε of its barycentre is covered by discs of radius ε at its corners and the middles of its sides: each of the four triangles
//! between them has its corners within ε of its own barycentre, so its smallest enclosing circle is no larger than ε, and every point of a triangle has a corner
//! within the radius of that circle (Guthe 2004, section 3.2). Points that share a cell of a grid are merged into the first of them, and the discs grow by the cell's diagonal, so that nothing is
//! uncovered.
//!
//! Points are made of what a node is decoded to. They take nothing on disk.

use crate::NodeMesh;
use glam::{Vec2, Vec3};

/// Cells of the grid in a radius.
const CELLS: f64 = 2.0;

/// A node's mesh, its small triangles as points; its buffers are reused.
#[derive(Clone, Debug, Default)]
pub struct Splats {
    /// Centres, relative to the mesh's origin.
    pub positions: Vec<Vec3>,
    /// Normals; empty without.
    pub normals: Vec<Vec3>,
    /// Texture coordinates; empty without.
    pub uvs: Vec<Vec2>,
    /// Colours; empty without.
    pub colours: Vec<[u8; 4]>,
    /// Triangles that stay, three of the mesh's vertices each.
    pub indices: Vec<u32>,
    /// Radius of the discs that cover what the points stand for. A drawn pixel is no farther than this from the mesh.
    pub radius: f32,
    cells: Cells,
    done: Vec<bool>,
}

/// A set of cells of the grid: a table of places in a list, each cell as near as there is room to where its coordinates say.
#[derive(Clone, Debug, Default)]
struct Cells {
    /// Places in the list plus one; zero where there is none. A power of two of them, at least twice as many as cells.
    slots: Vec<u32>,
    list: Vec<[i32; 3]>,
}

impl Cells {
    fn clear(&mut self) {
        self.slots.fill(0);
        self.list.clear();
    }

    /// Whether the cell was not there yet.
    fn insert(&mut self, cell: [i32; 3]) -> bool {
        if 2 * self.list.len() >= self.slots.len() {
            self.slots.clear();
            self.slots.resize((4 * self.list.len()).next_power_of_two().max(1 << 10), 0);
            for place in 0..self.list.len() {
                let slot = self.find(self.list[place]);
                self.slots[slot] = place as u32 + 1;
            }
        }
        let slot = self.find(cell);
        let is_new = self.slots[slot] == 0;
        if is_new {
            self.list.push(cell);
            self.slots[slot] = self.list.len() as u32;
        }
        is_new
    }

    /// The slot that a cell is in, or else the one it should be in.
    fn find(&self, cell: [i32; 3]) -> usize {
        let [x, y, z] = cell.map(|c| u64::from(c as u32));
        let mixed = (x.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ y.wrapping_mul(0xc2b2_ae3d_27d4_eb4f))
            .wrapping_add(z.wrapping_mul(0x1656_67b1_9e37_79f9));
        let mask = self.slots.len() - 1;
        let mut slot = (mixed ^ mixed >> 32) as usize & mask;
        while let Some(place) = self.slots[slot].checked_sub(1) {
            if self.list[place as usize] == cell {
                break;
            }
            slot = (slot + 1) & mask;
        }
        slot
    }
}

impl Splats {
    /// Replaces the triangles of a mesh whose corners are within `2 · reach` of their barycentre.
    ///
    /// A node is at its largest on the screen when its error is as many pixels as allowed: half a pixel is then its error's size, so that
    /// [`Tree::error`](crate::Tree::error) is the reach for points of about a pixel, as the paper has it. The finer the level, the smaller the reach against its triangles: leaves have no points.
    ///
    /// # Cost
    /// About 250 ns a small triangle; once, when the node is loaded.
    pub fn fill(&mut self, mesh: &NodeMesh, reach: f64) {
        let cell = (reach / CELLS) as f32;
        self.radius = (reach * (1.0 + 3f64.sqrt() / CELLS) * (1.0 + 1e-5)) as f32;
        self.positions.clear();
        self.normals.clear();
        self.uvs.clear();
        self.colours.clear();
        self.indices.clear();
        self.cells.clear();
        self.done.clear();
        self.done.resize(mesh.positions.len(), false);
        // A little less, for what rounding does to barycentre and distance.
        let limit_sq = (2.0 * reach * (1.0 - 1e-5)).powi(2) as f32;
        for &t in mesh.indices.as_chunks::<3>().0 {
            let corners = t.map(|v| mesh.positions[v as usize]);
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            if reach <= 0.0 || corners.iter().any(|c| c.distance_squared(middle) > limit_sq) {
                self.indices.extend(t);
                continue;
            }
            for i in 0..3 {
                let (a, b) = (t[i], t[(i + 1) % 3]);
                if !std::mem::replace(&mut self.done[a as usize], true) {
                    self.add(mesh, a, a, cell);
                }
                // The triangle on the other side has the same middle, whose cell is taken by then.
                self.add(mesh, a, b, cell);
            }
        }
    }

    /// Adds the middle of two vertices, unless its cell has a point.
    fn add(&mut self, mesh: &NodeMesh, a: u32, b: u32, cell: f32) {
        let (a, b) = (a as usize, b as usize);
        let at = (mesh.positions[a] + mesh.positions[b]) * 0.5;
        let key = (at / cell).floor().to_array().map(|x| x as i32);
        if !self.cells.insert(key) {
            return;
        }
        self.positions.push(at);
        if !mesh.normals.is_empty() {
            self.normals.push((mesh.normals[a] + mesh.normals[b]).normalize_or_zero());
        }
        if !mesh.uvs.is_empty() {
            self.uvs.push((mesh.uvs[a] + mesh.uvs[b]) * 0.5);
        }
        if !mesh.colours.is_empty() {
            let (c, d) = (mesh.colours[a], mesh.colours[b]);
            self.colours.push([0, 1, 2, 3].map(|k| ((u16::from(c[k]) + u16::from(d[k])) / 2) as u8));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::hard_cases;

    #[allow(clippy::field_reassign_with_default)] // Other fields are private.
    fn ball(n: u32) -> NodeMesh {
        let ball = hard_cases::bumpy_ball(n);
        let mut mesh = NodeMesh::default();
        mesh.positions = ball.positions().to_vec();
        mesh.normals = ball.positions().iter().map(|p| p.normalize()).collect();
        mesh.indices = ball.triangles().as_flattened().to_vec();
        mesh
    }

    #[test]
    fn discs_cover_what_they_stand_for() {
        let mesh = ball(10);
        let mut splats = Splats::default();
        for reach in [0.02, 0.05, 0.2] {
            splats.fill(&mesh, reach);
            let kept: std::collections::HashSet<[u32; 3]> =
                splats.indices.as_chunks::<3>().0.iter().copied().collect();
            assert_eq!(splats.normals.len(), splats.positions.len());
            let mut replaced = 0;
            for t in mesh.indices.as_chunks::<3>().0.iter().filter(|t| !kept.contains(*t)) {
                replaced += 1;
                let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
                for i in 0..=8u8 {
                    for j in 0..=8 - i {
                        let (u, v) = (f32::from(i) / 8.0, f32::from(j) / 8.0);
                        let p = a + (b - a) * u + (c - a) * v;
                        let near =
                            splats.positions.iter().map(|q| q.distance(p)).fold(f32::INFINITY, f32::min);
                        assert!(near <= splats.radius, "{reach}: {near} of {}", splats.radius);
                    }
                }
            }
            assert_eq!(replaced + kept.len(), mesh.indices.len() / 3);
            assert!(reach < 0.05 || replaced > 200, "{reach}: {replaced}");
        }
        // All within one cell: one point.
        splats.fill(&mesh, 100.0);
        assert!(splats.indices.is_empty() && splats.positions.len() <= 8);
    }

    #[test]
    fn nothing_is_replaced_without_reach() {
        let mesh = ball(4);
        let mut splats = Splats::default();
        splats.fill(&mesh, 0.0);
        assert_eq!((splats.indices.len(), splats.positions.len()), (mesh.indices.len(), 0));
    }
}
