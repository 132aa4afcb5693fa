//! Saved states that were changed, with a checksum that fits: whatever they hold, no function hands out what is no finite
//! number with fmi2OK.

use std::ops::Range;

use adaptive_fmu::fmi2::types::*;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::system::{Causality, Section, Variables};
use adaptive_fmu_library::{fmi2_functions::*, fmi3_functions::*};
use common::fmi3::Instance;
use common::random::Random;
use common::systems::SquareIntegral;
use common::{ERROR, OK, Unit, description, description_names};

const CHECKSUM: Range<usize> = 12..16;
/// Value of a buffer that isn't written.
const BLANK: f64 = 7.25;

/// Place of the first real value in a serialised state: only integers follow the real ones.
fn first_real(variables: &Variables, state: &[u8]) -> usize {
    state.len() - 8 * variables.reals(Section::Memory).end - 4 * variables.integers(Section::Memory).end
}

/// A state with a number at a place of the block.
fn with_real(variables: &Variables, state: &[u8], place: usize, value: f64) -> Vec<u8> {
    with_bytes(state, first_real(variables, state) + 8 * place, &value.to_le_bytes())
}

/// Puts a number into a state at a place of the block, and the unit there.
fn forge(unit: &Unit, state: &[u8], place: usize, value: f64) {
    let (status, saved) = unit.deserialise(&with_real(unit.model.variables(), state, place, value));
    assert_eq!((status, unit.restore(saved)), (OK, OK));
    assert_eq!(unit.free(saved), OK);
}

/// True if a function hands out so many numbers, or refuses and writes nothing.
fn hands_out_numbers(count: usize, call: &dyn Fn(*mut f64) -> Status) -> bool {
    let mut values = vec![BLANK; count];
    let status = call(values.as_mut_ptr());
    if status == OK { values.iter().all(|v| v.is_finite()) } else { values.iter().all(|v| *v == BLANK) }
}

/// Reals that may be asked for: all, and outputs, derivatives of which may be.
struct Asked {
    all: Vec<u32>,
    outputs: Vec<u32>,
    knowns: Vec<u32>,
}

impl Asked {
    fn of(unit: &Unit) -> Self {
        let reals = |wanted: &dyn Fn(Causality) -> bool| {
            let visible = unit.model.variables().visible();
            let reals = visible.filter(|element| element.variable.is_real() && wanted(element.variable.causality));
            reals.map(|element| unit.reference(&element.name())).collect::<Vec<_>>()
        };
        Asked {
            all: reals(&|_| true),
            outputs: reals(&|causality| causality == Causality::Output),
            knowns: reals(&|causality| causality == Causality::Input),
        }
    }

    /// Calls every function that hands out reals; the names of those that handed out what is none.
    fn broken(&self, unit: &Unit) -> Vec<&'static str> {
        let (c, variables) = (unit.component, unit.model.variables());
        let (states, indicators) = (variables.states(), unit.model.variables().indicators().len());
        let mut broken = Vec::new();
        let mut look = |name, count: usize, call: &dyn Fn(*mut f64) -> Status| {
            if !hands_out_numbers(count, call) {
                broken.push(name);
            }
        };
        let (orders, seed) = (vec![1; self.outputs.len()], vec![1.0; self.knowns.len()]);
        let count = self.outputs.len();
        look("fmi2GetReal", self.all.len(), &|values| unsafe {
            fmi2GetReal(c, self.all.as_ptr(), self.all.len(), values)
        });
        look("fmi2GetReal of outputs", count, &|values| unsafe {
            fmi2GetReal(c, self.outputs.as_ptr(), count, values)
        });
        look("fmi2GetRealOutputDerivatives", count, &|values| unsafe {
            fmi2GetRealOutputDerivatives(c, self.outputs.as_ptr(), count, orders.as_ptr(), values)
        });
        look("fmi2GetDirectionalDerivative", count, &|values| unsafe {
            let (outputs, knowns) = (self.outputs.as_ptr(), self.knowns.as_ptr());
            fmi2GetDirectionalDerivative(c, outputs, count, knowns, seed.len(), seed.as_ptr(), values)
        });
        look("fmi2GetDerivatives", states, &|values| unsafe { fmi2GetDerivatives(c, values, states) });
        look("fmi2GetEventIndicators", indicators, &|values| unsafe { fmi2GetEventIndicators(c, values, indicators) });
        look("fmi2GetContinuousStates", states, &|values| unsafe { fmi2GetContinuousStates(c, values, states) });
        look("fmi2GetNominalsOfContinuousStates", states, &|values| unsafe {
            fmi2GetNominalsOfContinuousStates(c, values, states)
        });
        let last_time = status_kind::LAST_SUCCESSFUL_TIME;
        look("fmi2GetRealStatus", 1, &|values| unsafe { fmi2GetRealStatus(c, last_time, values) });
        broken
    }
}

/// Starts a unit, and makes the first step, before which co-simulation starts anew; the time.
fn running(unit: &Unit, kind: i32, step: f64) -> f64 {
    unit.start(0.0);
    if kind == MODEL_EXCHANGE {
        return 0.0;
    }
    unit.run(0.0, 1, step);
    step
}

/// Every place of the smaller blocks, and some of each larger one.
fn places(variables: &Variables) -> Vec<usize> {
    let end = variables.reals(Section::Memory).end;
    let mut random = Random::new(7);
    let any = |_| (0.5 * (random.next() + 1.0) * end as f64) as usize % end;
    if end <= 120 { (0..end).collect() } else { (0..120).map(any).collect() }
}

#[test]
fn what_a_forged_state_holds_is_not_handed_out_as_a_number() {
    for (name, kind) in description_names().iter().flat_map(|name| [(name, CO_SIMULATION), (name, MODEL_EXCHANGE)]) {
        let unit = Unit::made(REGISTRY, &description(name), kind);
        let time = running(&unit, kind, unit.model.description().experiment.step);
        let (state, asked) = (unit.fingerprint(), Asked::of(&unit));
        // Time, states and their neighbours lie where what follows from them is handed out.
        let variables = unit.model.variables();
        let (reals, memory) = (variables.reals(Section::State), variables.reals(Section::Memory));
        for place in places(variables).into_iter().chain(reals).chain(memory) {
            for value in [f64::NAN, f64::INFINITY] {
                forge(&unit, &state, place, value);
                let broken = asked.broken(&unit);
                assert!(broken.is_empty(), "{name}, interface {kind}, place {place}: {broken:?}");
                // It goes on with numbers, or not at all.
                if kind == CO_SIMULATION {
                    unit.step(time, 1e-4);
                } else if let Ok(event) = unit.try_new_discrete_states() {
                    assert!(event.next.is_none_or(f64::is_finite), "{name}, place {place}: {event:?}");
                }
                let broken = asked.broken(&unit);
                assert!(broken.is_empty(), "{name}, interface {kind}, place {place}, going on: {broken:?}");
            }
        }
        unit.messages();
    }
}

/// Functions of FMI 3.0 that hand out what is no number.
fn broken_in_fmi3(instance: &Instance) -> Vec<&'static str> {
    let (c, states) = (instance.component, instance.model.variables().states());
    let indicators = instance.model.variables().indicators().len();
    let (all, values_of_all) = instance.references(|_| true);
    let (outputs, of_outputs) = instance.references(|causality| causality == Causality::Output);
    let (inputs, of_inputs) = instance.references(|causality| causality == Causality::Input);
    let (orders, seed) = (vec![1; outputs.len()], vec![1.0; of_inputs.max(of_outputs)]);
    let mut broken = Vec::new();
    let mut look = |name, count: usize, call: &dyn Fn(*mut f64) -> Status| {
        if !hands_out_numbers(count, call) {
            broken.push(name);
        }
    };
    let (out, outs, into, ins) = (outputs.as_ptr(), outputs.len(), inputs.as_ptr(), inputs.len());
    look("fmi3GetFloat64", values_of_all, &|v| unsafe { fmi3GetFloat64(c, all.as_ptr(), all.len(), v, values_of_all) });
    look("fmi3GetFloat64 of outputs", of_outputs, &|v| unsafe { fmi3GetFloat64(c, out, outs, v, of_outputs) });
    look("fmi3GetOutputDerivatives", of_outputs, &|v| unsafe {
        fmi3GetOutputDerivatives(c, out, outs, orders.as_ptr(), v, of_outputs)
    });
    look("fmi3GetDirectionalDerivative", of_outputs, &|v| unsafe {
        fmi3GetDirectionalDerivative(c, out, outs, into, ins, seed.as_ptr(), of_inputs, v, of_outputs)
    });
    look("fmi3GetAdjointDerivative", of_inputs, &|v| unsafe {
        fmi3GetAdjointDerivative(c, out, outs, into, ins, seed.as_ptr(), of_outputs, v, of_inputs)
    });
    look("fmi3GetContinuousStateDerivatives", states, &|v| unsafe { fmi3GetContinuousStateDerivatives(c, v, states) });
    look("fmi3GetEventIndicators", indicators, &|v| unsafe { fmi3GetEventIndicators(c, v, indicators) });
    look("fmi3GetContinuousStates", states, &|v| unsafe { fmi3GetContinuousStates(c, v, states) });
    look("fmi3GetNominalsOfContinuousStates", states, &|v| unsafe { fmi3GetNominalsOfContinuousStates(c, v, states) });
    broken
}

#[test]
fn what_a_forged_state_holds_is_not_handed_out_as_a_number_in_fmi_3() {
    for (name, kind) in description_names().iter().flat_map(|name| [(name, CO_SIMULATION), (name, MODEL_EXCHANGE)]) {
        let instance = Instance::started(&description(name), kind);
        let (step, mut time) = (instance.model.description().experiment.step, 0.0);
        if kind == CO_SIMULATION {
            let (status, reached) = instance.step(time, step);
            assert_eq!(status, OK, "{name}");
            time = reached;
        }
        let (state, variables) = (instance.state(), instance.model.variables());
        // The state is that of FMI 2.0, for which all places are tried.
        for place in places(variables).into_iter().step_by(30) {
            for value in [f64::NAN, f64::INFINITY] {
                assert_eq!(instance.restore(&with_real(variables, &state, place, value)), OK, "{name}, place {place}");
                let broken = broken_in_fmi3(&instance);
                assert!(broken.is_empty(), "{name}, interface {kind}, place {place}: {broken:?}");
                // It goes on with numbers, or not at all.
                if kind == CO_SIMULATION {
                    instance.step(time, 1e-4);
                } else {
                    unsafe { fmi3EnterEventMode(instance.component) };
                    instance.update();
                }
                let broken = broken_in_fmi3(&instance);
                assert!(broken.is_empty(), "{name}, interface {kind}, place {place}, going on: {broken:?}");
            }
        }
        assert_eq!(instance.restore(&state), OK, "{name}");
        let mut other = state.clone();
        other[CHECKSUM.start] ^= 1;
        assert_eq!(instance.restore(&other), ERROR, "{name}: a checksum that doesn't fit");
    }
}

#[test]
fn an_event_whose_time_is_no_number_is_not_passed_over() {
    for kind in [CO_SIMULATION, MODEL_EXCHANGE] {
        let unit = Unit::system::<SquareIntegral>("", kind);
        let time = running(&unit, kind, 0.1);
        let (state, edges) = (unit.fingerprint(), unit.reference("edges") as usize);
        forge(&unit, &state, edges, f64::NAN);
        let status = match kind {
            CO_SIMULATION => unit.step(time, 0.1),
            _ => unit.try_new_discrete_states().map_or_else(|status| status, |_| OK),
        };
        assert_eq!(status, ERROR);
        let message = unit.last_message();
        assert!(message.contains("NaN") && message.contains("the time of the next event"), "{message}");
    }
}

/// Puts an integer into a state at a place of the block, and a byte elsewhere; the state as bytes.
fn with_integer(unit: &Unit, state: &[u8], place: usize, value: i32) -> Vec<u8> {
    let first = state.len() - 4 * (unit.model.variables().integers(Section::Memory).end - place);
    with_bytes(state, first, &value.to_le_bytes())
}

fn with_bytes(state: &[u8], first: usize, bytes: &[u8]) -> Vec<u8> {
    let mut state = state.to_vec();
    state[first..first + bytes.len()].copy_from_slice(bytes);
    let checksum = crc32fast::hash(&state[CHECKSUM.end..]).to_le_bytes();
    state[CHECKSUM].copy_from_slice(&checksum);
    state
}

#[test]
fn an_integer_that_no_instance_has_is_refused() {
    for (name, kind) in description_names().iter().flat_map(|name| [(name, CO_SIMULATION), (name, MODEL_EXCHANGE)]) {
        let unit = Unit::made(REGISTRY, &description(name), kind);
        running(&unit, kind, unit.model.description().experiment.step);
        let (state, variables) = (unit.fingerprint(), unit.model.variables());
        let mut refused = 0;
        for place in 0..variables.integers(Section::Memory).end {
            let element = variables.visible().find(|it| !it.variable.is_real() && variables.index(*it) == place);
            // Counts and seeds may be any number, and so may copies of them.
            let is_any = unit.model.integer_ranges()[place] == (i32::MIN, i32::MAX);
            let limits = element.map(|it| it.variable.data.integers());
            let beyond: Vec<i32> = match limits {
                Some((least, most)) => least.checked_sub(1).into_iter().chain(most.checked_add(1)).collect(),
                None if is_any => Vec::new(),
                None => vec![i32::MIN, 2_000_000_000],
            };
            for value in beyond {
                let (shown, forged) = (format!("= {value}: must be within"), with_integer(&unit, &state, place, value));
                let named = element.map_or("internal value".to_owned(), |it| it.name());
                unit.refuses(&["fmi2DeSerializeFMUstate", &shown, &named], |unit| unit.deserialise(&forged).0);
                refused += 1;
            }
        }
        assert!(refused > 10, "{name}: {refused}");
    }
}

#[test]
fn steps_beyond_any_use_a_phase_of_the_other_interface_and_a_stop_time_that_is_none_are_refused() {
    let unit = Unit::started("NonlinearSiso");
    let state = unit.fingerprint();
    let steps = unit.reference("fixed_steps") as usize - unit.model.variables().reals(Section::Memory).end;
    let forged = with_integer(&unit, &state, steps, 500_000_000);
    let message = "fixed_steps = 500000000: must be within 1 … 10000";
    unit.refuses(&[message], |unit| unit.deserialise(&forged).0);
    // Behind magic, version, checksum and identity.
    let (phase, stop_time) = (32, 33);
    for number in [2, 3, 8, 9, 255] {
        unit.refuses(&["no such phase"], |unit| unit.deserialise(&with_bytes(&state, phase, &[number])).0);
    }
    for (flag, time) in [(2, 1.0), (1, f64::NAN), (1, f64::INFINITY)] {
        let bytes = [&[flag][..], &f64::to_le_bytes(time)].concat();
        unit.refuses(&["its stop time is none"], |unit| unit.deserialise(&with_bytes(&state, stop_time, &bytes)).0);
    }
    let (status, saved) = unit.deserialise(&state);
    assert_eq!((status, unit.restore(saved)), (OK, OK));
}

#[test]
fn a_parameter_that_waits_may_be_beyond_its_limits_and_is_refused_when_it_would_come_into_force() {
    let unit = Unit::new("NonlinearSiso");
    assert_eq!(unit.set_integer("fixed_steps", 0), OK);
    let state = unit.fingerprint();
    let other = Unit::new("NonlinearSiso");
    let (status, saved) = other.deserialise(&state);
    assert_eq!((status, other.restore(saved)), (OK, OK));
    other.enter(0.0);
    assert_eq!(other.exit(), ERROR);
    assert!(other.last_message().contains("fixed_steps = 0: must be within 1 … 10000"), "{}", other.last_message());
}
