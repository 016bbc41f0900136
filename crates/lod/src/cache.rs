//! The cache of approximations: what was made for earlier frames and may serve again.

use crate::LodError;
use glam::DVec3;
use std::collections::HashMap;

/// What an approximation is of: object, version of its geometry, view class (main view, mirror, shadow map, ...), and the light that is baked into it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Key {
    /// The object.
    pub object: u32,
    /// Which version of its geometry.
    pub version: u32,
    /// What it is seen by: approximations of one view do not suit another.
    pub view: u32,
    /// Baked light; [`LightKey::NONE`] for geometry, which is lit when it is drawn.
    pub light: LightKey,
}

/// A direction of light in an object's rigid frame, up to a tolerance: equal keys mean directions that differ by no more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LightKey(u64);

impl LightKey {
    /// No light is baked.
    pub const NONE: Self = Self(0);

    /// The cell of a direction (need not be of unit length) in a grid on the sphere whose cells are at most `tolerance` radians wide.
    ///
    /// A light that turns with its object keeps its key: take the direction from [`Placement::direction_to_rigid`](crate::Placement::direction_to_rigid).
    ///
    /// ```
    /// use farsight_lod::{LightKey, glam::DVec3};
    ///
    /// let noon = LightKey::direction(DVec3::new(0.1, -1.0, 0.2), 0.05)?;
    /// assert_eq!(noon, LightKey::direction(DVec3::new(0.1001, -1.0, 0.2), 0.05)?);
    /// assert_ne!(noon, LightKey::direction(DVec3::new(0.2, -1.0, 0.2), 0.05)?);
    /// # Ok::<(), farsight_lod::LodError>(())
    /// ```
    ///
    /// # Errors
    /// [`LodError::Option`] for a direction without length or a tolerance outside [1e-6, π].
    pub fn direction(direction: DVec3, tolerance: f64) -> Result<Self, LodError> {
        if !(1e-6..=std::f64::consts::PI).contains(&tolerance) {
            return Err(LodError::Option {
                option: "light tolerance", value: tolerance, range: "1e-6 to π"
            });
        }
        let d = (direction / direction.abs().max_element()).to_array();
        if d.iter().any(|x| !x.is_finite()) {
            let value = direction.length();
            return Err(LodError::Option {
                option: "light direction",
                value,
                range: "a finite length above 0",
            });
        }
        // A cube of cells: no angle exceeds the diagonal of a cell in a plane at distance 1.
        let cells = (2.0 * std::f64::consts::SQRT_2 / tolerance).ceil();
        let axis = (0..3).max_by(|&a, &b| d[a].abs().total_cmp(&d[b].abs())).unwrap_or(0);
        let face = 2 * axis as u64 + u64::from(d[axis] < 0.0);
        let cell = |x: f64| ((0.5 * (x + 1.0) * cells) as u64).min(cells as u64 - 1);
        let [i, j] = [d[(axis + 1) % 3], d[(axis + 2) % 3]].map(cell);
        // Six faces of at most 2²² by 2²² cells; never zero.
        Ok(Self(1 + i + ((j + (face << 22)) << 22)))
    }

    /// Any other state of the light: what differs must have different numbers.
    pub fn custom(state: u32) -> Self {
        Self(1 << 63 | u64::from(state))
    }
}

/// What a cache did, since it was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct CacheStats {
    /// Questions that found a valid entry.
    pub hits: u64,
    /// Questions that found none.
    pub misses: u64,
    /// Entries taken in.
    pub inserted: u64,
    /// Entries given up for others.
    pub evicted: u64,
    /// Entries dropped because their object changed or left.
    pub dropped: u64,
    /// Entries that found no room.
    pub refused: u64,
    /// Bytes held now, and at most so far.
    pub bytes: u64,
    /// Largest `bytes` so far.
    pub most_bytes: u64,
}

/// What became of an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Inserted<V> {
    /// It is in the cache.
    Cached,
    /// There is no room that this frame does not use: here it is back, to be drawn and forgotten.
    Uncached(V),
}

#[derive(Clone, Debug)]
struct Entry<V> {
    key: Key,
    value: V,
    bytes: u64,
    /// Frame of the last use, and how many uses of any entry there were before it.
    used: u64,
    time: u64,
    /// Neighbours in the order of use; `NONE` at the ends.
    newer: u32,
    older: u32,
}

const NONE: u32 = u32::MAX;

/// Approximations by [`Key`], several to a key, in a fixed number of bytes.
///
/// When room is needed, what was *used* longest ago goes first, whosever it is; what was used in this frame stays. An entry that cannot get
/// room that way is handed back. Bytes never exceed the budget.
///
/// ```
/// use farsight_lod::{Cache, Inserted, Key, LightKey};
///
/// let key = |object| Key { object, version: 0, view: 0, light: LightKey::NONE };
/// let mut cache = Cache::new(100);
/// assert_eq!(cache.insert(key(1), "far", 60), Inserted::Cached);
/// assert_eq!(cache.insert(key(2), "near", 60), Inserted::Uncached("near")); // the first is in use
/// cache.next_frame();
/// assert_eq!(cache.insert(key(2), "near", 60), Inserted::Cached);
/// // The caller says how wrong each entry would be now, or that it does not serve.
/// assert_eq!(cache.best(&[key(2)], |_, _| Some(0.3)), Some((&"near", 0.3)));
/// assert_eq!(cache.best(&[key(1)], |_, _| Some(0.1)), None);
/// ```
///
/// # Cost
/// A question asks all entries of its keys: at most [`per_key`](Self::with_per_key) each. The rest takes constant time.
#[derive(Clone, Debug)]
pub struct Cache<V> {
    budget: u64,
    per_key: usize,
    frame: u64,
    uses: u64,
    /// Bytes of what this frame uses.
    pinned: u64,
    entries: Vec<Option<Entry<V>>>,
    free: Vec<u32>,
    by_key: HashMap<Key, Vec<u32>>,
    newest: u32,
    oldest: u32,
    stats: CacheStats,
}

impl<V> Cache<V> {
    /// An empty cache for so many bytes.
    pub fn new(budget: u64) -> Self {
        Self {
            budget,
            per_key: 16,
            frame: 0,
            uses: 0,
            pinned: 0,
            entries: Vec::new(),
            free: Vec::new(),
            by_key: HashMap::new(),
            newest: NONE,
            oldest: NONE,
            stats: CacheStats::default(),
        }
    }

    /// With at most so many entries to a key (16 unless told; at least 1): the one used longest ago makes room, if this frame does not use it.
    #[must_use]
    pub fn with_per_key(self, per_key: usize) -> Self {
        Self { per_key: per_key.max(1), ..self }
    }

    /// A new frame begins: what was used so far may go.
    pub fn next_frame(&mut self) {
        self.frame += 1;
        self.pinned = 0;
    }

    /// The budget in bytes.
    pub fn budget(&self) -> u64 {
        self.budget
    }

    /// What happened so far.
    pub fn stats(&self) -> &CacheStats {
        &self.stats
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        self.entries.len() - self.free.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The entry of one of the keys with the smallest error, and that error; of equals the one used last. `error` is `None` for an entry that does
    /// not serve. What is found counts as used.
    pub fn best(&mut self, keys: &[Key], error: impl FnMut(&Key, &V) -> Option<f64>) -> Option<(&V, f64)> {
        let found = self.find(keys, error);
        self.count(found.is_some());
        let (id, error) = found?;
        self.value(id).map(|value| (value, error))
    }

    pub(crate) fn count(&mut self, hit: bool) {
        *(if hit { &mut self.stats.hits } else { &mut self.stats.misses }) += 1;
    }

    /// As [`best`](Self::best), by place; not counted.
    pub(crate) fn find<E: PartialOrd + Copy>(
        &mut self,
        keys: &[Key],
        mut error: impl FnMut(&Key, &V) -> Option<E>,
    ) -> Option<(u32, E)> {
        let mut best: Option<(E, u64, u32)> = None;
        for &id in keys.iter().filter_map(|key| self.by_key.get(key)).flatten() {
            let Some(entry) = &self.entries[id as usize] else { continue };
            let Some(e) = error(&entry.key, &entry.value) else { continue };
            if best.is_none_or(|(least, time, _)| e < least || (e == least && entry.time > time)) {
                best = Some((e, entry.time, id));
            }
        }
        let (e, _, id) = best?;
        self.touch(id);
        Some((id, e))
    }

    pub(crate) fn value(&self, id: u32) -> Option<&V> {
        self.entries.get(id as usize)?.as_ref().map(|entry| &entry.value)
    }

    /// The entry that was used or taken in last.
    pub(crate) fn newest(&self) -> Option<&V> {
        self.value(self.newest)
    }

    /// Takes an entry in, as used in this frame; what must make room for it goes.
    pub fn insert(&mut self, key: Key, value: V, bytes: u64) -> Inserted<V> {
        let own = self.by_key.get(&key).and_then(|ids| {
            let full = ids.len() >= self.per_key;
            let first = self.entries[ids[0] as usize].as_ref().filter(|_| full)?;
            Some((ids[0], first.used == self.frame, first.bytes))
        });
        // What can go: all but the pinned ones. An own entry that must go and cannot refuses the new one.
        let blocked = own.is_some_and(|(_, pinned, _)| pinned);
        if blocked || bytes > self.budget - self.pinned {
            self.stats.refused += 1;
            return Inserted::Uncached(value);
        }
        if let Some((id, ..)) = own {
            self.remove(id);
            self.stats.evicted += 1;
        }
        while self.stats.bytes > self.budget - bytes {
            self.remove(self.oldest);
            self.stats.evicted += 1;
        }
        self.uses += 1;
        let entry = Entry { key, value, bytes, used: self.frame, time: self.uses, newer: NONE, older: NONE };
        let id = match self.free.pop() {
            Some(id) => {
                self.entries[id as usize] = Some(entry);
                id
            }
            None => {
                self.entries.push(Some(entry));
                self.entries.len() as u32 - 1
            }
        };
        self.by_key.entry(key).or_default().push(id);
        self.link(id);
        self.pinned += bytes;
        self.stats.inserted += 1;
        self.stats.bytes += bytes;
        self.stats.most_bytes = self.stats.most_bytes.max(self.stats.bytes);
        Inserted::Cached
    }

    /// Drops everything of an object: its geometry has changed, or it has left. Returns how many entries that were.
    ///
    /// # Cost
    /// Looks at all keys.
    pub fn remove_object(&mut self, object: u32) -> usize {
        self.remove_where(|key| key.object == object)
    }

    /// Drops the entries whose keys are chosen.
    pub fn remove_where(&mut self, chosen: impl Fn(&Key) -> bool) -> usize {
        let ids: Vec<u32> = self
            .by_key
            .iter()
            .filter(|(key, _)| chosen(key))
            .flat_map(|(_, ids)| ids.iter().copied())
            .collect();
        for &id in &ids {
            self.remove(id);
        }
        self.stats.dropped += ids.len() as u64;
        ids.len()
    }

    /// The entry becomes the one used last.
    fn touch(&mut self, id: u32) {
        self.unlink(id);
        self.link(id);
        self.uses += 1;
        let (frame, time) = (self.frame, self.uses);
        let Some(entry) = &mut self.entries[id as usize] else { return };
        if entry.used != frame {
            self.pinned += entry.bytes;
        }
        (entry.used, entry.time) = (frame, time);
        let key = entry.key;
        if let Some(ids) = self.by_key.get_mut(&key) {
            ids.retain(|&other| other != id);
            ids.push(id);
        }
    }

    fn remove(&mut self, id: u32) {
        self.unlink(id);
        let Some(entry) = self.entries[id as usize].take() else { return };
        self.free.push(id);
        self.stats.bytes -= entry.bytes;
        if entry.used == self.frame {
            self.pinned -= entry.bytes;
        }
        if let Some(ids) = self.by_key.get_mut(&entry.key) {
            ids.retain(|&other| other != id);
            if ids.is_empty() {
                self.by_key.remove(&entry.key);
            }
        }
    }

    fn link(&mut self, id: u32) {
        let before = std::mem::replace(&mut self.newest, id);
        if let Some(entry) = &mut self.entries[id as usize] {
            (entry.newer, entry.older) = (NONE, before);
        }
        match self.entry_mut(before) {
            Some(entry) => entry.newer = id,
            None => self.oldest = id,
        }
    }

    fn unlink(&mut self, id: u32) {
        let Some((newer, older)) = self.entry_mut(id).map(|e| (e.newer, e.older)) else { return };
        match self.entry_mut(newer) {
            Some(entry) => entry.older = older,
            None => self.newest = older,
        }
        match self.entry_mut(older) {
            Some(entry) => entry.newer = newer,
            None => self.oldest = newer,
        }
    }

    fn entry_mut(&mut self, id: u32) -> Option<&mut Entry<V>> {
        self.entries.get_mut(id as usize)?.as_mut()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::Random;

    fn key(object: u32, view: u32) -> Key {
        Key { object, version: 0, view, light: LightKey::NONE }
    }

    /// The same rules on a plain list, the entry used last at its end.
    struct Naive {
        budget: u64,
        per_key: usize,
        frame: u64,
        list: Vec<(Key, u32, u64, u64)>,
    }

    impl Naive {
        fn best(&mut self, keys: &[Key], error: impl Fn(u32) -> Option<f64>) -> Option<(u32, f64)> {
            let candidates = self.list.iter().enumerate().filter(|(_, e)| keys.contains(&e.0));
            let valid = candidates.filter_map(|(i, e)| error(e.1).map(|error| (i, error)));
            // Of equals the one used last: the list's later one.
            let (i, e) = valid.min_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))?;
            let mut entry = self.list.remove(i);
            entry.3 = self.frame;
            self.list.push(entry);
            Some((entry.1, e))
        }

        fn insert(&mut self, key: Key, value: u32, bytes: u64) -> bool {
            let pinned: u64 = self.list.iter().filter(|e| e.3 == self.frame).map(|e| e.2).sum();
            let own: Vec<usize> = (0..self.list.len()).filter(|&i| self.list[i].0 == key).collect();
            let full = own.len() >= self.per_key;
            if (full && self.list[own[0]].3 == self.frame) || pinned + bytes > self.budget {
                return false;
            }
            if full {
                self.list.remove(own[0]);
            }
            while self.bytes() + bytes > self.budget {
                self.list.remove(0);
            }
            self.list.push((key, value, bytes, self.frame));
            true
        }

        fn bytes(&self) -> u64 {
            self.list.iter().map(|e| e.2).sum()
        }
    }

    #[test]
    fn equals_a_naive_model_over_random_traces() {
        let mut random = Random::new(31);
        let (mut evicted, mut refused, mut hits) = (0, 0, 0);
        for trace in 0..300 {
            let (budget, per_key) = (random.below(2000), 1 + random.below(5) as usize);
            let mut cache = Cache::new(budget).with_per_key(per_key);
            let mut naive = Naive { budget, per_key, frame: 0, list: Vec::new() };
            for step in 0..400u32 {
                let k = key(random.below(6) as u32, random.below(2) as u32);
                match random.below(10) {
                    0 => {
                        cache.next_frame();
                        naive.frame += 1;
                    }
                    1..=4 => {
                        let bytes = random.below(if step % 50 == 0 { 3000 } else { 300 });
                        let cached = cache.insert(k, step, bytes) == Inserted::Cached;
                        assert_eq!(cached, naive.insert(k, step, bytes), "trace {trace}, step {step}");
                    }
                    5 if random.below(10) == 0 => {
                        let before = naive.list.len();
                        naive.list.retain(|e| e.0.object != k.object);
                        assert_eq!(cache.remove_object(k.object), before - naive.list.len());
                    }
                    _ => {
                        // Few different errors, so that there are ties.
                        let salt = random.below(7) as u32;
                        let error =
                            |v: u32| (!v.wrapping_mul(salt).is_multiple_of(3)).then_some(f64::from(v % 4));
                        let keys = [k, key(k.object, 1 - k.view)];
                        let found = cache.best(&keys, |_, &v| error(v)).map(|(v, e)| (*v, e));
                        assert_eq!(found, naive.best(&keys, error), "trace {trace}, step {step}");
                    }
                }
                let stats = cache.stats();
                assert!(stats.bytes <= budget && stats.bytes == naive.bytes());
                assert_eq!(cache.len(), naive.list.len());
                assert_eq!(
                    cache.pinned,
                    naive.list.iter().filter(|e| e.3 == naive.frame).map(|e| e.2).sum::<u64>()
                );
            }
            let stats = cache.stats();
            assert_eq!(stats.inserted, stats.evicted + stats.dropped + cache.len() as u64);
            (evicted, refused, hits) = (evicted + stats.evicted, refused + stats.refused, hits + stats.hits);
        }
        println!("{hits} hits, {evicted} evicted, {refused} refused");
        assert!(evicted > 1000 && refused > 1000 && hits > 1000);
    }

    #[test]
    fn directions_with_one_key_are_within_the_tolerance() {
        let mut random = Random::new(32);
        let mut seen: HashMap<(u32, LightKey), Vec<DVec3>> = HashMap::new();
        for i in 0..60_000u32 {
            let d = DVec3::from_array(random.units()) * 2.0 - 1.0;
            let level = i % 3;
            let tolerance = [1.0, 0.3, 0.1][level as usize];
            seen.entry((level, LightKey::direction(d, tolerance).unwrap())).or_default().push(d);
        }
        let mut widest = [0.0f64; 3];
        for ((level, _), list) in &seen {
            for (a, b) in list.iter().flat_map(|a| list.iter().map(move |b| (a, b))).take(2000) {
                let tolerance = [1.0, 0.3, 0.1][*level as usize];
                let angle = a.angle_between(*b);
                assert!(angle <= tolerance, "{angle}");
                widest[*level as usize] = widest[*level as usize].max(angle / tolerance);
            }
        }
        assert!(widest.iter().all(|&w| w > 0.5), "{widest:?}");
        for (d, tolerance) in [(DVec3::ZERO, 0.1), (DVec3::NAN, 0.1), (DVec3::X, 0.0), (DVec3::X, f64::NAN)] {
            assert!(LightKey::direction(d, tolerance).is_err());
        }
    }
}
