//! Funnel control: against its equations written out, against a published figure, and on the loops of the thesis.
#![allow(non_snake_case)] // matrices have the names of the field

use adaptive_fmu::error::Invalid;
use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use common::closed::{Closed, metrics, near};
use common::description;
use common::models::Run;
use common::random::Random;

/// A unit of these channels and this degree, before its initialisation.
fn unit(channels: usize, degree: usize, form: &str, start: &str) -> Result<Run, Invalid> {
    let text = format!(
        "name = 'Test'\nmodel = 'funnel'\ndescription = ''\n[structure]\nchannels = {channels}\nrelative_degree = {degree}\nform \
         = '{form}'\n[start]\n{start}"
    );
    Ok(Run(Execution::new(Model::from_description(Description::read(&text)?, REGISTRY)?)))
}

/// The control law of the papers, for one channel.
fn asked(form: &str, errors: &[f64], [psi, tau, g, g_0, psi_1]: [f64; 5]) -> f64 {
    if form == "two_funnels" {
        let e_1 = errors[1] + g_0 * errors[0] / (1.0 - (errors[0] / psi).powi(2));
        return g * e_1 / (1.0 - (e_1 / psi_1).powi(2));
    }
    let mut e = errors[0] / psi;
    for (i, error) in errors.iter().enumerate().skip(1) {
        e = tau.powi(i as i32) * error / psi + e / (1.0 - e * e);
    }
    g * e / (1.0 - e * e)
}

#[test]
fn it_is_the_law_that_is_written() {
    let mut random = Random::new(17);
    let mut limited = 0;
    for (form, degree) in [("filtered_error", 1), ("filtered_error", 2), ("filtered_error", 3), ("two_funnels", 2)] {
        for _ in 0..20 {
            let mut any = |middle: f64, size: f64| [middle + size * random.next(), middle + size * random.next()];
            let (psi_0, psi_inf, l) = (any(2.0, 0.5), any(0.8, 0.3), any(1.0, 0.5));
            let (tau, g, g_0) = (any(0.2, 0.1), any(10.0, 5.0), any(3.0, 1.0));
            let (second_0, second_inf, second_l) = (any(6.0, 1.0), any(4.0, 0.5), any(0.8, 0.2));
            let G = [any(1.0, 0.5), any(0.0, 0.5)];
            let limit = any(12.0, 4.0);
            let own = if form == "two_funnels" {
                format!(
                    "g_0 = {g_0:?}\npsi_0_second = {second_0:?}\npsi_inf_second = {second_inf:?}\ndecay_rate_second = {second_l:?}\n"
                )
            } else if degree > 1 {
                format!("tau = {tau:?}\n")
            } else {
                String::new()
            };
            let start = format!(
                "{own}psi_0 = {psi_0:?}\npsi_inf = {psi_inf:?}\ndecay_rate = {l:?}\ng = {g:?}\nG = {G:?}\nu_min = [-{:?}, \
                 -{:?}]\nu_max = {limit:?}",
                limit[0], limit[1]
            );
            let mut run = unit(2, degree, form, &start).unwrap();
            let t = 0.4;
            let (r, errors): (Vec<_>, Vec<_>) = (0..degree).map(|_| (any(0.0, 1.0), any(0.0, 0.4))).unzip();
            for (k, (of_y, of_r)) in [("y", "r"), ("dy", "dr"), ("ddy", "ddr")].into_iter().take(degree).enumerate() {
                for i in 0..2 {
                    run.set(&format!("{of_r}[{}]", i + 1), r[k][i]);
                    run.set(&format!("{of_y}[{}]", i + 1), r[k][i] + errors[k][i]);
                }
            }
            run.0.initialise().unwrap();
            run.step(t);
            let at = |start: f64, end: f64, rate: f64| (start - end) * (-rate * t).exp() + end;
            let asks: [f64; 2] = std::array::from_fn(|i| {
                let of_channel: Vec<_> = errors.iter().map(|error| error[i]).collect();
                let psi = at(psi_0[i], psi_inf[i], l[i]);
                let psi_1 = at(second_0[i], second_inf[i], second_l[i]);
                asked(form, &of_channel, [psi, tau[i], g[i], g_0[i], psi_1])
            });
            for j in 0..2 {
                let wanted = -(G[j][0] * asks[0] + G[j][1] * asks[1]);
                let exact = wanted.clamp(-limit[j], limit[j]);
                limited += usize::from(exact != wanted);
                let found = run.get(&format!("u[{}]", j + 1));
                assert!((found - exact).abs() < 1e-12 * (1.0 + exact.abs()), "{form} {degree}: {found}, {exact}");
            }
        }
    }
    assert!((1..160).contains(&limited), "limits act in some: {limited}");
}

/// A mass on a car, with which the authors of funnel control show their figures: y'' = 8/9 y' − 4√2/9 (2η_1 + η_2) + u/9.
#[test]
fn the_mass_on_a_car_moves_as_published() {
    let root = 2.0_f64.sqrt();
    let plant = format!(
        "model = 'state-space'\n[structure]\nA = [[0.0, 1.0, 0.0, 0.0], [0.0, {:?}, {:?}, {:?}], [{:?}, 0.0, 0.0, 1.0], [0.0, \
         0.0, -4.0, -2.0]]\nB = [[0.0], [{:?}], [0.0], [0.0]]\nC = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]",
        8.0 / 9.0,
        -8.0 * root / 9.0,
        -4.0 * root / 9.0,
        2.0 * root,
        1.0 / 9.0
    );
    let reference =
        "model = 'reference'\n[structure]\nchannels = 1\n[start]\ncosine_amplitude = [1.0]\ncosine_frequency = [1.0]";
    let funnel = "model = 'funnel'\n[structure]\nchannels = 1\nrelative_degree = 2\n[start]\npsi_0 = [5.1]\npsi_inf = \
                  [0.1]\ndecay_rate = [2.0]\ntau = [1.0]\ng = [1.0]";
    let closed = Closed::new().described("reference", reference, "").described("plant", &plant, "");
    let closed = closed.described("controller", funnel, "").connected("reference.r", "controller.r", 1);
    let closed = closed.joined("reference.dr[1]", "controller.dr[1]").joined("plant.y[1]", "controller.y[1]");
    let closed = closed.joined("plant.y[2]", "controller.dy[1]").connected("controller.u", "plant.u", 1);
    let mut run = closed.started(1e-10);
    near("u(0)", run.get("controller.u[1]"), 0.2128, 5e-4);
    let (mut least, mut when, mut most, mut part) = (0.0_f64, 0.0, 0.0_f64, 0.0_f64);
    for k in 1..=20_000 {
        run.step(5e-4);
        let u = run.get("controller.u[1]");
        if u < least {
            (least, when) = (u, f64::from(k) * 5e-4);
        }
        (most, part) = (most.max(u), part.max(run.get("controller.e_part[1,1]").abs()));
    }
    println!("{least} at {when}, {most}, {part}, {}", run.get("controller.u[1]"));
    near("least u", least, -27.888, 1e-4);
    near("when", when, 1.2425, 1e-3);
    near("largest u", most, 11.4115, 1e-4);
    near("largest e/psi", part, 0.66864, 1e-4);
    near("u(10)", run.get("controller.u[1]"), 2.990, 5e-4);
}

/// A loop of a plant whose outputs and rates these are.
fn closed(
    [reference, plant]: [&str; 2],
    controller: &str,
    [m, degree]: [usize; 2],
    rates: &[usize],
    x0: &str,
) -> Closed {
    let closed = Closed::new().part("reference", reference, "").part("plant", plant, x0);
    let mut closed = closed.described("controller", controller, "").connected("reference.r", "controller.r", m);
    closed = closed.connected("plant.y", "controller.y", m).connected("controller.u", "plant.u", m);
    if degree > 1 {
        closed = closed.connected("reference.dr", "controller.dr", m);
    }
    for (i, rate) in rates.iter().enumerate() {
        closed = closed.joined(&format!("plant.x[{rate}]"), &format!("controller.dy[{}]", i + 1));
    }
    closed
}

struct Known<'a> {
    rms: &'a [f64],
    max: &'a [f64],
    part: f64,
}

/// Asserts the metrics of a loop.
fn comes_to(mut run: Run, degree: usize, known: &Known, [until, step]: [f64; 2]) {
    let m = known.rms.len();
    let errors = (1..=m).map(|i| format!("controller.e[{i}]"));
    let controls = (1..=m).map(|i| format!("controller.u[{i}]"));
    let parts = (1..=m).flat_map(|i| (1..=degree).map(move |level| format!("controller.e_part[{i},{level}]")));
    let signals: Vec<_> = errors.chain(controls).chain(parts).collect();
    let names: Vec<_> = signals.iter().map(String::as_str).collect();
    let found = metrics(&mut run, &names, [until, 5.0, step]);
    println!("{found:?}");
    for i in 0..m {
        as_printed(names[i], found[i].rms, known.rms[i]);
        as_printed(names[m + i], found[m + i].max, known.max[i]);
    }
    let part = found[2 * m..].iter().map(|metric| metric.max).fold(0.0, f64::max);
    as_printed("largest part", part, known.part);
}

/// Asserts that a number is another one within 3 parts in a thousand, or within rounding if that has two digits.
#[track_caller]
fn as_printed(what: &str, found: f64, known: f64) {
    let has_two_digits = format!("{known:.1e}").parse() == Ok(known);
    let of_last_digit = 0.51 * 10_f64.powf(known.log10().floor() - 1.0);
    let tolerance = if has_two_digits { of_last_digit } else { 3e-3 * known };
    assert!((found - known).abs() <= tolerance, "{what}: {found}, not {known}");
}

#[test]
fn the_plant_of_example_3_2_1_stays_in_its_funnel() {
    let units = ["ReferenceNonlinearSiso", "NonlinearSiso"];
    let run = closed(units, &description("FunnelNonlinearSiso"), [1, 2], &[2], "").started(1e-9);
    comes_to(run, 2, &Known { rms: &[0.004376], max: &[36.0], part: 0.667 }, [60.0, 0.005]);
}

#[test]
fn the_robot_stays_in_its_funnel() {
    let units = ["ReferenceTwoLinkRobot", "TwoLinkRobot"];
    let run = closed(units, &description("FunnelTwoLinkRobot"), [2, 2], &[3, 4], "").started(1e-9);
    comes_to(run, 2, &Known { rms: &[0.02207, 0.01847], max: &[38.8, 33.8], part: 0.777 }, [20.0, 0.002]);
}

#[test]
fn the_plant_of_chapter_4_stays_in_its_funnel() {
    let text = "model = 'funnel'\n[structure]\nchannels = 1\nrelative_degree = 2\n[start]\npsi_0 = [2.0]\npsi_inf = \
                [0.1]\ndecay_rate = [1.0]\ntau = [0.5]\ng = [20.0]";
    let run = closed(["ReferenceActuatedSiso", "ActuatedSiso"], text, [1, 2], &[2], "").started(1e-9);
    comes_to(run, 2, &Known { rms: &[0.007819], max: &[26.0], part: 0.687 }, [40.0, 0.002]);
}

/// The signal to follow is the state of the reference model.
#[test]
fn the_coupled_system_stays_in_its_funnel() {
    let text = "model = 'funnel'\n[structure]\nchannels = 3\nrelative_degree = 1\n[start]\npsi_0 = [2.0, 2.0, 2.0]\npsi_inf = \
                [0.05, 0.05, 0.05]\ndecay_rate = [1.5, 1.5, 1.5]\ng = [20.0, 20.0, 20.0]";
    let model = "model = 'state-space'\n[structure]\nA = [[-70.0, 0.0, 0.0], [0.0, -60.0, 1.0], [0.0, -1.0, -60.0]]\nB = \
                 [[70.0, 0.0, 0.0], [0.0, 60.0, -1.0], [0.0, 1.0, 60.0]]\nC = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, \
                 1.0]]";
    let closed = Closed::new().part("reference", "ReferenceCoupledMimo", "").described("model", model, "");
    let closed = closed.part("plant", "CoupledMimo", "x0 = [0.6, -0.8, 0.4]").described("controller", text, "");
    let closed = closed.connected("reference.r", "model.u", 3).connected("model.y", "controller.r", 3);
    let closed = closed.connected("plant.y", "controller.y", 3).connected("controller.u", "plant.u", 3);
    let known = Known { rms: &[0.0183, 0.0247, 0.0028], max: &[16.9, 48.5, 5.0], part: 0.815 };
    comes_to(closed.started(1e-9), 1, &known, [10.0, 0.001]);
}

const BOUNDS: &str = "psi_0 = [2.0, 2.0]\npsi_inf = [0.5, 0.5]\ndecay_rate = [1.0, 1.0]\n";

#[test]
fn an_error_that_leaves_its_funnel_is_reported_with_its_channel_and_the_time() {
    let mut run = unit(2, 2, "filtered_error", &format!("{BOUNDS}tau = [0.1, 0.1]")).unwrap();
    run.0.initialise().unwrap();
    run.step(0.5);
    let before = run.get("u[2]");
    run.set("y[2]", 1.5);
    let reason = run.failure(0.5).to_string();
    for message in ["e[2] = 1.5", "t = 1 s", "has left its funnel", "psi[2]", "1.05"] {
        assert!(reason.contains(message), "{message}: {reason}");
    }
    assert_eq!((run.0.time(), run.get("u[2]")), (0.5, before), "as before the step");
    // The second level: the error's rate.
    run.set("y[2]", 0.3);
    run.set("dy[2]", 30.0);
    let reason = run.failure(0.5).to_string();
    assert!(reason.contains("e_part[2,2]") && reason.contains("has left its funnel"), "{reason}");
    run.set("dy[2]", 0.0);
    run.step(0.5);
}

#[test]
fn a_start_outside_is_refused_with_a_bound_that_would_do() {
    let mut run = unit(2, 1, "filtered_error", BOUNDS).unwrap();
    run.set("r[1]", 3.5);
    run.0.initialise().unwrap();
    assert_eq!(run.get("u[1]"), 0.0, "a master may not have set its inputs yet");
    let reason = run.failure(0.01).to_string();
    assert!(reason.contains("e[1] = -3.5") && reason.contains("psi_0[1] above 3.5 would do"), "{reason}");
    run.set("r[1]", 1.5);
    run.step(0.01);
}

#[test]
fn taking_over_makes_no_jump_and_opens_the_funnel_anew() {
    let mut run = unit(2, 2, "filtered_error", &format!("{BOUNDS}tau = [0.1, 0.1]\ntakeover_rate = 2.0")).unwrap();
    run.set_boolean("enabled", false);
    run.set("u_manual[1]", 4.0);
    run.set("y[1]", 9.0);
    run.0.initialise().unwrap();
    run.run(50, 0.1);
    assert_eq!(run.get("u[1]"), 4.0, "by hand an error may be anywhere");
    run.set("y[1]", 1.2);
    run.set_boolean("enabled", true);
    run.step(1e-9);
    assert!((run.get("u[1]") - 4.0).abs() < 1e-6 && run.get("u[2]").abs() < 1e-9, "{}", run.get("u[1]"));
    assert!((run.get("psi[1]") - 2.0).abs() < 1e-6);
    let u_b = run.get("u_b[1]");
    run.set("y[1]", 0.2);
    run.step(0.5);
    near("what is left", run.get("u_b[1]"), u_b * (-1.0_f64).exp(), 1e-5);
}

#[test]
fn a_control_at_its_limit_is_reported() {
    let mut run = unit(1, 1, "filtered_error", "psi_0 = [2.0]\ng = [10.0]\nu_max = [1.0]\nu_min = [-1.0]").unwrap();
    run.set("r[1]", 0.05);
    run.0.initialise().unwrap();
    run.step(0.01);
    assert_eq!(run.0.take_messages().count(), 0);
    run.set("r[1]", 1.0);
    run.step(0.01);
    assert_eq!(run.get("u[1]"), 1.0);
    assert!(run.0.take_messages().any(|message| message.text.contains("isn't guaranteed")));
}

#[test]
fn structures_that_are_none_are_refused() {
    for (degree, form, named) in [
        (0, "filtered_error", "relative_degree = 0"),
        (4, "filtered_error", "relative_degree = 4"),
        (3, "two_funnels", "must be 2"),
    ] {
        let reason = unit(1, degree, form, "").map(drop).unwrap_err().to_string();
        assert!(reason.contains(named), "{reason}");
    }
    let reason = unit(1, 1, "filtered_error", "psi_inf = [2.0]").map(drop).unwrap_err().to_string();
    assert!(reason.contains("psi_inf[1] = 2: must not be above psi_0[1] = 1"), "{reason}");
}
