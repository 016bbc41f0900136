//! Nodes of hierarchies that stand for large surfaces: offered to the planner, read in the background, drawn with their rims.

use crate::surfaces::Surface;
use farsight_geometry::{Camera, TriangleMesh};
use farsight_hlod::{
    HlodError, Mesh, NodeId, NodeMesh, PrefetchOptions, Selection, Selector, Stream, StreamOptions,
    ViewOptions,
};
use farsight_plan::{Detail, Form, Kind, ObjectView};
use farsight_raster::{Part, Side};
use std::error::Error;
use std::time::{Duration, Instant};

/// Bytes of meshes in memory, for each hierarchy.
const MEMORY: u64 = 64 << 20;
/// How far ahead nodes are read, as a share of a surface's size.
const AHEAD: f64 = 0.02;
/// Tolerances that the planner is offered, each twice the one before. The first is a little below what is asked for, so that it stays when views vary.
const RUNGS: usize = 7;
const FIRST: f64 = 0.9;
/// How long a frame waits for nodes at most, where it may.
const PATIENCE: Duration = Duration::from_secs(5);

/// Hierarchies of a scene as the frames go by.
pub struct Nodes {
    surfaces: Vec<Live>,
}

/// What was drawn of hierarchies in a frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct NodesReport {
    pub surfaces: usize,
    pub nodes: usize,
    pub triangles: u64,
    /// Pixels that anything may be off, and that colours may be; the latter estimated, zero without attributes.
    pub error_px: f64,
    pub look_px: f64,
    /// Nodes that were not there in time.
    pub missing: usize,
    /// Bytes in memory.
    pub bytes: u64,
}

/// What a form of an object is made of.
#[derive(Clone, Copy)]
enum Source {
    /// Nodes within so many pixels.
    Nodes(f64),
    /// One of the forms made beforehand.
    Form(u32),
}

struct Live {
    instance: u32,
    closed: bool,
    /// Whether nobody sees backs in this frame.
    backs_hidden: bool,
    stream: Stream,
    /// What is in memory, as the renderer takes it.
    meshes: Vec<Option<Node>>,
    rungs: [Selector; RUNGS],
    selection: Selection,
    details: Vec<Detail>,
    sources: Vec<Source>,
    /// Nodes to draw.
    drawn: Vec<NodeId>,
}

/// A node's mesh, and the sides that neighbours may not fit.
struct Node {
    mesh: TriangleMesh,
    sides: Vec<Side>,
}

impl Nodes {
    /// Opens hierarchies for drawing.
    pub fn new(surfaces: &[Surface]) -> Result<Self, HlodError> {
        Ok(Self { surfaces: surfaces.iter().map(Live::new).collect::<Result<_, _>>()? })
    }

    /// Finds out what views of the hierarchies would take, at several tolerances from `px` on; `seen` are the objects as the view has them, `forms` those made
    /// beforehand.
    pub fn look<'f>(
        &mut self,
        camera: &Camera,
        px: f64,
        seen: &[ObjectView],
        forms: impl Fn(u32) -> &'f [Detail],
    ) {
        for surface in &mut self.surfaces {
            let seen = &seen[surface.instance as usize];
            surface.look(camera, px, seen, forms(surface.instance));
        }
    }

    /// The forms that the planner may choose from, by object.
    pub fn offers(&self) -> impl Iterator<Item = (u32, &[Detail])> {
        self.surfaces.iter().map(|s| (s.instance, &s.details[..]))
    }

    /// Which of the forms made beforehand a choice among an object's offers is: the same number where it has no hierarchy, `None` for nodes.
    pub fn form(&self, object: u32, detail: u32) -> Option<u32> {
        match self.surfaces.binary_search_by_key(&object, |s| s.instance) {
            Err(_) => Some(detail),
            Ok(at) => match self.surfaces[at].sources[detail as usize] {
                Source::Form(form) => Some(form),
                Source::Nodes(_) => None,
            },
        }
    }

    /// Gets ready what was chosen, which `chosen` tells by object. `patient` frames wait until all of it was read; others draw what is there.
    pub fn choose(
        &mut self,
        camera: &Camera,
        chosen: impl Fn(u32) -> Option<u32>,
        patient: bool,
    ) -> Result<NodesReport, Box<dyn Error>> {
        let mut report = NodesReport::default();
        for surface in &mut self.surfaces {
            surface.drawn.clear();
            if let Some(Source::Nodes(px)) = chosen(surface.instance).map(|d| surface.sources[d as usize]) {
                surface.choose(camera, px, patient, &mut report)?;
            }
        }
        Ok(report)
    }

    /// What was chosen, sorted by object; rims are lines of `width_px` samples.
    pub fn parts(&self, width_px: u32) -> Vec<Part<'_>> {
        self.surfaces.iter().flat_map(|s| s.parts(width_px)).collect()
    }
}

impl Live {
    fn new(surface: &Surface) -> Result<Self, HlodError> {
        let size = surface.store.tree().world_bounds().diagonal();
        let options = StreamOptions::default()
            .with_memory_bytes(MEMORY)
            .with_prefetch(PrefetchOptions::within(AHEAD * size));
        let nodes = surface.store.tree().ids().len();
        Ok(Self {
            instance: surface.instance,
            closed: surface.closed,
            backs_hidden: false,
            stream: Stream::new(surface.store.clone(), Mesh::Full, options)?,
            meshes: (0..nodes).map(|_| None).collect(),
            rungs: Default::default(),
            selection: Selection::default(),
            details: Vec::new(),
            sources: Vec::new(),
            drawn: Vec::new(),
        })
    }

    fn parts(&self, width_px: u32) -> impl Iterator<Item = Part<'_>> {
        let nodes = self.drawn.iter().filter_map(|n| self.meshes[n.0 as usize].as_ref());
        nodes.map(move |n| Part {
            instance: self.instance,
            mesh: &n.mesh,
            sides: &n.sides,
            width_px,
            cull_backs: self.backs_hidden,
        })
    }

    fn options(&self, px: f64) -> ViewOptions {
        ViewOptions::error(px).with_backs_culled(self.backs_hidden)
    }

    fn look(&mut self, camera: &Camera, px: f64, seen: &ObjectView, forms: &[Detail]) {
        self.details.clear();
        self.sources.clear();
        // From inside, the backs of a closed surface are all that is seen.
        let inside = self.stream.store().tree().world_bounds().contains(camera.eye());
        self.backs_hidden = self.closed && !inside;
        if !seen.in_view {
            return;
        }
        let mut all: Vec<(Detail, Source)> =
            (0..).zip(forms).map(|(i, &detail)| (detail, Source::Form(i))).collect();
        for k in 0..RUNGS {
            let px = px * FIRST * f64::from(1u32 << k);
            let options = self.options(px);
            let tree = self.stream.store().tree();
            self.rungs[k].select(tree, camera, &options, |_| true, &mut self.selection);
            let shape = self.selection.geometric.map_or(0.0, |e| e.value);
            let looks = self.selection.appearance;
            // What is in the leaves cannot be had any finer.
            let error = px.max(shape).max(looks.map_or(0.0, |e| e.value)) / seen.px_per_unit;
            let kind = looks.map_or(Kind::Proven, |e| e.kind);
            let elements = self.selection.triangles as f64;
            all.push((Detail { form: Form::Mesh, error, kind, elements }, Source::Nodes(px)));
        }
        all.sort_by(|(a, _), (b, _)| a.error.total_cmp(&b.error).then(a.elements.total_cmp(&b.elements)));
        let mut least = self.stream.store().tree().input_triangles() as f64;
        for (detail, source) in all {
            // What is farther off and no lighter is no choice.
            if detail.elements < least {
                least = detail.elements;
                self.details.push(detail);
                self.sources.push(source);
            }
        }
    }

    fn choose(
        &mut self,
        camera: &Camera,
        px: f64,
        patient: bool,
        report: &mut NodesReport,
    ) -> Result<(), Box<dyn Error>> {
        let options = self.options(px);
        let start = Instant::now();
        let Self { stream, meshes, drawn, .. } = self;
        let missing = loop {
            let frame = stream.frame(camera, &options);
            frame.went.iter().for_each(|n| meshes[n.0 as usize] = None);
            for &came in frame.came {
                if let Some(mesh) = frame.mesh(came) {
                    meshes[came.0 as usize] = Some(Node::new(mesh)?);
                }
            }
            let missing = frame.selection.wanted.len();
            if missing == 0 || !patient || start.elapsed() > PATIENCE {
                drawn.clear();
                drawn.extend(frame.selection.drawn.iter().map(|d| d.node));
                report.surfaces += 1;
                report.nodes += drawn.len();
                report.triangles += frame.selection.triangles;
                let most =
                    |of: f64, error: Option<farsight_plan::ErrorBound>| error.map_or(of, |e| of.max(e.value));
                report.error_px = most(report.error_px, frame.selection.geometric);
                report.look_px = most(report.look_px, frame.selection.appearance);
                break missing;
            }
            std::thread::sleep(Duration::from_micros(200));
        };
        report.missing += missing;
        report.bytes += stream.cached_bytes();
        match stream.take_failures().into_iter().next() {
            Some((_, error)) => Err(error.into()),
            None => Ok(()),
        }
    }
}

impl Node {
    fn new(node: &NodeMesh) -> Result<Self, Box<dyn Error>> {
        let mesh = node.to_mesh()?;
        let sides = Side::between(&mesh, &node.rims);
        Ok(Self { mesh, sides })
    }
}
