//! Figures of runs: diagrams, pages that show them, sketches for a terminal.

mod diagram;
mod page;
mod sketch;

pub(crate) use diagram::diagrams;
pub use diagram::{COLOURS, Diagram, Given, Mark, Part, Path, Peak, Shown, Style};
pub use diagram::{bound, figure, labelled, of_plot, space, svg, thinned, time_label, value_label};
pub use page::{DIAGRAMS, SCRIPT, STYLE, still, still_ending};
pub(crate) use page::{beginning, ending, push_diagrams};
pub use sketch::terminal;
