//! What a surface looks like: normals, texture coordinates and colours, and how far they are from where they were.
//!
//! The error of an attribute is a distance along the surface: how far away is the attribute that a point should have? It is
//! the difference between the attribute of an original vertex and the one interpolated above it, divided by how fast the facet's
//! attribute changes (Guthe 2004, section 3.1, for normals: angle over curvature). A facet is nowhere longer than its longest side, which
//! is therefore the most that the error can be said to be, and all that is said where the attribute does not change at all.
//! Errors along and off the surface add as squares.
//!
//! This is an estimate: it is taken at vertices, and the largest change stands for the change in any direction.

use crate::facet::{Facet, Shadow};
use crate::frame::Frame;
use crate::original::Original;
use farsight_geometry::TriangleMesh;
use glam::{DVec3, Vec2, Vec3, Vec4};

/// How far (in barycentric units) from a corner its attributes are looked up, so that they come from the facet's side of a seam.
const NUDGE: f64 = 1e-3;

/// Attributes of a point. What a mesh does not have is zero and stays so.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Look {
    pub normal: Vec3,
    pub uv: Vec2,
    /// Components from 0 to 1.
    pub colour: Vec4,
}

/// How much two looks differ: angle, and distances of texture coordinates and colours.
type Difference = [f32; 3];

/// Differences that nobody sees: a tenth of a degree, 1e-5 of a texture, half a step of a colour.
const UNSEEN: Difference = [1.7e-3, 1e-5, 0.5 / 255.0];

impl Look {
    fn mix(parts: [(Look, f32); 3]) -> Self {
        let mut sum = Self::default();
        for (look, weight) in parts {
            sum.normal += look.normal * weight;
            sum.uv += look.uv * weight;
            sum.colour += look.colour * weight;
        }
        Self { normal: sum.normal.normalize_or_zero(), ..sum }
    }

    /// What lies `t` of the way to another; normals are not brought to unit length.
    pub(crate) fn towards(&self, other: &Self, t: f32) -> Self {
        Self {
            normal: self.normal.lerp(other.normal, t),
            uv: self.uv.lerp(other.uv, t),
            colour: self.colour.lerp(other.colour, t),
        }
    }

    /// What lies `t` of the way to another.
    pub(crate) fn blend(&self, other: &Self, t: f32) -> Self {
        Self::mix([(*self, 1.0 - t), (*other, t), (*other, 0.0)])
    }

    /// Whether nobody sees a difference.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        let d = self.difference(other);
        (0..3).all(|a| d[a] <= UNSEEN[a])
    }

    fn difference(&self, other: &Self) -> Difference {
        let (a, b) = (self.normal, other.normal);
        // Accurate for small angles too; a missing normal differs from nothing.
        let angle = if a == Vec3::ZERO || b == Vec3::ZERO {
            0.0
        } else {
            2.0 * (a - b).length().atan2((a + b).length())
        };
        [angle, self.uv.distance(other.uv), self.colour.distance(other.colour)]
    }
}

/// Attributes over a facet, prepared for many questions.
pub(crate) struct Field {
    looks: [Look; 3],
    rates: [f64; 3],
    longest: f64,
}

impl Field {
    pub(crate) fn new(facet: &Facet, looks: [Look; 3]) -> Self {
        Self { looks, rates: rates(facet, &looks), longest: longest_side(facet) }
    }
}

/// The attributes of the input.
#[derive(Clone, Debug)]
pub(crate) struct Appearance<'a> {
    mesh: &'a TriangleMesh,
    normals: Option<Vec<Vec3>>,
    /// How far normals may be from what they were, in radians: differences below that say nothing.
    rounding: f32,
}

impl<'a> Appearance<'a> {
    /// `None` when the mesh has no attributes. Normals of vertices whose triangles are all smaller than `smooth_below` are smoothed.
    pub(crate) fn new(mesh: &'a TriangleMesh, smooth_below: f64) -> Option<Self> {
        let any = mesh.normals().is_some() || mesh.uvs().is_some() || mesh.colours().is_some();
        any.then(|| Self {
            mesh,
            normals: mesh.normals().map(|n| smoothed(mesh, n, smooth_below)),
            rounding: 0.0,
        })
    }

    /// Normals were rounded by at most an angle, once in the input and once in what will be made of it.
    pub(crate) fn with_rounding(self, angle: f32) -> Self {
        Self { rounding: 2.0 * angle, ..self }
    }

    /// How far along a line between two looks the one that `found` is lies from where it should be: `t` of the way.
    pub(crate) fn shift_on_line(&self, ends: [Look; 2], t: f32, found: &Look, length: f64) -> f64 {
        let there = ends[0].blend(&ends[1], t);
        let (off, rate) = (self.seen(found.difference(&there)), ends[0].difference(&ends[1]));
        (0..3).map(|a| shift(off[a], f64::from(rate[a]) / length, a, length)).fold(0.0, f64::max)
    }

    fn seen(&self, difference: Difference) -> Difference {
        [(difference[0] - self.rounding).max(0.0), difference[1], difference[2]]
    }

    pub(crate) fn corner(&self, original: &Original, t: u32, k: usize) -> Look {
        self.vertex(self.mesh.triangles()[original.source[t as usize] as usize][k])
    }

    /// The look of a vertex of the mesh.
    pub(crate) fn vertex(&self, v: u32) -> Look {
        let v = v as usize;
        Look {
            normal: self.normals.as_ref().map_or(Vec3::ZERO, |n| n[v]),
            uv: self.mesh.uvs().map_or(Vec2::ZERO, |uv| uv[v]),
            colour: self
                .mesh
                .colours()
                .map_or(Vec4::ZERO, |c| Vec4::from(c[v].map(|x| f32::from(x) / 255.0))),
        }
    }

    pub(crate) fn corners(&self, original: &Original, t: u32) -> [Look; 3] {
        [0, 1, 2].map(|k| self.corner(original, t, k))
    }

    /// Looks of a facet's corners, taken from the triangles below it, and the square of the largest error (off and along the
    /// surface together) of their corners; once that is above the limit, it need not be the largest. `worst_at` becomes where it is: a triangle and
    /// one of its corners.
    pub(crate) fn judge(
        &self,
        original: &Original,
        facet: &Facet,
        below: &[u32],
        limit_sq: f64,
        worst_at: &mut (u32, usize),
    ) -> ([Look; 3], f64) {
        let mut looks = [None; 3];
        let mut inside: Vec<(u32, usize, Shadow)> = Vec::with_capacity(below.len() * 2);
        for &t in below {
            let shadows = original.corners(t).map(|p| facet.shadow(p));
            for (k, s) in shadows.iter().enumerate() {
                if s.l.iter().all(|&l| l >= 0.0) {
                    inside.push((t, k, *s));
                }
            }
            for c in 0..3 {
                if looks[c].is_none() {
                    let mut at = [NUDGE; 3];
                    at[c] = 1.0 - 2.0 * NUDGE;
                    looks[c] = weights_at(&shadows, at).map(|w| {
                        // A vertex that stays keeps what it looks like, bit for bit.
                        let corners = original.corners(t);
                        match corners.iter().position(|p| *p == facet.corners[c]) {
                            Some(k) => self.corner(original, t, k),
                            None => self.mixed(original, t, w),
                        }
                    });
                }
            }
        }
        let looks: [Look; 3] = std::array::from_fn(|c| {
            looks[c].unwrap_or_else(|| self.nearest(original, below, facet.corners[c]))
        });
        let field = Field::new(facet, looks);
        let mut worst = 0.0f64;
        for (t, k, s) in inside {
            let error_sq = self.error_sq(&field, &s, &self.corner(original, t, k));
            if error_sq > worst {
                (worst, *worst_at) = (error_sq, (t, k));
            }
            if worst > limit_sq {
                break;
            }
        }
        (looks, worst)
    }

    /// The square of the error, off and along the surface together, of a point that should look like `wanted`.
    pub(crate) fn error_sq(&self, field: &Field, s: &Shadow, wanted: &Look) -> f64 {
        let there = Look::mix([0, 1, 2].map(|i| (field.looks[i], s.l[i] as f32)));
        let difference = self.seen(wanted.difference(&there));
        let along =
            (0..3).map(|a| shift(difference[a], field.rates[a], a, field.longest)).fold(0.0, f64::max);
        s.h * s.h + along * along
    }

    fn mixed(&self, original: &Original, t: u32, weights: [f64; 3]) -> Look {
        let corners = self.corners(original, t);
        Look::mix([0, 1, 2].map(|k| (corners[k], weights[k] as f32)))
    }

    /// The look at the triangle nearest to a point that none lies below.
    fn nearest(&self, original: &Original, below: &[u32], p: DVec3) -> Look {
        let mut best = (f64::INFINITY, Look::default());
        for &t in below {
            let corners = original.corners(t);
            let Some(facet) = Facet::new(corners) else { continue };
            let s = facet.shadow(p);
            let d = facet.distance_sq(p, &s);
            if d < best.0 {
                let inside = s.l.map(|l| l.max(0.0));
                let sum = inside[0] + inside[1] + inside[2];
                best = (d, self.mixed(original, t, inside.map(|l| l / sum)));
            }
        }
        best.1
    }
}

/// Barycentric coordinates, in a triangle seen from a facet with its right side up, of a point given in the facet's.
fn weights_at(shadows: &[Shadow; 3], at: [f64; 3]) -> Option<[f64; 3]> {
    let turn =
        |a: [f64; 3], b: [f64; 3], c: [f64; 3]| (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1]);
    let [a, b, c] = [shadows[0].l, shadows[1].l, shadows[2].l];
    let w = [turn(b, c, at), turn(c, a, at), turn(a, b, at)];
    let sum = w[0] + w[1] + w[2];
    (sum > 0.0 && w.iter().all(|&w| w >= 0.0)).then(|| w.map(|w| w / sum))
}

/// How fast each attribute changes over a facet, at most along a side.
fn rates(facet: &Facet, looks: &[Look; 3]) -> [f64; 3] {
    let mut rates = [0.0f64; 3];
    for i in 0..3 {
        let j = (i + 1) % 3;
        let length = facet.corners[i].distance(facet.corners[j]);
        let difference = looks[i].difference(&looks[j]);
        for a in 0..3 {
            rates[a] = rates[a].max(f64::from(difference[a]) / length);
        }
    }
    rates
}

fn longest_side(facet: &Facet) -> f64 {
    let c = &facet.corners;
    c[0].distance(c[1]).max(c[1].distance(c[2])).max(c[2].distance(c[0]))
}

/// The way along the surface that a difference of attribute `a` amounts to.
fn shift(difference: f32, rate: f64, a: usize, longest: f64) -> f64 {
    if difference <= UNSEEN[a] { 0.0 } else { (f64::from(difference) / rate).min(longest) }
}

/// Normals after one round of averaging at vertices whose triangles are all small: what is below the tolerance shades like noise.
fn smoothed(mesh: &TriangleMesh, normals: &[Vec3], below: f64) -> Vec<Vec3> {
    let mut sums = vec![Vec3::ZERO; normals.len()];
    let mut small = vec![true; normals.len()];
    for (t, c) in mesh.triangles().iter().zip(mesh.corner_iter()) {
        let longest = (c[0].distance(c[1])).max(c[1].distance(c[2])).max(c[2].distance(c[0]));
        let around: Vec3 = t.iter().map(|&v| normals[v as usize].normalize_or_zero()).sum();
        for &v in t {
            sums[v as usize] += around;
            small[v as usize] &= f64::from(longest) < below;
        }
    }
    let one = |i: usize| {
        let own = normals[i].normalize_or_zero();
        if small[i] && own != Vec3::ZERO { sums[i].try_normalize().unwrap_or(own) } else { own }
    };
    (0..normals.len()).map(one).collect()
}

/// Vertices with attributes, made from corners: those at one point that look alike become one.
#[derive(Debug, Default)]
pub(crate) struct Gathering {
    pub positions: Vec<Vec3>,
    looks: Vec<Look>,
    /// Vertices at each point, with how fast attributes change around them.
    at_point: Vec<Vec<(u32, [f64; 3])>>,
}

impl Gathering {
    pub(crate) fn new(points: usize) -> Self {
        Self { at_point: vec![Vec::new(); points], ..Self::default() }
    }

    /// The vertices of a face: a look that is not farther along the surface than `tolerance` from one that is already there becomes that.
    pub(crate) fn face(
        &mut self,
        frame: &Frame,
        corners: [u32; 3],
        points: [DVec3; 3],
        looks: &[Look; 3],
        tolerance: f64,
    ) -> [u32; 3] {
        let rates = Facet::new(points).map_or([0.0; 3], |f| rates(&f, looks));
        std::array::from_fn(|c| {
            let alike = |&(v, others): &(u32, [f64; 3])| {
                let d = self.looks[v as usize].difference(&looks[c]);
                (0..3).all(|a| f64::from(d[a]) <= f64::from(UNSEEN[a]) + tolerance * rates[a].max(others[a]))
            };
            if let Some(&(v, _)) = self.at_point[corners[c] as usize].iter().find(|&x| alike(x)) {
                return v;
            }
            let new = self.positions.len() as u32;
            self.positions.push(frame.leave(points[c]));
            self.looks.push(looks[c]);
            self.at_point[corners[c] as usize].push((new, rates));
            new
        })
    }

    /// A mesh with the attributes that `like` has.
    pub(crate) fn mesh(
        self,
        triangles: Vec<[u32; 3]>,
        like: &TriangleMesh,
    ) -> Result<TriangleMesh, farsight_geometry::MeshError> {
        let mut mesh = TriangleMesh::new(self.positions, triangles)?.with_origin(like.origin())?;
        if like.normals().is_some() {
            mesh = mesh.with_normals(self.looks.iter().map(|l| l.normal).collect())?;
        }
        if like.uvs().is_some() {
            mesh = mesh.with_uvs(self.looks.iter().map(|l| l.uv).collect())?;
        }
        if like.colours().is_some() {
            let byte = |x: f32| (x * 255.0).round() as u8;
            mesh = mesh.with_colours(self.looks.iter().map(|l| l.colour.to_array().map(byte)).collect())?;
        }
        Ok(mesh)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    fn facet() -> Facet {
        Facet::new([DVec3::ZERO, DVec3::X, DVec3::Y]).unwrap()
    }

    fn normal(angle: f32) -> Look {
        Look { normal: Vec3::new(angle.sin(), 0.0, angle.cos()), ..Look::default() }
    }

    #[test]
    fn an_angle_over_a_curvature_is_a_way() {
        let f = facet();
        let looks = [normal(0.0), normal(0.5), normal(0.0)];
        let r = rates(&f, &looks);
        assert!((r[0] - 0.5).abs() < 1e-6 && r[1] == 0.0);
        let d = normal(0.1).difference(&normal(0.0));
        assert!((shift(d[0], r[0], 0, 1.4) - 0.2).abs() < 1e-6);
        // Nothing changes: nothing is wrong, or all of the facet is.
        assert_eq!((shift(0.0, 0.0, 0, 1.4), shift(0.1, 0.0, 0, 1.4)), (0.0, 1.4));
        // Opposite normals and tiny angles are no special case.
        let pi = std::f32::consts::PI;
        assert!((normal(0.0).difference(&normal(pi))[0] - pi).abs() < 1e-5);
        assert!((normal(0.0).difference(&normal(1e-5))[0] - 1e-5).abs() < 1e-9);
    }

    #[test]
    fn points_are_found_in_triangles_seen_from_a_facet() {
        let f = facet();
        let t = [dvec3(-1.0, -1.0, 0.3), dvec3(3.0, -1.0, 0.1), dvec3(-1.0, 3.0, 0.2)];
        let shadows = t.map(|p| f.shadow(p));
        let at = [0.2, 0.5, 0.3];
        let w = weights_at(&shadows, at).unwrap();
        let p = t[0] * w[0] + t[1] * w[1] + t[2] * w[2];
        assert!((p.x - 0.5).abs() < 1e-12 && (p.y - 0.3).abs() < 1e-12);
        let turned = [shadows[0], shadows[2], shadows[1]];
        assert!(weights_at(&turned, at).is_none() && weights_at(&shadows, [9.0, -4.0, -4.0]).is_none());
    }
}
