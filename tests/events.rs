//! Events: landed on at their exact times, wherever communication points lie.

mod common;

use adaptive_fmu::system::*;
use common::models::Run;
use common::{OK, Unit};

/// A square wave of half period 1/.46 s, as example 3.2.1 has it, and its integral.
struct SquareIntegral {
    edges: ScalarOf<Discrete>,
    q: ScalarOf<State>,
    r: ScalarOf<Signal>,
}

fn edge(k: f64) -> f64 {
    k / 0.46
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
        y[self.r] = S::from(if v[self.edges].re() % 2.0 == 0.0 { 1.0 } else { -1.0 });
    }
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.q] = v[self.r];
    }
    fn next_time_event(&self, v: &Values<f64>) -> Option<f64> {
        Some(edge(v[self.edges] + 1.0))
    }
    fn event(&self, _t: f64, _: &[bool], v: &mut Point) {
        v[self.edges] += 1.0;
    }
}

/// The integral of the square wave: a triangle between 0 and half a period.
fn triangle(t: f64) -> f64 {
    let phase = t % edge(2.0);
    phase.min(edge(2.0) - phase)
}

#[test]
fn the_integral_of_a_square_wave_is_exact_whatever_the_communication_step() {
    for (step, steps) in [(10.0, 6), (1.0, 60), (0.37e-3, 20_000), (50.0, 1), (edge(1.0), 20), (0.1, 600)] {
        let mut run = Run::of::<SquareIntegral>("", 0.0);
        for _ in 0..steps {
            run.step(step);
            let t = run.0.time();
            assert!((run.get("q") - triangle(t)).abs() < 1e-9, "step {step}, t = {t}: {}", run.get("q"));
        }
    }
}

#[test]
fn the_square_reference_is_right_on_both_sides_of_its_edges() {
    for (step, steps) in [(10.0, 6), (1.0, 60), (0.37e-3, 20_000)] {
        let unit = square();
        for k in 1..=steps {
            unit.run(f64::from(k - 1) * step, 1, step);
            let t = f64::from(k) * step;
            // Edge 23 lies at 50 s, where steps of 10 s and 1 s meet it.
            let passed = (t * 0.46 + 1e-9).floor();
            assert_eq!(unit.get("r[1]"), if passed % 2.0 == 0.0 { 1.0 } else { -1.0 }, "step {step}, t = {t}");
        }
    }
}

fn square() -> Unit {
    let unit = Unit::new("ReferenceNonlinearSiso");
    assert_eq!(unit.set_integer("signal", 2), OK);
    unit.start(0.0);
    unit
}

#[test]
fn an_edge_at_a_communication_point_is_taken_there_in_spite_of_accumulated_rounding() {
    // Every seventh communication point is an edge, up to the rounding of a master that adds up its times, and of
    // one that multiplies.
    let step = edge(1.0) / 7.0;
    let (adding, multiplying) = (square(), square());
    let mut t = 0.0;
    for k in 1..=7 * 200 {
        assert_eq!(adding.step(t, step), OK);
        t += step;
        assert_eq!(multiplying.step(f64::from(k - 1) * step, step), OK);
        let expected = if (k / 7) % 2 == 0 { 1.0 } else { -1.0 };
        assert_eq!([adding.get("r[1]"), multiplying.get("r[1]")], [expected; 2], "step {k}");
    }
}

/// A ball that falls from 1 m with g = 10 m/s² and bounces back with `restitution` of its speed. Its height is set to
/// zero at the bounce.
struct Ball {
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

    fn indicators(&self) -> usize {
        1
    }
    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Ball {
            restitution: d.parameter(scalar("restitution", "part of the speed after a bounce").start(0.8)),
            height: d.state(scalar("height", "height")),
            speed: d.state(scalar("speed", "upward speed")),
            bounces: d.discrete(scalar("bounces", "number of bounces")),
            last: d.discrete(scalar("last", "time of the last one")),
        })
    }
    fn initialise(&self, _t: f64, v: &mut Point) -> Result<(), Invalid> {
        v[self.height] = 1.0;
        Ok(())
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.height] = v[self.speed];
        dx[self.speed] = S::from(-10.0);
    }
    fn event_indicators(&self, _t: f64, v: &Values<f64>, z: &mut [f64]) {
        z[0] = v[self.height];
    }
    fn event(&self, t: f64, _: &[bool], v: &mut Point) {
        v[self.height] = 0.0;
        let restitution = v[self.restitution];
        v[self.speed] *= -restitution;
        v[self.bounces] += 1.0;
        v[self.last] = t;
    }
}

/// Number and time of the last bounce until t, and the height at t.
fn exact_ball(t: f64, restitution: f64) -> (f64, f64, f64) {
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

#[test]
fn a_bouncing_ball_bounces_at_its_exact_times() {
    // From short steps to one that holds four bounces.
    for (step, steps) in [(0.01, 250), (0.25, 10), (2.5, 1)] {
        let mut run = Run::of::<Ball>("", 0.0);
        for _ in 0..steps {
            run.step(step);
            let t = run.0.time();
            let (bounces, last, height) = exact_ball(t, 0.8);
            assert_eq!(run.get("bounces"), bounces, "step {step}, t = {t}");
            assert!((run.get("last") - last).abs() < 1e-8, "step {step}: bounce at {last}, not {}", run.get("last"));
            assert!((run.get("height") - height).abs() < 1e-7, "step {step}, t = {t}: height {height}");
        }
    }
}

#[test]
fn a_ball_whose_bounces_never_end_ends_in_an_error() {
    // With half the speed each time, infinitely many bounces are over at t = .447 (1 + 2) = 1.34 s.
    let mut run = Run::of::<Ball>("restitution = 0.5", 0.0);
    run.run(13, 0.1);
    let error = (0..20).find_map(|_| run.0.step(run.0.time(), 0.1).err());
    let message = error.expect("the ball must not fall through the floor").to_string();
    assert!(message.contains("t = 1.34"), "{message}");
}

/// x' = ±1, turned round at +1 and at −1: switching times 1, 3, 5, …
struct Relay {
    x: ScalarOf<State>,
    direction: ScalarOf<Discrete>,
    last: ScalarOf<Discrete>,
    switches: ScalarOf<Discrete>,
}

impl System for Relay {
    type Structure = NoStructure;
    const NAME: &'static str = "relay";
    const DOCUMENTATION: &'static str = "";

    fn indicators(&self) -> usize {
        2
    }
    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Relay {
            x: d.state(scalar("x", "position")),
            direction: d.discrete(scalar("direction", "1 or -1")),
            last: d.discrete(scalar("last", "time of the last switch")),
            switches: d.discrete(scalar("switches", "number of switches")),
        })
    }
    fn initialise(&self, _t: f64, v: &mut Point) -> Result<(), Invalid> {
        v[self.direction] = 1.0;
        Ok(())
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.x] = v[self.direction];
    }
    fn event_indicators(&self, _t: f64, v: &Values<f64>, z: &mut [f64]) {
        z[0] = 1.0 - v[self.x];
        z[1] = v[self.x] + 1.0;
    }
    fn event(&self, t: f64, _: &[bool], v: &mut Point) {
        // Coming back inside is no turn.
        if v[self.direction] * v[self.x] < 0.5 {
            return;
        }
        v[self.direction] = if v[self.x] > 0.0 { -1.0 } else { 1.0 };
        v[self.last] = t;
        v[self.switches] += 1.0;
    }
}

#[test]
fn a_relay_switches_at_its_exact_times() {
    for (step, steps) in [(20.0, 1), (0.3, 66), (1.0, 20), (0.013, 1500)] {
        let mut run = Run::of::<Relay>("", 0.0);
        for _ in 0..steps {
            run.step(step);
            let t = run.0.time();
            let switches = run.get("switches");
            let exact = 2.0 * switches - 1.0;
            assert!(switches == 0.0 || (run.get("last") - exact).abs() < 1e-8, "step {step}: {}", run.get("last"));
            // At a communication point that is a switching time either side is right.
            let near = ((t + 1.0) / 2.0 - ((t + 1.0) / 2.0).round()).abs() < 1e-6;
            assert!(near || switches == ((t + 1.0) / 2.0).floor(), "step {step}, t = {t}: {switches} switches");
            assert!(run.get("x").abs() <= 1.0 + 1e-8);
        }
    }
}

/// A sliding relay, x' = −sgn x, that overshoots by a tenth of a picometre: from t = 0.5 on it switches without end.
struct Sliding {
    x: ScalarOf<State>,
    direction: ScalarOf<Discrete>,
}

impl System for Sliding {
    type Structure = NoStructure;
    const NAME: &'static str = "sliding";
    const DOCUMENTATION: &'static str = "";

    fn indicators(&self) -> usize {
        1
    }
    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Sliding { x: d.state(scalar("x", "position")), direction: d.discrete(scalar("direction", "1 or -1")) })
    }
    fn initialise(&self, _t: f64, v: &mut Point) -> Result<(), Invalid> {
        v[self.x] = 0.5;
        v[self.direction] = -1.0;
        Ok(())
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.x] = v[self.direction];
    }
    fn event_indicators(&self, _t: f64, v: &Values<f64>, z: &mut [f64]) {
        z[0] = v[self.x];
    }
    fn event(&self, _t: f64, _: &[bool], v: &mut Point) {
        v[self.x] = 1e-13 * v[self.direction];
        v[self.direction] = -v[self.direction];
    }
}

#[test]
fn endless_switching_ends_in_an_error_and_not_in_a_hang() {
    let mut run = Run::of::<Sliding>("", 0.0);
    run.step(0.25);
    let before = run.0.block.clone();
    let message = run.failure(1.0).to_string();
    assert!(message.contains("t = 0.5"), "{message}");
    assert_eq!(run.0.block, before, "as before the step");
}

/// An event that is always due.
struct Stuck;

impl System for Stuck {
    type Structure = NoStructure;
    const NAME: &'static str = "stuck";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.state(scalar("x", "state"));
        Ok(Stuck)
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn next_time_event(&self, _v: &Values<f64>) -> Option<f64> {
        Some(1.5)
    }
}

#[test]
fn a_time_event_that_stays_due_ends_in_an_error_and_not_in_a_hang() {
    let mut run = Run::of::<Stuck>("", 0.0);
    run.step(1.0);
    let message = run.failure(1.0).to_string();
    assert!(message.contains("t = 1.5"), "{message}");
    assert_eq!(run.0.time(), 1.0, "time as before the step");
}

/// A nonlinear crossing: x' = x, the event where x = 6, at t = ln 6.
struct Growth {
    x: ScalarOf<State>,
    at: ScalarOf<Discrete>,
}

impl System for Growth {
    type Structure = NoStructure;
    const NAME: &'static str = "growth";
    const DOCUMENTATION: &'static str = "";

    fn indicators(&self) -> usize {
        1
    }
    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Growth { x: d.state(scalar("x", "state")), at: d.discrete(scalar("at", "time of the event")) })
    }
    fn initialise(&self, _t: f64, v: &mut Point) -> Result<(), Invalid> {
        v[self.x] = 1.0;
        Ok(())
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.x] = v[self.x];
    }
    fn event_indicators(&self, _t: f64, v: &Values<f64>, z: &mut [f64]) {
        z[0] = 6.0 - v[self.x];
    }
    fn event(&self, t: f64, _: &[bool], v: &mut Point) {
        v[self.at] = t;
    }
}

#[test]
fn a_nonlinear_crossing_is_located_as_exactly_as_the_solution_itself() {
    for step in [2.0, 0.5, 0.01] {
        let mut run = Run::of::<Growth>("relative_tolerance = 1e-10", 0.0);
        run.run((2.0 / step) as usize, step);
        assert!((run.get("at") - 6.0_f64.ln()).abs() < 1e-8, "step {step}: {}", run.get("at"));
    }
}
