//! Stiff systems: accurate at long steps, by the method that a user chooses or that is chosen for them.

use adaptive_fmu::error::StepError;
use adaptive_fmu::execution::Execution;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::system::{Kind, NoStructure, Registry, Section, System};
use common::described::{model, open_description};
use common::models::Run;
use common::stiff::*;
use common::{OK, Unit};

const METHODS: [&str; 2] = ["stiff", "automatic"];

/// True if the stiff method is in force after a step.
fn is_stiff(execution: &Execution) -> bool {
    let variables = execution.model().variables();
    execution.block().integers[variables.index(variables.find("#stiff").unwrap())] != 0
}

fn run_of<M: System<Structure = NoStructure>>(method: &str, start: &str) -> Run {
    evaluations();
    Run::of::<M>(&format!("integration_method = \"{method}\"\n{start}"), 0.0)
}

#[test]
fn van_der_pols_stiff_oscillator_meets_its_published_values() {
    // Hairer and Wanner's test set, http://www.unige.ch/~hairer/testset/testset.html, at t = 1, 2, 3, 4.
    let published = [
        [-1.86364625480813, 0.753543086543546],
        [1.706167732170456, -0.8928097010248257],
        [-1.510606936744095, 1.178380000730945],
        [1.194414677695905, -2.799585996540082],
    ];
    for method in METHODS {
        for (tolerance, accuracy) in [(1e-6, 1e-4), (1e-9, 1e-7)] {
            let mut run = run_of::<VanDerPol>(method, &format!("relative_tolerance = {tolerance:e}"));
            for x in published {
                run.run(100, 0.01);
                for (name, value) in ["x[1]", "x[2]"].into_iter().zip(x) {
                    let error = (run.get(name) - value).abs();
                    assert!(error < accuracy, "{method}, tolerance {tolerance:e}: {name} is wrong by {error:e}");
                }
            }
        }
    }
}

#[test]
fn robertsons_reaction_meets_its_published_values() {
    // The same test set, at t = 1e11.
    let published = [0.2083340149701255e-7, 0.8333360770334713e-13, 0.999999979166505];
    for method in METHODS {
        let mut run = run_of::<Robertson>(method, "relative_tolerance = 1e-9");
        run.step(1.0);
        run.step(1e5);
        run.step(1e11 - 1.0 - 1e5);
        // Two of the values are small parts of what is tolerated.
        for (name, value) in ["y[1]", "y[2]", "y[3]"].into_iter().zip(published) {
            assert!((run.get(name) - value).abs() < 2e-9, "{method}: {name} = {}, not {value}", run.get(name));
        }
    }
}

#[test]
fn the_stiff_method_has_order_five() {
    // Loose tolerance: every communication step is one substep, so the error is that of the method.
    let error = |steps: usize| {
        let mut run = run_of::<Smooth>("stiff", "relative_tolerance = 1e-2");
        run.run(steps, 2.0 / steps as f64);
        let exact = 2.0_f64.sin().exp();
        (run.get("x[1]") / exact - 1.0).hypot(run.get("x[2]") * exact - 1.0)
    };
    for steps in [40, 80, 160] {
        let observed = (error(steps) / error(2 * steps)).log2();
        assert!((4.8..5.2).contains(&observed), "{steps} steps: order {observed}");
    }
}

#[test]
fn the_error_of_the_stiff_method_follows_the_tolerance() {
    let errors = [1e-4, 1e-6, 1e-8, 1e-10].map(|tolerance| {
        let mut run = run_of::<Smooth>("stiff", &format!("relative_tolerance = {tolerance:e}"));
        run.run(1, 10.0);
        let error = (run.get("x[1]") / 10.0_f64.sin().exp() - 1.0).abs();
        assert!(error < 100.0 * tolerance, "tolerance {tolerance:e}: error {error:e}");
        error
    });
    assert!(errors.windows(2).all(|pair| pair[1] < pair[0] / 10.0), "{errors:?}");
}

#[test]
fn one_substep_falls_onto_the_slow_solution_however_stiff_the_fall() {
    for (stiffness, accuracy) in [(1e8, 1e-6), (1e10, 1e-8), (1e12, 1e-10)] {
        let mut run = run_of::<Slope>("stiff", &format!("stiffness = {stiffness:e}\noffset = 0.5"));
        run.step(0.1);
        let error = (run.get("x") - 0.1_f64.cos()).abs();
        assert!(error < accuracy, "stiffness {stiffness:e}: off by {error:e}");
        let evaluations = evaluations();
        // Those of the start, the stages, and where the indicator is looked at within the substep: a second one takes nine.
        assert!(evaluations <= 27, "{evaluations} evaluations are those of one substep");
    }
}

#[test]
fn a_stiff_lag_follows_a_ramped_input_exactly() {
    for (method, stiffness) in [("stiff", 1e3), ("stiff", 1e6), ("automatic", 1e6)] {
        let mut run = run_of::<Lag>(method, &format!("stiffness = {stiffness:e}\nrelative_tolerance = 1e-9"));
        for k in 0..20 {
            run.set("u", 0.1 * 0.01 * f64::from(k));
            run.0.set_input_slope(0, 0.1);
            run.step(0.01);
            let t = 0.01 * f64::from(k + 1);
            // x' = λ (b t − x) from 0: x = b t − b/λ + b/λ exp(−λ t).
            let exact = 0.1 * (t - (1.0 - (-stiffness * t).exp()) / stiffness);
            assert!((run.get("x") - exact).abs() < 1e-9, "{method}, {stiffness:e}, t = {t}: {}", run.get("x") - exact);
        }
    }
}

#[test]
fn the_automatic_choice_saves_a_hundred_times_the_evaluations() {
    let evaluations_of = |method: &str| {
        let mut run = run_of::<VanDerPol>(method, "");
        run.run(1, 1.0);
        evaluations()
    };
    let [explicit, automatic] = ["explicit", "automatic"].map(evaluations_of);
    assert!(automatic < 12_000, "{automatic} evaluations");
    assert!(explicit > 100 * automatic, "{explicit} explicit ones for {automatic}");
}

#[test]
fn a_system_that_is_stiff_for_a_while_goes_by_the_stiff_method_for_a_while() {
    let mut run = run_of::<Valve>("automatic", "");
    let mut phase = |stiffness: f64| {
        run.set("stiffness", stiffness);
        run.run(5, 1.0);
        evaluations();
        run.run(5, 1.0);
        (is_stiff(&run.0), evaluations())
    };
    for _ in 0..3 {
        assert!(!phase(1.0).0, "explicit");
        let (stiff, evaluations) = phase(1e6);
        assert!(stiff && evaluations < 20_000, "{evaluations} evaluations, where 1e7 would be needed");
    }
    assert!(!phase(1.0).0, "explicit again");
}

#[test]
fn what_is_asked_for_is_done() {
    for (method, stiff) in [("explicit", false), ("stiff", true)] {
        let mut run = run_of::<Valve>(method, "");
        run.set("stiffness", 1e3);
        for _ in 0..10 {
            run.step(0.1);
            assert_eq!(is_stiff(&run.0), stiff, "{method}");
        }
    }
}

#[test]
fn short_communication_steps_never_bring_the_stiff_method_in() {
    // One or two explicit substeps each: there is nothing to save.
    let mut run = run_of::<Valve>("automatic", "");
    run.set("stiffness", 400.0);
    for _ in 0..3000 {
        run.step(0.01);
        assert!(!is_stiff(&run.0));
    }
}

#[test]
fn a_state_event_is_located_as_accurately_by_the_stiff_method() {
    for method in ["explicit", "stiff", "automatic"] {
        let mut run = run_of::<Slope>(method, "level = 0.5\nstiffness = 1e5\nrelative_tolerance = 1e-10");
        run.run(4, 0.3);
        let passed = run.get("passed");
        assert!((passed - 0.5_f64.acos()).abs() < 1e-9, "{method}: {}", passed - 0.5_f64.acos());
    }
}

#[test]
fn time_events_are_met_by_the_stiff_method() {
    let mut run = run_of::<Lag>("stiff", "stiffness = 50\nrelative_tolerance = 1e-9");
    let mut exact = 0.0;
    for k in 1..=5 {
        run.step(2.0 * INTERVAL);
        for level in [2 * k - 2, 2 * k - 1].map(f64::from) {
            exact = level + (exact - level) * (-50.0 * INTERVAL).exp();
        }
        assert!((run.get("x") - exact).abs() < 1e-8, "after {} events: {}", 2 * k, run.get("x") - exact);
    }
    assert_eq!(run.get("events"), 10.0);
}

static REGISTRY: Registry = &[Kind::of::<VanDerPol>(), Kind::of::<Many>()];

fn van_der_pol() -> Unit {
    let unit = Unit::of(REGISTRY, "name = 'Stiff'\nmodel = 'van-der-pol'\ndescription = ''\n");
    unit.start(0.0);
    unit
}

#[test]
fn a_saved_state_continues_bit_for_bit_in_a_stiff_phase_and_on_its_way_into_it() {
    const STEP: f64 = 1e-5;
    let unit = van_der_pol();
    // The choice falls within the first hundred steps or so; each of the states before and after it continues alike.
    for k in 0..200 {
        let (state, bytes) = (unit.save(), unit.fingerprint());
        let go_on = |unit: &Unit| {
            unit.run(f64::from(k) * STEP, 1, STEP);
            unit.run(f64::from(k + 1) * STEP, 1, 0.01);
            unit.fingerprint()
        };
        let first = go_on(&unit);
        assert_eq!(unit.restore(state), OK);
        assert_eq!(go_on(&unit), first, "step {k}");
        let other = van_der_pol();
        assert_eq!(other.restore(other.deserialise(&bytes).1), OK);
        assert_eq!(go_on(&other), first, "step {k}, in a unit that never ran");
        assert_eq!(unit.restore(state), OK);
        unit.run(f64::from(k) * STEP, 1, STEP);
        assert_eq!(unit.free(state), OK);
    }
    evaluations();
    unit.run(200.0 * STEP, 1, 0.1);
    let evaluations = evaluations();
    assert!(evaluations < 2_000, "{evaluations} evaluations, where the explicit method needs 1e5");
}

#[test]
fn divergence_is_reported_by_the_stiff_method_too() {
    let mut run = run_of::<Growth>("stiff", "rate = 10");
    let error = run.failure(10.0);
    let StepError::Diverged { variable, time, .. } = &error else { panic!("{error}") };
    assert_eq!(variable, "x");
    // exp(10 t) passes 1e12 at 2.763 s.
    assert!((2.7..4.0).contains(time), "{error}");
    assert_eq!([run.get("x"), run.0.time()], [1.0, 0.0], "as before the step");
}

#[test]
fn a_step_whose_equations_are_singular_is_taken_in_shorter_ones() {
    // I/(γh) − J is zero for h = 1.
    let mut run = run_of::<Growth>("stiff", &format!("rate = {}", 1.0 / 0.21193756319429014));
    run.step(1.0);
    let exact = (1.0_f64 / 0.21193756319429014).exp();
    assert!((run.get("x") / exact - 1.0).abs() < 1e-5, "{}", run.get("x") / exact - 1.0);
}

#[test]
fn a_derivative_that_is_no_number_is_named_where_the_stiff_method_was_asked_for() {
    // The derivative of √level at zero is infinite.
    let error = run_of::<Tank>("stiff", "start = 0").failure(1.0);
    assert!(matches!(error, StepError::NoJacobian { .. }), "{error}");
    let text = error.to_string();
    ["der(level)", "t = 0", "integration_method"].iter().for_each(|part| assert!(text.contains(part), "{text}"));
    let mut run = run_of::<Tank>("automatic", "start = 0");
    run.step(1.0);
    assert_eq!(run.get("level"), 0.0);
}

#[test]
fn a_trial_that_gives_no_number_makes_the_step_shorter() {
    let mut run = run_of::<Cooling>("stiff", "");
    assert_eq!(no_numbers(), 0);
    run.step(100.0);
    assert!(no_numbers() > 0, "a stage was below zero");
    assert!((run.get("x") - 1.0).abs() < 1e-6, "{}", run.get("x"));
}

#[test]
fn an_empty_tank_ends_in_an_error() {
    let error = run_of::<Tank>("stiff", "").failure(3.0);
    assert!(matches!(error, StepError::StepTooSmall { .. } | StepError::NoJacobian { .. }), "{error}");
    assert!(error.to_string().contains("level"), "{error}");
}

fn many(states: usize) -> Execution {
    let text = format!("name = 'Many'\nmodel = 'many'\ndescription = ''\nstructure = {{ states = {states} }}\n");
    let model = Model::from_description(Description::read(&text).unwrap(), REGISTRY).unwrap();
    let mut execution = Execution::new(model);
    execution.initialise().unwrap();
    execution
}

#[test]
fn large_systems_stay_explicit_while_the_dense_method_would_not_pay() {
    evaluations();
    let mut execution = many(1000);
    // Ten explicit substeps or so each: far less work than one decomposition of 1000 equations.
    (0..20).for_each(|k| execution.step(f64::from(k) * 0.02, 0.02).map(|_| ()).unwrap());
    assert!(!is_stiff(&execution), "{} evaluations", evaluations());
}

#[test]
fn a_system_of_fifty_states_goes_by_the_stiff_method_when_that_pays() {
    evaluations();
    let mut execution = many(50);
    (0..200).for_each(|k| execution.step(f64::from(k), 1.0).map(|_| ()).unwrap());
    let evaluations = evaluations();
    // The explicit method would take 3e5: six every 3.3 ms.
    assert!(is_stiff(&execution) && evaluations < 20_000, "{evaluations} evaluations");
    let error = (execution.block().reals[execution.model().variables().reals(Section::State)][0] - 200_f64.cos()).abs();
    assert!(error < 2e-3, "within its lag of 1 ms: {error}");
}

#[test]
fn systems_too_large_for_the_dense_method_have_no_choice() {
    let offered = |states| many(states).model().variables().find("integration_method").is_some();
    assert!(offered(2000));
    assert!(!offered(2001));
}

/// Pitch and yaw of the twin rotor after each step, from a pitch at rest, with these controls.
fn twin_rotor(method: i32, width: f64, step: f64, (pitch, controls): (f64, [f64; 2])) -> Vec<[f64; 2]> {
    let mut run = Run(Execution::new(model(&open_description("TwinRotor")).unwrap()));
    run.set("friction_width", width);
    run.set("x0[1]", pitch);
    run.set_integer("integration_method", method);
    run.0.initialise().unwrap();
    let row = |_| {
        ["u[1]", "u[2]"].into_iter().zip(controls).for_each(|(u, value)| run.set(u, value));
        run.step(step);
        [run.get("x[1]"), run.get("x[3]")]
    };
    (0..(2.0 / step).clamp(1.0, 60.0) as usize).map(row).collect()
}

#[test]
fn friction_that_is_nearly_a_sign_lets_go_in_long_steps_too() {
    let (automatic, stiff) = (1, 3);
    for start in [(0.9, [0.0, 0.0]), (0.0, [0.02, 0.5]), (-0.5, [0.4, -0.3])] {
        for width in [1e-3, 1e-5, 1e-7, 1e-8, 1e-9] {
            for step in [1e-3, 0.01, 0.1, 0.5, 1.0] {
                let [expected, found] = [automatic, stiff].map(|method| twin_rotor(method, width, step, start));
                let pairs = expected.as_flattened().iter().zip(found.as_flattened());
                let apart = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(apart < 1e-4, "{start:?}, width {width:e}, steps of {step} s: {apart:e} apart");
            }
        }
    }
}
