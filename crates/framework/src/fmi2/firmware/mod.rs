//! A law as C99 for a target, without FMI: `NAME.h` and `NAME.c` generated from its recorded equations, and
//! `NAME_replay.c`, which tests them.
//!
//! A law's outputs decide what is there: signals, states and events that none of them needs are left out. Parameters are constants
//! but for those that may be calibrated. A step takes a fixed number of Runge-Kutta steps of order 4; a sampled law counts calls
//! from sample to sample, so that no sample is lost in the rounding of time. A step that is refused changes nothing.

mod body;
mod driver;
mod equations;
mod functions;
mod header;
mod interface;
mod law;
mod live;
mod members;
mod parameters;
mod replay;
mod vectors;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::error::{Invalid, Number};
use crate::execution::Execution;
use crate::fmi2::source::SourceFile;
use crate::model::Model;
use functions::Structs;
use law::Law;
use vectors::Vectors;
pub use vectors::{Signals, VECTORS};

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

/// How a law is exported.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// From call to call, s; that of its samples, or the step of its default experiment, where there is none.
    pub period: Option<f64>,
    /// Runge-Kutta steps in a period.
    pub substeps: u32,
    /// Outputs of a refused step.
    pub fallback: Fallback,
    /// Parameters that can change at run time, without indices; all that can where there is no list.
    pub calibrate: Option<Vec<String>>,
    /// Signals of a loop, a row a period, by the names of inputs: inputs of the test vectors, which are small ones otherwise.
    #[serde(default)]
    pub signals: Option<Signals>,
}

impl Default for Options {
    fn default() -> Self {
        Options { period: None, substeps: 1, fallback: Fallback::Hold, calibrate: None, signals: None }
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

/// A controller's files: `NAME.h`, `NAME.c`, and `NAME_replay.c` with test vectors where a first step can be taken.
///
/// # Errors
/// Options that don't fit, with what they may be; what C for targets can't do: equations that can't be recorded, events
/// at times that aren't samples.
pub fn files(model: &Arc<Model>, options: &Options) -> Result<Vec<SourceFile>, Invalid> {
    options.check()?;
    let law = Law::of(model, options)?;
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
    let mut files = vec![
        (format!("{name}.h"), header::write(&law, &structs, name)),
        (format!("{name}.c"), body::write(&law, &structs, name)),
    ];
    let vectors = Vectors::of(&law, &structs, model, options.signals.as_ref());
    files.extend(vectors.map(|vectors| (format!("{name}_replay.c"), replay::write(&law, &structs, &vectors, name))));
    Ok(files)
}
