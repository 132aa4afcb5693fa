//! The program: its commands and files, loops, units of other tools, validation.

mod figures;
mod foreign;
mod foreign_exchange;
mod foreign_loops;
mod foreign_units;
mod loops;
mod loops_of_others;
mod new_loop;
mod reproduction;
mod results;
mod resume;
mod rooms;
mod searches;
mod streams;
mod structures;
mod validation;
