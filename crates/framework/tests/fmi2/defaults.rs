//! A unit as a tool first tries it: nothing is set and nothing connected.

use adaptive_fmu::fmi2::types::{CO_SIMULATION, MODEL_EXCHANGE};
use adaptive_fmu::library::REGISTRY;
use common::described::model;
use common::{OK, Unit, description, description_names};

/// Duration: 1 s, or the FMU's own experiment if that is shorter, as for a plant that needs its controller.
fn duration(unit: &Unit) -> f64 {
    unit.model.description().experiment.stop_time.min(1.0)
}

#[test]
fn every_unit_runs_from_its_own_defaults_in_co_simulation() {
    for name in description_names() {
        let unit = Unit::made(REGISTRY, &description(&name), CO_SIMULATION);
        unit.start(0.0);
        let step = unit.model.description().experiment.step.max(1e-3);
        for k in 0..(duration(&unit) / step) as usize {
            assert_eq!(unit.step(k as f64 * step, step), OK, "{name}: {:?}", unit.messages());
        }
    }
}

#[test]
fn every_unit_runs_from_its_own_defaults_in_model_exchange() {
    for name in description_names() {
        let unit = Unit::made(REGISTRY, &description(&name), MODEL_EXCHANGE);
        let next = unit.begin();
        println!("{name}");
        unit.integrate(0.0, duration(&unit), 1e-3, next);
        assert!(unit.values().into_iter().all(|value| f64::from_bits(value).is_finite()), "{name}");
    }
}

#[test]
fn limits_are_printed_with_significant_digits() {
    let text = description("NeuroPpfTwoLinkRobot");
    let (text, _) = text.rsplit_once("\nx = ").unwrap();
    // An arm on its reference, as any tool has it that sets all inputs to 0.
    let refused = |start: &str| {
        let unit = Unit::from_text(&format!("{text}\n{start}\n"));
        unit.start(0.0);
        assert_ne!(unit.step(0.0, 1e-4), OK);
        unit.last_message()
    };
    let message = refused("");
    let expected = "e[1] = 0: must lie between 0 and 1.1, and is at a bound: overshoot[1] above 0 would do";
    assert!(message.contains(expected), "{message}");
    let message = refused("x = [1.1000000001, 1e-300, 0.0, 0.0]");
    assert!(message.contains("e[1] = 1.1000000001: must lie between 0 and 1.1, and is beyond by 1e-10"), "{message}");
    assert!(!message.contains("e[2]"), "1e-300 is inside: {message}");
    let message = refused("x = [0.1, -1.2, 0.0, 0.0]\novershoot = [0.0, 1e-7]");
    assert!(
        message.contains("between -1.1 and 1.1e-7") && message.contains("rho_0[2] above 1.2 would do"),
        "{message}"
    );
    let message = model(&format!("{text}\nrelative_tolerance = 1e-300\n")).unwrap_err();
    assert!(message.contains("relative_tolerance = 1e-300") && message.contains("within 1e-12 … 0.01"), "{message}");
}
