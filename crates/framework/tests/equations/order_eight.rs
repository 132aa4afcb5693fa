//! The explicit method of order 8: taken by itself on long ways, with less work, and as accurate as was asked for.

use std::cell::Cell;

use adaptive_fmu::system::*;
use common::models::Run;

thread_local! {
    static EVALUATIONS: Cell<usize> = const { Cell::new(0) };
}

/// Lightly damped oscillators, like those of the adaptation of L1 controllers: q'' = −2 d q' − ω² q, each from q = 1 at
/// rest.
struct Oscillators {
    frequencies: VectorOf<Parameter>,
    damping: ScalarOf<Parameter>,
    q: VectorOf<State>,
    w: VectorOf<State>,
}

const OSCILLATORS: usize = 2;

impl System for Oscillators {
    type Structure = NoStructure;
    const NAME: &'static str = "oscillators";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Oscillators {
            frequencies: d.parameter(vector("frequencies", OSCILLATORS, "undamped ones").start(1.0)),
            damping: d.parameter(scalar("damping", "decay rate")),
            q: d.state(vector("q", OSCILLATORS, "position").start(1.0)),
            w: d.state(vector("w", OSCILLATORS, "velocity")),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        EVALUATIONS.with(|count| count.set(count.get() + 1));
        for i in 0..OSCILLATORS {
            let (omega, d) = (v[self.frequencies][i], v[self.damping]);
            let (q, w) = (v[self.q][i], v[self.w][i]);
            dx[self.q][i] = w;
            dx[self.w][i] = -d * w * 2.0 - omega * omega * q;
        }
    }
}

/// Evaluations of 50 steps of this length, and the largest error at their end in units of the tolerance.
fn run(method: &str, frequencies: [f64; OSCILLATORS], damping: f64, tolerance: f64, step: f64) -> (usize, f64) {
    let text = format!(
        "frequencies = {frequencies:?}\ndamping = {damping}\nrelative_tolerance = {tolerance:e}\n\
         integration_method = '{method}'"
    );
    let mut run = Run::of::<Oscillators>(&text, 0.0);
    let before = EVALUATIONS.with(Cell::get);
    run.run(50, step);
    let (t, mut worst) = (50.0 * step, 0.0_f64);
    for (i, omega) in frequencies.into_iter().enumerate() {
        let damped = (omega * omega - damping * damping).sqrt();
        let exact = (-damping * t).exp() * ((damped * t).cos() + damping / damped * (damped * t).sin());
        worst = worst.max((run.get(&format!("q[{}]", i + 1)) - exact).abs());
    }
    (EVALUATIONS.with(Cell::get) - before, worst / tolerance)
}

/// Pseudorandom numbers in [0, 1).
fn numbers() -> impl FnMut() -> f64 {
    let mut state = 1_u64;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

#[test]
fn long_ways_of_oscillations_take_less_work_and_are_as_accurate() {
    let mut random = numbers();
    for _ in 0..20 {
        let frequency = 10.0_f64.powf(1.0 + 3.0 * random());
        let frequencies = [frequency, frequency * (0.2 + 0.6 * random())];
        let (damping, tolerance) = (frequency * 1e-3 * random(), 10.0_f64.powf(-4.0 - 4.0 * random()));
        // 20 to 100 radians of the faster one between communication points.
        let step = (20.0 + 80.0 * random()) / frequency;
        let case = format!("{frequencies:?}, damping {damping}, tolerance {tolerance:e}, step {step}");
        let (automatic, error) = run("automatic", frequencies, damping, tolerance, step);
        let (of_5, error_of_5) = run("explicit", frequencies, damping, tolerance, step);
        println!("{case}: {automatic} and {of_5} evaluations, {error:.1} and {error_of_5:.1} tolerances");
        assert!(automatic * 100 < of_5 * 85, "{case}: {automatic} evaluations, {of_5} by order 5 alone");
        assert!(error < error_of_5.max(100.0), "{case}: {error} tolerances, {error_of_5} by order 5 alone");
    }
}

#[test]
fn short_ways_are_left_to_order_five() {
    let mut random = numbers();
    for _ in 0..10 {
        let frequency = 10.0_f64.powf(1.0 + 3.0 * random());
        let step = 0.3 * random() / frequency;
        let [automatic, of_5] =
            ["automatic", "explicit"].map(|method| run(method, [frequency, frequency], 0.0, 1e-6, step).0);
        assert_eq!(automatic, of_5, "{frequency} rad/s, steps of {step} s");
    }
}
