//! The scene and the cell in it.

use super::Arguments;
use farsight_geometry::glam::DVec3;
use farsight_geometry::{DAabb, Scene, io};
use farsight_raster::scenes::City;
use std::error::Error;
use std::path::Path;

pub struct Input {
    pub scene: Scene,
    pub cell: DAabb,
    /// Direction away from the ground.
    pub up: DVec3,
    /// Where pictures look from the cell.
    pub ahead: DVec3,
}

impl Input {
    pub fn new(arguments: &Arguments) -> Result<Self, Box<dyn Error>> {
        match &arguments.scene {
            None => Self::town(arguments.quick),
            Some(path) => Self::file(path, arguments),
        }
    }

    /// A street of the generated town.
    fn town(small: bool) -> Result<Self, Box<dyn Error>> {
        let city = if small { City::small() } else { City::default() };
        let street = city.street(city.blocks / 2);
        let (center, size) = (DVec3::new(street - 25.0, street, 1.7), DVec3::new(15.0, 2.2, 0.8));
        let cell = DAabb::new(center - size * 0.5, center + size * 0.5);
        Ok(Self { scene: city.build()?, cell, up: DVec3::Z, ahead: DVec3::X })
    }

    /// A file, y up; the cell where it is told to be, else in the middle of the scene.
    fn file(path: &Path, arguments: &Arguments) -> Result<Self, Box<dyn Error>> {
        let scene = io::load(path)?.into_scene().ok_or("a scene of points has no triangles")?;
        let b = scene.bounds();
        let station = arguments.station.map(|n| station(path, n)).transpose()?;
        let center = vector(&arguments.eye)?.or(station).unwrap_or(b.center());
        let size = vector(&arguments.size)?.unwrap_or(b.extent() * 0.02);
        let cell = DAabb::new(center - size * 0.5, center + size * 0.5);
        let level = (b.center() - center).with_y(0.0);
        Ok(Self { scene, cell, up: DVec3::Y, ahead: level.normalize_or(DVec3::X) })
    }
}

fn vector(numbers: &[f64]) -> Result<Option<DVec3>, Box<dyn Error>> {
    match numbers {
        [] => Ok(None),
        &[x, y, z] => Ok(Some(DVec3::new(x, y, z))),
        _ => Err("three numbers make a point: x,y,z".into()),
    }
}

/// The eye point number `n` of the stations that stand beside a level, at the height of a head.
fn station(level: &Path, n: usize) -> Result<DVec3, Box<dyn Error>> {
    let path = level.with_extension("stations.json");
    let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let positions = text.split("\"position\"").skip(1);
    let position = positions.into_iter().nth(n).ok_or("there is no such station")?;
    let list = position.split(['[', ']']).nth(1).ok_or("a station without position")?;
    let numbers = list.split(',').map(|x| x.trim().parse()).collect::<Result<Vec<f64>, _>>()?;
    Ok(vector(&numbers)?.ok_or("a station without position")? + DVec3::Y * 30.0)
}
