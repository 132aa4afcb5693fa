//! Adaptive controllers and their plants as systems, from which units of FMI 2.0 are made.
//!
//! What every model needs stands in a crate of its own, [`adaptive_fmu_framework`], whose modules are here by their
//! names, too. A crate of models depends on that one alone.
#![deny(missing_docs)]
#![deny(unsafe_code)]

pub mod catalogue;
pub mod controllers;
pub mod design;
pub mod library;
pub mod mathematics;
pub mod pages;
// They stand at the top, where a reader looks for them.
#[path = "../plants/mod.rs"]
pub mod plants;
pub mod template;
pub mod texts;

pub use adaptive_fmu_framework::{
    eigenvalues, error, execution, fmi2, integrator, kernel, model, near, nominal, picture, recording, report, scalar,
    structure, system, text_file,
};
