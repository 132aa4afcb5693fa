//! The commands, run as users run them: folders of results, a loop of one's own, searches, units of other tools, validation.

mod foreign;
mod foreign_exchange;
mod foreign_loops;
mod foreign_units;
mod new_loop;
mod results;
mod resume;
mod searches;
mod streams;
mod validation;
