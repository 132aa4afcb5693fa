//! One unit through both interfaces: the same motion, whoever integrates.

mod common;

use adaptive_fmu::system::{Causality, Element, Section, Variability};
use common::*;

/// Constant inputs of no special values.
fn put_inputs(unit: &Unit) {
    let inputs = unit.model.variables().visible().filter(|e| e.variable.causality == Causality::Input);
    inputs.enumerate().for_each(|(k, input)| unit.put(&input.name(), 0.3 - 0.2 * k as f64));
}

/// What changes continuously.
fn continuous(unit: &Unit) -> impl Iterator<Item = Element<'_>> {
    unit.model.variables().visible().filter(|e| e.variable.variability == Variability::Continuous)
}

/// How long the comparison takes: 200 rad of the fastest oscillation, where a unit has one.
fn duration(unit: &Unit) -> f64 {
    match unit.model.variables().find("adaptation_frequency") {
        Some(_) => unit.model.description().experiment.stop_time.min(200.0 / unit.get("adaptation_frequency")),
        None => 1.0,
    }
}

/// A bound of 1e-6 of each variable's nominal value; derivatives have none, theirs is the largest value of the run.
#[test]
fn model_exchange_and_co_simulation_agree() {
    for name in description_names() {
        let (exchange, slave) = (Unit::exchange(&name), Unit::new(&name));
        if slave.model.variables().find("relative_tolerance").is_some() {
            slave.put("relative_tolerance", 1e-10);
        }
        for unit in [&exchange, &slave] {
            unit.enter(0.0);
            put_inputs(unit);
            assert_eq!(unit.exit(), OK);
        }
        let (parts, mut next) = (20, exchange.settle());
        let step = duration(&slave) / f64::from(parts);
        let count = continuous(&slave).count();
        let (mut largest, mut difference) = (vec![0.0_f64; count], vec![0.0_f64; count]);
        for k in 0..parts {
            let t = f64::from(k) * step;
            assert_eq!(slave.step(t, step), OK, "{:?}", slave.messages());
            next = exchange.integrate(t, f64::from(k + 1) * step, step / 2000.0, next);
            for (i, element) in continuous(&slave).enumerate() {
                let values = [&exchange, &slave].map(|unit| unit.get(&element.name()));
                largest[i] = largest[i].max(values[1].abs());
                difference[i] = difference[i].max((values[0] - values[1]).abs());
            }
        }
        for (i, element) in continuous(&slave).enumerate() {
            let derivative = element.variable.section == Section::Derivative;
            let scale = if derivative { largest[i].max(1.0) } else { element.nominal() };
            let (name_of, error) = (element.name(), difference[i] / scale);
            assert!(error < 1e-6, "{name}: {name_of} differs by {error:e}, values up to {:e}", largest[i]);
        }
    }
}
