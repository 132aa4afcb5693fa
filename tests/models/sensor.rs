//! The sensor: what each of its effects makes of what is measured, and noise that is the same whoever steps it.

use adaptive_fmu_library::fmi2_functions::*;
use common::random::Random;
use common::{OK, Unit, described};

/// The description of a sensor with these start values.
fn text(channels: usize, start: &str) -> String {
    format!(
        "name = \"S\"\nmodel = \"sensor\"\ndescription = \"\"\n[structure]\nchannels = {channels}\n\
         delay_samples = 50\n[start]\n{start}\n"
    )
}

fn sensor(channels: usize, start: &str) -> Unit {
    Unit::from_text(&text(channels, start))
}

/// Started at 0 with its first input at u.
fn started(start: &str, u: f64) -> Unit {
    let unit = sensor(1, start);
    unit.put("u[1]", u);
    unit.start(0.0);
    unit
}

/// All effects simultaneously, in two channels.
const ALL: &str = "time_constant = [0.02, 0.01]\ndelay = [0.007, 0.0]\nbias = [0.1, -0.2]\nseed = 7\n\
                   noise_deviation = [0.05, 0.02]\nresolution = [0.001, 0.0]";

/// Output of a sensor with only noise at each of `count` samples of 1 ms.
fn noise(channels: usize, seed: i32, count: usize) -> Vec<Vec<f64>> {
    let deviations = vec!["1.0"; channels].join(", ");
    let unit = sensor(channels, &format!("noise_deviation = [{deviations}]\nseed = {seed}"));
    unit.start(0.0);
    let mut samples = vec![Vec::new(); channels];
    for k in 0..count {
        unit.run(k as f64 * 1e-3, 1, 1e-3);
        samples.iter_mut().enumerate().for_each(|(i, of)| of.push(unit.get(&format!("y[{}]", i + 1))));
    }
    samples
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

/// Mean product of two series.
fn product(a: &[f64], b: &[f64]) -> f64 {
    let count = a.len().min(b.len());
    mean((0..count).map(|k| a[k] * b[k]))
}

#[test]
fn a_sensor_without_errors_gives_what_is_measured_to_the_bit() {
    let unit = started("", 0.3);
    assert_eq!(unit.get("y[1]"), 0.3);
    let mut random = Random::new(1);
    for k in 0..1000 {
        let u = random.next() * 10.0_f64.powf(11.0 * random.next());
        unit.put("u[1]", u);
        unit.run(f64::from(k) * 0.01, 1, 0.01);
        assert_eq!(unit.get("y[1]").to_bits(), u.to_bits(), "u = {u}");
    }
}

#[test]
fn a_sensor_without_errors_passes_changes_on_and_has_no_events() {
    let unit = Unit::from_text(&text(1, ""));
    unit.start(0.0);
    let (y, u) = (unit.reference("y[1]"), unit.reference("u[1]"));
    let mut change = f64::NAN;
    assert_eq!(unsafe { fmi2GetDirectionalDerivative(unit.component, &y, 1, &u, 1, &1.0, &mut change) }, OK);
    assert_eq!(change, 1.0);
    assert_eq!(Unit::exchange_from_text(&text(1, "")).begin(), None, "no time event");
}

#[test]
fn a_lag_follows_a_step_by_the_exponential_and_starts_at_rest() {
    let unit = started("time_constant = [0.05]\nrelative_tolerance = 1e-10", 2.0);
    unit.run(0.0, 10, 0.01);
    assert_eq!(unit.get("y[1]"), 2.0, "at rest");
    unit.put("u[1]", 5.0);
    for k in 0..100 {
        unit.run(0.1 + f64::from(k) * 0.01, 1, 0.01);
        let expected = 5.0 - 3.0 * (-f64::from(k + 1) * 0.01 / 0.05).exp();
        assert!((unit.get("y[1]") - expected).abs() < 1e-8, "{} is not {expected}", unit.get("y[1]"));
    }
}

#[test]
fn a_delayed_ramp_is_the_ramp_of_before_whatever_the_communication_step() {
    for (step, steps) in [(1e-3, 100), (0.37e-3, 270), (0.025, 4), (0.1, 1)] {
        let unit = started("delay = [0.012]", -1.0);
        for k in 0..steps {
            let t = f64::from(k) * step;
            unit.put("u[1]", 3.0 * t - 1.0);
            assert_eq!(unit.set_slope("u[1]", 3.0), OK);
            unit.run(t, 1, step);
            let expected = 3.0 * (t + step - 0.012).max(0.0) - 1.0;
            assert!((unit.get("y[1]") - expected).abs() < 1e-12, "step {step}, t = {}", t + step);
        }
    }
}

#[test]
fn a_delay_is_exact_at_its_samples_and_straight_between_them() {
    let signal = |t: f64| (40.0 * t).sin() + 0.5;
    let unit = Unit::exchange_from_text(&text(1, "delay = [0.05]\nsample_time = 0.01"));
    unit.put("u[1]", signal(0.0));
    let mut next = unit.begin();
    for k in 1..=100 {
        let sample = f64::from(k) * 0.01;
        assert_eq!(next, Some(sample), "samples are events at their times");
        for part in [0.25, 0.5, 0.9] {
            let t = sample - 0.01 + part * 0.01;
            assert_eq!(unit.set_time(t), OK);
            unit.put("u[1]", signal(t));
            // h² max |s''| / 8, where the signal began at rest.
            let error = (unit.get("y[1]") - signal((t - 0.05).max(0.0))).abs();
            assert!(error < 1e-4 * 1600.0 / 8.0, "t = {t}: {error}");
        }
        assert_eq!(unit.set_time(sample), OK);
        unit.put("u[1]", signal(sample));
        assert_eq!(unit.enter_event_mode(), OK);
        next = unit.settle();
        let expected = signal((f64::from(k - 5) * 0.01).max(0.0));
        assert_eq!(unit.get("y[1]"), expected, "sample {k}");
    }
}

#[test]
fn the_longest_delay_and_that_of_one_sample_are_right() {
    for samples in [1, 49, 50] {
        let delay = f64::from(samples) * 1e-3;
        let unit = started(&format!("delay = [{delay}]"), 0.0);
        unit.run(0.0, 1, 1e-3);
        unit.put("u[1]", 1.0);
        for k in 2..=120 {
            unit.run(f64::from(k - 1) * 1e-3, 1, 1e-3);
            // Sample 2 is the first that is 1.
            let expected = if k >= 2 + samples { 1.0 } else { 0.0 };
            assert!((unit.get("y[1]") - expected).abs() < 1e-9, "{samples} samples, sample {k}");
        }
    }
}

#[test]
fn noise_is_white_and_gaussian_with_the_deviation_asked_for() {
    const COUNT: usize = 100_000;
    let all = noise(2, 1, COUNT);
    // Four and a half deviations of each estimate.
    let bound = 4.5 / (COUNT as f64).sqrt();
    for samples in &all {
        assert!(mean(samples.iter().copied()).abs() < bound);
        assert!((product(samples, samples) - 1.0).abs() < bound * 2.0_f64.sqrt());
        let fourth = mean(samples.iter().map(|x| x.powi(4)));
        assert!((fourth - 3.0).abs() < bound * 96.0_f64.sqrt(), "fourth moment {fourth}");
        for (limit, inside) in [(1.0, 0.682_689_5), (2.0, 0.954_499_7), (3.0, 0.997_300_2)] {
            let found = samples.iter().filter(|x| x.abs() < limit).count() as f64 / COUNT as f64;
            let spread: f64 = inside * (1.0 - inside);
            assert!((found - inside).abs() < bound * spread.sqrt(), "{found} within {limit} deviations");
        }
        for lag in [1, 2, 3, 5, 10, 100, 1024] {
            let correlation = product(samples, &samples[lag..]);
            assert!(correlation.abs() < 1.01 * bound, "correlation {correlation} at {lag} samples");
        }
    }
    assert!(product(&all[0], &all[1]).abs() < bound, "channels have nothing to do with each other");
}

#[test]
fn each_seed_has_noise_of_its_own() {
    const COUNT: usize = 20_000;
    let series: Vec<_> = [1, 2, 3, 0, -1, 65536].into_iter().flat_map(|seed| noise(2, seed, COUNT)).collect();
    for (i, a) in series.iter().enumerate() {
        for b in &series[..i] {
            for shift in [0, 1, 2] {
                assert!(product(a, &b[shift..]).abs() < 5.0 / (COUNT as f64).sqrt());
            }
        }
    }
    assert_eq!(noise(2, 3, 100), noise(2, 3, 100), "and the same one each time");
    let narrower: Vec<_> = noise(3, 3, 100).into_iter().take(2).collect();
    assert_eq!(narrower, noise(2, 3, 100), "whatever the number of channels");
}

/// Worked out by another program from the definition: SplitMix64's output function, and Box and Muller's cosine.
#[test]
fn the_noise_of_a_seed_stays_what_it_was() {
    let printed = [
        [-0.976_386_566_884_499_1, 0.363_463_412_625_192_05, -0.028_183_223_245_599_943],
        [1.305_035_117_090_314, 0.866_030_103_480_691_3, 1.515_449_845_738_524],
    ];
    for (samples, expected) in noise(2, 1, 1000).iter().zip(printed) {
        let found = [1, 2, 1000].map(|k| samples[k - 1]);
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-14), "{found:?}");
    }
    assert!((noise(1, -5, 1)[0][0] + 1.256_934_872_524_446_7).abs() < 1e-14);
}

#[test]
fn noise_has_the_deviation_and_sample_time_that_are_set() {
    let unit = started("noise_deviation = [0.25]\nsample_time = 0.004", 0.0);
    let mut seen = vec![unit.get("y[1]")];
    for k in 0..400 {
        unit.run(f64::from(k) * 1e-3, 1, 1e-3);
        seen.push(unit.get("y[1]"));
    }
    for (k, pair) in seen.windows(2).enumerate() {
        assert_eq!(pair[0] != pair[1], (k + 1) % 4 == 0, "it changes at each fourth millisecond: {k}");
    }
    let of_one = noise(1, 1, 100);
    for k in 1..=100 {
        assert_eq!(seen[4 * k], 0.25 * of_one[0][k - 1], "sample {k} is that of any deviation");
    }
}

/// Outputs at multiples of 20 ms in steps of `step`, with an input that changes every 100 ms.
fn outputs(unit: &Unit, step: f64) -> Vec<[u64; 2]> {
    let (per_point, mut rows) = ((0.02 / step).round() as usize, Vec::new());
    for point in 0..50_usize {
        let u = (point / 5) as f64;
        unit.put("u[1]", u.sin());
        unit.put("u[2]", u.cos());
        for k in 0..per_point {
            let t = (point * per_point + k) as f64 * step;
            unit.run(t, 1, step);
        }
        rows.push(["y[1]", "y[2]"].map(|name| unit.get(name).to_bits()));
    }
    rows
}

#[test]
fn noise_is_the_same_with_every_communication_step() {
    let effects = "noise_deviation = [0.3, 0.1]\nresolution = [0.0, 0.01]\ndelay = [0.004, 0.003]\nbias = [1.0, 0.0]";
    let of = |step| {
        let unit = sensor(2, effects);
        unit.start(0.0);
        outputs(&unit, step)
    };
    let expected = of(1e-3);
    // Steps that meet each sample, that meet none but those at which is looked, and that hold many.
    for step in [0.25e-3, 0.02 / 7.0, 0.02 / 33.0, 0.02] {
        let (found, close) = (of(step), |a: u64, b: u64| (f64::from_bits(a) - f64::from_bits(b)).abs() < 1e-12);
        assert!(found.iter().zip(&expected).all(|(a, b)| close(a[0], b[0]) && a[1] == b[1]), "step {step}");
    }
}

#[test]
fn noise_is_the_same_in_model_exchange() {
    let start = "noise_deviation = [0.3, 0.1]\nresolution = [0.0, 0.01]";
    let (slave, exchange) = (sensor(2, start), Unit::exchange_from_text(&text(2, start)));
    slave.start(0.0);
    let mut next = exchange.begin();
    for k in 0..500 {
        let sample = next.expect("samples are events");
        assert_eq!(exchange.set_time(sample), OK);
        assert_eq!(exchange.enter_event_mode(), OK);
        next = exchange.settle();
        slave.run(f64::from(k) * 1e-3, 1, 1e-3);
        for name in ["y[1]", "y[2]"] {
            assert_eq!(exchange.get(name).to_bits(), slave.get(name).to_bits(), "{name}, sample {k}");
        }
    }
}

#[test]
fn a_sensor_started_late_or_before_zero_has_the_noise_of_its_time() {
    let whole = started("noise_deviation = [1.0]", 0.0);
    whole.run(0.0, 300, 1e-3);
    for first in [300, 200, 1] {
        let unit = sensor(1, "noise_deviation = [1.0]");
        unit.start(f64::from(first) * 1e-3);
        unit.run(f64::from(first) * 1e-3, 300 - first as usize, 1e-3);
        assert_eq!(unit.get("y[1]"), whole.get("y[1]"), "from sample {first} on");
    }
    let early = sensor(1, "noise_deviation = [1.0]\ndelay = [0.003]");
    early.start(-0.1);
    early.run(-0.1, 400, 1e-3);
    assert!((early.get("y[1]") - whole.get("y[1]")).abs() < 1e-12);
}

#[test]
fn a_restored_or_deserialised_sensor_goes_on_bit_for_bit() {
    let unit = sensor(2, ALL);
    unit.start(0.0);
    let go_on = |unit: &Unit| {
        for k in 0..200 {
            let t = 0.0302 + f64::from(k) * 0.7e-3;
            unit.put("u[1]", t.sin());
            unit.put("u[2]", t.cos());
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
    let other = sensor(2, ALL);
    other.start(0.0);
    let (status, state) = other.deserialise(&bytes);
    assert_eq!((status, other.restore(state)), (OK, OK));
    assert_eq!(go_on(&other), first);
}

#[test]
fn a_reset_sensor_repeats_its_noise() {
    let unit = sensor(2, ALL);
    unit.start(0.0);
    unit.run(0.0, 100, 1e-3);
    let first = unit.values();
    assert_eq!(unit.reset(), OK);
    unit.start(0.0);
    unit.run(0.0, 100, 1e-3);
    assert_eq!(unit.values(), first);
}

#[test]
fn a_quantised_value_is_the_nearest_level_and_constant_between_samples() {
    let unit = started("resolution = [0.25]", 0.1);
    assert_eq!(unit.get("y[1]"), 0.0);
    unit.run(0.0, 1, 1e-3);
    let levels = [(0.13, 0.25), (0.374, 0.25), (0.376, 0.5), (-0.13, -0.25), (-0.1, 0.0), (1e9 + 0.2, 1e9 + 0.25)];
    for (k, (u, level)) in levels.into_iter().enumerate() {
        let (t, before) = ((k + 1) as f64 * 1e-3, unit.get("y[1]"));
        unit.put("u[1]", u);
        unit.run(t, 1, 0.5e-3);
        assert_eq!(unit.get("y[1]"), before, "held until the sample");
        unit.run(t + 0.5e-3, 1, 0.5e-3);
        assert_eq!(unit.get("y[1]"), level, "u = {u}");
    }
}

#[test]
fn a_resolution_finer_than_a_number_changes_nothing() {
    let unit = started("resolution = [1e-300]", 1e11 + 0.3);
    unit.run(0.0, 3, 1e-3);
    assert!((unit.get("y[1]") - (1e11 + 0.3)).abs() < 1e-4, "{}", unit.get("y[1]"));
}

#[test]
fn bias_and_noise_are_quantised_with_the_signal() {
    // 0.06 + 0.05 is nearest to 0.1, as is 0.06; 0.03 + 0.05 is, but 0.03 is not.
    let unit = started("resolution = [0.1]\nbias = [0.05]", 0.03);
    assert_eq!(unit.get("y[1]"), 0.1);
    let unit = started("resolution = [0.1]\nnoise_deviation = [1.0]", 0.0);
    for k in 0..100 {
        unit.run(f64::from(k) * 1e-3, 1, 1e-3);
        let steps = unit.get("y[1]") / 0.1;
        assert!((steps - steps.round()).abs() < 1e-12, "{steps}");
    }
}

#[test]
fn errors_tuned_while_running_take_effect_at_the_next_step() {
    let unit = started("", 1.0);
    unit.run(0.0, 10, 1e-3);
    unit.put("bias[1]", 0.5);
    unit.run(0.01, 1, 1e-4);
    assert_eq!(unit.get("y[1]"), 1.5);
    unit.put("resolution[1]", 0.4);
    unit.run(0.0101, 1, 1e-4);
    assert_eq!(unit.get("y[1]"), 4.0 * 0.4);
    unit.put("resolution[1]", 0.0);
    unit.put("bias[1]", 0.0);
    unit.put("noise_deviation[1]", 1.0);
    unit.run(0.0102, 8, 1e-4);
    unit.run(0.011, 9, 1e-3);
    let always = started("noise_deviation = [1.0]", 1.0);
    always.run(0.0, 20, 1e-3);
    assert_eq!(unit.get("y[1]"), always.get("y[1]"), "noise that sets in late is that of its time");
}

#[test]
fn a_parameter_tuned_a_rounding_before_a_sample_loses_none_of_the_delayed_values() {
    let unit = started("delay = [0.002]", 0.0);
    // u = t.
    let step = |t: f64, step: f64| {
        unit.put("u[1]", t);
        assert_eq!(unit.set_slope("u[1]", 1.0), OK);
        unit.run(t, 1, step);
    };
    let (sample, rounding) = (0.01, 5e-13);
    step(0.0, sample - 1e-7);
    // So short a step isn't taken for one to the sample.
    step(sample - 1e-7, 1e-7 - rounding);
    unit.put("bias[1]", 0.5);
    step(sample - rounding, 1e-7);
    for k in 0..4 {
        let t = sample - rounding + 1e-7 + f64::from(k) * 1e-3;
        step(t, 1e-3);
        assert!((unit.get("y[1]") - (t + 1e-3 - 0.002 + 0.5)).abs() < 1e-12, "{}", unit.get("y[1]"));
    }
}

#[test]
fn a_lag_that_is_switched_on_begins_where_the_signal_is() {
    let unit = started("relative_tolerance = 1e-10", 1.0);
    unit.run(0.0, 10, 0.01);
    unit.put("u[1]", 3.0);
    unit.run(0.1, 1, 0.01);
    unit.put("time_constant[1]", 0.1);
    unit.run(0.11, 1, 0.01);
    assert_eq!(unit.get("y[1]"), 3.0);
    unit.put("u[1]", 4.0);
    unit.run(0.12, 1, 0.1);
    assert!((unit.get("y[1]") - (4.0 - (-1.0_f64).exp())).abs() < 1e-8);
    unit.put("time_constant[1]", 0.0);
    unit.run(0.22, 1, 0.01);
    assert_eq!(unit.get("y[1]"), 4.0, "and off again");
}

#[test]
fn channels_do_not_disturb_each_other() {
    let unit = sensor(3, "delay = [0.0, 0.005, 0.0]\nbias = [0.0, 0.0, 0.5]\nresolution = [0.0, 0.0, 0.25]");
    unit.start(0.0);
    unit.run(0.0, 1, 1e-3);
    [("u[1]", 0.3), ("u[2]", 0.7), ("u[3]", 0.9)].into_iter().for_each(|(name, u)| unit.put(name, u));
    unit.run(1e-3, 4, 1e-3);
    assert_eq!(["y[1]", "y[2]", "y[3]"].map(|name| unit.get(name)), [0.3, 0.0, 1.5]);
    unit.run(5e-3, 3, 1e-3);
    assert_eq!(unit.get("y[2]"), 0.7);
}

#[test]
fn in_one_unit_with_its_source_a_sensor_has_the_noise_that_it_has_alone() {
    let whole = "name = \"W\"\nmodel = \"composite\"\ndescription = \"\"\n[structure]\n\
                 connections = [[\"source.r[1]\", \"sensor.u[1]\"]]\n\
                 [[structure.parts]]\nname = \"sensor\"\nmodel = \"sensor\"\nstructure.channels = 1\n\
                 start.noise_deviation = [1.0]\nstart.delay = [0.004]\n\
                 [[structure.parts]]\nname = \"source\"\nmodel = \"reference\"\nstructure.channels = 1\n\
                 start.slope = [2.0]\nstart.offset = [1.0]\n";
    let alone = &noise(1, 1, 300)[0];
    let unit = Unit::from_text(whole);
    unit.start(0.0);
    for k in 1..=30_usize {
        unit.run((k - 1) as f64 * 0.01, 1, 0.01);
        let expected = 1.0 + 2.0 * (k as f64 * 0.01 - 0.004) + alone[10 * k - 1];
        assert!((unit.get("sensor.y[1]") - expected).abs() < 1e-11, "sample {k}0");
    }
}

#[test]
fn what_makes_no_sensor_is_refused_with_what_is_allowed() {
    let refused = |start: &str, named: &[&str]| described::refused(&text(1, start), named);
    refused("delay = [0.051]", &["delay[1] = 0.051", "multiple of sample_time = 0.001", "0 … 0.05", "delay_samples"]);
    refused("delay = [0.0105]", &["delay[1] = 0.0105", "multiple of sample_time = 0.001"]);
    refused("delay = [0.0004]", &["delay[1] = 0.0004", "multiple"]);
    refused("delay = [-0.001]", &["delay[1] = -0.001", "at least 0"]);
    refused("time_constant = [-1.0]", &["time_constant[1] = -1", "at least 0"]);
    refused("noise_deviation = [-0.1]", &["noise_deviation[1] = -0.1", "at least 0"]);
    refused("resolution = [-0.1]", &["resolution[1] = -0.1", "at least 0"]);
    refused("sample_time = 0.0", &["sample_time = 0", "at least"]);
    refused("seed = 1.5", &["seed", "1.5", "integer"]);
    let structure =
        |lines: &str| format!("name = \"S\"\nmodel = \"sensor\"\ndescription = \"\"\n[structure]\n{lines}\n");
    described::refused(&structure("channels = 0"), &["channels = 0", "1 … 1000"]);
    described::refused(&structure("channels = 1001"), &["channels = 1001", "1 … 1000"]);
    described::refused(&structure("channels = 10\ndelay_samples = 100000"), &["delay_samples = 100000", "0 … 99999"]);
    described::refused(&structure("channels = 2\nunits = [\"rad\"]"), &["units of u", "must be 2"]);
    described::refused(&structure("channels = 1\nunits = [\"a\\tb\"]"), &["unit of u", "control character"]);
    described::refused(&structure("channels = 1\ndelay_sample = 3"), &["delay_sample", "delay_samples"]);
}

#[test]
fn a_refused_parameter_leaves_the_last_ones_in_force() {
    let unit = started("noise_deviation = [0.5]", 1.0);
    unit.run(0.0, 5, 1e-3);
    unit.put("noise_deviation[1]", -1.0);
    assert_eq!(unit.step(5e-3, 1e-3), common::ERROR);
    assert!(unit.last_message().contains("noise_deviation[1] = -1"));
    assert_eq!(unit.get("noise_deviation[1]"), 0.5);
    unit.run(5e-3, 5, 1e-3);
}
