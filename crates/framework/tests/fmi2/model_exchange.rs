//! Model exchange: the master integrates, and asks for values at times, states and inputs of its own.

use adaptive_fmu::fmi2::types::*;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu_library::fmi2_functions::*;
use common::described::open_description;
use common::exchange::Event;
use common::systems::*;
use common::*;

const NOTHING: Event = Event { again: false, states_changed: false, next: None };

/// Right-hand side of the plant of example 3.2.1, by hand.
fn plant(t: f64, [x1, x2]: [f64; 2], u: f64) -> f64 {
    (2.0 + 0.2 * t.sin()) * u + u.sin() * x1.sin() + x1 * x1 + x2 * x2 + (0.5 * t).sin()
}

fn started(name: &str) -> Unit {
    let unit = Unit::exchange_from_text(&open_description(name));
    unit.begin();
    unit
}

#[test]
fn values_are_those_of_the_time_states_and_inputs_that_the_master_has_set() {
    let unit = started("NonlinearSiso");
    for (t, x, u) in [(0.0, [0.3, -0.2], 0.5), (4.0, [1.5, 0.4], -1.0), (2.0, [1.5, 0.4], -1.0), (2.0, [0.0, 0.1], 0.2)]
    {
        assert_eq!((unit.set_time(t), unit.set_states(&x), unit.set("u[1]", u)), (OK, OK, OK));
        assert!((unit.derivatives()[1] - plant(t, x, u)).abs() < 1e-14);
        assert_eq!((unit.get("y[1]"), unit.derivatives()[0], unit.get("der(x[1])")), (x[0], x[1], x[1]));
        assert_eq!(unit.states(), x);
    }
    // Values are right for calls in any order, and after each single one.
    unit.put("u[1]", 0.7);
    assert!((unit.get("der(x[2])") - plant(2.0, [0.0, 0.1], 0.7)).abs() < 1e-14);
    assert_eq!(unit.set_time(3.0), OK);
    assert!((unit.get("der(x[2])") - plant(3.0, [0.0, 0.1], 0.7)).abs() < 1e-14);
}

#[test]
fn what_is_taken_from_inputs_at_the_start_is_taken_at_the_end_of_initialization_mode() {
    let unit = Unit::exchange("L1NonlinearSiso");
    unit.enter(0.0);
    unit.put("x[1]", 0.6);
    assert_eq!(unit.states()[0], 0.6, "in Initialization Mode from the present inputs");
    unit.put("x[1]", 0.8);
    assert_eq!(unit.exit(), OK);
    unit.put("x[1]", 5.0);
    unit.settle();
    unit.put("x[1]", 7.0);
    assert_eq!((unit.get("x_hat[1]"), unit.states()[0]), (0.8, 0.8));
}

#[test]
fn nominal_values_are_those_of_the_description() {
    for name in description_names() {
        let unit = started(&name);
        let variables = unit.model.variables();
        let mut nominals = vec![f64::NAN; variables.states()];
        let status =
            unsafe { fmi2GetNominalsOfContinuousStates(unit.component, nominals.as_mut_ptr(), nominals.len()) };
        assert_eq!(status, OK);
        let states = variables.visible().filter(|e| e.variable.section == adaptive_fmu::system::Section::State);
        states.for_each(|state| assert_eq!(nominals[state.place()], state.nominal(), "{name}: {}", state.name()));
    }
}

#[test]
fn the_derivatives_of_the_description_are_in_the_order_of_the_states() {
    for name in description_names() {
        let unit = started(&name);
        let xml = std::fs::read_to_string(description_folder().join(format!("{name}.xml"))).unwrap();
        let document = roxmltree::Document::parse(&xml).unwrap();
        let find = |tag: &str| document.descendants().filter(|n| n.has_tag_name(tag)).collect::<Vec<_>>();
        let variables = find("ScalarVariable");
        let at = |index: &str| variables[index.parse::<usize>().unwrap() - 1];
        let listed = find("Derivatives").first().map_or(Vec::new(), |list| list.children().collect());
        let (x, dx): (Vec<_>, Vec<_>) = listed
            .into_iter()
            .filter(roxmltree::Node::is_element)
            .map(|unknown| {
                let derivative = at(unknown.attribute("index").unwrap());
                let state = at(derivative.first_element_child().unwrap().attribute("derivative").unwrap());
                (state.attribute("name").unwrap(), derivative.attribute("name").unwrap())
            })
            .unzip();
        let count = x.len();
        assert_eq!(unit.set_states(&(0..count).map(|k| 0.1 + 0.01 * k as f64).collect::<Vec<_>>()), OK);
        assert_eq!(x.iter().map(|name| unit.get(name)).collect::<Vec<_>>(), unit.states(), "{name}");
        assert_eq!(dx.iter().map(|name| unit.get(name)).collect::<Vec<_>>(), unit.derivatives(), "{name}");
    }
}

#[test]
fn a_square_wave_has_its_edges_at_the_given_times() {
    let unit = Unit::exchange_from_text(
        &description("ReferenceNonlinearSiso").replace("signal = \"cosine\"", "signal = \"square\""),
    );
    let mut next = unit.begin();
    for k in 1..100 {
        let t = next.unwrap();
        assert!((t - edge(f64::from(k))).abs() < 1e-12 * t, "edge {k}: {t}");
        let before = unit.get("r[1]");
        assert_eq!(unit.set_time(t), OK);
        assert_eq!(unit.get("r[1]"), before, "not before the event");
        assert!(unit.completed_step(), "a time event is due");
        assert_eq!(unit.enter_event_mode(), OK);
        let event = unit.new_discrete_states();
        assert_eq!((event.again, unit.get("r[1]")), (true, -before));
        assert_eq!(unit.new_discrete_states(), Event { again: false, ..event });
        assert_eq!(unit.enter_continuous_time_mode(), OK);
        next = event.next;
    }
}

#[test]
fn a_time_event_is_handled_at_its_time_in_spite_of_the_masters_rounding() {
    let unit = Unit::exchange_of::<Timer>("due = 0.3");
    assert_eq!(unit.begin(), Some(0.3));
    assert_eq!(unit.set_time(0.1 + 0.2 - 1e-13), OK);
    assert!(unit.completed_step());
    assert_eq!(unit.enter_event_mode(), OK);
    assert_eq!((unit.settle(), unit.get("y")), (None, 1.0));
}

#[test]
fn an_event_update_where_nothing_happens_changes_nothing() {
    for name in description_names() {
        let unit = started(&name);
        let before = unit.values();
        assert_eq!(unit.enter_event_mode(), OK);
        let event = unit.new_discrete_states();
        assert_eq!((event.again, event.states_changed), (false, false), "{name}");
        assert_eq!(unit.enter_continuous_time_mode(), OK);
        assert_eq!(unit.values(), before, "{name}");
    }
}

#[test]
fn a_bouncing_ball_bounces_at_its_exact_times() {
    for h in [0.01, 0.1, 0.3] {
        let unit = Unit::exchange_of::<Ball>("");
        let mut next = unit.begin();
        for k in 1..=25 {
            let t = f64::from(k) * 0.1;
            next = unit.integrate(t - 0.1, t, h, next);
            let (bounces, last, height) = exact_ball(t, 0.8);
            assert_eq!(unit.get("bounces"), bounces, "h = {h}, t = {t}");
            assert!((unit.get("last") - last).abs() < 1e-9, "bounce at {last}, not {}", unit.get("last"));
            assert!((unit.get("height") - height).abs() < 1e-8, "h = {h}, t = {t}");
        }
    }
}

#[test]
fn a_master_that_looks_at_no_indicator_is_informed_of_each_event() {
    // Steps of 1 ms, each bounce noticed at the end of the step in which it was.
    let unit = Unit::exchange_of::<Ball>("");
    unit.begin();
    for k in 0..2500 {
        unit.runge_kutta(f64::from(k) * 1e-3, 1e-3);
        if unit.completed_step() {
            assert_eq!(unit.enter_event_mode(), OK);
            assert!(unit.new_discrete_states().states_changed);
            assert!(unit.new_discrete_states().states_changed, "also where a master looks at the last answer only");
            assert_eq!(unit.enter_continuous_time_mode(), OK);
            assert_eq!(unit.get("height"), 0.0);
        }
    }
    assert_eq!(unit.get("bounces"), exact_ball(2.5, 0.8).0);
}

#[test]
fn a_bounce_may_end_before_the_first_step_after_the_last_one() {
    // The whole flight between two bounces lies within one step of the integrator.
    let unit = Unit::exchange_of::<Ball>("");
    unit.begin();
    unit.runge_kutta(0.0, 0.5);
    assert!(unit.completed_step());
    assert_eq!(unit.enter_event_mode(), OK);
    unit.settle();
    assert!(unit.indicators()[0] == 0.0 && unit.get("speed") > 0.0);
    unit.runge_kutta(0.5, 1.0);
    assert!(unit.get("height") < 0.0);
    assert!(unit.completed_step(), "the ball must not fall through the floor");
}

#[test]
fn a_relay_switches_at_its_exact_times() {
    let unit = Unit::exchange_of::<Relay>("");
    let next = unit.begin();
    unit.integrate(0.0, 20.5, 0.3, next);
    assert_eq!(unit.get("switches"), 10.0);
    assert!((unit.get("last") - 19.0).abs() < 1e-9, "{}", unit.get("last"));
}

#[test]
fn an_input_that_jumps_across_a_threshold_is_an_event() {
    let unit = Unit::exchange_of::<Switch>("");
    unit.begin();
    // In Continuous-Time Mode, where its indicator changes sign, and in Event Mode.
    unit.put("u", 1.0);
    assert!(unit.indicators()[0] > 0.0);
    assert!(unit.completed_step());
    assert_eq!(unit.get("side"), -1.0, "not before the event");
    assert_eq!(unit.enter_event_mode(), OK);
    assert_eq!(unit.new_discrete_states(), Event { again: true, ..NOTHING });
    assert_eq!((unit.get("side"), unit.get_integer("switched")), (1.0, 8));
    assert_eq!(unit.new_discrete_states(), NOTHING);
    unit.put("u", 0.0);
    assert_eq!(unit.new_discrete_states(), Event { again: true, ..NOTHING }, "another unit has answered");
    assert_eq!((unit.get("side"), unit.get_integer("switched")), (-1.0, 9));
}

#[test]
fn events_without_end_are_an_error_and_values_are_as_before() {
    let unit = Unit::exchange_of::<Stuck>("");
    unit.begin();
    assert_eq!(unit.set_time(1.5), OK);
    assert!(unit.completed_step());
    assert_eq!(unit.enter_event_mode(), OK);
    let (before, good) = (unit.values(), unit.save());
    assert_eq!(unit.try_new_discrete_states(), Err(ERROR));
    let message = unit.last_message();
    ["fmi2NewDiscreteStates", "t = 1.5"].iter().for_each(|part| assert!(message.contains(part), "{message}"));
    assert_eq!(unit.values(), before);
    unit.refuses(&["fmi2NewDiscreteStates", "restore a state"], |unit| {
        unit.try_new_discrete_states().map_or_else(|status| status, |_| OK)
    });
    assert_eq!((unit.restore(good), unit.set_time(1.0)), (OK, OK));
    unit.settle();
}

#[test]
fn an_fmu_gets_the_length_of_each_completed_step() {
    let unit = Unit::exchange_of::<Odometer>("");
    unit.begin();
    for (t, length) in [(0.25, 0.25), (0.75, 0.5), (0.75, 0.5), (2.0, 1.25)] {
        // What a solver only tries is no step.
        assert_eq!((unit.set_time(t + 7.0), unit.set_time(t)), (OK, OK));
        assert!(!unit.completed_step(), "a count is no event");
        assert_eq!((unit.get("last"), unit.get("way")), (length, t));
    }
    assert_eq!(unit.get("steps"), 3.0);
    let warnings: Vec<_> = unit.messages().into_iter().map(|(_, category, _)| category).collect();
    assert_eq!(warnings, ["logWay"], "a warning, once");
}

#[test]
fn what_a_completed_step_changes_in_the_equations_is_an_event() {
    let unit = Unit::exchange_of::<Odometer>("full = 1.0");
    unit.begin();
    assert_eq!(unit.set_time(0.75), OK);
    assert!(!unit.completed_step());
    assert_eq!(unit.set_time(1.25), OK);
    assert!(unit.completed_step());
    assert_eq!(unit.get("y"), 1.0);
}

#[test]
fn a_run_beyond_the_stop_time_is_refused_and_a_solvers_look_ahead_is_not() {
    let unit = Unit::exchange("NonlinearSiso");
    assert_eq!(unit.setup(0.0, Some(1.0)), OK);
    assert_eq!(unsafe { fmi2EnterInitializationMode(unit.component) }, OK);
    assert_eq!(unit.exit(), OK);
    unit.settle();
    assert_eq!(unit.set_time(1.2), OK);
    unit.derivatives();
    unit.refuses(&["fmi2CompletedIntegratorStep", "stopTime = 1"], |unit| unit.try_completed_step(&mut 0));
    assert_eq!(unit.set_time(1.0 + 1e-9), OK);
    unit.completed_step();
}

#[test]
fn a_reset_unit_runs_as_a_new_one() {
    let (used, new) = (Unit::exchange_of::<Ball>(""), Unit::exchange_of::<Ball>(""));
    used.integrate(0.0, 1.0, 0.1, used.begin());
    assert_eq!(used.reset(), OK);
    for unit in [&used, &new] {
        unit.integrate(0.0, 2.0, 0.1, unit.begin());
    }
    assert_eq!(used.fingerprint(), new.fingerprint());
}

#[test]
fn every_unit_can_be_made_for_both_interfaces_at_once() {
    for name in description_names() {
        let [exchange, slave] =
            [MODEL_EXCHANGE, CO_SIMULATION].map(|kind| Unit::made(REGISTRY, &open_description(&name), kind));
        exchange.begin();
        slave.start(0.0);
        assert_eq!(slave.step(0.0, 1e-3), OK);
        assert!(!exchange.completed_step());
    }
}
