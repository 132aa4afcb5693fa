//! The samples of the robust MRAC: they are its own, however a master cuts the time.

use common::described::refused;
use common::random::Random;
use common::{OK, Unit, description};

const NAME: &str = "MracPpfCoupledMimo";
/// Sample time, s.
const T: f64 = 1e-3;
/// Inputs, in the order r, x.
type Inputs = [f64; 6];

fn text(start: &str) -> String {
    format!("{}\n{start}", description(NAME))
}

fn set(unit: &Unit, inputs: Inputs) {
    for i in 0..3 {
        unit.put(&format!("r[{}]", i + 1), inputs[i]);
        unit.put(&format!("x[{}]", i + 1), inputs[3 + i]);
    }
}

/// References and states that move, near the model, another one each sample.
fn inputs(random: &mut Random) -> Inputs {
    std::array::from_fn(|i| if i < 3 { 1.0 + 0.1 * random.next() } else { 0.3 + 0.2 * random.next() })
}

/// A controller with a wide funnel and any moves of the control: here nothing follows anything.
fn started(start: &str, t: f64) -> Unit {
    let unit = Unit::from_text(&text(start));
    (1..=3).for_each(|i| unit.put(&format!("rho_inf[{i}]"), 1.9));
    unit.put("step_move_limit", 100.0);
    unit.enter(t);
    set(&unit, [1.0, 1.0, 1.0, 0.3, 0.3, 0.3]);
    assert_eq!(unit.exit(), OK, "{:?}", unit.messages());
    unit
}

/// All that a sample leaves: the control, then the estimates. (The model goes on between samples; the control follows from
/// where it was at them.)
fn left(unit: &Unit) -> Vec<u64> {
    let of = |name: &str| [1, 2, 3].map(|i| unit.get(&format!("{name}[{i}]")).to_bits());
    let mut all = of("u").to_vec();
    for name in ["theta_hat", "sigma_integral"] {
        for (i, j) in (1..=3).flat_map(|i| (1..=3).map(move |j| (i, j))) {
            all.push(unit.get(&format!("{name}[{i},{j}]")).to_bits());
        }
    }
    all
}

/// Steps from sample to sample.
fn uncut(unit: &Unit, samples: &[Inputs]) -> Vec<Vec<u64>> {
    let step = |(k, inputs): (usize, &Inputs)| {
        set(unit, *inputs);
        assert_eq!(unit.step(k as f64 * T, T), OK, "{:?}", unit.messages());
        left(unit)
    };
    samples.iter().enumerate().map(step).collect()
}

/// Communication points between two samples: random ones, very near ones, and remnants about the second sample.
fn cut(from: f64, to: f64, random: &mut Random) -> Vec<f64> {
    let mut points: Vec<f64> = (0..3).map(|_| from + (to - from) * (0.5 + 0.49 * random.next())).collect();
    points.push(points[0] + 1e-13);
    let ends: [&[f64]; 5] = [&[0.0], &[1e-13], &[-1e-13, 0.0], &[-2e-8, -1e-13], &[-2e-8, -1e-13, 1e-13]];
    let end = ends[((0.5 + 0.5 * random.next()) * 4.999) as usize];
    points.extend(end.iter().map(|after| to + after));
    points.sort_by(f64::total_cmp);
    points.dedup();
    points
}

#[test]
fn communication_points_anywhere_change_no_bit_of_a_sample() {
    for seed in 1..=5 {
        let mut random = Random::new(seed);
        let samples: Vec<Inputs> = (0..200).map(|_| inputs(&mut random)).collect();
        let expected = uncut(&started("sample_time = 1e-3", 0.0), &samples);
        let unit = started("sample_time = 1e-3", 0.0);
        let mut t = 0.0;
        for (k, (&at_sample, expected)) in samples.iter().zip(&expected).enumerate() {
            let points = cut(t, (k + 1) as f64 * T, &mut random);
            let near = points.iter().position(|&point| point >= (k + 1) as f64 * T - 2e-13).unwrap();
            for (j, &point) in points.iter().enumerate() {
                // The step in which the sample lies has its inputs; those before it others, and those after it too.
                set(&unit, if j == near { at_sample } else { inputs(&mut random) });
                assert_eq!(unit.step(t, point - t), OK, "{:?}", unit.messages());
                if j == near {
                    assert_eq!(left(&unit), *expected, "seed {seed}, sample {k}, points {points:?}");
                }
                t = point;
            }
            assert_eq!(left(&unit), *expected, "held until the next sample");
        }
    }
}

#[test]
fn a_remnant_of_a_step_changes_nothing() {
    let unit = started("", 0.0);
    unit.run(0.0, 20, T);
    let before = left(&unit);
    for (from, step) in [(20.0 * T, 1e-13), (20.0 * T + 1e-13, 1e-12)] {
        assert_eq!(unit.step(from, step), OK, "{:?}", unit.messages());
        assert_eq!(left(&unit), before);
    }
    assert!(!unit.get_boolean("step_too_long"));
}

#[test]
fn the_sample_time_is_the_first_steps_length_unless_it_is_given() {
    let samples = {
        let mut random = Random::new(7);
        (0..50).map(|_| inputs(&mut random)).collect::<Vec<_>>()
    };
    let given = started("sample_time = 1e-3", 0.0);
    let by_itself = started("", 0.0);
    assert_eq!([given.get("sample_period"), by_itself.get("sample_period")], [T, 0.0]);
    assert_eq!(uncut(&given, &samples), uncut(&by_itself, &samples));
    assert_eq!(by_itself.get("sample_period"), T);
    // A remnant is none.
    let unit = started("", 0.0);
    assert_eq!((unit.step(0.0, 1e-13), unit.step(1e-13, 2.0 * T)), (OK, OK));
    assert_eq!(unit.get("sample_period"), 2.0 * T);
    refused(&text("sample_time = 1e-10"), &["sample_time = 1e-10", "1e-9"]);
    let continuous = started("law = 'continuous'\nsample_time = 1e-3\nswitching_width = 0.5", 0.0);
    assert_eq!(continuous.step(0.0, 1e-9), OK, "{:?}", continuous.messages());
    assert_eq!(continuous.get("sample_period"), 0.0);
}

#[test]
fn a_master_that_adds_up_its_points_has_one_sample_in_each_step() {
    // At these steps the sum runs ahead of k H, and behind it, by more than the slack of a time event.
    for (step, sign) in [(0.0106, 1.0), (0.009, -1.0)] {
        let start = 20_000.0;
        let (exact, added) = (started("", start), started("", start));
        let mut t = start;
        let mut random = Random::new(1);
        for k in 0..9000 {
            let now = inputs(&mut random);
            set(&exact, now);
            set(&added, now);
            assert_eq!(exact.step(start + f64::from(k) * step, step), OK, "{:?}", exact.messages());
            assert_eq!(added.step(t, step), OK, "{:?}", added.messages());
            t += step;
            assert_eq!(left(&exact), left(&added), "step {k} of {step} s");
        }
        let away = t - (start + 9000.0 * step);
        assert!(sign * away > 1e-6 * step, "{away:e}");
    }
}

#[test]
fn several_samples_in_a_step_are_those_of_constant_inputs_and_the_fmu_warns() {
    let (long, short) = (started("sample_time = 1e-3", 0.0), started("sample_time = 1e-3", 0.0));
    long.run(0.0, 20, 10.0 * T);
    short.run(0.0, 200, T);
    assert_eq!(left(&long), left(&short));
    let flags = |unit: &Unit| {
        let messages = unit.messages().into_iter().filter(|(_, category, _)| category == "logStepTooLong").count();
        (unit.get_boolean("step_too_long"), messages)
    };
    assert_eq!((flags(&long), flags(&short)), ((true, 1), (false, 0)));
    // Where the step is no multiple, the sample takes the inputs of the step that it lies in.
    let odd = started("sample_time = 1e-3", 0.0);
    let mut random = Random::new(3);
    let given: Vec<Inputs> = (0..30).map(|_| inputs(&mut random)).collect();
    let mut of_samples = Vec::new();
    for (k, &inputs) in given.iter().enumerate() {
        set(&odd, inputs);
        assert_eq!(odd.step(k as f64 * 0.7 * T, 0.7 * T), OK, "{:?}", odd.messages());
        if ((k + 1) * 7) / 10 > (k * 7) / 10 {
            of_samples.push((inputs, left(&odd)));
        }
    }
    let whole = uncut(&started("sample_time = 1e-3", 0.0), &of_samples.iter().map(|one| one.0).collect::<Vec<_>>());
    assert!(whole.len() == 21 && of_samples.iter().zip(whole).all(|(one, whole)| one.1 == whole));
}
