//! How far a surface is off where it could not be certified: by branch and bound, and only as far as it matters.
//!
//! The answer is one number, the largest distance anywhere. So what is measured first raises the floor for what comes next: below it, a certificate or a
//! rough bound is as good as an exact distance.

use crate::HlodError;
use crate::certify::{Bad, CertifiedSurface, beyond};
use crate::complex::Complex;
use crate::fast::Log;
use crate::frame::{Frame, SLACK};
use crate::original::{NONE, Original};
use crate::simplify::measuring;
use farsight_geometry::TriangleMesh;
use farsight_geometry::distance::{Surface, one_sided};

/// A surface and what was made of it.
pub(crate) struct Measure<'a> {
    pub mesh: &'a TriangleMesh,
    pub simple: &'a TriangleMesh,
    pub original: &'a Original,
    pub frame: &'a Frame,
    pub log: Log,
    pub tolerance: f64,
}

impl Measure<'_> {
    /// An upper bound of the distance of both surfaces, where some of it is certified and the rest is bad.
    pub(crate) fn bound(&self, state: &CertifiedSurface, bad: Bad) -> Result<f64, HlodError> {
        let Self { mesh, simple, original, frame, .. } = self;
        let certified = |reach: f64| frame.length_out(reach + SLACK).next_up();
        let mut upper = certified(state.reach());
        let surrounded = Surrounded { original, surface: &state.surface, log: &self.log };
        // Faces of the result are numbered as they come among the live ones.
        let mut numbers = vec![NONE; state.surface.faces.len()];
        state.surface.live_faces().enumerate().for_each(|(i, f)| numbers[f as usize] = i as u32);
        let part = |of: &TriangleMesh, triangles: Vec<[u32; 3]>| {
            TriangleMesh::new(of.positions().to_vec(), triangles)?.with_origin(of.origin())
        };
        let faces = |list: &[u32]| {
            part(simple, list.iter().map(|&f| simple.triangles()[numbers[f as usize] as usize]).collect())
        };
        let triangles = |list: &[u32]| {
            let source = |&t: &u32| mesh.triangles()[original.source[t as usize] as usize];
            part(mesh, list.iter().map(source).collect())
        };
        // The simplified surface is the quicker one to search.
        if !bad.triangles.is_empty() {
            let around = faces(&surrounded.faces_around(&bad.triangles))?;
            upper = upper.max(self.distance(&triangles(&bad.triangles)?, &around, simple, upper));
        }
        let limit = (frame.length_in(upper) - SLACK).min(4.0);
        let (left, reach) = beyond(original, state, &bad.faces, limit * limit);
        upper = upper.max(certified(reach));
        if !left.is_empty() {
            let around = triangles(&surrounded.triangles_around(&left))?;
            upper = upper.max(self.distance(&faces(&left)?, &around, mesh, upper));
        }
        Ok(upper)
    }

    /// The distance from a part of one surface to the other, if it is above the floor. That to what lies around is never below that to the
    /// whole, and the same unless something else is nearer: across a crack.
    fn distance(&self, of: &TriangleMesh, around: &TriangleMesh, whole: &TriangleMesh, floor: f64) -> f64 {
        let options = measuring(self.tolerance).with_floor(floor);
        let to = |surface: &TriangleMesh| one_sided(of, &Surface::new(surface), &options).upper;
        let has_cracks = self.original.neighbours.iter().flatten().any(|&n| n == NONE);
        let few = around.triangles().len() < whole.triangles().len() / if has_cracks { 2 } else { 1 };
        if around.is_empty() || !few {
            return to(whole);
        }
        let near = to(around);
        if near <= floor || !has_cracks { near } else { near.min(to(whole)) }
    }
}

/// A surface and what became of it, by what lies where.
struct Surrounded<'a> {
    original: &'a Original,
    surface: &'a Complex,
    log: &'a Log,
}

impl Surrounded<'_> {
    /// Original triangles around some faces.
    fn triangles_around(&self, faces: &[u32]) -> Vec<u32> {
        let marked = self.around(faces.iter().flat_map(|&f| self.surface.faces[f as usize]));
        let near = |v: &u32| marked[self.log.representative(*v) as usize];
        let all = 0..self.original.triangles.len() as u32;
        all.filter(|&t| self.original.triangles[t as usize].iter().any(near)).collect()
    }

    /// Faces around some original triangles.
    fn faces_around(&self, triangles: &[u32]) -> Vec<u32> {
        let corners = triangles.iter().flat_map(|&t| self.original.triangles[t as usize]);
        let marked = self.around(corners.map(|v| self.log.representative(v)));
        let near = |f: &u32| self.surface.faces[*f as usize].iter().any(|&v| marked[v as usize]);
        self.surface.live_faces().filter(near).collect()
    }

    /// Marks the vertices around given ones, over the faces that they share.
    fn around(&self, vertices: impl Iterator<Item = u32>) -> Vec<bool> {
        let mut marked = vec![false; self.original.points.len()];
        for f in vertices.flat_map(|v| self.surface.faces_at(v)) {
            self.surface.faces[f as usize].iter().for_each(|&v| marked[v as usize] = true);
        }
        marked
    }
}
