//! Runs of loops and single FMUs: instances that exchange values, and their recordings.

mod ahead;
mod alone;
mod changes;
mod closed_loop;
mod exchange;
mod inputs;
mod loaded;
mod port;
mod recording;
mod replay;
mod settling;

pub use alone::{Alone, AloneEvent};
pub(crate) use changes::ROUNDING;
pub use changes::{Change, Place};
pub use closed_loop::ClosedLoop;
pub use inputs::{Inputs, Read, conversion, values_of};
pub use loaded::LoadedLoop;
pub(crate) use loaded::LoadedUnit;
pub use recording::Recording;
pub(crate) use recording::place;
pub use replay::{Compared, Difference, Replay, Share};
