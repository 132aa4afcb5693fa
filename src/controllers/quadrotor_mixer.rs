//! Mixer of a quadrotor: a thrust and torques as the thrusts of its four rotors, within their limits.

use super::rotor_limits::{NOMINALS, RotorParameters, UNITS, rotor_forces};
use crate::catalogue::{Catalogued, Demonstration, Role, Scale, Stimulus};
use crate::mathematics::rotors::Allocation;
use crate::pages::{self, Page};
use crate::system::{
    BooleanOf, Declaration, Discrete, Input, Invalid, NoStructure, Point, Scalar, Signal, Signals, System, Values,
    VectorOf, any, boolean, vector,
};

/// A demand counts as met up to this part of it.
const MET: f64 = 1e-9;

/// (τ_z, τ_p, τ_q, τ_r) → f, the thrust of each rotor.
#[derive(Debug)]
pub struct QuadrotorMixer {
    rotors: RotorParameters,
    u: VectorOf<Input>,
    f: VectorOf<Signal>,
    achieved: VectorOf<Signal>,
    saturated: BooleanOf<Discrete>,
    indicator: usize,
}

impl System for QuadrotorMixer {
    type Structure = NoStructure;
    const NAME: &'static str = "quadrotor-mixer";
    const DOCUMENTATION: &'static str = pages::QUADROTOR_MIXER.text;

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let controls = ["thrust along the body's z axis", "torque of roll", "torque of pitch", "torque of yaw"];
        let control = |name: &str, texts: [String; 4]| {
            vector(name, 4, "").each(&texts.each_ref().map(String::as_str)).units(&UNITS).nominals(&NOMINALS)
        };
        let saturated = "whether the rotors give less, or more, than is commanded";
        Ok(QuadrotorMixer {
            rotors: RotorParameters::declare(d),
            u: d.input(control("u", controls.map(|control| format!("commanded {control}")))),
            f: d.output(rotor_forces("f", "")),
            achieved: d.output(control("achieved", controls.map(|control| format!("{control} that the rotors give")))),
            saturated: d.discrete(boolean("saturated", saturated).output()),
            indicator: d.indicators(["whether the rotors give the commanded control"]),
        })
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        self.rotors.relate(v);
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        self.look(v);
    }

    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        let Allocation { forces, achieved } = self.rotors.allocate(v.array(self.u), v);
        y.set(self.f, forces);
        y.set(self.achieved, achieved);
    }

    fn check<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        for i in 0..self.u.len() {
            RotorParameters::check(v[self.u][i], self.u.at(i), v);
        }
    }

    /// Negative when `saturated` has changed.
    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        let (before, now) = (v.get(self.saturated), self.is_saturated(v));
        let is_same = (before & now) | (!before & !now);
        z[self.indicator] = S::select(is_same, S::from(1.0), S::from(-1.0));
    }

    fn event<S: Scalar>(&self, _t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        self.look(v);
    }

    fn step_completed<S: Scalar>(&self, _t: S, _step: S, v: &mut Point<S>) {
        self.look(v);
    }
}

impl QuadrotorMixer {
    /// True if the rotors don't give the commanded control.
    fn is_saturated<S: Scalar>(&self, v: &Values<S>) -> S::Flag {
        let demand: [S; 4] = v.array(self.u);
        let achieved = self.rotors.allocate(demand, v).achieved;
        let differs = |(asked, given): (S, S)| (given - asked).abs().above(asked.abs() * MET);
        any::<S>(demand.into_iter().zip(achieved).map(differs))
    }

    fn look<S: Scalar>(&self, v: &mut Point<S>) {
        let is_saturated = self.is_saturated(&v.values());
        v.put(self.saturated, is_saturated);
    }
}

impl Catalogued for QuadrotorMixer {
    const PAGE: Page = pages::QUADROTOR_MIXER;
    const ROLE: Role = Role::Actuator;
    const DEMONSTRATION: Option<Demonstration> = Some(Demonstration {
        input: "u",
        stimulus: Stimulus::Steps,
        constant_inputs: &[],
        output: "f",
        shows_all: true,
        scale: |of, _| {
            let thrust = of("u");
            (thrust > 0.0).then_some(Scale { about: thrust, size: 2.5 * of("rotor_max"), duration: 1.0 })
        },
        example: "'u[1]' = 4.905\n'u[2]' = 0.3\n'u[4]' = 0.1",
    });
}
