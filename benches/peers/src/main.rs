//! Farsight beside libraries written in C++. Needs a C++ compiler.
//!
//! ```text
//! cargo run --release --manifest-path benches/peers/Cargo.toml
//! ```

mod vertex_cache;

fn main() -> std::process::ExitCode {
    if vertex_cache::report() { std::process::ExitCode::SUCCESS } else { std::process::ExitCode::FAILURE }
}
