//! The adaptive controllers: one file each, in the notation of the thesis.

pub mod l1;
pub mod l1_quadrotor;
pub mod observer;
mod position_loop;
