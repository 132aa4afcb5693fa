//! The FMI 3.0 boundary, over the same instances as that of FMI 2.0: [`Instance`](crate::fmi2::instance::Instance) is what both call.
//!
//! [`arrays`] decides which variables are arrays, [`model_description`] writes the XML, [`modes`] has what FMI 2.0 doesn't know, and
//! [`interface`] is the C side. None of them knows a model.

pub mod arrays;
#[allow(unsafe_code)]
pub mod interface;
pub mod model_description;
pub mod modes;

#[macro_use]
mod exports;
