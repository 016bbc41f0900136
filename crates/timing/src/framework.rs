//! Where a frame's time goes: the tasks of Wimmer 2007, chapter 2.
//!
//! RT = system + max(CPU, GPU). The CPU does non-rendering work, submits rendering, manages memory and idles; the GPU sets the frame up and renders,
//! and moves memory. Each task may be measured, modelled or given.

use crate::Millis;
use crate::quantiles::Residuals;

/// Times of one processor's tasks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tasks {
    /// Clearing, swapping, whatever a frame takes without objects.
    pub frame_setup: Millis,
    /// Work that does not draw: simulation, input, culling.
    pub non_rendering: Millis,
    /// Submitting (CPU) or executing (GPU) what is drawn.
    pub rendering: Millis,
    /// Uploads and evictions.
    pub memory: Millis,
    /// Waiting that cannot be avoided.
    pub idle: Millis,
}

impl Tasks {
    /// All of it, one after the other.
    pub fn total(&self) -> Millis {
        self.frame_setup + self.non_rendering + self.rendering + self.memory + self.idle
    }
}

/// A frame of both processors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameTime {
    /// What the operating system takes.
    pub system: Millis,
    /// The central processor's tasks.
    pub cpu: Tasks,
    /// The graphics processor's tasks.
    pub gpu: Tasks,
}

impl FrameTime {
    /// The frame: system + max(CPU, GPU), since both work at the same time.
    pub fn total(&self) -> Millis {
        self.system + self.cpu.total().max(self.gpu.total())
    }

    /// How much the processor that finishes first has to spare.
    pub fn slack(&self) -> Millis {
        let (cpu, gpu) = (self.cpu.total(), self.gpu.total());
        cpu.max(gpu) - cpu.min(gpu)
    }
}

/// What the operating system takes, from an empty loop's times: the quantile at the wanted confidence.
///
/// `None` when there are too few times for it (see [`Residuals::quantile`]).
pub fn system_constant(empty_frames: &[Millis], confidence: f64) -> Option<Millis> {
    let mut times = Residuals::new(empty_frames.len());
    empty_frames.iter().for_each(|&t| times.record(Millis(1.0), t));
    times.quantile(Millis(1.0), confidence)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn processors_work_side_by_side() {
        let gpu = Tasks { rendering: Millis(9.0), frame_setup: Millis(1.0), ..Tasks::default() };
        let cpu = Tasks { non_rendering: Millis(4.0), rendering: Millis(2.0), ..Tasks::default() };
        let frame = FrameTime { system: Millis(1.5), cpu, gpu };
        assert_eq!((frame.total(), frame.slack()), (Millis(11.5), Millis(4.0)));
    }

    #[test]
    fn the_system_s_share_is_a_quantile() {
        let times: Vec<Millis> = (0..1000).map(|i| Millis(f64::from(i % 100) * 0.01)).collect();
        assert_eq!(system_constant(&times, 0.99), Some(Millis(0.99)));
        assert_eq!(system_constant(&times[..50], 0.99), None);
    }
}
