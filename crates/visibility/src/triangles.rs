//! The triangles that are looked at: their numbers, their corners, and what a visible set counts.

use crate::VisibilityError;
use farsight_geometry::scene::Scene;
use farsight_geometry::{DAabb, Hit, TriangleMesh};
use glam::{DAffine3, DVec3};

/// The triangles of a mesh or of a scene's instances, numbered through, and the members of a visible set that they belong to.
///
/// Triangles of a scene are numbered instance by instance. Members are triangles unless
/// [`by_instance`](Self::by_instance) or [`with_members`](Self::with_members) says otherwise.
#[derive(Clone, Debug)]
pub struct Triangles<'a> {
    parts: Vec<Part<'a>>,
    count: u32,
    /// Member of each triangle; empty when every triangle is one.
    member_of: Vec<u32>,
    members: u32,
}

/// A placed mesh.
#[derive(Clone, Debug)]
struct Part<'a> {
    mesh: &'a TriangleMesh,
    first: u32,
    placement: Option<DAffine3>,
    mirrored: bool,
}

impl<'a> Triangles<'a> {
    /// The triangles of one mesh, as a caster over that mesh numbers them.
    pub fn of_mesh(mesh: &'a TriangleMesh) -> Self {
        let count = mesh.triangles().len() as u32;
        let part = Part { mesh, first: 0, placement: None, mirrored: false };
        Self { parts: vec![part], count, member_of: Vec::new(), members: count }
    }

    /// The triangles of all instances of a scene, as a caster over the scene names them.
    ///
    /// # Errors
    /// [`VisibilityError::TooManyTriangles`] beyond 2³² − 1.
    pub fn of_scene(scene: &'a Scene) -> Result<Self, VisibilityError> {
        let mut parts = Vec::with_capacity(scene.instances().len());
        let mut next = 0u64;
        for instance in scene.instances() {
            let mesh = scene.mesh_of(instance);
            let placement = Some(instance.world_from_mesh);
            let mirrored = instance.world_from_mesh.matrix3.determinant() < 0.0;
            parts.push(Part { mesh, first: next as u32, placement, mirrored });
            next += mesh.triangles().len() as u64;
            if next > u64::from(u32::MAX) {
                return Err(VisibilityError::TooManyTriangles { count: scene.placed_triangles() });
            }
        }
        Ok(Self { parts, count: next as u32, member_of: Vec::new(), members: next as u32 })
    }

    /// Counts whole instances instead of triangles: an instance is visible when one of its triangles is.
    #[must_use]
    pub fn by_instance(mut self) -> Self {
        self.member_of = Vec::with_capacity(self.count as usize);
        for (index, part) in self.parts.iter().enumerate() {
            self.member_of.resize(self.member_of.len() + part.mesh.triangles().len(), index as u32);
        }
        self.members = self.parts.len() as u32;
        self
    }

    /// Counts members of the caller's choice, such as clusters: `member_of[triangle]` is below `members`.
    ///
    /// # Errors
    /// [`VisibilityError::Members`] when there is not one entry a triangle, or one is out of range.
    pub fn with_members(mut self, member_of: Vec<u32>, members: u32) -> Result<Self, VisibilityError> {
        let bad = member_of.iter().position(|&m| m >= members);
        if member_of.len() != self.count as usize || bad.is_some() {
            let (entries, triangles) = (member_of.len(), self.count);
            return Err(VisibilityError::Members { entries, triangles, bad: bad.map(|t| t as u32) });
        }
        (self.member_of, self.members) = (member_of, members);
        Ok(self)
    }

    /// Number of triangles.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Number of members that there are to be seen.
    pub fn members(&self) -> u32 {
        self.members
    }

    /// Whether members are something else than triangles.
    pub(crate) fn is_grouped(&self) -> bool {
        !self.member_of.is_empty()
    }

    /// The member that a triangle belongs to.
    ///
    /// # Panics
    /// When there is no such triangle.
    #[inline]
    pub fn member(&self, triangle: u32) -> u32 {
        assert!(triangle < self.count, "triangle {triangle} of {}", self.count);
        if self.member_of.is_empty() { triangle } else { self.member_of[triangle as usize] }
    }

    /// The triangle that a ray met.
    #[inline]
    pub fn of_hit(&self, hit: &Hit) -> u32 {
        self.parts[hit.instance as usize].first + hit.triangle
    }

    /// World corners, counter-clockwise from the front.
    ///
    /// # Panics
    /// When there is no such triangle.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [DVec3; 3] {
        let at = match self.parts.len() {
            1 => 0,
            _ => self.parts.partition_point(|p| p.first <= triangle) - 1,
        };
        let part = &self.parts[at];
        part.corners(part.mesh.corners((triangle - part.first) as usize))
    }

    /// World corners of some triangles, appended to `corners`. Fetching them side by side lets the waits for memory overlap.
    pub(crate) fn gather(&self, triangles: impl Iterator<Item = u32>, corners: &mut Vec<[DVec3; 3]>) {
        corners.extend(triangles.map(|triangle| self.corners(triangle)));
    }

    /// Triangles whose boxes may overlap `bounds`, in order.
    pub(crate) fn near(&self, bounds: &DAabb) -> impl Iterator<Item = (u32, [DVec3; 3])> {
        let bounds = *bounds;
        let parts = self.parts.iter().filter(move |p| p.bounds().overlaps(&bounds));
        parts.flat_map(|part| {
            let corners = part.mesh.corner_iter().map(|corners| part.corners(corners));
            (part.first..).zip(corners)
        })
    }

    /// A number that differs, but for accidents, where any corner, placement or member does.
    pub(crate) fn fingerprint(&self) -> u64 {
        // The order of what is mixed counts; lengths keep lists apart.
        let mut sum = Mix(0);
        for part in &self.parts {
            sum.add(part.mesh.origin().to_array().map(f64::to_bits));
            sum.add(part.placement.unwrap_or_default().to_cols_array().map(f64::to_bits));
            sum.add([part.mesh.positions().len() as u64, part.mesh.triangles().len() as u64]);
            part.mesh.positions().iter().for_each(|p| sum.add(p.to_array().map(|x| x.to_bits().into())));
            part.mesh.triangles().iter().for_each(|t| sum.add(t.map(u64::from)));
        }
        sum.add([self.members.into(), self.parts.len() as u64]);
        self.member_of.iter().for_each(|&m| sum.add([m.into()]));
        sum.0
    }

    /// World box of all triangles.
    pub fn bounds(&self) -> DAabb {
        self.parts.iter().map(Part::bounds).fold(DAabb::EMPTY, DAabb::union)
    }
}

/// A sum of words that depends on their order.
struct Mix(u64);

impl Mix {
    fn add<const N: usize>(&mut self, words: [u64; N]) {
        let step = |sum: u64, word: u64| (sum ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
        self.0 = words.into_iter().fold(self.0, step);
    }
}

impl Part<'_> {
    #[inline]
    fn corners(&self, corners: [glam::Vec3; 3]) -> [DVec3; 3] {
        let [a, b, c] = corners.map(|p| self.mesh.origin() + p.as_dvec3());
        match &self.placement {
            None => [a, b, c],
            Some(placement) => {
                let [a, b, c] = [a, b, c].map(|p| placement.transform_point3(p));
                if self.mirrored { [a, c, b] } else { [a, b, c] }
            }
        }
    }

    fn bounds(&self) -> DAabb {
        let bounds = self.mesh.world_bounds();
        match &self.placement {
            None => bounds,
            // Corners are rounded on their way, but all alike: rounding keeps order.
            Some(placement) => bounds.transformed(placement),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::scene::Instance;
    use glam::Vec3;

    fn triangle() -> TriangleMesh {
        TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z], vec![[0, 1, 2], [0, 2, 3]]).unwrap()
    }

    #[test]
    fn triangles_of_a_scene_are_numbered_through() {
        let mut scene = Scene::new();
        let empty = scene.add_mesh(TriangleMesh::default());
        let mesh = scene.add_mesh(triangle());
        let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        for (mesh, world_from_mesh) in
            [(mesh, DAffine3::from_translation(DVec3::X * 10.0)), (empty, DAffine3::IDENTITY), (mesh, mirror)]
        {
            let instance = Instance { name: String::new(), mesh, world_from_mesh, material: None };
            scene.add_instance(instance).unwrap();
        }
        let triangles = Triangles::of_scene(&scene).unwrap();
        assert_eq!((triangles.count(), triangles.members()), (4, 4));
        assert_eq!(triangles.corners(1), [DVec3::X * 10.0, DVec3::new(10., 1., 0.), DVec3::new(10., 0., 1.)]);
        // Mirrored: still counter-clockwise from its front.
        assert_eq!(triangles.corners(2), [DVec3::ZERO, DVec3::Y, DVec3::NEG_X]);
        let hit = Hit { t: 1.0, instance: 2, triangle: 1, barycentrics: [0.0; 2], back_face: false };
        assert_eq!(triangles.of_hit(&hit), 3);
        let far = DAabb::new(DVec3::X * 9.0, DVec3::X * 20.0);
        assert_eq!(triangles.near(&far).map(|t| t.0).collect::<Vec<_>>(), [0, 1]);
        let grouped = triangles.by_instance();
        assert_eq!((grouped.members(), grouped.member(1), grouped.member(3)), (3, 0, 2));
    }

    #[test]
    fn fingerprints_tell_scenes_apart() {
        let mesh = triangle();
        let of_mesh = Triangles::of_mesh(&mesh);
        let moved = mesh.clone().with_origin(DVec3::X).unwrap();
        let turned = TriangleMesh::new(mesh.positions().to_vec(), vec![[1, 2, 0], [0, 2, 3]]).unwrap();
        let others = [
            Triangles::of_mesh(&moved),
            Triangles::of_mesh(&turned),
            of_mesh.clone().by_instance(),
            of_mesh.clone().with_members(vec![1, 0], 2).unwrap(),
        ];
        let mut prints: Vec<u64> = others.iter().map(Triangles::fingerprint).collect();
        prints.push(of_mesh.fingerprint());
        assert_eq!(Triangles::of_mesh(&mesh).fingerprint(), of_mesh.fingerprint());
        prints.sort_unstable();
        prints.dedup();
        assert_eq!(prints.len(), 5);
    }

    #[test]
    fn members_are_checked() {
        let mesh = triangle();
        let triangles = Triangles::of_mesh(&mesh);
        assert!(triangles.clone().with_members(vec![0], 1).is_err());
        let error = triangles.clone().with_members(vec![0, 1], 1).unwrap_err();
        assert!(error.to_string().contains("triangle 1"), "{error}");
        assert_eq!(triangles.with_members(vec![0, 0], 1).unwrap().member(1), 0);
    }
}
