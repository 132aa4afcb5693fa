//! The league: controllers on equal terms, on the same plants under the same conditions (`league`).
//!
//! A [`Study`] is data: plants, each with its controllers, conditions and limits. A [`Pair`] is the loop of a plant
//! and a controller, with sensors and actuators; the same search tunes all gains, which then stay fixed. Its result
//! is a [`Record`], a file of its own; [`Page`] shows them all.

mod advice;
pub(crate) mod bench;
mod condition;
mod gains;
mod judged;
mod laws;
mod margins;
mod mixer;
mod page;
mod pair;
mod panels;
mod quantity;
mod record;
mod spread;
mod standing;
mod study;
mod units;

pub use advice::{Measured, advice};
pub use condition::Condition;
pub use gains::Gains;
pub use judged::{Failure, Judged, Outcome};
pub use laws::{Law, laws};
pub use margins::{Bound, Margin, Margins};
pub use page::Page;
pub use pair::Pair;
pub use quantity::Quantity;
pub use record::{Record, Stage};
pub use spread::{Spread, interval};
pub use standing::{Rank, Standing, standings};
pub use study::{Advice, Bench, Budget, Entry, Mixer, Plant, Shift, Study};
pub use units::Units;
