//! FMUs as a master sees them: loading, closed loops, metrics, and what is shown of a run.

mod chart;
mod closed_loop;
mod description;
#[allow(unsafe_code)]
mod fmu;
mod linearise;
mod metrics;
mod model_structure;
mod page;
mod steady_state;
mod structure;
mod thinned;

pub use chart::{svg, terminal};
pub use closed_loop::{ClosedLoop, Order, Recording, Settings};
pub use description::{Description, Variable};
pub use fmu::{Fmu, Instance};
pub use linearise::{Eigenvalue, Linearisation, OperatingPoint, Quantity, linearise};
pub use metrics::{Measured, measure};
pub use page::{Ending, Report};
pub use structure::{Component, Connection, IdealModel, Metric, Plot, Statistic, Structure};
