//! Points of one pixel by the reference renderer, and how far drawn points are from those that are not.

use farsight_geometry::glam::{DVec2, Vec3};
use farsight_geometry::{Camera, ClipConvention};
use farsight_points::{NodeData, NodeId, Selection, Store};
use farsight_raster::{Outputs, PointDraw, Rasteriser, Splat, State, Target};
use std::collections::HashSet;
use std::error::Error;

/// Draws points of one pixel.
pub struct Plain {
    camera: Camera,
    pub target: Target,
    rasteriser: Rasteriser,
    positions: Vec<Vec3>,
    colours: Vec<[u8; 4]>,
}

impl Plain {
    pub fn new(camera: Camera) -> Result<Self, Box<dyn Error>> {
        let outputs = Outputs { id: false, ..Outputs::ALL };
        let target = Target::new(camera.width(), camera.height(), outputs)?;
        Ok(Self { camera, target, rasteriser: Rasteriser::new(), positions: Vec::new(), colours: Vec::new() })
    }

    pub fn draw(&mut self, store: &Store, data: &NodeData) {
        let (grid, eye) = (store.octree().grid(), self.camera.eye());
        self.positions.clear();
        self.colours.clear();
        self.positions.extend(data.points.iter().map(|p| grid.relative(p.position, eye)));
        self.colours.extend(data.points.iter().map(|p| p.colour));
        let draw = PointDraw {
            positions: &self.positions,
            colours: &self.colours,
            sizes_px: &[1.0],
            splat: Splat::Square,
            clip_from_local: self.camera.clip_from_relative_f64(ClipConvention::REVERSED, eye),
            state: State::default(),
        };
        self.rasteriser.draw_points(&mut self.target, &draw);
    }

    pub fn all(store: &Store, camera: Camera) -> Result<Self, Box<dyn Error>> {
        Self::some(store, camera, store.octree().ids())
    }

    pub fn some(
        store: &Store,
        camera: Camera,
        nodes: impl Iterator<Item = NodeId>,
    ) -> Result<Self, Box<dyn Error>> {
        let (mut plain, mut data) = (Self::new(camera)?, NodeData::default());
        for node in nodes {
            store.read(node, &mut data)?;
            plain.draw(store, &data);
        }
        Ok(plain)
    }

    pub fn covered(&self) -> Vec<bool> {
        self.target.depth_rows().flatten().map(|&d| d > 0.0).collect()
    }
}

/// Share of the pixels that all points cover and some do not; and pixels that only some cover, which must not be.
pub fn lost(all: &Plain, some: &Plain) -> (f64, usize) {
    let (a, b) = (all.covered(), some.covered());
    let covered = a.iter().filter(|&&c| c).count();
    let lost = a.iter().zip(&b).filter(|&(&a, &b)| a && !b).count();
    let extra = a.iter().zip(&b).filter(|&(&a, &b)| !a && b).count();
    (lost as f64 / covered.max(1) as f64, extra)
}

/// Positions of nodes on the screen, those in view and a little around.
fn on_screen(
    store: &Store,
    camera: &Camera,
    margin: f64,
    nodes: impl Iterator<Item = NodeId>,
) -> Result<Vec<DVec2>, Box<dyn Error>> {
    let (mut data, mut out) = (NodeData::default(), Vec::new());
    let (w, h) = (f64::from(camera.width()), f64::from(camera.height()));
    for node in nodes {
        store.read(node, &mut data)?;
        for p in &data.points {
            if let Some((px, _)) = camera.project(store.octree().grid().world(p.position))
                && (-margin..w + margin).contains(&px.x)
                && (-margin..h + margin).contains(&px.y)
            {
                out.push(px);
            }
        }
    }
    Ok(out)
}

/// Largest distance in pixels from a visible point to the nearest one of some nodes, in exact positions. Distances beyond
/// `reach` are reported as infinite.
pub fn hausdorff_px(
    store: &Store,
    camera: &Camera,
    selection: &Selection,
    reach: f64,
) -> Result<f64, Box<dyn Error>> {
    // Bins at least half as wide as the reach, so that 5 x 5 of them hold all that matters.
    let bin = (0.5 * reach).max(1.0);
    let margin = 2.0 * bin;
    let side = |pixels: u32| ((f64::from(pixels) + 2.0 * margin) / bin) as usize + 1;
    let (w, h) = (side(camera.width()), side(camera.height()));
    let place = |p: DVec2| (((p.x + margin) / bin) as usize, ((p.y + margin) / bin) as usize);
    let index = |p: DVec2| place(p).1 * w + place(p).0;
    let mut drawn = on_screen(store, camera, margin, selection.drawn.iter().map(|d| d.node))?;
    drawn.sort_unstable_by_key(|&p| index(p));
    let mut starts = vec![0u32; w * h + 1];
    drawn.iter().for_each(|&p| starts[index(p) + 1] += 1);
    (0..w * h).for_each(|i| starts[i + 1] += starts[i]);
    let is_drawn: HashSet<NodeId> = selection.drawn.iter().map(|d| d.node).collect();
    let omitted = store.octree().ids().filter(|n| !is_drawn.contains(n));
    let mut worst = 0.0f64;
    for p in on_screen(store, camera, 0.0, omitted)? {
        let (x, y) = place(p);
        let mut least = f64::INFINITY;
        'search: for j in y.saturating_sub(2)..=(y + 2).min(h - 1) {
            let row = j * w + x.saturating_sub(2)..j * w + (x + 2).min(w - 1) + 1;
            for q in &drawn[starts[row.start] as usize..starts[row.end] as usize] {
                least = least.min(q.distance(p));
                // It cannot change the result any more.
                if least <= worst {
                    break 'search;
                }
            }
        }
        worst = worst.max(least);
    }
    Ok(worst)
}
