//! Results of runs: metrics, tables, pages and provenance, as they are written and read again.

mod comparison;
mod drawn_points;
mod ideal;
mod measured;
mod metrics;
mod overview;
mod provenance;
mod recorded;
mod recorder;
mod report;
mod step_response;
mod steps;
mod table;

pub use comparison::Comparison;
pub use measured::{Measured, four_digits};
pub(crate) use metrics::Difference;
pub use metrics::{Meter, measure};
pub use overview::{Row, Verdict, table};
pub use provenance::{Asked, Mark, Provenance, UnitMark, Versions};
pub use recorded::{FILES, METRICS, Recorded, RecordedRun, metrics_json};
pub use recorder::{Ended, Recorder, TablePlace, Tabled};
pub use report::{Ending, Report, Thinned};
pub(crate) use step_response::StepResponse;
pub use table::{PARQUET, TABLE, Table, TableMark, TableMarks};
