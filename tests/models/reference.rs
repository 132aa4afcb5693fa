//! The reference signals: exact values and derivatives, however they are stepped, tuned or started.

use common::{ERROR, OK, Unit};

/// A general reference of one channel with these start values.
fn reference(start: &str) -> Unit {
    Unit::from_text(&format!(
        "name = \"Reference\"\nmodel = \"reference\"\ndescription = \"\"\n[structure]\nchannels = 1\n[start]\n{start}\n"
    ))
}

fn started(start: &str, time: f64) -> Unit {
    let unit = reference(start);
    unit.start(time);
    unit
}

/// r, dr and ddr at each of `count` communication points behind the start.
fn trace(unit: &Unit, from: f64, step: f64, count: usize) -> Vec<[f64; 3]> {
    let steps = (0..count).map(|k| {
        unit.run(from + k as f64 * step, 1, step);
        ["r[1]", "dr[1]", "ddr[1]"].map(|name| unit.get(name))
    });
    steps.collect()
}

/// The middle derivative of seven values at distance h, of order 6.
fn derivative(values: [f64; 7], h: f64) -> f64 {
    let weights = [-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0];
    weights.iter().zip(values).map(|(w, x)| w * x).sum::<f64>() / (60.0 * h)
}

const SMOOTH: [(&str, &str); 8] = [
    ("offset and ramp", "offset = [1.5]\nslope = [-0.7]"),
    ("cosine", "cosine_amplitude = [2.0]\ncosine_frequency = [1.3]\ncosine_phase = [0.4]"),
    ("sine", "sine_amplitude = [-0.6]\nsine_frequency = [0.65]\nsine_phase = [1.0]"),
    ("smooth start without curvature", "offset = [2.0]\nsmooth_start_rate = [0.9]\nsmooth_start_curvature = [0.0]"),
    ("smooth start with curvature", "offset = [2.0]\nsmooth_start_rate = [0.9]\nsmooth_start_curvature = [1.0]"),
    ("smooth start between", "slope = [0.3]\nsmooth_start_rate = [0.9]\nsmooth_start_curvature = [0.25]"),
    ("smooth start of a wave", "sine_amplitude = [0.3]\nsine_frequency = [1.1]\nsmooth_start_rate = [0.5]"),
    (
        "everything but jumps",
        "offset = [0.2]\nslope = [0.1]\ncosine_amplitude = [0.4]\ncosine_frequency = [0.8]\nsine_amplitude = [0.7]\n\
         sine_frequency = [0.3]\nsmooth_start_rate = [0.6]\nsmooth_start_curvature = [0.7]",
    ),
];

#[test]
fn derivatives_are_those_of_the_signal() {
    let h = 0.02;
    for (what, start) in SMOOTH {
        let unit = started(start, 0.0);
        for window in trace(&unit, 0.0, h, 500).windows(7) {
            let window: &[[f64; 3]; 7] = window.try_into().unwrap();
            let [_, dr, ddr] = window[3];
            // The difference's own error: h⁶/140 times a derivative of order 1, and rounding/h.
            assert!((derivative(window.map(|[r, _, _]| r), h) - dr).abs() < 1e-11, "{what}: dr = {dr}");
            assert!((derivative(window.map(|[_, dr, _]| dr), h) - ddr).abs() < 1e-11, "{what}: ddr = {ddr}");
        }
    }
}

#[test]
fn a_signal_that_jumps_has_the_derivatives_of_its_parts_between() {
    let jumps = "square_amplitude = [1.0]\nsquare_frequency = [0.5]\nstep_time = [[0.5, 1.5, 2.5, 3.5]]\n\
                 step_height = [[1.0, -2.0, 3.0, -4.0]]\nslope = [0.25]";
    let unit = started(jumps, 0.0);
    for [_, dr, ddr] in trace(&unit, 0.0, 0.1, 60) {
        assert_eq!([dr, ddr], [0.25, 0.0]);
    }
}

/// Start values, and the formula of r that the thesis' examples need.
type Printed = (&'static str, &'static str, fn(f64) -> f64);

fn quadrotor_start(t: f64) -> f64 {
    1.0 - (-0.5 * t).exp() * (1.0 + 0.5 * t)
}
fn twin_rotor_start(t: f64) -> f64 {
    1.0 - (-0.5 * t).exp() * (1.0 + 0.5 * t + 0.125 * t * t)
}
fn mares_start(t: f64) -> f64 {
    1.0 - (-0.4 * t).exp() * (1.0 + 0.4 * t + 0.08 * t * t)
}

const PRINTED: [Printed; 9] = [
    ("3.2.1", "cosine_amplitude = [2.0]\ncosine_frequency = [0.2]", |t| 2.0 * (0.2 * t).cos()),
    ("robot joint 2", "sine_amplitude = [-0.6]\nsine_frequency = [0.65]", |t| -0.6 * (0.65 * t).sin()),
    ("quadrotor y", "offset = [1.0]\ncosine_amplitude = [-1.0]\ncosine_frequency = [0.4]", |t| 1.0 - (0.4 * t).cos()),
    ("quadrotor z", "offset = [2.0]\nsmooth_start_rate = [0.5]\nsmooth_start_curvature = [0.0]", |t| {
        2.0 * quadrotor_start(t)
    }),
    ("TRMS pitch", "offset = [0.2]\nsine_amplitude = [0.1]\nsine_frequency = [0.3]\nsmooth_start_rate = [0.5]", |t| {
        twin_rotor_start(t) * (0.2 + 0.1 * (0.3 * t).sin())
    }),
    ("MARES N", "slope = [0.25]\nsmooth_start_rate = [0.4]", |t| 0.25 * t * mares_start(t)),
    ("MARES E", "sine_amplitude = [2.0]\nsine_frequency = [0.1]\nsmooth_start_rate = [0.4]", |t| {
        2.0 * (0.1 * t).sin() * mares_start(t)
    }),
    ("MARES D", "offset = [3.0]\nsmooth_start_rate = [0.4]", |t| 3.0 * mares_start(t)),
    (
        "7.5.1",
        "cosine_amplitude = [1.0]\ncosine_frequency = [0.5]\nstep_time = [[14.0, 35.0, 0.0, 0.0]]\n\
      step_height = [[1.0, -1.0, 0.0, 0.0]]",
        |t| (0.5 * t).cos() + if (14.0..35.0).contains(&t) { 1.0 } else { 0.0 },
    ),
];

#[test]
fn the_signals_of_the_thesis_are_those_printed() {
    for (what, start, formula) in PRINTED {
        for (step, count) in [(0.1, 400), (2.5, 16), (40.0, 1)] {
            let unit = started(start, 0.0);
            for (k, [r, ..]) in trace(&unit, 0.0, step, count).into_iter().enumerate() {
                let t = (k as f64 * step) + step;
                assert!((r - formula(t)).abs() < 1e-12, "{what} at t = {t}: {r} is not {}", formula(t));
            }
        }
    }
}

#[test]
fn a_smooth_start_begins_at_rest_and_ends_at_the_signal() {
    for (curvature, ddr) in [(0.0, 2.0 * 0.81), (1.0, 0.0)] {
        let unit =
            reference(&format!("offset = [2.0]\nsmooth_start_rate = [0.9]\nsmooth_start_curvature = [{curvature:?}]"));
        unit.start(0.0);
        assert_eq!([unit.get("r[1]"), unit.get("dr[1]")], [0.0; 2]);
        // With curvature 0 the second derivative starts at offset a².
        assert!((unit.get("ddr[1]") - ddr).abs() < 1e-15);
        unit.run(0.0, 1, 60.0);
        assert!((unit.get("r[1]") - 2.0).abs() < 1e-15 && unit.get("dr[1]").abs() < 1e-15);
    }
}

#[test]
fn a_reference_started_late_is_the_same_signal() {
    let all = "square_amplitude = [0.5]\nsquare_frequency = [0.23]\nstep_time = [[3.0, 13.0, 23.0, 33.0]]\n\
               step_height = [[1.0, 2.0, 4.0, 8.0]]\nsine_amplitude = [0.3]\nsine_frequency = [0.7]\n\
               smooth_start_rate = [0.4]";
    let whole = trace(&started(all, 0.0), 0.0, 0.5, 80);
    for first in [1, 6, 7, 26, 50, 79] {
        let start = first as f64 * 0.5;
        let late = started(all, start);
        let now = ["r[1]", "dr[1]", "ddr[1]"].map(|name| late.get(name));
        assert_eq!(now, whole[first - 1], "at its start, t = {start}");
        assert_eq!(trace(&late, start, 0.5, 80 - first), whole[first..], "from t = {start}");
    }
}

#[test]
fn a_reference_started_at_an_edge_or_before_zero_has_the_right_sign() {
    let square = "square_amplitude = [1.0]\nsquare_frequency = [0.23]";
    for k in [-3, -2, -1, 0, 1, 2, 23, 101] {
        let unit = started(square, f64::from(k) / 0.46);
        let expected = if k % 2 == 0 { 1.0 } else { -1.0 };
        assert_eq!(unit.get("r[1]"), expected, "from edge {k} on");
        unit.run(f64::from(k) / 0.46, 1, 0.5 / 0.46);
        assert_eq!(unit.get("r[1]"), expected);
        unit.run((f64::from(k) + 0.5) / 0.46, 1, 1.0 / 0.46);
        assert_eq!(unit.get("r[1]"), -expected);
    }
}

#[test]
fn the_phase_of_a_square_wave_shifts_its_edges() {
    // A quarter period early: the first edge at 1 s instead of 2 s.
    let unit = started("square_amplitude = [1.0]\nsquare_frequency = [0.25]\nsquare_phase = [1.5707963267948966]", 0.0);
    let signs: Vec<f64> = trace(&unit, 0.0, 0.75, 8).iter().map(|[r, ..]| *r).collect();
    // t = 0.75 | 1.5 2.25 | 3 … : edges at 1, 3, 5.
    assert_eq!(signs, [1.0, -1.0, -1.0, 1.0, 1.0, 1.0, -1.0, -1.0]);
}

#[test]
fn a_frequency_tuned_while_running_gives_the_signal_of_that_frequency() {
    let unit = started("cosine_amplitude = [1.0]\ncosine_frequency = [1.0]", 0.0);
    unit.run(0.0, 10, 0.3);
    unit.put("cosine_frequency[1]", 2.5);
    unit.run(3.0, 1, 0.3);
    assert!((unit.get("r[1]") - (2.5_f64 * 3.3).cos()).abs() < 1e-14);
    assert!((unit.get("dr[1]") + 2.5 * (2.5_f64 * 3.3).sin()).abs() < 1e-14);
}

#[test]
fn a_square_frequency_tuned_while_running_gives_the_wave_of_that_frequency() {
    let square = |t: f64, f: f64| if (2.0 * f * t).floor() % 2.0 == 0.0 { 1.0 } else { -1.0 };
    let unit = started("square_amplitude = [1.0]\nsquare_frequency = [0.23]", 0.0);
    let (mut t, step) = (0.0, 0.7731);
    // None of these has an edge at a communication point.
    for frequency in [0.23, 49.37, 0.011, 3.3, 0.0, 1e-6, 0.9] {
        unit.put("square_frequency[1]", frequency);
        for _ in 0..10 {
            unit.run(t, 1, step);
            t += step;
            assert_eq!(unit.get("r[1]"), square(t, frequency), "{frequency} Hz, t = {t}");
        }
    }
}

#[test]
fn a_frequency_with_too_many_edges_in_a_step_ends_in_an_error_and_not_in_a_hang() {
    let unit = started("square_amplitude = [1.0]\nsquare_frequency = [0.23]", 0.0);
    unit.put("square_frequency[1]", 1e12);
    let status = unit.step(0.0, 10.0);
    assert_eq!(status, ERROR);
    assert!(unit.last_message().contains("with all the work that work_limit allows"), "{}", unit.last_message());
}

#[test]
fn a_step_time_tuned_while_running_moves_the_step() {
    let unit = started("step_time = [[1.0, 2.0, 8.0, 9.0]]\nstep_height = [[1.0, 10.0, 100.0, 1000.0]]", 0.0);
    unit.run(0.0, 3, 1.0);
    assert_eq!(unit.get("r[1]"), 11.0);
    // One that was taken goes to the future, one from the future to the past.
    unit.put("step_time[1,1]", 5.5);
    unit.put("step_time[1,3]", 0.5);
    unit.run(3.0, 1, 1.0);
    assert_eq!(unit.get("r[1]"), 110.0);
    unit.run(4.0, 2, 1.0);
    assert_eq!(unit.get("r[1]"), 111.0, "and then comes at its new time");
    unit.run(6.0, 4, 1.0);
    assert_eq!(unit.get("r[1]"), 1111.0);
}

#[test]
fn two_steps_at_the_same_time_are_both_taken() {
    let unit = started("step_time = [[1.5, 1.5, 0.0, -1.0]]\nstep_height = [[1.0, 2.0, 4.0, 8.0]]", 0.0);
    assert_eq!(unit.get("r[1]"), 12.0, "those at and before the start");
    unit.run(0.0, 2, 1.0);
    assert_eq!(unit.get("r[1]"), 15.0);
}

#[test]
fn channels_do_not_disturb_each_other() {
    let unit = Unit::from_text(
        "name = \"R\"\nmodel = \"reference\"\ndescription = \"\"\n[structure]\nchannels = 3\n[start]\n\
         offset = [1.0, 2.0, 3.0]\nsquare_amplitude = [0.0, 1.0, 0.5]\nsquare_frequency = [1.0, 0.5, 0.25]\n\
         smooth_start_rate = [0.0, 0.0, 1.0]\n",
    );
    unit.start(0.0);
    unit.run(0.0, 5, 0.5);
    assert_eq!([unit.get("r[1]"), unit.get("r[2]")], [1.0, 3.0]);
    let s = 1.0 - (-2.5_f64).exp() * (1.0 + 2.5 + 3.125);
    assert!((unit.get("r[3]") - s * 2.5).abs() < 1e-15, "{}", unit.get("r[3]"));
}

#[test]
fn a_choice_of_signal_made_while_running_takes_effect_at_the_next_step() {
    let unit = Unit::started("ReferenceNonlinearSiso");
    unit.run(0.0, 3, 1.0);
    assert!((unit.get("r[1]") - 2.0 * 0.6_f64.cos()).abs() < 1e-15);
    assert_eq!(unit.set_integer("signal", 2), OK);
    assert!((unit.get("r[1]") - 2.0 * 0.6_f64.cos()).abs() < 1e-15, "not before");
    unit.run(3.0, 1, 1.0);
    // At 4 s one edge, 2.17 s, has passed.
    assert_eq!(unit.get("r[1]"), -1.0);
    assert_eq!([unit.get("dr[1]"), unit.get("ddr[1]")], [0.0; 2]);
}
