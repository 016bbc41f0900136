//! Draw calls: from a mesh and a matrix to the pixels of a target.

use crate::clip::{NEEDS_CLIP, SIDES, Viewport};
use crate::counters::Counters;
use crate::target::{GROUP, Target};
use crate::triangle::{Cull, Setup, Sink, Vertex, Window};
use fearless_simd::{Level, Simd, dispatch, f32x8, mask32x8, prelude::*, u32x8};
use glam::{DMat4, DVec3, DVec4, Vec3, Vec4};

/// When a pixel passes the depth test. Depth is reversed: larger is nearer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthTest {
    /// Nearer than what is there. Of equals the first drawn stays.
    #[default]
    Nearer,
    /// Nearer or equal.
    NearerOrEqual,
    /// Equal, for a pass over the same geometry and matrix that wrote the depth: depths then agree to the bit.
    Equal,
    /// Always.
    Always,
}

/// How colour is put over what is there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Blend {
    /// Replaces it.
    #[default]
    Replace,
    /// Premultiplied "over".
    Over,
}

/// What an id buffer gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ids {
    /// One id for the draw.
    Constant(u32),
    /// This for triangle 0, one more for each following triangle (wrapping).
    PerTriangle(u32),
}

impl Ids {
    /// The id of a triangle, point or segment of the draw.
    #[inline(always)]
    pub(crate) fn of(self, index: u32) -> u32 {
        match self {
            Self::Constant(id) => id,
            Self::PerTriangle(first) => first.wrapping_add(index),
        }
    }
}

/// Fixed-function state of a draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct State {
    /// Sides that are dropped; front faces appear counter-clockwise.
    pub cull: Cull,
    /// Depth test.
    pub depth_test: DepthTest,
    /// Whether depth is written.
    pub depth_write: bool,
    /// Whether geometry before the near and beyond the far plane is kept, its depth clamped.
    pub depth_clamp: bool,
    /// Ids.
    pub ids: Ids,
    /// Blending.
    pub blend: Blend,
}

impl Default for State {
    /// No culling, nearest wins, depth written, id 1.
    fn default() -> Self {
        Self {
            cull: Cull::None,
            depth_test: DepthTest::Nearer,
            depth_write: true,
            depth_clamp: false,
            ids: Ids::Constant(1),
            blend: Blend::Replace,
        }
    }
}

/// Triangles and where they appear.
#[derive(Clone, Copy, Debug)]
pub struct Draw<'a> {
    /// Corner positions.
    pub positions: &'a [Vec3],
    /// Indices into `positions`.
    pub triangles: &'a [[u32; 3]],
    /// Any matrix into clip space with y up and depth from w (near) to 0 (far): that of
    /// [`ClipConvention::REVERSED`](farsight_geometry::ClipConvention::REVERSED). See [`native_from`](crate::native_from) for others.
    /// Vertices are transformed in `f64`.
    pub clip_from_local: DMat4,
    /// State.
    pub state: State,
}

/// A covered pixel that passed the depth test.
pub struct Fragment<'a> {
    /// Column.
    pub x: u32,
    /// Row.
    pub y: u32,
    /// Depth.
    pub depth: f32,
    /// Index of the triangle in the draw.
    pub triangle: u32,
    planes: &'a [DVec3; 3],
}

impl Fragment<'_> {
    /// Perspective-correct weights of the triangle's three corners at the pixel's centre.
    ///
    /// Computed in `f64` from the corners before snapping and clipping; a centre that only snapping put inside
    /// gets weights clamped to the triangle.
    #[inline]
    pub fn weights(&self) -> Vec3 {
        let weights = self.weights_at(0.0, 0.0);
        let clamped = weights.max(DVec3::ZERO);
        let sum = clamped.element_sum();
        if sum.is_finite() && sum > 0.0 { (clamped / sum).as_vec3() } else { Vec3::splat(1.0 / 3.0) }
    }

    /// How the weights change per pixel to the right and per pixel down.
    #[inline]
    pub fn weight_gradients(&self) -> [Vec3; 2] {
        let p = self.planes;
        let values = self.raw(0.0, 0.0);
        let sum = values.element_sum();
        let gradient = |axis: usize| {
            let change = DVec3::new(p[0][axis], p[1][axis], p[2][axis]);
            let g = (change - values * (change.element_sum() / sum)) / sum;
            if g.is_finite() { g.as_vec3() } else { Vec3::ZERO }
        };
        [gradient(0), gradient(1)]
    }

    fn weights_at(&self, dx: f64, dy: f64) -> DVec3 {
        let values = self.raw(dx, dy);
        values / values.element_sum()
    }

    fn raw(&self, dx: f64, dy: f64) -> DVec3 {
        let at = DVec3::new(f64::from(self.x) + 0.5 + dx, f64::from(self.y) + 0.5 + dy, 1.0);
        DVec3::new(self.planes[0].dot(at), self.planes[1].dot(at), self.planes[2].dot(at))
    }
}

/// Computes the colour of pixels.
pub trait PixelShader {
    /// Linear colour premultiplied by its coverage; `None` leaves the pixel as it is (alpha test).
    fn shade(&self, fragment: &Fragment) -> Option<Vec4>;

    /// Whether [`depth`](Self::depth) is asked; the depth test then comes after it.
    const REPLACES_DEPTH: bool = false;

    /// The depth to test and write instead of the triangle's.
    fn depth(&self, fragment: &Fragment) -> f32 {
        fragment.depth
    }
}

impl<F: Fn(&Fragment) -> Option<Vec4>> PixelShader for F {
    fn shade(&self, fragment: &Fragment) -> Option<Vec4> {
        self(fragment)
    }
}

/// Draws; keeps its scratch memory and its counters from call to call.
#[derive(Debug)]
pub struct Rasteriser {
    level: Level,
    vertices: Vec<Vertex>,
    /// Work since the counters were last reset.
    pub counters: Counters,
}

impl Default for Rasteriser {
    fn default() -> Self {
        Self { level: Level::new(), vertices: Vec::new(), counters: Counters::default() }
    }
}

impl Rasteriser {
    /// A rasteriser for the best instruction set of this machine. Images do not depend on the instruction set.
    pub fn new() -> Self {
        Self::default()
    }

    /// Writes depth and ids, as far as `target` has them; colour is left alone.
    ///
    /// # Panics
    /// When an index of `draw` leads nowhere.
    pub fn draw(&mut self, target: &mut Target, draw: &Draw) {
        let mut sink = Plain { out: Buffers::new(target, &draw.state), id: 0, tested: 0, written: 0 };
        let level = self.level;
        dispatch!(level, simd => self.run(simd, draw, &mut sink));
        self.count(sink.tested, sink.written);
    }

    /// Writes depth, ids and the colours that `shader` computes.
    ///
    /// # Panics
    /// When an index of `draw` leads nowhere.
    pub fn draw_shaded<P: PixelShader>(&mut self, target: &mut Target, draw: &Draw, shader: &P) {
        let mut sink = Shaded {
            out: Buffers::new(target, &draw.state),
            shader,
            blend: draw.state.blend,
            id: 0,
            triangle: 0,
            planes: [DVec3::ZERO; 3],
            tested: 0,
            written: 0,
        };
        let level = self.level;
        dispatch!(level, simd => self.run(simd, draw, &mut sink));
        self.count(sink.tested, sink.written);
    }

    /// Counts the pixels that would pass the depth test, and writes nothing.
    ///
    /// # Panics
    /// When an index of `draw` leads nowhere.
    pub fn count_samples(&mut self, target: &Target, draw: &Draw) -> u64 {
        let mut sink = Count {
            depth: &target.depth,
            stride: target.stride(),
            size: [target.width(), target.height()],
            test: draw.state.depth_test,
            tested: 0,
            passed: 0,
        };
        let level = self.level;
        dispatch!(level, simd => self.run(simd, draw, &mut sink));
        self.count(sink.tested, 0);
        sink.passed
    }

    pub(crate) fn count(&mut self, tested: u64, written: u64) {
        self.counters.pixels_tested += tested;
        self.counters.pixels_written += written;
    }

    #[inline(always)]
    fn run<S: Simd, K: DrawSink<S>>(&mut self, simd: S, draw: &Draw, sink: &mut K) {
        let [width, height] = sink.size();
        let viewport = Viewport::new(width, height, draw.state.depth_clamp);
        let window = Window { x: [0, width as i32], y: [0, height as i32] };
        self.transform(draw, &viewport);
        self.counters.draws += 1;
        self.counters.vertices += draw.positions.len() as u64;
        self.counters.triangles += draw.triangles.len() as u64;
        let vertices = &self.vertices[..];
        let (mut outside, mut culled, mut drawn) = (0, 0, 0);
        for (index, corners) in draw.triangles.iter().enumerate() {
            let v = corners.map(|i| &vertices[i as usize]);
            if v[0].outcode & v[1].outcode & v[2].outcode & SIDES != 0 {
                outside += 1;
                continue;
            }
            if (v[0].outcode | v[1].outcode | v[2].outcode) & NEEDS_CLIP != 0 {
                self.counters.clipped += 1;
                clipped(simd, draw, index, &viewport, &window, &mut self.counters, sink);
                continue;
            }
            match Setup::new(&v, draw.state.cull, &window) {
                Err(_) => culled += 1,
                Ok(None) => {}
                Ok(Some(setup)) => {
                    drawn += 1;
                    sink.begin(index as u32, draw.state.ids, || v.map(|v| v.homogeneous()));
                    setup.scan(simd, &window, sink);
                }
            }
        }
        self.counters.outside += outside;
        self.counters.culled += culled;
        self.counters.drawn += drawn;
    }

    #[inline(always)]
    fn transform(&mut self, draw: &Draw, viewport: &Viewport) {
        self.vertices.clear();
        self.vertices.extend(draw.positions.iter().map(|&p| {
            let clip = to_clip(draw, p);
            Vertex::project(clip, viewport, viewport.outcode(clip))
        }));
    }
}

#[inline(always)]
fn to_clip(draw: &Draw, p: Vec3) -> DVec4 {
    let m = &draw.clip_from_local;
    m.x_axis * f64::from(p.x) + m.y_axis * f64::from(p.y) + m.z_axis * f64::from(p.z) + m.w_axis
}

/// The slow path: clips one triangle and draws the pieces.
#[inline(never)]
fn clipped<S: Simd, K: DrawSink<S>>(
    simd: S,
    draw: &Draw,
    index: usize,
    viewport: &Viewport,
    window: &Window,
    counters: &mut Counters,
    sink: &mut K,
) {
    let corners = draw.triangles[index].map(|i| to_clip(draw, draw.positions[i as usize]));
    let polygon = viewport.clip(corners);
    let (mut covered, mut culled) = (false, false);
    for i in 2..polygon.corners().len() {
        let piece = [0, i - 1, i].map(|k| Vertex::project(polygon.corners()[k], viewport, 0));
        if piece.iter().any(|v| !(v.x.is_finite() && v.y.is_finite() && v.z.is_finite())) {
            continue;
        }
        match Setup::new(&[&piece[0], &piece[1], &piece[2]], draw.state.cull, window) {
            Err(_) => culled = true,
            Ok(None) => {}
            Ok(Some(setup)) => {
                covered = true;
                sink.begin(index as u32, draw.state.ids, || corners.map(|p| viewport.homogeneous_px(p)));
                // This function is not part of what was compiled for the instruction set.
                simd.vectorize(
                    #[inline(always)]
                    || setup.scan(simd, window, sink),
                );
            }
        }
    }
    counters.drawn += u64::from(covered);
    counters.culled += u64::from(culled && !covered);
}

/// A [`Sink`] that is told of triangles.
trait DrawSink<S: Simd>: Sink<S> {
    fn size(&self) -> [u32; 2];
    fn begin(&mut self, triangle: u32, ids: Ids, homogeneous: impl Fn() -> [DVec3; 3]);
}

/// Depth and ids of a target with the tests that guard them.
struct Buffers<'a> {
    target: &'a mut Target,
    stride: usize,
    test: DepthTest,
    write_depth: bool,
    write_id: bool,
}

impl<'a> Buffers<'a> {
    fn new(target: &'a mut Target, state: &State) -> Self {
        let outputs = target.outputs();
        Self {
            stride: target.stride(),
            test: if outputs.depth { state.depth_test } else { DepthTest::Always },
            write_depth: outputs.depth && state.depth_write,
            write_id: outputs.id,
            target,
        }
    }
}

#[inline(always)]
fn passing<S: Simd>(
    simd: S,
    test: DepthTest,
    inside: mask32x8<S>,
    depth: f32x8<S>,
    buffer: &[f32],
    at: usize,
) -> mask32x8<S> {
    if test == DepthTest::Always || buffer.is_empty() {
        return inside;
    }
    let old = f32x8::from_slice(simd, &buffer[at..at + GROUP]);
    inside
        & match test {
            DepthTest::Nearer => depth.simd_gt(old),
            DepthTest::NearerOrEqual => depth.simd_ge(old),
            _ => depth.simd_eq(old),
        }
}

/// The depth test of one pixel; without a buffer everything passes.
pub(crate) fn passes(test: DepthTest, depth: f32, old: Option<f32>) -> bool {
    old.is_none_or(|old| match test {
        DepthTest::Nearer => depth > old,
        DepthTest::NearerOrEqual => depth >= old,
        DepthTest::Equal => depth == old,
        DepthTest::Always => true,
    })
}

/// Writes depth and ids.
struct Plain<'a> {
    out: Buffers<'a>,
    id: u32,
    tested: u64,
    written: u64,
}

impl<S: Simd> Sink<S> for Plain<'_> {
    #[inline(always)]
    fn row(&mut self, _: i32, begin: i32, end: i32) {
        self.tested += (end - begin) as u64;
    }

    #[inline(always)]
    fn group(&mut self, simd: S, x: i32, y: i32, inside: mask32x8<S>, depth: f32x8<S>) {
        let at = y as usize * self.out.stride + x as usize;
        let pass = passing(simd, self.out.test, inside, depth, &self.out.target.depth, at);
        self.written += u64::from(pass.to_bitmask().count_ones());
        if self.out.write_depth {
            let slot = &mut self.out.target.depth[at..at + GROUP];
            pass.select(depth, f32x8::from_slice(simd, slot)).store_slice(slot);
        }
        if self.out.write_id {
            let slot = &mut self.out.target.id[at..at + GROUP];
            pass.select(u32x8::splat(simd, self.id), u32x8::from_slice(simd, slot)).store_slice(slot);
        }
    }
}

impl<S: Simd> DrawSink<S> for Plain<'_> {
    fn size(&self) -> [u32; 2] {
        [self.out.target.width(), self.out.target.height()]
    }

    #[inline(always)]
    fn begin(&mut self, triangle: u32, ids: Ids, _: impl Fn() -> [DVec3; 3]) {
        self.id = ids.of(triangle);
    }
}

/// Writes depth, ids and colour.
struct Shaded<'a, P> {
    out: Buffers<'a>,
    shader: &'a P,
    blend: Blend,
    id: u32,
    triangle: u32,
    planes: [DVec3; 3],
    tested: u64,
    written: u64,
}

impl<P: PixelShader> Shaded<'_, P> {
    fn pixel(&mut self, x: i32, y: i32, mut depth: f32) {
        let fragment =
            Fragment { x: x as u32, y: y as u32, depth, triangle: self.triangle, planes: &self.planes };
        let at = y as usize * self.out.stride + x as usize;
        if P::REPLACES_DEPTH {
            depth = self.shader.depth(&fragment).clamp(0.0, 1.0);
            if !passes(self.out.test, depth, self.out.target.depth.get(at).copied()) {
                return;
            }
        }
        let Some(colour) = self.shader.shade(&fragment) else { return };
        self.written += 1;
        if self.out.write_depth {
            self.out.target.depth[at] = depth;
        }
        if self.out.write_id {
            self.out.target.id[at] = self.id;
        }
        if let Some(slot) = self.out.target.colour.get_mut(at) {
            *slot = blended(self.blend, colour, *slot);
        }
    }
}

#[inline(always)]
pub(crate) fn blended(blend: Blend, colour: Vec4, below: [f32; 4]) -> [f32; 4] {
    match blend {
        Blend::Replace => colour.to_array(),
        Blend::Over => (colour + Vec4::from_array(below) * (1.0 - colour.w)).to_array(),
    }
}

impl<S: Simd, P: PixelShader> Sink<S> for Shaded<'_, P> {
    #[inline(always)]
    fn row(&mut self, _: i32, begin: i32, end: i32) {
        self.tested += (end - begin) as u64;
    }

    #[inline(always)]
    fn group(&mut self, simd: S, x: i32, y: i32, inside: mask32x8<S>, depth: f32x8<S>) {
        let at = y as usize * self.out.stride + x as usize;
        let test = if P::REPLACES_DEPTH { DepthTest::Always } else { self.out.test };
        let pass = passing(simd, test, inside, depth, &self.out.target.depth, at);
        let mut bits = pass.to_bitmask();
        while bits != 0 {
            let lane = bits.trailing_zeros();
            bits &= bits - 1;
            self.pixel(x + lane as i32, y, depth[lane as usize & (GROUP - 1)]);
        }
    }
}

impl<S: Simd, P: PixelShader> DrawSink<S> for Shaded<'_, P> {
    fn size(&self) -> [u32; 2] {
        [self.out.target.width(), self.out.target.height()]
    }

    #[inline(always)]
    fn begin(&mut self, triangle: u32, ids: Ids, homogeneous: impl Fn() -> [DVec3; 3]) {
        self.id = ids.of(triangle);
        self.triangle = triangle;
        // Homogeneous rasterisation after Olano and Greer 1997: the rows of the inverse of the corner matrix, up to
        // a common factor, are the corners' weights divided by w.
        let [a, b, c] = homogeneous();
        self.planes = [b.cross(c), c.cross(a), a.cross(b)];
    }
}

/// Counts pixels that pass.
struct Count<'a> {
    depth: &'a [f32],
    stride: usize,
    size: [u32; 2],
    test: DepthTest,
    tested: u64,
    passed: u64,
}

impl<S: Simd> Sink<S> for Count<'_> {
    #[inline(always)]
    fn row(&mut self, _: i32, begin: i32, end: i32) {
        self.tested += (end - begin) as u64;
    }

    #[inline(always)]
    fn group(&mut self, simd: S, x: i32, y: i32, inside: mask32x8<S>, depth: f32x8<S>) {
        let at = y as usize * self.stride + x as usize;
        let pass = passing(simd, self.test, inside, depth, self.depth, at);
        self.passed += u64::from(pass.to_bitmask().count_ones());
    }
}

impl<S: Simd> DrawSink<S> for Count<'_> {
    fn size(&self) -> [u32; 2] {
        self.size
    }

    #[inline(always)]
    fn begin(&mut self, _: u32, _: Ids, _: impl Fn() -> [DVec3; 3]) {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenes::City;
    use crate::{Outputs, relative_from_mesh};

    /// Depth bits, ids and colours of a small town at a level.
    fn image(level: Level) -> (Vec<u32>, Vec<u32>, Vec<[u32; 4]>) {
        let city = City::small();
        let scene = city.build().unwrap();
        let camera = crate::scenes::Path::street_walk(&city).camera(1, 4).unwrap();
        let camera = camera.with_image(203, 117).unwrap();
        let mut rasteriser = Rasteriser { level, ..Rasteriser::new() };
        let mut target = Target::new(203, 117, Outputs::ALL).unwrap();
        let clip = camera.clip_from_relative_f64(farsight_geometry::ClipConvention::REVERSED, camera.eye());
        for (i, instance) in scene.instances().iter().enumerate() {
            let mesh = scene.mesh_of(instance);
            let relative = relative_from_mesh(instance, mesh, camera.eye());
            let draw = Draw {
                positions: mesh.positions(),
                triangles: mesh.triangles(),
                clip_from_local: clip * DMat4::from(relative),
                state: State { ids: Ids::Constant(i as u32 + 1), ..State::default() },
            };
            if i % 2 == 0 {
                rasteriser.draw(&mut target, &draw);
            } else {
                rasteriser.draw_shaded(&mut target, &draw, &|f: &Fragment| Some(f.weights().extend(1.0)));
            }
        }
        let depth = target.depth_rows().flatten().map(|d| d.to_bits()).collect();
        let colour = target.colour_rows().flatten().map(|c| c.map(f32::to_bits)).collect();
        (depth, target.ids().collect(), colour)
    }

    #[test]
    fn every_instruction_set_draws_the_same_bytes() {
        let best = image(Level::new());
        assert!(best.1.iter().filter(|&&id| id != 0).count() > 5000);
        assert!(best == image(Level::baseline()));
    }
}
