//! Loops as data: read from System Structure and Parameterization 1.0, packed, drafted for given FMUs, checked
//! against them, and composed to one FMU.

mod check;
mod draft;
mod feedthrough;
mod package;
mod settings;
mod ssp;
mod whole;

pub use check::{AlgebraicLoops, Wiring, check, start_values};
pub use draft::{Checked, Draft, DraftUnit, Found, Wishes};
pub use feedthrough::Link;
pub use package::{pack, packed};
pub use settings::{Order, Settings};
pub use ssp::within_run;
pub use ssp::{Component, Connection, Connector, Event, LoopFiles, Origin, StartValue, Structure, UnitFile};
pub use ssp::{ExpectedFailure, IdealModel, Metric, PerformanceFunction, Plot, STRUCTURE, Scale, Statistic};
pub use ssp::{SquareTerm, Tracked, TunedParameter, Tuning};
pub(crate) use whole::ABOUT_STEPS;
pub use whole::{Whole, check_values, composite, composite_name, designed, started, with_values};
