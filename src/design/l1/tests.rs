//! Designs whose numbers are known: found a second time by another program from the same rules.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{Complex, DMatrix};

use super::assess::Found;
use super::closed::Law;
use super::design::{Asked, Design, design};
use super::desired::{Desired, bessel};
use super::lambda::lambda;
use crate::design::nominal::poles_of;
use crate::design::robustness::bounds::Bounds;
use crate::design::robustness::linear::LinearLaw;
use crate::design::robustness::uncertain::Uncertain;
use crate::nominal::Uncertainty;
use crate::template::Plant;

/// A plant of examples/zoo, with its bandwidth and reference.
macro_rules! zoo {
    ($name:literal) => {
        Plant::parse(include_str!(concat!("../../../examples/zoo/", $name, ".json"))).unwrap()
    };
}

fn of(plant: &Plant, bandwidth: f64, reference: f64, adapts: bool) -> Design {
    let asked =
        Asked { bandwidth, references: &[reference], uncertainty: &Uncertainty::Part(0.2), adapts, varies: [1.0, 1.0] };
    design(plant, &asked).unwrap()
}

fn assert_near(what: &str, found: f64, expected: f64, relative: f64) {
    assert!((found - expected).abs() <= relative * expected.abs(), "{what}: {found} for {expected}");
}

/// Step, K/W, λ*, the shares that are proved and stable, the steady-state error of 95 % of the plants.
#[test]
fn plants_of_textbooks_have_the_known_filters_steps_and_proofs() {
    for (name, plant, W, R, [step, gain, of_lambda, proved, stable, rest]) in [
        ("dc_motor", zoo!("dc_motor"), 40.0, 100.0, [5e-4, 2.0, 0.759, 0.20, 0.9, 0.010]),
        ("two_mass", zoo!("two_mass"), 5.0, 10.0, [5e-4, 40.0, 1.62, 0.10, 0.26, 2.4]),
        ("boost", zoo!("boost"), 20.0, 2.0, [1e-4, 20.0, 1.26, 0.13, 0.28, 1.0]),
        ("cart_pendulum", zoo!("cart_pendulum"), 1.0, 0.5, [0.01, 5.0, 6.85, 0.023, 0.29, 0.0]),
        ("hydraulic_cylinder", zoo!("hydraulic_cylinder"), 3.0, 0.05, [5e-4, 40.0, 0.807, 0.197, 0.76, 0.0]),
        ("heated_room", zoo!("heated_room"), 0.003, 5.0, [5.0, 2.0, 0.332, 0.43, 0.9, 0.0]),
        ("quad_tank", zoo!("quad_tank"), 0.02, 0.02, [1.0, 2.0, 1.40, 0.115, 0.16, 0.31]),
        ("cstr", zoo!("cstr"), 0.1, 3.0, [0.2, 2.0, 0.478, 0.31, 0.67, 0.0]),
        ("pmsm_currents", zoo!("pmsm_currents"), 1000.0, 5.0, [2e-5, 2.0, 0.228, 0.52, 0.9, 0.0]),
        ("first_order", zoo!("first_order"), 3.0, 1.0, [0.005, 2.0, 0.114, 0.77, 0.9, 0.0]),
        ("satellite", zoo!("satellite"), 0.05, 0.5, [0.2, 2.0, 0.283, 0.45, 0.87, 0.0]),
        ("heat_chain", zoo!("heat_chain"), 0.02, 10.0, [1.0, 2.0, 0.200, 0.77, 0.9, 0.56]),
    ] {
        let found = of(&plant, W, R, false);
        assert_eq!((found.step, found.feedback_gain / W), (step, gain), "{name}");
        assert_near(name, found.found.lambda.unwrap(), of_lambda, 5e-3);
        // Shares were found among other plants, in steps of a few percent.
        assert_near(name, 0.2 * found.found.proved.unwrap(), proved, 0.1);
        assert_near(name, 0.2 * found.found.stable, stable, 0.03);
        assert!((found.found.off_at_rest - rest).abs() <= 0.15 * rest + 0.005, "{name}: {}", found.found.off_at_rest);
        assert_eq!(found.found.is_stable, name != "quad_tank", "{name}");
    }
}

/// λ*, K/W where the bound of the adaptation cuts it, and Γ where the first one is fast enough.
#[test]
fn a_law_that_adapts_has_the_known_proofs_bounds_and_gains() {
    for (name, plant, W, R, of_lambda, gain, adaptation) in [
        ("dc_motor", zoo!("dc_motor"), 40.0, 100.0, Some(0.785), 2.0, None),
        ("two_mass", zoo!("two_mass"), 5.0, 10.0, None, 1.66, None),
        ("boost", zoo!("boost"), 20.0, 2.0, Some(1.27), 20.0, None),
        ("heated_room", zoo!("heated_room"), 0.003, 5.0, None, 2.0, Some(1.15e7)),
        ("cstr", zoo!("cstr"), 0.1, 3.0, Some(0.516), 2.0, None),
        ("pmsm_currents", zoo!("pmsm_currents"), 1000.0, 5.0, Some(0.228), 2.0, None),
        ("satellite", zoo!("satellite"), 0.05, 0.5, Some(0.283), 2.0, None),
        ("heat_chain", zoo!("heat_chain"), 0.02, 10.0, Some(0.375), 2.0, Some(3.1e6)),
    ] {
        let found = of(&plant, W, R, true);
        assert_near(name, found.feedback_gain / W, gain, 0.01);
        if let Some(of_lambda) = of_lambda {
            assert_near(name, found.found.lambda.unwrap(), of_lambda, 0.01);
        }
        if let Some(adaptation) = adaptation {
            assert_near(name, found.adaptation_gain, adaptation, 0.03);
        }
        assert!(found.theta_bound.iter().all(|&bound| bound >= 0.0), "{name}");
    }
}

/// A plant in pascals and metres is the one in bar and millimetres.
#[test]
fn units_of_states_change_nothing_but_numbers() {
    let plant = zoo!("hydraulic_cylinder");
    let scales = DMatrix::from_diagonal(&nalgebra::DVector::from_vec(vec![1e3, 1e3, 1e-5]));
    let inverse = scales.clone().try_inverse().unwrap();
    let mut other = plant.clone();
    other.A = &scales * &plant.A * &inverse;
    other.B = &scales * &plant.B;
    other.C = &plant.C * &inverse;
    let (one, other) = (of(&plant, 3.0, 0.05, false), of(&other, 3.0, 0.05, false));
    assert_eq!((one.step, one.feedback_gain), (other.step, other.feedback_gain));
    assert_near("lambda", other.found.lambda.unwrap(), one.found.lambda.unwrap(), 1e-6);
    // Bounds are of what a control has to do.
    assert_near("theta", other.theta_bound[(0, 2)], one.theta_bound[(0, 2)], 0.01);
    assert_near("pressure", other.peaks[2], 1e-5 * one.peaks[2], 0.01);
}

#[test]
fn poles_of_a_bessel_filter_are_the_known_ones() {
    let of_order = |order| {
        let mut roots = bessel(order);
        roots.retain(|root: &Complex<f64>| root.im >= 0.0);
        roots.sort_by(|a, b| a.re.total_cmp(&b.re));
        roots.iter().flat_map(|root| [root.re, root.im]).map(|part| (part * 1e3).round() / 1e3).collect::<Vec<_>>()
    };
    assert_eq!(of_order(1), [-1.0, 0.0]);
    assert_eq!(of_order(2), [-0.866, 0.5]);
    assert_eq!(of_order(3), [-0.942, 0.0, -0.746, 0.711]);
    assert_eq!(of_order(4), [-0.905, 0.271, -0.657, 0.83]);
}

/// Without what the control does to rows that it doesn't enter, λ* would prove what is unstable.
#[test]
fn what_the_control_does_to_other_rows_counts() {
    let matrix = |rows, columns, entries: &[f64]| DMatrix::from_row_slice(rows, columns, entries);
    let (A, B, C) = (matrix(2, 2, &[-1.0, 1.0, 0.0, -1.0]), matrix(2, 1, &[1.0, 0.0]), matrix(1, 2, &[1.0, 0.0]));
    let bounds = Bounds::of_elements(matrix(2, 2, &[5.0, 0.0, 0.0, 0.0]), matrix(2, 1, &[0.0, 0.3]));
    let plant = Uncertain::new([&A, &B, &C], &bounds, &[0.0], 1.0).unwrap();
    let K_m = DMatrix::zeros(1, 2);
    let law = Law::limit(&plant, &K_m, &plant.A, &matrix(1, 1, &[1000.0])).unwrap();
    assert_near("lambda*", lambda(&plant, &law, &plant.bounds.A).unwrap(), 1.23, 5e-3);
    let parts = law.parts();
    let is_stable = |a: f64, b: f64| {
        let (A_t, B_t) = (&A + matrix(2, 2, &[a, 0.0, 0.0, 0.0]), &B + matrix(2, 1, &[0.0, b]));
        poles_of(&parts.closed(&A_t, &B_t)).unwrap().iter().all(|pole| pole.re < 0.0)
    };
    let unstable = [(5.0, 0.3), (5.0, -0.3), (-5.0, 0.3), (-5.0, -0.3)].into_iter().filter(|&(a, b)| !is_stable(a, b));
    assert_eq!(unstable.count(), 2);
}

#[test]
fn rows_of_kinematics_are_certain() {
    let plant = zoo!("satellite");
    let bounds = Bounds::by_part(&plant.A, &plant.B, 0.2);
    assert_eq!((bounds.A.amax(), bounds.B[(0, 0)]), (0.0, 0.0));
    assert_near("torque", bounds.B[(1, 0)], 0.2 * plant.B[(1, 0)], 1e-12);
}

#[test]
fn a_plant_that_moves_as_desired_is_left_alone() {
    let plant = Plant::parse(r#"{"A": [[-3, 0.5], [0.2, -4]], "B": [[1, 0], [0, 1]], "C": [[1, 0], [0, 1]]}"#).unwrap();
    let found = of(&plant, 2.0, 1.0, true);
    assert!(matches!(found.desired, Desired::Own) && found.A_m == plant.A, "{:?}", found.desired);
    let Found { is_stable, lambda, .. } = found.found;
    assert!(is_stable && lambda.unwrap() < 0.8);
}
