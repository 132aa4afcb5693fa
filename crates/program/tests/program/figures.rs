//! Figures of tracking: references are dashed, beneath, in the colour of their signals; no two curves look alike.

use std::collections::HashSet;
use std::time::Duration;

use adaptive_fmu::exporter;
use adaptive_fmu::figures::Diagram;
use adaptive_fmu::reproduction::{Curve, Figure, Outcome, Run, Study};
use adaptive_fmu::results::{Comparison, Ending, Report};
use adaptive_fmu::simulation::Recording;
use adaptive_fmu::structure::{LoopFiles, Settings, Structure};

const SETTINGS: Settings = Settings { start_time: 0.0, stop_time: 1.0, step: 0.1 };

fn structure(name: &str) -> Structure {
    LoopFiles::find(name).unwrap().structure().unwrap()
}

/// A recording that holds these signals, each once, and the ideal models of the loop.
fn recording<'a>(structure: &Structure, signals: impl Iterator<Item = &'a str>) -> Recording {
    let models = structure.models.iter().map(|model| model.name.clone());
    let mut names: Vec<String> = signals.map(str::to_owned).chain(models).collect();
    names.sort();
    names.dedup();
    let times: Vec<f64> = (0..11).map(|k| f64::from(k) * 0.1).collect();
    let columns = (0..names.len()).map(|k| times.iter().map(|time| time + k as f64).collect()).collect();
    Recording { measures: vec![String::new(); names.len()], names, times, columns, ..Recording::default() }
}

fn report<'a>(structure: &'a Structure, recording: &'a Recording) -> Report<'a> {
    Report {
        structure,
        settings: SETTINGS,
        whole: false,
        recording,
        measured: &[],
        ending: &Ending::Complete,
        thinned: None,
    }
}

fn assert_distinct(of: &str, diagram: &Diagram) {
    let styles: HashSet<_> = diagram.curves.iter().map(|curve| (curve.style.colour, &curve.style.dashes)).collect();
    assert_eq!(styles.len(), diagram.curves.len(), "{of}, {}: two curves look the same", diagram.title);
}

#[test]
fn no_two_curves_of_a_loop_s_figures_look_the_same_and_references_are_dashed() {
    let mut dashed = 0;
    for (name, _) in exporter::loops() {
        let structure = structure(name);
        let recording = recording(&structure, structure.signals());
        for diagram in report(&structure, &recording).diagrams().unwrap() {
            assert_distinct(name, &diagram);
            for curve in &diagram.curves {
                let style = &curve.style;
                assert_eq!(style.beneath, !style.dashes.is_empty(), "{name}: {}", curve.name);
                // By the names that these loops happen to have: the program goes by their structure.
                let own = ["plant.y", "controller.u", "|"].iter().any(|beginning| curve.name.starts_with(beginning));
                let reference = ["reference.", "y_m", "x_m", "funnel", "controller.angle_ref"];
                let reference = reference.iter().any(|beginning| curve.name.starts_with(beginning));
                assert!(!own || !style.beneath, "{name}: {} is dashed", curve.name);
                assert!(!reference || style.beneath, "{name}: {} is solid", curve.name);
                dashed += usize::from(style.beneath);
            }
        }
    }
    assert_eq!(exporter::loops().len(), 32);
    assert!(dashed > 60, "{dashed}");
}

#[test]
fn a_reference_has_the_colour_of_the_signal_that_follows_it() {
    for (name, pairs) in [
        ("3.2.1-cosine", &[("plant.y[1]", "y_m"), ("plant.y[1]", "reference.r[1]")][..]),
        ("3.3.3", &[("plant.y[2]", "reference.r[2]"), ("plant.y[6]", "reference.r[6]")]),
        ("3.3.2-case1", &[("plant.x[7]", "controller.angle_reference[1]"), ("plant.x[9]", "reference.r[4]")]),
        ("6.5.1-mrac", &[("plant.x[3]", "x_m3")]),
        ("7.5.3-case1", &[("observer.x_obs[5]", "plant.x[11]")]),
    ] {
        let structure = structure(name);
        let recording = recording(&structure, structure.signals());
        let report = report(&structure, &recording);
        let diagrams = report.diagrams().unwrap();
        for (own, reference) in pairs {
            let style = |signal: &str, diagram: &Diagram| {
                diagram.curves.iter().find(|curve| curve.name == *signal).map(|curve| curve.style.clone())
            };
            let found = diagrams.iter().find_map(|diagram| style(own, diagram).zip(style(reference, diagram)));
            let (own, reference) = found.unwrap_or_else(|| panic!("{name}: {own} and {reference} in one diagram"));
            assert_eq!((own.colour, own.beneath, reference.beneath), (reference.colour, false, true), "{name}");
        }
    }
}

#[test]
fn no_two_curves_of_a_figure_of_the_report_look_the_same() {
    for example in Study::thesis().unwrap().example {
        let structures: Vec<_> = example.run.iter().map(|run| structure(&run.name)).collect();
        let figures = Figure::all(&example, &structures);
        let needs: Vec<&Curve> = figures.iter().flat_map(Figure::needs).collect();
        let outcome = |(run, structure): (&Run, &Structure)| {
            let key = run.key();
            let of_run = needs.iter().filter(|curve| curve.run == key);
            let signals = of_run.flat_map(|curve| [Some(&curve.of), curve.minus.as_ref()]).flatten();
            let recording = recording(structure, signals.map(String::as_str));
            Outcome::new(&key, &report(structure, &recording), Duration::ZERO, &needs).unwrap()
        };
        let outcomes: Vec<_> = example.run.iter().zip(&structures).map(outcome).collect();
        for (k, figure) in figures.iter().enumerate() {
            let drawing = figure.draw(format!("{}-{k}", example.name), &outcomes).unwrap();
            assert!(drawing.svg.contains("<path") && !drawing.csv.is_empty(), "{}", figure.title);
            if figure.paths.is_empty() {
                assert_distinct(&example.name, &figure.diagram(&outcomes).unwrap());
            }
        }
        for title in example.thesis_figures.keys() {
            assert!(figures.iter().any(|figure| figure.title == *title), "{}: no figure `{title}`", example.name);
        }
    }
}

#[test]
fn loops_that_are_compared_have_a_colour_each_and_the_reference_is_black() {
    let names = ["6.5.1-mrac", "6.5.1-neuro", "6.5.1-l1"];
    let structures = names.map(structure);
    let recordings = structures.each_ref().map(|structure| recording(structure, structure.signals()));
    let runs = structures.iter().zip(&recordings).map(|(structure, recording)| report(structure, recording)).collect();
    let labels = names.map(str::to_owned).to_vec();
    let comparison = Comparison { runs, labels };
    let diagrams = comparison.diagrams().unwrap();
    assert!(diagrams.len() >= 6 && diagrams.iter().any(|diagram| diagram.decades.is_some()));
    for diagram in &diagrams {
        assert_distinct("compare", diagram);
        let dashed = diagram.curves.iter().filter(|curve| curve.style.beneath);
        assert!(dashed.clone().all(|curve| curve.style.colour == "#000000"), "{}", diagram.title);
    }
}
