//! Shared geometry of the Farsight crates.
//!
//! Data enters through validated types ([`TriangleMesh`], [`scene::Scene`], [`Camera`]) and is never NaN or out of
//! range afterwards. World coordinates are `f64` origins with `f32` offsets. Questions with a yes or a no are
//! decided exactly ([`predicates`]); what is promised as a bound includes rounding ([`rounding`]); what an
//! answer promises and costs is part of the answer ([`accuracy`]).
//!
//! ```
//! use farsight_geometry::{Camera, Frustum, Containment, DAabb, glam::{DVec3, dvec3}};
//!
//! let camera = Camera::look_at(dvec3(0.0, 1.7, 5.0), DVec3::ZERO, DVec3::Y)?;
//! let house = DAabb::new(dvec3(-2.0, 0.0, -2.0), dvec3(2.0, 3.0, 2.0));
//! assert_ne!(Frustum::from_camera(&camera).classify(&house), Containment::Outside);
//! // How far may a point of the house be off before anyone sees it by more than a pixel?
//! let tolerance = camera.world_error(1.0, camera.distance_to_box(&house));
//! assert!(tolerance > 0.001 && tolerance < 0.01);
//! # Ok::<(), farsight_geometry::CameraError>(())
//! ```
//!
//! | module | answers |
//! |---|---|
//! | [`accuracy`] | what an error bound means and what it cost |
//! | [`mesh`], [`points`], [`scene`] | what is there |
//! | [`bounds`], [`frustum`] | where it is, whether it can be seen |
//! | [`camera`] | how large it appears, how much a world error shows |
//! | [`convex`] | which part of space matters |
//! | [`clip`] | which part of a triangle lies ahead of the eye |
//! | [`ray`] | what a ray meets |
//! | [`distance`] | how far surfaces are apart |
//! | [`bvh`] | which objects are where |
//! | [`sampling`] | which points and directions to try |
//! | [`io`] | what a file holds |
//! | [`streaming`] | what is in memory, and what comes next |
//! | `hard_cases` | what may go wrong (feature `hard-cases`) |

pub mod accuracy;
pub mod bounds;
pub mod bvh;
pub mod camera;
pub mod clip;
pub mod convex;
pub mod distance;
pub mod frustum;
#[cfg(any(test, feature = "hard-cases"))]
pub mod hard_cases;
pub mod io;
pub mod mesh;
mod millis;
pub mod points;
pub mod predicates;
pub mod ray;
pub mod rounding;
pub mod sampling;
pub mod scene;
pub mod streaming;

pub use accuracy::{Cost, Counters, ErrorBound};
pub use bounds::{Aabb, DAabb, Sphere};
pub use camera::{Camera, CameraError, ClipConvention, Projection};
pub use convex::ConvexBody;
pub use frustum::{Containment, Frustum, Plane};
pub use glam;
pub use mesh::{MeshError, MeshReport, TriangleMesh};
pub use millis::Millis;
pub use points::PointCloud;
pub use ray::{Hit, Ray, RayCaster};
pub use scene::Scene;

/// The README's example, so that it stays true.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
