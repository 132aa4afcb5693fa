//! Sound designs work as reported: L1 controllers written out, with plants at the bounds of the input gain.
#![allow(non_snake_case)] // matrices have the names of the thesis

use adaptive_fmu::report::{Finding, Value};
use adaptive_fmu::system::{DesignReport, Verdict};
use common::described::model;
use common::random::Random;
use nalgebra::{DMatrix, DVector};

/// A design for x_1' = x_2, …, x_n' = −aᵀx + b u with y = x_1: its poles are real, its baseline outside.
#[derive(Debug, Clone)]
struct Design {
    a: Vec<f64>,
    b: f64,
    poles: Vec<f64>,
    K: f64,
    gain: f64,
    omega: [f64; 2],
    theta: f64,
    sigma: f64,
}

/// Results of the loop: the largest |y − 1| of the last quarter, and the range of u then.
#[derive(Debug)]
struct Ran {
    error: f64,
    swing: f64,
    y: f64,
}

impl Design {
    /// A third-order plant whose adaptation is slow compared with its filter.
    fn third() -> Self {
        let (a, poles) = (vec![1.0, 2.5, 3.0], vec![-4.7, -5.7, -6.8]);
        Design { a, b: 0.6, poles, K: 100.0, gain: 5e3, omega: [0.3, 3.0], theta: 11.63, sigma: 1000.0 }
    }

    fn random(random: &mut Random) -> Self {
        let mut within = |low: f64, high: f64| low * (high / low).powf(0.5 * (1.0 + random.next()));
        let n = within(1.0, 3.99).floor() as usize;
        let speed = within(1.0, 5.0);
        let poles: Vec<_> = (0..n).map(|i| -speed * 1.2_f64.powi(i as i32) * within(1.0, 1.1)).collect();
        // The plant is slower, and may be unstable.
        let own: Vec<_> =
            (0..n).map(|_| within(0.05, 0.8) * speed * if within(0.5, 2.0) > 1.4 { -1.0 } else { 1.0 }).collect();
        let omega = [1.0 / within(1.05, 2.5), within(1.05, 3.0)];
        let (b, K, gain) = (within(0.3, 3.0), speed * within(2.0, 40.0), within(3.0, 1e6));
        let K_g = polynomial(&poles)[0] / b;
        Design {
            a: polynomial(&own.iter().map(|p| -p).collect::<Vec<_>>()),
            b,
            poles,
            K,
            gain,
            omega,
            theta: 1.0,
            sigma: 3.0 * K_g,
        }
    }

    fn text(&self) -> String {
        let n = self.a.len();
        let row = |i: usize| {
            let entry = |j: usize| if i + 1 == n { -self.a[j] } else { f64::from(u8::from(j == i + 1)) };
            (0..n).map(entry).collect::<Vec<_>>()
        };
        let A: Vec<_> = (0..n).map(row).collect();
        let B: Vec<_> = (0..n).map(|i| vec![if i + 1 == n { self.b } else { 0.0 }]).collect();
        let C = vec![(0..n).map(|j| f64::from(u8::from(j == 0))).collect::<Vec<_>>()];
        format!(
            "name = 'Design'\nmodel = 'l1'\ndescription = ''\n[structure]\nA = {A:?}\nB = {B:?}\nC = {C:?}\nbaseline = 'outside'\n\
             regressor = 'state'\ninput_gain = 'diagonal'\n[start]\npole_real = {:?}\npole_imag = {:?}\nfeedback_gain = [[{:?}]]\n\
             adaptation_gain = {:?}\nomega_min = [{:?}]\nomega_max = [{:?}]\ntheta_bound = [{:?}]\nsigma_bound = [{:?}]\n",
            self.poles,
            vec![0.0; n],
            self.K,
            self.gain,
            self.omega[0],
            self.omega[1],
            self.theta,
            self.sigma
        )
    }

    fn report(&self) -> DesignReport {
        model(&self.text()).unwrap_or_else(|error| panic!("{error}: {self:?}")).report()
    }

    /// Runs the controller with a plant of `omega` times the nominal input gain, from rest, for a step of 1.
    fn run(&self, omega: f64, until: f64) -> Ran {
        let (n, wanted) = (self.a.len(), polynomial(&self.poles));
        let K_m: Vec<_> = (0..n).map(|j| (wanted[j] - self.a[j]) / self.b).collect();
        let K_g = wanted[0] / self.b;
        let BP: Vec<_> = last_row_of_P(&wanted).iter().map(|p| p * self.b).collect();
        let chain = |row: &[f64], x: &[f64], driven: f64, dx: &mut [f64]| {
            dx[..n - 1].copy_from_slice(&x[1..n]);
            dx[n - 1] = driven - row.iter().zip(x).map(|(a, x)| a * x).sum::<f64>();
        };
        let projected = |estimate: f64, [low, high]: [f64; 2], rate: f64| {
            let (d, h) = (estimate - 0.5 * (low + high), 0.5 * (high - low));
            let f = (1.1 * d * d - h * h) / (0.1 * h * h);
            if f > 0.0 && d * rate > 0.0 { rate * (1.0 - f) } else { rate }
        };
        // x, x̂, ω̂, σ̂, u_ad, θ̂
        let (of_omega, of_sigma, of_u, of_theta) = (2 * n, 2 * n + 1, 2 * n + 2, 2 * n + 3);
        let rates = |s: &[f64], ds: &mut [f64]| {
            let (x, u_ad) = (&s[..n], s[of_u]);
            let eta = s[of_omega] * u_ad + s[of_sigma] + (0..n).map(|j| s[of_theta + j] * x[j]).sum::<f64>();
            let fed: f64 = K_m.iter().zip(x).map(|(k, x)| k * x).sum();
            chain(&self.a, x, self.b * omega * (u_ad - fed), &mut ds[..n]);
            chain(&wanted, &s[n..2 * n], self.b * eta, &mut ds[n..2 * n]);
            let step = -self.gain * (0..n).map(|j| BP[j] * (s[n + j] - x[j])).sum::<f64>();
            ds[of_omega] = projected(s[of_omega], self.omega, step * u_ad);
            ds[of_sigma] = projected(s[of_sigma], [-self.sigma, self.sigma], step);
            ds[of_u] = -self.K * (eta - K_g);
            for j in 0..n {
                ds[of_theta + j] = projected(s[of_theta + j], [-self.theta, self.theta], step * x[j]);
            }
        };
        let fixed = self.K * self.omega[1] + wanted.iter().sum::<f64>().powf(1.0 / n as f64);
        let mut s = vec![0.0_f64; 3 * n + 3];
        s[of_omega] = 1.0;
        let (mut k, mut at) = (vec![vec![0.0; s.len()]; 4], s.clone());
        let (mut t, mut error, mut low, mut high) = (0.0, 0.0_f64, f64::INFINITY, f64::NEG_INFINITY);
        while t < until {
            let signals = 1.0 + s[of_u].powi(2) + s[..n].iter().map(|x| x * x).sum::<f64>();
            let h = (0.15 / (fixed + (self.gain * self.b * BP[n - 1] * signals).sqrt())).min(until - t).max(1e-12);
            rates(&s, &mut k[0]);
            for (i, part) in [(1, 0.5), (2, 0.5), (3, 1.0)] {
                (0..s.len()).for_each(|j| at[j] = s[j] + part * h * k[i - 1][j]);
                rates(&at, &mut k[i]);
            }
            (0..s.len()).for_each(|j| s[j] += h / 6.0 * (k[0][j] + 2.0 * k[1][j] + 2.0 * k[2][j] + k[3][j]));
            t += h;
            if s[0].is_nan() || s[0].abs() > 1e6 {
                return Ran { error: f64::INFINITY, swing: f64::INFINITY, y: s[0] };
            }
            if t > 0.75 * until {
                let u = s[of_u] - K_m.iter().zip(&s).map(|(k, x)| k * x).sum::<f64>();
                (error, low, high) = (error.max((s[0] - 1.0).abs()), low.min(u), high.max(u));
            }
        }
        Ran { error, swing: high - low, y: s[0] }
    }
}

/// c_0 … c_(n−1) of the monic polynomial with these roots.
fn polynomial(roots: &[f64]) -> Vec<f64> {
    let mut all = vec![1.0];
    for root in roots {
        // Highest power first.
        let shifted: Vec<_> = all.iter().map(|c| -root * c).collect();
        all.push(0.0);
        all.iter_mut().skip(1).zip(shifted).for_each(|(c, shifted)| *c += shifted);
    }
    all[1..].iter().rev().copied().collect()
}

/// The last row of P with A_mᵀ P + P A_m = −I, of the companion matrix of a polynomial, as one system of linear equations.
fn last_row_of_P(wanted: &[f64]) -> Vec<f64> {
    let n = wanted.len();
    let A_m = DMatrix::from_fn(n, n, |i, j| if i + 1 == n { -wanted[j] } else { f64::from(u8::from(j == i + 1)) });
    let one = DMatrix::identity(n, n);
    let whole = one.kronecker(&A_m.transpose()) + A_m.transpose().kronecker(&one);
    let P = whole.lu().solve(&DVector::from_column_slice((-&one).as_slice())).unwrap();
    (0..n).map(|j| P[j * n + n - 1]).collect()
}

fn finding<'a>(report: &'a DesignReport, name: &str) -> &'a Finding {
    report.findings.iter().find(|finding| finding.name.contains(name)).unwrap_or_else(|| panic!("{name}: {report:?}"))
}

const PREDICTION: &str = "bound on the prediction";
const TOLERATED: &str = "that the adaptation tolerates";

/// The adaptation of a third-order design oscillates at 7.7 rad/s with a filter of 300 rad/s. With twice or three times
/// the nominal input gain, y isn't 1 after 20 s, and u swings.
#[test]
fn a_design_whose_adaptation_is_slower_than_its_filter_is_not_sound_and_not_stable() {
    let design = Design::third();
    let report = design.report();
    assert!(!report.is_sound());
    let reason = report.reason().unwrap();
    assert!(
        reason.contains("turns at 7.7 rad/s, compared with a filter of 300 rad/s")
            && reason.contains("adaptation_gain = "),
        "{reason}"
    );
    assert_eq!(finding(&report, PREDICTION).verdict, Verdict::NotSound);
    let Value::Number(bound) = finding(&report, "bound on |x_hat - x|").value else { panic!("{report:?}") };
    assert!((bound - 163.655).abs() < 0.01, "{bound}");
    let tolerated = finding(&report, TOLERATED);
    assert!(
        tolerated.verdict == Verdict::Warning && tolerated.note.contains("feedback_gain times 0.0758"),
        "{tolerated:?}"
    );
    // What omega scales counts: 3 · 11.63 · ‖G‖ without (omega - I) K_m x is 0.947.
    let Value::Between { upper: lambda, .. } = finding(&report, "lambda").value else { panic!("{report:?}") };
    assert!((lambda - 1.157).abs() < 1e-3, "{lambda}");
    let added = finding(&report, "(omega - I) K_m");
    assert!(added.verdict == Verdict::Warning && added.note.contains("theta_bound"), "{added:?}");
    let (nominal, twice, thrice) = (design.run(1.0, 20.0), design.run(2.0, 20.0), design.run(3.0, 20.0));
    assert!(nominal.error < 1e-6, "{nominal:?}");
    assert!((twice.y - 0.986).abs() < 1e-3 && twice.swing > 18.0, "{twice:?}");
    assert!(thrice.error > 0.01 && thrice.swing > 15.0, "{thrice:?}");
}

#[test]
fn with_the_gain_that_it_tolerates_and_a_faster_adaptation_it_is_stable() {
    let design = Design { K: 7.0, gain: 5e4, ..Design::third() };
    let report = design.report();
    assert_ne!(finding(&report, PREDICTION).verdict, Verdict::NotSound);
    assert_eq!(finding(&report, TOLERATED).verdict, Verdict::Ok);
    for omega in [2.0, 3.0] {
        let ran = design.run(omega, 20.0);
        assert!(ran.error < 1e-3 && ran.swing < 0.05, "{omega}: {ran:?}");
    }
    // Fast adaptation by itself leaves the control swinging.
    let ran = Design { gain: 5e6, ..Design::third() }.run(2.0, 20.0);
    assert!(ran.error < 1e-2 && ran.swing > 0.1, "{ran:?}");
}

#[test]
fn the_advised_adaptation_gain_turns_fast_enough() {
    let design = Design { K: 7.0, ..Design::third() };
    let note = finding(&design.report(), PREDICTION).note.clone();
    let gain_of = |note: &str| -> f64 {
        note.split_once("adaptation_gain = ").unwrap().1.split(' ').next().unwrap().parse().unwrap()
    };
    let advised = gain_of(&note);
    for (gain, verdict) in [(advised, Verdict::Ok), (0.9 * advised, Verdict::Warning)] {
        assert_eq!(finding(&Design { gain, ..design.clone() }.report(), PREDICTION).verdict, verdict, "{note}");
    }
    // One that is as fast as that, with bounds as wide as no prediction holds: a larger gain is advised, not that one again.
    let wide = Design { gain: advised, theta: 1e6, ..design };
    let note = finding(&wide.report(), PREDICTION).note.clone();
    assert_eq!(finding(&wide.report(), PREDICTION).verdict, Verdict::Warning, "{note}");
    let enough = Design { gain: gain_of(&note), ..wide };
    assert!(enough.gain > advised, "{note}");
    assert_eq!(finding(&enough.report(), PREDICTION).verdict, Verdict::Ok, "{note}");
}

/// Random designs whose bounds on theta are within what their norm allows.
#[test]
fn what_is_called_sound_is_stable_at_the_bounds_of_the_input_gain() {
    let (mut random, mut seen, mut sound) = (Random::new(43), [0_usize; 3], 0);
    for k in 0..40 {
        let mut design = Design::random(&mut random);
        let Value::Between { upper: lambda, .. } = finding(&design.report(), "lambda").value else { continue };
        design.theta = 0.9 / lambda;
        let report = design.report();
        let prediction = finding(&report, PREDICTION).verdict;
        seen[prediction as usize] += 1;
        if !report.is_sound() {
            continue;
        }
        sound += 1;
        let until = 20.0 / design.poles.iter().map(|p| p.abs()).fold(f64::INFINITY, f64::min);
        for omega in design.omega {
            let (ran, most) = (design.run(omega, until), if prediction == Verdict::Ok { 0.01 } else { 0.1 });
            println!("{k}, omega {omega:.2}, prediction {prediction:?}: {ran:?}");
            assert!(ran.error < most, "design {k}, omega {omega}: {ran:?}, {design:?}");
        }
    }
    assert!(sound >= 10, "{sound} are called sound");
    assert!(seen.iter().all(|&count| count >= 3), "each verdict is among them: {seen:?}");
}
