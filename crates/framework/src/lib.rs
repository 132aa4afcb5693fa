//! Framework for authors of models: a dynamic system, written once, becomes FMUs of FMI 2.0 and FMI 3.0.
//!
//! A model is a [`system::System`]: declared variables and equations. The rest is written once: [`integrator`] takes
//! it through a communication step with error control, [`execution`] holds one instance of it in time, and
//! [`export_fmi2`] makes a crate of models a shared library, which the program `adaptive-fmu` packs.
#![deny(missing_docs)]
#![deny(unsafe_code)]

mod controls;
mod designed;
pub mod differentiation;
pub mod eigenvalues;
pub mod error;
pub mod execution;
#[macro_use]
pub mod fmi2;
pub mod integrator;
pub mod kernel;
pub mod model;
pub mod near;
pub mod nominal;
pub mod picture;
pub mod recording;
pub mod reference;
pub mod report;
pub mod scalar;
pub mod structure;
pub mod system;
pub mod text_file;
