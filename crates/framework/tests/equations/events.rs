//! Events: landed on at their exact times, wherever communication points lie.

use adaptive_fmu::error::Invalid;
use adaptive_fmu::system::*;
use common::models::Run;
use common::systems::*;
use common::{OK, Unit};

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
    // With half the speed each time, infinitely many bounces are over at t = 0.447 (1 + 2) = 1.34 s.
    let mut run = Run::of::<Ball>("restitution = 0.5", 0.0);
    run.run(13, 0.1);
    let error = (0..20).find_map(|_| run.0.step(run.0.time(), 0.1).err());
    let message = error.expect("the ball must not fall through the floor").to_string();
    assert!(message.contains("t = 1.34"), "{message}");
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

#[test]
fn endless_switching_ends_in_an_error_and_not_in_a_hang() {
    let mut run = Run::of::<Sliding>("", 0.0);
    run.step(0.25);
    let before = run.0.block().clone();
    let message = run.failure(1.0).to_string();
    assert!(message.contains("t = 0.5"), "{message}");
    assert_eq!(run.0.block(), &before, "as before the step");
}

#[test]
fn a_step_with_more_events_than_can_be_located_in_seconds_is_refused() {
    // Six million substeps, each with an event that takes several attempts to locate.
    let mut run = Run::of::<Relay>("", 0.0);
    let message = run.failure(1.2e7).to_string();
    assert!(message.contains("substeps reached only t = ") && message.contains("take a smaller one"), "{message}");
    assert_eq!(run.0.time(), 0.0, "time as before the step");
    run.step(1e4);
    assert_eq!(run.get("switches"), 5000.0);
}

#[test]
fn an_event_within_the_shortest_step_that_there_is_is_found() {
    let mut run = Run::of::<Switch>("threshold = 5e-323", 0.0);
    run.0.set_input_slope(0, 1.0);
    run.step(1e-322);
    assert_eq!(run.get("side"), 1.0);
}

#[test]
fn a_time_event_that_stays_due_ends_in_an_error_and_not_in_a_hang() {
    let mut run = Run::of::<Stuck>("", 0.0);
    run.step(1.0);
    let message = run.failure(1.0).to_string();
    assert!(message.contains("t = 1.5"), "{message}");
    assert_eq!(run.0.time(), 1.0, "time as before the step");
}

#[test]
fn a_nonlinear_crossing_is_located_as_exactly_as_the_solution_itself() {
    for step in [2.0, 0.5, 0.01] {
        let mut run = Run::of::<Growth>("relative_tolerance = 1e-10", 0.0);
        run.run((2.0 / step) as usize, step);
        assert!((run.get("at") - 6.0_f64.ln()).abs() < 1e-8, "step {step}: {}", run.get("at"));
    }
}

/// A position that a controller moves, and how often it has left and met a stop at zero.
struct Carriage {
    drift: ScalarOf<Input>,
    force: ScalarOf<Input>,
    crossings: IntegerOf<Discrete>,
    x: ScalarOf<State>,
    rate: ScalarOf<State>,
}

impl System for Carriage {
    type Structure = NoStructure;
    const NAME: &'static str = "carriage";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators([""]);
        Ok(Carriage {
            drift: d.input(scalar("drift", "velocity of what it is on")),
            force: d.input(scalar("force", "per mass")),
            crossings: d.discrete(integer("crossings", "how often it was at zero")),
            x: d.state(scalar("x", "position").start(-0.1)),
            rate: d.state(scalar("rate", "velocity")),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.x] = v[self.rate] + v[self.drift];
        dx[self.rate] = v[self.force];
    }
    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = v[self.x];
    }
    fn event<S: Scalar>(&self, _t: S, crossed: &[S::Flag], v: &mut Point<S>) {
        v.when(crossed[0], |v| {
            let crossings = S::from_integer(v.get(self.crossings)) + 1.0;
            v.put(self.crossings, crossings.to_integer());
        });
    }
}

#[test]
fn a_short_excursion_is_seen_whatever_the_motion_before() {
    // x = x0 + a t - b t^2 after a jump of the inputs is beyond zero for a moment, where a^2/4b is a little more than -x0; its mean
    // velocity is what the velocity was before, so that the motion seems to go on.
    for excess in [1e-1, 1e-3, 1e-6] {
        let mut run = Run::of::<Carriage>("", 0.0);
        run.set("drift", -1.0);
        run.step(1.0);
        assert_eq!(run.integer("crossings"), 0);
        let p = 2.0 - 4.0 * run.get("x") * (1.0 + excess);
        let b = (p + (p * p - 4.0).sqrt()) / 2.0;
        let a = b - 1.0;
        run.set("drift", a);
        run.set("force", -2.0 * b);
        run.step(1.0);
        assert_eq!(run.integer("crossings"), 2, "{excess}");
    }
}
