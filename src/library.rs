//! This package's own units: the registry of its systems, and, with the feature `library`, their C functions.
//!
//! To add a model: its own file, its description in `modelDescription/`, and a line here.

use crate::controllers::fuzzy_l1::FuzzyL1;
use crate::controllers::l1::L1;
use crate::controllers::l1_quadrotor::L1Quadrotor;
use crate::controllers::mrac_ppf::MracPpf;
use crate::controllers::neuro_ppf::NeuroPpf;
use crate::controllers::observer::Observer;
use crate::controllers::watched::Watched;
use crate::plants::actuated_siso::ActuatedSiso;
use crate::plants::actuator::Actuator;
use crate::plants::coupled_mimo::CoupledMimo;
use crate::plants::mares_auv::MaresAuv;
use crate::plants::nonlinear_siso::NonlinearSiso;
use crate::plants::quadrotor::Quadrotor;
use crate::plants::reference::Reference;
use crate::plants::sensor::Sensor;
use crate::plants::state_space::StateSpace;
use crate::plants::twin_rotor::TwinRotor;
use crate::plants::two_link_robot::TwoLinkRobot;
use crate::plants::unmatched_mimo::UnmatchedMimo;
use crate::system::{Kind, Registry};

/// Every system of this package.
pub static REGISTRY: Registry = &[
    Kind::of::<Watched<FuzzyL1>>(),
    Kind::of::<Watched<L1>>(),
    Kind::of::<Watched<L1Quadrotor<false>>>(),
    Kind::of::<Watched<L1Quadrotor<true>>>(),
    Kind::of::<MracPpf>(),
    Kind::of::<NeuroPpf>(),
    Kind::of::<Observer>(),
    Kind::of::<ActuatedSiso>(),
    Kind::of::<Actuator>(),
    Kind::of::<CoupledMimo>(),
    Kind::of::<MaresAuv>(),
    Kind::of::<NonlinearSiso>(),
    Kind::of::<Quadrotor>(),
    Kind::of::<Reference>(),
    Kind::of::<Sensor>(),
    Kind::of::<StateSpace>(),
    Kind::of::<TwinRotor>(),
    Kind::of::<TwoLinkRobot>(),
    Kind::of::<UnmatchedMimo>(),
    Kind::COMPOSITE,
];

#[cfg(feature = "library")]
crate::define_fmi2_functions!(crate::library::REGISTRY);
