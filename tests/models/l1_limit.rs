//! The linear limit of an L1 controller: its equations written out, L1 controllers of growing adaptation gain, and its
//! results on the loops of the thesis.

#![allow(non_snake_case)] // matrices have the names of the thesis

use adaptive_fmu::error::Invalid;
use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use common::closed::{Closed, Metric, metrics, near};
use common::description;
use common::models::Run;
use common::random::Random;

/// An L1 description of this package as that of its limit.
fn limit_of(name: &str) -> String {
    let text = description(name);
    assert!(text.contains("model = \"l1\"\n"));
    text.replace("model = \"l1\"\n", "model = \"l1-limit\"\n")
}

/// Two channels, taken for double integrators with x = (q, q'), and a plant x' = A x + B u + d that is something else.
struct Hand {
    plant: [[f64; 4]; 2],
    input: [[f64; 2]; 2],
    disturbance: [f64; 2],
    r: [f64; 2],
    pole: [[f64; 2]; 2],
    K: [[f64; 2]; 2],
    /// D(s) = g (z s + 1)/(s (τ s + 1)).
    filter: [f64; 3],
    limit: [f64; 2],
    T_t: f64,
    inertia: [f64; 2],
}

impl Hand {
    fn random(random: &mut Random) -> Self {
        let mut any = |size: f64| size * random.next();
        Hand {
            plant: [(); 2].map(|()| [(); 4].map(|()| any(3.0))),
            input: [[1.0 + any(0.4), any(0.3)], [any(0.3), 1.0 + any(0.4)]],
            disturbance: [any(2.0), any(2.0)],
            r: [any(1.0), any(1.0)],
            pole: [[-8.0 + any(2.0), 3.0 + any(1.0)], [-10.0 + any(2.0), 1.0 + any(1.0)]],
            K: [[15.0 + any(5.0), any(3.0)], [any(3.0), 12.0 + any(5.0)]],
            filter: [1.0 + any(0.5), 0.02 + any(0.01), 0.01 + any(0.003)],
            limit: [12.0 + any(8.0), 10.0 + any(8.0)],
            T_t: if any(1.0) > 0.0 { -1.0 } else { 0.06 + any(0.02) },
            inertia: [1.5 + any(0.5), 0.8 + any(0.3)],
        }
    }

    /// K_m x of a channel, and the stiffness that is K_g.
    fn feedback(&self, i: usize, x: &[f64]) -> [f64; 2] {
        let [re, im] = self.pole[i];
        let stiffness = re * re + im * im;
        [stiffness * x[i] - 2.0 * re * x[2 + i], stiffness]
    }

    /// u_ad, the control, and what the limits add to it in units of u_ad.
    fn control(&self, i: usize, z: &[f64]) -> [f64; 3] {
        let [g, zero, tau] = self.filter;
        let (integral, lagged) = (z[4 + i], z[6 + i]);
        let u_ad = g * (lagged + zero * (integral - lagged) / tau);
        let wanted = (u_ad - self.feedback(i, z)[0]) * self.inertia[i];
        let u = wanted.clamp(-self.limit[i], self.limit[i]);
        [u_ad, u, (u - wanted) / self.inertia[i]]
    }

    /// Rates of (q, q', integrals, lags): the equations are not rewritten, as x' is known here.
    fn rates(&self, z: &[f64; 8]) -> [f64; 8] {
        let controls = [self.control(0, z), self.control(1, z)];
        let mut rates = [0.0; 8];
        for i in 0..2 {
            rates[i] = z[2 + i];
            let own = (0..4).map(|j| self.plant[i][j] * z[j]).sum::<f64>();
            rates[2 + i] = own + (0..2).map(|j| self.input[i][j] * controls[j][1]).sum::<f64>() + self.disturbance[i];
        }
        let [g, _, tau] = self.filter;
        // η = B⁺ (x' − A_m x), and A_m = A − B K_m.
        let excess: [f64; 2] = std::array::from_fn(|j| {
            let [K_m_x, K_g] = self.feedback(j, z);
            rates[2 + j] + K_m_x - K_g * self.r[j]
        });
        for i in 0..2 {
            let size = self.K[i].iter().map(|k| k.abs()).sum::<f64>();
            let tracking = if self.T_t > 0.0 { 1.0 / self.T_t } else { size * g };
            let followed = controls[i][2] * tracking / g;
            rates[4 + i] = -(self.K[i][0] * excess[0] + self.K[i][1] * excess[1]) + followed;
            rates[6 + i] = (z[4 + i] - z[6 + i]) / tau + followed;
        }
        rates
    }

    fn advance(&self, z: &mut [f64; 8], duration: f64) {
        let steps = (duration / 2e-5).round() as usize;
        let h = duration / steps as f64;
        for _ in 0..steps {
            let moved = |k: &[f64; 8], h: f64| std::array::from_fn(|j| z[j] + h * k[j]);
            let k1 = self.rates(z);
            let k2 = self.rates(&moved(&k1, 0.5 * h));
            let k3 = self.rates(&moved(&k2, 0.5 * h));
            let k4 = self.rates(&moved(&k3, h));
            *z = std::array::from_fn(|j| z[j] + h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]));
        }
    }

    /// The same loop of the unit.
    fn run(&self, baseline: &str) -> Run {
        let rows = |values: &[[f64; 4]; 2]| {
            format!("[[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], {:?}, {:?}]", values[0], values[1])
        };
        let [[a, b], [c, e]] = self.input;
        let plant = format!(
            "model = 'state-space'\n[structure]\nA = {}\nB = [[0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0], [{a:?}, {b:?}, \
             1.0, 0.0], [{c:?}, {e:?}, 0.0, 1.0]]\nC = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], \
             [0.0, 0.0, 0.0, 1.0]]",
            rows(&self.plant)
        );
        let [g, zero, tau] = self.filter;
        let [[re_1, im_1], [re_2, im_2]] = self.pole;
        let controller = format!(
            "model = 'l1-limit'\n[structure]\nA = {}\nB = [[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]\nC = [[1.0, 0.0, \
             0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]\nbaseline = '{baseline}'\ncommands = 'acceleration'\nfilter = {{ gain = {g:?}, \
             numerator = [[{zero:?}, 1.0]], denominator = [[1.0, 0.0], [{tau:?}, 1.0]] }}\n[start]\npole_real = [{re_1:?}, \
             {re_1:?}, {re_2:?}, {re_2:?}]\npole_imag = [{im_1:?}, -{im_1:?}, {im_2:?}, -{im_2:?}]\nfeedback_gain = {:?}\n\
             u_min = [-{:?}, -{:?}]\nu_max = {:?}\ntracking_time = {:?}\nnominal_inertia = {:?}",
            rows(&[[0.0; 4]; 2]),
            self.K,
            self.limit[0],
            self.limit[1],
            self.limit,
            [self.T_t; 2],
            self.inertia
        );
        let closed = Closed::new().described("plant", &plant, "").described("controller", &controller, "");
        let closed = closed.connected("plant.y", "controller.x", 4).connected("controller.u", "plant.u", 2);
        let mut run = closed.prepared(1e-10);
        for i in 0..2 {
            run.set(&format!("controller.r[{}]", i + 1), self.r[i]);
            run.set(&format!("plant.u[{}]", i + 3), self.disturbance[i]);
        }
        run.0.initialise().unwrap();
        run
    }
}

#[test]
fn it_is_the_law_with_what_moves_the_plant_for_an_estimate() {
    let mut random = Random::new(7);
    let mut limited = 0;
    for round in 0..6 {
        let hand = Hand::random(&mut random);
        // What is known of the baseline or not is all the same to what the plant does.
        let mut run = hand.run(["inside", "outside"][round % 2]);
        let mut z = [0.0; 8];
        for k in 0..10 {
            hand.advance(&mut z, 0.1);
            run.step(0.1);
            for i in 0..2 {
                let [u_ad, u, added] = hand.control(i, &z);
                limited += usize::from(added != 0.0);
                for (name, exact) in [("plant.y", z[i]), ("controller.u", u), ("controller.u_ad", u_ad)] {
                    let found = run.get(&format!("{name}[{}]", i + 1));
                    assert!((found - exact).abs() < 2e-6 * (1.0 + exact.abs()), "{round} {k} {name}: {found}, {exact}");
                }
            }
        }
    }
    assert!(limited > 0, "limits act in some of them");
}

/// The controller of example 3.4.1 with a linear plant: D(s) and D(s) H_m⁻¹ H_um, which is D(s)(s + 1.8) in channel 2, as a
/// cascade of sections by hand.
#[test]
fn with_unmatched_uncertainty_it_is_the_law_with_what_moves_the_plant_for_an_estimate() {
    let mut random = Random::new(11);
    for round in 0..3 {
        let A: [[f64; 3]; 3] = [(); 3].map(|()| [(); 3].map(|()| 0.5 * random.next()));
        let A_m = [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, -1.8]];
        let A: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| A_m[i][j] + A[i][j]));
        let (d, r) = (random.vector::<3>(), random.vector::<2>());
        let sections = |z: &[f64], w: f64, a_2: f64| {
            let [i, p, q, w1, w2] = z[..] else { panic!("five states") };
            let whole = i + a_2;
            [w + 1.8 * a_2, 25.0 * (whole - p), 70.0 * (p - q), 40.0 * w2, 40.0 * (q - w1) - 72.0 * w2]
        };
        let rates = |z: &[f64; 13]| -> [f64; 13] {
            let u = [-8.0 * z[6], -8.0 * z[11]];
            let moved = [u[0], 0.0, u[0] + u[1]];
            let x_rate: [f64; 3] =
                std::array::from_fn(|i| (0..3).map(|j| A[i][j] * z[j]).sum::<f64>() + moved[i] + d[i]);
            let left: [f64; 3] = std::array::from_fn(|i| x_rate[i] - (0..3).map(|j| A_m[i][j] * z[j]).sum::<f64>());
            // B = [1 0; 0 0; 1 1], B_um = (0, 1, 0).
            let (eta, eta_2) = ([left[0], left[2] - left[0]], left[1]);
            let first = sections(&z[3..8], eta[0] - r[0], 0.0);
            let second = sections(&z[8..13], eta[1] - (r[1] - r[0]), eta_2);
            std::array::from_fn(|k| match k {
                0..3 => x_rate[k],
                3..8 => first[k - 3],
                _ => second[k - 8],
            })
        };
        let plant = format!(
            "model = 'state-space'\n[structure]\nA = {A:?}\nB = [[1.0, 0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, 0.0], [1.0, \
             1.0, 0.0, 0.0, 1.0]]\nC = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]"
        );
        let closed = Closed::new().described("plant", &plant, "");
        let closed = closed.described("controller", &limit_of("L1UnmatchedMimo"), "");
        let closed = closed.connected("plant.y", "controller.x", 3).connected("controller.u", "plant.u", 2);
        let mut run = closed.prepared(1e-10);
        (0..2).for_each(|i| run.set(&format!("controller.r[{}]", i + 1), r[i]));
        (0..3).for_each(|i| run.set(&format!("plant.u[{}]", i + 3), d[i]));
        run.0.initialise().unwrap();
        let (mut z, h) = ([0.0; 13], 5e-5);
        for k in 0..10 {
            for _ in 0..4000 {
                let moved = |k: &[f64; 13], h: f64| std::array::from_fn(|j| z[j] + h * k[j]);
                let k1 = rates(&z);
                let k2 = rates(&moved(&k1, 0.5 * h));
                let k3 = rates(&moved(&k2, 0.5 * h));
                let k4 = rates(&moved(&k3, h));
                z = std::array::from_fn(|j| z[j] + h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]));
            }
            run.step(0.2);
            let known = [
                ("plant.y[1]", z[0]),
                ("plant.y[2]", z[1]),
                ("controller.u[1]", -8.0 * z[6]),
                ("controller.u[2]", -8.0 * z[11]),
            ];
            for (name, exact) in known {
                assert!((run.get(name) - exact).abs() < 1e-6, "{round} {k} {name}: {}, {exact}", run.get(name));
            }
        }
    }
}

/// Two loops, each as a single FMU: their largest distance in the outputs.
fn distance([mut one, mut other]: [Run; 2], outputs: usize, steps: usize, step: f64) -> f64 {
    let mut largest: f64 = 0.0;
    for _ in 0..steps {
        one.step(step);
        other.step(step);
        for i in 1..=outputs {
            let name = format!("plant.y[{i}]");
            largest = largest.max((one.get(&name) - other.get(&name)).abs());
        }
    }
    largest
}

/// A loop of units of this package with a controller's text.
fn closed([reference, plant]: [&str; 2], controller: &str, start: &str, [m, n]: [usize; 2]) -> Closed {
    let closed = Closed::new().part("reference", reference, "").part("plant", plant, "");
    let closed = closed.described("controller", controller, start);
    let closed = closed.connected("reference.r", "controller.r", m).connected("plant.x", "controller.x", n);
    closed.connected("controller.u", "plant.u", m)
}

const SLOW_POLES: &str = "pole_real = [-30.0, -30.0, -40.0, -40.0]\npole_imag = [0.5, -0.5, 0.5, -0.5]\n";

/// With ten times the adaptation gain an L1 loop is ten times closer.
#[test]
fn an_l1_loop_tends_to_it_as_its_adaptation_gets_fast() {
    for (units, name, slow, sizes, steps, gains, known) in [
        (
            ["ReferenceNonlinearSiso", "NonlinearSiso"],
            "L1NonlinearSiso",
            "",
            [1, 2],
            10_000,
            [1e5, 1e6],
            [2.3e-5, 2.3e-6],
        ),
        (
            ["ReferenceTwoLinkRobot", "TwoLinkRobot"],
            "L1TwoLinkRobot",
            SLOW_POLES,
            [2, 4],
            4000,
            [1e5, 1e6],
            [4.117e-3, 7.08e-4],
        ),
        (["ReferenceActuatedSiso", "ActuatedSiso"], "L1ActuatedSiso", "", [1, 2], 4000, [1e5, 1e6], [0.0, 1.97e-5]),
    ] {
        let limit = || closed(units, &limit_of(name), slow, sizes).started(1e-9);
        for (gain, known) in gains.into_iter().zip(known).filter(|(_, known)| *known > 0.0) {
            let start = format!("{slow}adaptation_gain = {gain:?}");
            let l1 = closed(units, &description(name), &start, sizes).started(1e-9);
            let found = distance([l1, limit()], sizes[0], steps, 1e-3);
            println!("{name}, {gain:e}: {found:e}");
            near(&format!("{name}, {gain:e}"), found, known, 0.02);
        }
    }
}

fn show(name: &str, metrics: &[Metric]) {
    println!("{name}: {metrics:?}");
}

#[test]
fn on_the_first_example_it_is_what_the_l1_loop_is() {
    let model =
        "model = 'state-space'\n[structure]\nA = [[0.0, 1.0], [-1.0, -1.4]]\nB = [[0.0], [1.0]]\nC = [[1.0, 0.0]]";
    let units = ["ReferenceNonlinearSiso", "NonlinearSiso"];
    let closed = closed(units, &description("L1LimitNonlinearSiso"), "", [1, 2]).described("ideal", model, "");
    let mut run = closed.connected("reference.r", "ideal.u", 1).started(1e-9);
    let signals = ["plant.y[1] -ideal.y[1]", "reference.r[1] -plant.y[1]", "controller.u[1]"];
    let found = metrics(&mut run, &signals, [60.0, 5.0, 0.01]);
    show("3.2.1", &found);
    near("max |y - y_m|", found[0].max, 0.0367, 2e-3);
    near("rms (y - y_m)", found[0].rms, 0.01649, 1e-3);
    near("rms (r - y)", found[1].rms, 0.42241, 1e-3);
    near("max |u|", found[2].max, 2.766, 1e-3);
}

#[test]
fn on_the_robot_it_is_what_the_l1_loop_is() {
    let units = ["ReferenceTwoLinkRobot", "TwoLinkRobot"];
    let mut run = closed(units, &description("L1LimitTwoLinkRobot"), SLOW_POLES, [2, 4]).started(1e-9);
    let signals = ["reference.r[1] -plant.y[1]", "reference.r[2] -plant.y[2]", "controller.u[1]", "controller.u[2]"];
    let begun = metrics(&mut run, &signals, [0.5, 0.0, 5e-5]);
    near("max |u_1|", begun[2].max, 113.44, 1e-4);
    near("max |u_2|", begun[3].max, 88.86, 1e-4);
    let found = metrics(&mut run, &signals, [19.5, 4.5, 1e-3]);
    show("robot", &found);
    near("rms e_1", found[0].rms, 0.024851, 1e-4);
    near("rms e_2", found[1].rms, 0.022633, 1e-4);
}

#[test]
fn on_chapter_4_it_is_what_the_l1_loop_is() {
    let units = ["ReferenceActuatedSiso", "ActuatedSiso"];
    let mut run = closed(units, &limit_of("L1ActuatedSiso"), "", [1, 2]).started(1e-9);
    let found = metrics(&mut run, &["reference.r[1] -plant.y[1]", "controller.u[1]"], [40.0, 5.0, 2e-3]);
    show("4-case1", &found);
    near("max |e|", found[0].late, 0.072514, 1e-4);
    near("rms e", found[0].rms, 0.04991, 2e-4);
    near("max |u|", found[1].max, 245.15, 1e-3);
}

/// η_2 enters u_ad immediately: it is differentiated.
#[test]
fn on_the_twin_rotor_it_is_what_the_l1_loop_is() {
    let mut run = closed(["ReferenceTwinRotor", "TwinRotor"], &limit_of("L1TwinRotor"), "", [2, 6]).started(1e-8);
    let signals = ["reference.r[1] -plant.y[1]", "reference.r[2] -plant.y[2]", "controller.u[1]", "controller.u[2]"];
    let found = metrics(&mut run, &signals, [30.0, 10.0, 5e-3]);
    show("3.4.2", &found);
    near("rms of the pitch error", found[0].rms, 0.007194, 2e-4);
    near("rms of the yaw error", found[1].rms, 0.015479, 2e-4);
    near("max |u_1|", found[2].max, 0.8333, 1e-3);
    near("max |u_2|", found[3].max, 0.5027, 1e-3);
}

#[test]
fn on_the_example_of_unmatched_uncertainty_it_is_what_the_l1_loop_is() {
    let model = "model = 'state-space'\n[structure]\nA = [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, -1.8]]\nB = [[1.0, \
                 0.0], [0.0, 0.0], [0.0, 1.0]]\nC = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]";
    let closed = closed(["ReferenceUnmatchedMimo", "UnmatchedMimo"], &limit_of("L1UnmatchedMimo"), "", [2, 3]);
    let closed = closed.described("ideal", model, "").connected("reference.r", "ideal.u", 2);
    let mut run = closed.started(1e-9);
    let signals = ["plant.y[1] -ideal.y[1]", "plant.y[2] -ideal.y[2]", "controller.u[1]", "controller.u[2]"];
    let found = metrics(&mut run, &signals, [30.0, 5.0, 2e-3]);
    show("3.4.1", &found);
    for (i, (max, rms)) in [(0.19344, 0.02697), (0.04422, 0.01730)].into_iter().enumerate() {
        near("largest deviation", found[i].max, max, 5e-4);
        near("rms of the deviation", found[i].rms, rms, 1e-3);
    }
    near("max |u_1|", found[2].max, 1.2636, 1e-3);
    near("max |u_2|", found[3].max, 2.1729, 1e-3);
}

#[test]
fn on_the_coupled_system_it_is_what_the_l1_loop_is() {
    let model = "model = 'state-space'\n[structure]\nA = [[-70.0, 0.0, 0.0], [0.0, -60.0, 1.0], [0.0, -1.0, -60.0]]\nB = \
                 [[70.0, 0.0, 0.0], [0.0, 60.0, -1.0], [0.0, 1.0, 60.0]]\nC = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, \
                 1.0]]";
    let closed = Closed::new().part("reference", "ReferenceCoupledMimo", "");
    let closed = closed.part("plant", "CoupledMimo", "x0 = [0.6, -0.8, 0.4]");
    let closed = closed.described("controller", &limit_of("L1CoupledMimo"), "").described("ideal", model, "");
    let closed = closed.connected("reference.r", "controller.r", 3).connected("plant.x", "controller.x", 3);
    let closed = closed.connected("controller.u", "plant.u", 3).connected("reference.r", "ideal.u", 3);
    let mut run = closed.started(1e-9);
    let signals = [
        "plant.x[1] -ideal.y[1]",
        "plant.x[2] -ideal.y[2]",
        "plant.x[3] -ideal.y[3]",
        "controller.u[1]",
        "controller.u[2]",
        "controller.u[3]",
    ];
    let found = metrics(&mut run, &signals, [10.0, 5.0, 1e-3]);
    show("6.5.1", &found);
    for (i, rms) in [0.01745, 0.01947, 0.01508].into_iter().enumerate() {
        near("rms e", found[i].rms, rms, 1e-3);
    }
    near("max |u|", found[3..].iter().map(|metric| metric.max).fold(0.0, f64::max), 64.4, 2e-3);
}

/// A unit, before its initialisation, with further start values.
fn alone(text: &str, start: &str) -> Run {
    Run(Execution::new(made(&format!("{text}\n{start}")).unwrap()))
}

fn made(text: &str) -> Result<Model, Invalid> {
    Model::from_description(Description::read(text)?, REGISTRY)
}

#[test]
fn neither_way_of_changing_command_makes_the_control_jump() {
    for name in ["L1NonlinearSiso", "L1UnmatchedMimo", "L1TwinRotor", "L1TwoLinkRobot"] {
        let (n, m) = match name {
            "L1NonlinearSiso" => (2, 1),
            "L1UnmatchedMimo" => (3, 2),
            "L1TwinRotor" => (6, 2),
            _ => (4, 2),
        };
        let mut run = alone(&limit_of(name), "");
        let set_x = |run: &mut Run, k: usize| {
            (1..=n).for_each(|i| run.set(&format!("x[{i}]"), 0.1 * (0.3 * k as f64 + i as f64).sin()));
        };
        let controls = |run: &Run| (1..=m).map(|i| run.get(&format!("u[{i}]"))).collect::<Vec<_>>();
        set_x(&mut run, 0);
        run.0.initialise().unwrap();
        for k in 1..20 {
            set_x(&mut run, k);
            run.step(0.01);
        }
        let before = controls(&run);
        (1..=m).for_each(|i| run.set(&format!("u_manual[{i}]"), before[i - 1]));
        run.set_boolean("enabled", false);
        run.step(1e-9);
        assert_eq!(controls(&run), before, "{name}");
        for k in 20..40 {
            set_x(&mut run, k);
            (1..=m).for_each(|i| run.set(&format!("u_manual[{i}]"), 0.3 + 0.1 * i as f64));
            run.step(0.01);
        }
        run.set_boolean("enabled", true);
        run.step(1e-10);
        for (i, u) in controls(&run).into_iter().enumerate() {
            assert!((u - 0.4 - 0.1 * i as f64).abs() < 1e-4, "{name}: {u}");
        }
    }
}

#[test]
fn tuning_the_feedback_gain_makes_no_jump() {
    for (name, n) in [("L1NonlinearSiso", 2), ("L1UnmatchedMimo", 3)] {
        let mut run = alone(&limit_of(name), "");
        (1..=n).for_each(|i| run.set(&format!("x[{i}]"), 0.3));
        run.0.initialise().unwrap();
        run.run(20, 0.01);
        let before = run.get("u[1]");
        run.set("feedback_gain[1,1]", 3.0);
        run.step(1e-9);
        assert!((run.get("u[1]") - before).abs() < 1e-5, "{name}");
        run.run(20, 0.01);
        assert!((run.get("u[1]") - before).abs() > 1e-4, "{name}: it does act");
    }
}

#[test]
fn a_bumpless_start_begins_at_the_manual_control() {
    let mut run = alone(&limit_of("L1TwoLinkRobot"), "u_ad_start = 'bumpless'");
    for (name, value) in [("x[1]", 0.5), ("x[4]", -0.39), ("r[1]", 0.5), ("u_manual[1]", 15.0), ("u_manual[2]", -3.0)] {
        run.set(name, value);
    }
    run.0.initialise().unwrap();
    near("u_1", run.get("u[1]"), 15.0, 1e-12);
    near("u_2", run.get("u[2]"), -3.0, 1e-12);
}

/// Γ and the bounds of an L1 description have no meaning here, and make no harm; what no L1 controller has is refused.
#[test]
fn the_description_of_an_l1_controller_serves_as_it_is() {
    for name in ["L1NonlinearSiso", "L1TwoLinkRobot", "L1UnmatchedMimo", "L1TwinRotor", "L1MaresAuv", "L1CoupledMimo"] {
        let model = made(&limit_of(name)).unwrap_or_else(|invalid| panic!("{name}: {invalid}"));
        assert!(model.variables().find("adaptation_gain").is_none(), "{name}");
    }
    let text = limit_of("L1NonlinearSiso") + "\nadaption_gain = 1.0";
    let refused = made(&text).unwrap_err().to_string();
    assert!(refused.contains("adaption_gain") && refused.contains("no such parameter"), "{refused}");
}
