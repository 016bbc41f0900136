//! The picture from above: what became of each node.

use farsight_geometry::bvh::{Bvh, Walk};
use farsight_geometry::glam::{DVec2, DVec3};
use farsight_geometry::{Camera, DAabb};
use farsight_occlusion::{Classification, Culler};
use farsight_raster::{Image, RasterError};

const GROUND: [u8; 3] = [24, 26, 30];
const UNVISITED: [u8; 3] = [70, 74, 82];
const VISIBLE: [u8; 3] = [70, 190, 100];
const TAKEN: [u8; 3] = [240, 200, 60];
const HIDDEN: [u8; 3] = [215, 60, 50];
const VIEW: [u8; 3] = [255, 255, 255];

struct Canvas {
    side: usize,
    pixels: Vec<[u8; 3]>,
    from: DVec2,
    scale: f64,
}

impl Canvas {
    /// Column and row; north is up.
    fn at(&self, p: DVec3) -> (i64, i64) {
        let q = (p.truncate() - self.from) * self.scale;
        (q.x as i64, self.side as i64 - 1 - q.y as i64)
    }

    fn blend(&mut self, x: i64, y: i64, colour: [u8; 3], share: f64) {
        if x < 0 || y < 0 || x >= self.side as i64 || y >= self.side as i64 {
            return;
        }
        let at = &mut self.pixels[y as usize * self.side + x as usize];
        *at = std::array::from_fn(|c| {
            (f64::from(at[c]) * (1.0 - share) + f64::from(colour[c]) * share).round() as u8
        });
    }

    fn rectangle(&mut self, b: &DAabb, colour: [u8; 3], fill: f64, edge: f64) {
        let ((x0, y1), (x1, y0)) = (self.at(b.min), self.at(b.max));
        for y in y0..=y1 {
            for x in x0..=x1 {
                let border = x == x0 || x == x1 || y == y0 || y == y1;
                self.blend(x, y, colour, if border { edge } else { fill });
            }
        }
    }

    fn line(&mut self, a: DVec3, b: DVec3, colour: [u8; 3]) {
        for i in 0..=2 * self.side {
            let p = a.lerp(b, i as f64 / (2 * self.side) as f64);
            let (x, y) = self.at(p);
            self.blend(x, y, colour, 0.9);
        }
    }
}

/// The tree from above, its hidden nodes as a whole, leaves in the colour of what became of them, and the view.
pub fn picture(bvh: &Bvh, culler: &Culler, camera: &Camera, side: usize) -> Result<Image, RasterError> {
    let all = bvh.root().map_or(DAabb::EMPTY, |root| *bvh.bounds(root));
    let extent = all.extent().truncate().max_element().max(1e-9) * 1.04;
    let scale = side as f64 / extent;
    let from = all.center().truncate() - 0.5 * extent;
    let mut canvas = Canvas { side, pixels: vec![GROUND; side * side], from, scale };
    bvh.walk(|node, b| {
        if bvh.children(node).is_none() {
            canvas.rectangle(b, UNVISITED, 0.35, 0.6);
        }
        Walk::Descend
    });
    bvh.walk(|node, b| {
        let leaf = bvh.children(node).is_none();
        match culler.classification(node) {
            Classification::Hidden => {
                canvas.rectangle(b, HIDDEN, 0.22, 0.9);
                return Walk::Skip;
            }
            Classification::Unvisited => return Walk::Skip,
            Classification::Visible if leaf => canvas.rectangle(b, VISIBLE, 0.45, 0.95),
            Classification::Taken if leaf => canvas.rectangle(b, TAKEN, 0.45, 0.95),
            _ => {}
        }
        Walk::Descend
    });
    let (ahead, right) = (camera.forward() * extent, camera.right() * (extent * camera.half_extent().x));
    canvas.line(camera.eye(), camera.eye() + ahead - right, VIEW);
    canvas.line(camera.eye(), camera.eye() + ahead + right, VIEW);
    Image::new(side as u32, side as u32, canvas.pixels)
}
