//! L1 with prescribed performance: against its equations written out, on the loops of the thesis, and what becomes of an error
//! that leaves its funnel.
#![allow(non_snake_case)] // matrices have the names of the field

mod by_hand;
mod sampled;

use adaptive_fmu::error::Invalid;
use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use common::closed::{Closed, near};
use common::description;
use common::models::Run;
use toml::Table;

fn run_of(text: &str) -> Result<Run, Invalid> {
    Ok(Run(Execution::new(Model::from_description(Description::read(text)?, REGISTRY)?)))
}

/// A unit of this package with further start values, before its initialisation.
fn unit(name: &str, start: &str) -> Run {
    let mut table: Table = description(name).parse().unwrap();
    let all = table.entry("start").or_insert_with(|| Table::new().into()).as_table_mut().unwrap();
    all.extend(start.parse::<Table>().unwrap());
    run_of(&table.to_string()).unwrap()
}

/// Results of a loop of separate or joint FMUs: largest |e|/ρ, rms of e from 5 s on, largest |u|, channel by channel.
struct Found {
    part: Vec<f64>,
    late_part: Vec<f64>,
    rms: Vec<f64>,
    max: Vec<f64>,
    count: f64,
}

impl Found {
    fn new(m: usize) -> Self {
        let none = vec![0.0; m];
        Found { part: none.clone(), late_part: none.clone(), rms: none.clone(), max: none, count: 0.0 }
    }

    fn note(&mut self, t: f64, get: impl Fn(String) -> f64) {
        let is_late = t >= 5.0 - 1e-9;
        self.count += f64::from(u8::from(is_late));
        for i in 0..self.part.len() {
            let [e, rho, u] = ["e", "rho", "u"].map(|name| get(format!("{name}[{}]", i + 1)));
            self.part[i] = self.part[i].max((e / rho).abs());
            self.max[i] = self.max[i].max(u.abs());
            if is_late {
                self.rms[i] += e * e;
                self.late_part[i] = self.late_part[i].max((e / rho).abs());
            }
        }
    }

    fn done(mut self) -> Self {
        self.rms.iter_mut().for_each(|rms| *rms = (*rms / self.count).sqrt());
        println!("part {:?} late {:?} rms {:?} max {:?}", self.part, self.late_part, self.rms, self.max);
        self
    }
}

/// A loop as a single FMU, for 10 s.
fn whole([reference, plant, controller]: [&str; 3], [of_plant, of_controller]: [&str; 2], [m, n]: [usize; 2]) -> Found {
    let closed = Closed::new().part("reference", reference, "").part("plant", plant, of_plant);
    let mut closed = closed.part("controller", controller, of_controller).connected("reference.r", "controller.r", m);
    if n > m {
        closed = closed.connected("reference.dr", "controller.dr", m).connected("reference.ddr", "controller.ddr", m);
    }
    let closed = closed.connected("plant.x", "controller.x", n).connected("controller.u", "plant.u", m);
    let mut run = closed.started(1e-8);
    let mut found = Found::new(m);
    for k in 0..=10_000 {
        if k > 0 {
            run.step(1e-3);
        }
        found.note(f64::from(k) * 1e-3, |name| run.get(&format!("controller.{name}")));
    }
    found.done()
}

/// Asserts that numbers are those known, each within a part of itself.
#[track_caller]
fn all_near(what: &str, found: &[f64], known: &[f64], part: f64) {
    assert_eq!(found.len(), known.len());
    found.iter().zip(known).for_each(|(&found, &known)| near(what, found, known, part));
}

const COUPLED: [&str; 3] = ["ReferenceCoupledMimo", "CoupledMimo", "L1PpfCoupledMimo"];
/// Start of the model of example 6.5.2: that of the plant.
const MODEL: &str = "x_m0 = [0.6, -0.8, 0.4]\n";
const FIRST: &str = "x0 = [0.6, -0.8, 0.4]";
const SECOND: &str = "x0 = [0.6, -0.8, 0.4]\nnonaffine = true";
const BUMPLESS: &str = "u_ad_start = 'bumpless'";
/// Tolerance of the figures against those of the reference simulation, which have four digits.
const DIGITS: f64 = 1e-3;

#[test]
fn the_system_of_example_6_5_1_stays_in_its_funnel() {
    for (start, part, max) in [
        ("", [0.3171, 0.4127, 0.2509], [19.06, 64.43, 22.01]),
        (BUMPLESS, [0.3178, 0.6451, 0.2509], [35.61, 34.98, 10.36]),
    ] {
        let found = whole(COUPLED, [FIRST, start], [3, 3]);
        all_near("e/rho", &found.part, &part, DIGITS);
        all_near("rms e", &found.rms, &[0.01080, 0.01103, 0.008724], DIGITS);
        all_near("max u", &found.max, &max, DIGITS);
    }
}

#[test]
fn the_system_that_the_control_enters_nonlinearly_stays_in_its_funnel() {
    for (start, part, rms_2, max) in [
        ("", [0.5667, 0.5644, 0.2600], 0.01206, [13.16, 92.25, 22.00]),
        (BUMPLESS, [0.5667, 0.5719, 0.2512], 0.01208, [21.84, 58.08, 9.967]),
    ] {
        let found = whole(COUPLED, [SECOND, &format!("{MODEL}{start}")], [3, 3]);
        all_near("e/rho", &found.part, &part, DIGITS);
        all_near("rms e", &found.rms, &[0.01130, rms_2, 0.008727], DIGITS);
        all_near("max u", &found.max, &max, DIGITS);
    }
}

#[test]
fn a_bumpless_start_spares_the_peak_where_the_state_starts_elsewhere() {
    let elsewhere = "x0 = [0.6, 0.2, 1.4]\nnonaffine = true";
    for (start, largest) in [("", 4020.0), (BUMPLESS, 23.3)] {
        let found = whole(COUPLED, [elsewhere, &format!("x_m0 = [0.6, 0.2, 1.4]\n{start}")], [3, 3]);
        let of_all = found.max.iter().copied().fold(0.0, f64::max);
        near(start, of_all, largest, 5e-3);
        assert!(found.part.iter().all(|&part| part < 1.0));
    }
}

#[test]
fn without_the_barrier_the_error_leaves() {
    let closed = Closed::new().part("reference", COUPLED[0], "").part("plant", COUPLED[1], SECOND);
    let closed = closed.part("controller", COUPLED[2], &format!("{MODEL}barrier_gain = [0.0, 0.0, 0.0]"));
    let closed = closed.connected("reference.r", "controller.r", 3).connected("plant.x", "controller.x", 3);
    let mut run = closed.connected("controller.u", "plant.u", 3).started(1e-8);
    let failure = (0..10_000).find_map(|_| run.0.step(run.0.time(), 1e-3).err()).expect("the plain law leaves");
    assert!(failure.to_string().contains("has left its funnel"), "{failure}");
}

#[test]
fn the_robot_stays_in_its_funnel() {
    let found = whole(["ReferenceTwoLinkRobot", "TwoLinkRobot", "L1PpfTwoLinkRobot"], ["", ""], [2, 4]);
    all_near("e/rho", &found.part, &[0.4618, 0.5509], DIGITS);
    all_near("e/rho from 5 s on", &found.late_part, &[0.3573, 0.4399], DIGITS);
    all_near("rms e", &found.rms, &[0.001329, 0.001624], DIGITS);
    all_near("max u", &found.max, &[113.2, 89.51], DIGITS);
}

/// A loop of separate units.
#[derive(Debug, Clone, Copy)]
struct Split<'a> {
    of_plant: &'a str,
    /// Further start values of the controller.
    of_controller: &'a str,
    is_jacobi: bool,
    step: f64,
    /// Standard deviation of what a sensor adds to each state, and which noise it is.
    noise: (f64, i32),
}

impl Split<'_> {
    fn new(of_plant: &str, is_jacobi: bool, step: f64) -> Split<'_> {
        Split { of_plant, of_controller: "", is_jacobi, step, noise: (0.0, 1) }
    }

    /// The loop for 10 s; nothing where it leaves its funnel.
    fn found(self) -> Option<Found> {
        let Split { of_plant, of_controller, is_jacobi, step, noise: (deviation, seed) } = self;
        let model = if of_plant == SECOND { MODEL } else { "" };
        let sensor = Description::read(&description("Sensor").replace("channels = 1", "channels = 3")).unwrap();
        let mut sensor = Run(Execution::new(Model::from_description(sensor, REGISTRY).unwrap()));
        (1..=3).for_each(|i| sensor.set(&format!("noise_deviation[{i}]"), deviation));
        sensor.set_integer("seed", seed);
        sensor.set("sample_time", step);
        let [mut reference, mut plant, mut controller] =
            [unit(COUPLED[0], ""), unit(COUPLED[1], of_plant), unit(COUPLED[2], &format!("{model}{of_controller}"))];
        let hand_on = |from: &Run, [of, to]: [&str; 2], unit: &mut Run| {
            (1..=3).for_each(|i| unit.set(&format!("{to}[{i}]"), from.get(&format!("{of}[{i}]"))));
        };
        reference.0.initialise().unwrap();
        plant.0.initialise().unwrap();
        hand_on(&reference, ["r", "r"], &mut controller);
        hand_on(&plant, ["x", "u"], &mut sensor);
        sensor.0.initialise().unwrap();
        hand_on(&sensor, ["y", "x"], &mut controller);
        controller.0.initialise().unwrap();
        let mut found = Found::new(3);
        for k in 1..=(10.0 / step).round() as usize {
            hand_on(&controller, ["u", "u"], &mut plant);
            if is_jacobi {
                hand_on(&reference, ["r", "r"], &mut controller);
                hand_on(&sensor, ["y", "x"], &mut controller);
            }
            reference.step(step);
            plant.step(step);
            hand_on(&plant, ["x", "u"], &mut sensor);
            sensor.step(step);
            if !is_jacobi {
                hand_on(&reference, ["r", "r"], &mut controller);
                hand_on(&sensor, ["y", "x"], &mut controller);
            }
            if let Err(error) = controller.0.step(controller.0.time(), step) {
                println!("{error}");
                return None;
            }
            // The error as it is, not as it was handed on.
            found.note(k as f64 * step, |name| match name.strip_prefix('e') {
                Some(i) => plant.get(&format!("x{i}")) - controller.get(&format!("x_m{i}")),
                None => controller.get(&name),
            });
        }
        Some(found.done())
    }
}

/// At 1 ms, as on the page.
#[test]
fn units_of_their_own_stay_in_their_funnels() {
    for (plant, is_jacobi, part) in [
        (FIRST, false, [0.3177, 0.4101, 0.2575]),
        (FIRST, true, [0.3034, 0.4046, 0.2446]),
        (SECOND, false, [0.5722, 0.5614, 0.2654]),
        (SECOND, true, [0.5785, 0.5952, 0.2614]),
    ] {
        let found = Split::new(plant, is_jacobi, 1e-3).found().expect("it stays inside");
        all_near("e/rho", &found.part, &part, DIGITS);
    }
}

#[test]
fn at_a_longer_step_the_system_that_the_control_enters_nonlinearly_is_lost() {
    for (is_jacobi, part) in [(false, [0.3278, 0.3982, 0.2829]), (true, [0.3471, 0.3982, 0.2252])] {
        let found = Split::new(FIRST, is_jacobi, 5e-3).found().expect("it stays inside");
        all_near("e/rho", &found.part, &part, DIGITS);
        assert!(Split::new(SECOND, is_jacobi, 5e-3).found().is_none(), "it leaves, and the step is refused");
    }
}

#[test]
fn an_error_that_leaves_its_funnel_is_reported_with_its_channel_and_the_time() {
    let mut run = unit(COUPLED[2], "");
    run.0.initialise().unwrap();
    run.step(0.5);
    let before = run.get("u[2]");
    run.set("x[2]", 1.5);
    let reason = run.failure(0.5).to_string();
    for message in ["e[2] = 1.5", "has left its funnel", "rho[2]", "on_funnel_exit"] {
        assert!(reason.contains(message), "{message}: {reason}");
    }
    assert_eq!((run.0.time(), run.get("u[2]")), (0.5, before), "as before the step");
    let mut run = unit(COUPLED[2], "on_funnel_exit = 'reopen'");
    run.0.initialise().unwrap();
    run.step(0.5);
    run.set("x[2]", 1.5);
    run.step(1e-3);
    assert_eq!(run.integer("funnel_reopened"), 1);
    assert!((run.get("rho[2]") - 1.25 * 1.5).abs() < 0.01, "{}", run.get("rho[2]"));
}

#[test]
fn a_start_outside_is_refused_with_a_bound_that_would_do() {
    let mut run = unit("L1PpfTwoLinkRobot", "");
    run.set("r[1]", 3.5);
    run.0.initialise().unwrap();
    let reason = run.failure(0.001).to_string();
    assert!(reason.contains("e[1] = -3.5") && reason.contains("rho_0[1] above 3.5 would do"), "{reason}");
}

#[test]
fn taking_over_makes_no_jump_and_opens_the_funnel_anew() {
    for (name, n) in [("L1PpfCoupledMimo", 3), ("L1PpfTwoLinkRobot", 4)] {
        let mut run = unit(name, "");
        run.set_boolean("enabled", false);
        run.set("u_manual[1]", 4.0);
        run.set("x[1]", 9.0);
        run.0.initialise().unwrap();
        run.run(50, 0.1);
        assert_eq!(run.get("u[1]"), 4.0, "{name}: by hand an error may be anywhere");
        (1..=n).for_each(|i| run.set(&format!("x[{i}]"), 0.3));
        run.set_boolean("enabled", true);
        run.step(1e-9);
        assert!((run.get("u[1]") - 4.0).abs() < 1e-4, "{name}: {}", run.get("u[1]"));
        let rho_0 = run.get("rho_0[1]");
        assert!((run.get("rho[1]") - rho_0).abs() < 1e-6, "{name}");
    }
}

#[test]
fn a_bumpless_start_is_at_the_manual_control_whatever_the_barrier_adds() {
    let mut run = unit("L1PpfCoupledMimo", &format!("{BUMPLESS}\nx_m0 = [-0.5, 0.5, 0.5]"));
    for i in 1..=3 {
        run.set(&format!("x[{i}]"), 0.4 * f64::from(i));
        run.set(&format!("u_manual[{i}]"), f64::from(i));
    }
    run.0.initialise().unwrap();
    for i in 1..=3 {
        assert!((run.get(&format!("u[{i}]")) - f64::from(i)).abs() < 1e-12);
        assert!(run.get(&format!("u_barrier[{i}]")).abs() > 1e-3, "the barrier acts");
    }
}

#[test]
fn a_control_at_its_limit_ends_the_guarantee_and_is_reported() {
    let mut run = unit("L1PpfCoupledMimo", "u_max = [0.5, 0.5, 0.5]");
    run.0.initialise().unwrap();
    run.step(0.001);
    assert_eq!(run.0.take_messages().count(), 0);
    run.set("x[1]", -0.5);
    run.step(0.001);
    assert_eq!(run.get("u[1]"), 0.5);
    assert!(run.0.take_messages().any(|message| message.text.contains("isn't guaranteed")));
}

#[test]
fn a_step_that_is_too_long_for_the_barrier_is_reported() {
    let mut run = unit("L1PpfCoupledMimo", "rho_inf = [0.001, 0.05, 0.05]\ndecay_rate = [1e3, 1.5, 1.5]");
    run.0.initialise().unwrap();
    run.run(20, 0.001);
    assert_eq!(run.integer("step_too_long"), 0, "without an error the barrier does nothing");
    run.set("x[1]", 2e-4);
    run.step(0.001);
    assert!(run.get("barrier_stiffness") > 9e4, "K/rho²: {}", run.get("barrier_stiffness"));
    assert_eq!(run.integer("step_too_long"), 1);
    assert!(run.0.take_messages().any(|message| message.text.contains("too long for the barrier")));
}

#[test]
fn structures_that_are_none_are_refused() {
    let text = description("L1PpfTwoLinkRobot");
    for (from, to, named) in [
        ("baseline = \"inside\"\n", "", "where a control shows after two derivatives"),
        ("baseline = \"inside\"\n", "baseline = \"inside\"\nunmatched = true\n", "cancels only matched uncertainty"),
        ("[1.0, 0.0], [0.0, 1.0]]", "[1.0, 0.0], [1.0, 0.0]]", "C A B: least singular value"),
        ("B = [[0.0, 0.0]", "B = [[1.0, 0.0]", "C B: largest entry"),
    ] {
        assert!(text.contains(from), "{from}");
        let reason = run_of(&text.replacen(from, to, 1)).map(drop).unwrap_err().to_string();
        assert!(reason.contains(named), "{reason}");
    }
}
