//! Stiff systems with known solutions. They count how often their equations are evaluated in a thread.

use std::any::{Any, TypeId};
use std::cell::Cell;

use adaptive_fmu::system::*;

thread_local! {
    static EVALUATIONS: Cell<u64> = const { Cell::new(0) };
    static NO_NUMBERS: Cell<u64> = const { Cell::new(0) };
}

fn count<S: 'static>() {
    if TypeId::of::<S>() == TypeId::of::<f64>() {
        EVALUATIONS.set(EVALUATIONS.get() + 1);
    }
}

/// Evaluations since the last call.
pub fn evaluations() -> u64 {
    EVALUATIONS.take()
}

/// Van der Pol's oscillator: x' = y, y' = ((1 − x²) y − x) / epsilon.
pub struct VanDerPol {
    epsilon: ScalarOf<Parameter>,
    x: VectorOf<State>,
}

impl System for VanDerPol {
    type Structure = NoStructure;
    const NAME: &'static str = "van-der-pol";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(VanDerPol {
            epsilon: d.parameter(scalar("epsilon", "stiffness").start(1e-6)),
            x: d.state(vector("x", 2, "state").output()),
        })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.set(self.x, [2.0, 0.0].map(S::from));
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        count::<S>();
        let [x, y] = v.array(self.x);
        dx.set(self.x, [y, ((-x * x + 1.0) * y - x) / v[self.epsilon]]);
    }
}

/// Robertson's chemical reaction.
pub struct Robertson {
    y: VectorOf<State>,
}

impl System for Robertson {
    type Structure = NoStructure;
    const NAME: &'static str = "robertson";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Robertson { y: d.state(vector("y", 3, "concentrations").nominals(&[1.0, 1e-5, 1.0]).output()) })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.set(self.y, [1.0, 0.0, 0.0].map(S::from));
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let [y1, y2, y3] = v.array(self.y);
        let (slow, back, fast) = (y1 * 0.04, y2 * y3 * 1e4, y2 * y2 * 3e7);
        dx.set(self.y, [back - slow, slow - back - fast, fast]);
    }
}

/// x' = −stiffness (x − cos t) − sin t: all solutions converge to x = cos t (Prothero and Robinson). It starts at a
/// distance of `offset`, and records when it passes `level`.
pub struct Slope {
    stiffness: ScalarOf<Parameter>,
    offset: ScalarOf<Parameter>,
    level: ScalarOf<Parameter>,
    x: ScalarOf<State>,
    passed: ScalarOf<Discrete>,
}

impl System for Slope {
    type Structure = NoStructure;
    const NAME: &'static str = "slope";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators([""]);
        Ok(Slope {
            stiffness: d.parameter(scalar("stiffness", "rate of the fall").start(1e6)),
            offset: d.parameter(scalar("offset", "distance at the start")),
            level: d.parameter(scalar("level", "level whose passage is noted").start(-2.0)),
            x: d.state(scalar("x", "state").output()),
            passed: d.discrete(scalar("passed", "when the level was passed")),
        })
    }
    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        v[self.x] = t.cos() + v[self.offset];
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        count::<S>();
        dx[self.x] = -(v[self.x] - t.cos()) * v[self.stiffness] - t.sin();
    }
    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = v[self.x] - v[self.level];
    }
    fn event<S: Scalar>(&self, t: S, crossed: &[S::Flag], v: &mut Point<S>) {
        v.when(crossed[0], |v| v[self.passed] = t);
    }
}

/// x' = stiffness (r − x), where r = u + the number of events so far, one every 0.3 s.
pub struct Lag {
    stiffness: ScalarOf<Parameter>,
    u: ScalarOf<Input>,
    x: ScalarOf<State>,
    events: ScalarOf<Discrete>,
}

/// Time between the events of [`Lag`].
pub const INTERVAL: f64 = 0.3;

impl System for Lag {
    type Structure = NoStructure;
    const NAME: &'static str = "lag";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Lag {
            stiffness: d.parameter(scalar("stiffness", "rate").start(1e6)),
            u: d.input(scalar("u", "input")),
            x: d.state(scalar("x", "state").output()),
            events: d.discrete(scalar("events", "events so far")),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        count::<S>();
        dx[self.x] = (v[self.u] + v[self.events] - v[self.x]) * v[self.stiffness];
    }
    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        (v[self.events] + 1.0) * INTERVAL
    }
    fn event<S: Scalar>(&self, _t: S, _: &[S::Flag], v: &mut Point<S>) {
        v[self.events] += 1.0;
    }
}

/// x' = −stiffness (x − sin ωt) where the input makes it stiff, as a valve that is open for a while.
pub struct Valve {
    stiffness: ScalarOf<Input>,
    x: ScalarOf<State>,
}

impl System for Valve {
    type Structure = NoStructure;
    const NAME: &'static str = "valve";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Valve {
            stiffness: d.input(scalar("stiffness", "rate").start(1.0)),
            x: d.state(scalar("x", "state").output()),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        count::<S>();
        dx[self.x] = ((t * 10.0).sin() - v[self.x]) * v[self.stiffness];
    }
}

/// x₁' = x₁² x₂ cos t, x₂' = −x₁ x₂² cos t: x₁ = exp(sin t), x₂ = exp(−sin t).
pub struct Smooth {
    x: VectorOf<State>,
}

impl System for Smooth {
    type Structure = NoStructure;
    const NAME: &'static str = "smooth";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Smooth { x: d.state(vector("x", 2, "state")) })
    }
    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        v.set(self.x, [t.sin().exp(), (-t.sin()).exp()]);
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let [a, b] = v.array(self.x);
        dx.set(self.x, [a * a * b * t.cos(), -(a * b * b * t.cos())]);
    }
}

/// x' = rate x.
pub struct Growth {
    rate: ScalarOf<Parameter>,
    x: ScalarOf<State>,
}

impl System for Growth {
    type Structure = NoStructure;
    const NAME: &'static str = "growth";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Growth { rate: d.parameter(scalar("rate", "of growth").start(1.0)), x: d.state(scalar("x", "state")) })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.x] = S::from(1.0);
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.x] = v[self.x] * v[self.rate];
    }
}

/// level' = −√level: level = (√start − t/2)². Below zero its rate is no number.
pub struct Tank {
    start: ScalarOf<Parameter>,
    level: ScalarOf<State>,
}

impl System for Tank {
    type Structure = NoStructure;
    const NAME: &'static str = "tank";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Tank {
            start: d.parameter(scalar("start", "level at the start").start(1.0)),
            level: d.state(scalar("level", "state")),
        })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.level] = v[self.start];
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.level] = -v[self.level].sqrt();
    }
}

/// x' = −ln x from 10, which falls to 1. Below zero its rate is no number.
pub struct Cooling {
    x: ScalarOf<State>,
}

impl System for Cooling {
    type Structure = NoStructure;
    const NAME: &'static str = "cooling";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Cooling { x: d.state(scalar("x", "state")) })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.x] = S::from(10.0);
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.x] = -v[self.x].ln();
        let rate: &dyn Any = &dx[self.x];
        if rate.downcast_ref::<f64>().is_some_and(|rate| rate.is_nan()) {
            NO_NUMBERS.set(NO_NUMBERS.get() + 1);
        }
    }
}

/// Number of times that [`Cooling`] gave no number since the last call.
pub fn no_numbers() -> u64 {
    NO_NUMBERS.take()
}

/// Many independent relaxations: xᵢ' = stiffness (cos t − xᵢ).
pub struct Many {
    stiffness: ScalarOf<Parameter>,
    x: VectorOf<State>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Size {
    states: usize,
}

impl System for Many {
    type Structure = Size;
    const NAME: &'static str = "many";
    const DOCUMENTATION: &'static str = "";

    fn declare(size: Size, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Many {
            stiffness: d.parameter(scalar("stiffness", "rate").start(1e3)),
            x: d.state(vector("x", size.states, "state")),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        count::<S>();
        let rates = dx.slice(self.x).iter_mut().zip(&v[self.x]);
        rates.for_each(|(rate, &x)| *rate = (t.cos() - x) * v[self.stiffness]);
    }
}
