use super::*;
#[test]
fn look() {
    for scene in [SimScene::city(1), SimScene::forest(1)] {
        let mut sim = Simulator::new(Law::default(), 1);
        let start = std::time::Instant::now();
        let times: Vec<f64> = (0..60)
            .map(|i| {
                let camera = scene.camera(0, f64::from(i) / 60.0);
                let seen = scene.visible(&camera);
                sim.time_frame(seen.iter().map(|&i| (&scene.objects[i], 0)), &camera).0
            })
            .collect();
        println!("{} {:?} {times:.1?}", scene.name, start.elapsed());
    }
}
