//! The node graph: placements, cameras, lights.

use super::{Reader, item, primitive};
use crate::camera::{Camera, Projection};
use crate::io::{ImportError, short_name};
use crate::scene::{Instance, Light, MaterialId, MeshId};
use ::gltf::json;
use ::gltf::json::extensions::scene::khr_lights_punctual;
use ::gltf::json::scene::Node;
use ::gltf::json::validation::Checked;
use glam::{DAffine3, DMat4, DQuat, DVec3, Vec3};
use std::collections::HashMap;

/// Height in pixels of the images of a file's cameras; glTF gives only their proportions.
const IMAGE_HEIGHT: u32 = 1080;

/// Bytes that a placement takes in memory, next to its name.
const INSTANCE_BYTES: u64 = 160;

/// Meshes that were made, by the file's mesh: those of its primitives with their materials.
struct Made {
    materials: Vec<MaterialId>,
    users: HashMap<usize, u32>,
    meshes: HashMap<usize, Vec<(MeshId, Option<MaterialId>)>>,
}

impl Reader<'_> {
    /// Walks the scene from its roots and places what the nodes hold.
    pub(super) fn read_nodes(&mut self) -> Result<(), ImportError> {
        let root = self.root;
        let materials = self.materials()?;
        let mut made = Made { materials, users: primitive::position_users(root), meshes: HashMap::new() };
        if root.nodes.is_empty() {
            // A library of meshes: show each where it is.
            for mesh in 0..root.meshes.len() {
                self.place(mesh, None, DAffine3::IDENTITY, &mut made)?;
            }
            return Ok(());
        }
        let mut seen = vec![false; root.nodes.len()];
        let mut open: Vec<(usize, DAffine3)> =
            self.roots()?.into_iter().rev().map(|node| (node, DAffine3::IDENTITY)).collect();
        while let Some((number, world_from_parent)) = open.pop() {
            let node = item(&root.nodes, number, "node")?;
            // Also what ends cycles: every node is visited once.
            if std::mem::replace(&mut seen[number], true) {
                return Err(bad(number, "it is reached twice: nodes must form a tree"));
            }
            let world_from_node = world_from_parent * transform(node, number)?;
            if let Some(mesh) = node.mesh {
                self.place(mesh.value(), node.name.as_deref(), world_from_node, &mut made)?;
            }
            self.camera_and_light(node, number, &world_from_node)?;
            let children = node.children.iter().flatten().rev();
            open.extend(children.map(|child| (child.value(), world_from_node)));
        }
        Ok(())
    }

    /// Roots of the default scene; without scenes, the nodes that have no parent.
    fn roots(&self) -> Result<Vec<usize>, ImportError> {
        let root = self.root;
        if !root.scenes.is_empty() {
            let scene = item(&root.scenes, root.scene.map_or(0, |s| s.value()), "scene")?;
            return Ok(scene.nodes.iter().map(|n| n.value()).collect());
        }
        let mut is_root = vec![true; root.nodes.len()];
        for child in root.nodes.iter().flat_map(|n| n.children.iter().flatten()) {
            if let Some(flag) = is_root.get_mut(child.value()) {
                *flag = false;
            }
        }
        Ok((0..is_root.len()).filter(|&i| is_root[i]).collect())
    }

    fn place(
        &mut self,
        number: usize,
        name: Option<&str>,
        world_from_mesh: DAffine3,
        made: &mut Made,
    ) -> Result<(), ImportError> {
        let mesh = item(&self.root.meshes, number, "mesh")?;
        let fallback = format!("mesh {number}");
        let mesh_name = mesh.name.as_deref().unwrap_or(&fallback);
        if !made.meshes.contains_key(&number) {
            let mut parts = Vec::new();
            for primitive in &mesh.primitives {
                let Some(mesh) = self.primitive(mesh_name, primitive, &made.users)? else { continue };
                let material = match primitive.material {
                    Some(index) => Some(*item(&made.materials, index.value(), "material")?),
                    None => None,
                };
                parts.push((self.scene.add_mesh(mesh), material));
            }
            made.meshes.insert(number, parts);
        }
        let name = short_name(name.unwrap_or(mesh_name));
        for &(mesh, material) in &made.meshes[&number] {
            self.budget.take(INSTANCE_BYTES + name.len() as u64)?;
            self.scene.add_instance(Instance { name: name.clone(), mesh, world_from_mesh, material })?;
        }
        Ok(())
    }

    fn camera_and_light(
        &mut self,
        node: &Node,
        number: usize,
        world_from_node: &DAffine3,
    ) -> Result<(), ImportError> {
        if let Some(index) = node.camera {
            let camera = item(&self.root.cameras, index.value(), "camera")?;
            match camera_at(camera, world_from_node) {
                Some(camera) => self.scene.add_camera(camera),
                None => self.warnings.push(format!("the camera of node {number} is not usable")),
            }
        }
        let extension = node.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref());
        if let Some(extension) = extension {
            let all = self.root.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref());
            let light = item(all.map_or(&[], |all| &all.lights), extension.light.value(), "light")?;
            let light = light_at(light, world_from_node);
            if light.is_none_or(|light| self.scene.add_light(light).is_err()) {
                self.warnings.push(format!("the light of node {number} is not usable"));
            }
        }
        Ok(())
    }
}

fn bad(node: usize, problem: &str) -> ImportError {
    ImportError::syntax(format!("node {node}"), problem)
}

/// Placement of a node in its parent.
fn transform(node: &Node, number: usize) -> Result<DAffine3, ImportError> {
    let transform = match node.matrix {
        Some(columns) => DAffine3::from_mat4(DMat4::from_cols_array(&columns.map(f64::from))),
        None => {
            let rotation = DQuat::from_array(node.rotation.unwrap_or_default().0.map(f64::from));
            // Files hold rounded quaternions; a scale hidden in their length would show in large scenes.
            let length = rotation.length();
            if !(length.is_finite() && length > 1e-6) {
                return Err(bad(number, "its rotation has no direction"));
            }
            let vector = |v: [f32; 3]| Vec3::from(v).as_dvec3();
            DAffine3::from_scale_rotation_translation(
                node.scale.map_or(DVec3::ONE, vector),
                DQuat::from_array(rotation.to_array().map(|q| q / length)),
                node.translation.map_or(DVec3::ZERO, vector),
            )
        }
    };
    if transform.is_finite() { Ok(transform) } else { Err(bad(number, "its placement is not finite")) }
}

fn camera_at(camera: &json::Camera, world_from_node: &DAffine3) -> Option<Camera> {
    let eye = world_from_node.translation;
    let ahead = world_from_node.transform_vector3(DVec3::NEG_Z);
    let up = world_from_node.transform_vector3(DVec3::Y);
    let looking = Camera::look_at(eye, eye + ahead, up).ok()?;
    let (projection, aspect, near, far) = match (&camera.perspective, &camera.orthographic) {
        (Some(p), _) => {
            let projection = Projection::Perspective { fov_y: f64::from(p.yfov) };
            let far = p.zfar.map_or(f64::INFINITY, f64::from);
            (projection, f64::from(p.aspect_ratio.unwrap_or(16.0 / 9.0)), f64::from(p.znear), far)
        }
        (None, Some(o)) => {
            let projection = Projection::Orthographic { height: 2.0 * f64::from(o.ymag) };
            (projection, f64::from(o.xmag) / f64::from(o.ymag), f64::from(o.znear), f64::from(o.zfar))
        }
        _ => return None,
    };
    let width = (f64::from(IMAGE_HEIGHT) * aspect.clamp(0.01, 100.0)).round() as u32;
    let camera = looking.with_projection(projection).ok()?.with_range(near, far).ok()?;
    camera.with_image(width, IMAGE_HEIGHT).ok()
}

fn light_at(light: &khr_lights_punctual::Light, world_from_node: &DAffine3) -> Option<Light> {
    let position = world_from_node.translation;
    let direction = world_from_node.transform_vector3(DVec3::NEG_Z).try_normalize()?;
    let strength = Vec3::from(light.color) * light.intensity;
    Some(match light.type_ {
        Checked::Valid(khr_lights_punctual::Type::Directional) => {
            Light::Directional { direction, irradiance: strength, angular_radius: 0.0 }
        }
        Checked::Valid(khr_lights_punctual::Type::Point) => Light::Point { position, intensity: strength },
        Checked::Valid(khr_lights_punctual::Type::Spot) => Light::Spot {
            position,
            direction,
            half_angle: f64::from(light.spot.as_ref()?.outer_cone_angle),
            intensity: strength,
        },
        Checked::Invalid => return None,
    })
}
