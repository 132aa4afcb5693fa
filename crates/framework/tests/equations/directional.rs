//! Exact directional derivatives, against differences of the same equations.

use adaptive_fmu::execution::Execution;
use adaptive_fmu::fmi2::access::References;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::system::Section;
use adaptive_fmu_library::fmi2_functions::*;
use common::described::open_description;
use common::random::Random;
use common::systems::Root;
use common::{ERROR, OK, Unit, description_names};

/// Signals and derivatives with inputs and states moved by so much along a direction.
fn moved(execution: &Execution, knowns: &[u32], seed: &[f64], by: f64) -> Vec<f64> {
    let (model, mut block) = (execution.model(), execution.block().clone());
    for (&known, change) in knowns.iter().zip(seed) {
        block.reals[known as usize] += by * change;
    }
    let offsets = model.variables().offsets();
    model.equations().outputs(execution.time(), &mut block.reals, &block.integers, offsets);
    model.equations().derivatives(execution.time(), &mut block.reals, &block.integers, offsets);
    block.reals
}

/// Central difference extrapolated to step zero (Richardson), and how far two steps disagree: much, at a kink.
fn richardson(execution: &Execution, knowns: &[u32], seed: &[f64], unknown: u32) -> (f64, f64) {
    let at = |by| moved(execution, knowns, seed, by)[unknown as usize];
    let central = |h: f64| (at(h) - at(-h)) / (2.0 * h);
    let (coarse, fine) = (central(2e-4), central(1e-4));
    let extrapolated = fine + (fine - coarse) / 3.0;
    (extrapolated, (fine - coarse).abs())
}

#[test]
fn directional_derivatives_are_those_of_the_equations() {
    let mut random = Random::new(3);
    for name in description_names() {
        let model = Model::from_description(Description::read(&open_description(&name)).unwrap(), REGISTRY).unwrap();
        let mut execution = Execution::new(model);
        execution.initialise().unwrap();
        let variables = execution.model().variables();
        let range = |section| variables.reals(section).map(|index| index as u32);
        let knowns: Vec<u32> = range(Section::Input).chain(range(Section::State)).collect();
        let unknowns: Vec<u32> = range(Section::Signal).chain(range(Section::Derivative)).collect();
        let (mut compared, mut kinks) = (0, 0);
        for _ in 0..20 {
            execution.set_time(5.0 + 5.0 * random.next());
            knowns.iter().for_each(|&known| execution.block_mut().reals[known as usize] = 0.8 * random.next());
            let seed: Vec<f64> = knowns.iter().map(|_| random.next()).collect();
            let derivatives = execution.directional_derivative(&knowns, &seed);
            let exact: Vec<_> = unknowns.iter().map(|&unknown| derivatives[unknown as usize]).collect();
            for (&unknown, exact) in unknowns.iter().zip(&exact) {
                let (difference, disagreement) = richardson(&execution, &knowns, &seed, unknown);
                // Where a slope has a kink within the steps, as |v| v has at 0, the difference isn't known to what is asked.
                if disagreement > 1e-5 * exact.abs().max(1.0) {
                    kinks += 1;
                    continue;
                }
                compared += 1;
                let error = (exact - difference).abs() / exact.abs().max(1.0);
                assert!(error < 1e-6, "{name}, {unknown}: {exact} against {difference}");
            }
        }
        assert!(compared >= 19 * kinks, "{name}: {kinks} kinks in {compared} comparisons");
    }
}

/// fmi2GetDirectionalDerivative of several unknowns along a direction.
fn along(unit: &Unit, unknowns: &[u32], knowns: &[u32], seed: &[f64]) -> Result<Vec<f64>, String> {
    let mut result = vec![f64::NAN; unknowns.len()];
    let (n, m) = (unknowns.len(), knowns.len());
    let (unknowns, knowns, seed) = (unknowns.as_ptr(), knowns.as_ptr(), seed.as_ptr());
    let status =
        unsafe { fmi2GetDirectionalDerivative(unit.component, unknowns, n, knowns, m, seed, result.as_mut_ptr()) };
    if status == OK { Ok(result) } else { Err(unit.last_message()) }
}

fn derivative(unit: &Unit, unknown: u32, known: u32, seed: f64) -> Result<f64, String> {
    along(unit, &[unknown], &[known], &[seed]).map(|result| result[0])
}

/// Value references of the real inputs (in their order) and states (in theirs), and of what is calculated from them.
fn knowns_and_unknowns(unit: &Unit) -> (Vec<u32>, Vec<u32>) {
    let variables = unit.model.variables();
    let range = |section| variables.reals(section).map(|index| index as u32);
    let hidden = |reference: &u32| variables.visible().all(|e| References::of(variables, e) != *reference);
    let knowns = range(Section::Input).chain(range(Section::State)).collect();
    (knowns, range(Section::Signal).chain(range(Section::Derivative)).filter(|reference| !hidden(reference)).collect())
}

/// Puts an instance of model exchange to these inputs and states, and reads the unknowns.
fn at(unit: &Unit, knowns: &[u32], values: &[f64], unknowns: &[u32]) -> Vec<f64> {
    let inputs = unit.model.variables().reals(Section::Input).len();
    assert_eq!(unit.set_reals(&knowns[..inputs], &values[..inputs]), OK, "{:?}", unit.messages());
    assert_eq!(unit.set_states(&values[inputs..]), OK, "{:?}", unit.messages());
    let mut result = vec![f64::NAN; unknowns.len()];
    assert_eq!(unit.get_reals(unknowns, &mut result), OK, "{:?}", unit.messages());
    result
}

/// A unit that was stepped in a loop of small inputs, and one of model exchange at the same point: the derivatives that
/// both give are those of differences through the functions of model exchange.
#[test]
fn both_interfaces_give_the_derivatives_of_the_values_that_a_master_sees() {
    for name in description_names() {
        // The same for each: one more unit changes no other's points.
        let (mut random, mut starts) = (Random::new(7), Random::new(8));
        let text = open_description(&name);
        let (slave, exchange) = (Unit::from_text(&text), Unit::exchange_from_text(&text));
        [&slave, &exchange].into_iter().for_each(Unit::soften);
        slave.enter(0.0);
        // Away from rest, where quadratic damping has a kink in its slope.
        let variables = slave.model.variables().visible();
        for initial in
            variables.map(|element| element.name()).filter(|name| name.starts_with("x0[") || name.starts_with("x_m0["))
        {
            slave.put(&initial, slave.get(&initial) + 0.1 * starts.next());
        }
        assert_eq!(slave.exit(), OK);
        exchange.begin();
        let (knowns, unknowns) = knowns_and_unknowns(&slave);
        let inputs = slave.model.variables().reals(Section::Input).len();
        let step = slave.model.description().experiment.step;
        let (mut compared, mut kinks) = (0, 0);
        for k in 0..20 {
            let set: Vec<f64> = (0..inputs).map(|_| 0.1 * random.next()).collect();
            assert_eq!(slave.set_reals(&knowns[..inputs], &set), OK);
            slave.run(f64::from(k) * step, 1, step);
            assert_eq!(exchange.set_time(f64::from(k + 1) * step), OK);
            let mut values = vec![f64::NAN; knowns.len()];
            assert_eq!(slave.get_reals(&knowns, &mut values), OK);
            let seed: Vec<f64> = knowns.iter().map(|_| random.next()).collect();
            let moved =
                |by: f64| values.iter().zip(&seed).map(|(value, change)| value + by * change).collect::<Vec<_>>();
            let central = |h: f64| {
                let [after, before] = [h, -h].map(|by| at(&exchange, &knowns, &moved(by), &unknowns));
                after.iter().zip(&before).map(|(after, before)| (after - before) / (2.0 * h)).collect::<Vec<_>>()
            };
            // What the slave met as an event in its step is one here.
            at(&exchange, &knowns, &values, &unknowns);
            assert_eq!(exchange.enter_event_mode(), OK);
            exchange.settle();
            let [coarse, fine, finer, finest] = [2e-4, 1e-4, 1e-5, 1e-6].map(central);
            let exact = along(&slave, &unknowns, &knowns, &seed).unwrap();
            at(&exchange, &knowns, &values, &unknowns);
            assert_eq!(along(&exchange, &unknowns, &knowns, &seed).unwrap(), exact, "{name}");
            for (i, exact) in exact.iter().enumerate() {
                let (coarse, fine) = (coarse[i], fine[i]);
                if (fine - coarse).abs() > 1e-4 * exact.abs().max(1.0) {
                    kinks += 1;
                    continue;
                }
                compared += 1;
                // A slight kink nearby spoils what reaches across it: the nearer differences don't.
                let differences = [fine + (fine - coarse) / 3.0, finer[i], finest[i]];
                let near = |difference: f64| (exact - difference).abs() < 1e-6 * exact.abs().max(1.0);
                assert!(differences.into_iter().any(near), "{name}: {exact}, {differences:?}");
            }
        }
        assert!(compared >= 19 * kinks, "{name}: {kinks} kinks in {compared} comparisons");
    }
}

#[test]
fn a_directional_derivative_that_is_no_number_is_discarded() {
    let unit = Unit::exchange_of::<Root>("");
    unit.begin();
    assert_eq!(unit.set_states(&[0.0]), OK);
    assert_eq!(unit.get("rate"), 0.0, "the root itself is a number");
    let message = derivative(&unit, unit.reference("rate"), unit.reference("level"), 1.0).unwrap_err();
    assert!(message.contains("fmi2GetDirectionalDerivative") && message.contains("`rate`"), "{message}");
    assert!(unit.set_states(&[4.0]) == OK);
    assert_eq!(derivative(&unit, unit.reference("rate"), unit.reference("level"), 1.0), Ok(-0.25));
}

/// d(x2')/du = ω + ω_v sin t + cos u sin x1, by hand, at the communication point and the present input.
#[test]
fn a_master_gets_the_derivative_at_the_communication_point() {
    let unit = Unit::started("NonlinearSiso");
    unit.set("u[1]", 0.3);
    unit.run(0.0, 500, 1e-3);
    unit.set("u[1]", 0.7);
    let expected = 2.0 + 0.2 * 0.5_f64.sin() + 0.7_f64.cos() * unit.get("x[1]").sin();
    let found = derivative(&unit, unit.reference("der(x[2])"), unit.reference("u[1]"), 2.0).unwrap();
    assert!((found - 2.0 * expected).abs() < 1e-12, "{found}, not {}", 2.0 * expected);
    // An output that is a state changes as the state does.
    let (output, state) = (unit.reference("y[1]"), unit.reference("x[1]"));
    assert_eq!(derivative(&unit, output, state, 3.0), Ok(3.0));
    assert_eq!(derivative(&unit, state, state, 3.0), Ok(3.0));
}

#[test]
fn what_has_no_derivative_is_refused_by_name() {
    let unit = Unit::started("NonlinearSiso");
    let (y, u, a1) = (unit.reference("y[1]"), unit.reference("u[1]"), unit.reference("a1"));
    assert!(derivative(&unit, u, u, 1.0).unwrap_err().contains("`u[1]` is not calculated"));
    assert!(derivative(&unit, y, a1, 1.0).unwrap_err().contains("`a1` is neither an input nor a state"));
    assert!(derivative(&unit, y, u, f64::NAN).unwrap_err().contains("must be finite"));
    let integer = References::of(unit.model.variables(), unit.model.variables().find("input_handling").unwrap());
    assert!(derivative(&unit, y, integer, 1.0).unwrap_err().contains("input_handling"));
    let no_seed = unsafe { fmi2GetDirectionalDerivative(unit.component, &y, 1, &u, 1, std::ptr::null(), &mut 0.0) };
    assert_eq!(no_seed, ERROR);
}
