//! Plans: tolerance and time limit against how far drawn surfaces are off on the image, and what drawing takes.

#[path = "../../examples/tour/forms.rs"]
#[allow(dead_code)]
mod forms;

use super::row::{Row, timed};
use farsight_geometry::accuracy::{Counters, ErrorBound, Unit};
use farsight_geometry::distance::{HausdorffOptions, Surface, one_sided};
use farsight_geometry::{Camera, DAabb, Frustum, Scene, TriangleMesh};
use farsight_plan::{
    Budget, Choice, Costs, Effect, Millis, ObjectSummary, ObjectView, Outputs, Plan, PlanState, SceneSummary,
    Tolerances, ViewSummary, plan,
};
use farsight_raster::scenes::{City, Path};
use farsight_raster::{Rasteriser, RenderOptions, render_scene};
use forms::Forms;
use std::collections::HashMap;

pub fn rows(quick: bool) -> Vec<Row> {
    let city = if quick { City::small() } else { City::default() };
    let scene = city.build().expect("the options are usual ones");
    let forms = Forms::build(&scene, forms::LEAST_TRIANGLES).expect("the meshes are valid");
    let (_, triangles) = forms.count();
    let path = Path::rise(&city);
    let size = if quick { [320, 180] } else { [1280, 720] };
    let camera =
        path.camera(4, 5).and_then(|c| Ok(c.with_image(size[0], size[1])?)).expect("a stop of the path");
    let town = Town { scene: &scene, forms: &forms, bounds: scene.instance_bounds(), camera };
    let mut measure = Measure::default();
    let mut row = |knob: &str, value: f64, budget: Budget| {
        let (plan, _) = timed(1, || town.plan(&budget));
        let (counters, times) = timed(3, || town.draw(&plan));
        let claimed = plan.objects().iter().filter(|d| matches!(d.choice, Choice::Detail { .. }));
        let claimed = claimed.map(|d| d.error.value).fold(0.0, f64::max);
        Row {
            krate: "plan",
            scene: "town".into(),
            knob: knob.into(),
            value,
            claimed: ErrorBound::proven(claimed, Unit::Pixels),
            measured: measure.largest(&town, &plan),
            times,
            bytes: (triangles * 12) as u64,
            counters,
        }
    };
    let tolerances = |px: f64| Tolerances::default().with_position_px(px);
    let mut rows: Vec<Row> =
        [8.0, 4.0, 2.0, 1.0, 0.5].map(|px| row("tolerance px", px, Budget::unlimited(tolerances(px)))).into();
    let whole = town.plan(&Budget::unlimited(tolerances(0.5))).cost;
    for share in [0.3, 0.5, 0.7, 0.9] {
        let limit = Millis(whole.0 * share);
        rows.push(row("limit, share of the time at 0.5 px", share, Budget::within(limit, tolerances(0.5))));
    }
    rows
}

struct Town<'a> {
    scene: &'a Scene,
    forms: &'a Forms,
    bounds: Vec<DAabb>,
    camera: Camera,
}

impl Town<'_> {
    fn plan(&self, budget: &Budget) -> Plan {
        let frustum = Frustum::from_camera(&self.camera);
        let seen: Vec<_> =
            self.bounds.iter().map(|b| ObjectView::of_box(&self.camera, &frustum, b)).collect();
        // Instances are only moved and turned here: mesh units are world units.
        let objects: Vec<_> = self
            .scene
            .instances()
            .iter()
            .map(|i| ObjectSummary {
                draws: 1.0,
                vertices: self.scene.mesh_of(i).positions().len() as f64,
                triangles: self.scene.mesh_of(i).triangles().len() as f64,
                details: self.forms.details(i.mesh.0),
                impostor: false,
            })
            .collect();
        let scene = SceneSummary { objects: &objects, ..SceneSummary::default() };
        let view = ViewSummary {
            pixels: f64::from(self.camera.width()) * f64::from(self.camera.height()),
            outputs: Outputs::DEPTH,
            objects: &seen,
            lights: &[],
            clouds: &[],
            cell: None,
            jumped: false,
        };
        // Triangles are what counts where nothing is shaded.
        let costs = Costs { draw: 2000.0, vertex: 20.0, triangle: 60.0, pixel: 0.0, ..Costs::default() };
        let (plan, _) = plan(&scene, &view, budget, &costs, &PlanState::new()).expect("valid numbers");
        assert!(plan.decision(Effect::Occlusion).is_some());
        plan
    }

    fn draw(&self, plan: &Plan) -> Counters {
        let form = |(d, i): (&farsight_plan::Decision, &farsight_geometry::scene::Instance)| match d.choice {
            Choice::Detail { detail, .. } => Some(self.forms.triangles(i.mesh.0, detail)),
            _ => None,
        };
        let forms: Vec<_> = plan.objects().iter().zip(self.scene.instances()).map(form).collect();
        let drawn = (0u32..).zip(plan.objects()).filter(|(_, d)| d.choice != Choice::Nothing);
        let drawn: Vec<u32> = drawn.map(|(i, _)| i).collect();
        let mut options = RenderOptions::default();
        options.outputs.colour = false;
        options.only = Some(&drawn);
        options.forms = &forms;
        let (_, work) = render_scene(&mut Rasteriser::new(), self.scene, &self.camera, &options)
            .expect("the image is small");
        let mut counters = Counters::new();
        counters.add("objects", drawn.len() as u64);
        counters.add("triangles", work.triangles);
        counters
    }
}

/// Distances of forms from their meshes, by branch and bound; each is measured once.
#[derive(Default)]
struct Measure {
    known: HashMap<(u32, u32), f64>,
}

impl Measure {
    /// The largest error on the image of what a plan draws: certain lower bounds of the distances, as the nearest point of each box shows them.
    fn largest(&mut self, town: &Town, plan: &Plan) -> f64 {
        let mut largest = 0.0f64;
        for ((d, instance), bounds) in plan.objects().iter().zip(town.scene.instances()).zip(&town.bounds) {
            if let Choice::Detail { detail, .. } = d.choice {
                let distance = *self.known.entry((instance.mesh.0, detail)).or_insert_with(|| {
                    let mesh = town.scene.mesh_of(instance);
                    distance(mesh, town.forms.triangles(instance.mesh.0, detail))
                });
                let nearest = town.camera.distance_to_box(bounds).max(town.camera.near());
                largest = largest.max(distance * town.camera.pixels_per_unit() / nearest);
            }
        }
        largest
    }
}

/// How far a point of the form is from the mesh at most, from below.
fn distance(mesh: &TriangleMesh, triangles: &[[u32; 3]]) -> f64 {
    let form = TriangleMesh::new(mesh.positions().to_vec(), triangles.to_vec()).expect("indices of the mesh");
    let original =
        TriangleMesh::new(mesh.positions().to_vec(), mesh.triangles().to_vec()).expect("a valid mesh");
    let tolerance = 1e-4 * mesh.bounds().extent().length() as f64;
    let options = HausdorffOptions::new(tolerance).with_max_splits(20_000);
    one_sided(&form, &Surface::new(&original), &options).lower
}
