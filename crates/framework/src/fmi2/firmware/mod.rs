//! A law as C99 for a target, without FMI: `NAME.h` and `NAME.c` generated from its recorded equations, `NAME_replay.c`, which tests
//! them, and `NAME_data_sheet.md`.
//!
//! A law's outputs decide what is there: signals, states and events that none of them needs are left out. Parameters are constants
//! but for those that may be calibrated. A step takes a fixed number of Runge-Kutta steps of order 4; a sampled law counts calls
//! from sample to sample, so that no sample is lost in the rounding of time. A step that is refused changes nothing.

mod body;
mod common;
mod constants;
mod data_sheet;
mod driver;
mod equations;
mod functions;
mod header;
mod interface;
mod lanes;
mod law;
mod live;
mod members;
mod parameters;
mod repeated;
mod replay;
mod runge_kutta;
mod substeps;
mod targets;
mod vectors;
mod work;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::error::{Invalid, Number};
use crate::execution::Execution;
use crate::fmi2::source::SourceFile;
use crate::model::Model;
use functions::Structs;
use law::Law;
use substeps::Fastest;
pub use vectors::Signals;
use vectors::Vectors;

/// Outputs of a step that is refused.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Fallback {
    /// The outputs of the last step that was taken; zeros before that.
    #[default]
    Hold,
    /// Zeros.
    Zero,
    /// The manual control, of controllers that have one.
    Manual,
}

/// Options of an export.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// Time between calls, s; by default its sample time or, without one, the step of its default experiment.
    pub period: Option<f64>,
    /// Runge-Kutta steps in a period.
    pub substeps: u32,
    /// True if there are more where the controller's own modes need more to decay; else too few are refused.
    #[serde(default)]
    pub may_rise: bool,
    /// Outputs of a refused step.
    pub fallback: Fallback,
    /// Parameters that can change at run time, without indices; all that can where there is no list.
    pub calibrate: Option<Vec<String>>,
    /// Signals of a loop, a row a period, by the names of inputs: along them modes are found, and they are inputs of the test vectors,
    /// which are small ones otherwise.
    #[serde(default)]
    pub signals: Option<Signals>,
}

impl Default for Options {
    fn default() -> Self {
        Options { period: None, substeps: 1, may_rise: true, fallback: Fallback::Hold, calibrate: None, signals: None }
    }
}

/// The most Runge-Kutta steps in a period.
const MOST_SUBSTEPS: u32 = 10_000;

impl Options {
    /// Refuses what no controller can have.
    ///
    /// # Errors
    /// A period that is no time, or a number of Runge-Kutta steps outside 1 … 10,000.
    pub fn check(&self) -> Result<(), Invalid> {
        if !(1..=MOST_SUBSTEPS).contains(&self.substeps) {
            let allowed = format!("must be a whole number from 1 to {MOST_SUBSTEPS}");
            return Err(Invalid::new("substeps", self.substeps, allowed));
        }
        match self.period {
            Some(period) if !(period.is_finite() && period > 0.0) => {
                Err(Invalid::new("period", Number(period), "must be a time above 0 s"))
            }
            _ => Ok(()),
        }
    }
}

/// A controller for a target.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Firmware {
    /// `NAME.h`, `NAME.c`, `NAME_replay.c` with test vectors where a first step can be taken, and `NAME_data_sheet.md`.
    pub files: Vec<SourceFile>,
    /// Runge-Kutta steps in a period.
    pub substeps: u32,
}

/// A controller for a target.
///
/// # Errors
/// Options that don't fit, with what they may be; what C for targets can't do: equations that can't be recorded, events
/// at times that aren't samples.
pub fn files(model: &Arc<Model>, options: &Options) -> Result<Firmware, Invalid> {
    options.check()?;
    let mut law = Law::of(model, options)?;
    let name = &model.description().name;
    let structs = Structs::of(&law, name);
    if options.fallback == Fallback::Manual && structs.manual.is_empty() {
        let allowed = "must be hold or zero: this controller has no manual control";
        return Err(Invalid::new("fallback", "manual", allowed));
    }
    if structs.outputs.is_empty() {
        return Err(Invalid::new("model", &model.description().model, "has no Real output that a step could give"));
    }
    // A law that can't start from its own start values is not worth a target.
    Execution::new(Arc::clone(model)).initialise().map_err(Invalid::because)?;
    let gathered = equations::constants_by_lanes(&law, &structs);
    constants::gather(&mut law, &gathered);
    common::share(&mut law);
    let signals = options.signals.as_ref();
    let fastest = Fastest::of(&law, &structs, model, signals)?;
    substeps::raise(&mut law, options, fastest.as_ref())?;
    let fastest = fastest.as_ref();
    let vectors = Vectors::of(&law, &structs, model, signals);
    let mut files = vec![
        (format!("{name}.h"), header::write(&law, &structs, fastest, name)),
        (format!("{name}.c"), body::write(&law, &structs, name)),
    ];
    files.extend(vectors.as_ref().map(|made| (format!("{name}_replay.c"), replay::write(&law, &structs, made, name))));
    let sheet = data_sheet::write(&law, &structs, fastest, vectors.as_ref(), name);
    files.push((format!("{name}_data_sheet.md"), sheet));
    Ok(Firmware { files, substeps: law.substeps })
}
