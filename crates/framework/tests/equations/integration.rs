//! Accuracy of a communication step, against exact solutions.

use adaptive_fmu::system::*;
use common::models::Run;

/// q'' = −q from q = 1 at rest: q = cos t.
struct Oscillator {
    q: VectorOf<State>,
}

impl System for Oscillator {
    type Structure = NoStructure;
    const NAME: &'static str = "oscillator";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Oscillator { q: d.state(vector("q", 2, "position and velocity").output()) })
    }
    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        v.set(self.q, [t.cos(), -t.sin()]);
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let [q, w] = v.array(self.q);
        dx.set(self.q, [w, -q]);
    }
}

/// Error at t = 10 of the oscillator with this tolerance and communication step.
fn oscillator_error(tolerance: f64, steps: usize) -> f64 {
    let mut run = Run::of::<Oscillator>(&format!("relative_tolerance = {tolerance:e}"), 0.0);
    run.run(steps, 10.0 / steps as f64);
    assert!((run.0.time() - 10.0).abs() < 1e-12);
    (run.get("q[1]") - 10.0_f64.cos()).hypot(run.get("q[2]") + 10.0_f64.sin())
}

#[test]
fn the_error_of_an_oscillator_follows_the_tolerance() {
    for steps in [1, 10, 100] {
        let errors = [1e-4, 1e-6, 1e-8, 1e-10].map(|tolerance| (tolerance, oscillator_error(tolerance, steps)));
        for (tolerance, error) in errors {
            // The error of a substep is within the tolerance, and at most some 100 substeps add up on this orbit.
            assert!(error < 100.0 * tolerance, "{steps} steps, tolerance {tolerance:e}: error {error:e}");
        }
    }
    let of_one_step = [1e-4, 1e-6, 1e-8, 1e-10].map(|tolerance| oscillator_error(tolerance, 1));
    for pair in of_one_step.windows(2) {
        assert!(pair[1] < pair[0] / 20.0, "a hundredth of the tolerance shrinks the error: {of_one_step:?}");
    }
}

/// x' = |t − kink|
struct Kinked {
    kink: ScalarOf<Parameter>,
    x: ScalarOf<State>,
}

impl System for Kinked {
    type Structure = NoStructure;
    const NAME: &'static str = "kinked";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Kinked { kink: d.parameter(scalar("kink", "where it is")), x: d.state(scalar("x", "integral")) })
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.x] = (t - v[self.kink]).abs();
    }
}

#[test]
fn a_kink_hides_an_error_at_few_places_of_a_step_only() {
    const PLACES: usize = 500;
    for h in [0.01, 0.03, 0.1, 1.0] {
        let error = |k: usize| {
            let kink = h * (k as f64 + 0.5) / PLACES as f64;
            let mut run = Run::of::<Kinked>(&format!("kink = {kink}\nintegration_method = 'explicit'"), 0.0);
            run.step(h);
            (run.get("x") - 0.5 * (kink.powi(2) + (h - kink).powi(2))).abs() / run.get("relative_tolerance")
        };
        let errors: Vec<_> = (0..PLACES).map(error).collect();
        let (large, worst) =
            (errors.iter().filter(|error| **error > 10.0).count(), errors.iter().copied().fold(0.0, f64::max));
        println!("step {h}: {large} of {PLACES} above 10, worst {worst:.1}");
        assert!(50 * large <= PLACES, "step {h}: {large} errors of {PLACES} are above ten times the tolerance");
        assert!(worst < 50.0, "step {h}: an error of {worst} tolerances");
    }
}

#[test]
fn short_communication_steps_give_the_error_of_a_method_of_order_five() {
    // Loose tolerance: every communication step is one substep, so the error is that of the method, h⁵.
    let error = |steps| oscillator_error(1e-2, steps);
    let observed = (error(40) / error(80)).log2();
    assert!((4.5..6.5).contains(&observed), "order {observed}");
}

#[test]
fn a_masters_tolerance_tightens_the_models_own_and_never_loosens_it() {
    let with = |own: &str, masters: f64| {
        let mut run = Run::of::<Oscillator>(own, 0.0);
        run.0.set_tolerance(masters);
        run.run(3, 2.0);
        run.get("q[1]").to_bits()
    };
    let (own, tight) = ("relative_tolerance = 1e-6", "relative_tolerance = 1e-9");
    assert_eq!(with(own, 1e-9), with(tight, 0.0));
    assert_eq!(with(own, 1e-2), with(own, 0.0));
    assert_ne!(with(own, 0.0), with(tight, 0.0));
}

#[test]
fn a_simulation_may_start_at_any_time() {
    for start in [-7.25, 0.0, 1234.5] {
        let mut run = Run::of::<Oscillator>("relative_tolerance = 1e-10", start);
        run.run(10, 0.5);
        assert!((run.get("q[1]") - (start + 5.0).cos()).abs() < 1e-8, "from {start}");
    }
}

/// q' = u (the integral of the input), p' = −p + u, and the input fed through.
struct Inputs {
    u: VectorOf<Input>,
    q: ScalarOf<State>,
    p: ScalarOf<State>,
    y: ScalarOf<Signal>,
}

impl System for Inputs {
    type Structure = NoStructure;
    const NAME: &'static str = "inputs";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Inputs {
            u: d.input(vector("u", 1, "input")),
            q: d.state(scalar("q", "integral")),
            p: d.state(scalar("p", "lag")),
            y: d.output(scalar("y", "the input itself")),
        })
    }
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        y[self.y] = v[self.u][0];
    }
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.q] = v[self.u][0];
        dx[self.p] = v[self.u][0] - v[self.p];
    }
}

/// The lag p' = −p + a + b s, from p0 at s = 0.
fn lag(p0: f64, a: f64, b: f64, s: f64) -> f64 {
    (p0 - a + b) * (-s).exp() + a - b + b * s
}

/// The ramp that the input follows.
fn ramp(t: f64) -> f64 {
    0.7 - 0.4 * t
}

const H: f64 = 0.25;
const STEPS: usize = 12;

/// Steps with the input set to the ramp at each communication point; `before` prepares each step.
fn sampled_ramp(start: &str, before: impl Fn(&mut Run, usize)) -> Run {
    let mut run = Run::of::<Inputs>(&format!("relative_tolerance = 1e-11\n{start}"), 0.0);
    for k in 0..STEPS {
        run.set("u[1]", ramp(k as f64 * H));
        before(&mut run, k);
        run.step(H);
    }
    run
}

fn assert_near(value: f64, expected: f64, what: &str) {
    assert!((value - expected).abs() < 1e-9, "{what}: {value} is not {expected}");
}

#[test]
fn sampled_inputs_are_constant_exactly() {
    let run = sampled_ramp("", |_, _| {});
    let (mut q, mut p) = (0.0, 0.0);
    for k in 0..STEPS {
        let u = ramp(k as f64 * H);
        q += H * u;
        p = lag(p, u, 0.0, H);
    }
    assert_near(run.get("q"), q, "integral");
    assert_near(run.get("p"), p, "lag");
    assert_near(run.get("y"), ramp((STEPS - 1) as f64 * H), "feedthrough");
}

#[test]
fn input_derivatives_make_a_linear_input_exact() {
    let run = sampled_ramp("", |run, _| run.0.set_input_slope(0, -0.4));
    let t = STEPS as f64 * H;
    assert_near(run.get("q"), 0.7 * t - 0.2 * t * t, "integral");
    assert_near(run.get("p"), lag(0.0, 0.7, -0.4, t), "lag");
    assert_near(run.get("y"), ramp(t), "feedthrough at the end of the step");
    assert_eq!(run.get("u[1]"), ramp((STEPS - 1) as f64 * H), "the input reads back what was set");
}

#[test]
fn extrapolation_makes_a_linear_input_exact_after_its_first_step() {
    let run = sampled_ramp("input_handling = \"extrapolate\"", |_, _| {});
    // One value gives no line, so the first step has a zero-order hold.
    let (t, q1, p1) = (STEPS as f64 * H, H * ramp(0.0), lag(0.0, ramp(0.0), 0.0, H));
    assert_near(run.get("q"), q1 + 0.7 * (t - H) - 0.2 * (t * t - H * H), "integral");
    assert_near(run.get("p"), lag(p1, ramp(H), -0.4, t - H), "lag");
    assert_near(run.get("y"), ramp(t), "feedthrough");
}

#[test]
fn extrapolation_knows_steps_of_different_lengths() {
    let mut run = Run::of::<Inputs>("input_handling = \"extrapolate\"", 0.0);
    let mut t = 0.0;
    for step in [0.1, 0.4, 0.05, 1.0] {
        run.set("u[1]", ramp(t));
        run.step(step);
        t += step;
        let expected = if t == 0.1 { ramp(0.0) } else { ramp(t) };
        assert_near(run.get("y"), expected, "feedthrough");
    }
}

#[test]
fn interpolation_follows_a_linear_input_one_step_late() {
    let run = sampled_ramp("input_handling = \"interpolate\"", |_, _| {});
    // The first step has no previous value; then the ramp of the step before.
    let (late, q1) = ((STEPS - 1) as f64 * H, H * ramp(0.0));
    assert_near(run.get("q"), q1 + 0.7 * late - 0.2 * late * late, "integral");
    assert_near(run.get("p"), lag(lag(0.0, ramp(0.0), 0.0, H), ramp(0.0), -0.4, late), "lag");
    assert_near(run.get("y"), ramp(late), "feedthrough: the value that was set");
}

#[test]
fn a_masters_input_derivatives_win_over_input_handling_and_hold_for_one_step() {
    for handling in ["hold", "extrapolate", "interpolate"] {
        let start = format!("input_handling = \"{handling}\"");
        let mut run = Run::of::<Inputs>(&start, 0.0);
        run.set("u[1]", 1.0);
        run.step(H);
        run.set("u[1]", 2.0);
        run.0.set_input_slope(0, 10.0);
        let before = run.get("q");
        run.step(H);
        assert_near(run.get("q") - before, 2.0 * H + 5.0 * H * H, handling);
        assert_near(run.get("y"), 2.0 + 10.0 * H, handling);
        let before = run.get("q");
        run.step(H);
        // The input stays 2: by a zero-order hold, on the line through 2 and 2, or ramped from 2 to 2.
        assert_near(run.get("q") - before, 2.0 * H, handling);
    }
}

/// x' = −λ x + u through its own exact step. It reports (h / limit)² as its error, and counts the accepted substeps.
struct OwnStep {
    limit: ScalarOf<Parameter>,
    shortest: ScalarOf<Parameter>,
    u: ScalarOf<Input>,
    x: ScalarOf<State>,
    strides: ScalarOf<State>,
    longest: ScalarOf<State>,
}

const LAMBDA: f64 = 3.0;

impl System for OwnStep {
    type Structure = NoStructure;
    const NAME: &'static str = "own-step";
    const DOCUMENTATION: &'static str = "";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(OwnStep {
            limit: d.parameter(scalar("limit", "substep with error 1; 0: no step is possible").start(1e9)),
            shortest: d.parameter(scalar("shortest", "substep that pays")),
            u: d.input(scalar("u", "input")),
            x: d.state(scalar("x", "state")),
            strides: d.state(scalar("strides", "strides taken")),
            longest: d.state(scalar("longest", "the longest of them")),
        })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.x] = S::from(1.0);
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        dx[self.x] = v[self.x] * -LAMBDA + v[self.u];
    }
    fn own_step(&self) -> Option<&dyn adaptive_fmu::system::OwnStep> {
        Some(self)
    }
}

impl adaptive_fmu::system::OwnStep for OwnStep {
    fn advance(&self, stride: Stride, v: &mut Point) -> bool {
        let slope = stride.slopes.first().copied().unwrap_or(0.0);
        let (gain, rate) = (v[self.u] / LAMBDA - slope / (LAMBDA * LAMBDA), slope / LAMBDA);
        let (start, h) = (v[self.x], stride.length);
        let at = |h: f64| (start - gain) * (-LAMBDA * h).exp() + gain + rate * h;
        v[self.x] = at(h);
        v[self.strides] += 1.0;
        v[self.longest] = v[self.longest].max(h);
        stride.whole.copy_from_slice(&[at(2.0 * h), v[self.strides] + 1.0, 2.0 * h]);
        v[self.limit] > 0.0
    }
    fn pays(&self, h: f64, _relative_tolerance: f64, v: &Values<f64>) -> bool {
        h >= v[self.shortest]
    }
    fn conclude(&self, whole: &Values<f64>, _tolerance: (&[f64], f64), v: &mut Point) -> ErrorEstimate {
        assert!((whole[self.x] - v[self.x]).abs() < 1e-12);
        ErrorEstimate { scaled: (whole[self.longest] / v[self.limit]).powi(2), order: 2 }
    }
}

#[test]
fn a_system_that_steps_itself_exactly_takes_any_step_at_once() {
    let mut run = Run::of::<OwnStep>("", 0.0);
    run.step(4.0);
    assert_near(run.get("x"), (-4.0 * LAMBDA).exp(), "x");
    assert_eq!(run.get("strides"), 2.0);
}

#[test]
fn a_step_of_its_own_with_too_large_an_error_is_divided() {
    let mut run = Run::of::<OwnStep>("limit = 0.1", 0.0);
    run.run(3, 1.0);
    assert_near(run.get("x"), (-3.0 * LAMBDA).exp(), "x");
    assert!(run.get("longest") <= 0.05 + 1e-12, "{}", run.get("longest"));
    let strides = run.get("strides");
    assert!((60.0..=120.0).contains(&strides), "no more than twice as many as needed: {strides}");
}

#[test]
fn a_step_of_its_own_is_given_the_inputs_at_its_start_and_their_slopes() {
    for limit in ["limit = 1e9", "limit = 0.1"] {
        let mut run = Run::of::<OwnStep>(limit, 0.0);
        run.set("u", 2.0);
        run.0.set_input_slope(0, -1.5);
        run.step(1.0);
        // x = (1 − g) e^(−λt) + g + (b/λ) t with g = a/λ − b/λ², for u = a + b t.
        let gain = 2.0 / LAMBDA + 1.5 / (LAMBDA * LAMBDA);
        assert_near(run.get("x"), (1.0 - gain) * (-LAMBDA).exp() + gain - 1.5 / LAMBDA, limit);
        assert_eq!(run.get("u"), 2.0);
    }
}

#[test]
fn where_a_step_of_its_own_does_not_pay_or_is_impossible_a_general_method_goes_on() {
    // Too inaccurate, impossible, and of an error without bounds.
    for start in ["limit = 1e-4\nshortest = 1e-3", "limit = 0.0", "limit = 1e-200"] {
        let mut run = Run::of::<OwnStep>(&format!("{start}\nrelative_tolerance = 1e-11"), 0.0);
        run.run(2, 1.0);
        assert_near(run.get("x"), (-2.0 * LAMBDA).exp(), start);
        assert_eq!(run.get("strides"), 0.0, "{start}");
    }
}

#[test]
fn a_system_that_steps_itself_can_be_integrated_by_a_general_method_instead() {
    for method in ["explicit", "stiff"] {
        let mut run = Run::of::<OwnStep>(&format!("integration_method = '{method}'\nrelative_tolerance = 1e-11"), 0.0);
        run.step(1.0);
        assert_near(run.get("x"), (-LAMBDA).exp(), method);
        assert_eq!(run.get("strides"), 0.0);
    }
}
