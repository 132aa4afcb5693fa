//! What the program does: loops, their structure and figures, claims of the thesis; and what knows what in its sources.

mod figures;
mod loops;
mod loops_of_others;
mod reproduction;
mod rooms;
mod structures;
