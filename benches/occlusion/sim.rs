//! A deterministic machine to cull for: one processor, one graphics unit that works in order, queries whose answers come
//! a latency after they were worked off, and an image to compare.

use super::town::{Object, World};
use farsight_geometry::bvh::NodeId;
use farsight_geometry::glam::DMat4;
use farsight_geometry::{Camera, ClipConvention, DAabb};
use farsight_occlusion::{Answer, Command, Culler, FrameStats, Hierarchy, Proxy, QueryId, Schedule, View};
use farsight_raster::{Draw, Ids, OcclusionQueries, Outputs, Random, Rasteriser, State, Target};

/// Microseconds that things take.
#[derive(Clone, Copy, Debug)]
pub struct Costs {
    pub cpu_node: f64,
    pub cpu_draw: f64,
    pub cpu_query: f64,
    pub gpu_draw: f64,
    pub gpu_triangle: f64,
    pub gpu_pixel: f64,
    pub gpu_query: f64,
    pub gpu_query_pixel: f64,
    /// From the end of a query on the graphics unit to its answer.
    pub latency: f64,
}

/// Pixels of the image that costs are for.
const COSTED_PIXELS: f64 = 1024.0 * 768.0;

impl Costs {
    pub fn with_latency(latency: f64) -> Self {
        Self {
            cpu_node: 0.15,
            cpu_draw: 4.0,
            cpu_query: 2.0,
            gpu_draw: 1.0,
            gpu_triangle: 0.005,
            gpu_pixel: 0.0004,
            gpu_query: 1.0,
            gpu_query_pixel: 0.0001,
            latency,
        }
    }
}

/// In which order answers that have come are handed over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrival {
    InOrder,
    Reversed,
    /// Any order, some of them withheld for a while.
    Shuffled(u64),
}

/// What a frame showed and took.
#[derive(Clone, Debug)]
pub struct Frame {
    pub time_us: f64,
    pub stats: FrameStats,
    pub draws: u64,
    pub triangles: u64,
    /// Flushes at which the processor stood still.
    pub stalls: u64,
    /// Nodes that were queried, sorted.
    pub queried: Vec<u32>,
}

struct Pending {
    id: QueryId,
    answer: Answer,
    ready: f64,
}

/// The machine.
pub struct Machine<'a> {
    pub world: &'a World,
    pub costs: Costs,
    pub arrival: Arrival,
    pub target: Target,
    rasteriser: Rasteriser,
    random: Random,
    pending: Vec<Pending>,
    cpu: f64,
    gpu: f64,
    /// Whether backends tell counts.
    pub counts: bool,
}

impl<'a> Machine<'a> {
    pub fn new(world: &'a World, costs: Costs, px: [u32; 2]) -> Self {
        Self {
            world,
            costs,
            arrival: Arrival::InOrder,
            target: Target::new(px[0], px[1], Outputs::DEPTH_ID).expect("a small image"),
            rasteriser: Rasteriser::new(),
            random: Random::new(1),
            pending: Vec::new(),
            cpu: 0.0,
            gpu: 0.0,
            counts: true,
        }
    }

    /// Lets time pass between frames.
    pub fn idle(&mut self, us: f64) {
        self.cpu = self.cpu.max(self.gpu) + us;
    }

    /// Hands over all answers that have come, for a culler that outlives the machine.
    pub fn hand_over(&mut self, culler: &mut Culler) {
        self.deliver(culler, false);
    }

    /// Runs a frame to its end.
    pub fn frame<H: Hierarchy>(&mut self, culler: &mut Culler, hierarchy: &H, camera: &Camera) -> Frame {
        let begin = self.cpu.max(self.gpu);
        (self.cpu, self.gpu) = (begin, begin);
        if let Arrival::Shuffled(seed) = self.arrival {
            self.random = Random::new(seed ^ begin.to_bits());
        }
        self.target.clear();
        let mut frame = Frame {
            time_us: 0.0,
            stats: FrameStats::default(),
            draws: 0,
            triangles: 0,
            stalls: 0,
            queried: Vec::new(),
        };
        self.deliver(culler, false);
        culler.begin_frame(View::from_camera(camera));
        let clip = camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye());
        let mut visited = 0;
        loop {
            self.deliver(culler, false);
            let command = culler.next(hierarchy);
            self.cpu += self.costs.cpu_node * (culler.stats().visited - visited) as f64;
            visited = culler.stats().visited;
            match command {
                Command::Render(node) => {
                    self.draw(node, camera, clip, &mut frame);
                }
                Command::Query { id, node, proxy, .. } => {
                    frame.queried.push(node.0);
                    self.query(culler, id, node, &proxy, camera, clip, &mut frame);
                }
                Command::Flush => {
                    frame.stalls += 1;
                    self.wait(culler);
                }
                Command::Done => break,
            }
        }
        frame.queried.sort_unstable();
        frame.stats = *culler.stats();
        frame.time_us = self.cpu.max(self.gpu) - begin;
        frame
    }

    fn draw(&mut self, node: NodeId, camera: &Camera, clip: DMat4, frame: &mut Frame) -> u64 {
        let mut written = 0;
        for id in self.world.bvh.objects_below(node) {
            let object = &self.world.objects[id as usize];
            let before = self.rasteriser.counters.pixels_written;
            let draw = draw_of(id, object, camera, clip);
            self.rasteriser.draw(&mut self.target, &draw);
            let pixels = self.rasteriser.counters.pixels_written - before;
            written += pixels;
            let triangles = object.nominal_triangles;
            let work = f64::from(triangles) * self.costs.gpu_triangle + self.costs.gpu_draw;
            self.cpu += self.costs.cpu_draw;
            self.gpu = self.gpu.max(self.cpu) + work + self.pixels(pixels) * self.costs.gpu_pixel;
            frame.draws += 1;
            frame.triangles += u64::from(triangles);
        }
        written
    }

    /// A count at the size that costs are for.
    fn pixels(&self, count: u64) -> f64 {
        count as f64 * COSTED_PIXELS / (f64::from(self.target.width()) * f64::from(self.target.height()))
    }

    fn query(
        &mut self,
        culler: &Culler,
        id: QueryId,
        node: NodeId,
        proxy: &Proxy,
        camera: &Camera,
        clip: DMat4,
        frame: &mut Frame,
    ) {
        self.cpu += self.costs.cpu_query;
        let before = self.rasteriser.counters.pixels_tested;
        let samples = match proxy {
            Proxy::Geometry => self.draw(node, camera, clip, frame),
            Proxy::Box(b) => self.count(b, camera, clip),
            Proxy::Boxes => culler.boxes().iter().map(|b| self.count(b, camera, clip)).sum(),
        };
        let tested = self.rasteriser.counters.pixels_tested - before;
        let pixels = if *proxy == Proxy::Geometry { 0.0 } else { self.pixels(tested) };
        self.gpu = self.gpu.max(self.cpu) + self.costs.gpu_query + pixels * self.costs.gpu_query_pixel;
        let answer = if self.counts {
            Answer::counted(samples)
        } else if samples > 0 {
            Answer::VISIBLE
        } else {
            Answer::OCCLUDED
        };
        self.pending.push(Pending { id, answer, ready: self.gpu + self.costs.latency });
    }

    fn count(&mut self, b: &DAabb, camera: &Camera, clip: DMat4) -> u64 {
        let mut queries = OcclusionQueries::new(0);
        queries.issue_box(&mut self.rasteriser, &self.target, clip, camera.eye(), b);
        queries.poll().expect("no latency").samples
    }

    /// Hands over what has come. At least one answer when `insist` is set.
    fn deliver(&mut self, culler: &mut Culler, insist: bool) {
        let mut ready: Vec<usize> =
            (0..self.pending.len()).filter(|&i| self.pending[i].ready <= self.cpu).collect();
        match self.arrival {
            Arrival::InOrder => {}
            Arrival::Reversed => ready.reverse(),
            Arrival::Shuffled(_) => {
                for i in (1..ready.len()).rev() {
                    ready.swap(i, self.random.below(i + 1));
                }
                if !ready.is_empty() {
                    let kept = self.random.below(ready.len() + 1).max(usize::from(insist));
                    ready.truncate(kept);
                }
            }
        }
        for &i in &ready {
            assert!(culler.resolve(self.pending[i].id, self.pending[i].answer));
        }
        let mut gone = ready;
        gone.sort_unstable();
        for i in gone.into_iter().rev() {
            self.pending.remove(i);
        }
    }

    /// Lets the processor stand still until something comes: everything, for a culler that works in waves.
    fn wait(&mut self, culler: &mut Culler) {
        let times = self.pending.iter().map(|p| p.ready);
        let until = match culler.options().schedule {
            Schedule::Waves => times.fold(0.0, f64::max),
            Schedule::Polling => times.fold(f64::INFINITY, f64::min),
        };
        assert!(until.is_finite(), "a flush with nothing in flight");
        self.cpu = self.cpu.max(until);
        self.deliver(culler, true);
    }

    /// Image of ids and depths.
    pub fn image(&self) -> Vec<(u32, u32)> {
        let depths = self.target.depth_rows().flatten().map(|d| d.to_bits());
        self.target.ids().zip(depths).collect()
    }
}

fn draw_of<'a>(id: u32, object: &'a Object, camera: &Camera, clip: DMat4) -> Draw<'a> {
    let mut state = State::default();
    state.ids = Ids::Constant(id + 1);
    let clip_from_local = clip * DMat4::from_translation(object.origin - camera.eye());
    Draw { positions: &object.positions, triangles: object.triangles, clip_from_local, state }
}

/// The image with everything drawn.
pub fn everything(world: &World, camera: &Camera) -> Vec<(u32, u32)> {
    let mut machine = Machine::new(world, Costs::with_latency(0.0), [camera.width(), camera.height()]);
    let clip = camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye());
    // Nearest first, as the culled image is drawn: of equal depths the first stays.
    for (id, object) in world.objects.iter().enumerate() {
        machine.rasteriser.draw(&mut machine.target, &draw_of(id as u32, object, camera, clip));
    }
    machine.image()
}

/// Pixels that differ in depth, or show another object at the same depth without there being two.
pub fn wrong_pixels(a: &[(u32, u32)], b: &[(u32, u32)]) -> usize {
    a.iter().zip(b).filter(|(p, q)| p.1 != q.1 || (p.0 == 0) != (q.0 == 0)).count()
}
