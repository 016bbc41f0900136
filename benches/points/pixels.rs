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
            if let Some((px, depth)) = camera.project(store.octree().grid().world(p.position))
                // Without a margin, those that are visible.
                && (margin > 0.0 || (camera.near()..=camera.far()).contains(&depth))
                && (-margin..w + margin).contains(&px.x)
                && (-margin..h + margin).contains(&px.y)
            {
                out.push(px);
            }
        }
    }
    Ok(out)
}

/// Largest distance in pixels from a visible point to the nearest one of some nodes, in exact positions, a hundredth of
/// `reach` at least. Beyond `reach` it may come out too large, even infinite.
pub fn hausdorff_px(
    store: &Store,
    camera: &Camera,
    selection: &Selection,
    reach: f64,
) -> Result<f64, Box<dyn Error>> {
    // Bins half as wide as the reach, so that 5 x 5 of them hold all that matters; the nearest first.
    let bin = (0.5 * reach).max(0.5);
    let mut around: Vec<(i64, i64)> = (-2..=2).flat_map(|j| (-2..=2).map(move |i| (i, j))).collect();
    around.sort_by_key(|(i, j)| i * i + j * j);
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
    // Distances below a hundredth of the reach are not told apart: looking for them takes long where points are dense.
    let mut worst = 0.01 * reach;
    for p in on_screen(store, camera, 0.0, omitted)? {
        let (x, y) = place(p);
        let mut least = f64::INFINITY;
        'search: for (i, j) in &around {
            let (x, y) = (x as i64 + i, y as i64 + j);
            if !(0..w as i64).contains(&x) || !(0..h as i64).contains(&y) {
                continue;
            }
            let at = y as usize * w + x as usize;
            for q in &drawn[starts[at] as usize..starts[at + 1] as usize] {
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
