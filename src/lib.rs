//! Adaptive controllers and their plants as systems, from which FMUs of FMI 2.0 are generated.
//!
//! The crate [`adaptive_fmu_framework`] has all that every model needs; its modules are here by their names, too. A
//! crate of models depends on that one only.
#![deny(missing_docs)]
#![deny(unsafe_code)]

pub mod catalogue;
pub mod controllers;
pub mod design;
pub mod library;
pub mod mathematics;
pub mod pages;
// `plants` is a folder at the top, to be found easily.
#[path = "../plants/mod.rs"]
pub mod plants;
pub mod template;
pub mod texts;

pub use adaptive_fmu_framework::{
    eigenvalues, error, execution, fmi2, integrator, kernel, model, near, nominal, picture, recording, reference,
    report, scalar, structure, system, text_file,
};
