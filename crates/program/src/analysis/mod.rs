//! Studies of FMUs and loops: linear models, sweeps over parameters.

mod aim;
mod experiments;
mod in_loop;
mod linearise;
mod newton;
mod operating_point;
mod plan;
mod responses;
mod sampled;
mod sweep;
mod trim;

pub use in_loop::{InLoop, in_loop, period};
pub use linearise::{Linearisation, Quantity, linearise};
pub use operating_point::{Method, OperatingPoint};
pub use sweep::{Axis, Point, Spacing, Sweep, SweepPage};
pub use trim::{AtBound, Trim, Wanted};
