//! Growth is never hidden: linear plants with known modes, by each method.

use adaptive_fmu::error::StepError;
use adaptive_fmu::execution::Execution;
use adaptive_fmu::system::*;
use common::described::model;
use common::loops::whole;
use common::models::Run;
use common::random::Random;
use nalgebra::{DMatrix, DVector};

const METHODS: [&str; 3] = ["automatic", "explicit", "stiff"];

/// x' = A x from x0, by a method with a tolerance.
fn linear(a: &DMatrix<f64>, x0: &DVector<f64>, method: &str, tolerance: f64) -> Execution {
    let row = |i: usize| format!("{:?}", a.row(i).iter().collect::<Vec<_>>());
    let rows: Vec<_> = (0..a.nrows()).map(row).collect();
    let zeros = vec!["[0.0]"; a.nrows()].join(", ");
    let text = format!(
        "name = 'Linear'\nmodel = 'state-space'\ndescription = ''\n[structure]\nA = [{}]\nB = [{zeros}]\nC = [{:?}]\n[start]\n\
         x0 = {:?}\nintegration_method = '{method}'\nrelative_tolerance = {tolerance:e}\n",
        rows.join(", "),
        vec![0.0; a.nrows()],
        x0.as_slice(),
    );
    let mut execution = Execution::new(model(&text).unwrap());
    execution.initialise().unwrap();
    execution
}

fn states(execution: &Execution) -> DVector<f64> {
    DVector::from_column_slice(&execution.block().reals[execution.model().variables().reals(Section::State)])
}

/// Steps of length h up to time t.
fn run(execution: &mut Execution, h: f64, t: f64) -> Result<(), StepError> {
    let steps = (t / h).ceil() as usize;
    (0..steps).try_for_each(|_| execution.step(execution.time(), h).map(|_| ()))
}

#[test]
fn a_growing_oscillation_next_to_a_stiff_mode_is_seen_from_far_below_the_tolerance() {
    let a = DMatrix::from_row_slice(
        4,
        4,
        &[10.0, 1e4, 0.0, 0.0, -1e4, 10.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1e5, -1e5],
    );
    let x0 = DVector::from_column_slice(&[1e-8, 0.0, 1.0, 0.0]);
    for method in METHODS {
        for tolerance in [1e-3, 1e-6, 1e-9] {
            let mut execution = linear(&a, &x0, method, tolerance);
            run(&mut execution, 0.1, 2.5).unwrap();
            let x = states(&execution);
            let off = (x[0].hypot(x[1]) / (1e-8 * 25.0_f64.exp())).ln() / 25.0;
            assert!(off.abs() < 0.01, "{method}, {tolerance:e}: {x}");
        }
    }
}

#[test]
fn a_servo_whose_flexible_mode_grows_is_no_stable_servo() {
    // Poles at −5, a flexible mode of 2000 rad/s that grows at 3 1/s, and the drive's lag of 10 µs, each feeding the next.
    let a = DMatrix::from_row_slice(
        5,
        5,
        &[
            -5.0, 1.0, 0.0, 0.0, 0.0, 0.0, -5.0, 0.0, 0.0, 1.0, 0.0, 0.0, 3.0, 2000.0, 0.0, 0.0, 0.0, -2000.0, 3.0,
            1.0, //
            0.0, 0.0, 0.0, 0.0, -1e5,
        ],
    );
    let x0 = DVector::from_column_slice(&[1.0, 0.0, 1e-7, 0.0, 0.0]);
    for method in METHODS {
        for h in [1e-3, 1e-2, 0.1] {
            let mut execution = linear(&a, &x0, method, 1e-6);
            run(&mut execution, h, 8.0).unwrap();
            let x = states(&execution);
            let off = (x[2].hypot(x[3]) / (1e-7 * 24.0_f64.exp())).ln() / 24.0;
            assert!(off.abs() < 0.01, "{method}, {h}: {x}");
        }
    }
}

/// A random linear plant with one mode that grows: A, and its basis, whose first two vectors are that mode's.
struct Plant {
    a: DMatrix<f64>,
    basis: DMatrix<f64>,
    growth: f64,
    frequency: f64,
    /// The fastest of all modes, 1/s.
    fastest: f64,
}

fn between(random: &mut Random, low: f64, high: f64) -> f64 {
    low + 0.5 * (random.next() + 1.0) * (high - low)
}

fn plant(random: &mut Random) -> Plant {
    let states = 2 + (between(random, 0.0, 9.0) as usize);
    let mut blocks = DMatrix::zeros(states, states);
    let pair = |blocks: &mut DMatrix<f64>, k: usize, growth: f64, frequency: f64| {
        (blocks[(k, k)], blocks[(k + 1, k + 1)]) = (growth, growth);
        (blocks[(k, k + 1)], blocks[(k + 1, k)]) = (frequency, -frequency);
    };
    let frequency = 10_f64.powf(between(random, -1.0, 5.0));
    let growth = frequency * 10_f64.powf(between(random, -6.0, 0.0));
    pair(&mut blocks, 0, growth, frequency);
    let (mut k, mut fastest) = (2, frequency);
    while k < states {
        // Oscillations with any damping, and relaxations that may be stiff.
        if k + 1 < states && random.next() < 0.0 {
            let frequency = 10_f64.powf(between(random, -1.0, 5.0));
            pair(&mut blocks, k, -frequency * 10_f64.powf(between(random, -3.0, 0.0)), frequency);
            fastest = fastest.max(frequency);
            k += 2;
        } else {
            let rate = 10_f64.powf(between(random, -1.0, 8.0));
            blocks[(k, k)] = -rate;
            fastest = fastest.max(rate);
            k += 1;
        }
    }
    let basis = DMatrix::from_fn(states, states, |_, _| random.next()).qr().q();
    Plant { a: &basis * blocks * basis.transpose(), basis, growth, frequency, fastest }
}

#[test]
fn growth_rates_of_random_plants_are_right_or_the_step_reports_why_not() {
    let random = &mut Random::new(22);
    let mut checked = 0;
    for _ in 0..40 {
        let plant = plant(random);
        let amplitude = 10_f64.powf(between(random, -9.0, 0.0));
        let tolerance = 10_f64.powf(between(random, -9.0, -3.0));
        let h = 10_f64.powf(between(random, -4.0, -1.0));
        let mut modes = DVector::from_fn(plant.a.nrows(), |_, _| random.next());
        (modes[0], modes[1]) = (amplitude, 0.0);
        let x0 = &plant.basis * modes;
        for method in METHODS {
            // Time enough to grow by e⁵, if a test has time for that.
            let fastest = if method == "explicit" { plant.fastest } else { plant.frequency };
            let time = (5.0 / plant.growth).min(1e4 / fastest);
            if plant.growth * time < 0.5 {
                continue;
            }
            let message = format!(
                "{method}, {} states, growth {:e} at {:e} rad/s from {amplitude:e}, H = {h:e}, tolerance {tolerance:e}",
                plant.a.nrows(),
                plant.growth,
                plant.frequency
            );
            let mut execution = linear(&plant.a, &x0, method, tolerance);
            let h = h.min(0.5 * time).max(time / 1000.0);
            let amplitude = |execution: &Execution| {
                let modes = plant.basis.transpose() * states(execution);
                modes[0].hypot(modes[1])
            };
            // In the second half: what fast modes leave in the growing one by rounding, as they fall, is there before.
            let (middle, half) = match run(&mut execution, h, 0.5 * time) {
                Ok(()) => (execution.time(), amplitude(&execution)),
                Err(error) => panic!("{message}: {error}"),
            };
            run(&mut execution, h, 0.5 * time).unwrap_or_else(|error| panic!("{message}: {error}"));
            let rate = (amplitude(&execution) / half).ln() / (execution.time() - middle);
            assert!((rate / plant.growth - 1.0).abs() < 0.01, "{message}: {rate:e}");
            checked += 1;
        }
    }
    assert!(checked > 60, "{checked}");
}

#[test]
fn a_mode_that_grows_from_a_tuned_parameter_on_is_followed_from_there_on() {
    // An oscillation of 1e4 rad/s whose damping changes its sign, with a stiff mode; its matrix is as large before.
    let of = |damping: f64| [-damping, 1e4, 0.0, -1e4, -damping, 0.0, 0.0, 0.0, -1e7];
    let a = DMatrix::from_row_slice(3, 3, &of(100.0));
    for method in METHODS {
        let mut execution = linear(&a, &DVector::from_column_slice(&[1e-3, 0.0, 1.0]), method, 1e-4);
        run(&mut execution, 0.01, 0.1).unwrap();
        let before = states(&execution).fixed_rows::<2>(0).norm();
        for i in 0..2 {
            let variables = execution.model().variables();
            let index = variables.index(variables.find(&format!("A[{0},{0}]", i + 1)).unwrap());
            execution.set_real(index, 50.0);
        }
        run(&mut execution, 0.01, 0.2).unwrap();
        let rate = (states(&execution).fixed_rows::<2>(0).norm() / before).ln() / 0.2;
        assert!((rate / 50.0 - 1.0).abs() < 0.01, "{method}: {rate}");
    }
}

#[test]
fn growth_that_takes_too_much_work_to_follow_is_refused_with_its_mode() {
    // A mode of 1e5 rad/s and a stiff one: to follow it for 1e3 s takes some 1e9 substeps.
    let a = DMatrix::from_row_slice(3, 3, &[3.0, 1e5, 0.0, -1e5, 3.0, 0.0, 0.0, 0.0, -1e8]);
    let x0 = DVector::from_column_slice(&[1e-9, 0.0, 1.0]);
    let error = run(&mut linear(&a, &x0, "automatic", 1e-6), 1e3, 1e3).unwrap_err();
    assert!(matches!(error, StepError::TooMuchWork { .. }), "{error}");
    let text = error.to_string();
    ["100000 rad/s", "grows at 3 1/s", "work_limit"].iter().for_each(|part| assert!(text.contains(part), "{text}"));
}

#[test]
fn a_step_in_which_a_mode_would_grow_beyond_any_use_diverges_and_a_shorter_one_takes_too_much_work() {
    let a = DMatrix::from_row_slice(3, 3, &[300.0, 1e6, 0.0, -1e6, 300.0, 0.0, 0.0, 0.0, -1e7]);
    let x0 = DVector::from_column_slice(&[1e-9, 0.0, 1.0]);
    let reason = |step: f64| {
        let mut execution = linear(&a, &x0, "automatic", 1e-6);
        let variables = execution.model().variables();
        let limit = variables.index(variables.find("work_limit").unwrap());
        execution.set_real(limit, 1e6);
        run(&mut execution, step, step).unwrap_err()
    };
    // The growth is 3e6 in units of e, and 3e4.
    let (longer, shorter) = (reason(1e4), reason(1e2));
    assert!(matches!(longer, StepError::Diverged { .. }), "{longer}");
    assert!(matches!(shorter, StepError::TooMuchWork { .. }), "{shorter}");
}

/// Two modes that grow alike next to a stiff one: an altitude, which is large by nature, and an angle.
struct Climb {
    altitude: ScalarOf<State>,
    angle: ScalarOf<State>,
    fast: ScalarOf<State>,
}

impl System for Climb {
    type Structure = NoStructure;
    const NAME: &'static str = "climb";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Climb {
            altitude: d.state(scalar("altitude", "").unit("m").nominal(1e9)),
            angle: d.state(scalar("angle", "").unit("rad")),
            fast: d.state(scalar("fast", "")),
        })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.altitude] = S::from(1.0);
        v[self.angle] = S::from(1e-3);
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.altitude] = v[self.altitude] * 300.0;
        dx[self.angle] = v[self.angle] * 300.0;
        dx[self.fast] = -v[self.fast] * 1e7;
    }
}

#[test]
fn what_diverges_is_named_by_its_size_in_nominals() {
    let error = Run::of::<Climb>("work_limit = 3e4", 0.0).failure(1e4);
    let StepError::Diverged { variable, value, .. } = &error else { panic!("{error}") };
    assert!(variable == "angle" && *value > 1e-3, "{error}");
}

/// The time at which a loop as a single FMU ends with an error, stepped by h.
fn escape(method: &str, tolerance: f64, h: f64) -> f64 {
    let start = format!("[start]\nintegration_method = '{method}'\nrelative_tolerance = {tolerance:e}\n");
    let mut execution = Execution::new(model(&whole("4-case3").replace("\n[start]\n", &format!("\n{start}"))).unwrap());
    execution.initialise().unwrap();
    match run(&mut execution, h, 0.3) {
        Err(StepError::TooMuchWork { time, .. } | StepError::Diverged { time, .. }) => time,
        Err(StepError::StepTooSmall { time, .. }) => time,
        other => panic!("{method}, {tolerance:e}, {h}: {other:?}"),
    }
}

#[test]
fn no_step_leads_across_a_finite_escape() {
    // Chapter 4, case 3, with the constant gain: its solution ends at 0.119 s.
    for (method, tolerance, h) in
        [("automatic", 1e-3, 1e-3), ("stiff", 1e-3, 0.1), ("automatic", 1e-4, 1e-3), ("automatic", 1e-6, 1e-2)]
    {
        let time = escape(method, tolerance, h);
        assert!((time - 0.119).abs() < 0.005, "{method}, {tolerance:e}, {h}: ended at {time}");
    }
}

/// x'' = −(1 + ε cos 2t) x − d x': an arm whose inertia varies at twice its frequency. At each moment it is damped, and it grows.
struct Arm {
    variation: ScalarOf<Parameter>,
    damping: ScalarOf<Parameter>,
    x: VectorOf<State>,
}

impl System for Arm {
    type Structure = NoStructure;
    const NAME: &'static str = "arm";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Arm {
            variation: d.parameter(scalar("variation", "of the stiffness")),
            damping: d.parameter(scalar("damping", "1/s")),
            x: d.state(vector("x", 2, "angle and its rate")),
        })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.set(self.x, [S::from(1e-9), S::from(0.0)]);
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let [x, rate] = v.array(self.x);
        let stiffness = v[self.variation] * (t * 2.0).cos() + 1.0;
        dx.set(self.x, [rate, -stiffness * x - v[self.damping] * rate]);
    }
}

/// Growth of an arm in about 150 s, as a logarithm. `finer` divides each step.
fn growth_of_arm((variation, damping): (f64, f64), method: &str, steps_a_period: f64, finer: usize) -> f64 {
    let start = format!("variation = {variation}\ndamping = {damping}\nintegration_method = '{method}'");
    let (mut run, step) = (Run::of::<Arm>(&start, 0.0), std::f64::consts::PI / steps_a_period);
    run.run((150.0 / step).ceil() as usize * finer, step / finer as f64);
    (run.get("x[1]").hypot(run.get("x[2]")) / 1e-9).ln()
}

#[test]
fn growth_that_comes_of_equations_that_vary_is_right_in_steps_of_a_third_of_their_period() {
    for arm in [(0.2, 0.01), (0.5, 0.02), (0.2, 0.001)] {
        for steps_a_period in [3.0, 5.0, 20.0] {
            let exact = growth_of_arm(arm, "explicit", steps_a_period, 40);
            for method in METHODS {
                let found = growth_of_arm(arm, method, steps_a_period, 1);
                let off = found / exact - 1.0;
                println!("{arm:?}, {method}, {steps_a_period} steps a period: {found:.3}, {off:.4}");
                assert!(off.abs() < 0.01, "{arm:?}, {method}, {steps_a_period} steps a period: {found}, not {exact}");
            }
        }
    }
}
