//! Quadrotor: examples 3.3.2 and 7.5.3.

use super::attitude::{Attitude, require_regular};
use crate::catalogue::{Catalogued, Trial};
use crate::mathematics::limits::within;
use crate::mathematics::rotors;
use crate::pages::{self, Page};
use crate::system::{
    BooleanOf, Declaration, Input, Invalid, MatrixOf, NoStructure, Parameter, Point, Rates, Scalar, ScalarOf, Signal,
    Signals, State, System, Values, VectorOf, boolean, matrix, scalar, vector,
};

/// Place of the pitch angle in the state.
const PITCH: usize = 7;

/// p'' = (R(η) (0, 0, τ_z) + F)/m − g e_z; η'' = f(η, η') + G(η) τ.
#[derive(Debug)]
pub struct Quadrotor {
    x0: VectorOf<Parameter>,
    m: ScalarOf<Parameter>,
    inertia: VectorOf<Parameter>,
    g: ScalarOf<Parameter>,
    thrust_min: ScalarOf<Parameter>,
    thrust_max: ScalarOf<Parameter>,
    /// F: what wind or a rope does.
    disturbance_force: VectorOf<Parameter>,
    exact_kinematics: BooleanOf<Parameter>,
    rotors: Rotors,
    uncertainty: Uncertainty,
    u: VectorOf<Input>,
    x: VectorOf<State>,
    y: VectorOf<Signal>,
    /// τ_z within its limits, less what rotors lack.
    thrust: ScalarOf<Signal>,
}

/// Shares of the controls in each rotor: 1 in front, 2 left, 3 behind, 4 right; 1 and 3 turn the body to the left.
#[derive(Debug)]
struct Rotors {
    effect: VectorOf<Parameter>,
    arm: ScalarOf<Parameter>,
    drag_to_thrust: ScalarOf<Parameter>,
}

/// Uncertainty that the second case of the example adds.
#[derive(Debug)]
struct Uncertainty {
    uncertain: BooleanOf<Parameter>,
    input_gain: VectorOf<Parameter>,
    coefficient: MatrixOf<Parameter>,
    gain: VectorOf<Parameter>,
    frequency: VectorOf<Parameter>,
    /// Coefficients of the denominators.
    filter: VectorOf<Parameter>,
    disturbance0: VectorOf<Parameter>,
    /// Disturbance of φ; disturbance of θ and second state of its filter; the same of ψ.
    disturbance: VectorOf<State>,
}

impl System for Quadrotor {
    type Structure = NoStructure;
    const NAME: &'static str = "quadrotor";
    const DOCUMENTATION: &'static str = pages::QUADROTOR.text;

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let starts = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, -0.1, 0.2, 0.0, 0.0, 0.0];
        let units = ["m", "m/s", "rad", "rad/s"].map(|unit| [unit; 3]).concat();
        let texts = ["position in x", "position in y", "height", "velocity in x", "velocity in y", "climb rate"]
            .into_iter()
            .chain(["phi, roll", "theta, pitch", "psi, yaw", "rate of phi", "rate of theta", "rate of psi"])
            .collect::<Vec<_>>();
        let initial: Vec<_> = texts.iter().map(|text| format!("initial {text}")).collect();
        let initial: Vec<_> = initial.iter().map(String::as_str).collect();
        let outputs = ["position in x", "position in y", "height", "psi, yaw"].map(|y| format!("tracked output, {y}"));
        let axes = ["x", "y", "z"].map(|axis| format!("moment of inertia about the body's {axis} axis"));
        let forces = ["x", "y", "z"].map(|axis| format!("force from outside, as of wind, along earth's {axis} axis"));
        let forces = forces.each_ref().map(String::as_str);
        let controls = ["thrust along the body's z axis", "torque of roll", "torque of pitch", "torque of yaw"];
        let exact = "whether the body's rates are distinguished from the angles' rates";
        Ok(Quadrotor {
            x0: d.parameter(vector("x0", 12, "").each(&initial).units(&units).starts(&starts).fixed()),
            m: d.parameter(scalar("m", "mass").unit("kg").start(0.5).positive()),
            inertia: d.parameter(
                vector("inertia", 3, "")
                    .each(&axes.each_ref().map(String::as_str))
                    .unit("kg.m2")
                    .starts(&[4.85e-3, 4.85e-3, 8.81e-3])
                    .positive(),
            ),
            g: d.parameter(scalar("g", "acceleration of gravity").unit("m/s2").start(9.81)),
            thrust_min: d.parameter(scalar("thrust_min", "smallest thrust").unit("N")),
            thrust_max: d.parameter(scalar("thrust_max", "largest thrust").unit("N").start(15.0)),
            disturbance_force: d.parameter(vector("disturbance_force", 3, "").each(&forces).unit("N")),
            exact_kinematics: d.parameter(boolean("exact_kinematics", exact)),
            rotors: Rotors::declare(d),
            uncertainty: Uncertainty::declare(d),
            u: d.input(
                vector("u", 4, "")
                    .each(&controls)
                    .units(&["N", "N.m", "N.m", "N.m"])
                    .nominals(&[5.0, 0.01, 0.01, 0.01]),
            ),
            x: d.state(vector("x", 12, "").each(&texts).units(&units).output().source("Hashim, example 3.3.2")),
            y: d.output(
                vector("y", 4, "").each(&outputs.each_ref().map(String::as_str)).units(&["m", "m", "m", "rad"]),
            ),
            thrust: d.local(
                scalar("thrust", "acting thrust, within its limits and less the loss of rotors").unit("N").nominal(5.0),
            ),
        })
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        v.require_at_most(self.thrust_min, self.thrust_max);
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.copy(self.x0, self.x);
        v.copy(self.uncertainty.disturbance0, self.uncertainty.disturbance);
        require_regular(self.x0.at(PITCH), v.get(self.exact_kinematics), v);
    }

    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        let [p1, p2, p3, _, _, _, _, _, psi, ..] = v.array::<_, 12>(self.x);
        y.set(self.y, [p1, p2, p3, psi]);
        [y[self.thrust], ..] = self.acting(v);
    }

    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let x: [S; 12] = v.array(self.x);
        let [velocity, angles, rates] = [3, 6, 9].map(|first| [x[first], x[first + 1], x[first + 2]]);
        let attitude = Attitude::new(angles);
        let [_, _, up] = attitude.axes();
        let force = v.array::<_, 3>(self.disturbance_force);
        let [a1, a2, a3] = std::array::from_fn(|i| (up[i] * v[self.thrust] + force[i]) / v[self.m]);
        let turning = self.uncertainty.applied(angles, self.angular_accelerations(&attitude, rates, v), v);
        let parts = [velocity, [a1, a2, a3 - v[self.g]], rates, turning];
        dx.set(self.x, parts.as_flattened());
        self.uncertainty.derivatives(t, v, dx);
    }
}

impl Quadrotor {
    /// The thrust and the torques that act.
    fn acting<S: Scalar>(&self, v: &Values<S>) -> [S; 4] {
        let [thrust, torques @ ..] = v.array::<_, 4>(self.u);
        let [p, q, r] = torques;
        self.rotors.acting([within(thrust, v[self.thrust_min], v[self.thrust_max]), p, q, r], v)
    }

    /// f(η, η') and G(η) τ. The printed f takes the angles' rates for those of the body, and G for I⁻¹.
    fn angular_accelerations<S: Scalar>(&self, attitude: &Attitude<S>, rates: [S; 3], v: &Values<S>) -> [[S; 3]; 2] {
        let [i_x, i_y, i_z] = v.array(self.inertia);
        let [_, tau_p, tau_q, tau_r] = self.acting(v);
        let gyroscopic =
            |[p, q, r]: [S; 3]| [(i_y - i_z) / i_x * q * r, (i_z - i_x) / i_y * p * r, (i_x - i_y) / i_z * p * q];
        let by_torques = [tau_p / i_x, tau_q / i_y, tau_r / i_z];
        let exact = || {
            let (turning, drift) = (gyroscopic(attitude.body_rates(rates)), attitude.body_rate_drift(rates));
            let free = std::array::from_fn(|i| turning[i] - drift[i]);
            [free, by_torques].map(|acceleration| attitude.angle_rates(acceleration))
        };
        S::branch(v.get(self.exact_kinematics), exact, || [gyroscopic(rates), by_torques])
    }
}

impl Rotors {
    fn declare(d: &mut Declaration) -> Self {
        let effect =
            ["front", "left", "rear", "right"].map(|place| format!("part of its thrust that the {place} rotor gives"));
        let effect = effect.each_ref().map(String::as_str);
        let ratio = "a rotor's torque about its axis for its thrust";
        Rotors {
            effect: d.parameter(vector("rotor_effect", 4, "").each(&effect).start(1.0).min(0.0).max(1.0)),
            arm: d.parameter(
                scalar("arm_length", "distance of the rotors from the middle").unit("m").start(0.225).positive(),
            ),
            drag_to_thrust: d.parameter(scalar("drag_to_thrust", ratio).unit("m").start(0.038).positive()),
        }
    }

    /// Controls (T, τ) that act: each rotor lacks a part of the thrust that it should give, and of its torques.
    fn acting<S: Scalar>(&self, [thrust, roll, pitch, yaw]: [S; 4], v: &Values<S>) -> [S; 4] {
        let (arm, drag) = (v[self.arm], v[self.drag_to_thrust]);
        let would = rotors::forces([thrust, roll, pitch, yaw], arm, drag);
        let [front, left, rear, right] = std::array::from_fn(|i| (S::from(1.0) - v[self.effect.at(i)]) * would[i]);
        let (along, across) = (front + rear, left + right);
        [
            thrust - along - across,
            roll - arm * (left - right),
            pitch - arm * (rear - front),
            yaw - drag * (along - across),
        ]
    }
}

impl Uncertainty {
    fn declare(d: &mut Declaration) -> Self {
        let filters = [
            "a of the filter 1/(s + a) of phi's disturbance",
            "a of the filter 1/(s^2 + a s + b) of theta's disturbance",
            "b of the filter 1/(s^2 + a s + b) of theta's disturbance",
            "a of the filter 1/(s^2 + a s + b) of psi's disturbance",
            "b of the filter 1/(s^2 + a s + b) of psi's disturbance",
        ];
        let states = [
            "disturbance of phi",
            "disturbance of theta",
            "second state of the filter of theta's disturbance",
            "disturbance of psi",
            "second state of the filter of psi's disturbance",
        ];
        let initial = states.map(|state| format!("initial {state}"));
        let (initial, units) =
            (initial.each_ref().map(String::as_str), ["rad/s2", "rad/s2", "rad/s3", "rad/s2", "rad/s3"]);
        let what = "whether uncertainty, other input gains and disturbances act";
        let coefficient = "coefficient of a term of the uncertainty: row by angle, first or second term";
        Uncertainty {
            uncertain: d.parameter(boolean("uncertain", what)),
            input_gain: d.parameter(
                vector("input_gain", 3, "factor of a torque's effect, where uncertain").starts(&[1.6, 0.7, 1.23]),
            ),
            coefficient: d.parameter(
                matrix("uncertainty_coefficient", 3, 2, coefficient)
                    .start(0.2)
                    .units(&["rad/s2", "rad/s2", "rad/s2", "1/s2", "1/s2", "1/s2"]),
            ),
            gain: d.parameter(
                vector("disturbance_gain", 3, "amplitude of the sine that enters the filter of a disturbance")
                    .units(&["rad/s3", "rad/s4", "rad/s4"])
                    .starts(&[0.2, 0.24, 0.15]),
            ),
            frequency: d.parameter(
                vector("disturbance_frequency", 3, "angular frequency of that sine")
                    .unit("rad/s")
                    .in_own_unit()
                    .starts(&[0.4, 0.6, 0.5]),
            ),
            filter: d.parameter(
                vector("disturbance_filter", 5, "")
                    .each(&filters)
                    .units(&["1/s", "1/s", "1/s2", "1/s", "1/s2"])
                    .starts(&[1.0, 2.0, 3.0, 3.0, 2.0]),
            ),
            disturbance0: d.parameter(vector("disturbance0", 5, "").each(&initial).units(&units).fixed()),
            disturbance: d.state(
                vector("disturbance", 5, "")
                    .each(&states)
                    .units(&units)
                    .nominal(0.1)
                    .source("Hashim, example 3.3.2, case 2"),
            ),
        }
    }

    /// The angles' accelerations f + G τ, or f + f_Δ + G_Δ G τ + d where uncertain.
    fn applied<S: Scalar>(&self, angles: [S; 3], [f, by_torques]: [[S; 3]; 2], v: &Values<S>) -> [S; 3] {
        let certain = || std::array::from_fn(|i| f[i] + by_torques[i]);
        let uncertain = || {
            let [phi, theta, psi] = angles;
            let terms = [
                [phi.cos() * theta.sin(), phi * psi],
                [phi.cos() * psi.sin(), phi * psi * psi],
                [theta.cos() * phi.sin(), phi * theta * psi],
            ];
            let [d1, d2, _, d3, _] = v.array(self.disturbance);
            let (gain, d) = (v.array::<_, 3>(self.input_gain), [d1, d2, d3]);
            std::array::from_fn(|i| {
                let [first, second] = [0, 1].map(|j| v[self.coefficient.at(i, j)] * terms[i][j]);
                f[i] + first + second + gain[i] * by_torques[i] + d[i]
            })
        };
        S::branch(v.get(self.uncertain), uncertain, certain)
    }

    /// The filters, those of second order in observer form: the output is the first state.
    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let [w1, w2, w3] = std::array::from_fn(|i| v[self.gain][i] * (v[self.frequency][i] * t).sin());
        let [a1, a2, b2, a3, b3] = v.array(self.filter);
        let [d1, d2, s2, d3, s3] = v.array(self.disturbance);
        dx.set(self.disturbance, [w1 - a1 * d1, s2 - a2 * d2, w2 - b2 * d2, s3 - a3 * d3, w3 - b3 * d3]);
    }
}

impl Catalogued for Quadrotor {
    const PAGE: Page = pages::QUADROTOR;
    const TRIAL: Trial = Trial {
        // It hovers by the thrust of its weight.
        steady: "'u[1]' = 4.905",
        ..Trial::NONE
    };
}
