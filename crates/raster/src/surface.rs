//! How a surface is shaded: albedo times light.

use crate::draw::{Fragment, PixelShader};
use crate::render::View;
use crate::scenes::vertex_normals;
use crate::shade::Lighting;
use crate::texture::MipMap;
use farsight_geometry::TriangleMesh;
use farsight_geometry::scene::{AlphaMode, Material};
use glam::{DAffine3, Mat3, Vec2, Vec3, Vec4};
use std::cell::Cell;
use std::collections::HashMap;

/// A side of a triangle of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Side {
    /// The triangle.
    pub triangle: u32,
    /// The corner it begins at, 0 to 2; it ends at the next.
    pub corner: u32,
    /// Unit normal of the surface around it: the triangle may be a sliver, whose own means nothing.
    pub normal: Vec3,
}

impl Side {
    /// The sides of a mesh between given pairs of vertices, with the normals around them; pairs that no triangle joins are left out.
    pub fn between(mesh: &TriangleMesh, pairs: &[[u32; 2]]) -> Vec<Self> {
        let normals = vertex_normals(mesh);
        let mut known: HashMap<[u32; 2], (u32, u32)> = HashMap::new();
        for (triangle, t) in (0..).zip(mesh.triangles()) {
            for corner in 0..3 {
                let [a, b] = [t[corner as usize], t[(corner as usize + 1) % 3]];
                known.insert([a.min(b), a.max(b)], (triangle, corner));
            }
        }
        let side = |&[a, b]: &[u32; 2]| {
            let &(triangle, corner) = known.get(&[a.min(b), a.max(b)])?;
            let normal = (normals[a as usize] + normals[b as usize]).normalize_or(normals[a as usize]);
            Some(Self { triangle, corner, normal })
        };
        pairs.iter().filter_map(side).collect()
    }

    /// The corners of the triangle that it joins.
    pub fn corners(self) -> [usize; 2] {
        [self.corner as usize % 3, (self.corner as usize + 1) % 3]
    }
}

/// What is drawn at once.
#[derive(Clone, Copy)]
pub(crate) struct Surface<'a> {
    pub mesh: &'a TriangleMesh,
    pub triangles: &'a [[u32; 3]],
    pub material: &'a Material,
    /// From the mesh's coordinates to those relative to the eye.
    pub relative: DAffine3,
}

/// Albedo times light.
pub(crate) struct SurfaceShader<'a> {
    surface: Surface<'a>,
    texture: Option<&'a MipMap>,
    lighting: &'a Lighting<'a>,
    normal_matrix: Mat3,
    haze: Option<(f32, Vec3)>,
    exposure: f32,
    /// The last triangle that was shaded, and its normal: of the mesh, and in world axes.
    face: Cell<(u32, [Vec3; 2])>,
}

impl<'a> SurfaceShader<'a> {
    pub fn new(surface: &Surface<'a>, view: &View<'a>) -> Self {
        let inverse = surface.relative.matrix3.inverse().transpose();
        let horizon = view.options.sky.map_or(Vec3::ZERO, |s| s[1]);
        Self {
            surface: *surface,
            texture: surface.material.texture.and_then(|t| view.textures.get(t.0 as usize)),
            lighting: view.lighting,
            normal_matrix: if inverse.is_finite() { inverse.as_mat3() } else { Mat3::IDENTITY },
            haze: view.options.haze.map(|d| (d, horizon)),
            exposure: view.options.exposure,
            face: Cell::new((u32::MAX, [Vec3::ZERO; 2])),
        }
    }

    /// A point of a side, at `t` along it; a pixel farther it is at `t + step`. Backs that are not drawn have no sides either.
    pub fn shade_side(&self, side: Side, t: f32, step: f32) -> Option<Vec4> {
        let [from, to] = side.corners();
        let (mut weights, mut gradient) = (Vec3::ZERO, Vec3::ZERO);
        (weights[from], weights[to]) = (1.0 - t, t);
        (gradient[from], gradient[to]) = (-step, step);
        let corners = self.surface.triangles[side.triangle as usize].map(|i| i as usize);
        let faces = [side.normal, (self.normal_matrix * side.normal).normalize_or_zero()];
        let away = faces[1].dot(self.point(corners, weights)) > 0.0;
        if away && !self.surface.material.two_sided {
            return None;
        }
        self.shade_at(corners, weights, faces, || [gradient; 2])
    }

    /// The colour of a point, premultiplied; `None` in a hole. `faces` are the flat normal there: of the mesh, and in world axes.
    fn shade_at(
        &self,
        corners: [usize; 3],
        weights: Vec3,
        faces: [Vec3; 2],
        gradients: impl FnOnce() -> [Vec3; 2],
    ) -> Option<Vec4> {
        let albedo = self.albedo(corners, weights, gradients);
        let alpha = match self.surface.material.alpha {
            AlphaMode::Mask { cutoff } if albedo.w < cutoff => return None,
            AlphaMode::Blend => albedo.w.clamp(0.0, 1.0),
            _ => 1.0,
        };
        let point = self.point(corners, weights);
        let [normal, face] = self.normals(corners, weights, faces, point);
        let light = self.lighting.radiance(point, normal, face);
        let mut colour = albedo.truncate() * light * self.exposure;
        if let Some((distance, horizon)) = self.haze {
            colour = colour.lerp(horizon, 1.0 - (-point.length() / distance).exp());
        }
        Some((colour * alpha).extend(alpha))
    }

    fn albedo(&self, corners: [usize; 3], weights: Vec3, gradients: impl FnOnce() -> [Vec3; 2]) -> Vec4 {
        let mut albedo = Vec4::from_array(self.surface.material.base_colour);
        if let (Some(texture), Some(uvs)) = (self.texture, self.surface.mesh.uvs()) {
            let uv = corners.map(|i| uvs[i]);
            let mix = |w: Vec3| -> Vec2 { uv[0] * w.x + uv[1] * w.y + uv[2] * w.z };
            let [dx, dy] = gradients();
            albedo *= texture.sample(mix(weights), texture.level_of(mix(dx), mix(dy)));
        }
        if let Some(colours) = self.surface.mesh.colours() {
            let c = corners.map(|i| linear_colour(colours[i]));
            albedo *= c[0] * weights.x + c[1] * weights.y + c[2] * weights.z;
        }
        albedo
    }

    /// A point relative to the eye.
    fn point(&self, corners: [usize; 3], weights: Vec3) -> Vec3 {
        let p = corners.map(|i| self.surface.mesh.positions()[i]);
        let local = p[0] * weights.x + p[1] * weights.y + p[2] * weights.z;
        self.surface.relative.transform_point3(local.as_dvec3()).as_vec3()
    }

    /// The normal of a triangle: of the mesh, and in world axes.
    fn faces(&self, triangle: u32, corners: [usize; 3]) -> [Vec3; 2] {
        let (known, mut faces) = self.face.get();
        if known != triangle {
            let p = corners.map(|i| self.surface.mesh.positions()[i].as_dvec3());
            let local = (p[1] - p[0]).cross(p[2] - p[0]).normalize_or_zero().as_vec3();
            faces = [local, (self.normal_matrix * local).normalize_or_zero()];
            self.face.set((triangle, faces));
        }
        faces
    }

    /// Shading normal and face normal, in world axes.
    fn normals(&self, corners: [usize; 3], weights: Vec3, faces: [Vec3; 2], point: Vec3) -> [Vec3; 2] {
        let smooth = self.surface.mesh.normals().map_or(Vec3::ZERO, |n| {
            n[corners[0]] * weights.x + n[corners[1]] * weights.y + n[corners[2]] * weights.z
        });
        let [local, face] = faces;
        let normal = if smooth == Vec3::ZERO { local } else { smooth };
        let normal = (self.normal_matrix * normal).normalize_or_zero();
        // Data need not wind its triangles to suit its normals.
        let face = if face.dot(normal) < 0.0 { -face } else { face };
        // A surface seen from behind is lit from behind.
        let behind = self.surface.material.two_sided && face.dot(point) > 0.0;
        if behind { [-normal, -face] } else { [normal, face] }
    }
}

fn linear_colour([r, g, b, a]: [u8; 4]) -> Vec4 {
    // Decoding a byte takes a power; 256 of them are kept.
    static TABLE: std::sync::LazyLock<[f32; 256]> =
        std::sync::LazyLock::new(|| std::array::from_fn(|i| crate::linear_of(i as u8)));
    let t = &*TABLE;
    Vec4::new(t[r as usize], t[g as usize], t[b as usize], f32::from(a) / 255.0)
}

impl PixelShader for SurfaceShader<'_> {
    fn shade(&self, fragment: &Fragment) -> Option<Vec4> {
        let corners = self.surface.triangles[fragment.triangle as usize].map(|i| i as usize);
        let faces = self.faces(fragment.triangle, corners);
        self.shade_at(corners, fragment.weights(), faces, || fragment.weight_gradients())
    }
}
