//! Models of one's own as FMUs. This file holds the smallest one; `rooms` shows what a larger one takes, `ball` a contact.

mod ball;
mod rooms;

use adaptive_fmu::system::*;
use ball::Ball;
use rooms::Rooms;

/// Van der Pol oscillator x1' = x2, x2' = μ (1 − x1²) x2 − x1.
pub struct VanDerPol {
    mu: ScalarOf<Parameter>,
    x0: VectorOf<Parameter>,
    x: VectorOf<State>,
}

impl System for VanDerPol {
    type Structure = NoStructure;
    const NAME: &'static str = "van-der-pol";
    const DOCUMENTATION: &'static str =
        r"Van der Pol oscillator $\dot x_1 = x_2$, $\dot x_2 = \mu (1 - x_1^2) x_2 - x_1$.";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(VanDerPol {
            mu: d.parameter(scalar("mu", "damping").start(1.0)),
            x0: d.parameter(vector("x0", 2, "initial state").starts(&[2.0, 0.0]).fixed()),
            x: d.state(vector("x", 2, "state").output()),
        })
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.copy(self.x0, self.x);
    }

    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let [x1, x2] = v.array(self.x);
        dx.set(self.x, [x2, v[self.mu] * (-x1 * x1 + 1.0) * x2 - x1]);
    }
}

adaptive_fmu::export_fmi2![VanDerPol, Rooms, Ball];
