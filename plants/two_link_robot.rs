//! Two-link robot arm in a vertical plane: examples 3.3.1 and 7.5.2, and chapter 5.

use crate::catalogue::Catalogued;
use crate::pages::{self, Page};
use crate::system::{
    BooleanOf, Declaration, Input, Invalid, NoStructure, Parameter, Point, Rates, Scalar, ScalarOf, Signal, Signals,
    State, System, Values, VectorOf, boolean, scalar, vector,
};

/// One link: its mass centre lies at half its length.
#[derive(Debug)]
struct Link {
    mass: ScalarOf<Parameter>,
    length: ScalarOf<Parameter>,
    inertia: ScalarOf<Parameter>,
    friction: ScalarOf<Parameter>,
}

/// M(q, t) q'' + C(q, q') q' + G(q) = u.
#[derive(Debug)]
pub struct TwoLinkRobot {
    x0: VectorOf<Parameter>,
    links: [Link; 2],
    g: ScalarOf<Parameter>,
    inertia_variation: BooleanOf<Parameter>,
    variation_amplitude: VectorOf<Parameter>,
    variation_frequency: VectorOf<Parameter>,
    rate_weight: ScalarOf<Parameter>,
    u: VectorOf<Input>,
    x: VectorOf<State>,
    y: VectorOf<Signal>,
    /// Determinant of M.
    determinant: ScalarOf<Signal>,
}

impl System for TwoLinkRobot {
    type Structure = NoStructure;
    const NAME: &'static str = "two-link-robot";
    const DOCUMENTATION: &'static str = pages::TWO_LINK_ROBOT.text;

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let state_units = ["rad", "rad", "rad/s", "rad/s"];
        let initial = ["initial angle q1", "initial angle q2", "initial rate of q1", "initial rate of q2"];
        let states = [
            "q1, angle of link 1 above the horizontal",
            "q2, angle of link 2 from the direction of link 1",
            "rate of q1",
            "rate of q2",
        ];
        Ok(TwoLinkRobot {
            x0: d.parameter(vector("x0", 4, "").each(&initial).units(&state_units).fixed()),
            links: [Link::declare(d, 1, [3.2, 0.5, 0.96, 1.0]), Link::declare(d, 2, [2.0, 0.4, 0.841, 1.0])],
            g: d.parameter(scalar("g", "acceleration of gravity").unit("m/s2").start(9.81)),
            inertia_variation: d.parameter(boolean("inertia_variation", "whether the inertia varies with time")),
            variation_amplitude: d.parameter(
                vector("inertia_variation_amplitude", 3, "")
                    .each(&[
                        "amplitude of d1, the variation of M11",
                        "amplitude of d2, the variation of M12",
                        "amplitude of d3, the variation of M22",
                    ])
                    .unit("kg.m2")
                    .starts(&[0.6, 0.7, 0.5]),
            ),
            variation_frequency: d.parameter(
                vector("inertia_variation_frequency", 3, "")
                    .each(&["angular frequency of d1", "angular frequency of d2", "angular frequency of d3"])
                    .unit("rad/s")
                    .in_own_unit()
                    .starts(&[0.3, 0.25, 0.35]),
            ),
            rate_weight: d.parameter(scalar("rate_weight", "weight of the rates in the output y").unit("s")),
            u: d.input(vector("u", 2, "").each(&["torque of joint 1", "torque of joint 2"]).unit("N.m")),
            x: d.state(vector("x", 4, "").each(&states).units(&state_units).output().source("Hashim, example 3.3.1")),
            y: d.output(
                vector("y", 2, "").each(&["output, q1 + rate_weight q1'", "output, q2 + rate_weight q2'"]).unit("rad"),
            ),
            determinant: d.local(
                scalar("det_M", "determinant of the inertia matrix; where it is not positive no motion follows")
                    .unit("kg2.m4"),
            ),
        })
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.copy(self.x0, self.x);
    }

    fn check<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        let det = v[self.determinant];
        v.refuse(!det.above(S::from(0.0)), |v| {
            let allowed = "must be above 0: the motion is undefined if the inertia matrix is singular or indefinite";
            Invalid::new(v.name(self.determinant), det.to_text(), allowed)
        });
    }

    fn outputs<S: Scalar>(&self, t: S, v: &Values<S>, y: &mut Signals<S>) {
        let ([q1, q2, w1, w2], weight) = (v.array(self.x), v[self.rate_weight]);
        y.set(self.y, [q1 + weight * w1, q2 + weight * w2]);
        y[self.determinant] = determinant(self.inertia(t, v));
    }

    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let [_, _, w1, w2] = v.array(self.x);
        let [u1, u2] = v.array(self.u);
        let [m11, m12, m22] = self.inertia(t, v);
        let [f1, f2] = self.friction_and_coriolis(v);
        let [g1, g2] = self.gravity(v);
        let (a1, a2) = (u1 - f1 - g1, u2 - f2 - g2);
        let det = v[self.determinant];
        // A value that isn't a number ends the step; `check` then reports why.
        let det = S::select(det.above(S::from(0.0)), det, S::from(f64::NAN));
        dx.set(self.x, [w1, w2, (m22 * a1 - m12 * a2) / det, (m11 * a2 - m12 * a1) / det]);
    }
}

impl TwoLinkRobot {
    /// M11, M12 = M21 and M22. The thesis prints m1 l1²/2 in M11: with the mass centre at l1/2, as its G has it, that
    /// is m1 l1²/4.
    fn inertia<S: Scalar>(&self, t: S, v: &Values<S>) -> [S; 3] {
        let [link1, link2] = &self.links;
        let (m1, l1, i1) = (v[link1.mass], v[link1.length], v[link1.inertia]);
        let (m2, l2, i2) = (v[link2.mass], v[link2.length], v[link2.inertia]);
        let c2 = v[self.x][1].cos();
        let m11 = i1 + i2 + m1 * l1 * l1 * 0.25 + m2 * (l1 * l1 + l2 * l2 * 0.25 + l1 * l2 * c2);
        let m12 = i2 + m2 * (l2 * l2 * 0.25 + l1 * l2 * c2 * 0.5);
        let m22 = i2 + m2 * l2 * l2 * 0.25;
        let wave = |k: usize| v[self.variation_amplitude][k] * (v[self.variation_frequency][k] * t).sin();
        let varying = || [m11 + wave(0), m12 + wave(1), m22 + wave(2).abs()];
        S::branch(v.get(self.inertia_variation), varying, || [m11, m12, m22])
    }

    /// C(q, q') q' with C = [−c q2' + k1, −c (q1' + q2'); c q1', k2]. The thesis prints +c q2' and sin q1 in c: the
    /// matrix M' − 2C is skew-symmetric, as energy demands, with this sign and with sin q2.
    fn friction_and_coriolis<S: Scalar>(&self, v: &Values<S>) -> [S; 2] {
        let [link1, link2] = &self.links;
        let [_, q2, w1, w2] = v.array(self.x);
        let c = v[link2.mass] * v[link1.length] * v[link2.length] * q2.sin() * 0.5;
        [-c * w2 * w1 - c * (w1 + w2) * w2 + v[link1.friction] * w1, c * w1 * w1 + v[link2.friction] * w2]
    }

    /// G(q).
    fn gravity<S: Scalar>(&self, v: &Values<S>) -> [S; 2] {
        let [link1, link2] = &self.links;
        let [q1, q2, ..] = v.array::<_, 4>(self.x);
        let (c1, c12, g) = (q1.cos(), (q1 + q2).cos(), v[self.g]);
        let second = v[link2.mass] * g * v[link2.length] * c12 * 0.5;
        [v[link1.mass] * g * v[link1.length] * c1 * 0.5 + v[link2.mass] * g * v[link1.length] * c1 + second, second]
    }
}

impl Link {
    fn declare(d: &mut Declaration, number: usize, [mass, length, inertia, friction]: [f64; 4]) -> Self {
        let parameter = |symbol: &str, text: &str, unit, start| {
            scalar(&format!("{symbol}{number}"), &format!("{text} {number}")).unit(unit).start(start)
        };
        Link {
            mass: d.parameter(parameter("m", "mass of link", "kg", mass).min(0.0)),
            length: d.parameter(parameter("l", "length of link", "m", length).positive()),
            inertia: d.parameter(
                parameter("I_z", "moment of inertia, about its mass centre, of link", "kg.m2", inertia).positive(),
            ),
            friction: d.parameter(parameter("k", "viscous friction of joint", "N.m.s/rad", friction).min(0.0)),
        }
    }
}

/// Determinant of a symmetric matrix, given by its elements 11, 12, 22.
fn determinant<S: Scalar>([m11, m12, m22]: [S; 3]) -> S {
    m11 * m22 - m12 * m12
}

impl Catalogued for TwoLinkRobot {
    const PAGE: Page = pages::TWO_LINK_ROBOT;
}
