//! What each frame needs: numbers of the scene and the view, a plan, and costs learned from frames.

use crate::forms::Forms;
use farsight_geometry::glam::{DAffine3, DMat3};
use farsight_geometry::scene::{AlphaMode, Instance};
use farsight_geometry::{Camera, DAabb, Frustum, Scene};
use farsight_plan::{
    Budget, CellView, CostModel, Detail, LightSummary, LightView, ObjectSummary, ObjectView, Outputs, Plan,
    PlanError, Planner, SceneSummary, ViewSummary, Work,
};
use farsight_timing::{Features, Heuristic, Millis, Model, Refit, RefitOptions, TimingError};
use std::borrow::Cow;

/// Costs learned from frames: of the image term by term, of shadow maps what a texel takes beyond their triangles.
struct Learned {
    image: Refit,
    texel: Millis,
}

/// What a texel is taken to cost until a map was drawn, and the weight of a new measurement after that.
const TEXEL: Millis = Millis(5e-6);
const WEIGHT: f64 = 0.3;
/// What a sample of a map takes: its part of the difference between soft and hard shadows. As many are taken for every pixel, so that no frame tells.
pub const TAP: Millis = Millis(3e-6);

impl CostModel for Learned {
    fn time(&self, work: &Work) -> Millis {
        let drawn = Work { texels: 0.0, taps: 0.0, ..*work };
        self.image.time(&drawn) + TAP * work.taps + self.texel * work.texels
    }
}

impl Learned {
    fn learn_map(&mut self, work: &Work, took: Millis) {
        let drawn = Work { texels: 0.0, taps: 0.0, ..*work };
        let each = ((took - self.image.time(&drawn)) * (1.0 / work.texels.max(1.0))).max(Millis::ZERO);
        self.texel = self.texel * (1.0 - WEIGHT) + each * WEIGHT;
    }
}

/// By how much a placement stretches a length at most; never below that, and exact but for rounding where it stretches all alike.
fn largest_stretch(placement: &DAffine3) -> f64 {
    let m = placement.matrix3;
    let norm_sq =
        |m: DMat3| m.x_axis.length_squared() + m.y_axis.length_squared() + m.z_axis.length_squared();
    let scale = m.x_axis.length();
    let from_rotation = m.transpose() * m * (1.0 / (scale * scale)) - DMat3::IDENTITY;
    // Within 1e-9 of a scaled rotation the scale is as near; otherwise the Frobenius norm bounds every stretch.
    if norm_sq(from_rotation) < 1e-18 { scale * (1.0 + 1e-9) } else { norm_sq(m).sqrt() }
}

/// Plans frames of a scene and learns what they take.
pub struct Planning<'a> {
    objects: Vec<ObjectSummary<'a>>,
    /// By how much each object's placement stretches its mesh at most.
    stretch: Vec<f64>,
    seen: Vec<ObjectView>,
    lights: Vec<LightSummary>,
    planner: Planner,
    budget: Budget,
    costs: Learned,
}

impl<'a> Planning<'a> {
    /// For a scene with a sun or without, in images of so many samples.
    pub fn new(
        scene: &Scene,
        forms: &'a Forms,
        light: Option<LightSummary>,
        samples: u32,
        budget: Budget,
    ) -> Result<Self, TimingError> {
        let object = |instance: &Instance| {
            let mesh = scene.mesh_of(instance);
            let material = instance.material.map(|id| &scene.materials()[id.0 as usize]);
            let details = forms.details(instance.mesh.0);
            ObjectSummary {
                draws: 1.0,
                vertices: mesh.positions().len() as f64,
                triangles: mesh.triangles().len() as f64,
                details,
                // Small meshes are no dearer than their pictures, and glass would need what is behind it.
                impostor: !details.is_empty() && material.is_none_or(|m| m.alpha == AlphaMode::Opaque),
            }
        };
        // Rough costs of software rendering; frames put them right. Nearly every sample is shaded once, whatever is in view.
        let model = Model { heuristic: Heuristic::Extended, costs: [2e-5, 4e-6, 2e-3, 3e-5] };
        let constant = Millis(1.1e-4 * f64::from(samples));
        let mut refit = RefitOptions::default();
        // Along a walk all frames are alike; what they do not tell stays as it was.
        refit.trust = 30.0;
        Ok(Self {
            objects: scene.instances().iter().map(object).collect(),
            stretch: scene.instances().iter().map(|i| largest_stretch(&i.world_from_mesh)).collect(),
            seen: Vec::new(),
            lights: light.into_iter().collect(),
            planner: Planner::new(),
            budget,
            costs: Learned { image: Refit::new(model, constant, refit)?, texel: TEXEL },
        })
    }

    /// Sees what `camera` has in view of objects within `bounds`. Every pixel has `samples` samples.
    pub fn look(&mut self, camera: &Camera, bounds: &[DAabb], samples: f64) -> &mut [ObjectView] {
        let frustum = Frustum::from_camera(camera);
        self.seen.clear();
        self.seen.extend(bounds.iter().zip(&self.stretch).map(|(b, stretch)| {
            let mut seen = ObjectView::of_box(camera, &frustum, b);
            seen.px_per_unit *= stretch;
            seen.pixels *= samples;
            seen
        }));
        &mut self.seen
    }

    /// Plans for what was seen, in an image of so many samples. `light` is what is known of the sun, `cell` of what can be seen from around the eye;
    /// `offers` are forms of some objects that take the place of their own; `jumped` tells whether the eye is somewhere that its way from the last frame did not lead to.
    pub fn plan<'o>(
        &mut self,
        samples: f64,
        light: Option<LightView>,
        cell: Option<CellView>,
        jumped: bool,
        offers: impl Iterator<Item = (u32, &'o [Detail])>,
    ) -> Result<&Plan, PlanError> {
        let mut objects: Cow<[ObjectSummary]> = Cow::Borrowed(&self.objects);
        offers.for_each(|(object, details)| objects.to_mut()[object as usize].details = details);
        let scene = SceneSummary { objects: &objects, lights: &self.lights, clouds: &[] };
        let lights: &[LightView] = if let Some(light) = &light { std::slice::from_ref(light) } else { &[] };
        let view = ViewSummary {
            pixels: samples,
            outputs: Outputs { colour: true, depth: true },
            objects: &self.seen,
            lights,
            clouds: &[],
            cell,
            jumped,
        };
        // What a frame takes whatever is in it cannot be planned away.
        let constant = self.costs.image.constant();
        let mut budget = self.budget;
        budget.limit = budget.limit.map(|l| (l - constant).max(Millis::ZERO));
        self.planner.plan(&scene, &view, &budget, &self.costs)
    }

    /// By how much an object's placement stretches its mesh at most.
    pub fn stretch(&self, object: u32) -> f64 {
        self.stretch[object as usize]
    }

    /// The objects as the last view had them.
    pub fn seen(&self) -> &[ObjectView] {
        &self.seen
    }

    /// What a frame takes besides what its plan says.
    pub fn constant(&self) -> Millis {
        self.costs.image.constant()
    }

    /// Learns what the last frame took: the image, of which `share` was drawn as planned and the rest hidden, and its shadow map.
    pub fn learn(&mut self, share: f64, image: Millis, map: Option<Millis>) -> Result<(), TimingError> {
        let plan = self.planner.last();
        let drawn = (image - TAP * plan.shadow_work.taps).max(Millis::ZERO);
        self.costs.image.observe(&Features::from(&(plan.work * share)), drawn)?;
        if let Some(took) = map {
            self.costs.learn_map(&plan.shadow_work, took);
        }
        Ok(())
    }

    /// Tells what looking for hidden objects saved and took.
    pub fn learn_culling(&mut self, saved: Millis, spent: Millis) {
        self.planner.state_mut().observe_culling(saved, spent);
    }
}
