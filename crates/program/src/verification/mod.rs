//! Verification of a loop by random samples: the part of all runs that fails a requirement, with a confidence; and by
//! subset simulation, if that part is small.

mod accelerated;
mod backend;
mod binomial;
mod distribution;
mod outcome;
mod page;
mod plan;
mod plant;
mod random;
mod rare;
mod rare_summary;
mod record;
mod requirement;
mod sensitivity;
mod study;
mod subset;
mod summary;
mod varied;

pub use backend::Backend;
pub use distribution::{Distribution, Vary};
pub use outcome::{Judged, Limits, Outcome, Tally};
pub use plan::{Plan, Verdict};
pub use plant::VaryFrom;
pub use rare_summary::FailingRange;
pub use record::Record;
pub use requirement::{Limit, Requirement, Side};
pub use study::{Asked, Batch, Ended, Study};
pub use subset::{Drawn, Found, Level};
pub use summary::{Index, Summary};
