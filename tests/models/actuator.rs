//! The actuator: what each of its effects makes of a command, by numbers worked out by hand.

use adaptive_fmu_library::fmi2_functions::*;
use common::random::Random;
use common::{ERROR, OK, Unit, described};

/// The description of an actuator with these start values.
fn text(channels: usize, start: &str) -> String {
    format!(
        "name = \"A\"\nmodel = \"actuator\"\ndescription = \"\"\n[structure]\nchannels = {channels}\n\
         delay_samples = 50\n[start]\n{start}\n"
    )
}

/// An actuator of one channel that was at rest at u until t = 0.
fn at_rest(start: &str, u: f64) -> Unit {
    let unit = Unit::from_text(&text(1, start));
    unit.put("u[1]", u);
    unit.start(-0.1);
    unit.run(-0.1, 1, 0.1);
    unit
}

/// All effects simultaneously, in two channels.
const ALL: &str = "dead_zone = [0.1, 0.0]\ndelay = [0.007, 0.002]\nu_min = [-0.5, -1e15]\nu_max = [0.8, 0.6]\n\
                   rate_limit = [20.0, 1e15]\ntime_constant = [0.01, 0.02]\nrelative_tolerance = 1e-10";

/// The output for commands with a zero-order hold of a step each.
fn answers(unit: &Unit, commands: &[f64]) -> Vec<f64> {
    let steps = commands.iter().enumerate().map(|(k, &u)| {
        unit.put("u[1]", u);
        unit.run(k as f64 * 0.01, 1, 0.01);
        unit.get("y[1]")
    });
    steps.collect()
}

fn derivative_by_the_command(unit: &Unit) -> f64 {
    let (y, u) = (unit.reference("y[1]"), unit.reference("u[1]"));
    let mut change = f64::NAN;
    assert_eq!(unsafe { fmi2GetDirectionalDerivative(unit.component, &y, 1, &u, 1, &1.0, &mut change) }, OK);
    change
}

#[test]
fn a_gain_and_a_bias_act_behind_the_limits_and_at_once() {
    let unit = at_rest("u_min = [-1.0]\nu_max = [1.0]\ngain = [0.7]\nbias = [0.25]", 3.0);
    assert_eq!(unit.get("y[1]"), 0.7 + 0.25, "the limit is of what the drive gives");
    unit.put("gain[1]", -0.5);
    unit.put("bias[1]", 2.0);
    unit.run(0.0, 1, 0.01);
    assert_eq!(unit.get("y[1]"), 2.0 - 0.5, "while it runs");
    assert_eq!(derivative_by_the_command(&at_rest("gain = [0.7]\nbias = [5.0]", 0.1)), 0.7);
    // After a lag, the lagged value is lost immediately.
    let unit = at_rest("time_constant = [0.5]", 1.0);
    unit.put("u[1]", 0.0);
    unit.run(0.0, 1, 0.1);
    let before = unit.get("y[1]");
    unit.put("gain[1]", 0.5);
    unit.run(0.1, 1, 1e-9);
    assert!((unit.get("y[1]") - 0.5 * before).abs() < 1e-6 && before > 0.5, "{before}");
}

#[test]
fn an_actuator_without_limits_gives_what_is_commanded_to_the_bit() {
    let unit = at_rest("", 0.3);
    assert_eq!(unit.get("y[1]"), 0.3);
    let mut random = Random::new(1);
    for k in 0..1000 {
        let u = random.next() * 10.0_f64.powf(11.0 * random.next());
        unit.put("u[1]", u);
        unit.run(f64::from(k) * 0.01, 1, 0.01);
        assert_eq!(unit.get("y[1]").to_bits(), u.to_bits(), "u = {u}");
    }
    assert_eq!(derivative_by_the_command(&at_rest("", 0.0)), 1.0, "at rest too");
    assert_eq!(Unit::exchange_from_text(&text(1, "")).begin(), None, "no time event");
}

#[test]
fn a_command_in_the_dead_zone_does_nothing_and_one_beyond_acts_by_what_it_is_beyond() {
    let unit = at_rest("dead_zone = [0.25]", 0.0);
    let commands = [0.0, 0.2, 0.25, 0.5, 1.25, -0.2, -0.25, -0.75];
    assert_eq!(answers(&unit, &commands), [0.0, 0.0, 0.0, 0.25, 1.0, 0.0, 0.0, -0.5]);
    assert_eq!(derivative_by_the_command(&at_rest("dead_zone = [0.25]", 0.1)), 0.0);
    assert_eq!(derivative_by_the_command(&at_rest("dead_zone = [0.25]", 0.3)), 1.0);
}

#[test]
fn the_output_keeps_its_limits() {
    let unit = at_rest("u_min = [-0.5]\nu_max = [2.0]", 0.0);
    assert_eq!(answers(&unit, &[1.9, 2.0, 2.1, 1e9, -0.4, -0.6, -1e9]), [1.9, 2.0, 2.0, 2.0, -0.4, -0.5, -0.5]);
    assert_eq!(answers(&at_rest("u_min = [1.0]\nu_max = [2.0]", 0.0), &[0.0, 1.5, 3.0]), [1.0, 1.5, 2.0]);
}

#[test]
fn limits_act_on_what_the_dead_zone_leaves() {
    // The other way round it would be 1 - 0.25.
    assert_eq!(answers(&at_rest("dead_zone = [0.25]\nu_max = [1.0]", 0.0), &[1.5]), [1.0]);
}

#[test]
fn a_lag_follows_a_step_by_the_exponential() {
    let unit = at_rest("time_constant = [0.05]\nrelative_tolerance = 1e-10", 2.0);
    assert_eq!(unit.get("y[1]"), 2.0, "it starts at rest");
    unit.put("u[1]", 5.0);
    for k in 0..100 {
        unit.run(f64::from(k) * 0.01, 1, 0.01);
        let expected = 5.0 - 3.0 * (-f64::from(k + 1) * 0.01 / 0.05).exp();
        assert!((unit.get("y[1]") - expected).abs() < 1e-8, "{} is not {expected}", unit.get("y[1]"));
    }
}

/// A step from 0 to 1 (or to −1) with rate limit R and time constant T: the ramp ends at 1 − R T, where the lag is as
/// slow as the limit.
fn limited_step(t: f64, rate: f64, time_constant: f64) -> f64 {
    let end = 1.0 / rate - time_constant;
    if t < end { rate * t } else { 1.0 - rate * time_constant * (-(t - end) / time_constant).exp() }
}

#[test]
fn a_rate_limited_lag_ramps_and_then_settles_by_the_exponential() {
    for (u, step, steps) in [(1.0, 0.01, 100), (-1.0, 0.01, 100), (1.0, 0.25, 4), (-1.0, 1.0, 1)] {
        let unit = at_rest("rate_limit = [2.0]\ntime_constant = [0.1]\nrelative_tolerance = 1e-10", 0.0);
        unit.put("u[1]", u);
        for k in 1..=steps {
            unit.run(f64::from(k - 1) * step, 1, step);
            let expected = u * limited_step(f64::from(k) * step, 2.0, 0.1);
            assert!((unit.get("y[1]") - expected).abs() < 1e-8, "{} is not {expected}", unit.get("y[1]"));
        }
    }
}

#[test]
fn a_rate_limit_without_a_lag_settles_within_the_sample_time() {
    for (more, time_constant) in [("", 1e-3), ("\nsample_time = 0.02", 0.02)] {
        let unit = at_rest(&format!("rate_limit = [2.0]\nrelative_tolerance = 1e-10{more}"), 0.0);
        unit.put("u[1]", 1.0);
        for k in 1..=120 {
            unit.run(f64::from(k - 1) * 0.005, 1, 0.005);
            let expected = limited_step(f64::from(k) * 0.005, 2.0, time_constant);
            assert!((unit.get("y[1]") - expected).abs() < 1e-8, "{} is not {expected}", unit.get("y[1]"));
        }
    }
}

#[test]
fn a_delayed_command_comes_at_its_time() {
    let unit = at_rest("delay = [0.012]", -1.0);
    for (k, step) in [0.37e-3; 270].into_iter().enumerate() {
        let t = k as f64 * step;
        unit.put("u[1]", 3.0 * t - 1.0);
        assert_eq!(unit.set_slope("u[1]", 3.0), OK);
        unit.run(t, 1, step);
        let expected = 3.0 * (t + step - 0.012).max(0.0) - 1.0;
        assert!((unit.get("y[1]") - expected).abs() < 1e-12, "t = {}", t + step);
    }
}

#[test]
fn a_delayed_step_through_a_lag_is_the_steps_answer_delayed() {
    let unit = at_rest("delay = [0.02]\ntime_constant = [0.05]\nrelative_tolerance = 1e-10", 0.0);
    unit.put("u[1]", 1.0);
    for k in 0..30 {
        unit.run(f64::from(k) * 0.01, 1, 0.01);
        // The command comes in between the samples 0 and 1: as a ramp of 1 ms, by whose mean the lag is behind a step.
        let (t, h, rate) = (f64::from(k + 1) * 0.01 - 0.02, 1e-3, 1.0 / 0.05);
        let expected = if t < h { 0.0 } else { 1.0 - (-t * rate).exp() * ((h * rate).exp() - 1.0) / (h * rate) };
        assert!((unit.get("y[1]") - expected).abs() < 1e-8, "{} is not {expected}", unit.get("y[1]"));
    }
}

#[test]
fn whatever_is_commanded_the_output_keeps_its_limits_and_its_rate() {
    let unit = Unit::from_text(&text(2, ALL));
    unit.start(-0.1);
    unit.run(-0.1, 1, 0.1);
    let (mut random, mut before) = (Random::new(2), unit.get("y[1]"));
    let (mut lowest, mut highest, mut fastest) = (0.0_f64, 0.0_f64, 0.0_f64);
    for k in 0..5000 {
        if k % 50 == 0 {
            unit.put("u[1]", 3.0 * random.next());
            unit.put("u[2]", 3.0 * random.next());
        }
        unit.run(f64::from(k) * 1e-3, 1, 1e-3);
        let y = unit.get("y[1]");
        (lowest, highest) = (lowest.min(y), highest.max(y));
        fastest = fastest.max((y - before).abs() / 1e-3);
        assert!(unit.get("y[2]") <= 0.6 + 1e-9);
        before = y;
    }
    assert!((-0.5 - 1e-9..-0.45).contains(&lowest), "{lowest}");
    assert!((0.75..=0.8 + 1e-9).contains(&highest), "{highest}");
    assert!((19.9..=20.0 + 1e-6).contains(&fastest), "{fastest}");
}

#[test]
fn a_command_that_sweeps_across_everything_in_one_step_is_followed_all_the_same() {
    let all = "dead_zone = [0.1]\nu_min = [-0.6]\nu_max = [0.9]\nrate_limit = [15.0]\ntime_constant = [0.03]\n\
               relative_tolerance = 1e-10";
    let swept = |from: f64, slope: f64, steps: usize| {
        let (unit, step) = (at_rest(all, from), 0.05 / steps as f64);
        for k in 0..steps {
            unit.put("u[1]", from + slope * k as f64 * step);
            assert_eq!(unit.set_slope("u[1]", slope), OK);
            unit.run(k as f64 * step, 1, step);
        }
        unit.get("y[1]")
    };
    let mut random = Random::new(3);
    for from in [-1.12; 1].into_iter().chain((0..200).map(|_| 1.5 * random.next())) {
        let slope = -from.signum() * 50.0;
        let difference = (swept(from, slope, 1) - swept(from, slope, 500)).abs();
        assert!(difference < 1e-7, "from {from}: {difference}");
    }
}

#[test]
fn a_ramp_exactly_as_fast_as_the_rate_limit_is_followed_behind_it() {
    let unit = at_rest("rate_limit = [2.0]\ntime_constant = [0.125]", 0.0);
    for k in 0..1000 {
        unit.put("u[1]", 2.0 * f64::from(k) * 0.01);
        assert_eq!(unit.set_slope("u[1]", 2.0), OK);
        unit.run(f64::from(k) * 0.01, 1, 0.01);
    }
    assert!((unit.get("y[1]") - (20.0 - 2.0 * 0.125)).abs() < 1e-5, "{}", unit.get("y[1]"));
}

#[test]
fn a_restored_or_deserialised_actuator_goes_on_bit_for_bit() {
    let unit = Unit::from_text(&text(2, ALL));
    unit.start(0.0);
    let go_on = |unit: &Unit| {
        for k in 0..200 {
            let t = 0.0302 + f64::from(k) * 0.7e-3;
            unit.put("u[1]", (50.0 * t).sin());
            unit.put("u[2]", (50.0 * t).cos());
            unit.run(t, 1, 0.7e-3);
        }
        unit.fingerprint()
    };
    unit.put("u[1]", 0.4);
    // The state is saved between two samples.
    unit.run(0.0, 302, 1e-4);
    let (state, bytes) = (unit.save(), unit.fingerprint());
    let first = go_on(&unit);
    assert_eq!(unit.restore(state), OK);
    assert_eq!(go_on(&unit), first);
    let other = Unit::from_text(&text(2, ALL));
    other.start(0.0);
    let (status, state) = other.deserialise(&bytes);
    assert_eq!((status, other.restore(state)), (OK, OK));
    assert_eq!(go_on(&other), first);
}

#[test]
fn model_exchange_gives_what_co_simulation_gives() {
    let (slave, exchange) = (Unit::from_text(&text(2, ALL)), Unit::exchange_from_text(&text(2, ALL)));
    [&slave, &exchange].into_iter().for_each(|unit| unit.put("u[2]", 1.0));
    slave.start(0.0);
    let mut next = exchange.begin();
    for k in 0..60 {
        let t = f64::from(k) * 5e-3;
        for unit in [&slave, &exchange] {
            unit.put("u[1]", (30.0 * t).sin());
            unit.put("u[2]", (30.0 * t).cos());
        }
        slave.run(t, 1, 5e-3);
        next = exchange.integrate(t, f64::from(k + 1) * 5e-3, 1e-5, next);
        for name in ["y[1]", "y[2]"] {
            let difference = (slave.get(name) - exchange.get(name)).abs();
            assert!(difference < 1e-6, "{name} differs by {difference} at {t}");
        }
    }
}

#[test]
fn limits_tuned_while_running_hold_immediately_and_behind_a_lag_as_fast_as_possible() {
    let unit = at_rest("", 2.0);
    unit.put("u_max[1]", 1.0);
    unit.run(0.0, 1, 0.01);
    assert_eq!(unit.get("y[1]"), 1.0);
    let lagging = at_rest("time_constant = [0.1]\nrelative_tolerance = 1e-10", 2.0);
    lagging.put("u_max[1]", 1.0);
    lagging.run(0.0, 1, 0.1);
    assert!((lagging.get("y[1]") - (1.0 + (-1.0_f64).exp())).abs() < 1e-8);
}

#[test]
fn a_lag_or_rate_limit_that_is_switched_on_begins_where_the_output_is() {
    for (name, value) in [("time_constant[1]", 0.1), ("rate_limit[1]", 5.0)] {
        let unit = at_rest("u_max = [4.0]", 1.0);
        unit.put("u[1]", 9.0);
        unit.run(0.0, 1, 0.01);
        unit.put(name, value);
        unit.run(0.01, 1, 0.01);
        assert_eq!(unit.get("y[1]"), 4.0, "{name}");
    }
}

#[test]
fn channels_do_not_disturb_each_other() {
    let unit = Unit::from_text(&text(3, "dead_zone = [0.5, 0.0, 0.0]\nu_max = [1e15, 0.25, 1e15]"));
    unit.start(0.0);
    (1..=3).for_each(|i| unit.put(&format!("u[{i}]"), 0.75));
    unit.run(0.0, 1, 0.01);
    assert_eq!(["y[1]", "y[2]", "y[3]"].map(|name| unit.get(name)), [0.25, 0.25, 0.75]);
}

#[test]
fn what_makes_no_actuator_is_refused_with_what_is_allowed() {
    let refused = |start: &str, named: &[&str]| described::refused(&text(1, start), named);
    refused("u_min = [2.0]\nu_max = [1.0]", &["u_min[1] = 2", "below u_max[1] = 1"]);
    refused("dead_zone = [-0.1]", &["dead_zone[1] = -0.1", "at least 0"]);
    refused("rate_limit = [0.0]", &["rate_limit[1] = 0", "above 0 and at most 1e15"]);
    refused("time_constant = [-1.0]", &["time_constant[1] = -1", "at least 0"]);
    refused("delay = [0.051]", &["delay[1] = 0.051", "multiple of sample_time = 0.001", "0 … 0.05"]);
    let both = "u_min = [2.0]\nu_max = [1.0]\ndelay = [0.0005]";
    refused(both, &["u_min[1] = 2", "delay[1] = 0.0005"]);
    let unit = at_rest("", 1.0);
    unit.put("u_max[1]", -2e15);
    assert_eq!(unit.step(0.0, 0.01), ERROR);
    assert!(unit.last_message().contains("u_max[1] = -2e15"));
    unit.run(0.0, 1, 0.01);
    assert_eq!(unit.get("y[1]"), 1.0);
}
