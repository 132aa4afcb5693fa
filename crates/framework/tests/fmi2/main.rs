//! The C interface, called as masters call it: what it takes and refuses, states, threads, hosts of all sorts.

mod arguments;
mod boundary;
mod calls;
mod defaults;
mod forged_states;
mod fuzz_targets;
mod host_state;
mod hosts;
mod initialization;
mod instantiation;
mod model_exchange;
mod model_exchange_arguments;
mod panics;
mod processes;
mod sequences;
mod several_steps;
mod starts;
mod states;
mod steps;
mod threads;
mod tunables;
