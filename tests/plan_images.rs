//! What a plan calls void changes no pixel: images with and without it are the same, on every generated scene.

use farsight_geometry::scene::Light;
use farsight_geometry::{Camera, DAabb, Frustum, Scene};
use farsight_plan::{
    Budget, Choice, Class, Costs, Effect, LightSummary, LightView, ObjectSummary, ObjectView, Outputs, Plan,
    PlanState, SceneSummary, TexelSpread, Tolerances, ViewSummary, plan,
};
use farsight_raster::scenes::{City, Cubes, Forest, Path, Rooms, StreetCanyon, Terrain};
use farsight_raster::{Rasteriser, RenderOptions, ShadowMap, ShadowOptions, Target, render_scene};
use farsight_shadow::{Focus, MapOptions, Scope, ShadowLight};

/// Side of the shadow maps.
const SIDE: u32 = 512;

/// A scene with its plan from a camera.
struct Planned<'a> {
    scene: &'a Scene,
    camera: Camera,
    bounds: Vec<DAabb>,
    focus: Focus,
    plan: Plan,
}

impl<'a> Planned<'a> {
    fn new(scene: &'a Scene, camera: Camera, tolerances: Tolerances) -> Self {
        let bounds = scene.instance_bounds();
        let frustum = Frustum::from_camera(&camera);
        let seen: Vec<_> = bounds.iter().map(|b| ObjectView::of_box(&camera, &frustum, b)).collect();
        let objects: Vec<_> = scene
            .instances()
            .iter()
            .map(|i| ObjectSummary {
                draws: 1.0,
                vertices: scene.mesh_of(i).positions().len() as f64,
                triangles: scene.mesh_of(i).triangles().len() as f64,
                ..ObjectSummary::default()
            })
            .collect();
        let mut focus = Focus::new();
        let light = sun(scene).map(|direction| {
            let in_view = bounds.iter().zip(&seen).filter(|b| b.1.in_view).map(|b| *b.0);
            let receivers: Vec<_> = in_view.collect();
            let scope = Scope::new(&camera, 3000.0, &receivers, &bounds, SIDE);
            match focus.fit(&ShadowLight::directional(direction), &scope).unwrap() {
                Some(skip) => LightView::skipped(skip),
                None => LightView {
                    receiver_pixels: f64::from(camera.width()) * f64::from(camera.height()),
                    caster_triangles: scene.placed_triangles() as f64,
                    caster_draws: bounds.len() as f64,
                    contribution: 1.0,
                    texels: TexelSpread::of_map(&focus.map(&MapOptions::new(SIDE), None)),
                    penumbra_px: 0.0,
                    unchanged: false,
                },
            }
        });
        let lights = [LightSummary { most_side: SIDE, most_cascades: 1, most_taps: 0 }];
        let summary =
            SceneSummary { objects: &objects, lights: &lights[..light.iter().count()], clouds: &[] };
        let view = ViewSummary {
            pixels: f64::from(camera.width()) * f64::from(camera.height()),
            outputs: Outputs { colour: true, depth: true },
            objects: &seen,
            lights: light.as_slice(),
            clouds: &[],
            cell: None,
            jumped: false,
        };
        let budget = Budget::unlimited(tolerances);
        let (plan, _) = plan(&summary, &view, &budget, &Costs::default(), &PlanState::new()).unwrap();
        Self { scene, camera, bounds, focus, plan }
    }

    fn shadow(&self) -> Option<(Choice, Class)> {
        self.plan.decision(Effect::Shadow { light: 0 }).map(|d| (d.choice, d.because.class))
    }

    /// Draws the objects that `wanted` says, with or without the sun's shadows.
    fn draw(&self, wanted: impl Fn(Class, Choice) -> bool, shadows: bool) -> Target {
        let objects: Vec<u32> = (0u32..)
            .zip(self.plan.objects())
            .filter(|(_, d)| wanted(d.because.class, d.choice))
            .map(|(i, _)| i)
            .collect();
        let mut rasteriser = Rasteriser::new();
        let map = sun(self.scene).filter(|_| shadows).map(|direction| {
            // Where the focus found nothing to cover, a map of the whole scene stands in.
            let (matrix, origin) = match self.shadow() {
                Some((Choice::Map { .. }, _)) => {
                    let view = self.focus.map(&MapOptions::new(SIDE), None);
                    (view.clip_from_relative, view.origin)
                }
                _ => self.whole(direction),
            };
            let mut map = ShadowMap::new(SIDE, matrix, origin, -direction, ShadowOptions::default()).unwrap();
            map.draw_scene(&mut rasteriser, self.scene);
            map
        });
        let maps: Vec<_> = map.into_iter().collect();
        let mut options = RenderOptions::default();
        options.shadows = &maps;
        options.only = Some(&objects);
        render_scene(&mut rasteriser, self.scene, &self.camera, &options).unwrap().0
    }

    /// A map of everything.
    fn whole(
        &self,
        direction: farsight_geometry::glam::DVec3,
    ) -> (farsight_geometry::glam::DMat4, farsight_geometry::glam::DVec3) {
        let all = self.bounds.iter().fold(DAabb::EMPTY, |a, b| a.union(*b));
        let side = direction.any_orthonormal_vector();
        let eye = all.center() - direction * all.diagonal();
        let away = Camera::look_at(eye, all.center(), side)
            .unwrap()
            .with_projection(farsight_geometry::Projection::Orthographic { height: all.diagonal() })
            .unwrap()
            .with_range(0.1 * all.diagonal(), 2.0 * all.diagonal())
            .unwrap()
            .with_image(SIDE, SIDE)
            .unwrap();
        (away.clip_from_relative_f64(farsight_geometry::ClipConvention::REVERSED, eye), eye)
    }
}

fn sun(scene: &Scene) -> Option<farsight_geometry::glam::DVec3> {
    match scene.lights().first() {
        Some(Light::Directional { direction, .. }) => Some(*direction),
        _ => None,
    }
}

/// Generated scenes with cameras that see much, little and nothing of them.
fn views() -> Vec<(&'static str, Scene, Vec<Camera>)> {
    let city = City::small();
    let street = Path::street_walk(&city);
    let over = |side: f64, height: f64| {
        let path = Path::flyover(side, height);
        (0..4).map(|i| path.camera(i, 4).unwrap()).collect::<Vec<_>>()
    };
    let small = |cameras: Vec<Camera>| -> Vec<Camera> {
        cameras.into_iter().map(|c| c.with_image(160, 90).unwrap()).collect()
    };
    let town = (0..6).map(|i| street.camera(i, 6).unwrap()).collect();
    let mut forest = Forest::default();
    forest.trees = 60;
    let up = |scene: &Scene| {
        let b = scene.bounds();
        let top = b.center() + farsight_geometry::glam::DVec3::Z * b.extent().z;
        let sky = Camera::look_at(
            top,
            top + farsight_geometry::glam::dvec3(0.3, 0.0, 1.0),
            farsight_geometry::glam::DVec3::Y,
        );
        let down = Camera::look_at(top, b.center(), farsight_geometry::glam::DVec3::X);
        let along = Camera::look_at(b.center(), b.max, farsight_geometry::glam::DVec3::Z);
        [sky, down, along].map(Result::unwrap).to_vec()
    };
    let mut views = vec![("town", city.build().unwrap(), small(town))];
    let forest_side = forest.side();
    views.push(("forest", forest.build().unwrap(), small(over(forest_side, 30.0))));
    for (name, scene) in [
        ("cubes", Cubes::default().build().unwrap()),
        ("canyon", StreetCanyon::default().build().unwrap()),
        ("rooms", Rooms::default().build().unwrap()),
        ("terrain", Terrain::default().build().unwrap()),
    ] {
        let cameras = small(up(&scene));
        views.push((name, scene, cameras));
    }
    let sky = small(up(&views[0].1));
    views[0].2.extend(sky);
    views
}

fn same(a: &Target, b: &Target) -> bool {
    a.depth_rows().eq(b.depth_rows()) && a.colour_rows().eq(b.colour_rows())
}

#[test]
fn what_is_void_changes_no_pixel() {
    let (mut void_objects, mut void_shadows) = (0, 0);
    for (name, scene, cameras) in views() {
        for (i, camera) in cameras.into_iter().enumerate() {
            let planned = Planned::new(&scene, camera, Tolerances::default());
            let all = planned.draw(|_, _| true, true);
            let mut count = |class: Class| void_objects += usize::from(class == Class::Void);
            planned.plan.objects().iter().for_each(|d| count(d.because.class));
            let kept = planned.draw(|class, _| class != Class::Void, true);
            assert!(same(&all, &kept), "{name}, view {i}: leaving out void objects shows");
            if let Some((Choice::Nothing, class)) = planned.shadow() {
                assert_eq!(class, Class::Void);
                void_shadows += 1;
                let without = planned.draw(|_, _| true, false);
                assert!(same(&all, &without), "{name}, view {i}: a void shadow shows");
            }
        }
    }
    println!("{void_objects} objects and {void_shadows} shadows were void");
    assert!(void_objects > 1000 && void_shadows >= 3, "{void_objects} objects, {void_shadows} shadows");
}
