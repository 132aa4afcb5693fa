//! L1 adaptive control of a quadrotor's attitude behind a loop for its position: examples 3.3.2 and 7.5.3.

use std::ops::Range;

use super::at_limit::Limited;
use super::l1::{L1Structure, Law, Ports};
use super::position_loop::PositionLoop;
use super::rotor_limits::{NOMINALS, RotorLimits, UNITS};
use super::watched::Tracking;
use crate::catalogue::{Catalogued, Role};
use crate::mathematics::limits::{self, UNLIMITED, within};
use crate::pages::{self, Page};
use crate::system::{
    Declaration, DesignReport, ErrorEstimate, Input, Invalid, Many, OwnStep, Parameter, Point, Rates, Scalar, Signal,
    Signals, Spec, Stride, System, Values, VectorOf, boolean, vector,
};

/// The one angle that may turn without end, by its place in the state of the attitude, counted from 1.
const YAW: usize = 3;

/// Position loop → (φ_d, θ_d) → L1 law for (φ, θ, ψ) → torques. If `OBSERVED`, the L1 law takes the angles and their
/// rates from an observer; the position loop takes the measured angles all the same.
#[derive(Debug)]
pub struct L1Quadrotor<const OBSERVED: bool> {
    position: PositionLoop,
    attitude: Law,
    x: VectorOf<Input>,
    u_manual: VectorOf<Input>,
    /// u before its limits.
    unlimited: VectorOf<Signal>,
    u: VectorOf<Signal>,
    u_min: VectorOf<Parameter>,
    u_max: VectorOf<Parameter>,
    rotors: RotorLimits,
}

impl<const OBSERVED: bool> Tracking for L1Quadrotor<OBSERVED> {
    /// Units of the position and the yaw.
    fn error_units(&self) -> Vec<&'static str> {
        vec!["m", "m", "m", "rad"]
    }

    fn error_quantities(&self) -> Vec<String> {
        ["position in x", "position in y", "height", "yaw angle psi"].map(str::to_owned).to_vec()
    }

    fn tracking_error<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        let error = v[self.position.r][channel] - v[self.x][[0, 1, 2, 8][channel]];
        if channel == 3 { error.wrap() } else { error }
    }
}

impl<const OBSERVED: bool> System for L1Quadrotor<OBSERVED> {
    type Structure = L1Structure;
    const NAME: &'static str = if OBSERVED { "l1-quadrotor-observed" } else { "l1-quadrotor" };
    const DOCUMENTATION: &'static str = pages::L1_QUADROTOR.text;

    fn declare(structure: L1Structure, d: &mut Declaration) -> Result<Self, Invalid> {
        let size = structure.size()?;
        if size != (6, 3) {
            let allowed = "must be 6 x 3: three angles and their rates, and a torque for each";
            return Err(Invalid::new("B", format!("{} x {}", size.0, size.1), allowed));
        }
        let structure = structure.with_angles(&[YAW])?;
        let position = PositionLoop::declare(d);
        let controls = ["thrust along the body's z axis", "torque of roll", "torque of pitch", "torque of yaw"];
        let control = |name: &str, text: &str| {
            let each =
                controls.map(|control| if text.is_empty() { control.into() } else { format!("{text} {control}") });
            vector(name, 4, "").each(&each.each_ref().map(String::as_str)).units(&UNITS).nominals(&NOMINALS)
        };
        let x = d.input(state("x", "measured", 0..if OBSERVED { 9 } else { 12 }));
        let attitude_state = if OBSERVED { d.input(state("x_obs", "estimated", 6..12)) } else { x.part(6..12) };
        let enabled = "whether the controller is in command; the torques take over without a jump";
        let enabled = d.input(boolean("enabled", enabled).start(true));
        let u_manual = d.input(control("u_manual", "while the controller is not enabled:"));
        let u = d.output(control("u", ""));
        let unlimited = d.behind_output(control("#u without limits", ""));
        let min = [0.0, -UNLIMITED, -UNLIMITED, -UNLIMITED];
        let max = [15.0, UNLIMITED, UNLIMITED, UNLIMITED];
        let u_min = d.parameter(control("u_min", "lower limit:").no_lower_limit().starts(&min));
        let u_max = d.parameter(control("u_max", "upper limit:").no_upper_limit().starts(&max));
        let limited = Limited { u, u_min, u_max };
        let rotors = RotorLimits::declare(d, limited, unlimited, u_manual);
        let ports = Ports {
            x: attitude_state,
            r: position.r.part(1..4),
            enabled,
            u_manual: u_manual.part(1..4),
            u: u.part(1..4),
            unlimited: unlimited.part(1..4),
            u_min: u_min.part(1..4),
            u_max: u_max.part(1..4),
            limited,
            rotors: Some(rotors),
        };
        let attitude = Law::declare(&structure, ports, d)?;
        Ok(L1Quadrotor { position, attitude, x, u_manual, u, unlimited, u_min, u_max, rotors })
    }

    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        self.attitude.prepare(v)
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        limits::require_room(self.u_min, self.u_max, v);
        self.rotors.relate(v);
        self.attitude.relate(v);
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        self.attitude.initialise(v);
    }

    fn parameters_changed<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        self.attitude.clip_estimates(v);
    }

    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        let [p1, p2, p3, v1, v2, v3, phi, theta, psi, ..] = v.array::<_, 9>(self.x.part(0..9));
        self.position.outputs([[p1, p2, p3], [v1, v2, v3], [phi, theta, psi]], v, y);
        let thrust = y[self.position.thrust];
        let wanted = S::select(self.attitude.is_active(v), thrust, v[self.u_manual.at(0)]);
        y[self.unlimited.at(0)] = wanted;
        y[self.u.at(0)] = within(wanted, v[self.u_min.at(0)], v[self.u_max.at(0)]);
        let angles: [S; 3] = std::array::from_fn(|i| y[self.position.angles][i]);
        self.attitude.outputs(&angles, v, y);
    }

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        self.attitude.derivatives(v.matrix(self.attitude.feedback_gain()), v, dx);
    }

    fn check<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        self.rotors.check(v);
    }

    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        self.attitude.event_indicators(v, z);
    }

    fn event<S: Scalar>(&self, _t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        self.attitude.event(v);
    }

    fn step_completed<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        self.attitude.step_completed(t, step, v);
    }

    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.attitude.report(&[("", v.matrix(self.attitude.feedback_gain()).into_owned())], v, report);
    }

    fn own_step(&self) -> Option<&dyn OwnStep> {
        Some(self)
    }
}

impl<const OBSERVED: bool> OwnStep for L1Quadrotor<OBSERVED> {
    fn workspace(&self) -> usize {
        self.attitude.closed_form_workspace()
    }

    fn pays(&self, h: f64, relative_tolerance: f64, v: &Values<f64>) -> bool {
        !self.rotors.cut(v) && self.attitude.closed_form_pays(h, relative_tolerance, v)
    }

    /// Not where the rotors cut the torques: what they leave of one moves with the others and with the thrust.
    fn advance(&self, stride: Stride, v: &mut Point) -> bool {
        !self.rotors.cut(&v.values())
            && self.attitude.closed_form(self.position.angles, self.attitude.feedback_gain(), stride, v)
    }

    fn conclude(&self, whole: &Values<f64>, tolerance: (&[f64], f64), v: &mut Point) -> ErrorEstimate {
        self.attitude.conclude(whole, tolerance, v)
    }
}

/// The state (position, velocity, angles, rates of angles) or a part of it, as an input.
fn state(name: &str, how: &str, part: Range<usize>) -> Spec<Many> {
    let kinds = [("position", "m"), ("velocity", "m/s"), ("angle", "rad"), ("rate of angle", "rad/s")];
    let axes = [["in x", "in y", "in z"], ["phi, roll", "theta, pitch", "psi, yaw"]];
    let texts: Vec<_> = part.clone().map(|k| format!("{how} {} {}", kinds[k / 3].0, axes[k / 6][k % 3])).collect();
    let texts: Vec<_> = texts.iter().map(String::as_str).collect();
    let units: Vec<_> = part.clone().map(|k| kinds[k / 3].1).collect();
    vector(name, part.len(), "").each(&texts).units(&units)
}

impl<const OBSERVED: bool> Catalogued for L1Quadrotor<OBSERVED> {
    const TITLE: &'static str = if OBSERVED {
        "L1 adaptive controller of a quadrotor, its attitude observed"
    } else {
        "L1 adaptive controller of a quadrotor"
    };
    const PAGE: Page = pages::L1_QUADROTOR;
    const ROLE: Role = Role::Controller;
}
