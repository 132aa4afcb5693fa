//! Identification of a linear model from records, with the uncertainty that the data leave.
//!
//! # Way of a record
//!
//! 1. [`csv::Table::read`] reads a file, [`Record::of_table`] makes records of it; [`Record::new`] takes columns from memory.
//!    Units of measurement stay as the file has them: a caller that knows units converts the values.
//! 2. [`identify_states`] estimates x' = A x + B u + d where all states are measured, with the [`Structure`] that is known.
//!    [`Refusal`] has a [`Cause`] for programs and a text for people, which names no option of any command line.
//! 3. [`Identified`] has the [`Model`], which a file contains, with the covariance of its entries, and [`Finding`]s.
//!
//! ```
//! use adaptive_fmu_identification::{Options, Record, Signals, csv::Table, identify_states};
//!
//! // Speed of a motor, whose voltage is 1 V for 2 s of each 4 s, without noise: x' = -2 x + 6 u.
//! let mut text = "time,voltage,speed [rad/s]\n".to_owned();
//! let (mut x, step) = (0.0, 0.1);
//! for k in 0..200 {
//!     let u = f64::from(k % 40 < 20);
//!     text += &format!("{},{u},{x}\n", f64::from(k) * step);
//!     x = 3.0 * u + (x - 3.0 * u) * f64::exp(-2.0 * step);
//! }
//!
//! let table = Table::read(text.as_bytes(), &[])?;
//! let records = Record::of_table("motor.csv", &table, None)?;
//! let signals = Signals::new(&["voltage"], &["speed"]);
//! let identified = identify_states(&records, None, &signals, &Options::default())?;
//! assert!((identified.model.A[0][0] + 2.0).abs() < 1e-6 && (identified.model.B[0][0] - 6.0).abs() < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`identify_outputs`] does the same where only outputs are measured: it chooses the order and returns observable companion
//! form.
//!
//! # Left to a caller
//!
//! * Units of measurement: values are taken as they are, units are copied.
//! * Checksums of files, [`RecordOf::sha256`].
//! * Near names for unknown keys of files: serde's message lists the known ones. [`Structure`], [`Options`] and [`Model`] are
//!   read by serde from any format; entries are numbers or `"?"`, `"?<0"`, `"?>0"`, rows may be equations in words.
//! * Words of an interface: texts of [`Finding`] and [`Refusal`] name no option of a command line. [`Kind`] and [`Cause`] show to
//!   which finding or refusal a hint belongs.
//! * Exit codes: [`Identified::is_sound`] is false where a finding is [`Verdict::NotSound`].
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
pub mod marquardt;
mod model;
mod options;
mod outputs;
mod poles;
mod predictor;
mod problem;
mod record;
mod request;
mod residuals;
mod response;
mod results;
mod sampled;
mod simulated;
mod starts;
mod structure;
mod text;
mod uncertainty;
mod written;

pub use finding::{Cause, Finding, Kind, Refusal, Verdict};
pub use identify::identify_states;
pub use linear::chi_squared;
pub use model::{Fits, Free, Model, RecordOf, Units};
pub use options::{Estimated, Identified, Options, OrderFit, WrongCell};
pub use outputs::identify_outputs;
pub use poles::{Pole, poles_of};
pub use record::{LABEL, Record, Signals, seconds, time_of};
pub use residuals::Correlations;
pub use response::{Response, responses};
pub use sampled::{Hold, SampledModel, sampled};
pub use simulated::SimulatedCourse;
pub use structure::{Entry, Row, Structure};
