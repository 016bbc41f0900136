//! Coarser shadow casters: hierarchies on disk, of the whole scene or of a large surface, of which a shadow map draws as little as shows.

use farsight_geometry::glam::{DMat4, DVec3};
use farsight_geometry::scene::AlphaMode;
use farsight_geometry::{Camera, DAabb, Scene};
use farsight_hlod::{
    BuildOptions, CasterLight, Casters, HlodError, Mesh, NodeId, NodeMesh, ReceiverBox, Store, Tier, build,
    no_progress, select_casters,
};
use farsight_raster::{Rasteriser, ShadowMap};
use std::collections::HashMap;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

/// Most triangles that a hierarchy is built of: more would keep a tour waiting.
const MOST_TRIANGLES: u64 = 250_000;
/// Fewer are sooner drawn than chosen among.
const LEAST_TRIANGLES: u64 = 20_000;

/// A hierarchy of casters, and the nodes that have been drawn.
pub struct CasterStore {
    store: Arc<Store>,
    /// The object that it stands for; `None` for all that stands still.
    object: Option<u32>,
    nodes: HashMap<NodeId, NodeMesh>,
    chosen: Casters,
    /// Whether it is drawn in this frame.
    pub used: bool,
}

/// Builds the hierarchy of a scene into a file, if that is worth it: the reason if not.
pub fn build_whole(scene: &Scene, path: &Path) -> Result<Result<Arc<Store>, String>, Box<dyn Error>> {
    let triangles = scene.placed_triangles();
    if scene.materials().iter().any(|m| m.alpha != AlphaMode::Opaque) {
        return Ok(Err("no hierarchy of shadow casters: some objects have holes".into()));
    }
    if !(LEAST_TRIANGLES..=MOST_TRIANGLES).contains(&triangles) {
        let range = format!("worth it between {LEAST_TRIANGLES} and {MOST_TRIANGLES}");
        return Ok(Err(format!("no hierarchy of all shadow casters: {triangles} triangles, {range}")));
    }
    let mesh = scene.flattened()?;
    let options = BuildOptions::default().with_appearance(false).with_tier(Tier::Verified);
    build([Ok::<_, HlodError>(&mesh)], path, &options, &no_progress)?;
    Ok(Ok(Arc::new(Store::open(path)?)))
}

/// What the hierarchy of a whole scene is, in words.
pub fn text(store: &Store) -> String {
    let tree = store.tree();
    let root = tree.root().map_or(0, |r| tree.triangles(r, Mesh::Shape));
    let nodes = tree.ids().len();
    format!("a hierarchy of shadow casters: {nodes} nodes, {root} triangles in the root, errors proven")
}

impl CasterStore {
    /// Casters from a hierarchy of an object, or of all that stands still.
    pub fn new(store: Arc<Store>, object: Option<u32>) -> Self {
        Self { store, object, nodes: HashMap::new(), chosen: Casters::default(), used: false }
    }

    /// Whether it stands for an object, where those from `first_mover` on move.
    pub fn covers(&self, object: u32, first_mover: u32) -> bool {
        self.object.map_or(object < first_mover, |own| own == object)
    }

    /// Chooses the casters for what is seen, such that no shadow's edge moves by more than `px` pixels; returns the number of their triangles.
    pub fn choose(&mut self, camera: &Camera, along: DVec3, receivers: &[DAabb], px: f64) -> u64 {
        let all = receivers.iter().fold(DAabb::EMPTY, |a, b| a.union(*b));
        let seen = [ReceiverBox { level: 0, corners: all.corners() }];
        let tolerance = |_: NodeId, b: &DAabb| tolerance(camera, b, along, px);
        let light = CasterLight::Directional(along);
        select_casters(self.store.tree(), light, &seen, tolerance, |_| true, &mut self.chosen);
        self.chosen.triangles
    }

    /// Draws what was chosen, moved `along` the light by [`aside`]; returns the number of nodes.
    pub fn draw(
        &mut self,
        rasteriser: &mut Rasteriser,
        map: &mut ShadowMap,
        origin: DVec3,
        along: DVec3,
    ) -> Result<usize, HlodError> {
        for &node in &self.chosen.drawn {
            let mesh = match self.nodes.entry(node) {
                std::collections::hash_map::Entry::Occupied(known) => known.into_mut(),
                std::collections::hash_map::Entry::Vacant(new) => {
                    let mut mesh = NodeMesh::default();
                    self.store.read(node, Mesh::Shape, &mut mesh)?;
                    new.insert(mesh)
                }
            };
            let moved = along * aside(self.store.tree().error(node, Mesh::Shape).value);
            let relative = DMat4::from_translation(mesh.origin + moved - origin);
            map.draw(rasteriser, &mesh.positions, mesh.indices.as_chunks().0, relative);
        }
        Ok(self.chosen.drawn.len())
    }
}

/// How far a caster that is off by `error` is moved along the light: as far as it may be before the surface that it stands for, as the back of that may be where it is thin, and as what is
/// drawn of it may be behind. Otherwise thin parts show specks of their own shadow. The shadow stays where it is; only where it touches its caster does it stand off.
pub fn aside(error: f64) -> f64 {
    3.0 * error
}

/// By how much a caster within `b` may be off, in world units, so that its shadow's edge is off by `px` pixels at most.
pub fn tolerance(camera: &Camera, b: &DAabb, along: DVec3, px: f64) -> f64 {
    // Wherever the shadow falls, it is no nearer to the eye than what the box sweeps along the light.
    let distance = distance_to_sweep(camera.eye(), b, along).max(camera.near());
    camera.world_error(px, distance) * STEEPNESS
}

/// Sine of the lowest elevation of light above a receiver that is allowed for, 30°: there a shadow moves twice as far as its caster.
const STEEPNESS: f64 = 0.5;

/// Distance from a point to what a box sweeps along a unit direction.
fn distance_to_sweep(point: DVec3, b: &DAabb, along: DVec3) -> f64 {
    let at = |t: f64| b.closest_point(point - along * t).distance(point - along * t);
    // The distance is a convex function of how far the box has come.
    let (mut low, mut high) = (0.0, 2.0 * (b.center().distance(point) + b.diagonal()));
    for _ in 0..60 {
        let (a, c) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if at(a) <= at(c) { high = c } else { low = a }
    }
    at(low).min(at(0.0))
}
