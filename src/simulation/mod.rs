//! FMUs as a master sees them: loading, closed loops, metrics, and what is shown of a run.

mod alone;
mod check;
mod closed_loop;
mod comparison;
mod diagram;
mod draft;
mod exchange;
mod feedthrough;
#[allow(unsafe_code)]
mod fmu;
mod inputs;
mod linearise;
mod loaded;
mod logarithm;
mod metrics;
mod model_structure;
mod overview;
mod page;
mod plan;
mod port;
mod ready;
mod responses;
mod settling;
mod sketch;
mod ssp;
mod steady_state;
mod whole;

pub use alone::Alone;
pub use check::{Circles, Link, Wiring, check, start_values};
pub use closed_loop::{ClosedLoop, Order, Recording, Settings};
pub use comparison::Comparison;
pub use diagram::{COLOURS, Diagram, Given, Part, Path, Peak, Shown, Style};
pub use diagram::{bound, figure, labelled, of_plot, space, svg, thinned, time_label};
pub use draft::{Checked, Draft, DraftUnit, Found, Wishes};
#[cfg(unix)]
pub use fmu::serve_unit;
pub use fmu::{Event, Fmu, Hosting, Instance, Messages, UNIT_PROCESS, Value, compiler_trouble};
pub use inputs::Inputs;
pub use linearise::{Linearisation, Method, OperatingPoint, Quantity, linearise};
pub use loaded::{LoadedLoop, Place};
pub use metrics::{Measured, measure};
pub use overview::{Row, Verdict, four_digits, table};
pub use page::{DIAGRAMS, Ending, Report, SCRIPT, STYLE};
pub use ready::Ready;
pub use sketch::terminal;
pub use ssp::{Component, Connection, Connector, LoopFiles, Origin, StartValue, Structure, UnitFile, pack};
pub use ssp::{ExpectedFailure, Funnel, IdealModel, Metric, Plot, STRUCTURE, Scale, Statistic};
pub use ssp::{SquareTerm, TunedParameter, Tuning};
pub use whole::{Whole, composite, composite_name, started, with_values};
