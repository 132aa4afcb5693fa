//! The FMI 3.0 boundary, over the same instances as that of FMI 2.0: [`Instance`](crate::fmi2::instance::Instance) is what both call.
//!
//! [`arrays`] decides which variables are arrays, [`model_description`] and [`build_description`] write the XML, [`modes`] has what FMI 2.0 doesn't
//! know, [`configuration`] its sizes that can change, and [`interface`] is the C side. None of them knows a model.

pub mod arrays;
pub mod build_description;
pub mod configuration;
#[allow(unsafe_code)]
pub mod interface;
pub mod model_description;
pub mod modes;

#[macro_use]
mod exports;
