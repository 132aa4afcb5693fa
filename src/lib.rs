//! Adaptive controllers and their plants as FMI 2.0 units, and the exporter that packs any dynamic system.
//!
//! A model is a [`system::System`]: declared variables and equations. The rest is written once: [`integrator`] takes
//! it through a communication step with error control, [`execution`] holds one instance of it in time.
#![deny(missing_docs)]
#![deny(unsafe_code)]

pub mod catalogue;
pub mod control;
pub mod controllers;
#[cfg(feature = "cli")]
pub mod distribution;
pub mod error;
pub mod execution;
#[cfg(feature = "cli")]
pub mod exporter;
#[macro_use]
pub mod fmi2;
pub mod integrator;
pub mod library;
pub mod model;
#[cfg(feature = "cli")]
pub mod output;
#[cfg(feature = "cli")]
pub mod parallel;
#[path = "../plants/mod.rs"]
pub mod plants;
pub mod recording;
pub mod report;
#[cfg(feature = "cli")]
pub mod reproduction;
#[cfg(feature = "cli")]
pub mod schema;
#[cfg(feature = "cli")]
pub mod simulation;
pub mod structure;
pub mod system;
pub mod template;
pub mod text_file;
#[cfg(feature = "cli")]
pub mod tuning;
#[cfg(feature = "cli")]
pub mod validation;

/// Whether this crate was built with the C functions of its own models in it; see [`export_fmi2`].
pub const EXPORTS_ITS_OWN_MODELS: bool = cfg!(feature = "library");
