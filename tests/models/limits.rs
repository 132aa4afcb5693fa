//! L1 controllers whose control is limited: they follow again as soon as the limits allow it, and report how long the
//! control has been at them.

#![allow(non_snake_case)] // matrices have the names of the field

use adaptive_fmu::execution::Execution;
use adaptive_fmu::template::{Plant, Request, Sizes};
use common::described::{model, refused};
use common::limited_loop::{Law, Solution};
use common::loops::whole;
use common::models::Run;
use common::{OK, Unit, description};

/// A description with other values, initialised.
fn made(text: &str, values: &[(&str, f64)]) -> Run {
    let mut run = Run(Execution::new(model(text).unwrap_or_else(|reason| panic!("{reason}: {text}"))));
    values.iter().for_each(|(name, value)| run.set(name, *value));
    run.0.initialise().unwrap();
    run
}

/// Units of these descriptions as one, connected by signals of these names and sizes.
fn connected(parts: &[(&str, &str)], links: &[([&str; 2], usize)]) -> String {
    let part = |(name, text): &(&str, &str)| {
        let described: toml::Table = text.parse().unwrap();
        let keys = ["model", "structure", "start"].into_iter();
        let mut part: toml::Table = keys.filter_map(|key| Some((key.into(), described.get(key)?.clone()))).collect();
        part.insert("name".into(), (*name).into());
        part
    };
    let link = |(names, size): &([&str; 2], usize)| {
        let names = *names;
        (1..=*size)
            .map(move |i| toml::Value::from(names.map(|name| format!("{name}[{i}]")).to_vec()))
            .collect::<Vec<_>>()
    };
    let parts: Vec<_> = parts.iter().map(|described| toml::Value::Table(part(described))).collect();
    let connections: Vec<_> = links.iter().flat_map(link).collect();
    let structure = toml::Table::from_iter([
        ("connections".to_owned(), toml::Value::Array(connections)),
        ("parts".to_owned(), toml::Value::Array(parts)),
    ]);
    let whole = [("name", "Whole".into()), ("model", "composite".into()), ("description", "".into())];
    let mut whole: toml::Table =
        whole.map(|(key, value): (&str, toml::Value)| (key.to_owned(), value)).into_iter().collect();
    whole.insert("structure".into(), structure.into());
    whole.to_string()
}

/// The root of the mean square of each error, and what else a run is judged by.
#[derive(Debug)]
struct Judged {
    rms: Vec<f64>,
    largest_control: f64,
    longest_at_limit: f64,
}

/// Runs a loop in steps of a millisecond; the errors are those from a time on, s.
fn judged(name: &str, limit: f64, tracking_time: f64, from: f64, until: f64) -> Judged {
    let text = whole(name);
    let model = model(&text).unwrap();
    let m = (1..).take_while(|i| model.variables().find(&format!("controller.u[{i}]")).is_some()).count();
    let of = |variable: &str, i: usize, value: f64| (format!("controller.{variable}[{i}]"), value);
    let of_channel = |i| [of("u_min", i, -limit), of("u_max", i, limit), of("tracking_time", i, tracking_time)];
    let values: Vec<_> = (1..=m).flat_map(of_channel).collect();
    let mut run = made(&text, &values.iter().map(|(name, value)| (name.as_str(), *value)).collect::<Vec<_>>());
    let (mut squares, mut counted) = (vec![0.0; m], 0.0);
    let (mut largest_control, mut longest_at_limit) = (0.0_f64, 0.0_f64);
    for k in 1..=(until * 1e3) as usize {
        run.step(1e-3);
        longest_at_limit = longest_at_limit.max(run.get("controller.time_at_limit"));
        counted += f64::from(u8::from(k as f64 * 1e-3 >= from));
        for (i, sum) in (1..=m).zip(&mut squares) {
            largest_control = largest_control.max(run.get(&format!("controller.u[{i}]")).abs());
            let e = run.get(&format!("reference.r[{i}]")) - run.get(&format!("plant.y[{i}]"));
            *sum += if k as f64 * 1e-3 >= from { e * e } else { 0.0 };
        }
    }
    Judged { rms: squares.iter().map(|sum| (sum / counted).sqrt()).collect(), largest_control, longest_at_limit }
}

#[test]
fn the_robot_tracks_within_limits_far_below_what_it_asks_for_at_its_start() {
    // From an independent simulation of these equations; without limits 0.02533, 0.02278.
    for (limit, expected) in
        [(60.0, [0.02528, 0.02283]), (40.0, [0.02519, 0.02279]), (30.0, [0.02527, 0.02275]), (22.0, [0.02549, 0.02263])]
    {
        let found = judged("3.3.1-case2", limit, -1.0, 5.0, 20.0);
        let close = found.rms.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-5);
        assert!(close && found.largest_control == limit, "{limit}: {found:?}");
        assert!(found.longest_at_limit > 0.05, "{limit}: {found:?}");
    }
    let free = judged("3.3.1-case2", 1e15, -1.0, 5.0, 20.0);
    assert!(free.largest_control > 113.0 && free.longest_at_limit == 0.0, "{free:?}");
}

#[test]
fn without_it_the_robot_is_lost() {
    let found = judged("3.3.1-case2", 30.0, 0.0, 5.0, 20.0);
    assert!(found.rms[0] > 10.0 && found.rms[1] > 10.0, "{found:?}");
}

#[test]
fn where_the_plant_needs_more_than_there_is_no_law_helps_and_the_time_shows_it() {
    let [with, without] = [-1.0, 0.0].map(|time| judged("3.2.1-cosine", 2.0, time, 5.0, 20.0));
    assert!((with.rms[0] - 0.648).abs() < 1e-3 && (without.rms[0] - 0.581).abs() < 1e-3, "{with:?}, {without:?}");
    assert!(with.longest_at_limit > 2.0, "{with:?}");
}

/// A motor of 24 V, of speed and current, with what `new` writes for it; it steps to 100 rad/s.
fn motor(matrices: [&str; 3], bandwidth: f64, tracking_time: f64) -> Run {
    let [A, B, C] = matrices;
    let json = format!(r#"{{"A": {A}, "B": {B}, "C": {C}, "u_min": -24, "u_max": 24}}"#);
    let plant = Some(Plant::parse(&json).unwrap());
    let text = |kind| {
        let (sizes, plant) = (Sizes { states: None, inputs: None, outputs: None }, plant.clone());
        let request = Request {
            kind,
            name: "Mine",
            sizes,
            plant,
            bandwidth: Some(bandwidth),
            reference: &[100.0],
            uncertainty: None,
            experiment: None,
        };
        adaptive_fmu::library::begin(&request).unwrap().text
    };
    let [reference, motor, controller] = [text("reference"), text("state-space"), text("l1")];
    let n = C.matches(',').count() + 1;
    let links =
        [(["reference.r", "controller.r"], 1), (["controller.u", "motor.u"], 1), (["motor.x", "controller.x"], n)];
    let parts = [("reference", &*reference), ("motor", &*motor), ("controller", &*controller)];
    let step = [("reference.step_time[1,1]", 0.1), ("reference.step_height[1,1]", 100.0)];
    made(&connected(&parts, &links), &[&step[..], &[("controller.tracking_time[1]", tracking_time)]].concat())
}

#[test]
fn a_motor_comes_to_its_speed_without_running_past_it() {
    let of_first_order = ["[[-2.0]]", "[[16.0]]", "[[1.0]]"];
    let with_a_current = ["[[-0.1, 25.0], [-50.0, -500.0]]", "[[0.0], [500.0]]", "[[1.0, 0.0]]"];
    // How far it ran past 100 rad/s, and how long it took, when u_ad wound up.
    for (matrices, bandwidth, before) in [(of_first_order, 20.0, 130.0), (with_a_current, 20.0, 120.0)] {
        let peak_and_settling = |tracking_time: f64| {
            let mut run = motor(matrices, bandwidth, tracking_time);
            let (mut peak, mut settled, mut longest) = (0.0_f64, 0.0, 0.0_f64);
            for _ in 0..2000 {
                run.step(1e-3);
                peak = peak.max(run.get("motor.x[1]"));
                longest = longest.max(run.get("controller.time_at_limit"));
                if (run.get("motor.x[1]") - 100.0).abs() > 2.0 {
                    settled = run.0.time() - 0.1;
                }
            }
            assert_eq!(run.get("controller.time_at_limit"), 0.0);
            assert!((run.get("motor.x[1]") - 100.0).abs() < 1e-3);
            (peak, settled, longest)
        };
        let (peak, settled, longest) = peak_and_settling(-1.0);
        assert!(peak < 100.1 && settled < 0.45 && longest > 0.1, "{matrices:?}: {peak}, {settled}, {longest}");
        let (peak, ..) = peak_and_settling(0.0);
        assert!(peak > before, "{matrices:?}: {peak} with tracking off");
    }
}

/// A controller with limits, its plant and its reference as a single FMU.
fn limited_loop(law: &Law) -> Run {
    let reference = "model = 'reference'\n[structure]\nchannels = 1\n[start]\noffset = [0.6]\nsine_amplitude = [0.4]\n\
                     sine_frequency = [3.0]";
    let plant =
        "model = 'state-space'\n[structure]\nA = [[0.0, 1.0], [-3.0, -0.5]]\nB = [[0.0], [0.7]]\nC = [[1.0, 0.0]]";
    let links =
        [(["reference.r", "controller.r"], 1), (["controller.u", "plant.u"], 1), (["plant.x", "controller.x"], 2)];
    let controller = law.description();
    let parts = [("reference", reference), ("plant", plant), ("controller", &*controller)];
    made(&connected(&parts, &links), &[("relative_tolerance", 1e-9)])
}

#[test]
fn a_loop_within_limits_is_that_of_an_independent_solution() {
    let integrator =
        Law { gain: 25.0, inside: true, filter: None, limits: [-2.0, 6.0], tracking_time: -1.0, inertia: 2.0 };
    let filter = Some([1.5, 0.02, 0.05]);
    for law in [
        integrator,
        Law { tracking_time: 0.0, ..integrator },
        Law { tracking_time: 0.2, inside: false, ..integrator },
        Law { gain: 12.0, limits: [-0.5, 4.0], inside: false, inertia: 0.8, ..integrator },
        Law { filter, ..integrator },
        Law { filter, tracking_time: 0.01, inside: false, ..integrator },
        Law { filter, gain: 8.0, inertia: 1.0, ..integrator },
    ] {
        let (mut run, mut solution) = (limited_loop(&law), Solution::at_rest(law));
        let mut at_limit = 0;
        for k in 1..=150 {
            run.step(1e-2);
            solution.advance(1e-2);
            let found = ["plant.x[1]", "plant.x[2]", "controller.u_ad[1]", "controller.u[1]"].map(|name| run.get(name));
            let [x1, x2] = solution.x();
            let expected = [x1, x2, solution.u_ad(), solution.u()];
            let error = found.iter().zip(expected).map(|(a, b)| (a - b).abs() / b.abs().max(1.0)).fold(0.0, f64::max);
            assert!(error < 3e-5, "{law:?}, step {k}: {found:?}, {expected:?}");
            at_limit += u32::from(law.limits.contains(&found[3]));
        }
        assert!(at_limit > 5, "{law:?}: the limits matter, {at_limit}");
    }
}

#[test]
fn limits_that_are_not_reached_change_no_bit() {
    for name in ["L1ActuatedSiso", "L1TwoLinkRobot", "FuzzyL1ActuatedSiso", "L1UnmatchedMimo"] {
        let run = |start: &str| {
            let mut run = made(&format!("{}\n{start}", description(name)), &[]);
            for k in 0..100 {
                run.set("r[1]", 1e-3 * f64::from(k));
                run.set("x[1]", 1e-2 * (0.1 * f64::from(k)).sin());
                run.step(1e-3);
            }
            (run.get("u_ad[1]").to_bits(), run.get("eta_hat[1]").to_bits(), run.get("x_hat[2]").to_bits())
        };
        let free = run("");
        let m = if ["L1TwoLinkRobot", "L1UnmatchedMimo"].contains(&name) { 2 } else { 1 };
        for time in [-1.0, 0.0, 1e-9, 3.0] {
            let limits =
                format!("u_min = {:?}\nu_max = {:?}\ntracking_time = {:?}", vec![-1e6; m], vec![1e6; m], vec![time; m]);
            assert!(run(&limits) == free, "{name}, {time}");
        }
    }
}

/// The rate of u_ad by which the limits change it, where u_ad is so high, in a unit with these lines in its `[start]`.
fn rate_by_limits(text: &str, start: &str, u_ad: f64) -> (f64, Unit) {
    let at = |tracking_time: &str| {
        let unit = Unit::exchange_from_text(&format!("{text}\n{start}\ntracking_time = {tracking_time}"));
        unit.enter(0.0);
        unit.put("r[1]", 1.0);
        assert_eq!(unit.exit(), OK);
        unit.settle();
        let mut states = unit.states();
        states[unit.model.variables().find("u_ad[1]").unwrap().place()] = u_ad;
        assert_eq!(unit.set_states(&states), OK);
        unit
    };
    let times = if start.contains("[8.0, 8.0]") { ["[-1.0, -1.0]", "[0.0, 0.0]"] } else { ["[-1.0]", "[0.0]"] };
    let [on, off] = times.map(at);
    (on.get("der(u_ad[1])") - off.get("der(u_ad[1])"), on)
}

#[test]
fn the_time_is_the_inverse_of_the_gain_in_force() {
    let near = |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 1e-9, "{found}, not {expected}");
    let (rate, _) = rate_by_limits(&description("L1ActuatedSiso"), "u_max = [8.0]", 50.0);
    near(rate, -42.0 * 20.0);
    // A fuzzy gain: that of an error of 1, and the constant one where the error is small.
    let fuzzy = description("FuzzyL1ActuatedSiso");
    let (rate, unit) = rate_by_limits(&fuzzy, "u_max = [8.0]", 50.0);
    assert!(unit.get("gain_in_force[1,1]") == unit.get("k_f") && unit.get("k_f") < 10.0);
    near(rate, -42.0 * unit.get("k_f"));
    near(rate_by_limits(&fuzzy, "u_max = [8.0]\nk_e = 2.0", 50.0).0, -42.0 * 20.0);
    // Channels that answer to each other: the row's magnitudes together.
    let coupled = description("L1TwoLinkRobot").replace("[[30.0, 0.0]", "[[30.0, -4.0]");
    near(rate_by_limits(&coupled, "u_max = [8.0, 8.0]", 50.0).0, -42.0 * 34.0);
}

#[test]
fn a_time_that_is_none_is_refused_and_can_be_tuned() {
    let text = description("L1ActuatedSiso");
    refused(&format!("{text}\ntracking_time = [-2.0]"), &["tracking_time", "-2"]);
    for wrong in ["-0.5", "1e-10"] {
        refused(&format!("{text}\ntracking_time = [{wrong}]"), &["tracking_time[1] = ", "-1 (1/K), 0 (off)"]);
    }
    let unit = Unit::from_text(&format!("{text}\nu_max = [3.0]"));
    unit.start(0.0);
    unit.put("r[1]", 1.0);
    unit.run(0.0, 10, 1e-3);
    unit.put("tracking_time[1]", -0.5);
    assert_ne!(unit.step(0.01, 1e-3), OK);
    assert!(unit.last_message().contains("tracking_time[1] = -0.5"), "{}", unit.last_message());
    assert_eq!(unit.get("tracking_time[1]"), -1.0);
    unit.put("tracking_time[1]", 0.5);
    unit.run(0.01, 10, 1e-3);
}

/// A controller whose state is kept at zero: its control goes to the limit in the direction of its reference.
fn at_its_limit() -> String {
    format!("{}\nu_min = [-1.0]\nu_max = [3.0]", description("L1ActuatedSiso"))
}

#[test]
fn the_time_at_a_limit_is_reported_as_long_as_the_control_is_there() {
    let unit = Unit::from_text(&at_its_limit());
    unit.start(0.0);
    let (mut since, mut longest) = (None, 0.0_f64);
    for k in 0..700 {
        let t = 1e-3 * f64::from(k);
        unit.put("r[1]", if k < 300 { 1.0 } else { -1.0 });
        if k == 500 {
            assert_eq!(unit.set_boolean("enabled", false), OK);
        }
        unit.put("u_manual[1]", if k < 600 { 0.5 } else { 4.0 });
        assert_eq!(unit.step(t, 1e-3), OK);
        let (u, now) = (unit.get("u[1]"), t + 1e-3);
        let side = [-1.0, 3.0].into_iter().find(|limit| u == *limit);
        since = side.map(|side| since.filter(|(other, _)| *other == side).unwrap_or((side, now)));
        let expected = since.map_or(0.0, |(_, since)| now - since);
        assert!((unit.get("time_at_limit") - expected).abs() < 1e-12, "{now}: {u}, {}", unit.get("time_at_limit"));
        longest = longest.max(expected);
        if k == 550 {
            assert_eq!((u, expected), (0.5, 0.0), "a manual control within the limits");
        }
    }
    assert!(longest > 0.25 && unit.get("u[1]") == 3.0 && unit.get("time_at_limit") > 0.09);
    // The desired dynamics have the poles −21 ± 0.743 j: 4/21 s.
    let messages: Vec<_> = unit.messages().into_iter().filter(|(_, category, _)| category == "logLimit").collect();
    assert_eq!(messages.len(), 1, "{messages:?}");
    assert!(["u[1]", "u_max[1]", "0.191 s"].iter().all(|word| messages[0].2.contains(word)), "{messages:?}");
    assert_eq!(unit.reset(), OK);
    unit.start(0.0);
    assert_eq!(unit.get("time_at_limit"), 0.0);
}

#[test]
fn a_saved_state_goes_on_counting_bit_for_bit() {
    let unit = Unit::from_text(&at_its_limit());
    unit.start(0.0);
    unit.put("r[1]", 1.0);
    unit.run(0.0, 100, 1e-3);
    let state = unit.save();
    unit.run(0.1, 50, 1e-3);
    let (time, values) = (unit.get("time_at_limit"), unit.values());
    assert!(time > 0.14);
    assert_eq!(unit.restore(state), OK);
    assert!(unit.get("time_at_limit") < 0.1);
    unit.run(0.1, 50, 1e-3);
    assert_eq!((unit.get("time_at_limit"), unit.values()), (time, values));
    let other = Unit::from_text(&at_its_limit());
    other.start(0.0);
    let (status, state) = other.deserialise(&unit.bytes(state));
    assert_eq!((status, other.restore(state)), (OK, OK));
    other.put("r[1]", 1.0);
    other.run(0.1, 50, 1e-3);
    assert_eq!(other.get("time_at_limit"), time);
}

#[test]
fn in_model_exchange_the_time_goes_on_with_the_masters_steps_and_is_no_event() {
    let unit = Unit::exchange_from_text(&at_its_limit());
    unit.begin();
    let place = unit.model.variables().find("u_ad[1]").unwrap().place();
    let complete = |t: f64, u_ad: f64| {
        let mut states = unit.states();
        states[place] = u_ad;
        assert_eq!((unit.set_time(t), unit.set_states(&states)), (OK, OK));
        assert!(!unit.completed_step(), "an event at {t}");
        unit.get("time_at_limit")
    };
    assert_eq!([complete(0.1, 50.0), complete(0.25, 40.0), complete(0.25, 40.0)], [0.0, 0.15, 0.15]);
    assert_eq!([complete(0.3, 2.0), complete(0.4, -7.0), complete(0.5, -6.0)], [0.0, 0.0, 0.5 - 0.4]);
}

#[test]
fn a_thrust_at_its_limit_counts_too() {
    let unit = Unit::new("L1Quadrotor");
    assert_eq!(unit.set_boolean("enabled", false), OK);
    unit.start(0.0);
    unit.put("u_manual[1]", 20.0);
    unit.run(0.0, 20, 1e-3);
    assert!(unit.get("u[1]") == 15.0 && (unit.get("time_at_limit") - 0.019).abs() < 1e-9);
    unit.run(0.02, 2000, 1e-3);
    assert!(unit.messages().is_empty(), "what a person asks for says nothing of the design");
    unit.put("u_manual[1]", 5.0);
    unit.run(2.02, 1, 1e-3);
    assert_eq!(unit.get("time_at_limit"), 0.0);
}

#[test]
fn a_limit_under_manual_control_means_nothing_for_the_design() {
    for name in
        ["L1NonlinearSiso", "L1LimitNonlinearSiso", "L1SampledNonlinearSiso", "LadrcNonlinearSiso", "PidNonlinearSiso"]
    {
        let unit = Unit::new(name);
        assert_eq!(unit.set_boolean("enabled", false), OK);
        unit.put("u_max[1]", 5.0);
        unit.start(0.0);
        unit.put("u_manual[1]", 20.0);
        unit.run(0.0, 2000, 1e-2);
        assert!(unit.get("u[1]") == 5.0 && (unit.get("time_at_limit") - 19.99).abs() < 1e-6, "{name}");
        assert_eq!(unit.messages(), [], "{name}");
    }
}

#[test]
fn check_reports_the_time_and_warns_where_it_deviates() {
    use adaptive_fmu::report::{Finding, Value};
    use adaptive_fmu::system::Verdict;
    let limits = |start: &str| {
        let findings = model(&format!("{}\n{start}", description("L1ActuatedSiso"))).unwrap().report().findings;
        findings.into_iter().filter(|finding| finding.section == "Limits of the control").collect::<Vec<Finding>>()
    };
    assert!(limits("").is_empty());
    let [found] = &limits("u_max = [3.0]")[..] else { panic!("one channel") };
    assert!(matches!(found.value, Value::Number(time) if (time - 0.05).abs() < 1e-12), "{found:?}");
    let [found] = &limits("u_max = [3.0]\ntracking_time = [0.0]")[..] else { panic!("one channel") };
    assert!(found.verdict == Verdict::Warning && found.note.contains("tracking_time[1] = -1"), "{found:?}");
}
