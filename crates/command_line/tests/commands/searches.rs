//! Searches of a loop's parameters.

use std::process::Command;

use adaptive_fmu::fmu::Hosting;
use adaptive_fmu::simulation::LoadedLoop;
use adaptive_fmu::structure::{LoopFiles, Settings, TunedParameter};
use adaptive_fmu::tuning::{Best, Motion, Objective, Outcome, Search, Swarm};

const LOOP: &str = "3.2.1-cosine";

/// A search through separate units for what is minimised.
fn search(objective: Objective) -> Search {
    let folder = tempfile::tempdir().unwrap();
    let mut program = Command::new(env!("CARGO_BIN_EXE_adaptive-fmu"));
    let structure = LoopFiles::find(LOOP).unwrap().structure().unwrap();
    let units = structure.components.iter().map(|component| component.fmu.clone());
    let done = program.arg("export").args(units).arg("--out").arg(folder.path()).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let settings = Settings { start_time: 0.0, stop_time: 5.0, step: 0.01 };
    let loaded = LoadedLoop::new(&structure, folder.path(), &Hosting::InProcess).unwrap();
    let between =
        |name: &str, low: f64, high: f64| TunedParameter { name: name.into(), low: Some(low), high: Some(high) };
    let parameters =
        [between("controller.feedback_gain[1,1]", 2.0, 40.0), between("controller.adaptation_gain", 1e2, 1e5)];
    Search::new(structure, settings, objective, &parameters, vec![loaded]).unwrap()
}

/// End of a swarm, its best position, and the values of all runs; runs end at bounds, or are complete.
fn found(search: &Search, with_bounds: bool) -> (Vec<Vec<f64>>, Best, Vec<f64>) {
    let bounds = search.ranges().iter().map(|range| (range.low, range.high)).collect();
    let mut swarm = Swarm::new(6, bounds, search.start(), Motion::default(), 3);
    let mut all = Vec::new();
    for _ in 0..5 {
        let bounds = if with_bounds { swarm.bounds_of_values() } else { vec![f64::INFINITY; 6] };
        let outcomes = search.run(&swarm.positions(), &bounds, |_| (), || false);
        let values: Vec<Option<f64>> = outcomes.iter().map(Outcome::value).collect();
        all.extend(values.iter().map(|value| value.unwrap()));
        swarm.tell(&values);
    }
    (swarm.positions().into_iter().map(<[f64]>::to_vec).collect(), swarm.best().unwrap().clone(), all)
}

#[test]
fn runs_that_end_as_soon_as_they_can_be_no_better_change_no_search() {
    let terms = ["1 reference.r[1] - plant.y[1]", "1e-1 controller.u[1]"].map(|term| term.parse().unwrap()).to_vec();
    let largest = LoopFiles::find(LOOP).unwrap().structure().unwrap().metrics.last().unwrap().label.clone();
    assert!(largest.starts_with("max"), "{largest}");
    for objective in [Objective::Squares { terms, sample: 0.01 }, Objective::Metric(largest)] {
        let search = search(objective);
        let (whole, best, of_whole) = found(&search, false);
        let (positions, found_best, values) = found(&search, true);
        assert_eq!((positions, found_best), (whole, best));
        // Some ended before, below their final values, and no value exceeds its final one.
        let ended = values.iter().zip(&of_whole).filter(|(value, whole)| **value < 0.99 * **whole).count();
        let none_more = values.iter().zip(&of_whole).all(|(value, whole)| *value <= whole * (1.0 + 1e-12));
        assert!(ended > 3 && none_more, "{ended}: {values:?} {of_whole:?}");
    }
}
