//! The program's functions: export, closed loops, tuning, checks, pages. The command line is a crate of its own.
//!
//! Its models are in [`adaptive_fmu_models`], and what every model needs in [`adaptive_fmu_framework`]; their modules are
//! here by their names, too.
#![deny(missing_docs)]
#![deny(unsafe_code)]

pub mod analysis;
mod base64;
pub mod begun;
#[cfg(target_family = "wasm")]
#[allow(unsafe_code)]
mod browser;
mod c_compiler;
pub mod cache;
#[allow(unsafe_code)]
mod clock;
mod decimal;
pub mod designs;
#[cfg(not(target_family = "wasm"))]
pub mod distribution;
pub mod drawing;
#[allow(unsafe_code)]
mod dynamic;
pub mod ensemble;
pub mod estimation;
pub mod explore;
pub mod exporter;
pub mod figures;
#[allow(unsafe_code)]
pub mod fmu;
pub mod generated;
pub mod identified;
pub mod jit;
pub mod league;
pub mod model_description;
pub mod output;
pub mod parallel;
pub mod parquet;
pub mod playground;
#[cfg(unix)]
#[allow(unsafe_code)]
pub mod process;
pub mod related;
pub mod reproduction;
pub mod results;
pub mod schema;
pub mod scratch;
pub mod sealed;
pub mod simulation;
pub mod structure;
pub mod tables;
pub mod tuning;
pub mod validation;
pub mod verification;
pub mod workers;

pub use adaptive_fmu_framework as framework;
pub use adaptive_fmu_framework::{
    eigenvalues, error, execution, fmi2, integrator, kernel, model, near, nominal, picture, recording, reference,
    report, scalar, system, text_file,
};
pub use adaptive_fmu_models::{catalogue, controllers, design, library, mathematics, pages, plants, template, texts};

/// Checksum of the program's sources without its models.
pub const SOURCE: &str = env!("ADAPTIVE_FMU_SOURCE");
