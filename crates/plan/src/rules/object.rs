//! The form of an object: all of it, a coarser form, an impostor, or nothing.

use crate::candidate::{BAND, Candidate, admits, strain};
use crate::choice::{Choice, Class, Reason, Rejected, Rule};
use crate::summary::{Detail, Form, ObjectSummary, ObjectView, Tolerances};
use crate::work::{CostModel, Work};
use farsight_geometry::Millis;
use farsight_geometry::accuracy::{ErrorBound, Unit};

/// Frames over which an impostor is written off at most, even where nothing moves.
const HORIZON: f64 = 600.0;
/// An impostor that lasts no longer is not worth drawing.
const LEAST_FRAMES: f64 = 2.0;
/// By how much an impostor must be cheaper than a mesh to take its place. More than other bands: its cost goes with the square of a size.
const GAIN: f64 = 0.2;

/// The form that an object had, in two bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Had(u16);

impl Had {
    /// Not known.
    pub const UNKNOWN: Self = Self(u16::MAX);
    const IMPOSTOR: Self = Self(u16::MAX - 1);
    const NOTHING: Self = Self(u16::MAX - 2);
    const FULL: Self = Self(0);

    /// What a choice will have been.
    #[inline]
    pub fn of(choice: &Choice) -> Self {
        match choice {
            Choice::Nothing => Self::NOTHING,
            Choice::Impostor { .. } => Self::IMPOSTOR,
            // Details so far down share a place: they do not differ by anything that could be seen.
            Choice::Detail { detail, .. } => Self((detail + 1).min(u32::from(Self::NOTHING.0) - 1) as u16),
            _ => Self::FULL,
        }
    }

    /// The detail, counting the object itself as zero; `None` for what is no mesh.
    #[inline]
    fn detail(self) -> Option<u16> {
        (self.0 < Self::NOTHING.0).then_some(self.0)
    }
}

/// What to draw: nothing, an impostor of a detail, or a detail (the object itself being zero).
enum Choose {
    Nothing,
    Impostor(usize),
    Mesh(usize),
}

/// An object in a view.
#[derive(Clone, Copy)]
pub struct Seen<'a> {
    pub object: &'a ObjectSummary<'a>,
    pub view: &'a ObjectView,
    pub tolerances: &'a Tolerances,
    pub had: Had,
}

impl Seen<'_> {
    /// The cheapest form within `allowed` tolerances.
    #[inline]
    pub fn pick(&self, allowed: f64, costs: &(impl CostModel + ?Sized)) -> Candidate {
        match self.choose(allowed, costs) {
            (Choose::Nothing, _) => self.nothing(),
            (Choose::Impostor(mesh), cost) => self.impostor(allowed, mesh, cost),
            (Choose::Mesh(skipped), cost) => self.mesh(skipped, cost),
        }
    }

    /// What the cheapest form within `allowed` tolerances takes.
    #[inline]
    pub fn cost(&self, allowed: f64, costs: &(impl CostModel + ?Sized)) -> Millis {
        self.choose(allowed, costs).1
    }

    #[inline]
    fn choose(&self, allowed: f64, costs: &(impl CostModel + ?Sized)) -> (Choose, Millis) {
        let fresh = self.had == Had::UNKNOWN;
        if admits(allowed, self.vanishing(), self.had == Had::NOTHING, fresh) {
            return (Choose::Nothing, Millis::ZERO);
        }
        let (mesh, cost) = self.cheapest(allowed, costs);
        // The error of an impostor is what it is allowed to be; its mesh has its own.
        let least = if self.had == Had::IMPOSTOR || fresh { 1.0 } else { 1.0 - GAIN };
        let impostor = self.impostor_frames(allowed).map(|f| costs.time(&self.impostor_work(f, mesh)));
        match impostor {
            Some(impostor) if impostor.0 < cost.0 * least => (Choose::Impostor(mesh), impostor),
            _ => (Choose::Mesh(mesh), cost),
        }
    }

    /// Why `chosen` was chosen; with time enough it would have taken `unhurried`.
    #[inline]
    pub fn reason(&self, chosen: &Candidate, unhurried: Millis, allowed: f64) -> Reason {
        let class = if chosen.cost < unhurried { Class::Budgeted } else { Class::Dominated };
        match chosen.choice {
            Choice::Full => match self.object.details.first() {
                Some(next) => Reason::new(Class::Kept, Rule::Tolerance, self.strain(next), allowed),
                None => Reason::new(Class::Kept, Rule::OnlyOne, 0.0, 0.0),
            },
            Choice::Nothing => Reason::new(class, Rule::TooSmall, chosen.strain, allowed),
            _ => Reason::new(class, Rule::Tolerance, chosen.strain, allowed),
        }
    }

    /// What was not chosen: the whole, and what is next after the chosen form.
    #[inline]
    pub fn rejected(
        &self,
        chosen: &Candidate,
        allowed: f64,
        costs: &(impl CostModel + ?Sized),
        out: &mut Vec<Rejected>,
    ) {
        let next = match chosen.choice {
            Choice::Full => 0,
            Choice::Detail { detail, .. } => detail as usize + 1,
            _ => self.object.details.len(),
        };
        if chosen.choice != Choice::Full {
            let full = costs.time(&self.mesh_work(0));
            let because = Reason::new(Class::Dominated, Rule::Dearer, full.0, chosen.cost.0);
            out.push(Rejected { choice: Choice::Full, because });
        }
        if let Some(detail) = self.object.details.get(next) {
            let because = Reason::new(Class::Kept, Rule::Tolerance, self.strain(detail), allowed);
            out.push(Rejected { choice: Choice::Detail { detail: next as u32, form: detail.form }, because });
        } else if chosen.choice != Choice::Nothing {
            let because = Reason::new(Class::Kept, Rule::TooSmall, self.vanishing(), allowed);
            out.push(Rejected { choice: Choice::Nothing, because });
        }
    }

    /// The cheapest of the object and its details: the coarsest of those made of triangles, or of points.
    #[inline]
    fn cheapest(&self, allowed: f64, costs: &(impl CostModel + ?Sized)) -> (usize, Millis) {
        let coarsest = self.coarsest(allowed);
        let within = &self.object.details[..coarsest];
        let last = |points: bool| {
            let place = within.iter().rposition(|d| (d.form == Form::Points) == points);
            place.map_or(0, |i| i + 1)
        };
        let priced = |skipped| (skipped, costs.time(&self.mesh_work(skipped)));
        let (mesh, points) = (priced(last(false)), last(true));
        if points == 0 {
            return mesh;
        }
        // Which of the two it was stays so until the other is clearly cheaper.
        let had = self.had.detail().map(usize::from);
        let (stays, comes) = (had == Some(points), had.is_some_and(|h| h != points));
        let points = priced(points);
        let weight = if stays { 1.0 - BAND } else { 1.0 };
        let least = if comes { 1.0 - BAND } else { 1.0 };
        if points.1.0 * weight < mesh.1.0 * least { points } else { mesh }
    }

    /// How many details may be skipped, the object itself being zero. Finer than before is no new choice: only going down must clear the band.
    #[inline]
    fn coarsest(&self, allowed: f64) -> usize {
        let details = self.object.details;
        let limit = allowed * self.tolerances.position_px;
        let beyond = |d: &Detail, limit: f64| d.error * self.view.px_per_unit > limit && d.error != 0.0;
        let most = details.iter().take_while(|d| !beyond(d, limit)).count();
        if self.had == Had::UNKNOWN {
            return most;
        }
        let kept = most.min(self.had.detail().map_or(0, usize::from));
        let clear = limit * (1.0 - BAND);
        (kept..most).rev().find(|&i| !beyond(&details[i], clear)).map_or(kept, |i| i + 1)
    }

    /// Error of a detail in tolerances.
    fn strain(&self, detail: &Detail) -> f64 {
        strain(detail.error * self.view.px_per_unit, self.tolerances.position_px)
    }

    /// What drawing the object itself (zero) or a detail of it is.
    #[inline]
    fn mesh_work(&self, skipped: usize) -> Work {
        let (object, view) = (self.object, self.view);
        let mut work = Work {
            draws: object.draws,
            vertices: object.vertices,
            triangles: object.triangles,
            pixels: view.pixels,
            ..Work::default()
        };
        if let Some(detail) = skipped.checked_sub(1).map(|i| &object.details[i]) {
            if detail.form == Form::Points {
                work = Work { draws: object.draws.min(1.0), points: detail.elements, ..Work::default() };
            } else if detail.elements < object.triangles {
                work.vertices *= detail.elements / object.triangles;
                work.triangles = detail.elements;
                work.draws = work.draws.min(detail.elements);
            }
        }
        work
    }

    #[inline]
    fn mesh(&self, skipped: usize, cost: Millis) -> Candidate {
        let Some(detail) = skipped.checked_sub(1).map(|i| &self.object.details[i]) else {
            return Candidate::exact(Choice::Full, self.mesh_work(0), cost);
        };
        let error_px = detail.error * self.view.px_per_unit;
        Candidate {
            choice: Choice::Detail { detail: skipped as u32 - 1, form: detail.form },
            strain: strain(error_px, self.tolerances.position_px),
            error: ErrorBound { kind: detail.kind, ..ErrorBound::proven(error_px, Unit::Pixels) },
            work: self.mesh_work(skipped),
            cost,
        }
    }

    /// Frames until an impostor is off by what is allowed; `None` where it may not be or would not last.
    #[inline]
    fn impostor_frames(&self, allowed: f64) -> Option<f64> {
        let error_px = allowed * self.tolerances.position_px;
        let frames = (self.view.impostor_frames * error_px).min(HORIZON);
        let least = if self.had == Had::IMPOSTOR { LEAST_FRAMES } else { LEAST_FRAMES * (1.0 + GAIN) };
        (self.object.impostor && frames >= least).then_some(frames)
    }

    /// A quad every frame, and drawing the picture of a detail once in `frames` (Hilbert & Brunnett 2004, equation 1).
    #[inline]
    fn impostor_work(&self, frames: f64, skipped: usize) -> Work {
        // As many pixels as the square around it on the screen has.
        let square = (self.view.size_px * self.view.size_px).max(self.view.pixels);
        let quad = Work { draws: 1.0, vertices: 4.0, triangles: 2.0, pixels: square, ..Work::default() };
        let picture = Work { texels: square, ..Work::default() } + self.mesh_work(skipped);
        quad + picture * (1.0 / frames)
    }

    fn impostor(&self, allowed: f64, skipped: usize, cost: Millis) -> Candidate {
        let error_px = allowed * self.tolerances.position_px;
        Candidate {
            choice: Choice::Impostor { error_px },
            strain: allowed,
            error: ErrorBound::proven(error_px, Unit::Pixels),
            work: self.impostor_frames(allowed).map_or(Work::default(), |f| self.impostor_work(f, skipped)),
            cost,
        }
    }

    fn nothing(&self) -> Candidate {
        let size = self.view.size_px;
        let error = if size <= 1.0 {
            ErrorBound::proven(size * size, Unit::Fraction)
        } else {
            ErrorBound::proven(size, Unit::Pixels)
        };
        Candidate {
            choice: Choice::Nothing,
            strain: self.vanishing(),
            error,
            work: Work::default(),
            cost: Millis::ZERO,
        }
    }

    /// What is missed when the object is left out, in tolerances: of a pixel its area as a share of the range; of a larger object all of its size.
    #[inline]
    fn vanishing(&self) -> f64 {
        let size = self.view.size_px;
        let shade = strain((size * size).min(1.0), self.tolerances.edge_shade);
        if size <= 1.0 { shade } else { shade.max(strain(size, self.tolerances.position_px)) }
    }
}
