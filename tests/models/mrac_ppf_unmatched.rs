//! MRAC with prescribed performance for unmatched uncertainty: against its equations written out, and on the plant of example
//! 3.4.1.
mod by_hand;

use adaptive_fmu::error::Invalid;
use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::{REGISTRY, begin};
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::report::Value;
use adaptive_fmu::system::Verdict;
use adaptive_fmu::template::{Plant, Request, Sizes};
use common::closed::{Closed, near};
use common::described::model;
use common::models::Run;
use common::{Unit, description};

const NAME: &str = "MracPpfUnmatchedMimo";

fn read(text: &str) -> Result<Run, Invalid> {
    Ok(Run(Execution::new(Model::from_description(Description::read(text)?, REGISTRY)?)))
}

/// The unit with other values, before its initialisation.
fn unit(start: &str) -> Run {
    let mut table: toml::Table = description(NAME).parse().unwrap();
    table["start"].as_table_mut().unwrap().extend(start.parse::<toml::Table>().unwrap());
    read(&table.to_string()).unwrap()
}

/// The loop of example 3.4.1 as a single FMU, except for its controller.
fn whole(start: &str, of_plant: &str) -> Run {
    whole_of(start, of_plant).started(1e-8)
}

fn whole_of(start: &str, of_plant: &str) -> Closed {
    let closed = Closed::new().part("reference", "ReferenceUnmatchedMimo", "").part("plant", "UnmatchedMimo", of_plant);
    let closed = closed.part("controller", NAME, start).connected("reference.r", "controller.r", 2);
    closed.connected("plant.x", "controller.x", 3).connected("controller.u", "plant.u", 2)
}

/// Results of a loop: by channel, largest e/ρ, largest |e| and rms e over the whole run; largest |u|.
#[derive(Debug, Default)]
struct Found {
    part: [f64; 3],
    largest: [f64; 3],
    rms: [f64; 3],
    u: [f64; 2],
    /// Least 1 + θ̂_23/A_23.
    turned: f64,
    /// Number of evaluations.
    count: f64,
}

impl Found {
    fn note(&mut self, run: &Run, prefix: &str, e: [f64; 3]) {
        let get = |name: &str, i: usize| run.get(&format!("{prefix}{name}[{}]", i + 1));
        for (i, e) in e.into_iter().enumerate() {
            self.part[i] = self.part[i].max(e.abs() / get("rho", i));
            self.largest[i] = self.largest[i].max(e.abs());
            self.rms[i] += e * e;
        }
        (0..2).for_each(|i| self.u[i] = self.u[i].max(get("u", i).abs()));
        self.turned = self.turned.min(1.0 + run.get(&format!("{prefix}theta_hat[3,2]")));
        self.count += 1.0;
    }

    fn done(mut self) -> Self {
        self.rms = self.rms.map(|sum| (sum / self.count).sqrt());
        println!("{self:?}");
        self
    }
}

/// Runs the loop as a single FMU.
fn of_whole(start: &str, step: f64) -> Found {
    let (mut run, mut found) = (whole(start, ""), Found { turned: 1.0, ..Found::default() });
    let error = |run: &Run| std::array::from_fn(|i| run.get(&format!("controller.e[{}]", i + 1)));
    found.note(&run, "controller.", error(&run));
    for _ in 0..(30.0 / step).round() as usize {
        run.step(step);
        found.note(&run, "controller.", error(&run));
    }
    found.done()
}

fn hand_on(from: &Run, output: &str, to: &mut Run, input: &str, count: usize) {
    (1..=count).for_each(|i| to.set(&format!("{input}[{i}]"), from.get(&format!("{output}[{i}]"))));
}

/// Order in which FMUs are stepped.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Order {
    PlantFirst,
    AtOnce,
}

/// Runs the loop in separate units until a time; the errors are those of the plant against the model. Or when and why it was
/// lost.
fn of_units(start: &str, order: Order, step: f64, until: f64) -> Result<Found, String> {
    let of = |name: &str| read(&description(name)).unwrap();
    let (mut reference, mut plant) = (of("ReferenceUnmatchedMimo"), of("UnmatchedMimo"));
    let mut controller = unit(start);
    [&mut reference, &mut plant].into_iter().for_each(|unit| unit.0.initialise().unwrap());
    hand_on(&reference, "r", &mut controller, "r", 2);
    controller.0.initialise().unwrap();
    let mut found = Found { turned: 1.0, ..Found::default() };
    for _ in 0..(until / step).round() as usize {
        if order == Order::AtOnce {
            hand_on(&reference, "r", &mut controller, "r", 2);
            hand_on(&plant, "x", &mut controller, "x", 3);
        }
        hand_on(&controller, "u", &mut plant, "u", 2);
        reference.step(step);
        plant.step(step);
        if order == Order::PlantFirst {
            hand_on(&reference, "r", &mut controller, "r", 2);
            hand_on(&plant, "x", &mut controller, "x", 3);
        }
        controller.0.step(controller.0.time(), step).map_err(|reason| reason.to_string())?;
        let of_model = |i: usize| plant.get(&format!("x[{}]", i + 1)) - controller.get(&format!("x_m[{}]", i + 1));
        found.note(&controller, "", [of_model(0), of_model(1), controller.get("e[3]")]);
    }
    println!("{order:?} {step}:");
    Ok(found.done())
}

#[test]
fn the_plant_of_example_3_4_1_stays_in_its_funnels() {
    let found = of_whole("", 0.005);
    for (name, found, known) in [
        ("largest e_1/rho_1", found.part[0], 0.06604),
        ("largest e_2/rho_2", found.part[1], 0.2313),
        ("largest e_3/rho_3", found.part[2], 0.0410),
        ("largest e_1", found.largest[0], 0.01883),
        ("largest e_2", found.largest[1], 0.04894),
        ("rms e_1", found.rms[0], 0.002554),
        ("rms e_2", found.rms[1], 0.008071),
        ("largest u_1", found.u[0], 1.072),
        ("largest u_2", found.u[1], 2.374),
    ] {
        near(name, found, known, 1e-3);
    }
    assert!(found.turned > 0.84, "what the proof wants to be positive: {}", found.turned);
}

/// Known of one step of an independent simulation only.
#[test]
fn without_adaptation_of_the_unmatched_row_its_error_grows() {
    near("largest e_2/rho_2", of_whole("gamma = [1.0, 0.0, 1.0]", 0.01).part[1], 0.64, 0.01);
}

/// The step of the reference at 15 s, 1.5 in the rate of x_m1, reaches the model a communication step before the plant
/// answers it: at 5 ms, e_1 has that size.
#[test]
fn in_separate_units_it_stays_in_its_funnels() {
    for (order, step, known) in [
        (Order::PlantFirst, 1e-3, [0.0654, 0.230]),
        (Order::AtOnce, 1e-3, [0.068, 0.238]),
        (Order::PlantFirst, 5e-3, [0.146, 0.230]),
        (Order::AtOnce, 5e-3, [0.146, 0.265]),
    ] {
        let found = of_units("", order, step, 30.0).unwrap();
        for (part, known) in found.part.into_iter().zip(known) {
            assert!((part - known).abs() <= 5.5e-4, "{order:?}, {step} s, e/rho: {part}, not {known}");
        }
    }
}

/// 1/s = 9.0 ms if all are stepped simultaneously, 2/s = 18 ms if the plant is stepped first.
#[test]
fn the_longest_steps_are_those_that_s_gives() {
    for (order, stable, lost) in [(Order::AtOnce, 8e-3, 10e-3), (Order::PlantFirst, 17e-3, 20e-3)] {
        assert!(of_units("", order, stable, 30.0).is_ok(), "{order:?}, {stable} s");
        let reason = of_units("", order, lost, 30.0).unwrap_err();
        assert!(reason.contains("it has left its funnel"), "{order:?}, {lost} s: {reason}");
    }
}

/// The rule holds up to |x| = 5.77 as it is; with γ_2 = 2 to less than 1.
#[test]
fn a_fast_adaptation_of_the_unmatched_row_takes_the_funnel_of_the_state_that_drives_it_and_loses_separate_units() {
    for (gamma, least, most) in [(0.4, 0.0, 0.05), (2.0, 0.5, 0.6), (10.0, 0.9, 1.0)] {
        let part = of_whole(&format!("gamma = [1.0, {gamma:?}, 1.0]"), 0.01).part[2];
        assert!((least..most).contains(&part), "{gamma}: {part}");
    }
    for order in [Order::AtOnce, Order::PlantFirst] {
        let reason = of_units("gamma = [1.0, 5.0, 1.0]", order, 1e-3, 30.0).unwrap_err();
        assert!(reason.contains("it has left its funnel"), "{order:?}: {reason}");
    }
}

const START: &str = "x0 = [0.4, -0.4, -0.5]";

#[test]
fn a_start_outside_is_refused_with_a_bound_that_would_do() {
    let closed = |start: &str| whole_of(start, START).prepared(1e-8);
    let mut run = closed("x_m_start = 'given'");
    let reason = run.0.initialise().map(|()| run.failure(0.01).to_string()).unwrap_or_else(|reason| reason.to_string());
    // b_2 = 0.03 · 1.0986/(0.5 · 0.36) + 0.8 · 0.45, and alpha = b_2.
    assert!(reason.contains("controller.e[3] = -1.043") && reason.contains("rho_0[3] above 1.043"), "{reason}");
    let mut run = closed("");
    run.0.initialise().unwrap();
    run.run(500, 0.01);
    assert_eq!(run.integer("controller.funnel_reopened"), 0, "from where the plant is it starts with errors of 0");
}

#[test]
fn an_error_that_leaves_its_funnel_is_reported_and_nothing_has_changed() {
    let mut run = unit("");
    run.0.initialise().unwrap();
    run.step(0.5);
    let before = (run.get("u[2]"), run.get("rho[2]"));
    run.set("x[2]", 0.45);
    let reason = run.failure(0.5).to_string();
    for message in ["e[2] = 0.4", "rho[2]", "it has left its funnel", "t = "] {
        assert!(reason.contains(message), "{message}: {reason}");
    }
    assert_eq!((run.0.time(), run.get("u[2]"), run.get("rho[2]")), (0.5, before.0, before.1), "as before the step");
    // The state that drives the row.
    run.set("x[2]", 0.0);
    run.set("x[3]", -2.0);
    let reason = run.failure(0.5).to_string();
    assert!(reason.contains("e[3] = -"), "{reason}");
    run.set("x[3]", 0.0);
    run.step(0.5);
}

#[test]
fn a_funnel_that_was_left_opens_again_where_that_is_asked_for() {
    let mut run = unit("on_funnel_exit = 'reopen'\nrho_0 = [5.0, 5.0, 9.0]");
    run.0.initialise().unwrap();
    run.run(60, 0.1);
    run.set("x[2]", 0.3);
    run.step(0.01);
    assert!(run.integer("funnel_reopened") >= 1 && run.get("rho[2]") > 0.3, "{}", run.get("rho[2]"));
    assert!(run.get("u[1]").is_finite() && run.get("e[3]").abs() < run.get("rho[3]"));
}

#[test]
fn taking_over_makes_no_jump_and_begins_anew() {
    let mut run = unit("takeover_rate = 2.0");
    run.set_boolean("enabled", false);
    run.set("u_manual[1]", 3.0);
    run.set("u_manual[2]", -1.0);
    run.set("x[2]", 4.0);
    run.0.initialise().unwrap();
    run.run(50, 0.1);
    run.set("x[2]", 1.0);
    run.run(200, 0.1);
    assert_eq!((run.get("u[1]"), run.get("u[2]"), run.get("theta_hat[2,2]")), (3.0, -1.0, 0.0), "by hand");
    assert!((run.get("x_m[2]") - 1.0).abs() < 1e-3, "the model follows: {}", run.get("x_m[2]"));
    run.set("x[1]", 0.2);
    run.set("x[2]", 0.9);
    run.set("r[1]", 0.3);
    run.set_boolean("enabled", true);
    run.step(1e-9);
    assert!((run.get("u[1]") - 3.0).abs() < 1e-6 && (run.get("u[2]") + 1.0).abs() < 1e-6, "{}", run.get("u[1]"));
    let away = (run.get("x_m[1]") - 0.2).abs() + (run.get("x_m[2]") - 0.9).abs();
    assert!(away < 1e-7, "the model begins where the plant is: {away}");
    assert!((run.get("rho[1]") - 0.5).abs() < 1e-6 && run.get("e[3]").abs() < 1e-6);
    let u_b = run.get("u_b[1]");
    assert!(u_b.abs() > 0.1);
    run.step(0.1);
    near("what is left", run.get("u_b[1]"), u_b * (-0.2_f64).exp(), 1e-5);
}

#[test]
fn a_control_at_its_limit_is_reported() {
    let mut run = unit("u_max = [0.5, 9.0]\nrho_0 = [9.0, 9.0, 9.0]\nrho_inf = [8.0, 8.0, 8.0]");
    run.set("r[1]", 0.1);
    run.0.initialise().unwrap();
    run.step(0.01);
    assert_eq!(run.0.take_messages().count(), 0);
    run.set("r[1]", 2.0);
    run.step(0.01);
    assert_eq!(run.get("u[1]"), 0.5);
    assert!(run.0.take_messages().any(|message| message.text.contains("isn't guaranteed")));
}

#[test]
fn a_step_that_the_barriers_do_not_tolerate_is_reported_in_co_simulation() {
    for (step, message) in [(8e-3, false), (10e-3, true)] {
        let unit = Unit::new(NAME);
        unit.start(0.0);
        unit.run(0.0, 3, step);
        assert_eq!(unit.get_boolean("step_too_long"), message, "{step} s");
        let texts: Vec<_> =
            unit.messages().into_iter().filter(|(_, category, _)| category == "logStepTooLong").collect();
        assert_eq!(texts.len(), usize::from(message));
        assert!(texts.iter().all(|(.., text)| text.contains("1.11") && text.contains("as a single FMU")), "{texts:?}");
    }
}

#[test]
fn the_step_that_is_advised_is_never_above_the_bound() {
    // 8.95e-3 s, where 9.0e-3 s is nearest.
    let unit = Unit::from_text(&description(NAME).replace("0.03, 10.0]", "0.03, 10.05]"));
    unit.start(0.0);
    unit.run(0.0, 3, 8.99e-3);
    let messages = unit.messages();
    assert!(messages.iter().any(|(.., text)| text.contains("Use 8.9e-3 s or less")), "{messages:?}");
}

#[test]
fn the_design_report_has_the_rule_for_the_gains_and_the_step() {
    let number = |text: &str, name: &str| {
        let report = model(text).unwrap().report();
        let found = report.findings.iter().find(|finding| finding.name == name);
        let found = found.unwrap_or_else(|| panic!("`{name}` among {:?}", report.findings));
        let Value::Number(value) = found.value else { panic!("{found:?}") };
        (value, found.verdict)
    };
    let text = description(NAME);
    let ok = |name: &str, known: f64| {
        let (value, verdict) = number(&text, name);
        assert!((value / known - 1.0).abs() < 1e-12 && verdict == Verdict::Ok, "{name}: {value}, not {known}");
    };
    let s = 10.0 / 0.09;
    ok("s", s);
    ok("longest step", 1.0 / s);
    ok("largest |x| for gamma[2]", ((s / 3.0 * 0.05_f64).powi(2) / 0.1 - 1.0).sqrt());
    // The condition of [1 0; 1 1] is the square of the golden ratio.
    ok("error of the input gain", 2.0 / (3.0 + 5.0_f64.sqrt()));
    let fast = text.replace("gamma = [1.0, 0.1, 1.0]", "gamma = [1.0, 10.0, 1.0]");
    assert_eq!(number(&fast, "largest |x| for gamma[2]"), (0.0, Verdict::Warning));
    let slow = text.replace("step = 0.001", "step = 0.02");
    assert_eq!(number(&slow, "longest step").1, Verdict::Warning);
}

#[test]
fn structures_that_the_law_cannot_control_are_refused() {
    let text = description(NAME);
    let unmatched = "unmatched = [{ row = 2, driven_by = 3 }]";
    for (from, to, named) in [
        (unmatched, "", "nothing of row 2"),
        (unmatched, "unmatched = [{ row = 4, driven_by = 3 }]", "row = 4"),
        (unmatched, "unmatched = [{ row = 1, driven_by = 3 }]", "the controls reach this one"),
        (unmatched, "unmatched = [{ row = 2, driven_by = 2 }]", "one integrator"),
        (unmatched, "unmatched = [{ row = 2, driven_by = 1 }]", "A: row 2, column 1 = 0"),
        (unmatched, "unmatched = [{ row = 2, driven_by = 3 }, { row = 2, driven_by = 3 }]", "must be given once"),
        (
            "B = [[1.0, 0.0], [0.0, 0.0], [1.0, 1.0]]",
            "B = [[1.0, 0.0], [0.0, 0.1], [1.0, 1.0]]",
            "must be 2, one a control",
        ),
        ("B = [[1.0, 0.0], [0.0, 0.0], [1.0, 1.0]]", "B = [[1.0, 1.0], [0.0, 0.0], [1.0, 1.0]]", "independently"),
        (
            "[start]",
            "[start]\nA_m = [[-1.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, -1.0, -1.8]]",
            "A_m[2,2] = -1: must be 0",
        ),
        ("[start]", "[start]\nA_m = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, -1.8]]", "Hurwitz"),
        ("rho_inf = [0.05", "rho_inf = [0.5", "rho_inf[1] = 0.5"),
    ] {
        assert!(text.contains(from), "{from}");
        let reason = read(&text.replace(from, to)).map(drop).unwrap_err().to_string();
        assert!(reason.contains(named), "{to}: {reason}");
    }
    // Three levels: the twin rotor.
    let twin = description("L1TwinRotor").replace("model = \"l1\"", "model = \"mrac-ppf-unmatched\"");
    assert!(read(&twin).is_err());
}

/// A motor of which friction, torque and resistance are others than they are thought to be.
#[test]
fn a_new_controller_keeps_the_speed_of_a_motor_whose_load_no_voltage_reaches() {
    let json = r#"{"A": [[-0.5, 250.0], [-25.0, -500.0]], "B": [[0.0], [500.0]], "C": [[1.0, 0.0]], "D": 0}"#;
    let sizes = Sizes { states: None, inputs: None, outputs: None };
    let plant = Some(Plant::parse(json).unwrap());
    let request = Request {
        kind: "mrac-ppf-unmatched",
        name: "Mine",
        sizes,
        plant,
        bandwidth: Some(10.0),
        reference: &[100.0],
        uncertainty: None,
        experiment: None,
    };
    let text = begin(&request).unwrap().text;
    let motor = "model = 'state-space'\n[structure]\nA = [[-2.0, 200.0], [-25.0, -650.0]]\nB = [[0.0], [450.0]]\nC = [[1.0, 0.0]]";
    let reference = "model = 'reference'\n[structure]\nchannels = 1\n[start]\nstep_time = [[0.1, 0.0, 0.0, 0.0]]\nstep_height = \
                     [[100.0, 0.0, 0.0, 0.0]]";
    let closed = Closed::new().described("reference", reference, "").described("plant", motor, "");
    let closed = closed.described("controller", &text, "").connected("reference.r", "controller.r", 1);
    let mut run = closed.connected("plant.x", "controller.x", 2).connected("controller.u", "plant.u", 1).started(1e-8);
    let mut part = 0.0_f64;
    for _ in 0..3000 {
        run.step(1e-3);
        let of = |i: usize| (run.get(&format!("controller.e[{i}]")) / run.get(&format!("controller.rho[{i}]"))).abs();
        part = part.max(of(1)).max(of(2));
    }
    let speed = run.get("plant.x[1]");
    println!("{speed}, largest e/rho {part}");
    assert_eq!(run.integer("controller.funnel_reopened"), 0);
    assert!((speed - 100.0).abs() < 1.0 && (0.01..0.9).contains(&part), "{speed}, {part}");
}
