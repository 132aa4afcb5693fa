//! The underwater vehicle moves as a body in a perfect fluid with drag does: energy and momentum are counted here from
//! rotation matrices and the inertia matrix that it shows, which is checked by itself.

use std::f64::consts::FRAC_PI_2;

use common::random::Random;
use common::{ERROR, OK, Unit};
use nalgebra::{Matrix3, Matrix6, Rotation3, SVector, Vector3, Vector6, vector};

const WITHOUT_DRAG: &[(&str, f64)] = &[
    ("axial_drag", 0.0),
    ("cross_flow_drag", 0.0),
    ("roll_damping", 0.0),
    ("linear_damping[1]", 0.0),
    ("linear_damping[2]", 0.0),
    ("linear_damping[3]", 0.0),
    ("linear_damping[4]", 0.0),
    ("linear_damping[5]", 0.0),
    ("linear_damping[6]", 0.0),
];
/// Weight times height of the centre of buoyancy above the mass centre.
const RIGHTING: f64 = 32.0 * 9.81 * 0.0044;
/// η, then ν.
type State = SVector<f64, 12>;

/// A vehicle whose accelerations can be asked for anywhere.
struct Vehicle(Unit);

impl Vehicle {
    fn new(parameters: &[(&str, f64)]) -> Self {
        let unit = Unit::exchange("MaresAuv");
        parameters.iter().for_each(|&(name, value)| unit.put(name, value));
        unit.begin();
        Vehicle(unit)
    }

    fn rate(&self, x: &State, u: &Vector6<f64>) -> State {
        (0..6).for_each(|i| self.0.put(&format!("u[{}]", i + 1), u[i]));
        assert_eq!(self.0.set_states(x.as_slice()), OK);
        State::from_column_slice(&self.0.derivatives())
    }

    fn vector(&self, name: &str) -> Vector6<f64> {
        Vector6::from_fn(|i, _| self.0.get(&format!("{name}[{}]", i + 1)))
    }

    fn inertia(&self) -> Matrix6<f64> {
        Matrix6::from_fn(|i, j| self.0.get(&format!("M[{},{}]", i + 1, j + 1)))
    }
}

fn random_state(random: &mut Random) -> State {
    let mut x = State::from(random.vector()) * 2.0;
    // Away from a pitch of 90 degrees.
    x[4] *= 0.6;
    x
}

fn part(x: &State, first: usize) -> Vector3<f64> {
    x.fixed_rows::<3>(first).into_owned()
}

fn velocities(x: &State) -> Vector6<f64> {
    x.fixed_rows::<6>(6).into_owned()
}

fn rotation(x: &State) -> Matrix3<f64> {
    let turn = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
    let turned = turn(Vector3::z_axis(), x[5]) * turn(Vector3::y_axis(), x[4]);
    (turned * turn(Vector3::x_axis(), x[3])).into_inner()
}

/// A derivative along the direction in which the state changes: a central difference of order 4.
fn along<const N: usize>(x: &State, rate: &State, f: impl Fn(&State) -> SVector<f64, N>) -> SVector<f64, N> {
    let central = |h: f64| (f(&(x + rate * h)) - f(&(x - rate * h))) / (2.0 * h);
    (central(1e-4) * 4.0 - central(2e-4)) / 3.0
}

#[test]
fn the_pose_changes_by_the_velocities_in_body_axes() {
    let (mut random, vehicle) = (Random::new(1), Vehicle::new(&[]));
    for _ in 0..50 {
        let x = random_state(&mut random);
        let rate = vehicle.rate(&x, &Vector6::zeros());
        assert!((part(&rate, 0) - rotation(&x) * part(&x, 6)).norm() < 1e-13);
        // The change of the rotation matrix is the spin in body axes.
        let columns = |x: &State| SVector::<f64, 9>::from_column_slice(rotation(x).as_slice());
        let change = along(&x, &rate, columns);
        let expected = rotation(&x) * part(&x, 9).cross_matrix();
        assert!((change - SVector::<f64, 9>::from_column_slice(expected.as_slice())).norm() < 1e-8);
    }
}

#[test]
fn energy_changes_by_the_power_of_forces_and_damping() {
    let mut random = Random::new(2);
    for drag in [&[][..], WITHOUT_DRAG] {
        let vehicle = Vehicle::new(drag);
        let (inertia, linear, quadratic) =
            (vehicle.inertia(), vehicle.vector("linear_damping"), vehicle.vector("quadratic_damping"));
        for _ in 0..100 {
            let (x, u) = (random_state(&mut random), Vector6::from(random.vector()) * 30.0);
            let (rate, nu) = (vehicle.rate(&x, &u), velocities(&x));
            // The mass centre hangs below the centre of buoyancy, about which all else is counted.
            let energy = |x: &State| {
                vector![0.5 * velocities(x).dot(&(inertia * velocities(x))) - RIGHTING * rotation(x)[(2, 2)]]
            };
            let lost: f64 = (0..6).map(|i| (linear[i] + quadratic[i] * nu[i].abs()) * nu[i] * nu[i]).sum();
            let supplied = rate.fixed_rows::<6>(0).dot(&u) - lost;
            let error = along(&x, &rate, energy)[0] - supplied;
            assert!(error.abs() < 1e-7 * (1.0 + rate.norm_squared()), "{error:e} W at {x:?}");
        }
    }
}

/// Coriolis forces do no work: only the other forces change momentum and angular momentum about a fixed point, in earth
/// axes.
#[test]
fn without_drag_momentum_changes_by_the_forces_alone() {
    let (mut random, vehicle) = (Random::new(3), Vehicle::new(WITHOUT_DRAG));
    let inertia = vehicle.inertia();
    for _ in 0..100 {
        let (x, force) = (random_state(&mut random), Vector3::from(random.vector()) * 30.0);
        let u = vector![force.x, force.y, force.z, 0.0, 0.0, 0.0];
        let rate = vehicle.rate(&x, &u);
        let momenta = |x: &State| {
            let (momentum, turned) = (inertia * velocities(x), rotation(x));
            let linear = turned * momentum.fixed_rows::<3>(0);
            let angular = turned * momentum.fixed_rows::<3>(3) + part(x, 0).cross(&linear);
            Vector6::from_iterator(linear.iter().chain(angular.iter()).copied())
        };
        // Weight and buoyancy: a couple about the mass centre, which hangs along the body's z axis.
        let arm = rotation(&x).column(2) * RIGHTING;
        let moment = part(&x, 0).cross(&force) + arm.cross(&Vector3::z());
        let expected = Vector6::from_iterator(force.iter().chain(moment.iter()).copied());
        let error = (along(&x, &rate, momenta) - expected).norm();
        assert!(error < 1e-7 * (1.0 + rate.norm_squared()), "{error:e} at {x:?}");
    }
}

/// A current is not felt by a vehicle that drifts with it: velocities relative to the water change as in water at rest,
/// positions also by the current.
#[test]
fn in_water_that_moves_evenly_it_moves_as_in_water_at_rest() {
    let (mut random, still) = (Random::new(4), Vehicle::new(&[]));
    for _ in 0..30 {
        let (x, u) = (random_state(&mut random), Vector6::from(random.vector()) * 30.0);
        let current = Vector3::from(random.vector());
        let name = |i: usize| format!("current[{}]", i + 1);
        let names: [String; 3] = std::array::from_fn(name);
        let parameters: [(&str, f64); 3] = std::array::from_fn(|i| (names[i].as_str(), current[i]));
        let moving = Vehicle::new(&parameters);
        let mut carried = x;
        carried.fixed_rows_mut::<3>(6).copy_from(&(part(&x, 6) + rotation(&x).transpose() * current));
        let (at_rest, rate) = (still.rate(&x, &u), moving.rate(&carried, &u));
        let in_earth = |x: &State| rotation(x) * part(x, 6);
        let (expected, found) = (along(&x, &at_rest, in_earth), along(&carried, &rate, in_earth));
        assert!((found - expected).norm() < 1e-7 * (1.0 + rate.norm_squared()), "{found} for {expected}");
        assert!((part(&rate, 9) - part(&at_rest, 9)).norm() < 1e-10 * (1.0 + at_rest.norm()));
        assert!((part(&rate, 0) - part(&at_rest, 0) - current).norm() < 1e-12);
        assert!((part(&rate, 3) - part(&at_rest, 3)).norm() < 1e-12);
    }
}

#[test]
fn the_inertia_matrix_is_symmetric_positive_definite_and_that_of_the_motion() {
    let vehicle = Vehicle::new(&[]);
    let inertia = vehicle.inertia();
    assert_eq!(inertia, inertia.transpose());
    assert!(inertia.symmetric_eigenvalues().min() > 0.0);
    // Level and at rest, unit forces in earth axes are unit forces in body axes.
    let answer = |i: usize| velocities(&vehicle.rate(&State::zeros(), &Vector6::ith(i, 1.0)));
    for i in 0..6 {
        assert!((inertia * answer(i) - Vector6::ith(i, 1.0)).amax() < 1e-13);
    }
    // A mass centre below the origin couples surge with pitch and sway with roll.
    assert!((inertia[(0, 4)] - 32.0 * 0.0044).abs() < 1e-15 && (inertia[(1, 3)] + 32.0 * 0.0044).abs() < 1e-15);
}

/// Simpson's rule on [0, 1].
fn integral(f: impl Fn(f64) -> f64) -> f64 {
    let n = 200_000;
    let weight = |k: i32| if k == 0 || k == n { 1.0 } else { f64::from(2 + 2 * (k % 2)) };
    (0..=n).map(|k| weight(k) * f(f64::from(k) / f64::from(n))).sum::<f64>() / f64::from(3 * n)
}

/// Integrals of potential theory, with a² + λ = a²/w²:
/// α = a b² ∫ dλ / ((a² + λ)^(3/2) (b² + λ)), β = a b² ∫ dλ / ((a² + λ)^(1/2) (b² + λ)²), λ from 0 to ∞.
#[test]
fn added_mass_is_that_of_a_spheroid_in_a_perfect_fluid() {
    for fineness in [1.01, 1.5, 3.0, 7.5, 12.0] {
        let vehicle = Vehicle::new(&[("length", 0.2 * fineness), ("diameter", 0.2)]);
        let (a, b) = (0.1 * fineness, 0.1);
        let inner = |w: f64| a * a - (a * a - b * b) * w * w;
        let alpha = 2.0 * b * b * integral(|w| w * w / inner(w));
        let beta = 2.0 * a * a * b * b * integral(|w| (w / inner(w)).powi(2));
        let water = 1025.0 * 4.0 / 3.0 * std::f64::consts::PI * a * b * b;
        let by_turning = (b * b - a * a).powi(2) * (alpha - beta);
        let turning = by_turning / (2.0 * (b * b - a * a) + (b * b + a * a) * (beta - alpha)) * water / 5.0;
        let (along, across) = (water * alpha / (2.0 - alpha), water * beta / (2.0 - beta));
        let roll = 0.05 * vehicle.0.get("inertia[1]");
        let expected = vector![along, across, across, roll, turning, turning];
        let error = vehicle.vector("added_mass") - expected;
        assert!(error.component_div(&expected).amax() < 1e-9, "{error} at a/b = {fineness}");
    }
}

#[test]
fn level_at_rest_it_stays_and_tilted_it_rights_itself() {
    let vehicle = Vehicle::new(&[]);
    let mut x = State::zeros();
    (x[0], x[1], x[2], x[5]) = (1.0, -2.0, 3.0, 0.7);
    assert_eq!(vehicle.rate(&x, &Vector6::zeros()).amax(), 0.0);
    (x[3], x[4]) = (0.1, -0.2);
    let rate = vehicle.rate(&x, &Vector6::zeros());
    assert!(rate[9] < 0.0 && rate[10] > 0.0, "{rate}");
}

#[test]
fn a_constant_force_ahead_drives_it_until_drag_balances_the_force() {
    // Where the righting couple is too weak to hold it on its course, none at all leaves it there.
    for (force, z_g) in [(0.2, 0.0044), (10.0, 0.0)] {
        let unit = Unit::new("MaresAuv");
        unit.put("z_g", z_g);
        unit.enter(0.0);
        unit.put("u[1]", force);
        assert_eq!(unit.exit(), OK);
        unit.run(0.0, 1200, 0.5);
        let speed = unit.get("x[7]");
        let frontal_area = std::f64::consts::PI * 0.01;
        let drag = 1.0 * speed + 0.5 * 1025.0 * 0.2 * frontal_area * speed * speed;
        assert!((drag / force - 1.0).abs() < 1e-4, "{drag} N at {speed} m/s against {force} N");
    }
}

#[test]
fn it_starts_with_the_rates_that_it_was_given() {
    let unit = Unit::new("MaresAuv");
    let start: [f64; 12] = [1.0, 2.0, 3.0, 0.5, -1.1, 2.0, 0.3, -0.4, 0.5, 0.1, -0.2, 0.3];
    start.iter().enumerate().for_each(|(i, &value)| unit.put(&format!("x0[{}]", i + 1), value));
    unit.start(0.0);
    for (i, value) in start.iter().enumerate() {
        assert!((unit.get(&format!("x[{}]", i + 1)) - value).abs() < 1e-14);
    }
    assert!((unit.get("nu[2]") + 0.4).abs() > 0.1, "velocities in body axes are others");
}

#[test]
fn at_a_pitch_of_90_degrees_it_ends_with_an_error() {
    let started = |pitch: f64| {
        let unit = Unit::new("MaresAuv");
        unit.put("x0[5]", pitch);
        unit.enter(0.0);
        unit.put("u[5]", 20.0);
        (unit.exit(), unit)
    };
    for pitch in [FRAC_PI_2, -FRAC_PI_2, 2.0] {
        let (status, unit) = started(pitch);
        assert_eq!(status, ERROR);
        let message = unit.last_message();
        assert!(message.contains("x0[5] = ") && message.contains("90 degrees"), "{message}");
    }
    let (status, unit) = started(1.5);
    assert_eq!(status, OK);
    let before = unit.values();
    assert_eq!(unit.step(0.0, 1.0), ERROR);
    assert!(unit.last_message().contains("singular"));
    assert_eq!(unit.values(), before, "as before the step");

    let exchange = Unit::exchange("MaresAuv");
    exchange.begin();
    let mut x = [0.0; 12];
    x[4] = FRAC_PI_2;
    assert_eq!(exchange.set_states(&x), OK);
    assert_ne!(exchange.try_derivatives(&mut [0.0; 12]), OK, "no numbers for a solver either");
    assert_ne!(exchange.try_get("x[10]", &mut 0.0), OK);
}

#[test]
fn a_body_that_cannot_be_is_refused() {
    for (name, value, named) in [
        ("length", 0.2, "1.001 times the diameter"),
        ("length", 0.1, "1.001 times the diameter"),
        ("diameter", 0.0, "above 0"),
        ("m", -1.0, "above 0"),
        ("z_g", 0.5, "not positive definite"),
        ("axial_drag", -0.1, "at least 0"),
    ] {
        let unit = Unit::new("MaresAuv");
        unit.put(name, value);
        unit.enter(0.0);
        assert_eq!(unit.exit(), ERROR, "{name} = {value}");
        let message = unit.last_message();
        assert!(message.contains(&format!("{name} = {value}")) && message.contains(named), "{message}");
    }
}

#[test]
fn what_its_page_states_on_size_weight_and_inertia_is_true() {
    let page = include_str!("../../docs/plants/mares_auv.md").split_whitespace().collect::<Vec<_>>().join(" ");
    for text in
        ["$b$ = `diameter`/2", "\\tfrac43 \\pi \\rho\\, a b^2$", "no term $m z_g^2$", "a larger hull is not lifted"]
    {
        assert!(page.contains(text), "{text}");
    }
    // Without drag and at rest, a hull of another size and density of the water is turned by the same couple, and not lifted.
    let pose = State::from_fn(|i, _| if i == 3 { 0.4 } else { 0.0 });
    let moment = |vehicle: &Vehicle| {
        let rate = vehicle.rate(&pose, &Vector6::zeros());
        vehicle.inertia() * rate.fixed_rows::<6>(6)
    };
    let (own, other) = (
        moment(&Vehicle::new(WITHOUT_DRAG)),
        moment(&Vehicle::new(&[WITHOUT_DRAG, &[("diameter", 0.5), ("length", 3.0), ("rho", 500.0)]].concat())),
    );
    assert!((own - other).norm() < 1e-12 && (own[3] + RIGHTING * 0.4_f64.sin()).abs() < 1e-12, "{own}{other}");
    assert!(own.fixed_rows::<3>(0).norm() < 1e-12, "{own}");
    // The moments of inertia don't grow with z_g, and a sphere's added mass is half of the water that it displaces.
    let low = Vehicle::new(&[("z_g", 0.02)]).inertia();
    let (m, a, b) = (32.0, 0.75_f64, 0.1_f64);
    let added = Vehicle::new(&[]).vector("added_mass");
    assert!((low[(3, 3)] - added[3] - 0.4 * m * b * b).abs() < 1e-12, "{low}");
    assert!((low[(4, 4)] - added[4] - 0.2 * m * (a * a + b * b)).abs() < 1e-12, "{low}");
    let round = Vehicle::new(&[("length", 0.2 * 1.0011)]).vector("added_mass");
    let water = 4.0 / 3.0 * std::f64::consts::PI * 1025.0 * 0.1_f64.powi(3);
    assert!((round[0] / (0.5 * water) - 1.0).abs() < 2e-3, "{round}");
}
