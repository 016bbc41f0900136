//! Occlusion culling over the outer octree: the nodes of a selection are the hierarchy that the culler walks.
//!
//! A node with nodes below gets one leaf more, for its own points.

use crate::draw::Painter;
use farsight_geometry::bvh::NodeId as Id;
use farsight_geometry::glam::Vec3;
use farsight_geometry::{Camera, ClipConvention, DAabb};
use farsight_occlusion::{Answer, Backend, Command, Culler, Hierarchy, Options, Proxy, View};
use farsight_points::{NodeData, Selection, Store};
use farsight_raster::{Draw, State};
use std::collections::HashMap;
use std::error::Error;

/// Drawn nodes as a tree: id 2i is the cell of the i-th, id 2i + 1 its own points.
struct Shown {
    /// By id.
    bounds: Vec<DAabb>,
    children: Vec<Vec<Id>>,
}

impl Shown {
    fn new(store: &Store, selection: &Selection, camera: &Camera) -> Self {
        let octree = store.octree();
        let place: HashMap<u32, u32> = selection.drawn.iter().zip(0..).map(|(d, i)| (d.node.0, i)).collect();
        let mut children: Vec<Vec<Id>> = (0..place.len() as u32).map(|i| vec![Id(2 * i + 1)]).collect();
        for (i, drawn) in selection.drawn.iter().enumerate() {
            let parent = octree.parent(drawn.node).and_then(|p| place.get(&p.0));
            if let Some(&parent) = parent {
                children[parent as usize].push(Id(2 * i as u32));
            }
        }
        let bounds = |d: &farsight_points::Drawn| {
            let b = octree.bounds(d.node);
            // A splat reaches beyond its point.
            let pixel = 2.0 * b.closest_point(camera.eye()).distance(camera.eye()).max(camera.near())
                / camera.pixels_per_unit();
            b.inflated(f64::from(d.splat).max(pixel))
        };
        let mut all: Vec<DAabb> = selection.drawn.iter().map(bounds).flat_map(|b| [b, b]).collect();
        // Children may have larger splats: a cell's box holds theirs. They stand after their parents.
        for i in (0..children.len()).rev() {
            for child in &children[i] {
                all[2 * i] = all[2 * i].union(all[child.0 as usize]);
            }
        }
        Self { bounds: all, children }
    }
}

impl Hierarchy for Shown {
    fn root(&self) -> Option<Id> {
        (!self.bounds.is_empty()).then_some(Id(0))
    }

    fn bounds(&self, node: Id) -> DAabb {
        self.bounds[node.0 as usize]
    }

    fn child(&self, node: Id, index: u32) -> Option<Id> {
        if node.0 % 2 == 1 { None } else { self.children[node.0 as usize / 2].get(index as usize).copied() }
    }
}

/// What culling saved in a frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Saved {
    pub nodes: usize,
    pub points: u64,
    pub queries: u64,
}

/// Draws a selection with culling; `most_px` as in [`Painter::draw`].
pub fn draw(
    painter: &mut Painter,
    store: &Store,
    selection: &Selection,
    camera: &Camera,
    most_px: f32,
) -> Result<Saved, Box<dyn Error>> {
    let shown = Shown::new(store, selection, camera);
    let mut culler = Culler::new(Options::default(), Backend::Boolean)?;
    let (mut saved, mut data) = (Saved::default(), NodeData::default());
    culler.begin_frame(View::from_camera(camera));
    loop {
        match culler.next(&shown) {
            Command::Render(leaf) => {
                let drawn = selection.drawn[leaf.0 as usize / 2];
                store.read(drawn.node, &mut data)?;
                painter.draw(store.octree().grid(), &data.points, drawn.splat, most_px);
                saved.nodes += 1;
                saved.points += u64::from(drawn.points);
            }
            Command::Query { id, proxy, .. } => {
                saved.queries += 1;
                let samples = match proxy {
                    Proxy::Box(b) => samples(painter, camera, &b),
                    Proxy::Boxes => culler.boxes().to_vec().iter().map(|b| samples(painter, camera, b)).sum(),
                    Proxy::Geometry => 1,
                };
                culler.resolve(id, if samples > 0 { Answer::VISIBLE } else { Answer::OCCLUDED });
            }
            Command::Flush => {}
            Command::Done => break,
        }
    }
    (saved.nodes, saved.points) = (selection.drawn.len() - saved.nodes, selection.points - saved.points);
    Ok(saved)
}

/// Samples of a box that pass the depth test.
fn samples(painter: &mut Painter, camera: &Camera, b: &DAabb) -> u64 {
    let corners: Vec<Vec3> = b.corners().iter().map(|&c| (c - camera.eye()).as_vec3()).collect();
    let clip_from_local = camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye());
    let mut state = State::default();
    state.depth_test = farsight_raster::DepthTest::NearerOrEqual;
    painter.rasteriser.count_samples(
        &painter.target,
        &Draw { positions: &corners, triangles: &DAabb::TRIANGLES, clip_from_local, state },
    )
}
