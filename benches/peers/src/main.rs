//! Farsight beside libraries written in C++. Needs a C++ compiler.
//!
//! ```text
//! cargo run --release --manifest-path benches/peers/Cargo.toml                             vertex counts
//! cargo run --release --manifest-path benches/peers/Cargo.toml -- simplification           simplification; add --quick for smaller surfaces
//! cargo run --release --manifest-path benches/peers/Cargo.toml -- lod                      level of detail; the same
//! ```

mod lod;
mod simplification;
mod vertex_cache;

use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.first().map(String::as_str) {
        None => {
            if vertex_cache::report() {
                return ExitCode::SUCCESS;
            }
        }
        Some("simplification") => {
            simplification::report(&arguments[1..]);
            return ExitCode::SUCCESS;
        }
        Some("lod") => {
            lod::report(&arguments[1..]);
            return ExitCode::SUCCESS;
        }
        Some(other) => eprintln!("'{other}' is not a comparison; there are 'lod' and 'simplification'"),
    }
    ExitCode::FAILURE
}
