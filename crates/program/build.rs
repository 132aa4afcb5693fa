//! What a run tells of the program that made it.

use adaptive_fmu_sources as sources;

fn main() {
    sources::track(&["src", "Cargo.toml", "build.rs"]);
}
