//! Tests of the program: loops, their structure and figures, claims of the thesis; and dependencies within its sources.

mod ensemble;
mod figures;
mod loops;
mod loops_of_others;
mod modules;
mod reproduction;
mod structures;
