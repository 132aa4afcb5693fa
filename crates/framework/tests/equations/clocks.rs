//! Clocks: time events that come regularly, however many of them a communication step holds.

use common::contacts::Metronome;
use common::models::Run;
use common::{ERROR, OK, Unit};

fn unit(model: &str, start: &str) -> Unit {
    let text = format!("name = \"U\"\nmodel = \"{model}\"\ndescription = \"\"\n[structure]\nchannels = 1\n");
    let unit = Unit::from_text(&format!("{text}[start]\n{start}\n"));
    unit.start(0.0);
    unit
}

#[test]
fn a_square_wave_of_100_hz_is_stepped_by_hours() {
    let unit = unit("reference", "square_amplitude = [1.0]\nsquare_frequency = [100.0]");
    for k in 0..3 {
        // An odd number of half periods each.
        assert_eq!(unit.step(f64::from(k) * 1e4, 1e4 + if k == 2 { 0.0051 } else { 0.0 }), OK, "{:?}", unit.messages());
    }
    assert_eq!((unit.get("r[1]"), unit.get("half_periods[1]")), (-1.0, 6_000_001.0));
}

#[test]
fn a_sensor_that_samples_every_millisecond_has_the_same_samples_in_long_steps_as_in_short_ones() {
    let noisy = "noise_deviation = [1.0]\nseed = 7\ntime_constant = [0.02]";
    let (long, short) = (unit("sensor", noisy), unit("sensor", noisy));
    assert_eq!(long.step(0.0, 300.0), OK, "{:?}", long.messages());
    short.run(0.0, 3000, 0.1);
    assert_eq!(long.get("y[1]"), short.get("y[1]"));
}

#[test]
fn more_samples_than_a_step_may_take_work_are_refused_for_the_work() {
    let unit = unit("sensor", "noise_deviation = [1.0]");
    assert_eq!(unit.step(0.0, 1e4), ERROR);
    let message = unit.last_message();
    assert!(message.contains("take a smaller one") && !message.contains("Zeno"), "{message}");
}

#[test]
fn ticks_of_a_long_step_are_all_taken_at_their_own_times() {
    // Those at its end too.
    for (period, step, steps) in [(1e-3, 300.0, 2), (0.1, 1e4, 3), (0.3, 1e5, 2), (1e-3, 1e-3, 100)] {
        let mut run = Run::of::<Metronome>(&format!("period = {period}"), 0.0);
        run.run(steps, step);
        let end = run.0.time();
        assert!(run.get("off") < 1e-9 * end, "period {period}, step {step}: off by {}", run.get("off"));
        assert!((run.get("ticks") - end / period).abs() <= 1.0, "period {period}: {} ticks", run.get("ticks"));
    }
}

#[test]
fn the_fastest_clock_that_time_resolves_is_followed_and_a_step_that_has_too_many_ticks_ends() {
    for start in [0.0, 10.0] {
        let mut run = Run::of::<Metronome>("period = 1e-12", start);
        run.step(1e-8);
        assert!((run.get("ticks") - 1e4).abs() < 20.0, "{} ticks", run.get("ticks"));
        let before = run.0.block().clone();
        let message = run.failure(1.0).to_string();
        assert!(message.contains("substeps reached only"), "{message}");
        assert_eq!(run.0.block(), &before, "as before the step");
    }
    // Ticks closer than the resolution of numbers have no time between them.
    let message = Run::of::<Metronome>("period = 1e-12", 1e5).failure(1.0).to_string();
    assert!(message.contains("more than 10000 events at t = 10000"), "{message}");
}
