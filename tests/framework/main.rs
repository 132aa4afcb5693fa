//! Systems, their connections and what integrates them: events, errors, accuracy, derivatives, work.

mod clocks;
mod closed_form;
mod composites;
mod contacts;
mod dependence;
mod directional;
mod events;
mod failures;
mod growth;
mod honesty;
mod integration;
mod interfaces_agree;
mod jumps;
mod output_derivatives;
mod outputs;
mod recording;
mod stiff;
mod tolerance;
mod work;
