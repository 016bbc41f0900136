//! Hard configurations by the ten thousand, and what must not change from one frame to the next.

mod corpus;

use corpus::{Class, Outcome, run};
use farsight_geometry::sampling::Random;
use farsight_geometry::{Camera, DAabb};
use farsight_shadow::{Focus, MapOptions, Scope, ShadowError, ShadowLight, Warp};
use glam::{DQuat, DVec3, dvec3};

fn check(per_class: u64) {
    for class in Class::ALL {
        let o: Outcome = run(class, 0, per_class);
        println!("{class:?}: {o:?}");
        assert_eq!((o.not_finite, o.outside, o.wrong_rays), (0, 0, 0), "{class:?}");
        assert!(o.maps > o.tried / 20, "{class:?}: hardly any maps, {o:?}");
        assert!(o.shift_mild <= 0.01, "{class:?}: {} texels", o.shift_mild);
    }
}

#[test]
fn twenty_thousand_hard_configurations() {
    check(3000);
}

#[test]
#[ignore = "a million configurations: a minute or two"]
fn a_million_hard_configurations() {
    check(120_000);
}
