//! Everything that can be chosen, and what is refused.

/// What must hold of the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Policy {
    /// The image is that of drawing everything, whatever the latency. Waits for answers where it must.
    #[default]
    Exact,
    /// Never waits. An object that comes into sight is missing from at most `frames` consecutive frames: nothing stays hidden
    /// unless a query of one of the last `frames` frames found it occluded. What is unknown is drawn.
    Bounded {
        /// Most frames in which a visible object may be missing: 1 to 255. Choose it larger than the latency, or everything
        /// is drawn.
        frames: u32,
    },
}

/// How the tree is walked. Sections here, figures and "the paper" below are of Wimmer 2007, chapter 4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Algorithm {
    /// View-frustum culling only: the baseline to beat where there is occlusion, and to match where there is none.
    FrustumOnly,
    /// Every leaf in the view is queried, and each answer waited for (section 4.4.1).
    Naive,
    /// Every node is queried, and each answer waited for (section 4.4.3).
    StopAndWait,
    /// Last frame's visibility is the guess, queries check it (section 4.5).
    #[default]
    Coherent,
}

/// In which order nodes come off the list of open work.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// Depth first, children front to back. Nodes found late break the order.
    Stack,
    /// Nearest first, equal distances by id.
    #[default]
    Distance,
}

/// When queries are issued and answers acted on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Schedule {
    /// Queries as nodes are visited, answers as they come: GL, D3D11. The order of answers may change what is drawn
    /// (never the image).
    #[default]
    Polling,
    /// First everything that is known to be visible is drawn, then all queries are issued against the depth so far, then
    /// their answers are acted on together: wgpu, Vulkan, D3D12. What is drawn does not depend on when or in which
    /// order answers come within the frame.
    Waves,
}

/// What is assumed of nodes without a history: the first frame, after [`reset`](crate::Culler::reset), inserted objects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Unknown {
    /// Hidden until a query says otherwise: fewest draws, most waiting.
    #[default]
    Ask,
    /// Visible: no waiting, the frame costs as much as without culling. [`Policy::Bounded`] always does this.
    Draw,
}

/// What is assumed of nodes that come back into the view volume.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reentry {
    /// Hidden, as in Wimmer 2007.
    #[default]
    Ask,
    /// What they were when last seen.
    Remember,
}

/// Gives up culling while it does not pay, and looks now and then whether it would.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Adaptive {
    /// Culling pays when at least this share of queries finds something occluded. Each such answer saves one draw or more;
    /// set it to the cost of a query divided by that of a typical draw.
    pub least_occluded: f64,
    /// Frames without queries after the first failure; doubles with each further one up to `longest_pause`.
    pub shortest_pause: u32,
    /// Longest pause in frames.
    pub longest_pause: u32,
    /// One leaf in this many is queried by the probe that ends a pause.
    pub probe_one_in: u32,
}

impl Default for Adaptive {
    /// A tenth occluded, pauses of 8 to 128 frames, probes of one leaf in 16.
    fn default() -> Self {
        Self { least_occluded: 0.1, shortest_pause: 8, longest_pause: 128, probe_one_in: 16 }
    }
}

/// What the caller's queries can tell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// Visible or not: wgpu, WebGPU, most modern interfaces.
    #[default]
    Boolean,
    /// How many samples passed.
    Counts,
}

/// How to cull.
///
/// [`Options::default`] is the algorithm of Wimmer 2007, chapter 4 ("the paper" below), with its gaps closed. [`Options::waves`] suits interfaces whose answers come
/// after a submit.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Options {
    /// How the tree is walked. Everything below is for [`Algorithm::Coherent`].
    pub algorithm: Algorithm,
    /// What must hold of the image.
    pub policy: Policy,
    /// Order of visits.
    pub order: Order,
    /// When queries are issued.
    pub schedule: Schedule,
    /// Nodes without history.
    pub unknown: Unknown,
    /// Nodes coming back into view.
    pub reentry: Reentry,
    /// For how many frames an inner node that a query found visible is descended into although nothing below it is seen;
    /// 0 as in the paper. Without it such nodes change state every frame. Doubles, up to 16 times, each time the node
    /// closes and opens again.
    pub keep_open_frames: u32,
    /// Levels to go down at once below an inner node that was found visible late, instead of asking at each: fewer waves for
    /// more queries. For [`Schedule::Waves`]; 0 as in the paper.
    pub skip_levels: u32,
    /// Whether the frame may end before the answers of queries that cannot change it (leaves that are drawn anyway). They
    /// count for the next frame if they have come by then; until then the leaf stays visible.
    pub defer: bool,
    /// A visible leaf is queried every so many frames and drawn in between; leaves take turns. 1 queries it every frame.
    pub query_leaves_every: u32,
    /// Most hidden nodes that share one query; 1 for one query each. Nodes share when all were found hidden in each of the
    /// last 4 frames; when the query sees something, each is queried again.
    pub nodes_per_query: u32,
    /// Queries of visible leaves measure the draw itself instead of a box (section 4.6.1): no proxy to draw.
    pub query_with_geometry: bool,
    /// Switches off where occlusion does not pay.
    pub adaptive: Option<Adaptive>,
    /// Most samples that an object may show and still count as hidden. **Lossy above 0**: up to this many pixels per node
    /// are wrong in a frame. Needs [`Backend::Counts`].
    pub lossy_threshold: u64,
    /// By how many pixels query boxes are grown. Vertices are snapped to a grid, of a box as of what is inside it, so a box
    /// must be a little larger to be hit wherever its contents are. 1/16 px covers grids of 1/64 px and finer.
    pub inflate_px: f64,
}

impl Default for Options {
    /// Exact, nearest first, polling, open nodes kept for 8 frames, answers deferred, one query per node and frame.
    fn default() -> Self {
        Self {
            algorithm: Algorithm::Coherent,
            policy: Policy::Exact,
            order: Order::Distance,
            schedule: Schedule::Polling,
            unknown: Unknown::Ask,
            reentry: Reentry::Ask,
            keep_open_frames: 8,
            skip_levels: 0,
            defer: true,
            query_leaves_every: 1,
            nodes_per_query: 1,
            query_with_geometry: false,
            adaptive: None,
            lossy_threshold: 0,
            inflate_px: 1.0 / 16.0,
        }
    }
}

impl Options {
    /// For interfaces whose answers come after a submit: few submits, unknown nodes drawn.
    pub fn waves() -> Self {
        Self {
            schedule: Schedule::Waves,
            unknown: Unknown::Draw,
            reentry: Reentry::Remember,
            skip_levels: 1,
            adaptive: Some(Adaptive::default()),
            ..Self::default()
        }
    }

    /// Never waits; objects may appear up to `frames` frames late.
    pub fn bounded(frames: u32) -> Self {
        Self { policy: Policy::Bounded { frames }, ..Self::waves() }
    }

    /// The pseudocode of figures 4.5 and 4.6 of Wimmer 2007, mended where it would walk up beyond the root.
    pub fn pseudocode() -> Self {
        Self { order: Order::Stack, keep_open_frames: 0, defer: false, ..Self::default() }
    }

    /// One of the baselines.
    pub fn baseline(algorithm: Algorithm) -> Self {
        Self { algorithm, ..Self::default() }
    }

    pub(crate) fn check(&self, backend: Backend) -> Result<(), OptionsError> {
        let number = |option, value: f64, least: f64, most: f64| {
            let fits = value >= least && value <= most;
            if fits { Ok(()) } else { Err(OptionsError::Range { option, value, least, most }) }
        };
        if let Policy::Bounded { frames } = self.policy {
            number("frames", frames.into(), 1.0, 255.0)?;
        }
        number("keep_open_frames", self.keep_open_frames.into(), 0.0, 1024.0)?;
        number("skip_levels", self.skip_levels.into(), 0.0, 16.0)?;
        number("query_leaves_every", self.query_leaves_every.into(), 1.0, 1024.0)?;
        number("nodes_per_query", self.nodes_per_query.into(), 1.0, 256.0)?;
        number("inflate_px", self.inflate_px, 0.0, 1024.0)?;
        if let Some(a) = self.adaptive {
            number("least_occluded", a.least_occluded, 0.0, 1.0)?;
            number("shortest_pause", a.shortest_pause.into(), 1.0, 65_536.0)?;
            number("longest_pause", a.longest_pause.into(), a.shortest_pause.into(), 65_536.0)?;
            number("probe_one_in", a.probe_one_in.into(), 1.0, 65_536.0)?;
        }
        match self.lossy_threshold {
            0 => Ok(()),
            threshold if backend == Backend::Boolean => Err(OptionsError::NeedsCounts { threshold }),
            threshold if self.query_with_geometry => Err(OptionsError::TwoMeasures { threshold }),
            _ => Ok(()),
        }
    }
}

/// Why options were refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OptionsError {
    /// A number is out of its range, or NaN.
    #[error("{option} is {value}; it must lie between {least} and {most}")]
    Range {
        /// Which option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// Smallest allowed.
        least: f64,
        /// Largest allowed.
        most: f64,
    },
    /// A threshold above zero compares with counts that the backend does not have.
    #[error("a threshold of {threshold} samples needs queries that count samples")]
    NeedsCounts {
        /// The threshold.
        threshold: u64,
    },
    /// A threshold above zero would be compared with pixels of a box in one frame and of the object in the next.
    #[error("a threshold of {threshold} samples cannot go with queries of both boxes and geometry")]
    TwoMeasures {
        /// The threshold.
        threshold: u64,
    },
}
