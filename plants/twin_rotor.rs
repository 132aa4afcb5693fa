//! Twin rotor (TRMS) with strong coupling: example 3.4.2.

use crate::catalogue::Catalogued;
use crate::pages::{self, Page};
use crate::system::{
    Declaration, Input, Invalid, NoStructure, Parameter, Point, Rates, Scalar, ScalarOf, Signal, Signals, State,
    System, Values, VectorOf, scalar, vector,
};

/// I1 ψ'' and I2 φ'' from the torques of the main and of the tail rotor.
#[derive(Debug)]
pub struct TwinRotor {
    x0: VectorOf<Parameter>,
    pitch: Axis,
    yaw: Axis,
    friction_width: ScalarOf<Parameter>,
    m_g: ScalarOf<Parameter>,
    centrifugal: ScalarOf<Parameter>,
    k_gy: ScalarOf<Parameter>,
    u: VectorOf<Input>,
    x: VectorOf<State>,
    reaction: Reaction,
    y: VectorOf<Signal>,
    /// Torques of the main and of the tail rotor.
    m: VectorOf<Signal>,
}

/// An axis with its rotor: τ' = (−T_0 τ + k u)/T_1, torque a τ² + b τ, viscous and Coulomb friction B1, B2.
#[derive(Debug)]
struct Axis {
    inertia: ScalarOf<Parameter>,
    a: ScalarOf<Parameter>,
    b: ScalarOf<Parameter>,
    viscous: ScalarOf<Parameter>,
    coulomb: ScalarOf<Parameter>,
    k: ScalarOf<Parameter>,
    t_0: ScalarOf<Parameter>,
    t_1: ScalarOf<Parameter>,
}

/// M_R = k_c (T_0 s + 1)/(T_p s + 1) m1, whose state is m1 lagged by T_p.
#[derive(Debug)]
struct Reaction {
    lag0: ScalarOf<Parameter>,
    k_c: ScalarOf<Parameter>,
    t_0: ScalarOf<Parameter>,
    t_p: ScalarOf<Parameter>,
    lag: ScalarOf<State>,
    torque: ScalarOf<Signal>,
}

impl System for TwinRotor {
    type Structure = NoStructure;
    const NAME: &'static str = "twin-rotor";
    const DOCUMENTATION: &'static str = pages::TWIN_ROTOR.text;

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let units = ["rad", "rad/s", "rad", "rad/s", "V", "V"];
        let states = [
            "psi, pitch angle",
            "rate of psi",
            "phi, yaw angle",
            "rate of phi",
            "tau1, command of the main rotor after its lag",
            "tau2, command of the tail rotor after its lag",
        ];
        let initial = states.map(|text| format!("initial {text}"));
        Ok(TwinRotor {
            x0: d.parameter(vector("x0", 6, "").each(&initial.each_ref().map(String::as_str)).units(&units).fixed()),
            pitch: Axis::declare(d, 1, "psi", "main", [0.068, 0.0135, 0.0924, 0.006, 0.001, 1.1, 1.0, 1.1]),
            yaw: Axis::declare(d, 2, "phi", "tail", [0.02, 0.02, 0.09, 0.1, 0.01, 0.8, 1.0, 1.0]),
            friction_width: d.parameter(
                scalar("friction_width", "rate over which the sign of Coulomb friction is smoothed: tanh(rate/width)")
                    .unit("rad/s")
                    .start(0.01)
                    .positive(),
            ),
            m_g: d.parameter(scalar("M_g", "largest torque of gravity, at psi = pi/2").unit("N.m").start(0.32)),
            centrifugal: d.parameter(
                scalar("centrifugal_coefficient", "coefficient of the centrifugal torque sin(2 psi) phi'^2")
                    .unit("N.m.s2/rad2")
                    .start(0.0163),
            ),
            k_gy: d.parameter(scalar("K_gy", "coefficient of the gyroscopic torque").unit("s/rad").start(0.05)),
            u: d.input(vector("u", 2, "").each(&["voltage of the main rotor", "voltage of the tail rotor"]).unit("V")),
            x: d.state(vector("x", 6, "").each(&states).units(&units).output().source("Hashim, example 3.4.2")),
            reaction: Reaction::declare(d),
            y: d.output(vector("y", 2, "").each(&["tracked output, psi", "tracked output, phi"]).unit("rad")),
            m: d.local(
                vector("m", 2, "")
                    .each(&["torque of the main rotor", "torque of the tail rotor"])
                    .unit("N.m")
                    .nominal(0.1),
            ),
        })
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.copy(self.x0, self.x);
        v.copy(self.reaction.lag0, self.reaction.lag);
    }

    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        let [psi, _, phi, _, tau1, tau2] = v.array(self.x);
        y.set(self.y, [psi, phi]);
        let m1 = self.pitch.torque(tau1, v);
        y.set(self.m, [m1, self.yaw.torque(tau2, v)]);
        y[self.reaction.torque] = self.reaction.torque(m1, v);
    }

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let [psi, psi_rate, _, phi_rate, tau1, tau2] = v.array(self.x);
        let ([m1, m2], [u1, u2]) = (v.array(self.m), v.array(self.u));
        let width = v[self.friction_width];
        let gravity = v[self.m_g] * psi.sin();
        let centrifugal = v[self.centrifugal] * (psi * 2.0).sin() * phi_rate * phi_rate;
        let gyroscopic = v[self.k_gy] * psi.cos() * phi_rate * m1;
        let pitch = m1 - gravity + centrifugal - self.pitch.friction(psi_rate, width, v) - gyroscopic;
        let yaw = m2 - self.yaw.friction(phi_rate, width, v) - v[self.reaction.torque];
        dx.set(
            self.x,
            [
                psi_rate,
                pitch / v[self.pitch.inertia],
                phi_rate,
                yaw / v[self.yaw.inertia],
                self.pitch.rotor(tau1, u1, v),
                self.yaw.rotor(tau2, u2, v),
            ],
        );
        dx[self.reaction.lag] = (m1 - v[self.reaction.lag]) / v[self.reaction.t_p];
    }
}

impl Axis {
    /// Values in the order of the fields.
    fn declare(d: &mut Declaration, number: usize, angle: &str, rotor: &str, values: [f64; 8]) -> Self {
        let [inertia, a, b, viscous, coulomb, k, t_0, t_1] = values;
        let parameter = |symbol: String, text: String, unit, start| scalar(&symbol, &text).unit(unit).start(start);
        let axis = |text: &str| format!("{text} about the axis of {angle}");
        let of_rotor = |text: &str| format!("{text} of the {rotor} rotor");
        let n = number;
        Axis {
            inertia: d.parameter(parameter(format!("I{n}"), axis("moment of inertia"), "kg.m2", inertia).positive()),
            a: d.parameter(parameter(format!("a{n}"), of_rotor("quadratic coefficient of the torque"), "N.m/V2", a)),
            b: d.parameter(parameter(format!("b{n}"), of_rotor("linear coefficient of the torque"), "N.m/V", b)),
            viscous: d
                .parameter(parameter(format!("B1_{angle}"), axis("viscous friction"), "N.m.s/rad", viscous).min(0.0)),
            coulomb: d.parameter(parameter(format!("B2_{angle}"), axis("Coulomb friction"), "N.m", coulomb).min(0.0)),
            k: d.parameter(parameter(format!("k{n}"), of_rotor("gain of the motor"), "1", k)),
            t_0: d.parameter(parameter(format!("T{n}0"), of_rotor("constant term of the denominator"), "1", t_0)),
            t_1: d.parameter(parameter(format!("T{n}1"), of_rotor("time constant"), "s", t_1).positive()),
        }
    }

    fn torque<S: Scalar>(&self, tau: S, v: &Values<S>) -> S {
        (v[self.a] * tau + v[self.b]) * tau
    }

    /// A sign that jumps at rest would be an event at every turn: tanh is as steep as one likes.
    fn friction<S: Scalar>(&self, rate: S, width: S, v: &Values<S>) -> S {
        v[self.viscous] * rate + v[self.coulomb] * (rate / width).tanh()
    }

    /// The rate of τ.
    fn rotor<S: Scalar>(&self, tau: S, u: S, v: &Values<S>) -> S {
        (-v[self.t_0] * tau + v[self.k] * u) / v[self.t_1]
    }
}

impl Reaction {
    fn declare(d: &mut Declaration) -> Self {
        let mut parameter =
            |name: &str, text: &str, unit, start| d.parameter(scalar(name, text).unit(unit).start(start));
        let k_c = parameter("k_c", "gain of the main rotor's reaction about the axis of phi", "1", -0.2);
        let t_0 = parameter("T_0", "lead time constant of the main rotor's reaction", "s", 3.5);
        let torque = |name: &str, text: &str| scalar(name, text).unit("N.m").nominal(0.1);
        Reaction {
            lag0: d.parameter(torque("m1_lag0", "initial lagged torque of the main rotor").fixed()),
            k_c,
            t_0,
            t_p: d.parameter(
                scalar("T_p", "lag time constant of the main rotor's reaction").unit("s").start(2.0).positive(),
            ),
            lag: d.state(torque("m1_lag", "torque of the main rotor, lagged by T_p").source("Hashim, example 3.4.2")),
            torque: d.local(torque("M_R", "reaction of the main rotor about the axis of phi")),
        }
    }

    fn torque<S: Scalar>(&self, m1: S, v: &Values<S>) -> S {
        let lead = v[self.t_0] / v[self.t_p];
        v[self.k_c] * (lead * m1 + (-lead + 1.0) * v[self.lag])
    }
}

impl Catalogued for TwinRotor {
    const PAGE: Page = pages::TWIN_ROTOR;
}
