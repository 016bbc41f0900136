//! A scene: meshes, materials, instances, lights and cameras. What importers and generators return.
//!
//! Everything is checked when it is added, so a [`Scene`] never holds an index that leads nowhere.

use crate::bounds::DAabb;
use crate::camera::Camera;
use crate::mesh::{MeshError, TriangleMesh};
use glam::{DAffine3, DVec3, Vec3};

/// Index of a mesh in its scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MeshId(pub u32);

/// Index of a material in its scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MaterialId(pub u32);

/// Index of a texture in its scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TextureId(pub u32);

/// A picture, row by row from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texture {
    width: u32,
    height: u32,
    texels: Vec<[u8; 4]>,
}

impl Texture {
    /// Takes sRGB-encoded red, green, blue and linear alpha.
    ///
    /// # Errors
    /// [`SceneError::TextureSize`] when a side is zero or the number of texels is not `width · height`.
    pub fn new(width: u32, height: u32, texels: Vec<[u8; 4]>) -> Result<Self, SceneError> {
        if width == 0 || height == 0 || texels.len() as u64 != u64::from(width) * u64::from(height) {
            return Err(SceneError::TextureSize { width, height, texels: texels.len() });
        }
        Ok(Self { width, height, texels })
    }

    /// Width in texels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in texels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The texels, row by row from the top.
    pub fn texels(&self) -> &[[u8; 4]] {
        &self.texels
    }
}

/// What a material's alpha means.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum AlphaMode {
    /// Ignored.
    #[default]
    Opaque,
    /// Texels with less alpha than `cutoff` are holes.
    Mask {
        /// The smallest alpha that is solid.
        cutoff: f32,
    },
    /// The share of what is behind that the surface covers.
    Blend,
}

/// How a surface looks: diffuse albedo, cut-outs, sides.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name for people.
    pub name: String,
    /// Linear red, green, blue, alpha; multiplies the texture and the vertex colour.
    pub base_colour: [f32; 4],
    /// Texture of the base colour, by the mesh's uvs.
    pub texture: Option<TextureId>,
    /// What alpha means.
    pub alpha: AlphaMode,
    /// Whether the back of a triangle is drawn.
    pub two_sided: bool,
}

impl Default for Material {
    /// Opaque, two-sided light grey.
    fn default() -> Self {
        Self {
            name: String::new(),
            base_colour: [0.75, 0.75, 0.75, 1.0],
            texture: None,
            alpha: AlphaMode::Opaque,
            two_sided: true,
        }
    }
}

/// A mesh placed in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// Name for people.
    pub name: String,
    /// What is placed.
    pub mesh: MeshId,
    /// Where. Applied to the mesh's own world positions (origin + local position).
    pub world_from_mesh: DAffine3,
    /// How it looks; `None` is [`Material::default`].
    pub material: Option<MaterialId>,
}

/// A light. Directions are those in which light travels; colours are linear. Strengths are in whatever unit the scene has throughout: what matters here is how they compare.
/// Files in photometric units (glTF: candela and lux) keep their numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Light {
    /// Parallel light, such as the sun.
    Directional {
        /// Unit direction of travel.
        direction: DVec3,
        /// Irradiance on a surface facing the light.
        irradiance: Vec3,
        /// Half of the angle that the source spans, in radians; zero casts hard shadows.
        angular_radius: f64,
    },
    /// A point.
    Point {
        /// Where it is.
        position: DVec3,
        /// Radiant intensity.
        intensity: Vec3,
    },
    /// A point that shines into a cone.
    Spot {
        /// Where it is.
        position: DVec3,
        /// Unit direction of the cone's axis.
        direction: DVec3,
        /// Half the angle of the cone, in radians.
        half_angle: f64,
        /// Radiant intensity on the axis.
        intensity: Vec3,
    },
    /// A glowing sphere.
    Sphere {
        /// Its centre.
        center: DVec3,
        /// Its radius.
        radius: f64,
        /// Radiance.
        radiance: Vec3,
    },
    /// A disk that glows on the side of its normal.
    Disk {
        /// Its centre.
        center: DVec3,
        /// Unit normal.
        normal: DVec3,
        /// Its radius.
        radius: f64,
        /// Radiance.
        radiance: Vec3,
    },
    /// A rectangle that glows on the side of `half_u × half_v`.
    Rectangle {
        /// Its centre.
        center: DVec3,
        /// From the centre to the middle of one side.
        half_u: DVec3,
        /// From the centre to the middle of a neighbouring side; perpendicular to `half_u`.
        half_v: DVec3,
        /// Radiance.
        radiance: Vec3,
    },
}

/// Why something could not be added to a scene or moved in it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// An id leads nowhere.
    #[error("there is no {what} {index}; the scene has {count}")]
    NoSuch {
        /// "mesh", "material", "texture" or "instance".
        what: &'static str,
        /// The index asked for.
        index: u32,
        /// How many there are.
        count: usize,
    },
    /// A number of the named item is NaN, infinite or out of its range.
    #[error("{what} '{name}': {field} is not usable")]
    Value {
        /// "instance", "material" or "light".
        what: &'static str,
        /// Its name or number.
        name: String,
        /// The field.
        field: &'static str,
    },
    /// A texture's sides and its number of texels do not agree.
    #[error("a texture of {width} x {height} cannot have {texels} texels")]
    TextureSize {
        /// Width.
        width: u32,
        /// Height.
        height: u32,
        /// Texels given.
        texels: usize,
    },
}

/// Meshes, how they look, where they stand, what lights them and who looks.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    meshes: Vec<TriangleMesh>,
    materials: Vec<Material>,
    textures: Vec<Texture>,
    instances: Vec<Instance>,
    lights: Vec<Light>,
    cameras: Vec<Camera>,
}

impl Scene {
    /// An empty scene.
    pub fn new() -> Self {
        Self::default()
    }

    /// A scene with one mesh where it is.
    pub fn of_mesh(mesh: TriangleMesh) -> Self {
        let mut scene = Self::new();
        let id = scene.add_mesh(mesh);
        scene.instances.push(Instance {
            name: "mesh".into(),
            mesh: id,
            world_from_mesh: DAffine3::IDENTITY,
            material: None,
        });
        scene
    }

    /// Adds a mesh; it is drawn where instances place it.
    pub fn add_mesh(&mut self, mesh: TriangleMesh) -> MeshId {
        self.meshes.push(mesh);
        MeshId(self.meshes.len() as u32 - 1)
    }

    /// Adds a texture.
    pub fn add_texture(&mut self, texture: Texture) -> TextureId {
        self.textures.push(texture);
        TextureId(self.textures.len() as u32 - 1)
    }

    /// Adds a material.
    ///
    /// # Errors
    /// When its texture does not exist or a colour is not finite.
    pub fn add_material(&mut self, material: Material) -> Result<MaterialId, SceneError> {
        if let Some(TextureId(index)) = material.texture {
            check_id("texture", index, self.textures.len())?;
        }
        if !material.base_colour.iter().all(|c| c.is_finite()) {
            return Err(SceneError::Value { what: "material", name: material.name, field: "base_colour" });
        }
        self.materials.push(material);
        Ok(MaterialId(self.materials.len() as u32 - 1))
    }

    /// Places a mesh; returns the number of the instance, by which [`place`](Self::place) moves it.
    ///
    /// # Errors
    /// When mesh or material do not exist or the placement is not finite.
    pub fn add_instance(&mut self, instance: Instance) -> Result<u32, SceneError> {
        check_id("mesh", instance.mesh.0, self.meshes.len())?;
        if let Some(MaterialId(index)) = instance.material {
            check_id("material", index, self.materials.len())?;
        }
        check_placement(&instance.name, &instance.world_from_mesh)?;
        self.instances.push(instance);
        Ok(self.instances.len() as u32 - 1)
    }

    /// Moves an instance.
    ///
    /// # Errors
    /// When there is no such instance or the placement is not finite; it then stays where it was.
    pub fn place(&mut self, instance: u32, world_from_mesh: DAffine3) -> Result<(), SceneError> {
        check_id("instance", instance, self.instances.len())?;
        let placed = &mut self.instances[instance as usize];
        check_placement(&placed.name, &world_from_mesh)?;
        placed.world_from_mesh = world_from_mesh;
        Ok(())
    }

    /// Adds a light.
    ///
    /// # Errors
    /// When a number is not finite, a direction is not of unit length or a size is not positive.
    pub fn add_light(&mut self, light: Light) -> Result<(), SceneError> {
        if let Some(field) = light.bad_field() {
            return Err(SceneError::Value { what: "light", name: self.lights.len().to_string(), field });
        }
        self.lights.push(light);
        Ok(())
    }

    /// Adds a camera.
    pub fn add_camera(&mut self, camera: Camera) {
        self.cameras.push(camera);
    }

    /// Takes in everything of another scene, after what is there; its ids are shifted to match.
    pub fn append(&mut self, other: Scene) {
        let (meshes, materials, textures) =
            (self.meshes.len() as u32, self.materials.len() as u32, self.textures.len() as u32);
        let moved_material =
            |m: Material| Material { texture: m.texture.map(|t| TextureId(t.0 + textures)), ..m };
        self.materials.extend(other.materials.into_iter().map(moved_material));
        self.instances.extend(other.instances.into_iter().map(|i| Instance {
            mesh: MeshId(i.mesh.0 + meshes),
            material: i.material.map(|m| MaterialId(m.0 + materials)),
            ..i
        }));
        self.meshes.extend(other.meshes);
        self.textures.extend(other.textures);
        self.lights.extend(other.lights);
        self.cameras.extend(other.cameras);
    }

    /// All meshes.
    pub fn meshes(&self) -> &[TriangleMesh] {
        &self.meshes
    }

    /// All materials.
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// All textures.
    pub fn textures(&self) -> &[Texture] {
        &self.textures
    }

    /// All instances.
    pub fn instances(&self) -> &[Instance] {
        &self.instances
    }

    /// All lights.
    pub fn lights(&self) -> &[Light] {
        &self.lights
    }

    /// All cameras.
    pub fn cameras(&self) -> &[Camera] {
        &self.cameras
    }

    /// The mesh of an instance of this scene.
    ///
    /// # Panics
    /// When the instance is of another scene and this one has no such mesh.
    pub fn mesh_of(&self, instance: &Instance) -> &TriangleMesh {
        &self.meshes[instance.mesh.0 as usize]
    }

    /// World box of each instance, in order: around its mesh's box, transformed.
    pub fn instance_bounds(&self) -> Vec<DAabb> {
        let of_mesh: Vec<DAabb> = self.meshes.iter().map(TriangleMesh::world_bounds).collect();
        self.instances.iter().map(|i| of_mesh[i.mesh.0 as usize].transformed(&i.world_from_mesh)).collect()
    }

    /// World box of all instances.
    pub fn bounds(&self) -> DAabb {
        self.instance_bounds().into_iter().fold(DAabb::EMPTY, DAabb::union)
    }

    /// All instances as one mesh, without attributes, in the order of the instances.
    ///
    /// Positions go through `f64` world coordinates; a mirrored instance has its triangles turned over, so that its
    /// front stays in front.
    ///
    /// # Cost
    /// 36 bytes a placed vertex while it runs, besides the result.
    ///
    /// # Errors
    /// [`MeshError`] when the sum is more than 32-bit indices can name or a placed vertex is out of range.
    pub fn flattened(&self) -> Result<TriangleMesh, MeshError> {
        let vertices: u64 = self.instances.iter().map(|i| self.mesh_of(i).positions().len() as u64).sum();
        for (what, count) in [("vertices", vertices), ("triangles", self.placed_triangles())] {
            if count > u64::from(u32::MAX) {
                return Err(MeshError::TooMany { what, count: count as usize });
            }
        }
        let mut positions = Vec::with_capacity(vertices as usize);
        let mut triangles = Vec::with_capacity(self.placed_triangles() as usize);
        for instance in &self.instances {
            let mesh = self.mesh_of(instance);
            let base = positions.len() as u32;
            let place = &instance.world_from_mesh;
            let world = |p: &Vec3| place.transform_point3(mesh.origin() + p.as_dvec3());
            positions.extend(mesh.positions().iter().map(world));
            let mirrored = place.matrix3.determinant() < 0.0;
            let turned = |t: &[u32; 3]| if mirrored { [t[0], t[2], t[1]] } else { *t };
            triangles.extend(mesh.triangles().iter().map(|t| turned(t).map(|i| base + i)));
        }
        TriangleMesh::from_world(&positions, triangles)
    }

    /// Triangles stored.
    pub fn stored_triangles(&self) -> u64 {
        self.meshes.iter().map(|m| m.triangles().len() as u64).sum()
    }

    /// Triangles placed: every instance counts its mesh.
    pub fn placed_triangles(&self) -> u64 {
        self.instances.iter().map(|i| self.mesh_of(i).triangles().len() as u64).sum()
    }

    /// Bytes that the meshes and textures hold.
    pub fn bytes(&self) -> u64 {
        let textures: usize = self.textures.iter().map(|t| t.texels.len() * 4).sum();
        self.meshes.iter().map(TriangleMesh::bytes).sum::<u64>() + textures as u64
    }
}

/// Refuses a placement that is not finite.
fn check_placement(name: &str, world_from_mesh: &DAffine3) -> Result<(), SceneError> {
    let bad = || SceneError::Value { what: "instance", name: name.into(), field: "world_from_mesh" };
    if world_from_mesh.is_finite() { Ok(()) } else { Err(bad()) }
}

fn check_id(what: &'static str, index: u32, count: usize) -> Result<(), SceneError> {
    if (index as usize) < count { Ok(()) } else { Err(SceneError::NoSuch { what, index, count }) }
}

impl Light {
    /// The first field that no renderer could use.
    fn bad_field(&self) -> Option<&'static str> {
        // Loose enough for directions that were normalised in f32.
        let unit = |v: DVec3| v.is_finite() && (v.length() - 1.0).abs() < 1e-5;
        let positive = |x: f64| x.is_finite() && x > 0.0;
        let first_bad = |checks: &[(&'static str, bool)]| checks.iter().find(|c| !c.1).map(|c| c.0);
        match *self {
            Light::Directional { direction, irradiance, angular_radius } => first_bad(&[
                ("direction", unit(direction)),
                ("irradiance", irradiance.is_finite()),
                ("angular_radius", (0.0..std::f64::consts::FRAC_PI_2).contains(&angular_radius)),
            ]),
            Light::Point { position, intensity } => {
                first_bad(&[("position", position.is_finite()), ("intensity", intensity.is_finite())])
            }
            Light::Spot { position, direction, half_angle, intensity } => first_bad(&[
                ("position", position.is_finite()),
                ("direction", unit(direction)),
                ("half_angle", positive(half_angle) && half_angle < std::f64::consts::PI),
                ("intensity", intensity.is_finite()),
            ]),
            Light::Sphere { center, radius, radiance } => first_bad(&[
                ("center", center.is_finite()),
                ("radius", positive(radius)),
                ("radiance", radiance.is_finite()),
            ]),
            Light::Disk { center, normal, radius, radiance } => first_bad(&[
                ("center", center.is_finite()),
                ("normal", unit(normal)),
                ("radius", positive(radius)),
                ("radiance", radiance.is_finite()),
            ]),
            Light::Rectangle { center, half_u, half_v, radiance } => first_bad(&[
                ("center", center.is_finite()),
                ("half_u", half_u.is_finite() && half_u.length_squared() > 0.0),
                ("half_v", half_v.is_finite() && half_v.length_squared() > 0.0),
                ("radiance", radiance.is_finite()),
            ]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle() -> TriangleMesh {
        TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]).unwrap()
    }

    #[test]
    fn instances_count_and_bound_their_meshes() {
        let mut scene = Scene::of_mesh(triangle());
        let far = DAffine3::from_translation(DVec3::new(10.0, 0.0, 0.0));
        let instance = Instance { name: "far".into(), mesh: MeshId(0), world_from_mesh: far, material: None };
        scene.add_instance(instance).unwrap();
        assert_eq!((scene.stored_triangles(), scene.placed_triangles()), (1, 2));
        assert!(scene.bounds().contains(DVec3::new(11.0, 0.0, 0.0)));
        assert!(Scene::new().bounds().is_empty());
    }

    #[test]
    fn instances_move_and_refuse_what_is_no_placement() {
        let mut scene = Scene::of_mesh(triangle());
        scene.place(0, DAffine3::from_translation(DVec3::X * 5.0)).unwrap();
        assert_eq!(scene.bounds().min.x, 5.0);
        let nowhere = DAffine3::from_translation(DVec3::NAN);
        assert!(matches!(scene.place(0, nowhere), Err(SceneError::Value { field: "world_from_mesh", .. })));
        assert!(matches!(
            scene.place(1, DAffine3::IDENTITY),
            Err(SceneError::NoSuch { what: "instance", index: 1, .. })
        ));
        assert_eq!(scene.bounds().min.x, 5.0);
    }

    #[test]
    fn appending_moves_ids() {
        let with_texture = || {
            let mut scene = Scene::of_mesh(triangle());
            let texture = Some(scene.add_texture(Texture::new(1, 1, vec![[9; 4]]).unwrap()));
            let material = Some(scene.add_material(Material { texture, ..Material::default() }).unwrap());
            scene.instances[0].material = material;
            scene
        };
        let mut scene = with_texture();
        scene.append(with_texture());
        let last = &scene.instances()[1];
        assert_eq!((last.mesh, last.material), (MeshId(1), Some(MaterialId(1))));
        assert_eq!(scene.materials()[1].texture, Some(TextureId(1)));
    }

    #[test]
    fn flattening_places_and_keeps_fronts() {
        let mut scene = Scene::of_mesh(triangle());
        let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        let instance =
            Instance { name: "mirror".into(), mesh: MeshId(0), world_from_mesh: mirror, material: None };
        scene.add_instance(instance).unwrap();
        let mesh = scene.flattened().unwrap();
        assert_eq!(mesh.positions().len(), 6);
        for [a, b, c] in mesh.corner_iter() {
            assert_eq!((b - a).cross(c - a), Vec3::Z);
        }
        assert!(Scene::new().flattened().unwrap().is_empty());
    }

    #[test]
    fn ids_that_lead_nowhere_are_refused() {
        let mut scene = Scene::new();
        let nowhere = Instance {
            name: "i".into(),
            mesh: MeshId(0),
            world_from_mesh: DAffine3::IDENTITY,
            material: None,
        };
        let error = scene.add_instance(nowhere).unwrap_err();
        assert_eq!(error.to_string(), "there is no mesh 0; the scene has 0");
        let material = Material { texture: Some(TextureId(3)), ..Material::default() };
        assert!(scene.add_material(material).is_err());
        assert!(Texture::new(2, 2, vec![[0; 4]; 3]).is_err());
    }

    #[test]
    fn unusable_lights_are_refused() {
        let mut scene = Scene::new();
        let sun = |direction, angular_radius| Light::Directional {
            direction,
            irradiance: Vec3::ONE,
            angular_radius,
        };
        assert!(scene.add_light(sun(DVec3::NEG_Y, 0.0)).is_ok());
        assert!(scene.add_light(sun(DVec3::ZERO, 0.0)).is_err());
        assert!(scene.add_light(sun(DVec3::NEG_Y, f64::NAN)).is_err());
        let dark = Light::Sphere { center: DVec3::ZERO, radius: 0.0, radiance: Vec3::ONE };
        assert_eq!(scene.add_light(dark).unwrap_err().to_string(), "light '1': radius is not usable");
    }
}
