//! Laws with a reference model or a funnel, each with a plant of which a coordinate is an angle.
#![allow(non_snake_case)] // matrices have the names of the thesis

use std::f64::consts::TAU;

use common::models::Run;

use super::{head, made, wrapped};

/// Form in which the controller gets measurement and reference.
pub type Read = [fn(f64) -> f64; 2];

pub const UNWRAPPED: Read = [|y| y, |r| r];
pub const READS: [Read; 4] =
    [[wrapped, wrapped], [|y| y - 4.0 * TAU, |r| r], [wrapped, |r| r + TAU], [|y| y + 2.0 * TAU, wrapped]];

/// x' of a plant of two states, of which the first is an angle, at a time, with its control.
pub type Plant = fn(f64, [f64; 2], [f64; 2]) -> [f64; 2];

/// A law and its plant.
#[derive(Clone)]
pub struct Loop {
    pub kind: &'static str,
    /// Lines of the structure in addition to `angles`, then of the start.
    pub structure: String,
    pub start: String,
    pub plant: Plant,
    /// Numbers of states and controls.
    pub sizes: [usize; 2],
    /// True if the reference model has its own start.
    pub starts_model: bool,
    /// True if it has derivatives of the reference, which then must not jump.
    pub has_rates: bool,
    /// True if a person may take command.
    pub has_manual: bool,
}

impl Loop {
    pub fn text(&self, psi: f64, angles: &str) -> String {
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

pub fn mrac(further: &str, start: &str) -> Loop {
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

pub fn mrac_ppf(start: &str) -> Loop {
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

pub fn unmatched(start: &str) -> Loop {
    Loop {
        kind: "mrac-ppf-unmatched",
        structure: format!(
            "A = [[0.0, 1.0], [0.0, -1.0]]\nB = [[0.0], [1.0]]\nC = [[1.0, 0.0]]\nunmatched = [{{ row = 1, driven_by = 2 }}]\n{OF_TWO}"
        ),
        start: format!(
            "A_m = [[0.0, 1.0], [-9.0, -6.0]]\nrho_0 = [1.0, 3.0]\nrho_inf = [0.5, 2.0]\ndecay_rate = [1.0, 1.0]\ngamma = [0.05, 0.5]\n\
             K_epsilon = [0.4, 8.0]\ntheta_bound = [0.8, 5.0]\n{start}"
        ),
        plant: driven,
        sizes: [2, 1],
        starts_model: true,
        has_rates: false,
        has_manual: true,
    }
}

pub fn neuro(degree: usize, input_gain: bool) -> Loop {
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

pub fn l1_ppf(is_first: bool, further: &str, start: &str) -> Loop {
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

pub fn loops() -> Vec<Loop> {
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
pub type Reference<'a> = &'a dyn Fn(f64) -> [f64; 3];

pub const H: f64 = 2e-3;

/// ψ and u at each communication point, the plant integrated by Runge and Kutta's method.
pub fn closed(
    law: &Loop,
    text: &str,
    psi: f64,
    seconds: f64,
    r: Reference,
    read: Read,
    manual: [f64; 2],
) -> Vec<[f64; 2]> {
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

pub fn put_inputs(run: &mut Run, law: &Loop, t: f64, x: [f64; 2], r: Reference, read: Read) {
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

pub fn moved(plant: Plant, t: f64, x: [f64; 2], u: [f64; 2]) -> [f64; 2] {
    let along = |k: [f64; 2], h: f64| [x[0] + h * k[0], x[1] + h * k[1]];
    let k1 = plant(t, x, u);
    let k2 = plant(t + 0.5 * H, along(k1, 0.5 * H), u);
    let k3 = plant(t + 0.5 * H, along(k2, 0.5 * H), u);
    let k4 = plant(t + H, along(k3, H), u);
    std::array::from_fn(|i| x[i] + H / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]))
}

pub const KEY: &str = "angles = [1]";
