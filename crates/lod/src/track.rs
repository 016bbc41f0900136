//! What is remembered of an object from frame to frame: how it moves, what serves it since when, how well that was predicted.

use crate::approximate::Subject;
use crate::cache::LightKey;
use crate::{Approximation, Forecast, Kind, Placement};
use glam::{DVec3, Vec3};

/// Share of the latest frame in the velocity.
const SMOOTHING: f64 = 0.25;

/// What is known of an object in one view from frame to frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct Track {
    /// The last eye and placement.
    seen: Option<(DVec3, Placement)>,
    frame: u64,
    /// Movement a frame.
    step: Option<DVec3>,
    pub(crate) serving: Option<Serving>,
    /// What it was drawn as last.
    pub(crate) kind: Option<Kind>,
    pub(crate) forecasts: [Forecast; 2],
    /// Version of the geometry, and vertices that stick out of it: what a picture has to hold, nearly.
    pub(crate) outermost: Option<(u32, Vec<DVec3>)>,
}

/// What has been drawn since when.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Serving {
    pub(crate) kind: Kind,
    pub(crate) version: u32,
    pub(crate) light: LightKey,
    /// The eye it was made for, which tells it from others.
    pub(crate) eye: DVec3,
    pub(crate) since: u64,
    /// Frames that it would serve, as predicted without correction and with it.
    pub(crate) raw: f64,
    pub(crate) corrected: f64,
}

impl Track {
    /// Notes where the eye is; returns by how much it moves a frame, in the rigid frame, if that is known.
    pub(crate) fn advance(&mut self, frame: u64, eye: DVec3, placement: &Placement) -> Option<DVec3> {
        let before = self.seen.replace((eye, *placement));
        let frames = frame.wrapping_sub(std::mem::replace(&mut self.frame, frame));
        let now =
            before.filter(|b| b.1.is_stretched_like(placement)).map(|b| (eye - b.0) / frames.max(1) as f64);
        // Averaged, so that a head that trembles on its way does not seem to race back and forth.
        self.step = now.map(|now| self.step.map_or(now, |step| step.lerp(now, SMOOTHING)));
        self.step
    }

    /// Compares what serves now with what served so far, and learns from its end.
    pub(crate) fn note<I>(&mut self, found: Option<&Approximation<I>>, subject: &Subject, frame: u64) {
        if let Some(found) = found {
            self.kind = Some(found.kind());
        }
        let Some(serving) = self.serving else { return };
        let same = serving.version == subject.version && serving.light == subject.light;
        let still = found.is_some_and(|a| same && a.kind() == serving.kind && a.eye() == serving.eye);
        if !still {
            // One of its kind would have been preferred: if another serves, it was given up for a smaller error.
            let expired = same && found.is_none_or(|a| a.kind() != serving.kind);
            let achieved = frame.saturating_sub(serving.since) as f64;
            self.forecasts[usize::from(serving.kind == Kind::Impostor)].observe(
                serving.raw,
                achieved,
                expired,
            );
            self.serving = None;
        }
    }

    /// Whether a picture is to be considered in this frame though triangles serve: in the frame after they were made, then every so often.
    pub(crate) fn is_due(&self, frame: u64, every: u32) -> bool {
        let age = self.serving.map_or(1, |s| frame.saturating_sub(s.since));
        age == 1 || age.is_multiple_of(u64::from(every.max(1)))
    }

    /// Looks for the vertices farthest in 26 directions, once for each version of the geometry.
    pub(crate) fn measure(&mut self, subject: &Subject) {
        if self.outermost.as_ref().is_some_and(|(version, _)| *version == subject.version) {
            return;
        }
        let positions = subject.mesh.positions();
        let used = || subject.mesh.triangles().as_flattened().iter().map(|&v| positions[v as usize]);
        let directions = (0..27).map(|i| Vec3::new((i % 3) as f32, (i / 3 % 3) as f32, (i / 9) as f32) - 1.0);
        let farthest = |d: Vec3| used().max_by(|a, b| a.dot(d).total_cmp(&b.dot(d)));
        let outermost = directions.filter_map(farthest).map(|p| p.as_dvec3()).collect();
        self.outermost = Some((subject.version, outermost));
    }

    pub(crate) fn predicted(&self) -> f64 {
        self.serving.map_or(f64::NAN, |s| s.corrected)
    }
}
