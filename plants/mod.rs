//! The plants and reference signals, and what stands between plant and controller: one file each, in the symbols of
//! their source.

pub mod actuated_siso;
pub mod actuator;
mod attitude;
pub mod channels;
pub mod coupled_mimo;
mod dead_time;
pub mod excitation;
pub mod mares_auv;
pub mod nonlinear_siso;
pub mod quadrotor;
pub mod reference;
pub mod sensor;
pub mod state_space;
mod template;
pub mod twin_rotor;
pub mod two_link_robot;
pub mod unmatched_mimo;
pub mod unwrap;
