//! Small systems whose events are known exactly.

use adaptive_fmu::system::*;

/// Edges of the square wave a second.
const FREQUENCY: f64 = 0.46;

/// A square wave of half period 1/.46 s, as example 3.2.1 has it, and its integral.
pub struct SquareIntegral {
    edges: ScalarOf<Discrete>,
    q: ScalarOf<State>,
    r: ScalarOf<Signal>,
}

/// Time of an edge of that square wave.
pub fn edge(k: f64) -> f64 {
    k / FREQUENCY
}

impl System for SquareIntegral {
    type Structure = NoStructure;
    const NAME: &'static str = "square-integral";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(SquareIntegral {
            edges: d.discrete(scalar("edges", "edges that have passed")),
            q: d.state(scalar("q", "integral of r")),
            r: d.output(scalar("r", "square wave")),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        let pairs = v[self.edges] * 0.5;
        y[self.r] = S::select(pairs.floor().equals(pairs), S::from(1.0), S::from(-1.0));
    }
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.q] = v[self.r];
    }
    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        (v[self.edges] + 1.0) / FREQUENCY
    }
    fn event<S: Scalar>(&self, _t: S, _: &[S::Flag], v: &mut Point<S>) {
        v[self.edges] += 1.0;
    }
}

/// A ball that falls from 1 m with g = 10 m/s² and bounces back with `restitution` of its speed. Its height is set to
/// zero at the bounce.
pub struct Ball {
    restitution: ScalarOf<Parameter>,
    height: ScalarOf<State>,
    speed: ScalarOf<State>,
    bounces: ScalarOf<Discrete>,
    last: ScalarOf<Discrete>,
}

impl System for Ball {
    type Structure = NoStructure;
    const NAME: &'static str = "ball";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators([""]);
        Ok(Ball {
            restitution: d.parameter(scalar("restitution", "part of the speed after a bounce").start(0.8)),
            height: d.state(scalar("height", "height")),
            speed: d.state(scalar("speed", "upward speed")),
            bounces: d.discrete(scalar("bounces", "number of bounces")),
            last: d.discrete(scalar("last", "time of the last one")),
        })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.height] = S::from(1.0);
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.height] = v[self.speed];
        dx[self.speed] = S::from(-10.0);
    }
    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = v[self.height];
    }
    fn event<S: Scalar>(&self, t: S, _: &[S::Flag], v: &mut Point<S>) {
        v[self.height] = S::from(0.0);
        let restitution = v[self.restitution];
        v[self.speed] *= -restitution;
        v[self.bounces] += 1.0;
        v[self.last] = t;
    }
}

/// x' = ±1, turned round at +1 and at −1: switching times 1, 3, 5, …
pub struct Relay {
    x: ScalarOf<State>,
    direction: ScalarOf<Discrete>,
    last: ScalarOf<Discrete>,
    switches: ScalarOf<Discrete>,
}

impl System for Relay {
    type Structure = NoStructure;
    const NAME: &'static str = "relay";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators(["", ""]);
        Ok(Relay {
            x: d.state(scalar("x", "position")),
            direction: d.discrete(scalar("direction", "1 or -1")),
            last: d.discrete(scalar("last", "time of the last switch")),
            switches: d.discrete(scalar("switches", "number of switches")),
        })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.direction] = S::from(1.0);
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.x] = v[self.direction];
    }
    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = -v[self.x] + 1.0;
        z[1] = v[self.x] + 1.0;
    }
    fn event<S: Scalar>(&self, t: S, _: &[S::Flag], v: &mut Point<S>) {
        // Coming back inside is no turn.
        let turns = !(v[self.direction] * v[self.x]).below(S::from(0.5));
        v.when(turns, |v| {
            v[self.direction] = S::select(v[self.x].above(S::from(0.0)), S::from(-1.0), S::from(1.0));
            v[self.last] = t;
            v[self.switches] += 1.0;
        });
    }
}

/// A sliding relay, x' = −sgn x, that overshoots by a tenth of a picometre: from t = 0.5 on it switches without end.
pub struct Sliding {
    x: ScalarOf<State>,
    direction: ScalarOf<Discrete>,
}

impl System for Sliding {
    type Structure = NoStructure;
    const NAME: &'static str = "sliding";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators([""]);
        Ok(Sliding { x: d.state(scalar("x", "position")), direction: d.discrete(scalar("direction", "1 or -1")) })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.x] = S::from(0.5);
        v[self.direction] = S::from(-1.0);
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.x] = v[self.direction];
    }
    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = v[self.x];
    }
    fn event<S: Scalar>(&self, _t: S, _: &[S::Flag], v: &mut Point<S>) {
        v[self.x] = v[self.direction] * 1e-13;
        v[self.direction] = -v[self.direction];
    }
}

/// A nonlinear crossing: x' = x, the event where x = 6, at t = ln 6.
pub struct Growth {
    x: ScalarOf<State>,
    at: ScalarOf<Discrete>,
}

impl System for Growth {
    type Structure = NoStructure;
    const NAME: &'static str = "growth";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators([""]);
        Ok(Growth { x: d.state(scalar("x", "state")), at: d.discrete(scalar("at", "time of the event")) })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.x] = S::from(1.0);
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.x] = v[self.x];
    }
    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = -v[self.x] + 6.0;
    }
    fn event<S: Scalar>(&self, t: S, _: &[S::Flag], v: &mut Point<S>) {
        v[self.at] = t;
    }
}

/// A switch at u = threshold with a memory of its own: y integrates the side on which it was switched.
pub struct Switch {
    threshold: ScalarOf<Parameter>,
    u: ScalarOf<Input>,
    enabled: BooleanOf<Input>,
    side: ScalarOf<Discrete>,
    switched: IntegerOf<Discrete>,
    x: ScalarOf<State>,
    y: ScalarOf<Signal>,
}

impl System for Switch {
    type Structure = NoStructure;
    const NAME: &'static str = "switch";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators([""]);
        Ok(Switch {
            threshold: d.parameter(scalar("threshold", "where it switches").start(0.5)),
            u: d.input(scalar("u", "input")),
            enabled: d.input(boolean("enabled", "whether y grows").start(true)),
            side: d.discrete(scalar("side", "on which side it was switched").start(-1.0)),
            switched: d.discrete(integer("switched", "how often").start(7)),
            x: d.state(scalar("x", "integral of the side").start(2.0)),
            y: d.output(scalar("y", "x, where enabled; else -x")),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        y[self.y] = S::select(v.get(self.enabled), v[self.x], -v[self.x]);
    }
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.x] = v[self.side];
    }
    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = v[self.u] - v[self.threshold];
    }
    fn event<S: Scalar>(&self, _t: S, crossed: &[S::Flag], v: &mut Point<S>) {
        v.when(crossed[0], |v| {
            v[self.side] = -v[self.side];
            let switched = S::from_integer(v.get(self.switched)) + 1.0;
            v.put(self.switched, switched.to_integer());
        });
    }
}

/// A timer whose author compares the time with that of the event.
pub struct Timer {
    due: ScalarOf<Parameter>,
    fired: ScalarOf<Discrete>,
    y: ScalarOf<Signal>,
}

impl System for Timer {
    type Structure = NoStructure;
    const NAME: &'static str = "timer";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Timer {
            due: d.parameter(scalar("due", "when it fires").unit("s")),
            fired: d.discrete(scalar("fired", "1 once it fired")),
            y: d.output(scalar("y", "1 once it fired")),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        y[self.y] = v[self.fired];
    }
    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        S::select(v[self.fired].equals(S::from(0.0)), v[self.due], S::from(f64::INFINITY))
    }
    fn event<S: Scalar>(&self, t: S, _: &[S::Flag], v: &mut Point<S>) {
        v.when(t.at_least(v[self.due]), |v| v[self.fired] = S::from(1.0));
    }
}

/// The integral of the square wave: a triangle between 0 and half a period.
pub fn triangle(t: f64) -> f64 {
    let phase = t % edge(2.0);
    phase.min(edge(2.0) - phase)
}

/// Number and time of the last bounce until t, and the height at t.
pub fn exact_ball(t: f64, restitution: f64) -> (f64, f64, f64) {
    let mut speed = 20.0_f64.sqrt();
    let (mut last, mut bounces) = (speed / 10.0, 1.0);
    if t < last {
        return (0.0, 0.0, 1.0 - 5.0 * t * t);
    }
    speed *= restitution;
    while last + speed / 5.0 <= t {
        last += speed / 5.0;
        bounces += 1.0;
        speed *= restitution;
    }
    let flown = t - last;
    (bounces, last, speed * flown - 5.0 * flown * flown)
}

/// An event that is always due.
pub struct Stuck;

impl System for Stuck {
    type Structure = NoStructure;
    const NAME: &'static str = "stuck";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.state(scalar("x", "state"));
        Ok(Stuck)
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn next_time_event<S: Scalar>(&self, _v: &Values<S>) -> S {
        S::from(1.5)
    }
}

/// Counts completed steps and their lengths; y is 1 once their sum is above `full`.
pub struct Odometer {
    full: ScalarOf<Parameter>,
    steps: ScalarOf<Discrete>,
    last: ScalarOf<Discrete>,
    way: ScalarOf<Discrete>,
    y: ScalarOf<Signal>,
    step_taken: Warning,
}

impl System for Odometer {
    type Structure = NoStructure;
    const NAME: &'static str = "odometer";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Odometer {
            full: d.parameter(scalar("full", "way above which y is 1").start(100.0)),
            steps: d.discrete(scalar("steps", "number of steps")),
            last: d.discrete(scalar("last", "length of the last step")),
            way: d.discrete(scalar("way", "sum of all lengths")),
            y: d.output(scalar("y", "1 where the way is above full")),
            step_taken: d.warning("logWay", "the first step"),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        y[self.y] = S::from_flag(v[self.way].above(v[self.full]));
    }
    fn step_completed<S: Scalar>(&self, _t: S, step: S, v: &mut Point<S>) {
        v[self.steps] += 1.0;
        v[self.last] = step;
        v[self.way] += step;
        v.warn(self.step_taken, |_| "a step".to_owned());
    }
}

/// level' = −√level: no number below zero.
pub struct Root {
    level: ScalarOf<State>,
    rate: ScalarOf<Signal>,
}

impl System for Root {
    type Structure = NoStructure;
    const NAME: &'static str = "root";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Root {
            level: d.state(scalar("level", "level").start(1.0)),
            rate: d.local(scalar("rate", "rate of the level")),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        y[self.rate] = -v[self.level].sqrt();
    }
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.level] = v[self.rate];
    }
}
