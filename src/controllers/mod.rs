//! The adaptive controllers: one file each, in the notation of the thesis.

#[allow(dead_code)]
mod funnel;
mod fuzzy_gain;
pub mod fuzzy_l1;
pub mod l1;
pub mod l1_quadrotor;
pub mod observer;
mod position_loop;
