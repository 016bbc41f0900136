//! What a frame will take, told before it is drawn, and corrected by what frames took.

use farsight_geometry::{Camera, Scene, Sphere};
use farsight_timing::{Features, Heuristic, Millis, Model, Refit, RefitOptions, TimingError};

/// Predicts the time of drawing a frame.
pub struct Prediction {
    refit: Refit,
    predicted: Millis,
    features: Features,
}

impl Prediction {
    /// Starts from rough costs of software rendering; frames put them right.
    pub fn new() -> Result<Self, TimingError> {
        let costs = [2e-5, 4e-5, 2e-3, 2e-5];
        let model = Model { heuristic: Heuristic::Extended, costs };
        let refit = Refit::new(model, Millis(20.0), RefitOptions::default())?;
        Ok(Self { refit, predicted: Millis::ZERO, features: Features::default() })
    }

    /// Predicts the drawing of some objects.
    pub fn predict(
        &mut self,
        scene: &Scene,
        objects: &[u32],
        bounds: &[farsight_geometry::DAabb],
        camera: &Camera,
    ) -> Millis {
        let screen = f64::from(camera.width()) * f64::from(camera.height());
        self.features = Features::default();
        for &object in objects {
            let mesh = scene.mesh_of(&scene.instances()[object as usize]);
            // A disk as wide as the object's ball, at most the screen: cheap, and put right by the refit.
            let px = camera.sphere_px(&Sphere::around_box(&bounds[object as usize]));
            self.features += Features {
                triangles: mesh.triangles().len() as f64,
                vertices: mesh.positions().len() as f64,
                pixels: (std::f64::consts::FRAC_PI_4 * px * px).min(screen),
                draws: 1.0,
                ..Features::default()
            };
        }
        self.predicted = self.refit.predict(&self.features);
        self.predicted
    }

    /// Learns what the predicted frame took.
    pub fn learn(&mut self, measured: Millis) -> Result<(), TimingError> {
        self.refit.observe(&self.features, measured)?;
        Ok(())
    }
}
