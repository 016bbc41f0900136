//! How well view cells are sampled, and what that costs. Every figure is printed beside the floor it is held to.
//!
//! ```text
//! cargo bench --bench visibility                          everything (some minutes); the scan needs FARSIGHT_DATA
//! cargo bench --bench visibility -- --quick               smaller scenes and budgets
//! cargo bench --bench visibility -- --only speed          one part: growth, speed, correct, small, bound, store, pictures
//! cargo bench --bench visibility -- --scene cubes         one scene: city, igea or cubes
//! cargo bench --bench visibility -- --make-reference      samples the reference sets anew and prints their lines
//! ```

mod bound;
mod correct;
mod growth;
mod item_buffer;
mod judge;
mod pictures;
mod reference;
mod scenes;
mod small;
mod speed;
mod store;

use scenes::Case;
use std::error::Error;

/// What was asked for on the command line.
pub struct Ask {
    /// Smaller scenes and budgets.
    pub quick: bool,
    only: Option<String>,
}

impl Ask {
    fn wants(&self, part: &str) -> bool {
        self.only.as_deref().is_none_or(|only| only == part)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let has = |flag: &str| arguments.iter().any(|a| a == flag);
    let after = |flag: &str| arguments.iter().skip_while(|a| *a != flag).nth(1).cloned();
    let ask = Ask { quick: has("--quick"), only: after("--only") };
    let mut cases = vec![Case::city(ask.quick)?, Case::cubes()?];
    match Case::igea()? {
        Some(case) => cases.insert(1, case),
        None => println!("without FARSIGHT_DATA the scan is left out"),
    }
    if let Some(name) = after("--scene") {
        cases.retain(|c| c.name == name);
    }
    if has("--make-reference") {
        return reference::make(&cases);
    }
    for case in cases.iter().filter(|_| ask.wants("growth") || ask.wants("speed")) {
        println!("\n{}: {} triangles", case.name, case.mesh.triangles().len());
        if ask.wants("growth") {
            growth::report(case, &ask)?;
        }
        if ask.wants("speed") {
            speed::report(case, &ask)?;
        }
    }
    if ask.wants("correct") {
        correct::report(&cases, &ask)?;
    }
    if ask.wants("small") {
        small::report(&ask)?;
    }
    if ask.wants("bound") {
        bound::report(&cases, &ask)?;
    }
    if let Some(case) = cases.first().filter(|_| ask.wants("store")) {
        store::report(case, &ask)?;
    }
    if ask.wants("pictures") {
        pictures::report(&ask)?;
    }
    Ok(())
}
