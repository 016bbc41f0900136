//! The object hierarchy against a plain list of boxes.

use farsight_geometry::bvh::{Bvh, BvhError, MAX_DEPTH, NodeId, Walk};
use farsight_geometry::glam::{DVec3, dvec3};
use farsight_geometry::{Camera, Containment, DAabb, Frustum};

/// A small generator of its own, so that the tests do not lean on the crate's.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn below(&mut self, n: usize) -> usize {
        (self.unit() * n as f64) as usize
    }

    fn a_box(&mut self) -> DAabb {
        let min = dvec3(self.unit(), self.unit(), self.unit()) * 100.0;
        let size = dvec3(self.unit(), self.unit(), self.unit()) * 10.0 * self.unit();
        match self.below(12) {
            0 => DAabb::EMPTY,
            1 => DAabb::new(min, min),
            // Coincident boxes.
            2 => DAabb::new(DVec3::splat(50.0), DVec3::splat(51.0)),
            _ => DAabb::new(min, min + size),
        }
    }
}

/// Every link, box, height and leaf, from the root down.
fn check(bvh: &Bvh, boxes: &[Option<DAabb>]) {
    let mut seen = vec![0; boxes.len()];
    let mut nodes = 0;
    bvh.walk(|node, bounds| {
        nodes += 1;
        match bvh.children(node) {
            Some(children) => {
                let union = children.iter().fold(DAabb::EMPTY, |sum, c| sum.union(*bvh.bounds(*c)));
                assert_eq!(union, *bounds);
                assert!(children.iter().all(|c| bvh.parent(*c) == Some(node)));
            }
            None => {
                let object = bvh.object(node).unwrap();
                assert_eq!(bvh.leaf_of(object), Some(node));
                assert_eq!(boxes[object as usize], Some(*bounds));
                seen[object as usize] += 1;
            }
        }
        Walk::Descend
    });
    let solid = |b: &Option<DAabb>| b.is_some_and(|b| !b.is_empty());
    for (object, bounds) in boxes.iter().enumerate() {
        assert_eq!(seen[object], usize::from(solid(bounds)), "object {object}");
    }
    let leaves = boxes.iter().filter(|b| solid(b)).count();
    assert_eq!(nodes, (2 * leaves).saturating_sub(1));
    assert_eq!(bvh.root().is_none(), leaves == 0);
    assert!(bvh.depth() <= MAX_DEPTH && depth(bvh, bvh.root()) == bvh.depth());
}

fn depth(bvh: &Bvh, node: Option<NodeId>) -> usize {
    node.map_or(0, |n| {
        1 + bvh.children(n).map_or(0, |c| c.map(|c| depth(bvh, Some(c))).into_iter().max().unwrap())
    })
}

fn check_queries(bvh: &Bvh, boxes: &[Option<DAabb>], random: &mut Random) {
    let query = random.a_box();
    let mut found = vec![];
    bvh.overlaps(&query, |object| found.push(object));
    found.sort_unstable();
    let hits = |b: &DAabb| !b.is_empty() && b.overlaps(&query);
    let expected: Vec<u32> =
        (0..boxes.len()).filter(|&i| boxes[i].as_ref().is_some_and(hits)).map(|i| i as u32).collect();
    assert_eq!(found, expected);

    let eye = dvec3(random.unit(), random.unit(), random.unit()) * 100.0;
    let camera = Camera::look_at(eye, DVec3::splat(50.0), DVec3::Y).unwrap().with_range(0.1, 60.0).unwrap();
    let frustum = Frustum::from_camera(&camera);
    let mut found = vec![];
    bvh.frustum(&frustum, |object, containment| found.push((object, containment)));
    found.sort_unstable_by_key(|f| f.0);
    assert!(found.windows(2).all(|w| w[0].0 != w[1].0));
    // What the list finds the tree must find; inside must be inside, and nothing outside may be called visible unless
    // only rounding tells the difference.
    for (object, bounds) in boxes.iter().enumerate() {
        let Some(bounds) = bounds else { continue };
        let of_tree = found.binary_search_by_key(&(object as u32), |f| f.0).ok().map(|i| found[i].1);
        match frustum.classify(bounds) {
            Containment::Outside => assert_ne!(of_tree, Some(Containment::Inside)),
            containment => assert_eq!(of_tree, Some(containment), "object {object}"),
        }
        if of_tree.is_some() {
            assert_ne!(frustum.classify(bounds), Containment::Outside);
        }
    }
}

#[test]
fn random_histories_agree_with_a_list() {
    for seed in 0..20 {
        let mut random = Random(seed);
        let start = random.below(200);
        let mut boxes: Vec<Option<DAabb>> = (0..start).map(|_| Some(random.a_box())).collect();
        let all: Vec<DAabb> = boxes.iter().flatten().copied().collect();
        let mut bvh = Bvh::build(&all).unwrap();
        check(&bvh, &boxes);
        for step in 0..600 {
            let object = random.below(boxes.len().max(1));
            match random.below(10) {
                0..4 => {
                    let bounds = random.a_box();
                    let id = bvh.insert(bounds).unwrap() as usize;
                    if id == boxes.len() {
                        boxes.push(None);
                    }
                    assert_eq!(boxes[id].replace(bounds), None);
                }
                4..7 if object < boxes.len() => {
                    assert_eq!(bvh.remove(object as u32).is_ok(), boxes[object].take().is_some());
                }
                7..9 if object < boxes.len() => {
                    let bounds = random.a_box();
                    let known = boxes[object].is_some();
                    assert_eq!(bvh.set_bounds(object as u32, bounds).is_ok(), known);
                    if known {
                        boxes[object] = Some(bounds);
                    }
                }
                _ if step % 10 == 0 => {
                    let new: Vec<DAabb> = boxes.iter().map(|_| random.a_box()).collect();
                    bvh.refit(&new).unwrap();
                    boxes.iter_mut().zip(new).for_each(|(b, n)| *b = b.map(|_| n));
                }
                _ => {}
            }
            check(&bvh, &boxes);
            check_queries(&bvh, &boxes, &mut random);
        }
        bvh.rebuild();
        check(&bvh, &boxes);
    }
}

#[test]
fn same_calls_same_tree() {
    let make = || {
        let mut random = Random(9);
        let boxes: Vec<DAabb> = (0..500).map(|_| random.a_box()).collect();
        let mut bvh = Bvh::build(&boxes).unwrap();
        for i in 0..100 {
            bvh.remove(i * 3).unwrap();
            bvh.insert(random.a_box()).unwrap();
        }
        format!("{bvh:?}")
    };
    assert_eq!(make(), make());
}

#[test]
fn ids_are_dense_after_a_build() {
    let mut random = Random(3);
    let boxes: Vec<DAabb> = (0..100).map(|_| random.a_box()).filter(|b| !b.is_empty()).collect();
    let bvh = Bvh::build(&boxes).unwrap();
    let mut seen = vec![false; bvh.node_capacity()];
    bvh.walk(|node, _| {
        seen[node.0 as usize] = true;
        Walk::Descend
    });
    assert!(seen.iter().all(|s| *s) && seen.len() == 2 * boxes.len() - 1);
    let below: Vec<u32> = bvh.objects_below(bvh.root().unwrap()).collect();
    assert_eq!(below.len(), boxes.len());
}

#[test]
fn unusable_boxes_are_refused_and_change_nothing() {
    let good = DAabb::new(DVec3::ZERO, DVec3::ONE);
    let mut bvh = Bvh::build(&[good]).unwrap();
    let infinite = DAabb::new(DVec3::ZERO, DVec3::INFINITY);
    let nan = DAabb::new(DVec3::NAN, DVec3::ONE);
    let huge = DAabb::new(DVec3::ZERO, DVec3::splat(1e101));
    for bad in [infinite, nan, huge] {
        assert!(matches!(Bvh::build(&[good, bad]), Err(BvhError::Bounds { object: 1, .. })));
        assert!(bvh.insert(bad).is_err() && bvh.set_bounds(0, bad).is_err() && bvh.refit(&[bad]).is_err());
        check(&bvh, &[Some(good)]);
    }
    assert_eq!(bvh.set_bounds(1, good), Err(BvhError::NoSuchObject { object: 1 }));
    assert!(matches!(bvh.refit(&[]), Err(BvhError::Count { boxes: 0, objects: 1 })));
    bvh.remove(0).unwrap();
    assert!(bvh.remove(0).is_err() && bvh.root().is_none() && bvh.cost() == 0.0);
    let largest = DAabb::new(DVec3::splat(-1e100), DVec3::splat(1e100));
    let extreme = Bvh::build(&[largest, good, largest]).unwrap();
    check(&extreme, &[Some(largest), Some(good), Some(largest)]);
    assert!(extreme.cost().is_finite());
}

#[test]
fn coincident_and_sorted_boxes_keep_the_tree_shallow() {
    let same = vec![DAabb::new(DVec3::ZERO, DVec3::ONE); 10_000];
    assert!(Bvh::build(&same).unwrap().depth() <= 15);
    // Exponentially growing boxes defeat bins at every level.
    let nested: Vec<DAabb> =
        (0..300).map(|i| DAabb::new(DVec3::ZERO, DVec3::splat(1.5f64.powi(i)))).collect();
    assert!(Bvh::build(&nested).unwrap().depth() <= MAX_DEPTH);
    let mut grown = Bvh::default();
    let mut boxes = vec![];
    for i in 0..4000 {
        let at = DVec3::X * f64::from(i) * 2.0;
        boxes.push(Some(DAabb::new(at, at + DVec3::ONE)));
        grown.insert(boxes[i as usize].unwrap()).unwrap();
    }
    check(&grown, &boxes);
    let mut piled = Bvh::default();
    for bounds in &same {
        piled.insert(*bounds).unwrap();
    }
    assert!(piled.depth() <= MAX_DEPTH, "{}", piled.depth());
}

#[test]
fn inserted_trees_are_nearly_as_good_as_built_ones() {
    let mut random = Random(5);
    let boxes: Vec<DAabb> = (0..5000).map(|_| random.a_box()).filter(|b| !b.is_empty()).collect();
    let built = Bvh::build(&boxes).unwrap();
    let mut grown = Bvh::default();
    boxes.iter().for_each(|b| {
        grown.insert(*b).unwrap();
    });
    let ratio = grown.cost() / built.cost();
    println!(
        "cost built {:.1}, inserted {:.1}; depth {} and {}",
        built.cost(),
        grown.cost(),
        built.depth(),
        grown.depth()
    );
    assert!(ratio < 1.5, "{ratio}");
    // Half of the objects replaced, many times over.
    for round in 0..20_000 {
        let object = round * 7 % boxes.len();
        grown.remove(object as u32).unwrap();
        assert_eq!(grown.insert(boxes[object]).unwrap(), object as u32);
    }
    assert!(grown.cost() / built.cost() < 1.5);
}
