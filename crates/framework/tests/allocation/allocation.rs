//! Steps don't allocate: fmi2SetReal, fmi2DoStep, fmi2GetReal, and all of model exchange. Steps that apply parameters
//! or log messages allocate no more than docs/internals.md states.

use adaptive_fmu::fmi2::types::*;
use adaptive_fmu::library;
use adaptive_fmu::system::{Causality, Kind, Registry, Variability};
use adaptive_fmu_library::fmi2_functions::*;
use common::described::open_description;
use common::loops::whole;
use common::pages;
use common::stiff::{Valve, evaluations};
use common::systems::Ball;
use common::{OK, Unit, description, description_names};

use crate::COUNT;

fn references(unit: &Unit, wanted: impl Fn(Causality) -> bool) -> Vec<u32> {
    let variables = unit.model.variables().visible();
    let reals = variables.filter(|element| element.variable.is_real() && wanted(element.variable.causality));
    reals.map(|element| unit.reference(&element.name())).collect()
}

/// Variables that aren't Real: Integers, with choices, and Booleans.
struct Others {
    integers: Vec<u32>,
    booleans: Vec<u32>,
}

impl Others {
    fn of(unit: &Unit) -> Self {
        let others = unit.model.variables().visible().filter(|element| !element.variable.is_real());
        let references: Vec<u32> = others.map(|element| unit.reference(&element.name())).collect();
        // Value references are unique over all types, and reading one as another type is refused.
        let is_integer = |r: &u32| unsafe { fmi2GetInteger(unit.component, std::ptr::from_ref(r), 1, &mut 0) } == OK;
        let (integers, booleans): (Vec<_>, Vec<_>) = references.into_iter().partition(is_integer);
        unit.messages();
        Others { integers, booleans }
    }

    fn get(&self, unit: &Unit, values: &mut [i32]) {
        let (c, values) = (unit.component, values.as_mut_ptr());
        unsafe {
            assert_eq!(fmi2GetInteger(c, self.integers.as_ptr(), self.integers.len(), values), OK);
            assert_eq!(fmi2GetBoolean(c, self.booleans.as_ptr(), self.booleans.len(), values), OK);
        }
    }
}

/// Allocations of each step but those that warn, of setting its inputs and of reading everything.
fn allocations(unit: &Unit, step: f64, steps: usize) -> [usize; 3] {
    let inputs = references(unit, |causality| causality == Causality::Input);
    let all = references(unit, |_| true);
    let (mut set, mut got) = (vec![0.0; inputs.len()], vec![0.0; all.len()]);
    let others = Others::of(unit);
    let mut got_others = vec![0; others.integers.len().max(others.booleans.len())];
    let mut sums = [0; 3];
    for k in 0..steps {
        // Inputs that change, as in a loop, and stay small, so that no unit diverges.
        set.iter_mut().enumerate().for_each(|(i, value)| *value = 0.01 * ((k + i) as f64).sin());
        let mut before = COUNT.get();
        let mut since = || COUNT.get() - std::mem::replace(&mut before, COUNT.get());
        assert_eq!(unit.set_reals(&inputs, &set), OK);
        let setting = since();
        assert_eq!(unit.step(k as f64 * step, step), OK);
        let stepping = since();
        // A warning, given once, is logged with what takes memory.
        let warned = !unit.messages().is_empty();
        since();
        assert_eq!(unit.get_reals(&all, &mut got), OK);
        others.get(unit, &mut got_others);
        let getting = since();
        if !warned {
            sums = [sums[0] + setting, sums[1] + stepping, sums[2] + getting];
        }
    }
    sums
}

#[test]
fn the_counter_counts() {
    let before = COUNT.get();
    std::hint::black_box(vec![1.0; 100]);
    assert_eq!(COUNT.get(), before + 1);
}

#[test]
fn a_step_allocates_nothing() {
    for name in description_names() {
        let unit = Unit::from_text(&open_description(&name));
        unit.start(0.0);
        let step = unit.model.description().experiment.step;
        assert_eq!(allocations(&unit, step, 300), [0; 3], "{name}: setting, stepping, getting");
        // Further instances share their working memory.
        for further in [1, 2].map(|_| Unit::from_text(&open_description(&name))) {
            further.start(0.0);
            assert_eq!(allocations(&further, step, 30), [0; 3], "{name}: a further instance");
        }
    }
}

#[test]
fn a_step_with_bounds_of_single_elements_allocates_nothing() {
    let text = open_description("L1NonlinearSiso").replace("theta_bound = [10.0]", "theta_bound = [[0.2, 0.5]]");
    let unit = Unit::from_text(&text);
    assert!(unit.model.variables().find("theta_bound[1,2]").is_some());
    unit.start(0.0);
    assert_eq!(allocations(&unit, 1e-3, 300), [0; 3]);
}

#[test]
fn a_step_with_changing_inputs_allocates_nothing() {
    for name in description_names() {
        for handling in [2, 3] {
            let unit = Unit::from_text(&open_description(&name));
            if unit.model.variables().find("input_handling").is_none() {
                continue;
            }
            assert_eq!(unit.set_integer("input_handling", handling), OK);
            unit.start(0.0);
            let step = unit.model.description().experiment.step;
            assert_eq!(allocations(&unit, step, 100), [0; 3], "{name}, handling {handling}");
        }
    }
}

#[test]
fn a_step_of_a_law_that_samples_or_does_not_allocates_nothing() {
    let mut known = 0;
    for (name, law) in description_names().into_iter().flat_map(|name| [(name.clone(), 2), (name, 3)]) {
        let unit = Unit::from_text(&open_description(&name));
        if unit.model.variables().find("law").is_none() {
            continue;
        }
        assert_eq!(unit.set_integer("law", law), OK);
        unit.enter(0.0);
        // Not every plant has a control for each state, which sampling needs.
        if unit.exit() != OK {
            assert!(unit.last_message().contains("law = sampled: must be continuous"), "{name}");
            continue;
        }
        known += 1;
        let step = unit.model.description().experiment.step;
        assert_eq!(allocations(&unit, step, 300), [0; 3], "{name}, law {law}");
    }
    assert!(known >= 5, "only {known} were stepped");
}

#[test]
fn a_step_by_the_stiff_method_or_of_fixed_length_allocates_nothing() {
    for (name, method) in description_names().into_iter().flat_map(|name| [(name.clone(), 3), (name, 4)]) {
        let unit = Unit::from_text(&open_description(&name));
        if unit.model.variables().find("integration_method").is_none() {
            continue;
        }
        assert_eq!(unit.set_integer("integration_method", method), OK);
        assert_eq!(unit.set_integer("fixed_steps", 10), OK);
        unit.start(0.0);
        let step = unit.model.description().experiment.step;
        assert_eq!(allocations(&unit, step, 100), [0; 3], "{name}, method {method}");
    }
}

static REGISTRY: Registry = &[Kind::of::<Valve>()];

#[test]
fn the_change_to_the_stiff_method_and_back_allocates_nothing() {
    let unit = Unit::of(REGISTRY, "name = 'Valve'\nmodel = 'valve'\ndescription = ''\n");
    unit.start(0.0);
    unit.run(0.0, 1, 0.1);
    for (phase, stiffness) in [1.0, 1e6, 1.0].into_iter().enumerate() {
        unit.put("stiffness", stiffness);
        let before = COUNT.get();
        evaluations();
        unit.run(0.1 + phase as f64, 10, 0.1);
        let evaluations = evaluations();
        assert_eq!(COUNT.get(), before, "stiffness {stiffness}");
        assert!(
            evaluations < 20_000,
            "{evaluations} evaluations, of which the explicit method takes 2e6 where it is stiff"
        );
    }
}

#[test]
fn a_step_of_a_composite_allocates_nothing() {
    let text = whole("3.2.1-cosine");
    for method in [1, 3] {
        let unit = Unit::from_text(&text);
        assert_eq!(unit.set_integer("integration_method", method), OK);
        unit.start(0.0);
        assert_eq!(allocations(&unit, 1e-3, 300), [0; 3], "integration method {method}");
        // Several in one go, once there is a place for what is between them.
        let (times, y) =
            ([0.3, 0.36, 0.42, 0.48].map(|t| [t, t + 0.02, t + 0.04, t + 0.06]), unit.reference("plant.y[1]"));
        let taken = times.map(|times| {
            let before = COUNT.get();
            let mut rows = [0.0; 3];
            // SAFETY: the instance is alive, and there is a row for each step.
            let taken =
                unsafe { adaptive_fmu_do_steps(unit.component, times.as_ptr(), 4, &raw const y, 1, rows.as_mut_ptr()) };
            (taken, COUNT.get() - before)
        });
        assert_eq!(taken[1..], [(3, 0); 3], "integration method {method}");
    }
    let unit = Unit::made(library::REGISTRY, &text, MODEL_EXCHANGE);
    unit.start(0.0);
    assert_eq!(allocations_of_exchange(&unit, 1e-3, 300), 0);
}

#[test]
fn a_step_with_events_allocates_nothing() {
    let square = description("ReferenceNonlinearSiso").replace("signal = \"cosine\"", "signal = \"square\"");
    let unit = Unit::from_text(&square);
    unit.start(0.0);
    // Two or three edges in each step; 138 until 300 s.
    assert_eq!(allocations(&unit, 6.0, 50), [0; 3]);
    assert_eq!(unit.get("half_periods[1]"), 138.0);
}

/// Allocations of steps in model exchange, with an event after each.
fn allocations_of_exchange(unit: &Unit, step: f64, steps: usize) -> usize {
    let (inputs, all) = (references(unit, |causality| causality == Causality::Input), references(unit, |_| true));
    let (mut set, mut got) = (vec![0.0; inputs.len()], vec![0.0; all.len()]);
    let (mut x, mut z) = (unit.states(), unit.indicators());
    let (mut dx, n, c) = (x.clone(), x.len(), unit.component);
    unit.settle();
    let before = COUNT.get();
    for k in 1..=steps {
        set.iter_mut().enumerate().for_each(|(i, value)| *value = 0.01 * ((k + i) as f64).sin());
        assert_eq!((unit.set_time(k as f64 * step), unit.set_reals(&inputs, &set)), (OK, OK));
        unsafe {
            assert_eq!(fmi2GetContinuousStates(c, x.as_mut_ptr(), n), OK);
            assert_eq!(fmi2GetDerivatives(c, dx.as_mut_ptr(), n), OK);
            x.iter_mut().zip(&dx).for_each(|(x, dx)| *x += 1e-3 * step * dx);
            assert_eq!(fmi2SetContinuousStates(c, x.as_ptr(), n), OK);
            assert_eq!(fmi2GetEventIndicators(c, z.as_mut_ptr(), z.len()), OK);
            assert_eq!(fmi2CompletedIntegratorStep(c, TRUE, &mut 0, &mut 0), OK);
            assert_eq!(unit.get_reals(&all, &mut got), OK);
            assert_eq!(fmi2EnterEventMode(c), OK);
        }
        unit.settle();
    }
    COUNT.get() - before
}

#[test]
fn model_exchange_allocates_nothing() {
    for name in description_names() {
        let unit = Unit::exchange_from_text(&open_description(&name));
        unit.start(0.0);
        let step = unit.model.description().experiment.step;
        assert_eq!(allocations_of_exchange(&unit, step, 300), 0, "{name}");
    }
    let ball = Unit::exchange_of::<Ball>("");
    ball.start(0.0);
    assert_eq!(allocations_of_exchange(&ball, 100.0, 300), 0, "with bounces");
    assert!(ball.get("bounces") > 2.0);
}

/// Number of a warning on the page.
const OF_A_WARNING: usize = 27;

/// Number of an FMU on the page.
fn documented(page: &str, name: &str) -> usize {
    let row = page
        .lines()
        .find_map(|line| line.strip_prefix(&format!("| `{name}` | ")))
        .map(|rest| rest.trim_end_matches(" |"));
    row.map_or(0, |count| count.parse().unwrap())
}

/// All tunable real parameters, with their values.
fn tunables(unit: &Unit) -> (Vec<u32>, Vec<f64>) {
    let tunable = unit.model.variables().visible().filter(|element| {
        let variable = element.variable;
        variable.is_real() && variable.causality == Causality::Parameter && variable.variability == Variability::Tunable
    });
    let references: Vec<u32> = tunable.map(|element| unit.reference(&element.name())).collect();
    let mut values = vec![0.0; references.len()];
    assert_eq!(unit.get_reals(&references, &mut values), OK);
    (references, values)
}

#[test]
fn a_step_that_takes_over_parameters_allocates_as_documented() {
    let (mut wrong, mut rows) = (Vec::new(), String::new());
    let page = pages::generated("docs/internals.md", "allocations");
    for name in description_names() {
        let unit = Unit::from_text(&open_description(&name));
        unit.start(0.0);
        let step = unit.model.description().experiment.step;
        unit.run(0.0, 5, step);
        let (references, values) = tunables(&unit);
        // Run twice: memory of the first time is not reused from then on.
        let counts = [5, 6].map(|k| {
            unit.messages();
            assert_eq!(unit.set_reals(&references, &values), OK);
            let before = COUNT.get();
            assert_eq!(unit.step(k as f64 * step, step), OK);
            COUNT.get() - before
        });
        if counts[1] > 0 {
            rows.push_str(&format!("| `{name}` | {} |\n", counts[1]));
        }
        let documented = documented(&page, &name);
        let right = counts.iter().all(|&count| count <= documented) && documented <= counts[1] + counts[1] / 4 + 2;
        if !right {
            wrong.push(format!("{name}: {counts:?}, {documented} by the page"));
        }
        // From then on nothing again.
        let before = COUNT.get();
        assert_eq!(unit.step(7.0 * step, step), OK);
        assert_eq!(COUNT.get(), before, "{name}: the step behind it");
    }
    print!("{rows}");
    if pages::updating() {
        let head = "| FMU | allocations of a step that takes over parameters |\n| --- | --- |\n";
        return pages::write("docs/internals.md", "allocations", &format!("{head}{rows}"));
    }
    assert!(wrong.is_empty(), "{wrong:#?}: with UPDATE_TABLES=1 the table is written anew");
}

#[test]
fn a_warning_allocates_no_more_than_documented() {
    assert!(
        std::fs::read_to_string(common::at_top("docs/internals.md"))
            .unwrap()
            .contains(&format!("{OF_A_WARNING} times at most"))
    );
    let mut most = 0;
    for (name, step) in [("L1ActuatedSiso", 0.05), ("L1TwoLinkRobot", 0.02), ("L1CoupledMimo", 0.05)] {
        let unit = Unit::new(name);
        unit.start(0.0);
        let (mut t, mut messages) = (0.0, 0);
        for k in 0..20 {
            unit.put("x[1]", if k < 10 { 0.0 } else { 0.5 });
            unit.put("r[1]", 0.3);
            let before = COUNT.get();
            assert_eq!(unit.step(t, step), OK, "{:?}", unit.messages());
            let count = COUNT.get() - before;
            t += step;
            let logged = unit.messages().len();
            assert!(count <= logged * OF_A_WARNING, "{name}: {count} for {logged} warnings");
            most = most.max(count.checked_div(logged).unwrap_or(0));
            messages += logged;
        }
        assert!(messages > 0, "{name} logs something");
    }
    println!("{most} a warning");
}
