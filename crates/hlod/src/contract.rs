//! Contractions that are certified one by one.
//!
//! A contraction is made only if every face that it changes gets both certificates: the flood below it, and a cover of
//! every original triangle that the old faces covered. Nothing else of the surface is looked at, since nothing else changes.

use crate::appearance::{Appearance, Field, Look};
use crate::certify::CertifiedSurface;
use crate::complex::{Complex, Marks, Surroundings, on_border};
use crate::cover::Coverer;
use crate::facet::Facet;
use crate::fast::border_quadric;
use crate::flood::{Flood, steep_reach_sq};
use crate::frame::Frame;
use crate::original::{NONE, Original};
use crate::quadric::Quadric;
use crate::roles::{Place, Roles};
use farsight_geometry::accuracy::Counters;
use glam::DVec3;

/// Passes over the candidates that failed.
const PASSES: u32 = 5;

/// Faces that a contraction may leave around its vertex; a bit mask has to hold them.
const MAX_FACES: usize = 60;

/// Pull of a new vertex towards the middle of its pair, over the trace of the quadric: keeps minima unique where the surface
/// is flat or bent in one direction only.
const PULL: f64 = 1e-2;

/// What the squared length of a pair adds to its cost, over the area around it: short pairs first where the surface is flat.
const LENGTH: f64 = 1e-3;

/// Squared height over a face, over the squared tolerance, above which an original triangle is taken to belong to another sheet.
const SAME_SHEET_SQ: f64 = 16.0;

/// Which pairs may be contracted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pairs {
    All,
    /// Those with a vertex that should go along a rim.
    Rims,
}

/// What the contractions took.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ContractCounts {
    pub attempts: u64,
    pub contractions: u64,
    pub visits: u64,
    pub pieces: u64,
}

impl ContractCounts {
    pub(crate) fn add_to(&self, counters: &mut Counters) {
        counters.add("attempts", self.attempts);
        counters.add("contractions", self.contractions);
        counters.add("visits", self.visits);
        counters.add("pieces", self.pieces);
    }
}

/// A pair that may be contracted, with the state of its ends when that was found.
#[derive(Clone, Copy, Debug)]
struct Pair {
    u: u32,
    v: u32,
    made: [u32; 2],
}

/// Where a pair may go, the best place first.
#[derive(Clone, Copy, Debug)]
struct Places {
    all: [DVec3; 3],
    len: usize,
}

/// Pairs by the size of their cost: half powers of two, first come first served within.
#[derive(Clone, Debug)]
struct Buckets {
    buckets: Vec<Vec<Pair>>,
    lowest: usize,
    /// How many of the lowest bucket are taken.
    taken: usize,
}

impl Buckets {
    /// Costs below 2⁻¹⁰⁰ are equal, as are those above 2²⁷.
    const COUNT: usize = 256;

    fn new() -> Self {
        Self { buckets: vec![Vec::new(); Self::COUNT], lowest: 0, taken: 0 }
    }

    fn key(cost: f64) -> usize {
        let half_powers = (cost.max(f64::MIN_POSITIVE).to_bits() >> 51) as usize;
        half_powers.saturating_sub((1023 - 100) << 1).min(Self::COUNT - 1)
    }

    fn push(&mut self, cost: f64, pair: Pair) {
        let key = Self::key(cost);
        if key < self.lowest {
            self.buckets[self.lowest].drain(..self.taken);
            (self.lowest, self.taken) = (key, 0);
        }
        self.buckets[key].push(pair);
    }

    fn pop(&mut self) -> Option<(usize, Pair)> {
        while self.lowest < Self::COUNT {
            let bucket = &mut self.buckets[self.lowest];
            if let Some(&pair) = bucket.get(self.taken) {
                self.taken += 1;
                return Some((self.lowest, pair));
            }
            bucket.clear();
            (self.lowest, self.taken) = (self.lowest + 1, 0);
        }
        self.lowest = 0;
        None
    }
}

/// Why an attempt failed.
enum Failure {
    /// This original triangle is too far from the new faces.
    Distance(u32),
    /// At this corner of an original triangle, a new face looks too different.
    Look((u32, usize)),
}

/// A face as a contraction would leave it.
struct NewFace {
    face: u32,
    facet: Facet,
    seed: u32,
    reach_sq: f64,
    /// Looks of the corners and the error of appearance, if asked for.
    look: Option<([Look; 3], f64)>,
}

/// An original triangle that a contraction has to cover anew.
struct Gathered {
    triangle: u32,
    /// New faces whose floods visited it.
    visitors: u64,
    /// New faces that cover it.
    by: u64,
    done: bool,
}

pub(crate) struct Contractor<'a> {
    original: &'a Original,
    frame: &'a Frame,
    state: CertifiedSurface,
    roles: &'a Roles,
    pairs: Pairs,
    appearance: Option<&'a Appearance<'a>>,
    tolerance_sq: f64,
    flood: Flood,
    coverer: Coverer,
    around: Surroundings,
    queue: Buckets,
    /// How often a vertex was moved.
    made: Vec<u32>,
    /// When a face at the vertex last changed.
    changed: Vec<u32>,
    clock: u32,
    /// Failed pairs and when they failed.
    failed: Vec<(u32, u32, u32)>,
    /// The original triangle that the last failure at a vertex was about.
    culprit: Vec<u32>,
    /// The corner of an original triangle that an attempt at a vertex last failed at for its looks; empty when nobody asked.
    look_culprit: Vec<(u32, usize)>,
    /// The face that the last failure was about.
    failed_at: u32,
    is_gathered: Marks,
    slot: Vec<u32>,
    gathered: Vec<Gathered>,
    news: Vec<NewFace>,
    nearby: Vec<u32>,
    /// Kept faces that a gathered triangle needs besides new ones: (slot, face).
    kept: Vec<(u32, u32)>,
    /// Kept faces that cover gathered triangles together with new ones.
    ring: Vec<(u32, Facet)>,
    counts: ContractCounts,
}

impl<'a> Contractor<'a> {
    pub(crate) fn new(
        original: &'a Original,
        frame: &'a Frame,
        state: CertifiedSurface,
        roles: &'a Roles,
        appearance: Option<&'a Appearance<'a>>,
        tolerance_sq: f64,
    ) -> Self {
        let (vertices, triangles) = (original.points.len(), original.triangles.len());
        Self {
            original,
            frame,
            state,
            roles,
            pairs: Pairs::All,
            appearance,
            tolerance_sq,
            flood: Flood::new(original),
            coverer: Coverer::default(),
            around: Surroundings::default(),
            queue: Buckets::new(),
            made: vec![0; vertices],
            changed: vec![1; vertices],
            clock: 1,
            failed: Vec::new(),
            culprit: vec![NONE; vertices],
            look_culprit: vec![(NONE, 0); if appearance.is_some() { vertices } else { 0 }],
            failed_at: NONE,
            is_gathered: Marks::new(triangles),
            slot: vec![0; triangles],
            gathered: Vec::new(),
            news: Vec::new(),
            nearby: Vec::new(),
            kept: Vec::new(),
            ring: Vec::new(),
            counts: ContractCounts::default(),
        }
    }

    /// Contracts until every pair has failed since its surroundings last changed.
    pub(crate) fn run(mut self, pairs: Pairs) -> (CertifiedSurface, ContractCounts, usize) {
        self.pairs = pairs;
        for u in 0..self.original.points.len() as u32 {
            self.push_pairs(u, |u, v| u < v);
        }
        for pass in 0..PASSES {
            let before = self.counts.contractions;
            while let Some((key, pair)) = self.queue.pop() {
                self.try_pair(key, pair, pass > 0);
            }
            if pass > 0 && (self.counts.contractions - before) * 50 < self.state.surface.live as u64 {
                break;
            }
            let failed = std::mem::take(&mut self.failed);
            for (u, v, when) in failed {
                let changed = self.changed[u as usize].max(self.changed[v as usize]);
                if (pass == 0 || changed > when)
                    && !self.state.surface.is_isolated(u)
                    && !self.state.surface.is_isolated(v)
                    && let Some((cost, ..)) = self.evaluate(u, v)
                {
                    let made = [self.made[u as usize], self.made[v as usize]];
                    self.queue.push(cost, Pair { u, v, made });
                }
            }
        }
        self.counts.visits = self.flood.visits;
        self.counts.pieces = self.coverer.count;
        let bytes = self.bytes();
        (self.state, self.counts, bytes)
    }

    /// Bytes of the tables, most of all buckets as they were at their fullest.
    pub(crate) fn bytes(&self) -> usize {
        let vertices = 4 * (self.made.capacity() + self.changed.capacity() + self.culprit.capacity());
        let triangles = self.is_gathered.bytes() + 4 * self.slot.capacity();
        let pairs = size_of::<Pair>() * self.queue.buckets.iter().map(Vec::capacity).sum::<usize>()
            + 12 * self.failed.capacity();
        self.state.bytes() + self.flood.bytes() + self.around.bytes() + vertices + triangles + pairs
    }

    fn may_pair(&self, u: u32, v: u32) -> bool {
        self.pairs == Pairs::All || self.roles.is_on_rim(u) || self.roles.is_on_rim(v)
    }

    /// Queues the pairs of `u` and its neighbours.
    fn push_pairs(&mut self, u: u32, wanted: impl Fn(u32, u32) -> bool) {
        let mut neighbours: Vec<u32> = Vec::with_capacity(16);
        for corner in self.state.surface.corners_at(u) {
            for v in self.state.surface.others(corner) {
                if wanted(u, v) && self.may_pair(u, v) && !neighbours.contains(&v) {
                    neighbours.push(v);
                }
            }
        }
        for v in neighbours {
            if let Some((cost, ..)) = self.evaluate(u, v) {
                let made = [self.made[u as usize], self.made[v as usize]];
                self.queue.push(cost, Pair { u, v, made });
            }
        }
    }

    /// Cost of a contraction by the quadric of the faces around it, the vertex that stays and the one that goes, and places for it, the
    /// best first; `None` when it is not allowed or cannot come out well.
    fn evaluate(&self, u: u32, v: u32) -> Option<(f64, [u32; 2], Places)> {
        let (u, v, rule) = self.roles.pair(u, v)?;
        let s = &self.state.surface;
        let (a, b) = (s.points[u as usize], s.points[v as usize]);
        let middle = (a + b) * 0.5;
        let mut q = Quadric::default();
        let mut add_face = |f: u32| {
            let c = s.corners(f).map(|p| p - middle);
            let cross = (c[1] - c[0]).cross(c[2] - c[0]);
            let double_area = cross.length();
            if double_area > 0.0 {
                q.add(&Quadric::plane(cross / double_area, c[0], 0.5 * double_area));
            }
        };
        s.faces_at(u).for_each(&mut add_face);
        s.faces_at(v).filter(|&f| !s.faces[f as usize].contains(&u)).for_each(&mut add_face);
        for (x, y) in [(u, v), (v, u)] {
            if on_border(s, x) {
                add_border(s, x, y, middle, &mut q);
            }
        }
        let length_sq = a.distance_squared(b);
        let extra = LENGTH * length_sq * q.weight;
        if rule != Place::Anywhere {
            // A rim has to become what the other side of the wall makes of it: there is no choice, and no cost is too high to try.
            let mut places = Places { all: [a; 3], len: 1 };
            if rule == Place::Either {
                let ends = if q.at(b - middle) < q.at(a - middle) { [b, a] } else { [a, b] };
                (places.all[0], places.all[1], places.len) = (ends[0], ends[1], 2);
            }
            return Some((q.at(places.all[0] - middle) + extra, [u, v], places));
        }
        let mut pulled = q;
        pulled.pull(DVec3::ZERO, PULL * q.trace());
        let at = pulled.minimum().unwrap_or(DVec3::ZERO);
        let mut places = [at, a - middle, b - middle].map(|p| (q.at(p), p));
        let limit = self.tolerance_sq * q.weight;
        if places[0].0 > limit {
            // The pull moves corners inwards: an end may be better.
            places.sort_by(|x, y| x.0.total_cmp(&y.0));
        }
        let value = places[0].0;
        if value > limit {
            return None;
        }
        let all = places.map(|(_, p)| self.frame.snap(middle + p));
        Some((value + extra, [u, v], Places { all, len: 3 }))
    }

    fn try_pair(&mut self, key: usize, pair: Pair, all_places: bool) {
        let Pair { u, v, made } = pair;
        if [self.made[u as usize], self.made[v as usize]] != made {
            return;
        }
        self.around.read(&self.state.surface, u, v);
        if !self.around.link_holds() {
            self.failed.push((u, v, self.clock));
            return;
        }
        let Some((cost, [u, v], places)) = self.evaluate(u, v) else {
            self.failed.push((u, v, self.clock));
            return;
        };
        // The surroundings have changed: it is another's turn.
        if Buckets::key(cost) > key + 1 {
            self.queue.push(cost, pair);
            return;
        }
        let count = if all_places { places.len } else { 1 };
        for &at in &places.all[..count] {
            if self.attempt(u, v, at) {
                self.push_pairs(u, |_, _| true);
                return;
            }
        }
        self.failed.push((u, v, self.clock));
    }

    /// Contracts the pair to `at` if all that it changes can be certified.
    fn attempt(&mut self, u: u32, v: u32, at: DVec3) -> bool {
        self.counts.attempts += 1;
        if !self.around.keep_orientation(&self.state.surface, at) || !self.make_faces(u, v, at) {
            return false;
        }
        if self.will_look_wrong(u, v, at) {
            return false;
        }
        let culprits = [self.culprit[u as usize], self.culprit[v as usize]];
        if culprits.iter().any(|&t| self.will_fail(u, v, t)) {
            return false;
        }
        self.gather(u, v);
        match self.certify_faces().and_then(|()| self.cover_rest(u, v)) {
            Err(Failure::Distance(t)) => {
                [u, v].iter().for_each(|&x| self.culprit[x as usize] = t);
                return false;
            }
            Err(Failure::Look(corner)) => {
                [u, v].iter().for_each(|&x| self.look_culprit[x as usize] = corner);
                return false;
            }
            Ok(()) => {}
        }
        self.commit(u, v, at);
        true
    }

    /// The faces that would be there; `false` when one is too thin or there are too many.
    fn make_faces(&mut self, u: u32, v: u32, at: DVec3) -> bool {
        self.news.clear();
        let s = &self.state.surface;
        for (x, y) in [(u, v), (v, u)] {
            for corner in s.corners_at(x) {
                let face = corner >> 2;
                if s.faces[face as usize].contains(&y) {
                    continue;
                }
                let mut corners = s.corners(face);
                corners[(corner & 3) as usize] = at;
                let Some(facet) = Facet::new(corners) else { return false };
                self.news.push(NewFace {
                    face,
                    facet,
                    seed: self.state.seeds[face as usize],
                    reach_sq: 0.0,
                    look: None,
                });
            }
        }
        // Where the last place failed, the next one may fail too.
        if let Some(i) = self.news.iter().position(|n| n.face == self.failed_at) {
            self.news.swap(0, i);
        }
        self.news.len() <= MAX_FACES
    }

    /// The original triangles that the faces around the pair cover.
    fn gather(&mut self, u: u32, v: u32) {
        self.is_gathered.clear();
        self.gathered.clear();
        self.nearby.clear();
        let CertifiedSurface { surface: s, claims, .. } = &mut self.state;
        let (gathered, nearby) = (&mut self.gathered, &mut self.nearby);
        for f in s.faces_at(u).chain(s.faces_at(v)) {
            claims.sweep(f, |t| {
                if self.is_gathered.set(t) {
                    self.slot[t as usize] = gathered.len() as u32;
                    gathered.push(Gathered { triangle: t, visitors: 0, by: 0, done: false });
                    nearby.push(t);
                }
            });
        }
    }

    fn is_touched(&self, face: u32, u: u32, v: u32) -> bool {
        let f = &self.state.surface.faces[face as usize];
        f.contains(&u) || f.contains(&v)
    }

    /// Whether the triangle, at which an earlier attempt failed, will make this one fail too: it is too high over a new face, or
    /// too far from all of them where nothing else may cover it.
    fn will_fail(&self, u: u32, v: u32, triangle: u32) -> bool {
        if triangle == NONE {
            return false;
        }
        let claims = &self.state.claims;
        if !claims.faces_of(triangle).any(|f| self.is_touched(f, u, v)) {
            return false;
        }
        // Over a new face and too high there: the flood will find it, unless it belongs to another sheet.
        let same_sheet_sq = SAME_SHEET_SQ * self.tolerance_sq;
        let too_high = self.news.iter().any(|n| {
            let shadows = self.original.corners(triangle).map(|p| n.facet.shadow(p));
            let highest = shadows.iter().map(|s| s.h * s.h).fold(0.0, f64::max);
            highest > self.tolerance_sq
                && highest < same_sheet_sq
                && steep_reach_sq(self.original, &n.facet, triangle, &shadows, self.tolerance_sq).is_none()
        });
        let far = |p: DVec3| self.news.iter().all(|n| n.facet.distance_sq_to(p) > self.tolerance_sq);
        too_high
            || self.original.corners(triangle).into_iter().any(far)
                && claims.faces_of(triangle).all(|f| self.is_touched(f, u, v))
    }

    /// Whether the new faces would look too wrong where the vertices are that go, or where they did when an attempt last failed: by a guess of what
    /// their common corner will look like.
    fn will_look_wrong(&self, u: u32, v: u32, at: DVec3) -> bool {
        let Some(appearance) = self.appearance else { return false };
        let CertifiedSurface { surface: s, looks, .. } = &self.state;
        let Some(shared) = s.faces_at(u).find(|&f| s.faces[f as usize].contains(&v)) else { return false };
        let look_of = |f: u32, x: u32| {
            let corner = s.faces[f as usize].iter().position(|&y| y == x);
            corner.map(|c| looks[f as usize][c])
        };
        let (Some(look_u), Some(look_v)) = (look_of(shared, u), look_of(shared, v)) else { return false };
        let [p, q] = [u, v].map(|x| s.points[x as usize]);
        let t = ((at - p).dot(q - p) / p.distance_squared(q)).clamp(0.0, 1.0) as f32;
        let look = look_u.blend(&look_v, t);
        let mut culprits = [u, v].map(|x| self.look_culprit[x as usize]);
        if culprits[0] == culprits[1] {
            culprits[1].0 = NONE;
        }
        self.news.iter().any(|new| {
            // A face beyond a seam looks otherwise.
            let (x, old) = if s.faces[new.face as usize].contains(&u) { (u, look_u) } else { (v, look_v) };
            let Some(c) = s.faces[new.face as usize].iter().position(|&y| y == x) else { return false };
            let mut corners = looks[new.face as usize];
            if !corners[c].is_like(&old) {
                return false;
            }
            corners[c] = look;
            let mut field = None;
            let mut is_wrong = |at: DVec3, wanted: &Look| {
                let s = new.facet.shadow(at);
                if s.l.iter().any(|&l| l < 0.0) {
                    return false;
                }
                let field = field.get_or_insert_with(|| Field::new(&new.facet, corners));
                appearance.error_sq(field, &s, wanted) > self.tolerance_sq
            };
            if is_wrong(p, &look_u) || is_wrong(q, &look_v) {
                return true;
            }
            culprits
                .iter()
                .filter(|&&(t, _)| t != NONE && self.is_below(t, &new.facet))
                .any(|&(t, k)| is_wrong(self.original.corners(t)[k], &appearance.corner(self.original, t, k)))
        })
    }

    /// Whether an original triangle lies below a face with its middle, and on the same sheet, as far as that can be told at once.
    fn is_below(&self, triangle: u32, facet: &Facet) -> bool {
        let [a, b, c] = self.original.corners(triangle);
        let normal = (b - a).cross(c - a);
        let s = facet.shadow((a + b + c) / 3.0);
        s.l.iter().all(|&l| l >= 0.0)
            && s.h * s.h < SAME_SHEET_SQ * self.tolerance_sq
            && normal.dot(facet.normal) > 0.5 * normal.length()
    }

    /// Backward certificates of the new faces, noting on the way whom they cover. Fails with what is to blame.
    fn certify_faces(&mut self) -> Result<(), Failure> {
        let original = self.original;
        let tolerance_sq = self.tolerance_sq;
        for i in 0..self.news.len() {
            let new = &mut self.news[i];
            let (gathered, slot, is_gathered) = (&mut self.gathered, &self.slot, &self.is_gathered);
            let facet = &new.facet;
            let mut reach_sq = 0.0f64;
            let mut last = NONE;
            let certified =
                self.flood.certify(original, facet, new.seed, &self.nearby, tolerance_sq, |t, shadows| {
                    last = t;
                    if !is_gathered.has(t) {
                        return;
                    }
                    let g = &mut gathered[slot[t as usize] as usize];
                    if g.done {
                        return;
                    }
                    g.visitors |= 1 << i;
                    let corners = original.corners(t);
                    let mut farthest = 0.0f64;
                    for k in 0..3 {
                        let d = facet.distance_sq(corners[k], &shadows[k]);
                        if d > tolerance_sq {
                            return;
                        }
                        farthest = farthest.max(d);
                    }
                    (g.done, g.by) = (true, 1 << i);
                    reach_sq = reach_sq.max(farthest);
                });
            let Some(certified) = certified else {
                self.failed_at = self.news[i].face;
                return Err(Failure::Distance(last));
            };
            let mut worst_at = (NONE, 0);
            new.look = self
                .appearance
                .map(|a| a.judge(original, &new.facet, self.flood.below(), tolerance_sq, &mut worst_at));
            if new.look.is_some_and(|(_, error_sq)| error_sq > tolerance_sq) {
                self.failed_at = new.face;
                return Err(Failure::Look(worst_at));
            }
            new.seed = certified.seed;
            new.reach_sq = reach_sq.max(certified.reach_sq);
        }
        Ok(())
    }

    /// Forward certificates of the triangles that no new face covers alone. Fails with what is to blame.
    fn cover_rest(&mut self, u: u32, v: u32) -> Result<(), Failure> {
        self.kept.clear();
        self.ring.clear();
        let mut kept = Vec::new();
        for i in 0..self.gathered.len() {
            if self.gathered[i].done {
                continue;
            }
            let triangle = self.gathered[i].triangle;
            kept.clear();
            for f in self.state.claims.faces_of(triangle) {
                if self.is_touched(f, u, v) {
                    continue;
                }
                let known = self.ring.iter().position(|r| r.0 == f).or_else(|| {
                    // The claim was made with this facet, so there is one.
                    self.ring.push((f, Facet::new(self.state.surface.corners(f))?));
                    Some(self.ring.len() - 1)
                });
                kept.extend(known);
            }
            let visitors = self.gathered[i].visitors;
            if !self.cover_one(i, visitors, &kept) && !self.cover_one(i, u64::MAX, &kept) {
                return Err(Failure::Distance(triangle));
            }
        }
        Ok(())
    }

    /// Covers a gathered triangle by the new faces of a bit mask and by kept ones.
    fn cover_one(&mut self, i: usize, mask: u64, kept: &[usize]) -> bool {
        let mut facets: Vec<&Facet> = Vec::with_capacity(16);
        let mut indices: Vec<usize> = Vec::with_capacity(16);
        for (k, new) in self.news.iter().enumerate() {
            if mask & 1 << k != 0 {
                facets.push(&new.facet);
                indices.push(k);
            }
        }
        let news = facets.len();
        facets.extend(kept.iter().map(|&k| &self.ring[k].1).take(64 - news));
        let total = facets.len();
        let corners = self.original.corners(self.gathered[i].triangle);
        let Some(cover) = self.coverer.cover(corners, &facets, self.tolerance_sq) else { return false };
        let mut by = 0;
        for bit in 0..total {
            if cover.facets & 1 << bit == 0 {
                continue;
            }
            if bit < news {
                by |= 1 << indices[bit];
                let reach = &mut self.news[indices[bit]].reach_sq;
                *reach = reach.max(cover.reach_sq);
            } else {
                let face = self.ring[kept[bit - news]].0;
                self.kept.push((i as u32, face));
                let reach = &mut self.state.reach_sq[face as usize];
                *reach = reach.max(cover.reach_sq);
            }
        }
        (self.gathered[i].done, self.gathered[i].by) = (true, by);
        true
    }

    fn commit(&mut self, u: u32, v: u32, at: DVec3) {
        self.counts.contractions += 1;
        self.clock += 1;
        let claims = &mut self.state.claims;
        for g in &self.gathered {
            claims.release(g.triangle);
        }
        let s = &self.state.surface;
        for f in s.faces_at(u).chain(s.faces_at(v)) {
            claims.clear_face(f);
        }
        for g in &self.gathered {
            let mut by = g.by;
            while by != 0 {
                claims.add(g.triangle, self.news[by.trailing_zeros() as usize].face);
                by &= by - 1;
            }
        }
        for &(i, face) in &self.kept {
            claims.add(self.gathered[i as usize].triangle, face);
        }
        for new in &self.news {
            self.state.seeds[new.face as usize] = new.seed;
            self.state.reach_sq[new.face as usize] = new.reach_sq;
            if let Some((looks, error_sq)) = new.look {
                self.state.looks[new.face as usize] = looks;
                self.state.look_sq[new.face as usize] = error_sq;
            }
        }
        for f in s.faces_at(u).chain(s.faces_at(v)) {
            for x in s.faces[f as usize] {
                self.changed[x as usize] = self.clock;
            }
        }
        self.state.surface.contract(u, v, at);
        self.made[u as usize] += 1;
        self.made[v as usize] += 1;
    }
}

/// Adds walls on the edges at `x` that do not have exactly two faces, but for the one to `except`, which the other end adds or not.
fn add_border(s: &Complex, x: u32, except: u32, middle: DVec3, q: &mut Quadric) {
    for corner in s.corners_at(x) {
        for y in s.others(corner) {
            let users = s.faces_at(x).filter(|&f| s.faces[f as usize].contains(&y)).count();
            if users == 2 || (y == except && x > except) {
                continue;
            }
            let c = s.corners(corner >> 2).map(|p| p - middle);
            let Some(normal) = (c[1] - c[0]).cross(c[2] - c[0]).try_normalize() else { continue };
            let (a, b) = (s.points[x as usize] - middle, s.points[y as usize] - middle);
            if let Some(wall) = border_quadric(a, b, normal) {
                q.add(&wall);
            }
        }
    }
}
