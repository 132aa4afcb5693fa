//! The quadrotor moves as a rigid body does. Energy and momentum are counted here from rotation matrices: nothing of
//! the unit's kinematics is repeated.

use std::f64::consts::FRAC_PI_2;

use common::random::Random;
use common::{ERROR, OK, Unit};
use nalgebra::{Matrix3, Rotation3, SVector, Vector3, vector};

const M: f64 = 0.5;
const G: f64 = 9.81;
const INERTIA: [f64; 3] = [4.85e-3, 4.85e-3, 8.81e-3];
type State = SVector<f64, 12>;

/// A quadrotor whose accelerations can be asked for anywhere.
struct Quadrotor(Unit);

impl Quadrotor {
    fn new(switches: &[&str], parameters: &[(&str, f64)]) -> Self {
        let unit = Unit::exchange("Quadrotor");
        switches.iter().for_each(|name| assert_eq!(unit.set_boolean(name, true), OK));
        parameters.iter().for_each(|&(name, value)| unit.put(name, value));
        unit.begin();
        Quadrotor(unit)
    }

    /// The state's rate, where the disturbances are zero.
    fn rate(&self, x: &State, u: [f64; 4]) -> State {
        (0..4).for_each(|i| self.0.put(&format!("u[{}]", i + 1), u[i]));
        assert_eq!(self.0.set_states(&[&[0.0; 5], x.as_slice()].concat()), OK);
        State::from_column_slice(&self.0.derivatives()[5..])
    }
}

fn random_state(random: &mut Random) -> State {
    let mut x = State::from(random.vector()) * 2.0;
    // Away from a pitch of 90 degrees.
    x[7] *= 0.6;
    x
}

/// Position, velocity, angles and rates of angles.
fn part(x: &State, first: usize) -> Vector3<f64> {
    x.fixed_rows::<3>(first).into_owned()
}

fn rotation(angles: Vector3<f64>) -> Matrix3<f64> {
    let turn = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
    let turned = turn(Vector3::z_axis(), angles.z) * turn(Vector3::y_axis(), angles.y);
    (turned * turn(Vector3::x_axis(), angles.x)).into_inner()
}

/// A derivative along the direction in which the state changes: a central difference of order 4.
fn along<const N: usize>(x: &State, rate: &State, f: impl Fn(&State) -> SVector<f64, N>) -> SVector<f64, N> {
    let central = |h: f64| (f(&(x + rate * h)) - f(&(x - rate * h))) / (2.0 * h);
    (central(1e-4) * 4.0 - central(2e-4)) / 3.0
}

/// The body's rates in body axes, from the change of its rotation matrix.
fn body_rates(x: &State) -> Vector3<f64> {
    let (angles, rates) = (part(x, 6), part(x, 9));
    let central = |h: f64| (rotation(angles + rates * h) - rotation(angles - rates * h)) / (2.0 * h);
    let spin = rotation(angles).transpose() * (central(1e-3) * 4.0 - central(2e-3)) / 3.0;
    vector![spin[(2, 1)] - spin[(1, 2)], spin[(0, 2)] - spin[(2, 0)], spin[(1, 0)] - spin[(0, 1)]] / 2.0
}

fn energy(x: &State, inertia: [f64; 3]) -> SVector<f64, 1> {
    let omega = body_rates(x);
    let turning = omega.component_mul(&Vector3::from(inertia)).dot(&omega);
    vector![0.5 * (M * part(x, 3).norm_squared() + turning) + M * G * x[2]]
}

/// Angular momentum about the mass centre, in earth axes.
fn momentum(x: &State, inertia: [f64; 3]) -> Vector3<f64> {
    rotation(part(x, 6)) * body_rates(x).component_mul(&Vector3::from(inertia))
}

#[test]
fn with_exact_kinematics_energy_and_momentum_change_by_thrust_and_torques_alone() {
    let mut random = Random::new(1);
    // No two moments of inertia alike in the second.
    for inertia in [INERTIA, [0.3, 0.7, 0.9]] {
        let named = [("inertia[1]", inertia[0]), ("inertia[2]", inertia[1]), ("inertia[3]", inertia[2])];
        let quadrotor = Quadrotor::new(&["exact_kinematics"], &named);
        for _ in 0..100 {
            let x = random_state(&mut random);
            let (thrust, torque) = (7.0 + 7.0 * random.next(), Vector3::from(random.vector()) * inertia[0] * 5.0);
            let rate = quadrotor.rate(&x, [thrust, torque.x, torque.y, torque.z]);
            let turned = rotation(part(&x, 6));
            let supplied = thrust * turned.column(2).dot(&part(&x, 3)) + torque.dot(&body_rates(&x));
            let error = along(&x, &rate, |x| energy(x, inertia))[0] - supplied;
            assert!(error.abs() < 1e-7 * (1.0 + rate.norm_squared()), "{error:e} W at {x:?}");
            let error = along(&x, &rate, |x| momentum(x, inertia)) - turned * torque;
            assert!(error.norm() < 1e-7 * (1.0 + rate.norm_squared()), "{error} N m at {x:?}");
        }
    }
}

#[test]
fn a_level_quadrotor_whose_thrust_is_its_weight_hovers() {
    for switches in [&[][..], &["exact_kinematics"]] {
        let quadrotor = Quadrotor::new(switches, &[]);
        let mut x = State::zeros();
        // Anywhere, and whatever its heading is.
        (x[0], x[1], x[2], x[8]) = (3.0, -2.0, 5.0, 0.7);
        assert!(quadrotor.rate(&x, [M * G, 0.0, 0.0, 0.0]).amax() < 1e-14);
    }
}

#[test]
fn without_thrust_it_falls_freely() {
    let (mut random, quadrotor) = (Random::new(2), Quadrotor::new(&["uncertain"], &[]));
    for _ in 0..20 {
        let x = random_state(&mut random);
        let rate = quadrotor.rate(&x, [0.0, random.next(), random.next(), random.next()]);
        assert_eq!([rate[0], rate[1], rate[2]], [x[3], x[4], x[5]]);
        assert_eq!([rate[3], rate[4], rate[5]], [0.0, 0.0, -G]);
    }
}

/// A force from outside pushes the mass, whatever the attitude is, and turns nothing.
#[test]
fn a_force_from_outside_pushes_its_mass_in_earth_axes() {
    let mut random = Random::new(3);
    for switches in [&[][..], &["exact_kinematics"], &["uncertain"]] {
        for _ in 0..20 {
            let (x, force) = (random_state(&mut random), Vector3::from(random.vector()) * 5.0);
            let u = [6.0 + 5.0 * random.next(), random.next(), random.next(), random.next()];
            let name = |i: usize| format!("disturbance_force[{}]", i + 1);
            let names: [String; 3] = std::array::from_fn(name);
            let pushed: [(&str, f64); 3] = std::array::from_fn(|i| (names[i].as_str(), force[i]));
            let change = Quadrotor::new(switches, &pushed).rate(&x, u) - Quadrotor::new(switches, &[]).rate(&x, u);
            let mut expected = State::zeros();
            expected.fixed_rows_mut::<3>(3).copy_from(&(force / M));
            assert!((change - expected).amax() < 1e-12, "{change}");
        }
    }
}

/// Force and torque of four rotors that push at their places, some of them less than they are asked to.
#[test]
fn what_a_rotor_lacks_is_missing_of_thrust_and_torques() {
    let (mut random, inertia) = (Random::new(5), INERTIA);
    let effects = ["rotor_effect[1]", "rotor_effect[2]", "rotor_effect[3]", "rotor_effect[4]"];
    for _ in 0..50 {
        let (arm, drag) = (0.3 + 0.2 * random.next(), 0.05 + 0.04 * random.next());
        let effect: [f64; 4] = std::array::from_fn(|_| 0.5 + 0.5 * random.next());
        let asked: [f64; 4] = std::array::from_fn(|_| 1.5 + random.next());
        let places = [[arm, 0.0, 0.0], [0.0, arm, 0.0], [-arm, 0.0, 0.0], [0.0, -arm, 0.0]];
        let wrench = |pushes: [f64; 4]| {
            let mut wrench = [0.0; 4];
            for (i, push) in pushes.into_iter().enumerate() {
                let force = Vector3::new(0.0, 0.0, push);
                let about = if i % 2 == 0 { drag } else { -drag };
                let torque = Vector3::from(places[i]).cross(&force) + Vector3::new(0.0, 0.0, about * push);
                wrench[0] += push;
                (0..3).for_each(|k| wrench[k + 1] += torque[k]);
            }
            wrench
        };
        let mut set: Vec<(&str, f64)> = effects.into_iter().zip(effect).collect();
        set.extend([("arm_length", arm), ("drag_to_thrust", drag)]);
        // Level and at rest, where angles turn as the body does.
        let rate = Quadrotor::new(&[], &set).rate(&State::zeros(), wrench(asked));
        let left = wrench(std::array::from_fn(|i| effect[i] * asked[i]));
        assert!((rate[5] - (left[0] / M - G)).abs() < 1e-12, "{rate}");
        for k in 0..3 {
            assert!((rate[9 + k] - left[k + 1] / inertia[k]).abs() < 1e-9, "{rate}");
        }
    }
}

#[test]
fn thrust_acts_within_its_limits() {
    for (limits, thrust, acting) in [
        (&[][..], -5.0, 0.0),
        (&[], 7.0, 7.0),
        (&[], 20.0, 15.0),
        (&[("thrust_min", 1.0), ("thrust_max", 9.0)], 0.5, 1.0),
        (&[("thrust_min", 1.0), ("thrust_max", 9.0)], 10.0, 9.0),
    ] {
        let quadrotor = Quadrotor::new(&[], limits);
        let rate = quadrotor.rate(&State::zeros(), [thrust, 0.0, 0.0, 0.0]);
        assert!((rate[5] - (acting / M - G)).abs() < 1e-14, "{thrust} N act as {acting} N, not {}", rate[5]);
        assert_eq!(quadrotor.0.get("thrust"), acting);
    }
}

#[test]
fn limits_of_the_thrust_that_are_upside_down_are_refused() {
    let unit = Unit::new("Quadrotor");
    unit.put("thrust_min", 16.0);
    unit.enter(0.0);
    assert_eq!(unit.exit(), ERROR);
    let message = unit.last_message();
    assert!(message.contains("thrust_min = 16") && message.contains("thrust_max = 15"), "{message}");
}

/// Position after two seconds of climbing and turning.
fn flown(heading: f64, exact: bool) -> Vector3<f64> {
    let unit = Unit::new("Quadrotor");
    unit.put("relative_tolerance", 1e-10);
    unit.put("x0[9]", heading);
    // A start from which it moves along the heading.
    (0..2).for_each(|i| unit.put(&format!("x0[{}]", i + 4), [heading.cos(), heading.sin()][i]));
    assert_eq!(unit.set_boolean("exact_kinematics", exact), OK);
    unit.enter(0.0);
    [6.0, 2e-3, -3e-3, 4e-3].iter().enumerate().for_each(|(i, &u)| unit.put(&format!("u[{}]", i + 1), u));
    assert_eq!(unit.exit(), OK);
    unit.run(0.0, 20, 0.1);
    Vector3::from_fn(|i, _| unit.get(&format!("x[{}]", i + 1)))
}

#[test]
fn another_heading_turns_the_whole_flight() {
    for exact in [false, true] {
        let (straight, turned) = (flown(0.0, exact), flown(1.2, exact));
        assert!(straight.xy().norm() > 1.0);
        let expected = Rotation3::from_axis_angle(&Vector3::z_axis(), 1.2) * straight;
        assert!((turned - expected).amax() < 1e-7, "{turned} against {expected}");
    }
}

#[test]
fn an_uncertain_quadrotor_answers_its_torques_otherwise() {
    let (mut random, torque) = (Random::new(3), [0.01, -0.02, 0.03]);
    let [known, uncertain] = [&[][..], &["uncertain"]].map(|switches| Quadrotor::new(switches, &[]));
    for _ in 0..20 {
        let x = random_state(&mut random);
        let answer =
            |q: &Quadrotor| q.rate(&x, [5.0, torque[0], torque[1], torque[2]]) - q.rate(&x, [5.0, 0.0, 0.0, 0.0]);
        let ratio = part(&answer(&uncertain), 9).component_div(&part(&answer(&known), 9));
        assert!((ratio - vector![1.6, 0.7, 1.23]).amax() < 1e-10, "{ratio}");
    }
}

#[test]
fn exact_kinematics_end_with_an_error_at_a_pitch_of_90_degrees() {
    let started = |pitch: f64, exact: bool| {
        let unit = Unit::new("Quadrotor");
        let start = [("x0[7]", 0.0), ("x0[8]", pitch), ("x0[9]", 0.0), ("x0[11]", 1.0)];
        start.iter().for_each(|&(name, value)| unit.put(name, value));
        assert_eq!(unit.set_boolean("exact_kinematics", exact), OK);
        unit.enter(0.0);
        (unit.exit(), unit)
    };
    for pitch in [FRAC_PI_2, 2.0, -FRAC_PI_2] {
        assert_eq!(started(pitch, false).0, OK, "the printed equations know no such pitch");
        let (status, unit) = started(pitch, true);
        assert_eq!(status, ERROR);
        let message = unit.last_message();
        assert!(message.contains("x0[8] = ") && message.contains("90 degrees"), "{message}");
    }
    let (status, unit) = started(1.5, true);
    assert_eq!(status, OK);
    let before = unit.values();
    assert_eq!(unit.step(0.0, 0.2), ERROR);
    assert!(unit.last_message().contains("singular"));
    assert_eq!(unit.values(), before, "as before the step");
}
