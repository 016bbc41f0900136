//! Shared geometry of the Farsight crates.
//!
//! Data enters through validated types ([`TriangleMesh`], [`scene::Scene`], [`Camera`]) and is never NaN or out of
//! range afterwards. World coordinates are `f64` origins with `f32` offsets. Questions with a yes or a no are
//! decided exactly ([`predicates`]); what is promised as a bound includes rounding ([`rounding`]); what an
//! answer promises and costs is part of the answer ([`accuracy`]).
//!
//! | module | answers |
//! |---|---|
//! | [`accuracy`] | what an error bound means and what it cost |
//! | [`mesh`], [`scene`] | what is there |
//! | [`bounds`], [`frustum`] | where it is, whether it can be seen |
//! | [`camera`] | how large it appears, how much a world error shows |
//! | [`convex`] | which part of space matters |
//! | [`ray`] | what a ray meets |
//! | [`distance`] | how far surfaces are apart |

pub mod accuracy;
pub mod bounds;
pub mod bvh;
pub mod camera;
pub mod convex;
pub mod distance;
pub mod frustum;
#[cfg(any(test, feature = "hard-cases"))]
pub mod hard_cases;
pub mod io;
pub mod mesh;
pub mod points;
pub mod predicates;
pub mod ray;
pub mod rounding;
pub mod sampling;
pub mod scene;

pub use accuracy::{Cost, Counters, ErrorBound};
pub use bounds::{Aabb, DAabb, Sphere};
pub use camera::{Camera, CameraError, ClipConvention, Projection};
pub use convex::ConvexBody;
pub use frustum::{Containment, Frustum, Plane};
pub use glam;
pub use mesh::{MeshError, MeshReport, TriangleMesh};
pub use points::PointCloud;
pub use ray::{Hit, Ray, RayCaster};
pub use scene::Scene;
