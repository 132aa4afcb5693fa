//! Studies of FMUs and loops: linear models, sweeps over parameters.

mod experiments;
mod linearise;
mod operating_point;
mod plan;
mod responses;
mod sampled;
mod steady_state;
mod sweep;

pub use linearise::{Linearisation, Quantity, linearise};
pub use operating_point::{Method, OperatingPoint};
pub use sweep::{Axis, Point, Spacing, Sweep, SweepPage};
