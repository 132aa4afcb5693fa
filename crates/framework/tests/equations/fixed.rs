//! Steps of fixed length: their order, events at the ends of substeps, what they need and what they refuse.

use adaptive_fmu::error::StepError;
use adaptive_fmu::model::Model;
use adaptive_fmu::system::*;
use common::described::open_description;
use common::description_names;
use common::models::Run;
use common::{OK, Unit};

/// Van der Pol's oscillator, driven: x'' = (1 − x²) x' − x + sin 2t + u.
struct Driven {
    u: ScalarOf<Input>,
    x: VectorOf<State>,
}

impl System for Driven {
    type Structure = NoStructure;
    const NAME: &'static str = "driven";
    const DOCUMENTATION: &'static str = "An oscillator.";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Driven { u: d.input(scalar("u", "")), x: d.state(vector("x", 2, "").output()) })
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.set(self.x, [S::from(1.0), S::from(-0.5)]);
    }

    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}

    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let [x, rate] = v.array(self.x);
        dx.set(self.x, [rate, (-x * x + 1.0) * rate - x + (t * 2.0).sin() + v[self.u]]);
    }
}

fn fixed<M: System<Structure = NoStructure>>(steps: i32) -> Run {
    Run::of::<M>(&format!("integration_method = 'fixed'\nfixed_steps = {steps}"), 0.0)
}

/// x after 20 steps of 0.1 s with a ramp as input.
fn driven(start: &str) -> [f64; 2] {
    let mut run = Run::of::<Driven>(&format!("{start}\ninput_handling = 'interpolate'"), 0.0);
    for k in 1..=20 {
        run.set("u", 0.05 * f64::from(k));
        run.step(0.1);
    }
    ["x[1]", "x[2]"].map(|name| run.get(name))
}

#[test]
fn twice_as_many_substeps_leave_a_sixteenth_of_the_error() {
    let exact = driven("integration_method = 'explicit'\nrelative_tolerance = 1e-12");
    let error = |steps: i32| {
        let found = driven(&format!("integration_method = 'fixed'\nfixed_steps = {steps}"));
        (0..2).map(|i| (found[i] - exact[i]).abs()).fold(0.0, f64::max)
    };
    let errors = [1, 2, 4, 8, 16].map(error);
    assert!(errors[0] < 1e-4 && errors[4] > 1e-12, "{errors:?}");
    for pair in errors.windows(2) {
        assert!((13.0..20.0).contains(&(pair[0] / pair[1])), "{errors:?}");
    }
}

/// A mode with λ = −decay ± frequency j, from 1.
struct Mode {
    decay: ScalarOf<Parameter>,
    frequency: ScalarOf<Parameter>,
    x: VectorOf<State>,
}

impl System for Mode {
    type Structure = NoStructure;
    const NAME: &'static str = "mode";
    const DOCUMENTATION: &'static str = "A mode.";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Mode {
            decay: d.parameter(scalar("decay", "")),
            frequency: d.parameter(scalar("frequency", "")),
            x: d.state(vector("x", 2, "").output()),
        })
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.set(self.x, [S::from(1.0), S::from(0.0)]);
    }

    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let ([x, y], decay, frequency) = (v.array(self.x), v[self.decay], v[self.frequency]);
        dx.set(self.x, [-decay * x - frequency * y, frequency * x - decay * y]);
    }
}

#[test]
fn modes_decay_up_to_the_limit_of_stability_and_grow_beyond() {
    let size = |mode: &str| {
        let mut run = Run::of::<Mode>(&format!("integration_method = 'fixed'\nfixed_steps = 100\n{mode}"), 0.0);
        run.run(20, 100.0);
        run.get("x[1]").hypot(run.get("x[2]"))
    };
    assert!(size("decay = 2.78") < 1e-6 && size("decay = 2.79") > 1e3);
    assert!(size("frequency = 2.82") < 1e-6 && size("frequency = 2.83") > 1e3);
}

/// x' = 1, and −1 once x has passed a threshold; that and the ticks of a clock are noted when they are handled.
struct Noted {
    period: ScalarOf<Parameter>,
    threshold: ScalarOf<Parameter>,
    ticks: IntegerOf<Discrete>,
    ticked_at: ScalarOf<Discrete>,
    passed_at: ScalarOf<Discrete>,
    x: ScalarOf<State>,
}

impl System for Noted {
    type Structure = NoStructure;
    const NAME: &'static str = "noted";
    const DOCUMENTATION: &'static str = "Events.";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators(["threshold"]);
        Ok(Noted {
            period: d.parameter(scalar("period", "").start(1e9)),
            threshold: d.parameter(scalar("threshold", "").start(1e9)),
            ticks: d.discrete(integer("ticks", "").output()),
            ticked_at: d.discrete(scalar("ticked_at", "").output()),
            passed_at: d.discrete(scalar("passed_at", "").output()),
            x: d.state(scalar("x", "").output()),
        })
    }

    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx.set(self.x, [S::select(v[self.passed_at].above(S::from(0.0)), S::from(-1.0), S::from(1.0))]);
    }

    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        (S::from_integer(v.get(self.ticks)) + 1.0) * v[self.period]
    }

    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = v[self.x] - v[self.threshold];
    }

    fn event<S: Scalar>(&self, t: S, crossed: &[S::Flag], v: &mut Point<S>) {
        let is_tick = System::next_time_event(self, &v.values()).at_most(t);
        v.when(is_tick, |v| {
            let ticks = S::from_integer(v.get(self.ticks)) + 1.0;
            v.put(self.ticks, ticks.to_integer());
            v[self.ticked_at] = t;
        });
        let is_first = v[self.passed_at].equals(S::from(0.0));
        v.when(crossed[0] & is_first, |v| v[self.passed_at] = t);
    }
}

fn noted(steps: i32, lines: &str) -> Run {
    Run::of::<Noted>(&format!("integration_method = 'fixed'\nfixed_steps = {steps}\n{lines}"), 0.0)
}

#[test]
fn time_events_are_handled_at_the_end_of_the_substep_in_which_they_fall_due() {
    for (period, ticks, ticked_at) in [
        (0.3, 3, 1.0),
        (0.24, 4, 1.0),
        // All that are due, where there are several in a substep.
        (0.07, 14, 1.0),
        (0.6, 1, 0.75),
        // A rounding behind the end of a substep is the end itself; more is the next one.
        (0.5 * (1.0 + 1e-12), 2, 1.0 + 1e-12),
        (0.5 * (1.0 + 1e-6), 1, 0.75),
        (1.0 + 1e-12, 1, 1.0 + 1e-12),
    ] {
        let mut run = noted(4, &format!("period = {period}"));
        run.step(1.0);
        let found = (run.integer("ticks"), run.get("ticked_at"));
        assert_eq!(found, (ticks, ticked_at), "every {period} s");
        assert_eq!(run.get("x"), 1.0);
    }
}

#[test]
fn an_indicator_has_its_event_at_the_end_of_the_substep_in_which_it_changes_sides() {
    for (threshold, steps, passed_at) in [(0.3, 4, 0.5), (0.5, 4, 0.5), (0.51, 4, 0.75), (0.33, 10, 0.4), (0.9, 1, 1.0)]
    {
        let mut run = noted(steps, &format!("threshold = {threshold}"));
        run.step(1.0);
        assert!((run.get("passed_at") - passed_at).abs() < 1e-15, "{threshold}: {}", run.get("passed_at"));
        // What the event has changed holds from there on.
        assert!((run.get("x") - (2.0 * passed_at - 1.0)).abs() < 1e-15, "{threshold}");
    }
}

#[test]
fn what_was_set_across_a_threshold_has_its_event_where_the_step_begins() {
    let mut run = noted(4, "");
    run.step(1.0);
    run.set("threshold", 0.5);
    run.step(1.0);
    assert_eq!((run.get("passed_at"), run.get("x")), (1.0, 0.0));
}

#[test]
fn an_instance_that_was_restored_goes_on_bit_for_bit() {
    let mut run = noted(3, "period = 0.13\nthreshold = 0.7");
    let mut other = noted(3, "period = 0.13\nthreshold = 0.7");
    run.run(4, 0.1);
    let saved = run.0.block().clone();
    run.run(7, 0.1);
    other.run(2, 0.05);
    other.0.block_mut().copy_from(&saved);
    other.run(7, 0.1);
    assert_eq!(run.0.block(), other.0.block());
    assert!(run.get("passed_at") > 0.4, "an event lies behind");
}

/// x' = x² from 1: it escapes at t = 1.
struct Escaping {
    x: ScalarOf<State>,
}

impl System for Escaping {
    type Structure = NoStructure;
    const NAME: &'static str = "escaping";
    const DOCUMENTATION: &'static str = "A pole.";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Escaping { x: d.state(scalar("x", "").output()) })
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.x] = S::from(1.0);
    }

    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx.set(self.x, [v[self.x] * v[self.x]]);
    }
}

#[test]
fn what_grows_beyond_numbers_is_an_error_and_leaves_everything_as_it_was() {
    let mut run = fixed::<Escaping>(100);
    run.step(0.5);
    let before = run.0.block().clone();
    let StepError::Diverged { variable, time, .. } = run.failure(1.0) else { panic!("another error") };
    assert!(variable == "x" && time > 1.0 && time < 1.1, "{variable} at {time}");
    assert_eq!(run.0.block(), &before);
}

#[test]
fn work_is_known_beforehand_and_has_no_limit() {
    let mut run = Run::of::<Driven>("integration_method = 'fixed'\nfixed_steps = 10000\nwork_limit = 1000.0", 0.0);
    run.step(10.0);
    let mut other = Run::of::<Driven>("integration_method = 'explicit'\nwork_limit = 1000.0", 0.0);
    assert!(matches!(other.failure(10.0), StepError::TooMuchWork { .. }));
}

#[test]
fn the_number_of_substeps_has_limits() {
    for steps in [0, 10_001] {
        let start = format!("fixed_steps = {steps}").parse().unwrap();
        let error = Model::new::<Driven>("Driven", &start).unwrap_err().to_string();
        assert!(error.contains(&format!("fixed_steps = {steps}: must be within 1 … 10000")), "{error}");
    }
}

#[test]
fn every_unit_of_this_package_can_be_stepped_so() {
    for name in description_names() {
        let unit = Unit::from_text(&open_description(&name));
        if unit.model.variables().find("fixed_steps").is_none() {
            continue;
        }
        assert_eq!(unit.set_integer("integration_method", 4), OK);
        assert_eq!(unit.set_integer("fixed_steps", 20), OK);
        unit.start(0.0);
        unit.run(0.0, 3, unit.model.description().experiment.step);
    }
}
