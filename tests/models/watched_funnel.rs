//! A funnel that is watched about a controller that knows none.

use common::described::refused;
use common::{OK, Unit, description};

const CONTROLLERS: [&str; 4] = ["L1ActuatedSiso", "FuzzyL1ActuatedSiso", "L1Quadrotor", "L1QuadrotorObserved"];

/// A controller whose description asks for a funnel.
fn watched(name: &str) -> String {
    description(name).replacen("[structure]", "[structure]\nfunnel = true", 1)
}

fn started(text: &str, r: f64) -> Unit {
    let unit = Unit::from_text(text);
    unit.enter(0.0);
    unit.put("r[1]", r);
    assert_eq!(unit.exit(), OK, "{:?}", unit.messages());
    unit
}

#[test]
fn the_control_is_that_of_the_controller_alone_bit_for_bit() {
    for name in CONTROLLERS {
        let [alone, watched] = [description(name), watched(name)].map(|text| started(&text, 0.05));
        for k in 0..50 {
            let t = 1e-3 * f64::from(k);
            for unit in [&alone, &watched] {
                unit.put("r[1]", 0.05 + t);
                assert_eq!(unit.step(t, 1e-3), OK, "{:?}", unit.messages());
            }
            assert_eq!(alone.get("u[1]").to_bits(), watched.get("u[1]").to_bits(), "{name} at {t}");
        }
        assert!(watched.get("u[1]") != 0.0 && (watched.get("e[1]") - 0.099).abs() < 1e-12, "{name}");
    }
}

#[test]
fn an_error_that_leaves_the_funnel_is_reported_when_it_does_and_counted() {
    let unit = started(&watched("L1ActuatedSiso"), 0.5);
    // 0.9 e^(-t) + 0.1 is 0.5 at t = ln(9/4) = 0.81093 s.
    unit.run(0.0, 810, 1e-3);
    assert_eq!((unit.get_boolean("funnel_left"), unit.get_integer("funnel_exits")), (false, 0));
    assert!((unit.get("rho[1]") - 0.9 * (-0.81_f64).exp() - 0.1).abs() < 1e-9 && unit.get("e[1]") == 0.5);
    unit.messages();
    unit.run(0.81, 1, 1e-3);
    assert_eq!((unit.get_boolean("funnel_left"), unit.get_integer("funnel_exits")), (true, 1));
    let warnings = |unit: &Unit| {
        unit.messages().into_iter().filter(|(_, category, _)| category == "logFunnel").collect::<Vec<_>>()
    };
    let messages = warnings(&unit);
    assert_eq!(messages.len(), 1);
    let text = &messages[0].2;
    assert!(["e[1] = 0.5", "rho[1] = 0.5", "t = 0.8109"].iter().all(|word| text.contains(word)), "{text}");
    // Back inside, and out again on the other side.
    unit.put("r[1]", 0.1);
    unit.run(0.811, 1, 1e-3);
    assert_eq!((unit.get_boolean("funnel_left"), unit.get_integer("funnel_exits")), (false, 1));
    unit.put("r[1]", -0.7);
    unit.run(0.812, 1, 1e-3);
    assert_eq!((unit.get_boolean("funnel_left"), unit.get_integer("funnel_exits")), (true, 2));
    assert_eq!(warnings(&unit), [], "warned once");
}

#[test]
fn an_error_that_is_outside_at_the_start_counts_and_refuses_nothing() {
    let unit = started(&watched("L1ActuatedSiso"), 1.5);
    assert_eq!(unit.step(0.0, 1e-3), OK);
    assert_eq!((unit.get_boolean("funnel_left"), unit.get_integer("funnel_exits")), (true, 1));
}

#[test]
fn a_funnel_that_widens_or_is_no_answer_is_refused() {
    refused(&format!("{}\nrho_inf = [2.0]", watched("L1ActuatedSiso")), &["rho_inf[1] = 2", "rho_0[1] = 1"]);
    let text = description("L1ActuatedSiso").replacen("[structure]", "[structure]\nfunnel = 'wide'", 1);
    refused(&text, &["[structure]", "funnel", "boolean"]);
    let text = description("L1ActuatedSiso").replacen("[structure]", "[structure]\nfunnels = true", 1);
    refused(&text, &["[structure]", "funnels"]);
}
