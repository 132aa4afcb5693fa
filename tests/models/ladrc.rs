//! Active disturbance rejection: against its equations written out, against published figures, and on the loops of the
//! thesis.
#![allow(non_snake_case)] // matrices have the names of the field

use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use common::closed::{Closed, Metric, metrics, near};
use common::description;
use common::models::Run;
use common::random::Random;

/// Two coupled chains of n integrators with disturbances in their last derivatives, and the controller, written out.
struct Hand {
    n: usize,
    /// Last derivatives by the states (output by output), and by the controls.
    A: Vec<Vec<f64>>,
    B: [[f64; 2]; 2],
    B_0: [[f64; 2]; 2],
    omega_c: [f64; 2],
    omega_o: [f64; 2],
    limit: [f64; 2],
    /// r and its derivatives, which here are constants of their own.
    r: Vec<[f64; 2]>,
    /// The manual control, while it is in command.
    manual: Option<[f64; 2]>,
}

/// n over k, for what is needed of it.
fn over(n: usize, k: usize) -> f64 {
    [[1.0, 1.0, 0.0, 0.0, 0.0], [1.0, 2.0, 1.0, 0.0, 0.0], [1.0, 3.0, 3.0, 1.0, 0.0], [1.0, 4.0, 6.0, 4.0, 1.0]][n - 1]
        [k]
}

impl Hand {
    fn random(n: usize, random: &mut Random) -> Self {
        let mut any = |size: f64| size * random.next();
        let B = [[1.5 + any(0.3), any(0.4)], [any(0.4), 1.2 + any(0.3)]];
        Hand {
            n,
            A: (0..2).map(|_| (0..2 * n).map(|_| any(1.5)).collect()).collect(),
            B,
            B_0: B.map(|row| row.map(|b| b * (1.0 + any(0.2)))),
            omega_c: [3.0 + any(1.0), 4.0 + any(1.0)],
            omega_o: [30.0 + any(5.0), 25.0 + any(5.0)],
            limit: [6.0 + any(2.0), 8.0 + any(2.0)],
            r: (0..=n).map(|_| [any(0.7), any(0.7)]).collect(),
            manual: None,
        }
    }

    /// B_0⁻¹ (u_0 − z_{n+1}). States: outputs with their derivatives, estimates, u_b.
    fn law(&self, s: &[f64]) -> [f64; 2] {
        let (n, z) = (self.n, 2 * self.n);
        let asked: [f64; 2] = std::array::from_fn(|ch| {
            let z = &s[z + ch * (n + 1)..];
            let parts = (1..=n)
                .map(|i| over(n, i - 1) * self.omega_c[ch].powi((n - i + 1) as i32) * (self.r[i - 1][ch] - z[i - 1]));
            parts.sum::<f64>() + self.r[n][ch] - z[n]
        });
        let [[a, b], [c, d]] = self.B_0;
        let determinant = a * d - b * c;
        [(d * asked[0] - b * asked[1]) / determinant, (a * asked[1] - c * asked[0]) / determinant]
    }

    fn control(&self, s: &[f64]) -> [f64; 2] {
        let law = self.law(s);
        let u_b = &s[s.len() - 2..];
        std::array::from_fn(|j| {
            self.manual.map_or(law[j] + u_b[j], |manual| manual[j]).clamp(-self.limit[j], self.limit[j])
        })
    }

    fn rates(&self, s: &[f64]) -> Vec<f64> {
        let n = self.n;
        let u = self.control(s);
        let mut rates = vec![0.0; s.len()];
        for ch in 0..2 {
            for k in 0..n - 1 {
                rates[ch * n + k] = s[ch * n + k + 1];
            }
            rates[ch * n + n - 1] = (0..2 * n).map(|j| self.A[ch][j] * s[j]).sum::<f64>()
                + (0..2).map(|j| self.B[ch][j] * u[j]).sum::<f64>();
            let first = 2 * n + ch * (n + 1);
            let left = s[ch * n] - s[first];
            for i in 1..=n {
                rates[first + i - 1] = s[first + i] + over(n + 1, i) * self.omega_o[ch].powi(i as i32) * left;
            }
            rates[first + n - 1] += (0..2).map(|j| self.B_0[ch][j] * u[j]).sum::<f64>();
            rates[first + n] = self.omega_o[ch].powi(n as i32 + 1) * left;
            let u_b = s.len() - 2 + ch;
            rates[u_b] = -self.omega_c[ch] * s[u_b];
        }
        rates
    }

    fn advance(&self, s: &mut [f64], duration: f64) {
        let steps = (duration / 1e-4).round() as usize;
        let h = duration / steps as f64;
        let moved = |s: &[f64], k: &[f64], h: f64| s.iter().zip(k).map(|(s, k)| s + h * k).collect::<Vec<_>>();
        for _ in 0..steps {
            let k1 = self.rates(s);
            let k2 = self.rates(&moved(s, &k1, 0.5 * h));
            let k3 = self.rates(&moved(s, &k2, 0.5 * h));
            let k4 = self.rates(&moved(s, &k3, h));
            for j in 0..s.len() {
                s[j] += h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]);
            }
        }
    }

    /// The same loop of the unit, before its initialisation.
    fn run(&self) -> Run {
        let n = self.n;
        let unit = |k: usize| (0..2 * n).map(|j| f64::from(u8::from(j == k))).collect::<Vec<_>>();
        let A: Vec<_> = (0..2 * n).map(|k| if k % n == n - 1 { self.A[k / n].clone() } else { unit(k + 1) }).collect();
        let B: Vec<_> = (0..2 * n).map(|k| if k % n == n - 1 { self.B[k / n] } else { [0.0; 2] }).collect();
        let C = [unit(0), unit(n)];
        let plant = format!("model = 'state-space'\n[structure]\nA = {A:?}\nB = {B:?}\nC = {C:?}");
        let controller = format!(
            "model = 'ladrc'\n[structure]\nchannels = 2\norder = {n}\nfeedforward = 'given'\n[start]\nomega_c = {:?}\nomega_o = \
             {:?}\nB_0 = {:?}\nu_min = [-{:?}, -{:?}]\nu_max = {:?}",
            self.omega_c, self.omega_o, self.B_0, self.limit[0], self.limit[1], self.limit
        );
        let closed = Closed::new().described("plant", &plant, "").described("controller", &controller, "");
        let closed = closed.connected("plant.y", "controller.y", 2).connected("controller.u", "plant.u", 2);
        let mut run = closed.prepared(1e-10);
        for (name, r) in ["r", "dr", "ddr", "dddr"].into_iter().zip(&self.r) {
            (0..2).for_each(|i| run.set(&format!("controller.{name}[{}]", i + 1), r[i]));
        }
        run.0.initialise().unwrap();
        run
    }
}

#[test]
fn it_is_the_law_that_is_written() {
    let mut random = Random::new(3);
    for n in [1, 2, 3] {
        for _ in 0..3 {
            let mut hand = Hand::random(n, &mut random);
            let mut run = hand.run();
            let mut s = vec![0.0; 2 * n + 2 * (n + 1) + 2];
            let (mut limited, mut jump) = (0, f64::NAN);
            for k in 0..20 {
                if k == 8 {
                    hand.manual = Some([0.5, -20.0]);
                    (0..2).for_each(|i| run.set(&format!("controller.u_manual[{}]", i + 1), [0.5, -20.0][i]));
                    run.set_boolean("controller.enabled", false);
                }
                if k == 12 {
                    let manual = hand.control(&s);
                    hand.manual = None;
                    let (law, last) = (hand.law(&s), s.len() - 2);
                    (0..2).for_each(|j| s[last + j] = manual[j] - law[j]);
                    jump = hand.control(&s)[0] - manual[0];
                    run.set_boolean("controller.enabled", true);
                }
                hand.advance(&mut s, 0.1);
                run.step(0.1);
                let u = hand.control(&s);
                limited += usize::from((0..2).any(|j| u[j].abs() == hand.limit[j]));
                for i in 0..2 {
                    for (name, exact) in [("plant.y", s[i * n]), ("controller.u", u[i])] {
                        let found = run.get(&format!("{name}[{}]", i + 1));
                        assert!((found - exact).abs() < 1e-5 * (1.0 + exact.abs()), "{n} {k} {name}: {found}, {exact}");
                    }
                    let found = run.get(&format!("controller.z[{},{}]", i + 1, n + 1));
                    let exact = s[2 * n + i * (n + 1) + n];
                    assert!((found - exact).abs() < 1e-5 * (1.0 + exact.abs()), "{n} {k} f: {found}, {exact}");
                }
            }
            assert!(limited > 0 && jump.abs() < 1e-12, "limits act, and a take-over makes no jump: {limited}, {jump}");
        }
    }
}

/// Herbst's examples: when the step response of y has come within 2 %, by how much it overshoots, and the largest control.
#[test]
fn the_published_step_responses_come_out() {
    let first = "model = 'state-space'\n[structure]\nA = [[-1.0]]\nB = [[1.0]]\nC = [[1.0]]";
    let second =
        "model = 'state-space'\n[structure]\nA = [[0.0, 1.0], [-1.0, -2.0]]\nB = [[0.0], [1.0]]\nC = [[1.0, 0.0]]";
    for (plant, n, omega_c, settled, overshoot, largest) in
        [(first, 1, 4.0, 1.0354, 0.0, 4.0), (second, 2, 1.2, 4.9255, 0.00242, 1.44)]
    {
        let controller =
            format!("model = 'ladrc'\n[structure]\nchannels = 1\norder = {n}\n[start]\nomega_c = [{omega_c:?}]");
        let closed = Closed::new().described("plant", plant, "").described("controller", &controller, "");
        let closed = closed.connected("plant.y", "controller.y", 1).connected("controller.u", "plant.u", 1);
        let mut run = closed.prepared(1e-10);
        run.set("controller.r[1]", 1.0);
        run.0.initialise().unwrap();
        let (mut last, mut within, mut highest, mut control) = (0.0_f64, 0.0, 0.0_f64, run.get("controller.u[1]"));
        for k in 1..=8000 {
            run.step(1e-3);
            let y = run.get("plant.y[1]");
            if last < 0.98 && y >= 0.98 {
                within = 1e-3 * (f64::from(k - 1) + (0.98 - last) / (y - last));
            }
            (last, highest, control) = (y, highest.max(y), control.max(run.get("controller.u[1]")));
        }
        assert_eq!(run.get("controller.omega_o_in_force[1]"), 10.0 * omega_c);
        assert!((within - settled).abs() < 1e-4, "{n}: {within}, {settled}");
        assert!(((highest - 1.0).max(0.0) - overshoot).abs() < 1e-5, "{n}: {highest}");
        near("max u", control, largest, 1e-4);
    }
}

/// A loop with a controller of this text; all of its inputs are connected.
fn closed([reference, plant]: [&str; 2], controller: &str, m: usize) -> Closed {
    let closed = Closed::new().part("reference", reference, "").part("plant", plant, "");
    let mut closed = closed.described("controller", controller, "");
    if controller.contains("feedforward = \"given\"") {
        closed = closed.connected("reference.dr", "controller.dr", m).connected("reference.ddr", "controller.ddr", m);
    }
    let closed = closed.connected("reference.r", "controller.r", m).connected("plant.y", "controller.y", m);
    closed.connected("controller.u", "plant.u", m)
}

fn without_derivatives(text: &str) -> String {
    text.replace("feedforward = \"given\"", "feedforward = \"none\"")
}

fn of(channels: usize, order: usize, start: &str) -> String {
    format!(
        "model = 'ladrc'\n[structure]\nchannels = {channels}\norder = {order}\nfeedforward = \"given\"\n[start]\n{start}"
    )
}

fn errors(run: &mut Run, m: usize, time: [f64; 3]) -> Vec<Metric> {
    let error = |i: usize| format!("reference.r[{i}] -plant.y[{i}]");
    let control = |i: usize| format!("controller.u[{i}]");
    let signals: Vec<_> = (1..=m).map(error).chain((1..=m).map(control)).collect();
    let found = metrics(run, &signals.iter().map(String::as_str).collect::<Vec<_>>(), time);
    println!("{found:?}");
    found
}

#[test]
fn the_plant_of_example_3_2_1_follows_its_reference() {
    let (units, text) = (["ReferenceNonlinearSiso", "NonlinearSiso"], description("LadrcNonlinearSiso"));
    let found = errors(&mut closed(units, &text, 1).started(1e-9), 1, [60.0, 5.0, 0.01]);
    near("rms e", found[0].rms, 0.000503, 2e-3);
    near("max |u|", found[1].max, 64.0, 1e-3);
    let found = errors(&mut closed(units, &without_derivatives(&text), 1).started(1e-9), 1, [60.0, 5.0, 0.01]);
    near("rms e, r alone", found[0].rms, 0.0737, 1e-3);
}

#[test]
fn the_robot_follows_its_reference() {
    let (units, text) = (["ReferenceTwoLinkRobot", "TwoLinkRobot"], description("LadrcTwoLinkRobot"));
    let found = errors(&mut closed(units, &text, 2).started(1e-9), 2, [20.0, 5.0, 0.005]);
    near("rms e_1", found[0].rms, 0.001770, 1e-3);
    near("rms e_2", found[1].rms, 0.002617, 1e-3);
    near("max |u_1|", found[2].max, 51.9, 2e-3);
    near("max |u_2|", found[3].max, 4.36, 2e-3);
    let found = errors(&mut closed(units, &without_derivatives(&text), 2).started(1e-9), 2, [20.0, 5.0, 0.005]);
    near("rms e_1, r alone", found[0].rms, 0.0617, 1e-3);
    near("rms e_2, r alone", found[1].rms, 0.0675, 1e-3);
}

#[test]
fn the_plant_of_chapter_4_follows_its_reference() {
    let (units, text) = (["ReferenceActuatedSiso", "ActuatedSiso"], of(1, 2, "omega_c = [5.0]\nomega_o = [100.0]"));
    let found = errors(&mut closed(units, &text, 1).started(1e-9), 1, [40.0, 5.0, 0.005]);
    near("rms e", found[0].rms, 0.000823, 2e-3);
    near("max |u|", found[1].max, 27.1, 2e-3);
    let found = errors(&mut closed(units, &without_derivatives(&text), 1).started(1e-9), 1, [40.0, 5.0, 0.005]);
    near("rms e, r alone", found[0].rms, 0.136, 2e-3);
}

/// Third order; of its reference no third derivative is there, so it is followed as a constant.
#[test]
fn the_twin_rotor_follows_its_reference() {
    let start = "omega_c = [10.0, 10.0]\nomega_o = [100.0, 100.0]\nB_0 = [[1.3588, 0.0], [0.0, 3.6]]";
    let text = without_derivatives(&of(2, 3, start));
    let mut run = closed(["ReferenceTwinRotor", "TwinRotor"], &text, 2).started(1e-9);
    let found = errors(&mut run, 2, [30.0, 10.0, 0.005]);
    near("rms of the pitch error", found[0].rms, 0.0058, 1e-2);
    near("rms of the yaw error", found[1].rms, 0.0123, 5e-3);
}

/// First order, behind a reference model whose state and rate are what is to be followed.
#[test]
fn the_coupled_system_follows_its_model() {
    let A = "[[-70.0, 0.0, 0.0], [0.0, -60.0, 1.0], [0.0, -1.0, -60.0]]";
    let B = "[[70.0, 0.0, 0.0], [0.0, 60.0, -1.0], [0.0, 1.0, 60.0]]";
    let I = "[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]";
    let O = "[0.0, 0.0, 0.0]";
    let model = format!(
        "model = 'state-space'\n[structure]\nA = {A}\nB = {B}\nC = [{I}, {}\nD = [{O}, {O}, {O}, {}",
        &A[1..],
        &B[1..]
    );
    let start = "omega_c = [60.0, 60.0, 60.0]\nomega_o = [300.0, 300.0, 300.0]";
    for (feedforward, known) in [("given", [0.00103, 0.00165, 0.00021]), ("none", [0.0088, 0.0085, 0.0080])] {
        let text = of(3, 1, start).replace("\"given\"", &format!("\"{feedforward}\""));
        let mut closed = Closed::new().part("reference", "ReferenceCoupledMimo", "").described("model", &model, "");
        closed = closed.part("plant", "CoupledMimo", "x0 = [0.6, -0.8, 0.4]").described("controller", &text, "");
        closed = closed.connected("reference.r", "model.u", 3).connected("model.y", "controller.r", 3);
        for i in 1..=3 {
            if feedforward == "given" {
                closed = closed.joined(&format!("model.y[{}]", i + 3), &format!("controller.dr[{i}]"));
            }
        }
        closed = closed.connected("plant.y", "controller.y", 3).connected("controller.u", "plant.u", 3);
        let signals = [1, 2, 3].map(|i| format!("model.y[{i}] -plant.y[{i}]"));
        let controls = [1, 2, 3].map(|i| format!("controller.u[{i}]"));
        let signals: Vec<_> = signals.iter().chain(&controls).map(String::as_str).collect();
        let found = metrics(&mut closed.started(1e-9), &signals, [10.0, 5.0, 1e-3]);
        println!("{found:?}");
        for (metric, known) in found.iter().zip(known) {
            near(feedforward, metric.rms, known, 2e-2);
        }
        if feedforward == "given" {
            near("max |u|", found[3..].iter().map(|metric| metric.max).fold(0.0, f64::max), 107.0, 5e-3);
        }
    }
}

#[test]
fn orders_and_bandwidths_that_are_none_are_refused() {
    let refusal = |order: usize, start: &str| {
        let text = format!("name = 'Test'\ndescription = ''\n{}", of(1, order, start));
        match Model::from_description(Description::read(&text).unwrap(), REGISTRY) {
            Ok(model) => Execution::new(model).initialise().unwrap_err().to_string(),
            Err(invalid) => invalid.to_string(),
        }
    };
    for (order, start, named) in [
        (0, "", "order = 0"),
        (4, "", "order = 4"),
        (2, "B_0 = [[0.0]]", "B_0: least singular value"),
        (2, "omega_c = [0.0]", "omega_c"),
        (2, "omega_o = [-2.0]", "at least -1"),
        (2, "omega_o = [-0.5]", "or above 0 rad/s"),
    ] {
        let reason = refusal(order, start);
        assert!(reason.contains(named), "{reason}");
    }
}
