//! Limits that four rotors put on the thrust and the torques of a quadrotor together.

use super::at_limit::Limited;
use crate::mathematics::limits::within;
use crate::mathematics::rotors::{self, Allocation, RotorPriority, Rotors};
use crate::system::{
    BooleanOf, ChoiceOf, Class, Declaration, Input, Invalid, Many, Parameter, Point, Scalar, ScalarOf, Signal, Signals,
    Spec, Values, VectorOf, boolean, choice, scalar, vector,
};

/// Largest magnitude of a demand: a larger one is divergence, which limited outputs would hide.
const LARGEST_DEMAND: f64 = 1e12;
/// Units of a thrust and torques of roll, pitch and yaw, and their usual magnitudes.
pub(super) const UNITS: [&str; 4] = ["N", "N.m", "N.m", "N.m"];
pub(super) const NOMINALS: [f64; 4] = [5.0, 0.01, 0.01, 0.01];

/// Parameters of the rotors, with the names that they have in the plant.
#[derive(Debug, Clone, Copy)]
pub(super) struct RotorParameters {
    arm_length: ScalarOf<Parameter>,
    drag_to_thrust: ScalarOf<Parameter>,
    rotor_min: ScalarOf<Parameter>,
    rotor_max: ScalarOf<Parameter>,
    priority: ChoiceOf<Parameter, RotorPriority>,
}

impl RotorParameters {
    pub fn declare(d: &mut Declaration) -> Self {
        let ratio = "a rotor's torque about its axis for its thrust";
        let priority = "demand that comes first where the rotors can't give thrust, roll and pitch; yaw comes last";
        RotorParameters {
            arm_length: d.parameter(
                scalar("arm_length", "distance of the rotors from the middle").unit("m").start(0.225).positive(),
            ),
            drag_to_thrust: d.parameter(scalar("drag_to_thrust", ratio).unit("m").start(0.038).positive()),
            rotor_min: d.parameter(scalar("rotor_min", "smallest thrust of a rotor").unit("N")),
            rotor_max: d.parameter(scalar("rotor_max", "largest thrust of a rotor").unit("N").start(3.75)),
            priority: d.parameter(choice::<RotorPriority>("priority", priority)),
        }
    }

    /// Refuses limits that leave the rotors no room.
    pub fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        v.require_below(self.rotor_min, self.rotor_max);
    }

    pub fn rotors<S: Scalar>(&self, v: &Values<S>) -> Rotors<S> {
        Rotors {
            arm_length: v[self.arm_length],
            drag_to_thrust: v[self.drag_to_thrust],
            limits: [v[self.rotor_min], v[self.rotor_max]],
        }
    }

    pub fn allocate<S: Scalar>(&self, demand: [S; 4], v: &Values<S>) -> Allocation<S> {
        self.rotors(v).allocate(demand, v.get(self.priority))
    }

    /// Refuses a demand, of this variable, that no rotors could mean.
    pub fn check<S: Scalar>(demand: S, variable: ScalarOf<impl Class>, v: &mut Point<S>) {
        v.refuse(!demand.abs().at_most(S::from(LARGEST_DEMAND)), |v| {
            let allowed = format!("must be within -{LARGEST_DEMAND:e} … {LARGEST_DEMAND:e}, before the rotors' limits");
            Invalid::new(format!("demand of {}", v.name(variable)), demand.rounded(), allowed)
        });
    }
}

/// The thrust of each rotor.
pub(super) fn rotor_forces(name: &str, end: &str) -> Spec<Many> {
    let texts = ["front", "left", "rear", "right"].map(|place| format!("thrust of the {place} rotor{end}"));
    vector(name, 4, "").each(&texts.each_ref().map(String::as_str)).unit("N")
}

/// The rotors' limits on a control (thrust, torques of roll, pitch and yaw) that has limits of its own.
#[derive(Debug, Clone, Copy)]
pub(super) struct RotorLimits {
    is_on: BooleanOf<Parameter>,
    parameters: RotorParameters,
    force: VectorOf<Signal>,
    limited: Limited,
    /// The control before any limits.
    unlimited: VectorOf<Signal>,
    u_manual: VectorOf<Input>,
}

impl RotorLimits {
    pub fn declare(
        d: &mut Declaration,
        limited: Limited,
        unlimited: VectorOf<Signal>,
        u_manual: VectorOf<Input>,
    ) -> Self {
        let is_on = "whether the controller knows the rotors' limits: u is then the achieved control";
        RotorLimits {
            is_on: d.parameter(boolean("rotor_limits", is_on)),
            parameters: RotorParameters::declare(d),
            force: d.local(rotor_forces("rotor_force", " that gives u")),
            limited,
            unlimited,
            u_manual,
        }
    }

    pub fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        self.parameters.relate(v);
    }

    pub fn is_on<S: Scalar>(&self, v: &Values<S>) -> S::Flag {
        v.get(self.is_on)
    }

    /// A control within its own limits, element by element.
    fn demand<S: Scalar>(&self, control: impl Fn(usize) -> S, v: &Values<S>) -> [S; 4] {
        let Limited { u_min, u_max, .. } = self.limited;
        std::array::from_fn(|i| within(control(i), v[u_min][i], v[u_max][i]))
    }

    /// Limits u, which is within its own limits, to the forces that the rotors give; without rotor limits, u stays.
    pub fn limit<S: Scalar>(&self, v: &Values<S>, y: &mut Signals<S>) {
        let demand: [S; 4] = std::array::from_fn(|i| y[self.limited.u][i]);
        let limited = || {
            let Allocation { forces, achieved } = self.allocate(demand, v);
            (forces, achieved)
        };
        let unlimited = || {
            let RotorParameters { arm_length, drag_to_thrust, .. } = self.parameters;
            (rotors::forces(demand, v[arm_length], v[drag_to_thrust]), demand)
        };
        let (forces, achieved) = S::branch(self.is_on(v), limited, unlimited);
        y.set(self.force, forces);
        y.set(self.limited.u, achieved);
    }

    fn allocate<S: Scalar>(&self, demand: [S; 4], v: &Values<S>) -> Allocation<S> {
        let (is_on, one) = (self.is_on(v), S::from(1.0));
        let Rotors { arm_length, drag_to_thrust, limits } = self.parameters.rotors(v);
        // Without rotor limits, derivatives must not depend on the rotors, whatever their numbers are.
        let [arm_length, drag_to_thrust] = [arm_length, drag_to_thrust].map(|size| S::select(is_on, size, one));
        Rotors { arm_length, drag_to_thrust, limits }.allocate(demand, v.get(self.parameters.priority))
    }

    /// Torques that act under manual control.
    pub fn torques_by_hand<S: Scalar>(&self, v: &Values<S>) -> [S; 3] {
        let demand = self.demand(|i| v[self.u_manual][i], v);
        let [_, torques @ ..] = S::branch(self.is_on(v), || self.allocate(demand, v).achieved, || demand);
        torques
    }

    /// True if the rotors don't give the demanded control.
    pub fn cut(&self, v: &Values<f64>) -> bool {
        let demand = self.demand(|i| v[self.unlimited][i], v);
        self.is_on(v) && v[self.limited.u] != demand
    }

    /// Refuses a demand that has diverged, which the limited control doesn't show.
    pub fn check<S: Scalar>(&self, v: &mut Point<S>) {
        let (demand, is_on) = (self.demand(|i| v[self.unlimited][i], &v.values()), v.get(self.is_on));
        v.when(is_on, |v| {
            for (i, demand) in demand.into_iter().enumerate() {
                RotorParameters::check(demand, self.limited.u.at(i), v);
            }
        });
    }
}
