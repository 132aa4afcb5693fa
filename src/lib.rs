//! Adaptive controllers and their plants as FMI 2.0 units, and the exporter that packs any dynamic system.
//!
//! What every model needs stands in a crate of its own, [`adaptive_fmu_framework`], whose modules are here by their
//! names, too. A crate of models depends on that one alone.
#![deny(missing_docs)]
#![deny(unsafe_code)]

#[cfg(feature = "cli")]
mod base64;
#[cfg(feature = "cli")]
mod cache;
pub mod catalogue;
pub mod controllers;
#[cfg(feature = "cli")]
pub mod distribution;
#[cfg(feature = "cli")]
#[allow(unsafe_code)]
mod dynamic;
#[cfg(feature = "cli")]
pub mod explore;
#[cfg(feature = "cli")]
pub mod exporter;
#[cfg(feature = "cli")]
pub mod league;
pub mod library;
pub mod mathematics;
#[cfg(feature = "cli")]
pub mod model_description;
#[cfg(feature = "cli")]
pub mod output;
#[cfg(feature = "cli")]
pub mod parallel;
#[cfg(feature = "cli")]
pub mod parquet;
#[path = "../plants/mod.rs"]
pub mod plants;
#[cfg(feature = "cli")]
pub mod reproduction;
#[cfg(feature = "cli")]
pub mod schema;
#[cfg(feature = "cli")]
pub mod sealed;
#[cfg(feature = "cli")]
pub mod simulation;
pub mod template;
#[cfg(feature = "cli")]
pub mod tuning;
#[cfg(feature = "cli")]
pub mod validation;

pub use adaptive_fmu_framework::{
    eigenvalues, error, execution, fmi2, integrator, kernel, model, near, recording, report, scalar, structure, system,
    text_file,
};

// For a library that holds models of this package beside others: without the feature `library`, whose functions have the
// same names.
#[cfg(not(feature = "library"))]
pub use adaptive_fmu_framework::export_fmi2;
