//! Contacts as anyone writes them, without a mode for rest.

use adaptive_fmu::system::*;

/// Gravity, m/s².
pub const GRAVITY: f64 = 9.81;

/// Forms of the event of a ball on a floor.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(i32)]
pub enum Bounce {
    /// The speed is reversed whenever the height changes sides.
    Always,
    /// Reverses the speed if it points downward.
    Falling,
    /// Makes the speed point upward.
    Upward,
    /// Reverses the speed, and sets the height to that of the floor.
    Placed,
}

pub const BOUNCES: [Bounce; 4] = [Bounce::Always, Bounce::Falling, Bounce::Upward, Bounce::Placed];

/// A ball that falls from 1 m onto a floor at `floor` and bounces back with `restitution` of its speed. It never rests.
pub struct NaiveBall {
    restitution: ScalarOf<Parameter>,
    floor: ScalarOf<Parameter>,
    way: ScalarOf<Parameter>,
    height: ScalarOf<State>,
    speed: ScalarOf<State>,
    bounces: ScalarOf<Discrete>,
    last: ScalarOf<Discrete>,
}

impl System for NaiveBall {
    type Structure = NoStructure;
    const NAME: &'static str = "naive-ball";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators([""]);
        Ok(NaiveBall {
            restitution: d.parameter(scalar("restitution", "part of the speed after a bounce").start(0.7)),
            floor: d.parameter(scalar("floor", "height of the floor")),
            way: d.parameter(scalar("way", "how the event is written")),
            height: d.state(scalar("height", "height")),
            speed: d.state(scalar("speed", "upward speed")),
            bounces: d.discrete(scalar("bounces", "number of bounces")),
            last: d.discrete(scalar("last", "time of the last one")),
        })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.height] = v[self.floor] + 1.0;
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.height] = v[self.speed];
        dx[self.speed] = S::from(-GRAVITY);
    }
    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = v[self.height] - v[self.floor];
    }
    fn event<S: Scalar>(&self, t: S, crossed: &[S::Flag], v: &mut Point<S>) {
        let is = |way: Bounce| v[self.way].equals(S::from(f64::from(way as i32)));
        let [falling, upward, placed] = [Bounce::Falling, Bounce::Upward, Bounce::Placed].map(is);
        v.when(crossed[0] & !(falling & v[self.speed].at_least(S::from(0.0))), |v| {
            let speed = v[self.speed] * -v[self.restitution];
            v[self.speed] = S::select(upward, speed.abs(), speed);
            v[self.height] = S::select(placed, v[self.floor], v[self.height]);
            v[self.bounces] += 1.0;
            v[self.last] = t;
        });
    }
}

/// Number and time of the last bounce until t, and the height at t, of a ball that falls from 1 m.
pub fn exact_naive_ball(t: f64, restitution: f64) -> (f64, f64, f64) {
    let mut speed = (2.0 * GRAVITY).sqrt();
    let (mut last, mut bounces) = (speed / GRAVITY, 1.0);
    if t < last {
        return (0.0, 0.0, 1.0 - 0.5 * GRAVITY * t * t);
    }
    speed *= restitution;
    while last + 2.0 * speed / GRAVITY <= t {
        last += 2.0 * speed / GRAVITY;
        bounces += 1.0;
        speed *= restitution;
    }
    let flown = t - last;
    (bounces, last, speed * flown - 0.5 * GRAVITY * flown * flown)
}

/// Time at which the bounces of that ball have ended.
pub fn end_of_bounces(restitution: f64) -> f64 {
    (2.0 / GRAVITY).sqrt() * (1.0 + restitution) / (1.0 - restitution)
}

/// A cart of 1 kg that a force pushes to an end stop at 1 m.
pub struct Cart {
    force: ScalarOf<Parameter>,
    speed_0: ScalarOf<Parameter>,
    restitution: ScalarOf<Parameter>,
    position: ScalarOf<State>,
    speed: ScalarOf<State>,
    hits: ScalarOf<Discrete>,
}

impl System for Cart {
    type Structure = NoStructure;
    const NAME: &'static str = "cart";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators(["end stop"]);
        Ok(Cart {
            force: d.parameter(scalar("force", "force").start(1.0)),
            speed_0: d.parameter(scalar("speed_0", "initial speed")),
            restitution: d.parameter(scalar("restitution", "part of the speed after a hit")),
            position: d.state(scalar("position", "position")),
            speed: d.state(scalar("speed", "speed")),
            hits: d.discrete(scalar("hits", "number of hits")),
        })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.speed] = v[self.speed_0];
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.position] = v[self.speed];
        dx[self.speed] = v[self.force] - v[self.speed] * 0.1;
    }
    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = -v[self.position] + 1.0;
    }
    fn event<S: Scalar>(&self, _t: S, crossed: &[S::Flag], v: &mut Point<S>) {
        v.when(crossed[0] & v[self.speed].above(S::from(0.0)), |v| {
            let restitution = v[self.restitution];
            v[self.speed] *= -restitution;
            v[self.hits] += 1.0;
        });
    }
}

/// A body that goes along x at speed 1 and meets a level at x = 1: it keeps a part of its speed, and takes up a mass.
pub struct Level {
    kept: ScalarOf<Parameter>,
    taken_up: ScalarOf<Parameter>,
    x: ScalarOf<State>,
    speed: ScalarOf<State>,
    mass: ScalarOf<State>,
    passed: ScalarOf<Discrete>,
}

impl System for Level {
    type Structure = NoStructure;
    const NAME: &'static str = "level";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators([""]);
        Ok(Level {
            kept: d.parameter(scalar("kept", "part of the speed that is kept").start(1.0)),
            taken_up: d.parameter(scalar("taken_up", "mass that is taken up")),
            x: d.state(scalar("x", "position")),
            speed: d.state(scalar("speed", "speed").start(1.0)),
            mass: d.state(scalar("mass", "mass").start(1.0)),
            passed: d.discrete(scalar("passed", "how often the level was passed")),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.x] = v[self.speed];
        dx[self.speed] = S::from(0.0);
        dx[self.mass] = S::from(0.0);
    }
    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = v[self.x] - 1.0;
    }
    fn event<S: Scalar>(&self, _t: S, crossed: &[S::Flag], v: &mut Point<S>) {
        v.when(crossed[0], |v| {
            let (kept, taken_up) = (v[self.kept], v[self.taken_up]);
            v[self.speed] *= kept;
            v[self.mass] += taken_up;
            v[self.passed] += 1.0;
        });
    }
}

/// A body that is thrown upward, and when it was above 1 m.
pub struct Thrown {
    speed_0: ScalarOf<Parameter>,
    height: ScalarOf<State>,
    speed: ScalarOf<State>,
    above_at: ScalarOf<Discrete>,
    below_at: ScalarOf<Discrete>,
}

impl System for Thrown {
    type Structure = NoStructure;
    const NAME: &'static str = "thrown";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators([""]);
        Ok(Thrown {
            speed_0: d.parameter(scalar("speed_0", "speed with which it is thrown")),
            height: d.state(scalar("height", "height")),
            speed: d.state(scalar("speed", "upward speed")),
            above_at: d.discrete(scalar("above_at", "when it came above 1 m")),
            below_at: d.discrete(scalar("below_at", "when it came below 1 m")),
        })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.speed] = v[self.speed_0];
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.height] = v[self.speed];
        dx[self.speed] = S::from(-GRAVITY);
    }
    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = v[self.height] - 1.0;
    }
    fn event<S: Scalar>(&self, t: S, crossed: &[S::Flag], v: &mut Point<S>) {
        let rises = v[self.speed].above(S::from(0.0));
        v.when(crossed[0] & rises, |v| v[self.above_at] = t);
        v.when(crossed[0] & !rises, |v| v[self.below_at] = t);
    }
}

/// A clock, and how far x = t was from the times of its ticks.
pub struct Metronome {
    period: ScalarOf<Parameter>,
    x: ScalarOf<State>,
    began: ScalarOf<Discrete>,
    ticks: ScalarOf<Discrete>,
    off: ScalarOf<Discrete>,
}

impl System for Metronome {
    type Structure = NoStructure;
    const NAME: &'static str = "metronome";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Metronome {
            period: d.parameter(scalar("period", "time between ticks").start(1e-3)),
            x: d.state(scalar("x", "time")),
            began: d.discrete(scalar("began", "start")),
            ticks: d.discrete(scalar("ticks", "number of ticks")),
            off: d.discrete(scalar("off", "largest distance of x from the time of a tick")),
        })
    }
    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        v[self.x] = t;
        v[self.began] = t;
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, _v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.x] = S::from(1.0);
    }
    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        v[self.began] + (v[self.ticks] + 1.0) * v[self.period]
    }
    fn event<S: Scalar>(&self, _t: S, _: &[S::Flag], v: &mut Point<S>) {
        let due = v[self.began] + (v[self.ticks] + 1.0) * v[self.period];
        v[self.off] = larger(v[self.off], (v[self.x] - due).abs());
        v[self.ticks] += 1.0;
    }
}
