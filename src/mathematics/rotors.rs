//! Allocation of a thrust and three torques to the four rotors of a quadrotor, each within its limits.
//!
//! Rotor 1 is in front, 2 left, 3 behind, 4 right; 1 and 3 turn the body to the left, 2 and 4 to the right. Rotor i gives
//! f_i = t + s d_i + s_y τ_r g_i with d = (−τ_q, τ_p, τ_q, −τ_p)/2l and g = (1, −1, 1, −1)/4c: a quarter of the thrust, the
//! part s of roll and pitch, whose direction stays, and the part s_y of yaw. Limits cut yaw first.

use crate::system::{Choice, Chosen, Scalar, larger, smaller};

/// Demand that gives way where the rotors can't give thrust, roll and pitch at the same time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RotorPriority {
    /// The thrust, up and down.
    Attitude,
    /// The thrust where it has to be lowered; roll and pitch where it would have to be raised.
    AttitudeDown,
    /// Roll and pitch.
    Thrust,
}

impl Choice for RotorPriority {
    const TYPE: &'static str = "RotorPriority";
    const ITEMS: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Attitude, "attitude", "roll and pitch come first: the thrust is raised or lowered for them"),
        (Self::AttitudeDown, "attitude_down", "the thrust is lowered for roll and pitch, but never raised"),
        (Self::Thrust, "thrust", "the thrust comes first: roll and pitch are cut"),
    ];
}

/// Four equal rotors, a quarter turn from each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rotors<S> {
    /// Distance l of the rotors from the middle.
    pub arm_length: S,
    /// Torque c of a rotor about its own axis for its thrust.
    pub drag_to_thrust: S,
    /// Smallest and largest thrust of a rotor.
    pub limits: [S; 2],
}

/// Thrusts of the rotors, and their sum and torques.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Allocation<S> {
    /// Thrust of each rotor.
    pub forces: [S; 4],
    /// Thrust, and torques of roll, pitch and yaw: those of the demand, to the last bit, where no limit cuts them.
    pub achieved: [S; 4],
}

/// A thrust and torques as they show in the thrust of a rotor.
#[derive(Clone, Copy)]
struct Shares<S> {
    quarter: S,
    roll: S,
    pitch: S,
    yaw: S,
}

/// The thrust of each rotor that together give a thrust and torques of roll, pitch and yaw, whatever their limits are.
pub fn forces<S: Scalar>(demand: [S; 4], arm_length: S, drag_to_thrust: S) -> [S; 4] {
    Shares::of(demand, arm_length, drag_to_thrust).forces()
}

impl<S: Scalar> Shares<S> {
    fn of([thrust, roll, pitch, yaw]: [S; 4], arm_length: S, drag_to_thrust: S) -> Self {
        let (quarter, yaw) = (thrust / 4.0, yaw / (drag_to_thrust * 4.0));
        Shares { quarter, roll: roll / (arm_length * 2.0), pitch: pitch / (arm_length * 2.0), yaw }
    }

    fn forces(self) -> [S; 4] {
        let Shares { quarter, roll, pitch, yaw } = self;
        [quarter - pitch + yaw, quarter + roll - yaw, quarter + pitch + yaw, quarter - roll - yaw]
    }
}

impl<S: Scalar> Rotors<S> {
    /// Divides a thrust and torques of roll, pitch and yaw among the rotors, as far as their limits allow.
    pub fn allocate(&self, demand: [S; 4], priority: Chosen<S, RotorPriority>) -> Allocation<S> {
        let asked = Shares::of(demand, self.arm_length, self.drag_to_thrust);
        let (quarter, part) = self.thrust_and_part(&asked, priority);
        let (roll, pitch) = (part * asked.roll, part * asked.pitch);
        let of_yaw = part_within(self.room_of_yaw(Shares { quarter, roll, pitch, ..asked }), asked.yaw.abs());
        let given = Shares { quarter, roll, pitch, yaw: of_yaw * asked.yaw };
        let [_, by_roll, by_pitch, by_yaw] = demand;
        Allocation {
            // Rounding leaves no rotor beyond its limits.
            forces: given.forces().map(|force| self.clipped(force)),
            achieved: [quarter * 4.0, part * by_roll, part * by_pitch, of_yaw * by_yaw],
        }
    }

    /// A quarter t of the thrust, and the part s of roll and pitch. d is symmetric: max d = −min d is the larger share.
    fn thrust_and_part(&self, asked: &Shares<S>, priority: Chosen<S, RotorPriority>) -> (S, S) {
        let [min, max] = self.limits;
        let most = larger(asked.roll.abs(), asked.pitch.abs());
        let part = part_within((max - min) / 2.0, most);
        let (low, high) = (min + part * most, max - part * most);
        let (is_low, is_high) = (asked.quarter.below(low), asked.quarter.above(high));
        let (may_rise, may_fall) = (priority.is(RotorPriority::Attitude), !priority.is(RotorPriority::Thrust));
        let gives_way = (!is_low | may_rise) & (!is_high | may_fall);
        // Not by `within`, whose limits are in order: rounding may turn these.
        let moved = larger(smaller(asked.quarter, high), low);
        let clipped = self.clipped(asked.quarter);
        let part_of_kept = part_within(smaller(max - clipped, clipped - min), most);
        (S::select(gives_way, moved, clipped), S::select(gives_way, part, part_of_kept))
    }

    /// Largest magnitude of yaw's share that the rotors have room for in addition to the others.
    fn room_of_yaw(&self, given: Shares<S>) -> S {
        let [min, max] = self.limits;
        let Shares { quarter, roll, pitch, yaw } = given;
        let (along, across) = (pitch.abs(), roll.abs());
        let is_left = yaw.at_least(S::from(0.0));
        // Rotors 1 and 3 push more to the left, 2 and 4 to the right.
        let (more, less) = (S::select(is_left, along, across), S::select(is_left, across, along));
        smaller(max - (quarter + more), quarter - less - min)
    }

    fn clipped(&self, force: S) -> S {
        let [min, max] = self.limits;
        larger(smaller(force, max), min)
    }
}

/// The largest part of an amount, which isn't negative, for which there is room, 1 at most.
fn part_within<S: Scalar>(room: S, amount: S) -> S {
    let (room, one) = (larger(room, S::from(0.0)), S::from(1.0));
    let is_more = amount.above(room);
    // Nothing is divided by 0, on neither way.
    S::select(is_more, room / S::select(is_more, amount, one), one)
}

#[cfg(test)]
mod tests;
