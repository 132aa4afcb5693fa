//! Systems, their connections and what integrates them: events, errors, accuracy, derivatives, work.

mod at_limits;
mod clocks;
mod closed_form;
mod composites;
mod contacts;
mod dependence;
mod designed;
mod directional;
mod events;
mod failures;
mod fixed;
mod growth;
mod honesty;
mod integration;
mod interfaces_agree;
mod jumps;
mod kernel;
mod order_eight;
mod output_derivatives;
mod outputs;
mod recording;
mod relations;
mod source;
mod stiff;
mod tolerance;
mod work;
