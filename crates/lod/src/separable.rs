//! Whether an impostor can stand for an object without coming before or behind something that it should not.

use farsight_geometry::bvh::{Bvh, Walk};
use farsight_geometry::{Containment, ConvexBody, Frustum};

/// Whether nothing but `object` itself (and what `ignored` names) reaches into the slab of an impostor ([`ImpostorView::slab`](crate::ImpostorView::slab)).
///
/// The slab is convex and holds the object's drawn points, the picture, and the ways between. A box outside of it lies wholly on one side of some plane that has the
/// slab on the other. So on every line of sight from every eye both, object and picture, come before the box or both come behind it: depth order is that
/// of the object. Disjoint boxes alone do not suffice, since the picture leaves the object's box.
///
/// What an object stands on reaches into its slab as a rule; name it in `ignored` where it is drawn first without depth, or give the picture depth.
///
/// # Cost
/// A walk down the hierarchy; what its conservative test leaves open is cut exactly.
///
/// # References
/// Replaces the collision of boxes in [Hilbert & Brunnett 2004, section 3].
pub fn is_separable(bvh: &Bvh, slab: &Frustum, object: u32, ignored: impl Fn(u32) -> bool) -> bool {
    let mut alone = true;
    bvh.walk(|node, bounds| {
        if !alone || slab.classify(bounds) == Containment::Outside {
            return Walk::Skip;
        }
        if let Some(other) = bvh.object(node)
            && other != object
            && !ignored(other)
        {
            let anchor = slab.anchor();
            let mut body = ConvexBody::from_box(&farsight_geometry::DAabb::new(
                bounds.min - anchor,
                bounds.max - anchor,
            ));
            body.clip_to_frustum(slab, anchor);
            alone = body.is_empty();
        }
        Walk::Descend
    });
    alone
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ImpostorOptions, ImpostorView, Placement};
    use farsight_geometry::glam::{DAffine3, DVec3};
    use farsight_geometry::sampling::{Random, in_box};
    use farsight_geometry::{Camera, DAabb};

    /// Distances at which a ray enters and leaves a box, by slabs.
    fn crossing(b: &DAabb, origin: DVec3, direction: DVec3) -> Option<(f64, f64)> {
        let (a, c) = ((b.min - origin) / direction, (b.max - origin) / direction);
        let (near, far) = (a.min(c).max_element(), a.max(c).min_element());
        (near <= far && far >= 0.0).then_some((near, far))
    }

    /// For random eyes: whether the box comes before some shown points and behind others, or cuts them.
    fn is_torn(view: &ImpostorView, other: &DAabb, random: &mut Random) -> bool {
        let n = view.normal();
        let middle = view.bounds().center();
        (0..60).any(|_| {
            let eye = (DVec3::from_array(random.units()) * 2.0 - 1.0) * 12.0;
            if view.bounds().contains(eye) || other.contains(eye) {
                return false;
            }
            let mut sides = [false; 2];
            for _ in 0..60 {
                let p = in_box(view.bounds(), random.units());
                let ray = p - view.eye();
                let image = view.eye() + ray * (n.dot(middle - view.eye()) / n.dot(ray));
                for shown in [p, image] {
                    if let Some((near, far)) = crossing(other, eye, shown - eye) {
                        sides[0] |= far > 1.0;
                        sides[1] |= near < 1.0;
                    }
                }
            }
            sides == [true; 2]
        })
    }

    #[test]
    fn what_is_separable_is_never_torn_from_any_eye() {
        let mut random = Random::new(51);
        let placement = Placement::new(&DAffine3::IDENTITY, DVec3::ZERO).unwrap();
        let options = ImpostorOptions { max_side: 1 << 20, ..ImpostorOptions::default() };
        let (mut separable, mut torn, mut disjoint_torn) = (0, 0, 0);
        for _ in 0..4000 {
            let mut v = || DVec3::from_array(random.units()) * 2.0 - 1.0;
            let bounds = DAabb::from_points([v(), v(), v()]);
            let eye = v() * 5.0;
            let at = v() * 1.6;
            let other = DAabb::from_points([at, at + v(), at + v()]);
            let camera = Camera::look_at(eye, DVec3::ZERO, DVec3::Y).unwrap();
            let Ok(view) = ImpostorView::new(&placement, &bounds, &bounds.corners(), &camera, &options)
            else {
                continue;
            };
            let bvh = Bvh::build(&[bounds, other]).unwrap();
            let slab = view.slab(&placement);
            let is_torn = is_torn(&view, &other, &mut random);
            if is_separable(&bvh, &slab, 0, |_| false) {
                separable += 1;
                assert!(!is_torn, "{view:?} {other:?}");
            } else {
                torn += u32::from(is_torn);
                disjoint_torn += u32::from(is_torn && !bounds.overlaps(&other));
            }
            assert!(is_separable(&bvh, &slab, 0, |other| other == 1), "it is alone if the other is ignored");
        }
        println!("{separable} separable, {torn} torn, {disjoint_torn} of these with disjoint boxes");
        assert!(separable > 1000 && torn > 200 && disjoint_torn > 30);
    }
}
