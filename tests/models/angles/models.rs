//! Laws with a reference model or a funnel: plain and robust MRAC, neuro-adaptive control, L1 control with prescribed performance.

use std::f64::consts::{PI, TAU};

use common::random::Random;

use super::loops::*;
use super::{head, made, refusal, wrapped};

const DEGREE: f64 = PI / 180.0;

fn apart(a: &[[f64; 2]], b: &[[f64; 2]]) -> [f64; 2] {
    let most = |element: usize| a.iter().zip(b).map(|(a, b)| (a[element] - b[element]).abs()).fold(0.0, f64::max);
    [most(0), most(1)]
}

/// Over more than a turn, with a manual phase, at random starts and speeds.
#[test]
fn each_law_takes_wrapped_angles_for_unwrapped_ones_and_follows_them() {
    let mut random = Random::new(17);
    let mut worst = [0.0_f64; 2];
    for law in loops() {
        for _ in 0..2 {
            let (start, speed) = (3.1 * random.next(), (2.2 + 0.6 * random.next()) * random.next().signum());
            // An L1 law counts from 0 only what is read near 0 at the start: here none is, whichever way it is read.
            let start = if law.kind == "l1-ppf" { (1.0 + 0.65 * start.abs()).copysign(start) } else { start };
            let jump = if law.has_rates { 0.0 } else { 0.8 * random.next() };
            let r = |t: f64| [start + speed * t + if t < 2.5 { 0.0 } else { jump }, speed, 0.0];
            let smooth = |t: f64| {
                let (soft, slope) = (1.0 - (-2.0 * t).exp(), 2.0 * (-2.0 * t).exp());
                [start + speed * (t - 0.5 * soft), speed * soft, speed * slope]
            };
            let r: Reference = if law.has_rates { &smooth } else { &r };
            let text = law.text(start, KEY);
            let seconds = 8.0;
            let manual = if random.next() > 0.0 { [1.0, 1.2] } else { [9.0, 9.0] };
            let unwrapped = closed(&law, &text, start, seconds, r, UNWRAPPED, manual);
            let end = unwrapped[unwrapped.len() - 1][0];
            assert!((end - r(seconds)[0]).abs() < 2.6, "{end}, not {}: {text}", r(seconds)[0]);
            assert!((end - start).abs() > TAU, "{end}: {text}");
            for read in READS {
                let [psi, u] = apart(&closed(&law, &text, start, seconds, r, read, manual), &unwrapped);
                worst = [worst[0].max(psi), worst[1].max(u)];
                assert!(psi < 1e-10 && u < 1e-9, "{psi} {u}: {text}");
            }
        }
    }
    println!("{worst:?}");
}

#[test]
fn each_law_goes_the_short_way_over_the_seam() {
    for law in loops() {
        let text = law.text(170.0 * DEGREE, KEY);
        let r = |t: f64| [if t < 1e-9 { 170.0 } else { 190.0 } * DEGREE, 0.0, 0.0];
        let found = closed(&law, &text, 170.0 * DEGREE, 6.0, &r, [wrapped, wrapped], [9.0, 9.0]);
        let end = found[found.len() - 1][0] / DEGREE;
        assert!((end - 190.0).abs() < 12.0, "{end}: {text}");
        let most = found.iter().map(|[psi, _]| (psi / DEGREE - 180.0).abs()).fold(0.0, f64::max);
        assert!(most < 40.0, "{most}: {text}");
    }
}

/// Without the key the seam is a motion: a controller is lost, or goes the long way, or refuses the error.
#[test]
fn without_the_key_the_seam_is_no_seam() {
    for law in [mrac("baseline = 'outside'", ""), unmatched(""), l1_ppf(true, "baseline = 'outside'", "")] {
        let text = law.text(170.0 * DEGREE, "");
        let mut run = made(&text);
        let r = |t: f64| [if t < 0.1 { 170.0 } else { 190.0 } * DEGREE, 0.0, 0.0];
        let (mut x, mut far) = ([170.0 * DEGREE, 0.0], false);
        for k in 0..1500 {
            let t = f64::from(k) * H;
            put_inputs(&mut run, &law, t, x, &r, [wrapped, wrapped]);
            if k == 0 {
                run.0.initialise().unwrap();
            }
            if run.0.step(run.0.time(), H).is_err() {
                far = true;
                break;
            }
            let u = [run.get("u[1]"), if law.sizes[1] > 1 { run.get("u[2]") } else { 0.0 }];
            x = moved(law.plant, t, x, u);
            far |= (x[0] / DEGREE - 180.0).abs() > 60.0;
        }
        assert!(far, "{text}");
    }
}

/// The control doesn't jump where an origin moves, however far it moves.
#[test]
fn an_origin_that_moves_makes_no_jump() {
    let ramp = |t: f64| [0.7 + 0.5 * t, 0.5, 0.0];
    for law in loops().into_iter().filter(|law| law.kind != "neuro-ppf") {
        let run = |further: &str| {
            let mut run = made(&format!("{}{further}", law.text(0.7, KEY)));
            let (mut x, mut found) = ([0.7, 0.5], Vec::new());
            for k in 0..1500 {
                let t = f64::from(k) * H;
                put_inputs(&mut run, &law, t, x, &ramp, UNWRAPPED);
                if k == 0 {
                    run.0.initialise().unwrap();
                }
                run.step(H);
                let u = [run.get("u[1]"), if law.sizes[1] > 1 { run.get("u[2]") } else { 0.0 }];
                x = moved(law.plant, t, x, u);
                found.push((u[0], run.get("origin[1]")));
            }
            found
        };
        let jumps = |found: &[(f64, f64)]| {
            found.windows(2).skip(50).map(|pair| (pair[1].0 - pair[0].0).abs()).fold(0.0, f64::max)
        };
        let (moves, stays) = (run(""), run("origin_range = 3.0\n"));
        assert!(moves[1499].1 > 0.75 && stays[1499].1 == 0.0, "{:?} {:?}", moves[1499], stays[1499]);
        assert!(
            jumps(&moves) < 2.0 * jumps(&stays) + 0.01,
            "{} {}: {}",
            jumps(&moves),
            jumps(&stays),
            law.text(0.7, KEY)
        );
    }
}

/// Values that differ by whole turns start the same.
#[test]
fn laws_that_start_their_model_at_the_plant_start_the_same_in_any_turn() {
    for law in [mrac("baseline = 'outside'", ""), unmatched(""), mrac("baseline = 'inside'", "law = 'continuous'")] {
        for psi in [0.2, 2.0, -3.0] {
            let r = |t: f64| [psi + 0.4 * t, 0.4, 0.0];
            let text = law.text(psi, KEY);
            let expected = closed(&law, &text, psi, 1.0, &r, UNWRAPPED, [9.0, 9.0]);
            for read in [[|y| y + 3.0 * TAU, |r| r + 3.0 * TAU], [|y| y - TAU, |r| r + 5.0 * TAU]] as [Read; 2] {
                let [_, u] = apart(&closed(&law, &text, psi, 1.0, &r, read, [9.0, 9.0]), &expected);
                assert!(u < 1e-10, "{u} at {psi}: {text}");
            }
        }
    }
}

#[test]
fn an_angle_that_jumps_and_is_not_declared_is_reported_once() {
    for law in [
        mrac("baseline = 'outside'", ""),
        mrac_ppf("on_funnel_exit = 'reopen'\n"),
        unmatched("on_funnel_exit = 'reopen'\n"),
        neuro(1, false),
        neuro(2, true),
        l1_ppf(true, "baseline = 'outside'", "on_funnel_exit = 'reopen'\n"),
    ] {
        for (angles, warnings) in [("", 1), (KEY, 0)] {
            let mut run = made(&format!(
                "{}{}",
                law.text(3.1, angles),
                if law.kind == "neuro-ppf" { "on_funnel_exit = 'reopen'\n" } else { "" }
            ));
            let mut messages = Vec::new();
            for (k, psi) in [3.1, 3.12, -3.1, -3.05, 3.1].into_iter().enumerate() {
                put_inputs(&mut run, &law, 0.0, [psi, 0.0], &|_| [3.1, 0.0, 0.0], UNWRAPPED);
                if k == 0 {
                    run.0.initialise().unwrap();
                }
                run.step(1e-3);
                messages.extend(run.0.take_messages().filter(|message| message.category == "logAngleJump"));
            }
            assert_eq!(messages.len(), warnings, "{}: {messages:?}", law.kind);
            assert!(messages.iter().all(|message| message.text.contains("x[1]")), "{messages:?}");
        }
    }
}

#[test]
fn angles_that_laws_can_not_have_are_refused() {
    let with = |law: &Loop, angles: &str| refusal(&law.text(0.0, angles));
    for law in
        [mrac("baseline = 'outside'", ""), mrac_ppf(""), unmatched(""), l1_ppf(false, "baseline = 'outside'", "")]
    {
        let reason = with(&law, "angles = [2]");
        let reasons = ["angles = 2", "rad"];
        assert!(reasons.iter().all(|part| reason.contains(part)), "{}: {reason}", law.kind);
        let reason = with(&law, "angles = [3]");
        assert!(reason.contains("angles = 3") && reason.contains("must be within 1 … 2"), "{}: {reason}", law.kind);
    }
    let reason = with(&neuro(2, false), "angles = [2]");
    assert!(reason.contains("angles = 2") && reason.contains("must be within 1 … 1"), "{reason}");
    let mut drives = unmatched("");
    drives.structure = drives.structure.replace("'rad/s'", "'rad'");
    let reason = with(&drives, "angles = [2]");
    assert!(reason.contains("angles = 2") && reason.contains("must not drive an unmatched row"), "{reason}");
    let mut given = neuro(1, false);
    given.structure = given
        .structure
        .replace("{ rule = 'square_roots', neurons = 12 }", "{ rule = 'given', weights = [[1.0]], biases = [0.0] }");
    let reason = with(&given, KEY);
    assert!(reason.contains("must be 2") && reason.contains("sine and cosine"), "{reason}");
}

#[test]
fn a_funnel_of_an_angle_is_narrower_than_half_a_turn() {
    let laws = [mrac_ppf(""), unmatched(""), neuro(2, false), l1_ppf(false, "baseline = 'outside'", "")];
    for law in &laws {
        let rest = if law.start.contains("rho_0 = [1.2]") { "rho_0 = [1.2]" } else { "rho_0 = [1.0" };
        let wide =
            Loop { start: law.start.replace(rest, &rest.replace("1.0", "3.2").replace("1.2", "3.2")), ..law.clone() };
        let reason = refusal(&wide.text(0.0, KEY));
        assert!(reason.contains("rho_0[1] = 3.2") && reason.contains("must be below 3.14"), "{reason}");
        assert!(made(&wide.text(0.0, "")).0.initialise().is_ok());
    }
}

#[test]
fn a_funnel_of_an_angle_re_opens_below_half_a_turn_only() {
    let sampled = l1_ppf(true, "baseline = 'outside'", "law = 'sampled'\n");
    for law in [mrac_ppf(""), unmatched(""), neuro(1, false), l1_ppf(true, "baseline = 'outside'", ""), sampled] {
        for (error, reopens) in [(1.9, true), (2.7, false)] {
            let mut run = made(&format!("{}on_funnel_exit = 'reopen'\n", law.text(0.0, KEY)));
            run.0.initialise().unwrap();
            run.step(1e-3);
            run.set("x[1]", error - TAU);
            if reopens {
                run.step(1e-3);
                run.step(1e-3);
                assert!(
                    run.get("rho[1]") >= 1.2 * error && run.get("rho[1]") < PI,
                    "{}: {}",
                    law.kind,
                    run.get("rho[1]")
                );
            } else {
                let refusal = match run.0.step(run.0.time(), 1e-3) {
                    Err(refusal) => refusal,
                    Ok(_) => run.failure(1e-3),
                };
                let refusal = refusal.to_string();
                assert!(
                    refusal.contains("rho[1] = 3.3") && refusal.contains("must be below 3.14"),
                    "{}: {refusal}",
                    law.kind
                );
            }
        }
    }
}

/// A composite integrates the error in place of the plant's angle: that turns, too.
#[test]
fn a_composite_turns_without_end_as_units_of_their_own_do() {
    let law = mrac_ppf("");
    let composite = |psi: f64, model: f64| {
        format!(
            "{}[structure]\nconnections = [['law.u[1]', 'plant.u[1]'], ['law.u[2]', 'plant.u[2]'], \
             ['plant.x[1]', 'law.x[1]'], ['plant.x[2]', 'law.x[2]']]\n[[structure.parts]]\nname = 'plant'\n\
             model = 'state-space'\n[structure.parts.structure]\nA = [[0.0, 0.55], [0.0, -0.9]]\nB = [[1.1, 0.0], [0.0, 1.0]]\n\
             C = [[1.0, 0.0], [0.0, 1.0]]\n[structure.parts.start]\nx0 = [{psi:?}, 0.0]\n[[structure.parts]]\nname = 'law'\n\
             model = 'mrac-ppf'\n[structure.parts.structure]\n{KEY}\n{}\n[structure.parts.start]\nx_m0 = [{model:?}, 0.0]\n{}\n\
             [start]\nrelative_tolerance = 1e-10\n",
            head("composite"),
            law.structure,
            law.start
        )
    };
    let turned = |psi: f64, model: f64, read: fn(f64) -> f64| {
        let (mut run, mut found) = (made(&composite(psi, model)), Vec::new());
        for k in 0..1600 {
            let t = f64::from(k) * 5e-3;
            run.set("law.r[1]", read(2.5 + 2.0 * t));
            if k == 0 {
                run.0.initialise().unwrap();
            }
            run.step(5e-3);
            found.push([run.get("plant.x[1]") - psi, run.get("law.u[1]")]);
        }
        found
    };
    let expected = turned(2.4, 2.4, |r| r);
    assert!(expected[1599][0] > 2.2 * TAU);
    for (psi, model, read) in
        [(2.4, 2.4, wrapped as fn(f64) -> f64), (2.4 + TAU, 2.4, wrapped), (2.4, 2.4, |r| r - TAU)]
    {
        let [of_psi, u] = apart(&turned(psi, model, read), &expected);
        assert!(of_psi < 1e-7 && u < 1e-6, "{of_psi} {u}");
    }
}
