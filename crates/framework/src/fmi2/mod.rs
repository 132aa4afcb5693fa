//! The boundary of FMI 2.0 and, in [`fmi3`], of FMI 3.0: everything that the standards ask of an FMU, for any system.
//!
//! [`calls`] lists the functions that each phase allows, [`instance`] implements the functions in safe Rust,
//! [`interface`] is the C side of it, and [`model_description`] writes the XML. None of them knows a model.

pub mod access;
#[allow(unsafe_code)]
pub(crate) mod boundary;
pub mod build;
pub mod calls;
mod derivatives;
pub mod describe;
pub mod firmware;
pub mod floating_point;
#[macro_use]
pub mod fmi3;
pub mod instance;
#[allow(unsafe_code)]
pub mod interface;
pub mod kernel;
#[allow(unsafe_code)]
mod kernel_interface;
pub mod logger;
pub mod model_description;
pub mod model_exchange;
#[allow(unsafe_code)]
mod model_exchange_interface;
#[cfg(old_glibc)]
#[allow(unsafe_code)]
#[macro_use]
pub mod old_glibc;
pub mod panics;
#[allow(unsafe_code)]
pub mod resources;
pub mod shared;
pub mod snapshot;
pub mod source;
mod states;
#[allow(unsafe_code)]
mod status;
mod stepping;
pub mod types;

#[macro_use]
mod exports;
