//! The reference renderer as an item buffer.

use farsight_geometry::scene::Scene;
use farsight_geometry::{Camera, TriangleMesh};
use farsight_raster::{Outputs, Rasteriser, RenderOptions, SceneIds, render_scene};
use farsight_visibility::ItemBuffer;

/// Draws a mesh with a number for each of its triangles.
pub struct Pictures {
    rasteriser: Rasteriser,
    scene: Scene,
}

impl Pictures {
    pub fn of_mesh(mesh: TriangleMesh) -> Self {
        Self { rasteriser: Rasteriser::new(), scene: Scene::of_mesh(mesh) }
    }
}

impl ItemBuffer for Pictures {
    fn draw(&mut self, camera: &Camera, ids: &mut Vec<u32>) {
        let mut options = RenderOptions::default();
        options.ids = SceneIds::Triangles;
        options.outputs = Outputs { colour: false, depth: true, id: true };
        let drawn = render_scene(&mut self.rasteriser, &self.scene, camera, &options);
        // A picture that is missing would count as one that shows nothing.
        let (target, _) = drawn.expect("a small picture");
        ids.extend(target.ids());
    }
}
