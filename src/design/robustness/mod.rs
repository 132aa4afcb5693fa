//! Linear loops with plants that differ from the nominal one: stable or not, how it steps, and the worst of many
//! plants.
//!
//! States are in [balanced](crate::mathematics::balanced) coordinates and times in 1/W, as for first designs.

pub mod assumed;
pub mod bounds;
mod draws;
pub mod feedback;
pub mod linear;
pub mod margins;
pub mod pictures;
pub mod place;
pub mod region;
pub mod report;
pub mod respond;
pub mod uncertain;
pub mod worst;
