//! The robot moves as two rigid bodies do. Energy is counted here from the motion of the links' mass centres: nothing
//! of the unit's matrices is repeated.

use adaptive_fmu::fmi2::types::{Boolean, CO_SIMULATION, MODEL_EXCHANGE, Status};
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu_library::fmi2_functions::{fmi2CompletedIntegratorStep, fmi2SetBoolean};
use common::random::Random;
use common::{DISCARD, ERROR, OK, Unit, description};
use nalgebra::{Matrix2, Vector2, Vector4};

const G: f64 = 9.81;
/// Mass, length and moment of inertia of each link.
const LINKS: [[f64; 3]; 2] = [[3.2, 0.5, 0.96], [2.0, 0.4, 0.841]];
const FRICTIONLESS: &[(&str, f64)] = &[("k1", 0.0), ("k2", 0.0)];

/// A robot whose accelerations can be asked for anywhere.
struct Robot(Unit);

impl Robot {
    fn new(parameters: &[(&str, f64)]) -> Self {
        let unit = Unit::exchange("TwoLinkRobot");
        parameters.iter().for_each(|&(name, value)| unit.put(name, value));
        unit.begin();
        Robot(unit)
    }

    fn rate(&self, x: Vector4<f64>, u: Vector2<f64>) -> Vector4<f64> {
        self.0.put("u[1]", u[0]);
        self.0.put("u[2]", u[1]);
        assert_eq!(self.0.set_states(x.as_slice()), OK);
        Vector4::from_column_slice(&self.0.derivatives())
    }

    fn acceleration(&self, q: Vector2<f64>, w: Vector2<f64>, u: Vector2<f64>) -> Vector2<f64> {
        let rate = self.rate(Vector4::new(q[0], q[1], w[0], w[1]), u);
        assert_eq!([rate[0], rate[1]], [w[0], w[1]], "the rate of an angle is that rate");
        Vector2::new(rate[2], rate[3])
    }

    /// The inertia matrix, from what unit torques change.
    fn inertia(&self, q: Vector2<f64>) -> Matrix2<f64> {
        let free = self.acceleration(q, Vector2::zeros(), Vector2::zeros());
        let column = |i: usize| self.acceleration(q, Vector2::zeros(), Vector2::ith(i, 1.0)) - free;
        Matrix2::from_columns(&[column(0), column(1)]).try_inverse().unwrap()
    }

    /// The torques that centrifugal and Coriolis forces take up, quadratic in the rates.
    fn gyroscopic(&self, q: Vector2<f64>, w: Vector2<f64>) -> Vector2<f64> {
        let still = self.acceleration(q, Vector2::zeros(), Vector2::zeros());
        self.inertia(q) * (still - self.acceleration(q, w, Vector2::zeros()))
    }
}

/// Kinetic and potential energy of the links, from where their mass centres are and how they move.
fn energy(x: Vector4<f64>) -> f64 {
    let [[m1, l1, i1], [m2, l2, i2]] = LINKS;
    let (a, b) = (x[0], x[0] + x[1]);
    let (a_rate, b_rate) = (x[2], x[2] + x[3]);
    let along = |angle: f64| Vector2::new(angle.cos(), angle.sin());
    let across = |angle: f64| Vector2::new(-angle.sin(), angle.cos());
    let centres = [along(a) * (l1 / 2.0), along(a) * l1 + along(b) * (l2 / 2.0)];
    let first = across(a) * a_rate;
    let velocities = [first * (l1 / 2.0), first * l1 + across(b) * (b_rate * l2 / 2.0)];
    let kinetic = m1 * velocities[0].norm_squared() + m2 * velocities[1].norm_squared();
    0.5 * (kinetic + i1 * a_rate * a_rate + i2 * b_rate * b_rate) + G * (m1 * centres[0].y + m2 * centres[1].y)
}

/// Rate of the energy if the state changes at this rate: a central difference of order 4.
fn power(x: Vector4<f64>, rate: Vector4<f64>) -> f64 {
    let central = |h: f64| (energy(x + rate * h) - energy(x - rate * h)) / (2.0 * h);
    (4.0 * central(1e-4) - central(2e-4)) / 3.0
}

#[test]
fn the_power_of_the_torques_is_what_energy_and_friction_take_up() {
    let mut random = Random::new(1);
    for [k1, k2] in [[0.0, 0.0], [1.0, 1.0], [0.7, 2.5]] {
        let robot = Robot::new(&[("k1", k1), ("k2", k2)]);
        for _ in 0..200 {
            let (x, u) = (Vector4::from(random.vector()) * 2.0, Vector2::from(random.vector()) * 20.0);
            let supplied = x[2] * u[0] + x[3] * u[1] - k1 * x[2] * x[2] - k2 * x[3] * x[3];
            let rate = robot.rate(x, u);
            let error = power(x, rate) - supplied;
            assert!(error.abs() < 1e-8 * (1.0 + rate.norm_squared()), "{error:e} W at {x:?}, {u:?}");
        }
    }
}

#[test]
fn the_change_of_inertia_minus_twice_the_coriolis_matrix_is_skew_symmetric() {
    let (mut random, robot, mut largest) = (Random::new(2), Robot::new(FRICTIONLESS), 0.0_f64);
    for _ in 0..100 {
        let [q, w] = [(); 2].map(|()| Vector2::from(random.vector()) * 2.0);
        let central = |h: f64| (robot.inertia(q + w * h) - robot.inertia(q - w * h)) / (2.0 * h);
        let change = (central(1e-3) * 4.0 - central(2e-3)) / 3.0;
        // C(q, w) v is half of what remains of the quadratic form at w + v without those at w and at v.
        let coriolis = |v| (robot.gyroscopic(q, w + v) - robot.gyroscopic(q, w) - robot.gyroscopic(q, v)) * 0.5;
        let c = Matrix2::from_columns(&[coriolis(Vector2::x()), coriolis(Vector2::y())]);
        let n = change - c * 2.0;
        assert!((n + n.transpose()).amax() < 1e-9, "{n} at q = {q:?}, q' = {w:?}");
        largest = largest.max(n.amax());
    }
    assert!(largest > 0.1, "the matrices are not just zero");
}

fn simulated(parameters: &[(&str, f64)]) -> Unit {
    let unit = Unit::new("TwoLinkRobot");
    unit.put("relative_tolerance", 1e-10);
    parameters.iter().for_each(|&(name, value)| unit.put(name, value));
    unit.start(0.0);
    unit
}

fn state(unit: &Unit) -> Vector4<f64> {
    Vector4::from_fn(|i, _| unit.get(&format!("x[{}]", i + 1)))
}

#[test]
fn without_friction_and_torque_the_energy_stays() {
    let robot = simulated(&[FRICTIONLESS, &[("x0[2]", 0.5), ("x0[4]", 2.0)]].concat());
    let before = energy(state(&robot));
    for k in 0..1000 {
        robot.run(f64::from(k) * 0.01, 1, 0.01);
        let lost = energy(state(&robot)) - before;
        assert!(lost.abs() < 1e-7, "{lost:e} J after {} s", f64::from(k + 1) * 0.01);
    }
}

#[test]
fn friction_brings_the_arm_to_hang() {
    let robot = simulated(&[("x0[3]", 1.0)]);
    let mut before = energy(state(&robot));
    for k in 0..600 {
        robot.run(f64::from(k) * 0.1, 1, 0.1);
        let now = energy(state(&robot));
        assert!(now <= before + 1e-9, "friction gives no energy: {before} J, then {now} J");
        before = now;
    }
    let hanging = Vector4::new(-std::f64::consts::FRAC_PI_2, 0.0, 0.0, 0.0);
    assert!((state(&robot) - hanging).amax() < 1e-3, "{:?}", state(&robot));
}

#[test]
fn a_hanging_arm_at_rest_stays() {
    let hanging = [("x0[1]", -std::f64::consts::FRAC_PI_2), ("x0[2]", 0.0)];
    for parameters in [&hanging[..], &[&hanging, FRICTIONLESS].concat()] {
        let robot = simulated(parameters);
        let start = state(&robot);
        robot.run(0.0, 1000, 0.01);
        assert!((state(&robot) - start).amax() < 1e-12, "{:?}", state(&robot));
    }
}

/// Without a second link the first is a physical pendulum with a known frequency for small swings.
#[test]
fn with_nothing_at_its_end_the_first_link_is_a_pendulum() {
    let swing = 1e-3;
    let down = -std::f64::consts::FRAC_PI_2;
    let robot = simulated(
        &[FRICTIONLESS, &[("m2", 1e-12), ("I_z2", 1e-12), ("x0[1]", down + swing), ("x0[2]", -swing)]].concat(),
    );
    let [m, l, inertia] = LINKS[0];
    let omega = (m * G * l / 2.0 / (inertia + m * l * l / 4.0)).sqrt();
    for k in 0..1000 {
        robot.run(f64::from(k) * 0.01, 1, 0.01);
        let t = f64::from(k + 1) * 0.01;
        let error = robot.get("x[1]") - down - swing * (omega * t).cos();
        // A swing of 1e-3 rad is longer by 6e-8 of its period.
        assert!(error.abs() < 1e-5 * swing, "{error:e} rad at t = {t} s");
    }
}

/// d1, d2 and d3 at a time, by the numbers of the example.
fn variation(t: f64) -> [f64; 3] {
    [0.6 * (0.3 * t).sin(), 0.7 * (0.25 * t).sin(), (0.5 * (0.35 * t).sin()).abs()]
}

#[test]
fn the_inertia_varies_with_time_when_chosen() {
    let mut random = Random::new(4);
    let (constant, varying) = (Robot::new(&[]), Unit::exchange("TwoLinkRobot"));
    assert_eq!(set_boolean(&varying, "inertia_variation", true), OK);
    varying.begin();
    let varying = Robot(varying);
    for t in [0.5, 4.0, 9.0, 10.0, 20.0] {
        let q = Vector2::from(random.vector()) * 2.0;
        assert_eq!(varying.0.set_time(t), OK);
        let [d1, d2, d3] = variation(t);
        let difference = varying.inertia(q) - constant.inertia(q) - Matrix2::new(d1, d2, d2, d3);
        assert!(difference.amax() < 1e-9, "{difference} at t = {t} s");
        let det = varying.inertia(q).determinant();
        assert!((varying.0.get("det_M") - det).abs() < 1e-9 * det, "the determinant is shown");
    }
}

fn set_boolean(unit: &Unit, name: &str, value: bool) -> Status {
    let value = Boolean::from(value);
    unsafe { fmi2SetBoolean(unit.component, &unit.reference(name), 1, &value) }
}

/// A hanging arm (cos q2 = 1) with varying inertia, at rest.
fn varying(kind: i32) -> Unit {
    let text = format!(
        "{}\n[start]\ninertia_variation = true\nx0 = [{:?}, 0.0, 0.0, 0.0]\n",
        description("TwoLinkRobot"),
        -std::f64::consts::FRAC_PI_2
    );
    Unit::made(REGISTRY, &text, kind)
}

/// Time at which the determinant of the hanging arm's inertia matrix becomes zero: bisection between 53 s and 54 s.
fn singular_time() -> f64 {
    let robot = Robot::new(&[]);
    let constant = robot.inertia(Vector2::new(-std::f64::consts::FRAC_PI_2, 0.0));
    let determinant = |t| {
        let [d1, d2, d3] = variation(t);
        (constant + Matrix2::new(d1, d2, d2, d3)).determinant()
    };
    let (mut low, mut high) = (53.0, 54.0);
    assert!(determinant(low) > 0.0 && determinant(high) < 0.0);
    while high - low > 1e-12 {
        let middle = 0.5 * (low + high);
        if determinant(middle) > 0.0 { low = middle } else { high = middle }
    }
    low
}

#[test]
fn a_step_into_a_singular_inertia_matrix_is_an_error_with_its_time() {
    let (unit, singular) = (varying(CO_SIMULATION), singular_time());
    unit.start(0.0);
    let step = 0.1;
    let steps = (singular / step).floor();
    unit.run(0.0, steps as usize, step);
    let before = unit.values();
    assert_eq!(unit.step(steps * step, step), ERROR, "at t = {singular} s no motion follows");
    let message = unit.last_message();
    assert_mentions_determinant(&message, "", singular);
    assert_eq!(unit.values(), before, "as before the step");
}

/// Asserts that a message names the negative determinant, the allowed values, and this time.
fn assert_mentions_determinant(message: &str, part: &str, time: f64) {
    assert!(message.contains(&format!(": {part}det_M = -")) && message.contains("must be above 0"), "{message}");
    let reported =
        message.rsplit("t = ").next().and_then(|rest| rest.split(' ').next()).unwrap().parse::<f64>().unwrap();
    assert!((reported - time).abs() < 1e-6, "{message} names t = {time} s");
}

/// The same arm as the only part of a composite.
fn varying_part(kind: i32) -> Unit {
    let text = format!(
        "name = 'Whole'\nmodel = 'composite'\ndescription = ''\n[structure]\nparts = [{{ name = 'arm', model = \
         'two-link-robot', start = {{ inertia_variation = true, x0 = [{:?}, 0.0, 0.0, 0.0] }} }}]",
        -std::f64::consts::FRAC_PI_2
    );
    Unit::made(REGISTRY, &text, kind)
}

#[test]
fn in_a_composite_the_part_is_named_too() {
    let (unit, singular) = (varying_part(CO_SIMULATION), singular_time());
    unit.start(0.0);
    let steps = (singular / 0.1).floor();
    unit.run(0.0, steps as usize, 0.1);
    assert_eq!(unit.step(steps * 0.1, 0.1), ERROR);
    assert_mentions_determinant(&unit.last_message(), "arm.", singular);
    let solved = varying_part(MODEL_EXCHANGE);
    solved.begin();
    assert_eq!(solved.set_time(56.0), OK);
    assert_eq!(solved.try_derivatives(&mut [0.0; 4]), DISCARD);
    assert_mentions_determinant(&solved.last_message(), "arm.", 56.0);
}

#[test]
fn a_start_from_a_singular_inertia_matrix_is_refused() {
    let unit = varying(MODEL_EXCHANGE);
    unit.enter(56.0);
    assert_eq!(unit.exit(), ERROR);
    assert_mentions_determinant(&unit.last_message(), "", 56.0);
    let unit = varying(CO_SIMULATION);
    unit.start(56.0);
    assert_eq!(unit.step(56.0, 0.1), ERROR);
    assert_mentions_determinant(&unit.last_message(), "", 56.0);
}

#[test]
fn a_solver_gets_no_derivatives_of_a_singular_inertia_matrix() {
    let unit = varying(MODEL_EXCHANGE);
    unit.begin();
    assert_eq!(unit.set_time(56.0), OK);
    assert_eq!(unit.try_derivatives(&mut [0.0; 4]), DISCARD, "it may come back with a smaller step");
    let message = unit.last_message();
    assert!(message.contains("der(x[3])"), "the rate that is no number is named: {message}");
    assert_mentions_determinant(&message, "", 56.0);
    assert!(unit.get("det_M") < 0.0);
    let status = unsafe { fmi2CompletedIntegratorStep(unit.component, 1, &mut 0, &mut 0) };
    assert_eq!(status, ERROR, "a step that ends there");
    assert_mentions_determinant(&unit.last_message(), "", 56.0);
}

#[test]
fn bodies_without_length_or_inertia_are_refused() {
    for (name, value, allowed) in [("l1", 0.0, "above 0"), ("I_z2", 0.0, "above 0"), ("m1", -1.0, "at least 0")] {
        let unit = Unit::new("TwoLinkRobot");
        unit.put(name, value);
        unit.enter(0.0);
        assert_eq!(unit.exit(), ERROR);
        let message = unit.last_message();
        assert!(message.contains(&format!("{name} = {value}")) && message.contains(allowed), "{message}");
    }
}
