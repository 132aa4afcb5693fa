//! Ports of an L1 controller: those of its own FMU, or a part of them if the FMU contains more.

use super::structure::Symbols;
use crate::controllers::at_limit::{Limited, manual, unlimited};
use crate::controllers::rotor_limits::RotorLimits;
use crate::system::{BooleanOf, Declaration, Input, Parameter, Signal, VectorOf, boolean, vector};

/// The measured state, the control with its limits, and manual control.
#[derive(Debug, Clone, Copy)]
pub(in crate::controllers) struct Ports {
    pub x: VectorOf<Input>,
    /// References of the outputs. A unit that computes some of them has inputs only for outputs that are angles.
    pub r: VectorOf<Input>,
    pub enabled: BooleanOf<Input>,
    pub u_manual: VectorOf<Input>,
    pub u: VectorOf<Signal>,
    /// u before its limits.
    pub unlimited: VectorOf<Signal>,
    pub u_min: VectorOf<Parameter>,
    pub u_max: VectorOf<Parameter>,
    /// The whole control of the unit, with its limits.
    pub limited: Limited,
    /// Limits of the whole control together, where rotors give it.
    pub rotors: Option<RotorLimits>,
}

impl Ports {
    /// Declares the ports of a standalone controller.
    pub fn declare(d: &mut Declaration, r: VectorOf<Input>, units: &Symbols) -> Self {
        let (x, u) = (&units.x, &units.u);
        let enabled =
            boolean("enabled", "whether the controller is in command; it takes over without a jump").start(true);
        let x = d.input(vector("x", x.len(), "measured state of the plant").about(&units.of_x, "measured {}").units(x));
        let enabled = d.input(enabled);
        let u_manual = d.input(manual(u, &units.of_u));
        let limited =
            Limited::declare(d, (u, &units.of_u), "that the actuator can give; the predictor knows of it", "");
        let Limited { u, u_min, u_max } = limited;
        let unlimited = unlimited(d, u.len());
        Ports { x, r, enabled, u_manual, u, unlimited, u_min, u_max, limited, rotors: None }
    }
}
