//! The whole loop for one object and frame: what is cached, what must be made, and as what.

use crate::angle::{corner_angle, growth};
use crate::approximation::{Approximation, ApproximationOptions, ParallaxTest};
use crate::cache::{Cache, CacheStats, Inserted, Key, LightKey};
use crate::decide::{Choice, Costs, Decision, Forecast, Kind, Reason, decide, frames_until};
use crate::placement::SAME_STRETCH;
use crate::track::{Serving, Track};
use crate::{Cut, ImpostorRenderer, ImpostorView, LodError, Placement, Tolerance, VertexHierarchy};
use farsight_geometry::accuracy::{ErrorBound, Unit};
use farsight_geometry::{Camera, DAabb, Frustum, TriangleMesh, rounding};
use glam::DVec3;
use std::collections::HashMap;

/// One object in one frame.
#[derive(Debug)]
pub struct Subject<'a> {
    /// The object.
    pub object: u32,
    /// Version of its geometry.
    pub version: u32,
    /// What it is seen by.
    pub view: u32,
    /// Light that a picture would have baked in.
    pub light: LightKey,
    /// Its mesh.
    pub mesh: &'a TriangleMesh,
    /// The mesh's hierarchy.
    pub hierarchy: &'a VertexHierarchy,
    /// The object's cut for this view.
    pub cut: &'a mut Cut,
    /// Where it is.
    pub placement: &'a Placement,
}

/// What would have to be drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Work {
    /// Triangles of the current approximation.
    pub triangles: usize,
    /// Texels of a picture of it, gutter included.
    pub texels: u64,
}

/// What the engine is asked for: pictures, what things cost, and what is in the way.
pub trait Engine: ImpostorRenderer {
    /// What drawing and making approximations of an object takes, measured or predicted.
    fn costs(&mut self, object: u32, work: &Work) -> Costs;

    /// Whether only the object itself reaches into the slab: [`is_separable`](crate::is_separable) over the scene's hierarchy. `true` for all where
    /// pictures have depth.
    fn is_separable(&mut self, object: u32, slab: &Frustum) -> bool;
}

/// What to draw, and why.
#[derive(Debug)]
pub struct Shown<'a, I> {
    /// What to draw.
    pub approximation: &'a Approximation<I>,
    /// How wrong it is for this eye, texels aside.
    pub error: ErrorBound,
    /// Whether it was made in this frame.
    pub fresh: bool,
    /// Whether the cache has it; without room it is made anew in every frame.
    pub cached: bool,
    /// The decision that this frame made; `None` where what serves was taken as it is.
    pub decision: Option<Decision>,
    /// Frames for which it was predicted to serve when it was made, itself included.
    pub predicted_frames: f64,
}

/// Why there is nothing to draw.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ApproximationError<E> {
    /// Placement, camera or options are not usable.
    #[error(transparent)]
    Lod(#[from] LodError),
    /// The engine could not make a picture.
    #[error("no picture of object {object}")]
    Renderer {
        /// The object.
        object: u32,
        /// What the engine said.
        error: E,
    },
}

/// Approximations of many objects: looks for one that serves, makes one where none does, and decides which.
///
/// ```
/// use farsight_geometry::{Camera, Frustum, TriangleMesh};
/// use farsight_lod::*;
/// use farsight_lod::glam::{DAffine3, DVec3, Vec3};
/// use std::time::Duration;
///
/// struct Game; // the engine
/// impl ImpostorRenderer for Game {
///     type Image = u32; // a texture's handle
///     type Error = std::convert::Infallible;
///     fn render(&mut self, _: u32, _: &ImpostorView, _: &Placement, _: &[[u32; 3]]) -> Result<u32, Self::Error> {
///         Ok(7) // drawn with `view.clip_from_mesh(..)`
///     }
/// }
/// impl Engine for Game {
///     fn costs(&mut self, _: u32, work: &Work) -> Costs { // as measured
///         let draw = Duration::from_nanos(20) * work.triangles as u32;
///         let texels = Duration::from_nanos(2) * work.texels as u32;
///         Costs { extract: draw, draw_geometry: draw, create_impostor: draw + texels, draw_impostor: texels }
///     }
///     fn is_separable(&mut self, _: u32, _: &Frustum) -> bool { true } // `is_separable` over the scene
/// }
///
/// // A wavy sheet of 32 x 32 squares.
/// let at = |i: u32| { let (x, y) = ((i % 33) as f32, (i / 33) as f32); Vec3::new(x, y, x.sin() * y.cos()) };
/// let square = |i: u32| { let a = i / 32 * 33 + i % 32; [[a, a + 1, a + 34], [a, a + 34, a + 33]] };
/// let mesh = TriangleMesh::new((0..33 * 33).map(at).collect(), (0..32 * 32).flat_map(square).collect())?;
/// let hierarchy = VertexHierarchy::build(&mesh)?;
/// let mut cut = Cut::new(&hierarchy);
/// let placement = Placement::new(&DAffine3::IDENTITY, mesh.origin())?;
///
/// let mut approximations = Approximations::new(64 << 20, ApproximationOptions::default())?;
/// for frame in 0..3 {
///     let eye = DVec3::new(16.0 + 0.1 * frame as f64, -200.0, 150.0);
///     let camera = Camera::look_at(eye, DVec3::ZERO, DVec3::Z)?;
///     approximations.next_frame();
///     let mut subject = Subject {
///         object: 0, version: 0, view: 0, light: LightKey::custom(0),
///         mesh: &mesh, hierarchy: &hierarchy, cut: &mut cut, placement: &placement,
///     };
///     let shown = approximations.approximate(&mut subject, &camera, &mut Game)?;
///     match shown.approximation {
///         Approximation::Geometry { triangles, .. } => assert!(frame == 0 && !triangles.is_empty()),
///         Approximation::Impostor { view, image, .. } => assert!(*image == 7 && view.bytes() < 100_000),
///     }
///     assert!(shown.error.value <= 1.0 + 1.25); // pixels of parallax and of displacement, proven
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # References
/// [Hilbert & Brunnett 2004, sections 1.3, 3 and 4].
#[derive(Clone, Debug)]
pub struct Approximations<I> {
    options: ApproximationOptions,
    cache: Cache<Approximation<I>>,
    tracks: HashMap<(u32, u32), Track>,
    /// The eye of each view in the world: in the last frame that had it, and in the one before.
    eyes: HashMap<u32, [Option<(u64, DVec3)>; 2]>,
    frame: u64,
    /// What found no room, until the next is made.
    uncached: Option<Approximation<I>>,
}

impl<I> Approximations<I> {
    /// None yet; the cache may take so many bytes.
    ///
    /// # Errors
    /// [`LodError::Option`] for options out of range.
    pub fn new(budget: u64, options: ApproximationOptions) -> Result<Self, LodError> {
        options.check()?;
        Ok(Self {
            options,
            cache: Cache::new(budget),
            tracks: HashMap::new(),
            eyes: HashMap::new(),
            frame: 0,
            uncached: None,
        })
    }

    /// A new frame begins. Objects not asked for in a frame are taken to stand still.
    pub fn next_frame(&mut self) {
        self.frame += 1;
        self.cache.next_frame();
    }

    /// What the cache did.
    pub fn cache_stats(&self) -> &CacheStats {
        self.cache.stats()
    }

    /// How predicted numbers of frames have been corrected for an object in a view: triangles, pictures.
    pub fn forecasts(&self, object: u32, view: u32) -> [Forecast; 2] {
        self.tracks.get(&(object, view)).map_or([Forecast::default(); 2], |t| t.forecasts)
    }

    /// Drops everything of an object: it has left, or its geometry is no longer what it was.
    pub fn remove_object(&mut self, object: u32) -> usize {
        self.tracks.retain(|(o, _), _| *o != object);
        self.cache.remove_object(object)
    }

    /// Drops the approximations of all versions of an object's geometry but one.
    pub fn keep_version(&mut self, object: u32, version: u32) -> usize {
        self.cache.remove_where(|key| key.object == object && key.version != version)
    }

    /// What to draw for an object in this frame: the cached approximation with the smallest error if one serves, else a new one.
    ///
    /// An object seen for the first time is taken to stand still in the world; in the first frame of a view, when nothing is known of the eye's motion either, it gets
    /// triangles.
    ///
    /// # Cost
    /// About 3 µs where something serves; else that of the cut's update, plus the engine's.
    ///
    /// # Errors
    /// [`ApproximationError::Lod`] for a parallel camera or a placement that is not finite, [`ApproximationError::Renderer`] when the engine fails.
    ///
    /// # Panics
    /// When cut or mesh are not of the hierarchy.
    pub fn approximate<E: Engine<Image = I>>(
        &mut self,
        subject: &mut Subject,
        camera: &Camera,
        engine: &mut E,
    ) -> Result<Shown<'_, I>, ApproximationError<E::Error>> {
        let placement = *subject.placement;
        let eye = placement.to_rigid(camera.eye());
        let bounds = placement.bounds(subject.hierarchy.bounds());
        let now = Now { options: &self.options, bounds, placement, camera, eye };
        let key = |light| Key { object: subject.object, version: subject.version, view: subject.view, light };
        let keys = [key(LightKey::NONE), key(subject.light)];
        // Without a baked light both keys are one.
        let keys = &keys[..1 + usize::from(keys[0] != keys[1])];
        let track = self.tracks.entry((subject.object, subject.view)).or_default();
        let eyes = self.eyes.entry(subject.view).or_default();
        if eyes[0].is_none_or(|(frame, _)| frame != self.frame) {
            *eyes = [Some((self.frame, camera.eye())), eyes[0]];
        }
        let step = track.advance(self.frame, eye, &placement).or_else(|| {
            // An object seen for the first time is taken to stand still in the world.
            let [Some((now, to)), Some((then, from))] = *eyes else { return None };
            Some(placement.direction_to_rigid(to - from) / (now - then) as f64)
        });

        // What was decided for stays; of its kind that with the smallest error.
        let preferred = track.kind;
        let found = find(&mut self.cache, keys, &now, preferred, subject.object, engine);
        self.cache.count(found.is_some());
        let serving = found.and_then(|(id, _)| self.cache.value(id));
        track.note(serving, subject, self.frame);
        let reconsidered = match serving {
            Some(Approximation::Geometry { triangles, .. })
                if track.is_due(self.frame, self.options.reconsider) =>
            {
                Some(triangles.len())
            }
            _ => None,
        };
        if let (Some(found), None) = (found, reconsidered) {
            return Ok(shown(&self.cache, found, track, None));
        }

        let tolerance = Tolerance::pixels(self.options.tolerance_px, camera)?;
        let observer = placement.observer(camera.eye())?;
        if reconsidered.is_none() {
            subject.cut.update_kinetic(subject.hierarchy, &observer, &tolerance)?;
        }
        let triangles = reconsidered.unwrap_or(subject.cut.triangles().len());
        track.measure(subject);
        let (decision, raw) = now.decision(subject.object, triangles, track, step, engine)?;
        track.forecasts[usize::from(decision.kind == Kind::Geometry)].fade();
        if let (Some(found), Kind::Geometry) = (found, decision.kind) {
            return Ok(shown(&self.cache, found, track, Some(decision)));
        }
        if reconsidered.is_some() {
            // A picture from before may serve again.
            track.kind = Some(Kind::Impostor);
            let found = find(&mut self.cache, keys, &now, track.kind, subject.object, engine);
            let picture =
                |&(id, _): &(u32, f64)| self.cache.value(id).is_some_and(|a| a.kind() == Kind::Impostor);
            if let Some(found) = found.filter(picture) {
                track.serving = None;
                return Ok(shown(&self.cache, found, track, Some(decision)));
            }
            subject.cut.update_kinetic(subject.hierarchy, &observer, &tolerance)?;
        }
        let made = now.make(subject, decision.kind, tolerance.tau, engine)?;
        let kind = made.kind();
        let index = usize::from(kind == Kind::Impostor);
        track.kind = Some(kind);
        track.serving = Some(Serving {
            kind,
            version: subject.version,
            light: subject.light,
            eye,
            since: self.frame,
            raw: raw[index],
            corrected: track.forecasts[index].corrected(raw[index]),
        });
        let predicted_frames = track.predicted();
        let (light, bytes) = match &made {
            Approximation::Geometry { triangles, .. } => {
                (LightKey::NONE, (triangles.len() * size_of::<[u32; 3]>()) as u64)
            }
            Approximation::Impostor { view, .. } => (subject.light, view.bytes()),
        };
        let bytes = bytes + size_of::<Approximation<I>>() as u64;
        let cached = match self.cache.insert(key(light), made, bytes) {
            Inserted::Cached => {
                self.uncached = None;
                true
            }
            Inserted::Uncached(made) => {
                self.uncached = Some(made);
                false
            }
        };
        let approximation =
            self.uncached.as_ref().or(self.cache.newest()).expect("one of them has just got it");
        let error = approximation.error_px(&bounds, &placement, camera);
        Ok(Shown { approximation, error, fresh: true, cached, decision: Some(decision), predicted_frames })
    }
}

/// The cached approximation that serves, is of the preferred kind if possible, and has the smallest error; and that error.
fn find<E: Engine>(
    cache: &mut Cache<Approximation<E::Image>>,
    keys: &[Key],
    now: &Now,
    preferred: Option<Kind>,
    object: u32,
    engine: &mut E,
) -> Option<(u32, f64)> {
    let (id, (.., error)) = cache.find(keys, |_, a| {
        let (error, rank) = now.judge(a)?;
        // Something may have come between since the picture was made.
        let separable = match a {
            Approximation::Impostor { view, .. } => engine.is_separable(object, &view.slab(&now.placement)),
            Approximation::Geometry { .. } => true,
        };
        let other = preferred.is_some_and(|kind| kind != a.kind());
        separable.then_some((other, rank, error))
    })?;
    Some((id, error))
}

fn shown<'a, I>(
    cache: &'a Cache<Approximation<I>>,
    (id, error): (u32, f64),
    track: &Track,
    decision: Option<Decision>,
) -> Shown<'a, I> {
    Shown {
        approximation: cache.value(id).expect("it has just been found"),
        error: ErrorBound::proven(error, Unit::Pixels),
        fresh: false,
        cached: true,
        decision,
        predicted_frames: track.predicted(),
    }
}

/// An object and a camera in one frame.
struct Now<'a> {
    options: &'a ApproximationOptions,
    bounds: DAabb,
    placement: Placement,
    camera: &'a Camera,
    eye: DVec3,
}

impl Now<'_> {
    /// For what serves: its error in pixels, and what it is compared by, which for a picture counts half a texel more.
    fn judge<I>(&self, approximation: &Approximation<I>) -> Option<(f64, f64)> {
        if !approximation.is_of(&self.placement) {
            return None;
        }
        let (made_for, share, parallax, texel) = match approximation {
            Approximation::Geometry { eye, share, .. } => (*eye, *share, 0.0, 0.0),
            Approximation::Impostor { view, share, .. } => {
                let parallax = self.parallax_if_serving(view, self.eye)?;
                (view.eye(), *share, parallax, 0.5 * view.texel_px(self.eye, self.camera))
            }
        };
        let grown = growth(&self.bounds, made_for, self.eye);
        if approximation.kind() == Kind::Geometry && !self.is_tolerable(grown) {
            return None;
        }
        let error =
            rounding::add_up(Tolerance::displacement_px(share * grown * SAME_STRETCH, self.camera), parallax);
        Some((error, error + texel))
    }

    /// Whether triangles serve whose displacement has grown by a factor.
    fn is_tolerable(&self, grown: f64) -> bool {
        grown <= self.options.growth && grown * self.options.excess >= 1.0
    }

    fn geometry_serves(&self, made_for: DVec3, eye: DVec3) -> bool {
        self.is_tolerable(growth(&self.bounds, made_for, eye))
    }

    /// Parallax in pixels of a picture for an eye, if it serves that one.
    fn parallax_if_serving(&self, view: &ImpostorView, eye: DVec3) -> Option<f64> {
        let o = self.options;
        let texel = view.texel_px(eye, self.camera) * o.impostor.texels_per_px;
        if texel.is_nan() || texel > o.magnification || texel * o.minification < 1.0 {
            return None;
        }
        let rounding = self.placement.rounding(self.camera.eye(), view.bounds());
        let px = view.turned_px(view.parallax_sine(eye, rounding), &self.placement, self.camera);
        let serves = match o.parallax {
            ParallaxTest::Corners(limit) => corner_angle(view.bounds(), view.eye(), eye) <= limit,
            ParallaxTest::Pixels(limit) => px <= limit,
        };
        serves.then_some(px)
    }

    /// Triangles or a picture, and for how many frames each would serve (without correction).
    fn decision<E: Engine>(
        &self,
        object: u32,
        triangles: usize,
        track: &Track,
        step: Option<DVec3>,
        engine: &mut E,
    ) -> Result<(Decision, [f64; 2]), LodError> {
        let horizon = self.options.decision.horizon.max(1);
        let moved = step.unwrap_or(DVec3::ZERO);
        let geometry = frames_until(|eye| self.geometry_serves(self.eye, eye), self.eye, moved, horizon);
        // The picture of what sticks out, which is at hand; that of what is drawn differs little.
        let outermost = track.outermost.iter().flat_map(|(_, points)| points);
        let points: Vec<DVec3> = outermost.map(|p| *self.placement.stretch() * *p).collect();
        let view = self.view(&points);
        let mut frames = [f64::from(geometry.max(1)), 0.0];
        let (mut texels, mut ratio, mut separable) = (0, f64::INFINITY, true);
        if let (Ok(view), true) = (&view, triangles > 0) {
            let serves = |eye| self.parallax_if_serving(view, eye).is_some();
            frames[1] = f64::from(frames_until(serves, self.eye, moved, horizon));
            let [width, height] = view.size();
            (texels, ratio) = (u64::from(width) * u64::from(height), view.resolution_ratio(self.camera));
            separable = frames[1] >= 1.0
                && ratio <= self.options.decision.max_ratio
                && engine.is_separable(object, &view.slab(&self.placement));
            // What is too large is refused as such.
            separable |= ratio > self.options.decision.max_ratio;
        } else if let Err(LodError::Parallel | LodError::Placement | LodError::Option { .. }) = view {
            return view.map(|_| unreachable!("the view is an error"));
        }
        let corrected = |i: usize| track.forecasts[i].corrected(frames[i]);
        let choice = Choice {
            costs: engine.costs(object, &Work { triangles, texels }),
            separable,
            ratio,
            geometry_frames: corrected(0).max(1.0),
            impostor_frames: if frames[1] >= 1.0 { corrected(1).max(1.0) } else { 0.0 },
            current: track.kind,
        };
        let mut decision = decide(&choice, &self.options.decision);
        if step.is_none() && decision.kind == Kind::Impostor {
            (decision.kind, decision.reason) = (Kind::Geometry, Reason::FirstSeen);
        }
        Ok((decision, frames))
    }

    fn view(&self, points: &[DVec3]) -> Result<ImpostorView, LodError> {
        ImpostorView::new(&self.placement, &self.bounds, points, self.camera, &self.options.impostor)
    }

    fn make<E: Engine>(
        &self,
        subject: &Subject,
        kind: Kind,
        share: f64,
        engine: &mut E,
    ) -> Result<Approximation<E::Image>, ApproximationError<E::Error>> {
        let triangles = subject.cut.triangles();
        if kind == Kind::Geometry {
            let stretch = *self.placement.stretch();
            return Ok(Approximation::Geometry {
                triangles: triangles.to_vec(),
                eye: self.eye,
                stretch,
                share,
            });
        }
        let stretch = self.placement.stretch();
        let place = |v: &u32| subject.hierarchy.place_of(*v) as usize;
        let position = |v: &u32| *stretch * subject.mesh.positions()[place(v)].as_dvec3();
        let points: Vec<DVec3> = triangles.as_flattened().iter().map(position).collect();
        let view = self.view(&points)?;
        let object = subject.object;
        let image = engine
            .render(object, &view, &self.placement, triangles)
            .map_err(|error| ApproximationError::Renderer { object, error })?;
        Ok(Approximation::Impostor { view, image, share, triangles: triangles.len() })
    }
}

#[cfg(test)]
mod tests;
