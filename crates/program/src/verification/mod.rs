//! Verification of a loop by random samples: the part of all runs that fails a requirement, with a confidence.

mod binomial;
mod distribution;
mod outcome;
mod page;
mod plan;
mod plant;
mod random;
mod record;
mod requirement;
mod sensitivity;
mod study;
mod summary;
mod varied;

pub use distribution::{Distribution, Vary};
pub use outcome::{Judged, Limits, Outcome, Tally};
pub use plan::{Plan, Verdict};
pub use plant::VaryFrom;
pub use record::Record;
pub use requirement::{Limit, Requirement, Side};
pub use study::{Asked, Batch, Ended, Study};
pub use summary::{Index, Summary};
