//! Claims of `report` about the thesis: each concerns a metric of its runs.

use adaptive_fmu::reproduction::{Figure, Outcome, Run, Study};
use adaptive_fmu::structure::{LoopFiles, Structure};

fn structure(run: &Run) -> Structure {
    LoopFiles::find(&run.name).unwrap().structure().unwrap()
}

#[test]
fn every_claim_is_about_a_metric_of_a_run_of_its_example() {
    for example in Study::thesis().unwrap().example {
        let before: Vec<_> = example.run.iter().map(|run| Outcome::before(&run.key(), &structure(run))).collect();
        assert!(!example.claim.is_empty(), "{} claims nothing", example.name);
        for claim in &example.claim {
            let judged = claim.judge(&before).unwrap_or_else(|reason| panic!("{}: {reason}", example.name));
            // What hasn't been run holds nothing, unless it is to fail.
            assert!(!judged.holds, "{}: {} holds without a run", example.name, claim.text);
        }
    }
}

#[test]
fn every_figure_is_of_runs_of_its_example() {
    for example in Study::thesis().unwrap().example {
        let structures: Vec<_> = example.run.iter().map(structure).collect();
        let (runs, figures) = (example.run.iter().map(Run::key), Figure::all(&example, &structures));
        let runs: Vec<_> = runs.collect();
        let shows = |figure: &Figure| figure.needs().count() > 0 || !figure.lines.is_empty();
        assert!(figures.iter().all(|figure| shows(figure) && !figure.title.is_empty()));
        for curve in figures.iter().flat_map(Figure::needs) {
            assert!(runs.contains(&curve.run), "{}: no run `{}`", example.name, curve.run);
        }
    }
}

#[test]
fn an_example_whose_name_would_lead_elsewhere_is_refused_by_it() {
    for name in ["../3.2.1", "a/b", "", "<b>"] {
        let text = format!(
            "title = 't'\nabout = ''\n[[example]]\nname = '{name}'\ntitle = ''\nabout = ''\nrun = []\nclaim = []"
        );
        let refused = Study::read(&text).unwrap_err();
        assert!(refused.contains(&format!("name = `{name}`")), "{refused}");
    }
}

#[test]
fn examples_are_chosen_by_the_beginning_of_their_names() {
    let chosen = |names: &[&str]| -> Vec<String> {
        let names: Vec<_> = names.iter().map(|name| (*name).to_owned()).collect();
        Study::thesis().unwrap().only(&names).unwrap().example.into_iter().map(|example| example.name).collect()
    };
    assert_eq!(chosen(&["3.3"]), ["3.3.1", "3.3.2", "3.3.3"]);
    assert_eq!(chosen(&["7.5.2", "4"]), ["4", "7.5.2"]);
    assert_eq!(chosen(&[]).len(), 13);
}
