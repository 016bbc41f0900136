//! Levels and nodes against a slow construction that shares nothing with the fast one: cells in hash maps, level by level.

mod common;

use common::{Folder, Random, all_points, build_points, sorted, surface};
use farsight_points::{BuildOptions, NodeData, Point, Store};
use std::collections::{BTreeMap, HashMap};

/// A cell: its level and coordinates.
type Key = (u32, [u32; 3]);

struct Oracle {
    lo: [i32; 3],
    bits: u32,
}

struct Represented {
    index: usize,
    sums: [i128; 3],
    count: i128,
}

impl Oracle {
    fn new(points: &[Point]) -> Self {
        let lo = [0, 1, 2].map(|k| points.iter().map(|p| p.position[k]).min().unwrap());
        let extent =
            (0..3).map(|k| points.iter().map(|p| (p.position[k] - lo[k]) as u32).max().unwrap()).max();
        let mut bits = 0;
        while u64::from(extent.unwrap()) >= 1 << bits {
            bits += 1;
        }
        Self { lo, bits }
    }

    fn cell(&self, p: &Point, level: u32) -> Key {
        let size = 1u64 << self.bits.saturating_sub(level);
        (level, [0, 1, 2].map(|k| ((i64::from(p.position[k]) - i64::from(self.lo[k])) as u64 / size) as u32))
    }

    /// Octants from the top: the order of a walk through the tree.
    fn walk(&self, p: &Point) -> Vec<u32> {
        (1..=self.bits)
            .map(|level| {
                let [x, y, z] = self.cell(p, level).1;
                (z & 1) << 2 | (y & 1) << 1 | x & 1
            })
            .collect()
    }

    /// Level of each point.
    fn levels(&self, points: &[Point]) -> Vec<u32> {
        let mut levels = vec![0; points.len()];
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by_key(|&i| (self.walk(&points[i]), points[i].colour));
        let one = |i: usize| Represented {
            index: i,
            sums: points[i].colour.map(i128::from)[..3].try_into().unwrap(),
            count: 1,
        };
        let mut cells: Vec<Represented> = order.into_iter().map(one).collect();
        for level in (1..=self.bits + 1).rev() {
            let mut groups: HashMap<Key, Vec<Represented>> = HashMap::new();
            let mut seen = Vec::new();
            for cell in cells {
                let key = self.cell(&points[cell.index], level - 1);
                let group = groups.entry(key).or_default();
                if group.is_empty() {
                    seen.push(key);
                }
                group.push(cell);
            }
            cells = seen
                .into_iter()
                .map(|key| choose(groups.remove(&key).unwrap(), points, level, &mut levels))
                .collect();
        }
        assert_eq!(cells.len(), 1);
        levels
    }
}

/// The member nearest to the mean of all points below, in exact arithmetic.
fn choose(group: Vec<Represented>, points: &[Point], level: u32, levels: &mut [u32]) -> Represented {
    let count: i128 = group.iter().map(|m| m.count).sum();
    let sums = [0, 1, 2].map(|k| group.iter().map(|m| m.sums[k]).sum::<i128>());
    let distance = |m: &Represented| -> i128 {
        (0..3).map(|k| (count * i128::from(points[m.index].colour[k]) - sums[k]).pow(2)).sum()
    };
    let best = (0..group.len()).min_by_key(|&i| distance(&group[i])).unwrap();
    for (i, m) in group.iter().enumerate() {
        if i != best {
            levels[m.index] = level;
        }
    }
    Represented { index: group[best].index, sums, count }
}

/// Nodes with their points per level, in order.
type Nodes = BTreeMap<(u32, [u32; 3]), BTreeMap<u32, Vec<([i32; 3], [u8; 4])>>>;

fn nodes(points: &[Point], inner: u32, merge: usize) -> Nodes {
    let oracle = Oracle::new(points);
    let levels = oracle.levels(points);
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by_key(|&i| (oracle.walk(&points[i]), points[i].colour));
    let mut open: BTreeMap<Key, Vec<usize>> = BTreeMap::new();
    for i in order {
        open.entry(oracle.cell(&points[i], levels[i].saturating_sub(inner))).or_default().push(i);
    }
    let deepest = open.keys().map(|k| k.0).max().unwrap();
    let mut stored: BTreeMap<Key, Vec<usize>> = BTreeMap::new();
    let mut has_stored_below: BTreeMap<Key, bool> = BTreeMap::new();
    for level in (1..=deepest).rev() {
        let keys: Vec<Key> = open
            .keys()
            .chain(has_stored_below.keys())
            .filter(|k| k.0 == level)
            .copied()
            .collect::<std::collections::BTreeSet<_>>()
            .into_iter()
            .collect();
        for key in keys {
            let parent = (level - 1, key.1.map(|v| v / 2));
            let below = has_stored_below.contains_key(&key);
            let list = open.remove(&key).unwrap_or_default();
            if list.is_empty() {
                has_stored_below.insert(parent, true);
            } else if list.len() < merge && !below {
                open.entry(parent).or_default().extend(list);
            } else {
                stored.insert(key, list);
                has_stored_below.insert(parent, true);
            }
        }
    }
    stored.extend(open);
    let per_level = |list: Vec<usize>| {
        let mut map: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        list.into_iter().for_each(|i| map.entry(levels[i]).or_default().push(i));
        let in_order = |mut list: Vec<usize>| {
            list.sort_by_key(|&i| (oracle.walk(&points[i]), points[i].colour));
            list.into_iter().map(|i| (points[i].position, points[i].colour)).collect()
        };
        map.into_iter().map(|(level, list)| (level, in_order(list))).collect()
    };
    stored.into_iter().map(|(key, list)| (key, per_level(list))).collect()
}

/// The same from a file.
fn nodes_of(store: &Store, points: &[Point]) -> Nodes {
    let (octree, oracle) = (store.octree(), Oracle::new(points));
    let mut out = Nodes::new();
    let mut data = NodeData::default();
    for id in octree.ids() {
        store.read(id, &mut data).unwrap();
        let key = oracle.cell(&data.points[0], octree.level(id));
        let (first, counts) = octree.node_levels(id);
        let mut rest = &data.points[..];
        let mut map = BTreeMap::new();
        for (level, &count) in (first..).zip(counts) {
            let (now, later) = rest.split_at(count as usize);
            rest = later;
            if count > 0 {
                map.insert(level, now.iter().map(|p| (p.position, p.colour)).collect());
            }
        }
        assert!(rest.is_empty());
        for p in &data.points {
            assert!(octree.bounds(id).contains(octree.grid().world(p.position)));
        }
        assert!(out.insert(key, map).is_none());
    }
    out
}

fn check(name: &str, points: &[Point]) {
    let folder = Folder::new(name);
    for (inner, merge) in [(7, 500), (3, 40), (1, 1), (2, 10)] {
        let mut options = BuildOptions::default();
        (options.inner_depth, options.merge_below) = (inner, merge);
        let path = folder.path("out.points");
        let report = build_points(points, &path, &options).unwrap();
        assert_eq!(report.points, points.len() as u64, "{name}");
        let store = Store::open(&path).unwrap();
        assert_eq!(sorted(&all_points(&store)), sorted(points), "{name}: another set of points");
        assert!(
            nodes_of(&store, points) == nodes(points, inner, merge),
            "{name}, depth {inner}, merge {merge}"
        );
        // Points of levels 0 to L: one per occupied cell of level L.
        let oracle = Oracle::new(points);
        let mut prefix = 0;
        for (level, count) in report.levels.iter().enumerate().take(oracle.bits as usize + 1) {
            prefix += count;
            let cells: std::collections::HashSet<Key> =
                points.iter().map(|p| oracle.cell(p, level as u32)).collect();
            assert_eq!(prefix, cells.len() as u64, "{name}: cells of level {level}");
        }
    }
}

#[test]
fn a_surface_with_copies() {
    check("surface", &surface(20_000, 1));
}

#[test]
fn few_points() {
    let p = |x, y, z, c| Point::new([x, y, z], [c, c / 2, 9]);
    check("one", &[p(5, -7, 9, 1)]);
    check("two", &[p(5, -7, 9, 1), p(5, -7, 10, 1)]);
    check("equal", &[p(5, -7, 9, 1), p(5, -7, 9, 3), p(5, -7, 9, 1)]);
    check(
        "corners",
        &[p(0, 0, 0, 1), p(1023, 0, 0, 2), p(0, 1023, 0, 3), p(0, 0, 1023, 4), p(1023, 1023, 1023, 5)],
    );
}

#[test]
fn flat_line_and_volume() {
    let mut random = Random(5);
    let cloud = |f: &mut dyn FnMut() -> [i32; 3]| -> Vec<Point> {
        let mut colours = Random(9);
        (0..4000).map(|_| Point::new(f(), colours.colour())).collect()
    };
    check("flat", &cloud(&mut || [random.below(5000) as i32, random.below(3000) as i32, 7]));
    check("line", &cloud(&mut || [random.below(900) as i32, 0, 0]));
    check("volume", &cloud(&mut || [0; 3].map(|_: i32| random.below(64) as i32)));
}

#[test]
fn dense_spots_far_apart_with_empty_nodes_between() {
    let mut random = Random(6);
    let points: Vec<Point> = (0..6000)
        .map(|i| {
            let spot = [i32::from(i % 3 == 0) * 1_000_000_000, i32::from(i % 2 == 0) * 900_000, 0];
            let position = spot.map(|s| s + random.below(12) as i32);
            Point::new(position, [random.bits() as u8 & 3, 0, 0])
        })
        .collect();
    check("spots", &points);
}
