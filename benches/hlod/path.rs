//! Tables 3 and 4 of Guthe 2004: one camera path at half a pixel, four kinds of levels, without, with hard and with soft shadows.

use crate::points::{self, Points};
use crate::shadows::{self, Shadow, Sun};
use crate::{Outcome, built, generated, scanned, temp};
use farsight_geometry::glam::{DVec3, Vec3};
use farsight_geometry::{Camera, ClipConvention, DAabb, TriangleMesh};
use farsight_hlod::{
    BuildOptions, Mesh, NodeId, NodeMesh, Selection, Selector, Splats, Store, Tier, ViewOptions,
};
use farsight_raster::{
    Draw, Fragment, Image, LineDraw, Outputs, PointDraw, Rasteriser, Splat, State, Target, thread_cpu_time,
};
use farsight_shadow::Focus;
use std::collections::HashMap;
use std::error::Error;
use std::time::Duration;

/// Views of the path.
pub const FRAMES: u32 = 24;

/// Pixels that anything may be off.
const ERROR_PX: f64 = 0.5;

/// Bytes of a point on disk: what QSplat publishes for a node with a normal and without a colour. The only figure here that was not measured.
const POINT_BYTES: u64 = 4;

/// What is drawn of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Triangles(Mesh),
    /// Small triangles as points.
    Mixed,
    /// Everything as points of a pixel.
    Points,
}

impl Kind {
    fn mesh(self) -> Mesh {
        if let Self::Triangles(mesh) = self { mesh } else { Mesh::Full }
    }
}

const KINDS: [(&str, Kind); 4] = [
    ("with appearance", Kind::Triangles(Mesh::Full)),
    ("with appearance, points", Kind::Mixed),
    ("shape alone", Kind::Triangles(Mesh::Shape)),
    ("points alone", Kind::Points),
];

const SUNS: [(&str, Sun); 3] = [("no", Sun::Open), ("hard", Sun::Hard), ("soft", Sun::Soft(0.06))];

/// Decoded nodes: reading them is not part of a frame here.
pub struct Cache<'a> {
    pub store: &'a Store,
    /// Normals of the rims' first vertices.
    rim_normals: [HashMap<NodeId, Vec<Vec3>>; 2],
    meshes: [HashMap<NodeId, NodeMesh>; 2],
    splats: HashMap<NodeId, Splats>,
}

impl<'a> Cache<'a> {
    fn new(store: &'a Store) -> Result<Self, Box<dyn Error>> {
        let empty = || [HashMap::new(), HashMap::new()];
        let mut cache = Self {
            store,
            rim_normals: [HashMap::new(), HashMap::new()],
            meshes: empty(),
            splats: HashMap::new(),
        };
        let tree = store.tree();
        for n in tree.ids() {
            for (i, mesh) in [Mesh::Full, Mesh::Shape].into_iter().enumerate() {
                let mut node = NodeMesh::default();
                store.read(n, mesh, &mut node)?;
                cache.rim_normals[i].insert(n, rim_normals(&node));
                cache.meshes[i].insert(n, node);
            }
            let mut splats = Splats::default();
            splats.fill(&cache.meshes[0][&n], tree.error(n, Mesh::Full).value);
            cache.splats.insert(n, splats);
        }
        Ok(cache)
    }

    pub fn mesh(&self, node: NodeId, mesh: Mesh) -> &NodeMesh {
        &self.meshes[usize::from(mesh == Mesh::Shape)][&node]
    }
}

fn rim_normals(node: &NodeMesh) -> Vec<Vec3> {
    let mut normals = node.normals.clone();
    if normals.is_empty() {
        normals = vec![Vec3::ZERO; node.positions.len()];
        for t in node.indices.as_chunks::<3>().0 {
            let [a, b, c] = t.map(|v| node.positions[v as usize]);
            t.iter().for_each(|&v| normals[v as usize] += (b - a).cross(c - a));
        }
    }
    node.rims.iter().map(|r| normals[r[0] as usize].normalize_or_zero()).collect()
}

/// The whole path with one kind and one light.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    triangles: u64,
    points: u64,
    casters: u64,
    disk: u64,
    memory: u64,
    choosing: Duration,
    drawing: Duration,
    slowest: Duration,
}

pub fn tables(quick: bool) -> Outcome {
    let mut models = vec![("wrinkled ball".to_owned(), generated(if quick { 40 } else { 140 }))];
    models.extend(scanned(quick, &["armadillo.obj", "igea.glb"])?);
    for (name, mesh) in models {
        let file = temp("path");
        let options = BuildOptions::default().with_tier(Tier::Verified);
        let options = if quick { options.with_most_triangles(2000) } else { options };
        built(&mesh, &file, &options)?;
        let store = Store::open(&file)?;
        model(&name, &mesh, &store)?;
        std::fs::remove_file(&file)?;
    }
    Ok(())
}

fn model(name: &str, mesh: &TriangleMesh, store: &Store) -> Outcome {
    println!(
        "\n{name}, {} triangles: {FRAMES} views from 1.3 to 40 radii at half a pixel, 640 x 480, per frame; ms of one thread, and the rate over that without shadows",
        mesh.triangles().len()
    );
    println!(
        "{:<24} {:<7} {:>9} {:>9} {:>9} {:>8} {:>8} {:>8} {:>8} {:>8} {:>6}",
        "levels",
        "shadows",
        "triangles",
        "points",
        "casters",
        "kB disk",
        "kB mem",
        "choose",
        "draw",
        "slowest",
        "rate"
    );
    let cache = Cache::new(store)?;
    for (what, kind) in KINDS {
        let mut open = 0.0;
        for (light, sun) in SUNS {
            let sum = walk(mesh, &cache, kind, sun)?;
            let ms = |d: Duration| d.as_secs_f64() * 1e3;
            let drawn = ms(sum.drawing) / f64::from(FRAMES);
            open = if sun == Sun::Open { drawn } else { open };
            let each = |n: u64| n / u64::from(FRAMES);
            println!(
                "{what:<24} {light:<7} {:>9} {:>9} {:>9} {:>8.1} {:>8.1} {:>8.3} {drawn:>8.2} {:>8.2} {:>6.2}",
                each(sum.triangles),
                each(sum.points),
                each(sum.casters),
                each(sum.disk) as f64 / 1e3,
                each(sum.memory) as f64 / 1e3,
                ms(sum.choosing) / f64::from(FRAMES),
                ms(sum.slowest),
                open / drawn
            );
        }
    }
    Ok(())
}

/// A view of the path.
pub fn camera(mesh: &TriangleMesh, frame: u32) -> Result<Camera, Box<dyn Error>> {
    let bounds = mesh.world_bounds();
    let radius = 0.5 * bounds.diagonal();
    let t = f64::from(frame) / f64::from(FRAMES - 1);
    let distance = 1.3 * (40.0f64 / 1.3).powf(t) * radius;
    let eye = bounds.center() + DVec3::new((3.0 * t).sin(), 0.4, (3.0 * t).cos()).normalize() * distance;
    let camera = Camera::look_at(eye, bounds.center(), DVec3::Y)?;
    Ok(camera.with_range(0.02 * radius, 200.0 * radius)?.with_image(640, 480)?)
}

/// A square that the model stands on.
fn ground(mesh: &TriangleMesh) -> NodeMesh {
    let bounds = mesh.world_bounds();
    let side = 1.5 * bounds.diagonal() as f32;
    let mut ground = NodeMesh::default();
    ground.origin = DVec3::new(bounds.center().x, bounds.min.y, bounds.center().z);
    ground.positions = [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)]
        .map(|(x, z)| Vec3::new(x * side, 0.0, z * side))
        .into();
    ground.indices = vec![0, 1, 2, 0, 2, 3];
    ground
}

fn walk(mesh: &TriangleMesh, cache: &Cache, kind: Kind, sun: Sun) -> Result<Sum, Box<dyn Error>> {
    let mut sum = Sum::default();
    let (mut selector, mut selection, mut focus) = (Selector::new(), Selection::default(), Focus::new());
    let direction = DVec3::new(-0.5, -0.8, -0.35).normalize();
    let ground = ground(mesh);
    let floor = DAabb::from_points(ground.positions.iter().map(|p| ground.origin + p.as_dvec3()));
    let tree = cache.store.tree();
    let options = ViewOptions::error(ERROR_PX).with_mesh(kind.mesh()).with_backs_culled(true);
    for frame in 0..FRAMES {
        let camera = camera(mesh, frame)?;
        let start = thread_cpu_time();
        selector.select(tree, &camera, &options, |_| true, &mut selection);
        let mut receivers: Vec<DAabb> = selection.drawn.iter().map(|d| tree.bounds(d.node)).collect();
        let casters = (sun != Sun::Open)
            .then(|| shadows::casters(sun, direction, &camera, cache.store, &selection, &receivers));
        sum.choosing += thread_cpu_time() - start;
        receivers.push(floor);
        let points: Vec<Points> = if kind == Kind::Points {
            selection
                .drawn
                .iter()
                .map(|d| pixel_points(&camera, tree.bounds(d.node), cache.mesh(d.node, Mesh::Full)))
                .collect()
        } else {
            Vec::new()
        };
        let start = thread_cpu_time();
        let shadow = match &casters {
            Some(casters) => shadows::draw(sun, direction, &camera, &receivers, casters, cache, &mut focus)?,
            None => None,
        };
        let view = View { camera: &camera, shadow: shadow.as_ref(), towards_light: -direction.as_vec3() };
        let mut target = Target::new(640, 480, Outputs { colour: true, depth: true, id: false })?;
        view.triangles(&mut target, &ground, &ground.indices, &[]);
        for (i, d) in selection.drawn.iter().enumerate() {
            let node = cache.mesh(d.node, kind.mesh());
            let rims = &cache.rim_normals[usize::from(kind.mesh() == Mesh::Shape)][&d.node];
            match kind {
                Kind::Triangles(_) => view.triangles(&mut target, node, &node.indices, rims),
                Kind::Mixed => {
                    let splats = &cache.splats[&d.node];
                    view.triangles(&mut target, node, &splats.indices, rims);
                    view.points(
                        &mut target,
                        node.origin,
                        &splats.positions,
                        &splats.normals,
                        splats.radius.into(),
                    );
                }
                Kind::Points => {
                    let p = &points[i];
                    view.points(&mut target, node.origin, &p.positions, &p.normals, p.radius);
                }
            }
        }
        let time = thread_cpu_time() - start;
        sum.drawing += time;
        sum.slowest = sum.slowest.max(time);
        save(&target, kind, sun, frame)?;
        count(&mut sum, kind, cache, &selection, &points);
        sum.casters += casters.map_or(0, |c| c.triangles);
    }
    Ok(sum)
}

/// Points of about a pixel for a node: their reach is half a pixel at the nearest point of its box, which its error does not exceed.
fn pixel_points(camera: &Camera, bounds: DAabb, mesh: &NodeMesh) -> Points {
    let reach = camera.world_error(ERROR_PX, camera.distance_to_box(&bounds).max(camera.near()));
    points::all(mesh, reach)
}

fn count(sum: &mut Sum, kind: Kind, cache: &Cache, selection: &Selection, points: &[Points]) {
    let tree = cache.store.tree();
    for (i, d) in selection.drawn.iter().enumerate() {
        let mesh = kind.mesh();
        if kind == Kind::Points {
            let n = points[i].positions.len() as u64;
            sum.points += n;
            sum.disk += POINT_BYTES * n;
            sum.memory += 24 * n;
            continue;
        }
        sum.disk += tree.disk_bytes(d.node, mesh);
        sum.memory += tree.memory_bytes(d.node, mesh);
        sum.triangles += u64::from(tree.triangles(d.node, mesh));
        if kind == Kind::Mixed {
            let splats = &cache.splats[&d.node];
            let gone = u64::from(tree.triangles(d.node, mesh)) - splats.indices.len() as u64 / 3;
            sum.triangles -= gone;
            sum.points += splats.positions.len() as u64;
            sum.memory = sum.memory + 24 * splats.positions.len() as u64 - 12 * gone;
        }
    }
}

/// Writes a frame of the path if a folder is named: what was timed should be looked at.
fn save(target: &Target, kind: Kind, sun: Sun, frame: u32) -> Outcome {
    if let Some(folder) = std::env::var_os("FARSIGHT_BENCH_IMAGES").filter(|_| frame == 2 || frame == 8) {
        let name =
            format!("{kind:?}-{sun:?}-{frame}.png").replace(['(', ')', '.'], "_").replace("_png", ".png");
        Image::from_colour(target).write_png(std::path::Path::new(&folder).join(name))?;
    }
    Ok(())
}

/// A frame being drawn.
struct View<'a> {
    camera: &'a Camera,
    shadow: Option<&'a Shadow>,
    towards_light: Vec3,
}

impl View<'_> {
    /// Brightness of a point relative to an origin.
    fn brightness(&self, origin: DVec3, at: Vec3, normal: Vec3) -> f32 {
        let facing = normal.dot(self.towards_light);
        if facing <= 0.0 {
            return 0.12;
        }
        let lit = self.shadow.map_or(1.0, |s| s.lit(at + (origin - s.origin()).as_vec3(), normal));
        0.12 + 0.7 * lit * facing
    }

    fn triangles(&self, target: &mut Target, node: &NodeMesh, indices: &[u32], rim_normals: &[Vec3]) {
        let clip_from_local = self.camera.clip_from_relative_f64(ClipConvention::REVERSED, node.origin);
        let state = State::default();
        let (positions, triangles) = (&node.positions[..], indices.as_chunks::<3>().0);
        let eye = (self.camera.eye() - node.origin).as_vec3();
        let shade = |f: &Fragment| {
            let (t, w) = (triangles[f.triangle as usize], f.weights().to_array());
            let mix = |of: &[Vec3]| (0..3).map(|i| of[t[i] as usize] * w[i]).sum::<Vec3>();
            let [a, b, c] = t.map(|v| positions[v as usize]);
            let at = mix(positions);
            let normal = if node.normals.is_empty() { (b - a).cross(c - a) } else { mix(&node.normals) };
            let normal = normal.normalize_or_zero();
            let normal = if normal.dot(eye - at) < 0.0 { -normal } else { normal };
            Some(Vec3::splat(self.brightness(node.origin, at, normal)).extend(1.0))
        };
        let mut rasteriser = Rasteriser::new();
        rasteriser.draw_shaded(target, &Draw { positions, triangles, clip_from_local, state }, &shade);
        for (rim, &normal) in node.rims.iter().zip(rim_normals) {
            let segment = rim.map(|v| positions[v as usize]);
            let normal = if normal.dot(eye - segment[0]) < 0.0 { -normal } else { normal };
            let colour = Vec3::splat(self.brightness(node.origin, segment[0], normal)).extend(1.0);
            let lines = LineDraw { segments: &[segment], colour, width_px: 1, clip_from_local, state };
            rasteriser.draw_lines(target, &lines);
        }
    }

    fn points(&self, target: &mut Target, origin: DVec3, positions: &[Vec3], normals: &[Vec3], radius: f64) {
        if positions.is_empty() {
            return;
        }
        let eye = (self.camera.eye() - origin).as_vec3();
        let (mut colours, mut sizes) =
            (Vec::with_capacity(positions.len()), Vec::with_capacity(positions.len()));
        for (i, &at) in positions.iter().enumerate() {
            let normal = normals.get(i).copied().unwrap_or(self.towards_light);
            let normal = if normal.dot(eye - at) < 0.0 { -normal } else { normal };
            let linear = self.brightness(origin, at, normal);
            let byte = farsight_raster::srgb_byte(linear);
            colours.push([byte, byte, byte, 255]);
            sizes.push(2.0 * self.camera.error_px(radius, f64::from(eye.distance(at))) as f32);
        }
        let clip_from_local = self.camera.clip_from_relative_f64(ClipConvention::REVERSED, origin);
        let state = State::default();
        let (splat, sizes_px) = (Splat::Round, &sizes[..]);
        let points = PointDraw { positions, colours: &colours, sizes_px, splat, clip_from_local, state };
        Rasteriser::new().draw_points(target, &points);
    }
}
