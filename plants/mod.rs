//! The plants and reference signals: one file each, in the symbols of their source.

pub mod actuated_siso;
mod attitude;
pub mod coupled_mimo;
pub mod mares_auv;
pub mod nonlinear_siso;
pub mod quadrotor;
pub mod reference;
pub mod twin_rotor;
pub mod two_link_robot;
pub mod unmatched_mimo;
