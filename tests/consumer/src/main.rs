//! What a user of one crate writes: types of their own glam go in, a matrix comes out.

use farsight_shadow::farsight_geometry::{Camera, DAabb};
use farsight_shadow::{Focus, MapOptions, Scope, ShadowLight};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let eye = glam::DVec3::new(0.0, 2.0, 0.0);
    let camera = Camera::look_at(eye, glam::DVec3::new(30.0, 1.0, 0.0), glam::DVec3::Y)?;
    let ground = [DAabb::new(glam::DVec3::new(-500.0, -1.0, -500.0), glam::DVec3::new(500.0, 3.0, 500.0))];
    let sun = ShadowLight::directional(glam::DVec3::new(0.5, -0.7, 0.2).normalize());
    let mut focus = Focus::new();
    let skip = focus.fit(&sun, &Scope::new(&camera, 400.0, &ground, &ground, 2048))?;
    assert!(skip.is_none(), "the ground is lit");
    let view = focus.map(&MapOptions::new(2048), None);
    let matrix: glam::Mat4 = view.matrix();
    println!("worst texel {:.2} px, {:.1} times finer than without a warp", view.texel.value, view.gain());
    assert!(matrix.is_finite() && view.gain() > 10.0);
    Ok(())
}
