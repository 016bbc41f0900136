//! What is hidden behind what: coherent hierarchical culling, answered by a software depth buffer.

use farsight_geometry::bvh::Bvh;
use farsight_geometry::glam::DMat4;
use farsight_geometry::scene::AlphaMode;
use farsight_geometry::{Camera, ClipConvention, Scene};
use farsight_occlusion::{
    Answer, Backend, Command, Culler, DepthBuffer, Faces, NodeId, Occluders, Options, Proxy, View,
};
use farsight_raster::relative_from_mesh;
use std::error::Error;

/// Triangles that are drawn as occluders in a frame, and the least size on the screen that makes one worth it.
const OCCLUDER_TRIANGLES: u64 = 150_000;
const OCCLUDER_PX: f64 = 24.0;

/// Finds the objects of a scene that may be seen, frame by frame.
pub struct Visibility {
    /// Whether an object has no holes.
    solid: Vec<bool>,
    culler: Culler,
    buffer: DepthBuffer,
    occluders: Occluders,
    visible: Vec<u32>,
}

impl Visibility {
    /// For images of a scene of `width` by `height` samples.
    pub fn new(scene: &Scene, width: u32, height: u32) -> Result<Self, Box<dyn Error>> {
        let opaque = |id: farsight_geometry::scene::MaterialId| {
            let material = &scene.materials()[id.0 as usize];
            material.alpha == AlphaMode::Opaque
        };
        Ok(Self {
            solid: scene.instances().iter().map(|i| i.material.is_none_or(opaque)).collect(),
            culler: Culler::new(Options::default(), Backend::Boolean)?,
            buffer: DepthBuffer::new(width, height)?,
            occluders: Occluders::new(OCCLUDER_TRIANGLES, OCCLUDER_PX),
            visible: Vec::new(),
        })
    }

    /// The objects that may be seen, drawn in these forms. The image without the others is the same, sample by sample.
    pub fn cull(
        &mut self,
        scene: &Scene,
        hierarchy: &Bvh,
        camera: &Camera,
        forms: &[Option<&[[u32; 3]]>],
    ) -> &[u32] {
        self.buffer.clear();
        self.occluders.clear();
        self.visible.clear();
        let clip = camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye());
        self.culler.begin_frame(View::from_camera(camera));
        loop {
            match self.culler.next(hierarchy) {
                Command::Render(leaf) => self.see(scene, hierarchy, leaf, camera, &clip, forms),
                Command::Query { id, proxy, .. } => {
                    let hidden = match &proxy {
                        Proxy::Box(b) => self.buffer.is_occluded(&clip, camera.eye(), b),
                        Proxy::Boxes => {
                            let boxes = self.culler.boxes();
                            boxes.iter().all(|b| self.buffer.is_occluded(&clip, camera.eye(), b))
                        }
                        Proxy::Geometry => false,
                    };
                    self.culler.resolve(id, if hidden { Answer::OCCLUDED } else { Answer::VISIBLE });
                }
                // All queries are answered at once, so none is waited for.
                Command::Flush => {}
                Command::Done => break,
            }
        }
        &self.visible
    }

    /// Notes a visible object and draws it as occluder when it is large and solid.
    fn see(
        &mut self,
        scene: &Scene,
        hierarchy: &Bvh,
        leaf: NodeId,
        camera: &Camera,
        clip: &DMat4,
        forms: &[Option<&[[u32; 3]]>],
    ) {
        let Some(object) = hierarchy.object(leaf) else { return };
        self.visible.push(object);
        let instance = &scene.instances()[object as usize];
        let mesh = scene.mesh_of(instance);
        let triangles = forms.get(object as usize).copied().flatten().unwrap_or(mesh.triangles());
        let size = camera.box_px(hierarchy.bounds(leaf));
        if self.solid[object as usize] && self.occluders.admits(size, triangles.len() as u64) {
            let relative = DMat4::from(relative_from_mesh(instance, mesh, camera.eye()));
            self.buffer.draw(&(*clip * relative), mesh.positions(), triangles, Faces::Both);
        }
    }
}
