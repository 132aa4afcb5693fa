//! From records to a linear model with the uncertainty that the data leave.
//!
//! # Way of a record
//!
//! 1. [`csv::Table::read`] reads a file, [`Record::of_table`] makes records of it; [`Record::new`] takes columns from memory.
//!    Units of measurement stay as the file has them: a caller that knows units converts the values.
//! 2. [`identify_states`] estimates x' = A x + B u + d where all states are measured, with the [`Structure`] that is known.
//!    [`Refusal`] has a [`Cause`] for programs and a text for people, which names no option of any command line.
//! 3. [`Identified`] has the [`Model`], which is what a file contains, with the covariance of its entries, and
//!    [`Finding`]s. [`Identified::is_sound`] is false where one of them forbids a design.
//!
//! A caller adds checksums of files to [`Model::records`] and the near names to serde's messages about unknown keys.
//!
//! # Method
//!
//! Prediction error with exact derivatives of the sampled model. *Output error*, over windows whose initial states are
//! projected out, counts where only sensors are noisy; the *innovation form*, a predictor with a free gain, for plants that
//! are disturbed, in closed loops or unstable. The covariance holds for correlated and coloured residuals.
#![deny(missing_docs)]
#![forbid(unsafe_code)]

mod cells;
mod checks;
pub mod csv;
mod data;
mod estimate;
mod faults;
mod finding;
mod held_out;
mod identify;
mod known_rows;
mod layout;
mod linear;
mod marquardt;
mod model;
mod options;
mod outputs;
mod poles;
mod predictor;
mod problem;
mod record;
mod request;
mod residuals;
mod sampled;
mod starts;
mod structure;
mod text;
mod uncertainty;
mod written;

pub use finding::{Cause, Finding, Kind, Refusal, Verdict};
pub use identify::identify_states;
pub use model::{Fits, Free, Model, RecordOf, Units};
pub use options::{Estimated, Identified, Options, OrderFit, WrongCell};
pub use outputs::identify_outputs;
pub use poles::Pole;
pub use record::{LABEL, Record, Signals};
pub use sampled::{Hold, SampledModel, sampled};
pub use structure::{Entry, Row, Structure};
