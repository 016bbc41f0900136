//! Where a penumbra can be: wedges behind silhouette edges, and the quads in which they meet a receiver.
//!
//! A point that sees part of a light sees an edge of the occluder across it, and that edge is a silhouette edge from where the line of sight
//! ends on the light. So the wedges behind all edges that are silhouette edges for *some* point of the light hold the whole
//! penumbra, of any mesh, convex or not. The silhouette from the light's centre alone does not promise that.

use super::coverage::{disk_past_half_plane, polygon_past_half_space, sphere_past_half_space};
use farsight_geometry::scene::Light;
use farsight_geometry::{Plane, TriangleMesh};
use glam::{DVec2, DVec3};

/// An area light's shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A sphere.
    Sphere {
        /// Its centre.
        center: DVec3,
        /// Its radius.
        radius: f64,
    },
    /// A disk.
    Disk {
        /// Its centre.
        center: DVec3,
        /// Unit normal.
        normal: DVec3,
        /// Its radius.
        radius: f64,
    },
    /// A rectangle.
    Rectangle {
        /// Its centre.
        center: DVec3,
        /// From the centre to the middle of a side.
        half_u: DVec3,
        /// From the centre to the middle of a neighbouring side.
        half_v: DVec3,
    },
}

impl Shape {
    /// The shape of a scene's light; `None` for lights without an area.
    pub fn of_light(light: &Light) -> Option<Self> {
        match *light {
            Light::Sphere { center, radius, .. } => Some(Self::Sphere { center, radius }),
            Light::Disk { center, normal, radius, .. } => Some(Self::Disk { center, normal, radius }),
            Light::Rectangle { center, half_u, half_v, .. } => {
                Some(Self::Rectangle { center, half_u, half_v })
            }
            _ => None,
        }
    }

    /// Its centre.
    pub fn center(&self) -> DVec3 {
        match *self {
            Self::Sphere { center, .. } | Self::Disk { center, .. } | Self::Rectangle { center, .. } => {
                center
            }
        }
    }

    /// How far it reaches from its centre in the unit direction `d`.
    pub fn reach(&self, d: DVec3) -> f64 {
        match *self {
            Self::Sphere { radius, .. } => radius,
            Self::Disk { normal, radius, .. } => radius * d.cross(normal).length(),
            Self::Rectangle { half_u, half_v, .. } => d.dot(half_u).abs() + d.dot(half_v).abs(),
        }
    }

    /// The corners of a rectangle.
    fn corners(half_u: DVec3, half_v: DVec3) -> [DVec3; 4] {
        [-half_u - half_v, half_u - half_v, half_u + half_v, half_v - half_u]
    }

    /// Angles, seen from the origin of the plane with axes `u` (towards the centre, which is `distance` away) and `v`, of the tangents
    /// to the light's projection into that plane. `None` when the origin lies in or on it.
    fn tangents(&self, u: DVec3, v: DVec3, distance: f64) -> Option<[f64; 2]> {
        match *self {
            Self::Rectangle { half_u, half_v, .. } => {
                let angle = |c: DVec3| v.dot(c).atan2(distance + u.dot(c));
                let angles = Self::corners(half_u, half_v).map(angle);
                let (lo, hi) =
                    angles.iter().fold((f64::MAX, f64::MIN), |(lo, hi), &x| (lo.min(x), hi.max(x)));
                (distance > 0.0 && hi - lo < std::f64::consts::PI * (1.0 - 1e-9)).then_some([lo, hi])
            }
            Self::Sphere { radius, .. } => quadric_tangents(distance, radius, DVec2::ZERO),
            Self::Disk { normal, radius, .. } => {
                quadric_tangents(distance, radius, DVec2::new(u.dot(normal), v.dot(normal)))
            }
        }
    }
}

/// Tangents to the ellipse around (distance, 0) that a disk with a normal of the given components projects to (a circle when they are 0).
///
/// A line through the origin with unit normal n touches it when (n·c)² = R²·(1 − (n·m)²): a quadratic form in n.
fn quadric_tangents(distance: f64, radius: f64, normal: DVec2) -> Option<[f64; 2]> {
    let r_sq = radius * radius;
    let a = distance * distance - r_sq * (1.0 - normal.x * normal.x);
    let b = r_sq * normal.x * normal.y;
    let c = -r_sq * (1.0 - normal.y * normal.y);
    let discriminant = b * b - a * c;
    if a <= 1e-12 * distance * distance || discriminant < 0.0 {
        return None;
    }
    // n ∝ (x, 1); the tangent runs along (1, −x).
    let root = discriminant.sqrt();
    let angles = [(-b - root) / a, (-b + root) / a].map(|x| (-x).atan());
    Some([angles[0].min(angles[1]), angles[0].max(angles[1])])
}

/// Edges of a mesh with the faces beside them, for silhouettes from any light.
#[derive(Clone, Debug, Default)]
pub struct EdgeList {
    edges: Vec<MeshEdge>,
}

#[derive(Clone, Copy, Debug)]
struct MeshEdge {
    ends: [DVec3; 2],
    /// Third corners of the faces.
    apexes: [DVec3; 2],
    /// Planes of the two faces, when there are just two and they are wound alike; otherwise the edge counts as a silhouette edge for any light.
    planes: Option<[Plane; 2]>,
}

/// An edge across which a light may be partly seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SilhouetteEdge {
    /// Its ends, in the world.
    pub ends: [DVec3; 2],
    /// A point of the occluder beside it.
    pub beside: DVec3,
    /// Whether it is a silhouette edge from the light's centre; the others are so from some other point of the light.
    pub from_center: bool,
}

impl EdgeList {
    /// Collects the edges of a mesh; corners at equal places count as one.
    ///
    /// # Cost
    /// O(n log n); about 300 bytes an edge.
    pub fn new(mesh: &TriangleMesh) -> Self {
        let welded = mesh.welded().mesh;
        let at = |i: u32| welded.origin() + welded.positions()[i as usize].as_dvec3();
        let mut sides: Vec<(u32, u32, bool, u32)> = Vec::new();
        for t in welded.triangles() {
            let [a, b, c] = t.map(at);
            if (b - a).cross(c - a) == DVec3::ZERO {
                continue;
            }
            for i in 0..3 {
                let (p, q, apex) = (t[i], t[(i + 1) % 3], t[(i + 2) % 3]);
                sides.push((p.min(q), p.max(q), p < q, apex));
            }
        }
        sides.sort_unstable();
        let edges = sides.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)).map(|faces| {
            let ends = [at(faces[0].0), at(faces[0].1)];
            let apexes = [at(faces[0].3), at(faces[faces.len() - 1].3)];
            let plane = |forward: bool, apex: DVec3| {
                let normal = (ends[1] - ends[0]).cross(apex - ends[0]).normalize_or_zero();
                Plane::through(ends[0], if forward { normal } else { -normal })
            };
            let usual = faces.len() == 2 && faces[0].2 != faces[1].2;
            let planes = usual.then(|| [0, 1].map(|i: usize| plane(faces[i].2, apexes[i])));
            MeshEdge { ends, apexes, planes }
        });
        Self { edges: edges.collect() }
    }

    /// Number of edges.
    pub fn len(&self) -> usize {
        self.edges.len()
    }

    /// Whether there is no edge.
    pub fn is_empty(&self) -> bool {
        self.edges.is_empty()
    }

    /// Edges that are silhouette edges from some point of the light; never misses one.
    pub fn silhouette(&self, light: &Shape) -> impl Iterator<Item = SilhouetteEdge> + '_ {
        let light = *light;
        self.edges.iter().filter_map(move |e| {
            let edge = |apex: usize, from_center| SilhouetteEdge {
                ends: e.ends,
                beside: e.apexes[apex],
                from_center,
            };
            let Some(planes) = &e.planes else { return Some(edge(0, true)) };
            let sides = planes.map(|p| {
                let (at, reach) = (p.distance(light.center()), light.reach(p.normal));
                // Rounding of a distance between coordinates this large.
                let slack = 1e-14 * (light.center().length() + p.offset.abs());
                (at, reach + slack)
            });
            let all_front = sides.iter().all(|(at, reach)| at > reach);
            let all_back = sides.iter().all(|(at, reach)| *at < -reach);
            let from_center = (sides[0].0 > 0.0) != (sides[1].0 > 0.0);
            // The face towards the light is the one beside which the occluder lies.
            let apex = usize::from(sides[1].0 > sides[0].0);
            (!(all_front || all_back)).then(|| edge(apex, from_center))
        })
    }
}

/// Points from which an edge may be seen across a light.
// Nearly all are wedges; a box for each would cost more than the few others waste.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Penumbra {
    /// The wedge behind the edge.
    Wedge(Wedge),
    /// The edge's line touches the light: no plane through it has the light on one side, and no point behind it can be told to be in the
    /// umbra or fully lit by this edge.
    Everywhere(SilhouetteEdge),
}

/// The wedge between the two planes through an edge that touch the light, on the side away from the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wedge {
    /// The edge.
    pub edge: SilhouetteEdge,
    /// Unit direction, across the edge, of the border to where all of the light is seen.
    pub outer: DVec3,
    /// Unit direction of the shadow of the light's centre.
    pub middle: DVec3,
    /// Unit direction of the border to the umbra.
    pub inner: DVec3,
    light: Shape,
    /// Unit direction along the edge, and its length.
    along: DVec3,
    length: f64,
    /// Least and largest distance of the light along `-middle`, and along the edge.
    depth: [f64; 2],
    beside: [f64; 2],
}

impl Penumbra {
    /// The penumbra of an edge. Edges without length have none.
    pub fn new(edge: &SilhouetteEdge, light: &Shape) -> Option<Self> {
        let [a, b] = edge.ends;
        let length = a.distance(b);
        let along = (b - a).try_normalize()?;
        let to = light.center() - a;
        let across = to - along * to.dot(along);
        let distance = across.length();
        // A light this close to the edge's line, relative to its distance, is on it.
        if distance <= 1e-12 * to.length() {
            return Some(Self::Everywhere(*edge));
        }
        let u = across / distance;
        let mut v = along.cross(u);
        if v.dot(edge.beside - a) < 0.0 {
            v = -v;
        }
        let Some([away, towards]) = light.tangents(u, v, distance) else {
            return Some(Self::Everywhere(*edge));
        };
        let at = |angle: f64| -(u * angle.cos() + v * angle.sin());
        let (depth, beside) = (light.reach(u), light.reach(along));
        let center = along.dot(to);
        Some(Self::Wedge(Wedge {
            edge: *edge,
            // The light's end on the occluder's side shines past the edge to the other side.
            outer: at(towards),
            middle: -u,
            inner: at(away),
            light: *light,
            along,
            length,
            depth: [distance - depth, distance + depth],
            beside: [center - beside, center + beside],
        }))
    }

    /// Whether the edge may be seen across the light from a point: never false where it is.
    pub fn contains(&self, point: DVec3) -> bool {
        match self {
            Self::Wedge(w) => w.contains(point),
            Self::Everywhere(_) => true,
        }
    }
}

/// The quads in which a wedge meets a plane, as penumbra maps draw them: rows along the shadow's edge, each from the first end to the second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quads {
    /// Where all of the light is seen from.
    pub outer: [DVec3; 2],
    /// The shadow of the light's centre.
    pub middle: [DVec3; 2],
    /// Where none is.
    pub inner: [DVec3; 2],
}

impl Wedge {
    /// Whether a point lies in the wedge, between the ends as far as they can be told: never false where the edge is seen across the light.
    pub fn contains(&self, point: DVec3) -> bool {
        let p = point - self.edge.ends[0];
        let depth = p.dot(self.middle);
        // The slack covers rounding of coordinates relative to the edge.
        let slack = 1e-12 * (p.length() + self.depth[1]);
        if depth < -slack {
            return false;
        }
        let side = self.along.cross(self.middle);
        let position = p.dot(side);
        let border = |d: DVec3| (d.dot(self.middle), d.dot(side));
        let [(u0, v0), (u1, v1)] = [border(self.outer), border(self.inner)];
        // Between both borders: left of one and right of the other, whichever way round.
        let (c0, c1) = (u0 * position - v0 * depth, u1 * position - v1 * depth);
        let turn = (u0 * v1 - v0 * u1).signum();
        c0 * turn >= -slack && c1 * turn <= slack && self.within_ends(p.dot(self.along), depth, slack)
    }

    /// Whether a line from a point at `x` along the edge, `depth` behind it, to some point of the light passes between the edge's ends.
    fn within_ends(&self, x: f64, depth: f64, slack: f64) -> bool {
        let at = |l: f64, light_depth: f64| {
            if light_depth <= 0.0 { l } else { (x * light_depth + l * depth) / (light_depth + depth) }
        };
        let crossings = [
            at(self.beside[0], self.depth[0]),
            at(self.beside[0], self.depth[1]),
            at(self.beside[1], self.depth[0]),
            at(self.beside[1], self.depth[1]),
        ];
        let (lo, hi) = crossings.iter().fold((f64::MAX, f64::MIN), |(lo, hi), &c| (lo.min(c), hi.max(c)));
        // At no depth at all any light point will do; the crossing is the point itself.
        hi >= -slack && lo <= self.length + slack
    }

    /// Share of the light's area (of its solid angle for a sphere) that the edge, taken as endless, leaves visible from a point.
    pub fn visible(&self, point: DVec3) -> f32 {
        let to_edge = self.edge.ends[0] - point;
        let mut normal = self.along.cross(to_edge).normalize_or_zero();
        // Away from the occluder.
        let side = self.inner - self.outer;
        if normal.dot(side) > 0.0 {
            normal = -normal;
        }
        let center = self.light.center() - point;
        let offset = -normal.dot(center);
        match self.light {
            Shape::Sphere { radius, .. } => {
                let distance = center.length();
                if distance <= radius {
                    return 1.0;
                }
                sphere_past_half_space((offset / distance).asin() as f32, (radius / distance).asin() as f32)
            }
            Shape::Disk { normal: facing, radius, .. } => {
                // Distance of the centre, within the disk's plane, to the line in which the two planes meet.
                let slope = normal.cross(facing).length();
                disk_past_half_plane((offset / (slope * radius).max(f64::MIN_POSITIVE)) as f32)
            }
            Shape::Rectangle { half_u, half_v, .. } => {
                let corners = Shape::corners(half_u, half_v).map(|c| (center + c).as_vec3());
                polygon_past_half_space(&corners, normal.as_vec3(), (-normal).as_vec3()).area
            }
        }
    }

    /// Where the wedge meets a plane. `None` when one of its borders does not: the penumbra then has no end there.
    pub fn quads(&self, plane: &Plane) -> Option<Quads> {
        let row = |direction: DVec3| -> Option<[DVec3; 2]> {
            // The light's point that the border touches; the middle goes through the centre.
            let touch = self.touched(direction);
            let mut ends = self.edge.ends;
            for end in &mut ends {
                let ray = *end - touch;
                let (from, slope) = (plane.distance(*end), plane.normal.dot(ray));
                // Rays that run along the plane or away from it never meet it.
                if from == 0.0 {
                    continue;
                }
                let t = -from / slope;
                if !(t > 0.0 && t.is_finite()) {
                    return None;
                }
                *end += ray * t;
            }
            Some(ends)
        };
        Some(Quads { outer: row(self.outer)?, middle: row(self.middle)?, inner: row(self.inner)? })
    }

    /// The point of the light on a border of the wedge.
    fn touched(&self, direction: DVec3) -> DVec3 {
        let center = self.light.center();
        if direction == self.middle {
            return center;
        }
        // Normal of the tangent plane, away from the light: its centre lies against the middle.
        let n = self.along.cross(direction).normalize_or_zero();
        let n = if n.dot(self.middle) < 0.0 { -n } else { n };
        match self.light {
            Shape::Sphere { radius, .. } => center + n * radius,
            Shape::Disk { normal, radius, .. } => {
                center + (n - normal * n.dot(normal)).normalize_or_zero() * radius
            }
            Shape::Rectangle { half_u, half_v, .. } => {
                center + half_u * n.dot(half_u).signum() + half_v * n.dot(half_v).signum()
            }
        }
    }
}

#[cfg(test)]
#[path = "quads_tests.rs"]
mod tests;
