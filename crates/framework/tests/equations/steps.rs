//! Several steps in one go: what they show at each communication point is what single steps show.

use adaptive_fmu::execution::Execution;
use adaptive_fmu::system::*;
use common::described::model;
use common::loops::{loop_names, whole};
use common::models::{Run, rows};
use common::random::Random;
use common::sample::sampled;
use common::systems::*;

/// The values of a variable behind each of the steps to these times, taken in one go where that is possible.
fn values(run: &mut Run, times: &[f64], name: &str) -> Vec<f64> {
    let variables = run.0.model().variables();
    let place = variables.index(variables.find(name).unwrap());
    rows(&mut run.0, times, &[place], true).into_iter().map(|row| row[0]).collect()
}

fn times(step: f64, steps: u32) -> Vec<f64> {
    (0..=steps).map(|k| f64::from(k) * step).collect()
}

/// x' = λ(x − cos ωt) − ω sin ωt, so that x = cos ωt, with an output that follows.
struct Follower {
    lambda: ScalarOf<Parameter>,
    omega: ScalarOf<Parameter>,
    x: ScalarOf<State>,
    y: ScalarOf<Signal>,
}

impl System for Follower {
    type Structure = NoStructure;
    const NAME: &'static str = "follower";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Follower {
            lambda: d.parameter(scalar("lambda", "eigenvalue")),
            omega: d.parameter(scalar("omega", "frequency")),
            x: d.state(scalar("x", "state").start(1.0)),
            y: d.output(scalar("y", "twice the state")),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        y[self.y] = v[self.x] * 2.0;
    }
    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let omega = v[self.omega];
        dx[self.x] = v[self.lambda] * (v[self.x] - (omega * t).cos()) - omega * (omega * t).sin();
    }
}

#[test]
fn values_between_the_ends_of_substeps_are_as_accurate_as_these() {
    let mut random = Random::new(7);
    for method in ["automatic", "explicit", "stiff"] {
        for _ in 0..30 {
            let omega = 10.0_f64.powf(2.0 * (0.5 + 0.5 * random.next()));
            // Slow, and where it is stiff, fast.
            let lambda = -omega
                * if method == "explicit" { 0.3 } else { 10.0_f64.powf(-1.0 + 5.0 * (0.5 + 0.5 * random.next())) };
            let tolerance = 10.0_f64.powf(-4.0 - 5.0 * (0.5 + 0.5 * random.next()));
            let start = format!(
                "lambda = {lambda}\nomega = {omega}\nrelative_tolerance = {tolerance:e}\nintegration_method = '{method}'"
            );
            let times = times((0.001 + 0.2 * (0.5 + 0.5 * random.next())) / omega, 500);
            let found = values(&mut Run::of::<Follower>(&start, 0.0), &times, "y");
            let errors = found.iter().zip(&times[1..]).map(|(y, t)| (y - 2.0 * (omega * t).cos()).abs());
            let worst = errors.fold(0.0, f64::max);
            println!(
                "{method}: lambda {lambda}, omega {omega}, tolerance {tolerance:e}: {:.2} tolerances",
                worst / tolerance
            );
            assert!(worst < 30.0 * tolerance, "{start}: {worst:e}");
        }
    }
}

#[test]
fn events_are_where_they_are_in_single_steps() {
    for (step, steps) in [(1.0, 60), (0.37e-3, 20_000), (0.1, 600), (edge(1.0) / 7.0, 300)] {
        let times = times(step, steps);
        let found = values(&mut Run::of::<SquareIntegral>("", 0.0), &times, "q");
        found.iter().zip(&times[1..]).for_each(|(q, &t)| assert!((q - triangle(t)).abs() < 1e-9, "{step}, {t}: {q}"));
    }
    for (step, steps) in [(0.01, 250), (0.25, 10)] {
        let times = times(step, steps);
        let found = values(&mut Run::of::<Ball>("", 0.0), &times, "bounces");
        found.iter().zip(&times[1..]).for_each(|(&n, &t)| assert_eq!(n, exact_ball(t, 0.8).0, "{step}, {t}"));
    }
    for (step, steps) in [(0.3, 66), (1.0, 20), (0.013, 1500)] {
        let times = times(step, steps);
        let found = values(&mut Run::of::<Relay>("", 0.0), &times, "x");
        let triangle = |t: f64| 1.0 - ((t + 1.0).rem_euclid(4.0) - 2.0).abs();
        found.iter().zip(&times[1..]).for_each(|(&x, &t)| assert!((x - triangle(t)).abs() < 1e-8, "{step}, {t}: {x}"));
    }
}

#[test]
fn what_can_not_be_finished_is_left_to_a_single_step() {
    // With half the speed each time, infinitely many bounces are over at t = 1.34 s.
    let mut run = Run::of::<Ball>("restitution = 0.5", 0.0);
    let times = times(0.1, 30);
    run.step(0.1);
    let mut taken = 0;
    let mut given = 0;
    while taken < 30 {
        let further = run.0.steps(&times[1 + taken..], false, &mut |_, _, _| given += 1);
        taken += further;
        if further == 0 {
            break;
        }
    }
    assert!((9..=12).contains(&taken) && given >= taken, "{taken} steps, {given} points");
    assert_eq!(run.0.time(), times[1 + taken]);
    let before = run.0.block().clone();
    assert_eq!(run.0.steps(&times[1 + taken..], false, &mut |_, _, _| ()), 0);
    assert_eq!(run.0.block(), &before);
    let message = (0..20).find_map(|_| run.0.step(run.0.time(), 0.1).err()).expect("an endless event").to_string();
    assert!(message.contains("t = 1.34"), "{message}");
}

#[test]
fn what_was_set_and_fixed_steps_are_stepped_singly() {
    let times = times(0.01, 10);
    let mut switch = Run::of::<Switch>("threshold = 1.0", 0.0);
    switch.step(0.01);
    switch.set("u", 0.5);
    assert_eq!(switch.0.steps(&times[1..], false, &mut |_, _, _| ()), 0, "another input");
    switch.step(0.01);
    assert_eq!(switch.0.steps(&times[2..4], false, &mut |_, _, _| ()), 1, "the same input");
    switch.0.set_input_slope(0, 1.0);
    assert_eq!(switch.0.steps(&times[3..], false, &mut |_, _, _| ()), 0, "an input that moves");
    switch.step(0.01);
    assert_eq!(switch.0.steps(&times[4..], false, &mut |_, _, _| ()), 0, "an input that has moved");
    for (start, taken) in [("integration_method = 'fixed'\n", 0), ("", 9)] {
        let mut run = Run::of::<Follower>(&format!("{start}lambda = -1.0\nomega = 1.0"), 0.0);
        assert_eq!(run.0.steps(&times, false, &mut |_, _, _| ()), 0, "before the first step");
        run.step(0.01);
        assert_eq!(run.0.steps(&times[1..], false, &mut |_, _, _| ()), taken, "{start}");
        run.set("omega", 2.0);
        assert_eq!(run.0.steps(&times[1..], false, &mut |_, _, _| ()), 0, "a parameter is to be taken over");
    }
}

#[test]
fn loops_have_the_values_of_single_steps_within_the_tolerance() {
    for name in sampled(loop_names()) {
        let text = whole(&name);
        let begun = || {
            let mut execution = Execution::new(model(&text).unwrap());
            execution.initialise().unwrap();
            execution
        };
        let first = begun();
        let (variables, times) = (first.model().variables(), times(first.model().description().experiment.step, 400));
        let shown = variables.visible().filter(|e| e.variable.is_real() && e.variable.causality == Causality::Output);
        let places: Vec<_> = shown.map(|element| variables.index(element)).collect();
        let [singly, at_once] = [false, true].map(|in_one_go| rows(&mut begun(), &times, &places, in_one_go));
        let mut worst = 0.0_f64;
        for k in 0..singly[0].len() {
            let size = singly.iter().map(|row| row[k].abs()).fold(1e-9, f64::max);
            let apart = singly.iter().zip(&at_once).map(|(one, other)| (one[k] - other[k]).abs()).fold(0.0, f64::max);
            worst = worst.max(apart / size);
        }
        println!("{name}: {worst:.1e}");
        assert!(worst < 2e-5, "{name}: {worst:e}");
    }
}

/// q'' = −ω² q from q = 1 at rest, so that q = cos ωt. An event counts how often q exceeds a threshold, each step how many
/// there were.
struct Pendulum {
    omega: ScalarOf<Parameter>,
    threshold: ScalarOf<Parameter>,
    q: ScalarOf<State>,
    w: ScalarOf<State>,
    peaks: ScalarOf<Discrete>,
    steps: ScalarOf<Discrete>,
    largest: ScalarOf<Discrete>,
}

impl System for Pendulum {
    type Structure = NoStructure;
    const NAME: &'static str = "pendulum";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators(["threshold"]);
        Ok(Pendulum {
            omega: d.parameter(scalar("omega", "frequency").start(1.0)),
            threshold: d.parameter(scalar("threshold", "what is exceeded").start(0.999)),
            q: d.state(scalar("q", "position").start(1.0)),
            w: d.state(scalar("w", "velocity")),
            peaks: d.discrete(scalar("peaks", "how often the threshold was exceeded")),
            steps: d.discrete(scalar("steps", "number of steps")),
            largest: d.discrete(scalar("largest", "largest position at the end of a step").start(-1.0)),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.q] = v[self.w];
        dx[self.w] = -v[self.omega] * v[self.omega] * v[self.q];
    }
    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = v[self.q] - v[self.threshold];
    }
    fn event<S: Scalar>(&self, _t: S, _: &[S::Flag], v: &mut Point<S>) {
        let rises = v[self.w].above(S::from(0.0));
        v.when(rises, |v| v[self.peaks] += 1.0);
    }
    fn step_completed<S: Scalar>(&self, _t: S, _step: S, v: &mut Point<S>) {
        v[self.steps] += 1.0;
        let (q, largest) = (v[self.q], v[self.largest]);
        v[self.largest] = S::select(q.above(largest), q, largest);
    }
}

#[test]
fn what_the_ends_of_steps_count_is_counted_at_each() {
    let times = times(0.02, 400);
    let mut run = Run::of::<Pendulum>("threshold = 2.0", 0.0);
    run.step(0.02);
    assert!(run.0.steps(&times[1..], false, &mut |_, _, _| ()) > 100, "in one go");
    let mut run = Run::of::<Pendulum>("threshold = 2.0", 0.0);
    let variables = run.0.model().variables();
    let places = ["q", "steps", "largest"].map(|name| variables.index(variables.find(name).unwrap()));
    let rows = rows(&mut run.0, &times, &places, true);
    let mut largest = f64::MIN;
    for (k, row) in rows.iter().enumerate() {
        largest = largest.max(row[0]);
        assert_eq!(row[1..], [(k + 1) as f64, largest], "{k}");
    }
    assert_eq!([run.get("steps"), run.get("largest")], [400.0, largest]);
}

#[test]
fn what_reads_the_ends_of_steps_is_stepped_singly() {
    let times = times(0.01, 10);
    let mut run = Run::of::<Odometer>("full = 0.035", 0.0);
    run.step(0.01);
    assert_eq!(run.0.steps(&times[1..], false, &mut |_, _, _| ()), 0, "its output is that of its counter");
    let goes = |name: &String| {
        let mut execution = Execution::new(model(&whole(name)).unwrap());
        execution.initialise().unwrap();
        let step = execution.model().description().experiment.step;
        execution.step(0.0, step).unwrap();
        execution.steps(&[step, 2.0 * step, 3.0 * step], false, &mut |_, _, _| ()) > 0
    };
    let names = loop_names();
    let others: Vec<_> = names.iter().filter(|name| !goes(name)).collect();
    // The sampled form of robust MRAC, which reads it, is the same system.
    assert_eq!(others, ["6.5.1-mrac", "6.5.2-mrac"]);
}

#[test]
fn what_leaves_its_side_for_a_few_points_within_a_substep_is_found() {
    let mut random = Random::new(3);
    for _ in 0..20 {
        let threshold = 1.0 - 10.0_f64.powf(-2.0 - 3.0 * (0.5 + 0.5 * random.next()));
        // Three to ten points for each time above it.
        let above = 2.0 * threshold.acos();
        let step = above / (3.0 + 7.0 * (0.5 + 0.5 * random.next()));
        let steps = (20.0 / step) as u32;
        let times = times(step, steps);
        let mut run = Run::of::<Pendulum>(&format!("threshold = {threshold}\nrelative_tolerance = 1e-9"), 0.0);
        let found = values(&mut run, &times, "peaks");
        for (peaks, &t) in found.iter().zip(&times[1..]) {
            let phase = (t + 0.5 * above) / std::f64::consts::TAU;
            let is_near = (phase - phase.round()).abs() < 1e-4;
            assert!(is_near || *peaks == phase.floor(), "threshold {threshold}, step {step}, t = {t}: {peaks}");
        }
    }
}

#[test]
fn a_go_ends_after_some_work_and_where_steps_get_another_length() {
    let mut run = Run::of::<Pendulum>("omega = 1e5\nthreshold = 2.0", 0.0);
    run.step(0.01);
    let all = times(0.01, 1000);
    let taken = run.0.steps(&all[1..], false, &mut |_, _, _| ());
    assert!((1..500).contains(&taken), "{taken} steps of 1000 rad");
    let mut run = Run::of::<Pendulum>("", 0.0);
    run.step(0.01);
    assert_eq!(run.0.steps(&[0.01, 0.02, 0.03, 0.035, 0.04], false, &mut |_, _, _| ()), 2);
}

/// z = x rests at zero until t = 1, and then moves: x' = 3 (t − 1)². Another indicator is 2 − t.
struct Rest {
    x: ScalarOf<State>,
    events: ScalarOf<Discrete>,
    steps: ScalarOf<Discrete>,
}

impl System for Rest {
    type Structure = NoStructure;
    const NAME: &'static str = "rest";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators(["", ""]);
        Ok(Rest {
            x: d.state(scalar("x", "state")),
            events: d.discrete(scalar("events", "number of events")),
            steps: d.discrete(scalar("steps", "number of steps")),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, t: S, _v: &Values<S>, dx: &mut Rates<S>) {
        let late = t.above(S::from(1.0));
        dx[self.x] = S::select(late, (t - 1.0) * (t - 1.0) * 3.0, S::from(0.0));
    }
    fn event_indicators<S: Scalar>(&self, t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = v[self.x];
        z[1] = -t + 2.0;
    }
    fn event<S: Scalar>(&self, _t: S, _: &[S::Flag], v: &mut Point<S>) {
        v[self.events] += 1.0;
    }
    fn step_completed<S: Scalar>(&self, _t: S, _step: S, v: &mut Point<S>) {
        v[self.steps] += 1.0;
    }
}

#[test]
fn an_indicator_that_rests_at_zero_has_the_events_of_single_steps() {
    for step in [0.01, 0.013, 0.1] {
        let times = times(step, (3.0 / step) as u32);
        let found = [false, true].map(|in_one_go| {
            let mut run = Run::of::<Rest>("", 0.0);
            let variables = run.0.model().variables();
            let places = ["events", "steps"].map(|name| variables.index(variables.find(name).unwrap()));
            rows(&mut run.0, &times, &places, in_one_go)
        });
        assert_eq!(found[0], found[1], "{step}");
        assert_eq!(found[1].last().unwrap()[1], (times.len() - 1) as f64);
    }
}

/// x' = 1, with a time event whose time may be set, and an event of the state that sets it to 100.
struct Planned {
    x: ScalarOf<State>,
    next: ScalarOf<Discrete>,
}

impl System for Planned {
    type Structure = NoStructure;
    const NAME: &'static str = "planned";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        d.indicators([""]);
        Ok(Planned {
            x: d.state(scalar("x", "state")),
            next: d.discrete(scalar("next", "time of the next event").start(200.0)),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, _v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.x] = S::from(1.0);
    }
    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        v[self.next]
    }
    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = v[self.x] - 0.95;
    }
    fn event<S: Scalar>(&self, _t: S, _: &[S::Flag], v: &mut Point<S>) {
        v[self.next] = S::from(100.0);
    }
}

#[test]
fn an_event_at_no_time_is_refused_before_another_event_gives_it_one() {
    let mut run = Run::of::<Planned>("", 0.0);
    run.step(0.1);
    run.set("next", f64::NAN);
    assert_eq!(run.0.steps(&times(0.1, 10)[1..], false, &mut |_, _, _| ()), 0);
    let message = run.failure(0.1).to_string();
    assert!(message.contains("the time of the next event"), "{message}");
}
