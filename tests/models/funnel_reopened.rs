//! A funnel that opens to an error that leaves it.

use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use common::models::Run;
use common::random::Random;

const PSI: [f64; 3] = [2.0, 0.5, 1.0];

fn unit(degree: usize, form: &str, start: &str) -> Run {
    let [psi_0, psi_inf, l] = PSI;
    let text = format!(
        "name = 'Test'\nmodel = 'funnel'\ndescription = ''\n[structure]\nchannels = 2\nrelative_degree = {degree}\nform = \
         '{form}'\n[start]\npsi_0 = [{psi_0}, {psi_0}]\npsi_inf = [{psi_inf}, {psi_inf}]\ndecay_rate = [{l}, \
         {l}]\non_funnel_exit = 'reopen'\n{start}"
    );
    let description = Description::read(&text).unwrap();
    let mut run = Run(Execution::new(Model::from_description(description, REGISTRY).unwrap()));
    run.0.initialise().unwrap();
    run
}

/// ψ at a time after it was so wide.
fn bound(opened_to: f64, since: f64) -> f64 {
    let [_, psi_inf, l] = PSI;
    (opened_to - psi_inf) * (-l * since).exp() + psi_inf
}

fn parts(run: &Run, channel: usize, levels: usize) -> Vec<f64> {
    (1..=levels).map(|level| run.get(&format!("e_part[{channel},{level}]")).abs()).collect()
}

#[test]
fn it_opens_to_more_than_the_error_and_closes_again_at_its_rate() {
    let mut run = unit(1, "filtered_error", "");
    run.step(1.0);
    assert_eq!(run.integer("funnel_reopened"), 0);
    let before = run.get("psi[2]");
    run.set("y[1]", -7.0);
    run.step(1e-9);
    assert!((run.get("psi[1]") - 1.25 * 7.0).abs() < 1e-6 && (parts(&run, 1, 1)[0] - 0.8).abs() < 1e-6);
    assert!((run.get("psi[2]") - before).abs() < 1e-6, "the other channel's stays");
    run.set("y[1]", 0.1);
    run.step(0.7);
    assert!((run.get("psi[1]") - bound(8.75, 0.7)).abs() < 1e-6, "{}", run.get("psi[1]"));
    // A small error that leaves the narrow funnel opens it to what it ends at, at least.
    run.run(20, 1.0);
    run.set("y[1]", 0.501);
    run.step(1e-9);
    assert!((run.get("psi[1]") - 1.25 * 0.501).abs() < 1e-6 && run.integer("funnel_reopened") == 2);
    let messages: Vec<_> =
        run.0.take_messages().map(|message| message.text).filter(|text| text.contains("re-opened")).collect();
    assert_eq!(messages.len(), 1, "warned once: {messages:?}");
    for word in ["e[1] = -7", "re-opened to 8.75", "t = 1 s", "funnel_reopened"] {
        assert!(messages[0].contains(word), "{word}: {messages:?}");
    }
}

#[test]
fn after_it_the_errors_of_all_levels_are_well_inside_wherever_they_were() {
    let mut random = Random::new(5);
    let mut reopened = 0;
    for (form, degree, start) in [
        ("filtered_error", 2, "tau = [0.3, 0.3]"),
        ("filtered_error", 3, "tau = [0.3, 0.1]"),
        ("two_funnels", 2, "g_0 = [2.0, 2.0]\npsi_0_second = [5.0, 5.0]\npsi_inf_second = [3.0, 3.0]"),
    ] {
        for _ in 0..40 {
            let mut run = unit(degree, form, start);
            run.step(0.3);
            let size = 10_f64.powf(2.0 * random.next());
            for name in ["y", "dy", "ddy"].iter().take(degree) {
                run.set(&format!("{name}[1]"), size * random.next());
            }
            run.step(1e-9);
            let all = parts(&run, 1, degree.min(3));
            assert!(all.iter().all(|part| *part < 1.0), "{form} {degree}: {all:?}");
            if run.integer("funnel_reopened") > 0 {
                reopened += 1;
                assert!(all.iter().all(|part| *part <= 0.8 + 1e-6), "{form} {degree}: {all:?}");
            }
            assert!(run.get("u[1]").is_finite());
        }
    }
    assert!((20..115).contains(&reopened), "some left, some did not: {reopened}");
}

#[test]
fn by_hand_it_stays_as_it_is_and_a_start_outside_is_refused_all_the_same() {
    let mut run = unit(1, "filtered_error", "");
    run.set_boolean("enabled", false);
    run.step(0.1);
    run.set("y[1]", 50.0);
    run.step(0.1);
    assert_eq!(run.integer("funnel_reopened"), 0);
    run.set("y[1]", 0.0);
    run.set("r[1]", 3.0);
    run.set_boolean("enabled", true);
    let reason = run.failure(0.01).to_string();
    assert!(reason.contains("e[1] = -3") && reason.contains("psi[1]"), "{reason}");
}
