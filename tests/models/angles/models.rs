//! Laws with a reference model or a funnel: plain and robust MRAC, neuro-adaptive control, L1 control with prescribed performance.
#![allow(non_snake_case)] // matrices have the names of the thesis

use std::f64::consts::{PI, TAU};

use common::models::Run;
use common::random::Random;

use super::{head, made, refusal, wrapped};

const DEGREE: f64 = PI / 180.0;

/// How measurement and reference come to the law.
type Read = [fn(f64) -> f64; 2];

const UNWRAPPED: Read = [|y| y, |r| r];
const READS: [Read; 4] =
    [[wrapped, wrapped], [|y| y - 4.0 * TAU, |r| r], [wrapped, |r| r + TAU], [|y| y + 2.0 * TAU, wrapped]];

/// x' of a plant of two states, of which the first is an angle, at a time, with its control.
type Plant = fn(f64, [f64; 2], [f64; 2]) -> [f64; 2];

/// A law and its plant.
#[derive(Clone)]
struct Loop {
    kind: &'static str,
    /// Lines of the structure beside `angles`, then of the start.
    structure: String,
    start: String,
    plant: Plant,
    /// Numbers of states and controls.
    sizes: [usize; 2],
    /// Where the reference model starts.
    starts_model: bool,
    /// True if it has derivatives of the reference, which then must not jump.
    has_rates: bool,
    /// True if a person may take command.
    has_manual: bool,
}

impl Loop {
    fn text(&self, psi: f64, angles: &str) -> String {
        let x_m0 = if self.starts_model && self.sizes[0] == 1 {
            format!("x_m0 = [{psi:?}]\n")
        } else if self.starts_model {
            format!("x_m0 = [{psi:?}, 0.0]\n")
        } else {
            String::new()
        };
        format!(
            "{}[structure]\n{angles}\n{}\n[start]\nintegration_method = 'fixed'\nfixed_steps = 4\n{x_m0}{}",
            head(self.kind),
            self.structure,
            self.start
        )
    }
}

/// ψ'' = 1.2 u + 0.3 sin t
fn double_integrator(t: f64, x: [f64; 2], u: [f64; 2]) -> [f64; 2] {
    [x[1], 1.2 * u[0] + 0.3 * t.sin()]
}

/// Nominal rows (0, 0.5), (0, −1), and a control each.
fn two_controls(t: f64, x: [f64; 2], u: [f64; 2]) -> [f64; 2] {
    [0.55 * x[1] + 1.1 * u[0] + 0.2 * t.sin(), -0.9 * x[1] + u[1] + 0.2 * x[0].sin()]
}

/// Nominal rows (0, 1), (0, −1), and a control in the second.
fn driven(t: f64, x: [f64; 2], u: [f64; 2]) -> [f64; 2] {
    [x[1] + 0.1 * (2.0 * t).sin(), -1.2 * x[1] + 1.1 * u[0]]
}

/// ψ' = 1.2 u + 0.2 sin ψ
fn first_order(_t: f64, x: [f64; 2], u: [f64; 2]) -> [f64; 2] {
    [1.2 * u[0] + 0.2 * x[0].sin(), 0.0]
}

const OF_TWO: &str = "units = { x = ['rad', 'rad/s'], r = ['rad'], u = ['rad/s2'] }";
const DOUBLE: &str = "A = [[0.0, 1.0], [0.0, 0.0]]\nB = [[0.0], [1.0]]\nC = [[1.0, 0.0]]\n";

fn mrac(further: &str, start: &str) -> Loop {
    let by_element = !further.contains("infinity_norm");
    let theta = if by_element { "[[2.0, 3.0]]" } else { "[[3.0]]" };
    Loop {
        kind: "mrac",
        structure: format!("{DOUBLE}{further}\n{OF_TWO}"),
        start: format!(
            "pole_real = [-4.0, -4.0]\npole_imag = [0.5, -0.5]\nadaptation_gain = 80.0\nomega_min = [0.5]\nomega_max = [2.0]\n\
             theta_bound = {theta}\nsigma_bound = [10.0]\n{start}"
        ),
        plant: double_integrator,
        sizes: [2, 1],
        starts_model: false,
        has_rates: false,
        has_manual: true,
    }
}

fn mrac_ppf(start: &str) -> Loop {
    Loop {
        kind: "mrac-ppf",
        structure: "A = [[0.0, 0.5], [0.0, -1.0]]\nB = [[1.0, 0.0], [0.0, 1.0]]\nunits = { x = ['rad', '1'] }"
            .to_owned(),
        start: format!(
            "A_m = [[-3.0, 0.2], [0.0, -3.0]]\nrho_0 = [1.0, 1.0]\nrho_inf = [0.4, 0.4]\ndecay_rate = [1.0, 1.0]\ngamma_1 = [3.0, 3.0]\n\
             gamma_2 = [2.0, 2.0]\nbeta = [0.2, 0.2]\nalpha_bar = [0.5, 0.5]\nswitching_width = 0.5\nK_epsilon = [3.0, 3.0]\n{start}"
        ),
        plant: two_controls,
        sizes: [2, 2],
        starts_model: true,
        has_rates: false,
        has_manual: false,
    }
}

fn unmatched(start: &str) -> Loop {
    Loop {
        kind: "mrac-ppf-unmatched",
        structure: format!(
            "A = [[0.0, 1.0], [0.0, -1.0]]\nB = [[0.0], [1.0]]\nC = [[1.0, 0.0]]\nunmatched = [{{ row = 1, driven_by = 2 }}]\n{OF_TWO}"
        ),
        start: format!(
            "A_m = [[0.0, 1.0], [-4.0, -4.0]]\nrho_0 = [1.0, 3.0]\nrho_inf = [0.5, 2.0]\ndecay_rate = [1.0, 1.0]\ngamma = [0.05, 0.5]\n\
             K_epsilon = [0.4, 8.0]\ntheta_bound = [0.8, 5.0]\n{start}"
        ),
        plant: driven,
        sizes: [2, 1],
        starts_model: true,
        has_rates: false,
        has_manual: true,
    }
}

fn neuro(degree: usize, input_gain: bool) -> Loop {
    let start = if degree == 1 { "A_m = [[-3.0]]\n" } else { "lambda = [2.0]\n" };
    let initial = if input_gain { "g_network_initial = 1.0\n" } else { "" };
    Loop {
        kind: "neuro-ppf",
        structure: format!(
            "relative_degree = {degree}\nchannels = 1\ninput_gain_network = {input_gain}\nnetwork = {{ rule = 'square_roots', neurons = 12 }}\n\
             units = {{ r = ['rad'] }}"
        ),
        start: format!(
            "rho_0 = [1.2]\nrho_inf = [0.6]\ndecay_rate = [1.0]\nfunnel = 'symmetric'\nk = 1.0\neta_Gb = 0.5\nnetwork_gain = 0.3\n{initial}{start}"
        ),
        plant: if degree == 1 { first_order } else { double_integrator },
        sizes: [degree, 1],
        starts_model: degree == 1,
        has_rates: degree == 2,
        has_manual: false,
    }
}

fn l1_ppf(is_first: bool, further: &str, start: &str) -> Loop {
    let matrices = if is_first {
        "A = [[0.0, 0.5], [0.0, -1.0]]\nB = [[1.0, 0.0], [0.0, 1.0]]\nC = [[1.0, 0.0], [0.0, 1.0]]\ndesired_dynamics = 'matrix'\n\
         units = { x = ['rad', '1'], r = ['rad', '1'] }\n"
    } else {
        "A = [[0.0, 1.0], [0.0, 0.0]]\nB = [[0.0], [1.0]]\nC = [[1.0, 0.0]]\nunits = { x = ['rad', 'rad/s'], r = ['rad'] }\n"
    };
    let gains = if is_first {
        "A_m = [[-4.0, 0.1], [0.0, -5.0]]\nfeedback_gain = [[15.0, 0.0], [0.0, 15.0]]\nomega_min = [0.5, 0.5]\nomega_max = [2.0, 2.0]\n\
         theta_bound = [5.0, 5.0]\nsigma_bound = [5.0, 5.0]\nrho_0 = [1.0, 1.0]\nrho_inf = [0.5, 0.5]\nbarrier_gain = [0.3, 0.3]\n"
    } else {
        "pole_real = [-4.0, -4.0]\npole_imag = [0.5, -0.5]\nfeedback_gain = [[15.0]]\nomega_min = [0.5]\nomega_max = [2.0]\n\
         theta_bound = [10.0]\nsigma_bound = [10.0]\nrho_0 = [1.0]\nrho_inf = [0.5]\nbarrier_gain = [0.1]\nerror_weight = [4.0]\n"
    };
    Loop {
        kind: "l1-ppf",
        structure: format!("regressor = 'infinity_norm'\ninput_gain = 'diagonal'\n{matrices}{further}"),
        start: format!(
            "adaptation_gain = 2e3\ndecay_rate = {}\n{gains}{start}",
            if is_first { "[1.0, 1.0]" } else { "[1.0]" }
        ),
        plant: if is_first { two_controls } else { double_integrator },
        sizes: if is_first { [2, 2] } else { [2, 1] },
        starts_model: is_first,
        has_rates: !is_first,
        has_manual: true,
    }
}

fn loops() -> Vec<Loop> {
    let mut loops = Vec::new();
    for law in ["law = 'continuous'\n", ""] {
        for further in [
            "baseline = 'outside'",
            "baseline = 'inside'\nstate_scale = [0.5, 2.0]",
            "baseline = 'outside'\nregressor = 'infinity_norm'",
        ] {
            loops.push(mrac(further, law));
        }
        loops.push(mrac("baseline = 'outside'", &format!("{law}leakage = 0.5\n")));
        loops.push(mrac_ppf(law));
        loops.push(mrac_ppf(&format!("{law}theta_leakage = [0.1, 0.1]\ntheta_bound = [0.5, 0.5]\n")));
    }
    loops.push(unmatched(""));
    loops.push(unmatched("x_m_start = 'given'\ntheta_leakage = [0.1, 0.1]\n"));
    loops.extend([neuro(1, false), neuro(1, true), neuro(2, false), neuro(2, true)]);
    for start in ["", "law = 'sampled'\n", "u_ad_start = 'bumpless'\n"] {
        loops.push(l1_ppf(true, "baseline = 'outside'", start));
    }
    loops.push(l1_ppf(false, "baseline = 'outside'", ""));
    loops.push(l1_ppf(false, "baseline = 'inside'", ""));
    loops
}

/// A reference with its derivatives, by time.
type Reference<'a> = &'a dyn Fn(f64) -> [f64; 3];

const H: f64 = 2e-3;

/// ψ and u at each communication point, the plant integrated by Runge and Kutta's method.
fn closed(law: &Loop, text: &str, psi: f64, seconds: f64, r: Reference, read: Read, manual: [f64; 2]) -> Vec<[f64; 2]> {
    let (mut run, mut x, mut found) = (made(text), [psi, 0.0], Vec::new());
    let [states, controls] = law.sizes;
    for k in 0..(seconds / H).round() as i32 {
        let t = f64::from(k) * H;
        put_inputs(&mut run, law, t, x, r, read);
        if law.has_manual {
            run.set_boolean("enabled", !(manual[0]..manual[1]).contains(&t));
            run.set("u_manual[1]", 0.4);
        }
        if k == 0 {
            run.0.initialise().unwrap();
        }
        run.step(H);
        let u = [run.get("u[1]"), if controls > 1 { run.get("u[2]") } else { 0.0 }];
        x = moved(law.plant, t, x, u);
        found.push([x[0], u[0]]);
        assert!(states <= 2);
    }
    found
}

fn put_inputs(run: &mut Run, law: &Loop, t: f64, x: [f64; 2], r: Reference, read: Read) {
    let [place, rate, acceleration] = r(t);
    run.set("x[1]", read[0](x[0]));
    run.set("r[1]", read[1](place));
    if law.sizes[0] > 1 {
        run.set("x[2]", x[1]);
    }
    if law.has_rates {
        run.set("dr[1]", rate);
        run.set("ddr[1]", acceleration);
    }
}

fn moved(plant: Plant, t: f64, x: [f64; 2], u: [f64; 2]) -> [f64; 2] {
    let along = |k: [f64; 2], h: f64| [x[0] + h * k[0], x[1] + h * k[1]];
    let k1 = plant(t, x, u);
    let k2 = plant(t + 0.5 * H, along(k1, 0.5 * H), u);
    let k3 = plant(t + 0.5 * H, along(k2, 0.5 * H), u);
    let k4 = plant(t + H, along(k3, H), u);
    std::array::from_fn(|i| x[i] + H / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]))
}

const KEY: &str = "angles = [1]";

fn apart(a: &[[f64; 2]], b: &[[f64; 2]]) -> [f64; 2] {
    let most = |element: usize| a.iter().zip(b).map(|(a, b)| (a[element] - b[element]).abs()).fold(0.0, f64::max);
    [most(0), most(1)]
}

/// Over more than a turn, with a manual phase, at random starts and speeds.
#[test]
fn each_law_takes_wrapped_angles_for_unwrapped_ones_and_follows_them() {
    let mut random = Random::new(17);
    let mut worst = [0.0_f64; 2];
    for law in loops() {
        for _ in 0..2 {
            let (start, speed) = (3.1 * random.next(), (2.2 + 0.6 * random.next()) * random.next().signum());
            let jump = if law.has_rates { 0.0 } else { 0.8 * random.next() };
            let r = |t: f64| [start + speed * t + if t < 2.5 { 0.0 } else { jump }, speed, 0.0];
            let smooth = |t: f64| {
                let (soft, slope) = (1.0 - (-2.0 * t).exp(), 2.0 * (-2.0 * t).exp());
                [start + speed * (t - 0.5 * soft), speed * soft, speed * slope]
            };
            let r: Reference = if law.has_rates { &smooth } else { &r };
            let text = law.text(start, KEY);
            let seconds = 8.0;
            let manual = if random.next() > 0.0 { [1.0, 1.2] } else { [9.0, 9.0] };
            let unwrapped = closed(&law, &text, start, seconds, r, UNWRAPPED, manual);
            let end = unwrapped[unwrapped.len() - 1][0];
            assert!((end - r(seconds)[0]).abs() < 1.6, "{end}, not {}: {text}", r(seconds)[0]);
            assert!((end - start).abs() > TAU, "{end}: {text}");
            for read in READS {
                let [psi, u] = apart(&closed(&law, &text, start, seconds, r, read, manual), &unwrapped);
                worst = [worst[0].max(psi), worst[1].max(u)];
                assert!(psi < 1e-10 && u < 1e-9, "{psi} {u}: {text}");
            }
        }
    }
    println!("{worst:?}");
}

#[test]
fn each_law_goes_the_short_way_over_the_seam() {
    for law in loops() {
        let text = law.text(170.0 * DEGREE, KEY);
        let r = |t: f64| [if t < 1e-9 { 170.0 } else { 190.0 } * DEGREE, 0.0, 0.0];
        let found = closed(&law, &text, 170.0 * DEGREE, 6.0, &r, [wrapped, wrapped], [9.0, 9.0]);
        let end = found[found.len() - 1][0] / DEGREE;
        assert!((end - 190.0).abs() < 12.0, "{end}: {text}");
        let most = found.iter().map(|[psi, _]| (psi / DEGREE - 180.0).abs()).fold(0.0, f64::max);
        assert!(most < 40.0, "{most}: {text}");
    }
}

/// Without the key the seam is a motion: a law is lost, or goes the long way, or refuses the error.
#[test]
fn without_the_key_the_seam_is_no_seam() {
    for law in [mrac("baseline = 'outside'", ""), unmatched(""), l1_ppf(true, "baseline = 'outside'", "")] {
        let text = law.text(170.0 * DEGREE, "");
        let mut run = made(&text);
        let r = |t: f64| [if t < 0.1 { 170.0 } else { 190.0 } * DEGREE, 0.0, 0.0];
        let (mut x, mut far) = ([170.0 * DEGREE, 0.0], false);
        for k in 0..1500 {
            let t = f64::from(k) * H;
            put_inputs(&mut run, &law, t, x, &r, [wrapped, wrapped]);
            if k == 0 {
                run.0.initialise().unwrap();
            }
            if run.0.step(run.0.time(), H).is_err() {
                far = true;
                break;
            }
            let u = [run.get("u[1]"), if law.sizes[1] > 1 { run.get("u[2]") } else { 0.0 }];
            x = moved(law.plant, t, x, u);
            far |= (x[0] / DEGREE - 180.0).abs() > 60.0;
        }
        assert!(far, "{text}");
    }
}

/// The control doesn't jump where an origin moves, however far it moves.
#[test]
fn an_origin_that_moves_makes_no_jump() {
    let ramp = |t: f64| [0.7 + 0.5 * t, 0.5, 0.0];
    for law in loops().into_iter().filter(|law| law.kind != "neuro-ppf") {
        let run = |further: &str| {
            let mut run = made(&format!("{}{further}", law.text(0.7, KEY)));
            let (mut x, mut found) = ([0.7, 0.5], Vec::new());
            for k in 0..1500 {
                let t = f64::from(k) * H;
                put_inputs(&mut run, &law, t, x, &ramp, UNWRAPPED);
                if k == 0 {
                    run.0.initialise().unwrap();
                }
                run.step(H);
                let u = [run.get("u[1]"), if law.sizes[1] > 1 { run.get("u[2]") } else { 0.0 }];
                x = moved(law.plant, t, x, u);
                found.push((u[0], run.get("origin[1]")));
            }
            found
        };
        let jumps = |found: &[(f64, f64)]| {
            found.windows(2).skip(50).map(|pair| (pair[1].0 - pair[0].0).abs()).fold(0.0, f64::max)
        };
        let (moves, stays) = (run(""), run("origin_range = 3.0\n"));
        assert!(moves[1499].1 > 0.75 && stays[1499].1 == 0.0, "{:?} {:?}", moves[1499], stays[1499]);
        assert!(
            jumps(&moves) < 2.0 * jumps(&stays) + 0.01,
            "{} {}: {}",
            jumps(&moves),
            jumps(&stays),
            law.text(0.7, KEY)
        );
    }
}

/// What is the same by whole turns starts the same.
#[test]
fn laws_that_start_their_model_at_the_plant_start_the_same_in_any_turn() {
    for law in [mrac("baseline = 'outside'", ""), unmatched(""), mrac("baseline = 'inside'", "law = 'continuous'")] {
        for psi in [0.2, 2.0, -3.0] {
            let r = |t: f64| [psi + 0.4 * t, 0.4, 0.0];
            let text = law.text(psi, KEY);
            let expected = closed(&law, &text, psi, 1.0, &r, UNWRAPPED, [9.0, 9.0]);
            for read in [[|y| y + 3.0 * TAU, |r| r + 3.0 * TAU], [|y| y - TAU, |r| r + 5.0 * TAU]] as [Read; 2] {
                let [_, u] = apart(&closed(&law, &text, psi, 1.0, &r, read, [9.0, 9.0]), &expected);
                assert!(u < 1e-10, "{u} at {psi}: {text}");
            }
        }
    }
}

#[test]
fn an_angle_that_jumps_and_is_not_declared_is_reported_once() {
    for law in [
        mrac("baseline = 'outside'", ""),
        mrac_ppf("on_funnel_exit = 'reopen'\n"),
        unmatched("on_funnel_exit = 'reopen'\n"),
        neuro(1, false),
        neuro(2, true),
        l1_ppf(true, "baseline = 'outside'", "on_funnel_exit = 'reopen'\n"),
    ] {
        for (angles, warnings) in [("", 1), (KEY, 0)] {
            let mut run = made(&format!(
                "{}{}",
                law.text(3.1, angles),
                if law.kind == "neuro-ppf" { "on_funnel_exit = 'reopen'\n" } else { "" }
            ));
            let mut told = Vec::new();
            for (k, psi) in [3.1, 3.12, -3.1, -3.05, 3.1].into_iter().enumerate() {
                put_inputs(&mut run, &law, 0.0, [psi, 0.0], &|_| [3.1, 0.0, 0.0], UNWRAPPED);
                if k == 0 {
                    run.0.initialise().unwrap();
                }
                run.step(1e-3);
                told.extend(run.0.take_messages().filter(|message| message.category == "logAngleJump"));
            }
            assert_eq!(told.len(), warnings, "{}: {told:?}", law.kind);
            assert!(told.iter().all(|message| message.text.contains("x[1]")), "{told:?}");
        }
    }
}

#[test]
fn angles_that_laws_can_not_have_are_refused() {
    let with = |law: &Loop, angles: &str| refusal(&law.text(0.0, angles));
    for law in
        [mrac("baseline = 'outside'", ""), mrac_ppf(""), unmatched(""), l1_ppf(false, "baseline = 'outside'", "")]
    {
        let reason = with(&law, "angles = [2]");
        let reasons = ["angles = 2", "rad"];
        assert!(reasons.iter().all(|part| reason.contains(part)), "{}: {reason}", law.kind);
        let reason = with(&law, "angles = [3]");
        assert!(reason.contains("angles = 3") && reason.contains("must be within 1 … 2"), "{}: {reason}", law.kind);
    }
    let reason = with(&neuro(2, false), "angles = [2]");
    assert!(reason.contains("angles = 2") && reason.contains("must be within 1 … 1"), "{reason}");
    let mut drives = unmatched("");
    drives.structure = drives.structure.replace("'rad/s'", "'rad'");
    let reason = with(&drives, "angles = [2]");
    assert!(reason.contains("angles = 2") && reason.contains("must not drive an unmatched row"), "{reason}");
    let mut given = neuro(1, false);
    given.structure = given
        .structure
        .replace("{ rule = 'square_roots', neurons = 12 }", "{ rule = 'given', weights = [[1.0]], biases = [0.0] }");
    let reason = with(&given, KEY);
    assert!(reason.contains("must be 2") && reason.contains("sine and cosine"), "{reason}");
}

#[test]
fn a_funnel_of_an_angle_is_narrower_than_half_a_turn() {
    let laws = [mrac_ppf(""), unmatched(""), neuro(2, false), l1_ppf(false, "baseline = 'outside'", "")];
    for law in &laws {
        let rest = if law.start.contains("rho_0 = [1.2]") { "rho_0 = [1.2]" } else { "rho_0 = [1.0" };
        let wide =
            Loop { start: law.start.replace(rest, &rest.replace("1.0", "3.2").replace("1.2", "3.2")), ..law.clone() };
        let reason = refusal(&wide.text(0.0, KEY));
        assert!(reason.contains("rho_0[1] = 3.2") && reason.contains("must be below 3.14"), "{reason}");
        assert!(made(&wide.text(0.0, "")).0.initialise().is_ok());
    }
}

#[test]
fn a_funnel_of_an_angle_re_opens_below_half_a_turn_only() {
    let sampled = l1_ppf(true, "baseline = 'outside'", "law = 'sampled'\n");
    for law in [mrac_ppf(""), unmatched(""), neuro(1, false), l1_ppf(true, "baseline = 'outside'", ""), sampled] {
        for (error, reopens) in [(1.9, true), (2.7, false)] {
            let mut run = made(&format!("{}on_funnel_exit = 'reopen'\n", law.text(0.0, KEY)));
            run.0.initialise().unwrap();
            run.step(1e-3);
            run.set("x[1]", error - TAU);
            if reopens {
                run.step(1e-3);
                run.step(1e-3);
                assert!(
                    run.get("rho[1]") >= 1.2 * error && run.get("rho[1]") < PI,
                    "{}: {}",
                    law.kind,
                    run.get("rho[1]")
                );
            } else {
                let told = match run.0.step(run.0.time(), 1e-3) {
                    Err(told) => told,
                    Ok(_) => run.failure(1e-3),
                };
                let told = told.to_string();
                assert!(told.contains("rho[1] = 3.3") && told.contains("must be below 3.14"), "{}: {told}", law.kind);
            }
        }
    }
}

/// A composite integrates the error in place of the plant's angle: that turns, too.
#[test]
fn a_composite_turns_without_end_as_units_of_their_own_do() {
    let law = mrac_ppf("");
    let composite = |psi: f64, model: f64| {
        format!(
            "{}[structure]\nconnections = [['law.u', 'plant.u'], ['plant.x', 'law.x']]\n[[structure.parts]]\nname = 'plant'\n\
             model = 'state-space'\n[structure.parts.structure]\nA = [[0.0, 0.55], [0.0, -0.9]]\nB = [[1.1, 0.0], [0.0, 1.0]]\n\
             C = [[1.0, 0.0], [0.0, 1.0]]\n[structure.parts.start]\nx0 = [{psi:?}, 0.0]\n[[structure.parts]]\nname = 'law'\n\
             model = 'mrac-ppf'\n[structure.parts.structure]\n{KEY}\n{}\n[structure.parts.start]\nx_m0 = [{model:?}, 0.0]\n{}\n\
             [start]\nrelative_tolerance = 1e-10\n",
            head("composite"),
            law.structure,
            law.start
        )
    };
    let turned = |psi: f64, model: f64, read: fn(f64) -> f64| {
        let (mut run, mut found) = (made(&composite(psi, model)), Vec::new());
        for k in 0..1600 {
            let t = f64::from(k) * 5e-3;
            run.set("law.r[1]", read(2.5 + 2.0 * t));
            if k == 0 {
                run.0.initialise().unwrap();
            }
            run.step(5e-3);
            found.push([run.get("plant.x[1]") - psi, run.get("law.u[1]")]);
        }
        found
    };
    let expected = turned(2.4, 2.4, |r| r);
    assert!(expected[1599][0] > 2.2 * TAU);
    for (psi, model, read) in
        [(2.4, 2.4, wrapped as fn(f64) -> f64), (2.4 + TAU, 2.4, wrapped), (2.4, 2.4, |r| r - TAU)]
    {
        let [of_psi, u] = apart(&turned(psi, model, read), &expected);
        assert!(of_psi < 1e-7 && u < 1e-6, "{of_psi} {u}");
    }
}
