//! One FMU through both interfaces: the motion is the same, whoever integrates.

use adaptive_fmu::system::{Causality, Element, Section, Variability};
use common::described::open_description;
use common::sample::{sampled, sampled_names};
use common::*;

/// Constant inputs of no special values.
fn put_inputs(unit: &Unit) {
    let inputs = unit.model.variables().visible();
    let inputs = inputs.filter(|e| e.variable.causality == Causality::Input && e.variable.is_real());
    inputs.enumerate().for_each(|(k, input)| unit.put(&input.name(), 0.3 - 0.2 * k as f64));
}

/// Continuous variables.
fn continuous(unit: &Unit) -> impl Iterator<Item = Element<'_>> {
    let visible = unit.model.variables().visible();
    visible.filter(|e| e.variable.variability == Variability::Continuous && e.variable.is_real())
}

/// A unit with constant inputs, initialised.
fn started(unit: Unit) -> Unit {
    unit.soften();
    unit.enter(0.0);
    put_inputs(&unit);
    assert_eq!(unit.exit(), OK);
    unit
}

/// Duration of the comparison: the fastest oscillation turns through 200 rad, if there is one; otherwise 1 s, or the
/// FMU's experiment if that is shorter.
fn duration(name: &str) -> f64 {
    let unit = started(Unit::from_text(&open_description(name)));
    if unit.model.variables().find("adaptation_frequency").is_none() {
        return unit.model.description().experiment.stop_time.min(1.0);
    }
    let (mut t, mut phase, stop) = (0.0, 0.0, unit.model.description().experiment.stop_time);
    while t < stop && phase < 200.0 {
        let frequency = unit.get("adaptation_frequency");
        let step = 1.0 / frequency;
        assert_eq!(unit.step(t, step), OK, "{:?}", unit.messages());
        (t, phase) = (t + step, phase + frequency.max(unit.get("adaptation_frequency")) * step);
    }
    t.min(stop)
}

/// Variables for which the interfaces differ by more than 1e-6 of the nominal value, or of the largest value if that is
/// larger: with inputs that no plant answers, a controller's own signals may grow to thousands. Derivatives of
/// oscillations are faster by that. The FMU for model exchange is integrated in substeps of one length.
fn differences(name: &str, substeps: f64) -> Vec<String> {
    let text = open_description(name);
    let (exchange, slave) = (Unit::exchange_from_text(&text), Unit::from_text(&text));
    if slave.model.variables().find("relative_tolerance").is_some() {
        // It rules whatever method the unit takes.
        slave.put("relative_tolerance", 1e-10);
    }
    let [exchange, slave] = [exchange, slave].map(started);
    let adapts = slave.model.variables().find("adaptation_frequency").is_some();
    let (parts, mut next) = (20, exchange.settle());
    let step = duration(name) / f64::from(parts);
    let count = continuous(&slave).count();
    let (mut largest, mut difference) = (vec![0.0_f64; count], vec![0.0_f64; count]);
    for k in 0..parts {
        let t = f64::from(k) * step;
        assert_eq!(slave.step(t, step), OK, "{:?}", slave.messages());
        next = exchange.integrate(t, f64::from(k + 1) * step, step / substeps, next);
        for (i, element) in continuous(&slave).enumerate() {
            let values = [&exchange, &slave].map(|unit| unit.get(&element.name()));
            largest[i] = largest[i].max(values[1].abs());
            difference[i] = difference[i].max((values[0] - values[1]).abs());
        }
    }
    let fastest = if adapts { slave.get("adaptation_frequency") } else { 1.0 };
    let mut found = Vec::new();
    for (i, element) in continuous(&slave).enumerate() {
        let rate = if element.variable.section == Section::Derivative { fastest } else { 1.0 };
        let error = difference[i] / largest[i].max(element.nominal() * rate);
        // What is no number is no agreement.
        if error.is_nan() || error >= 1e-6 {
            found.push(format!("{} differs by {error:e}, values up to {:e}", element.name(), largest[i]));
        }
    }
    found
}

#[test]
fn model_exchange_and_co_simulation_agree() {
    for name in sampled(sampled_names()) {
        let adapts = Unit::new(&name).model.variables().find("adaptation_frequency").is_some();
        // The layer in which projection acts is stiff: an estimate that reaches its bound fast needs short substeps.
        let substeps = if adapts { vec![20_000.0, 80_000.0] } else { vec![2000.0] };
        let mut found = Vec::new();
        let agree = substeps.into_iter().any(|substeps| {
            found = differences(&name, substeps);
            found.is_empty()
        });
        assert!(agree, "{name}: {found:?}");
    }
}
