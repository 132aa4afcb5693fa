//! Many runs at a time on a device of OpenCL: the same values as those of the FMU with fixed steps. The device is pocl's, a
//! processor; without it nothing is tested.

use adaptive_fmu::ensemble::{Device, Runner};
use adaptive_fmu::fmu::{Ready, Value};
use adaptive_fmu::simulation::{LoadedLoop, Place, Recording};
use adaptive_fmu::structure::{LoopFiles, Settings, Whole};
use common::loops::loop_names;
use common::sample::sampled;

/// Fixed steps in a communication step that are tried: an FMU's run must be near that with twice as many. With fewer, a loop at the limit
/// of stability may have signals that rounding decides.
const SUBSTEPS: [usize; 5] = [4, 8, 16, 32, 64];
const NEAR: f64 = 1e-2;
/// Communication steps, and the largest difference in parts of a signal's magnitude.
const STEPS: f64 = 200.0;
const DIFFERENCE: f64 = 1e-9;

struct Case {
    loaded: LoadedLoop,
    settings: Settings,
}

impl Case {
    /// A loop as one system; none if it can't be that.
    fn of(name: &str, ready: &Ready) -> Option<Self> {
        let structure = LoopFiles::find(name).unwrap().structure().unwrap();
        let whole = Whole::new(&structure, ready.library()).ok()?;
        let fmu = ready.fmu(&whole.source).unwrap();
        let loaded = LoadedLoop::whole(name, fmu, &whole.values, whole.notes).unwrap();
        let loaded = loaded.recording(structure.signals()).with_events(&structure.events).unwrap();
        let (start_time, step) = (structure.start_time, structure.step);
        let stop_time = (start_time + STEPS * step).min(structure.stop_time);
        Some(Case { loaded, settings: Settings { start_time, stop_time, step } })
    }

    /// The FMU with fixed steps from these values; none where it doesn't reach its end.
    fn by_fmu(&self, values: &[(Place, Value)], substeps: usize) -> Option<Recording> {
        let integer = |name: &str, value: usize| {
            let (place, _) = self.loaded.variable(name).unwrap();
            (place, Value::Integer(value as i32))
        };
        let (_, method) = self.loaded.variable("integration_method").unwrap();
        let fixed = method.items.iter().find(|(name, _)| name == "fixed").unwrap().1;
        let further = [integer("integration_method", fixed as usize), integer("fixed_steps", substeps)];
        let closed = self.loaded.instantiate_with(&[values, &further].concat()).ok()?;
        closed.run(self.settings, |_| true).ok()
    }
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most, value| most.max(value.abs()))
}

/// The largest difference of a run's signals in parts of their magnitudes, and whose it is.
fn difference<'a>(one: &'a Recording, other: &Recording) -> (f64, &'a str) {
    assert_eq!((one.times.len(), &one.names), (other.times.len(), &other.names));
    let of = |((one, other), name): ((&Vec<f64>, &Vec<f64>), &'a String)| {
        let differences: Vec<f64> = one.iter().zip(other).map(|(a, b)| a - b).collect();
        assert!(differences.iter().all(|it| it.is_finite()), "{name}");
        (largest(&differences) / largest(other).max(1e-9), name.as_str())
    };
    let all = one.columns.iter().zip(&other.columns).zip(&one.names).map(of);
    all.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
}

#[test]
fn runs_on_a_device_are_those_of_the_fmu_with_fixed_steps() {
    let device = || Device::chosen(Some("Portable Computing Language"));
    if let Err(reason) = device() {
        println!("skipped: {reason}");
        return;
    }
    let ready = Ready::new().unwrap();
    let (mut compared, mut wrong) = (0, Vec::new());
    // Each is compiled for the device: of those of a sample every third.
    let all = std::env::var("TEST_ALL").is_ok_and(|all| all == "1");
    for name in sampled(loop_names()).into_iter().step_by(if all { 1 } else { 3 }) {
        let Some(case) = Case::of(&name, &ready) else { continue };
        let names = case.loaded.signals().names;
        let varied = case.loaded.tunable().into_iter().find_map(|name| {
            let (place, _) = case.loaded.variable(&name)?;
            let value = case.loaded.start_of(place).filter(|value| *value != 0.0)?;
            let values = vec![(place, Value::Real(1.01 * value))];
            case.loaded.instantiate_with(&values).ok().map(|_| values)
        });
        let samples: Vec<Vec<(Place, Value)>> = std::iter::once(Vec::new()).chain(varied).collect();
        let all: Vec<_> = samples.iter().map(|values| (values.clone(), Vec::new())).collect();
        let runner = Runner::new(device().unwrap(), &case.loaded, &names, &all, case.settings);
        let runner = runner.unwrap_or_else(|reason| panic!("{name}: {reason}"));
        let starts: Vec<_> = samples.iter().filter_map(|values| runner.start(values, &[])).collect();
        assert_eq!(starts.len(), samples.len(), "{name}");
        let is_near = |substeps: &&usize| {
            let runs = [1, 2].map(|times| case.by_fmu(&samples[0], times * **substeps));
            matches!(&runs, [Some(one), Some(finer)] if difference(one, finer).0 <= NEAR)
        };
        let Some(&substeps) = SUBSTEPS.iter().find(is_near) else {
            println!("{name}: needs more fixed steps");
            continue;
        };
        let mut found =
            vec![Recording { columns: vec![Vec::new(); names.len()], names, ..Recording::default() }; samples.len()];
        let complete = runner.run(&starts, substeps, |rows| {
            for (run, found) in found.iter_mut().enumerate() {
                rows.add_to(found, run);
            }
            true
        });
        let complete = complete.unwrap().unwrap();
        for ((values, found), complete) in samples.iter().zip(&found).zip(complete) {
            let expected = case.by_fmu(values, substeps);
            assert_eq!(complete, expected.is_some(), "{name}");
            let Some(expected) = expected else { continue };
            let (difference, signal) = difference(found, &expected);
            println!("{name}, {substeps} fixed steps: {difference:.1e} in {signal}");
            if difference > DIFFERENCE {
                wrong.push(format!("{name}: {difference:e} in {signal}"));
            }
            compared += 1;
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(compared >= 2, "{compared} runs were compared");
}
