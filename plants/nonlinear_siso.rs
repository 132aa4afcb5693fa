//! Uncertain nonlinear SISO system of example 3.2.1.

use crate::catalogue::Catalogued;
use crate::pages::{self, Page};
use crate::system::{
    Declaration, Input, Invalid, NoStructure, Parameter, Point, Rates, Scalar, ScalarOf, Signals, State, System,
    Values, VectorOf, scalar, vector,
};

/// The plant of example 3.2.1; its whole right-hand side but A_m x is unknown to the controller.
#[derive(Debug)]
pub struct NonlinearSiso {
    x0: VectorOf<Parameter>,
    a1: ScalarOf<Parameter>,
    a2: ScalarOf<Parameter>,
    omega: ScalarOf<Parameter>,
    omega_variation: ScalarOf<Parameter>,
    u: VectorOf<Input>,
    x: VectorOf<State>,
    y: VectorOf<crate::system::Signal>,
}

impl System for NonlinearSiso {
    type Structure = NoStructure;
    const NAME: &'static str = "nonlinear-siso";
    const DOCUMENTATION: &'static str = pages::NONLINEAR_SISO.text;

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(NonlinearSiso {
            x0: d.parameter(vector("x0", 2, "initial state").each(&["initial x1", "initial x2"]).fixed()),
            a1: d.parameter(scalar("a1", "restoring coefficient of the desired dynamics").unit("1/s2").start(1.0)),
            a2: d.parameter(scalar("a2", "damping coefficient of the desired dynamics").unit("1/s").start(1.4)),
            omega: d.parameter(scalar("omega", "mean input gain").start(2.0)),
            omega_variation: d.parameter(scalar("omega_variation", "amplitude of the input gain's sine").start(0.2)),
            u: d.input(vector("u", 1, "control")),
            x: d.state(
                vector("x", 2, "")
                    .each(&["x1, the controlled output", "x2, its rate"])
                    .units(&["1", "1/s"])
                    .output()
                    .source("Hashim, example 3.2.1"),
            ),
            y: d.output(vector("y", 1, "tracked output, x1")),
        })
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.copy(self.x0, self.x);
    }

    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        y.set(self.y, [v[self.x][0]]);
    }

    /// x1' = x2, x2' = −a1 x1 − a2 x2 + f(x, u, t). The thesis prints ωu in addition to f, which contains the input
    /// gain itself: with both, the estimates stay at their bounds.
    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let [x1, x2] = v.array(self.x);
        let [u] = v.array(self.u);
        let (a1, a2) = (v[self.a1], v[self.a2]);
        let omega = v[self.omega] + v[self.omega_variation] * t.sin();
        let f = a1 * x1 + a2 * x2 + omega * u + u.sin() * x1.sin() + x1 * x1 + x2 * x2 + (t * 0.5).sin();
        dx.set(self.x, [x2, -a1 * x1 - a2 * x2 + f]);
    }
}

impl Catalogued for NonlinearSiso {
    const PAGE: Page = pages::NONLINEAR_SISO;
}
