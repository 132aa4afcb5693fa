//! Compiled C source of an FMU gives the same bits as its equations.

use std::path::{Path, PathBuf};
use std::process::Command;

use adaptive_fmu::fmi2::source;
use adaptive_fmu::framework::differentiation::{LARGEST_IN_C, jacobian};
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Block, Description, Model};
use adaptive_fmu::recording::{Method, Recording, Registers};
use adaptive_fmu::system::*;
use common::random::Random;
use common::sample::{sampled, sampled_names};
use common::{at_top, description, description_names};
use libloading::Library;

use crate::recording::{Draw, composites, same};

const WARNINGS: &[&str] =
    &["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wdouble-promotion", "-Werror"];

/// The runtime, and names for the functions of a unit's source, which has none outside.
const INCLUDED: [&str; 2] = ["crates/framework/src/fmi2/source/runtime", "crates/framework/tests/equations/source"];

/// Writes the files of a unit and compiles them with a compiler; the library.
fn compiled(model: &Model, folder: &Path, optimised: &str) -> PathBuf {
    std::fs::create_dir_all(folder).unwrap();
    for (name, text) in source::files(model).unwrap() {
        std::fs::write(folder.join(name), text).unwrap();
    }
    let library = folder.join("unit.so");
    let mut command = Command::new("cc");
    command.args(WARNINGS).args([optimised, "-ffp-contract=off", "-fPIC", "-shared", "-I"]).arg(folder);
    INCLUDED.iter().for_each(|included| _ = command.arg("-I").arg(at_top(included)));
    command.arg(at_top("crates/framework/tests/equations/source/harness.c")).arg("-o").arg(&library).arg("-lm");
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}: {}", folder.display(), String::from_utf8_lossy(&output.stderr));
    library
}

type Carry = unsafe extern "C" fn(i32, f64, f64, *const u8, *mut f64, *mut i32, *mut f64);

/// Functions of the harness in addition to those of methods, by their numbers.
const DIRECTIONAL: i32 = 9;
const JACOBIAN: i32 = 11;

/// Results of the C functions at a point, from initial results.
fn carried(library: &Library, function: i32, draw: &Draw, mut results: Vec<f64>) -> (Block, Vec<f64>) {
    let mut block = draw.block.clone();
    let crossed: Vec<u8> = draw.crossed.iter().map(|crossed| u8::from(*crossed)).collect();
    // SAFETY: the harness has this signature, and the arrays have the unit's sizes.
    unsafe {
        let carry = library.get::<Carry>(b"carry_out").unwrap();
        let (reals, integers) = (block.reals.as_mut_ptr(), block.integers.as_mut_ptr());
        carry(function, draw.time, draw.step, crossed.as_ptr(), reals, integers, results.as_mut_ptr());
    }
    (block, results)
}

/// The methods that give what the generic equations give, by the sections that they write.
const COMPARED: [Method; 6] = [
    Method::Evaluate,
    Method::ParametersChanged,
    Method::NextTimeEvent,
    Method::Indicators,
    Method::Event,
    Method::StepCompleted,
];

/// A folder of its own.
pub fn folder() -> tempfile::TempDir {
    let mut folder = tempfile::tempdir().unwrap();
    folder.disable_cleanup(std::env::var_os("KEEP_SOURCES").is_some());
    folder
}

pub fn compare(model: &Model, (points, optimised): (usize, &str), random: &mut Random, folder: &Path) {
    let name = &model.description().name;
    let library = compiled(model, &folder.join(name), optimised);
    // SAFETY: it has no code that runs when it is loaded.
    let library = unsafe { Library::new(library) }.unwrap();
    for _ in 0..points {
        let mut draw = Draw::new(model, random);
        // What the source has as constants.
        let mut prepared = model.start().clone();
        model.prepare(&mut prepared, &mut MessageLog::new()).unwrap();
        let range = model.variables().reals(Section::Prepared);
        draw.block.reals[range.clone()].copy_from_slice(&prepared.reals[range]);
        for method in COMPARED {
            let (expected, results) = draw.generic(model, method);
            let results_before = vec![1.0; draw.crossed.len().max(1)];
            let (found, found_results) = carried(&library, method as i32, &draw, results_before);
            for (place, (found, expected)) in found.reals.iter().zip(&expected.reals).enumerate() {
                assert!(same(*found, *expected), "{name}, {method:?}, real {place}: {found:e}, not {expected:e}");
            }
            assert_eq!(found.integers, expected.integers, "{name}, {method:?}");
            for (found, expected) in found_results.iter().zip(&results) {
                assert!(same(*found, *expected), "{name}, {method:?}: {found:e}, not {expected:e}");
            }
        }
        compare_derivatives(model, &library, &draw, random);
    }
}

/// Derivatives against those of the generic form: in a random direction, and the Jacobian.
fn compare_derivatives(model: &Model, library: &Library, draw: &Draw, random: &mut Random) {
    let (name, variables) = (&model.description().name, model.variables());
    let mut seed = vec![0.0; draw.block.reals.len()];
    let moved = [variables.reals(Section::Input), variables.reals(Section::State)];
    moved.iter().cloned().flatten().for_each(|place| seed[place] = random.next());
    let (mut expected, mut registers) = (seed.clone(), Registers::new());
    model.direction().carry_out(&draw.given(), draw.step, &mut expected, &mut registers);
    let (_, found) = carried(library, DIRECTIONAL, draw, seed);
    for place in variables.reals(Section::Signal).chain(variables.reals(Section::Derivative)) {
        let (found, expected) = (found[place], expected[place]);
        assert!(equal(found, expected), "{name}, change of {place}: {found:e}, not {expected:e}");
    }
    if variables.states() == 0 {
        return;
    }
    let expected = draw.jacobian(model, None);
    let (_, found) = carried(library, JACOBIAN, draw, vec![0.0; expected.len()]);
    let evaluate = Recording::of(model.system(), Method::Evaluate, &variables.layout());
    let is_by_entries = jacobian(variables, model.sparsity().columns(), evaluate, LARGEST_IN_C).is_some();
    for (place, (found, expected)) in found.into_iter().zip(expected).enumerate() {
        // By directions a change of zero that meets an infinite slope has no number.
        let is_same = equal(found, expected) || found.is_nan() && !is_by_entries;
        assert!(is_same, "{name}, Jacobian {place}: {found:e}, not {expected:e}");
    }
}

/// The same number, where zero has no sign; or none at all.
fn equal(found: f64, expected: f64) -> bool {
    found == expected || found.is_nan() && expected.is_nan()
}

#[test]
fn the_source_of_all_units_gives_the_bits_of_the_equations() {
    let mut random = Random::new(26);
    let folder = folder();
    for name in sampled(sampled_names()) {
        let model = Model::from_description(Description::read(&description(&name)).unwrap(), REGISTRY).unwrap();
        compare(&model, (100, "-O1"), &mut random, folder.path());
    }
}

/// Parameters that are a matrix where units of this package have a list.
#[test]
fn the_source_of_a_unit_with_bounds_of_single_elements_gives_the_bits_of_the_equations() {
    let text = description("L1NonlinearSiso").replace("theta_bound = [10.0]", "theta_bound = [[0.2, 0.5]]");
    let model = Model::from_description(Description::read(&text).unwrap(), REGISTRY).unwrap();
    assert!(model.variables().find("theta_bound[1,2]").is_some());
    compare(&model, (100, "-O1"), &mut Random::new(28), folder().path());
}

#[test]
fn the_source_of_all_composites_gives_the_bits_of_the_equations() {
    let mut random = Random::new(27);
    let folder = folder();
    for model in sampled(composites()) {
        // Large sources take a compiler long to optimise.
        compare(&model, (20, "-O0"), &mut random, folder.path());
    }
}

/// Laws by how the names of their units begin, and how what they cite does.
const LAWS: [(&str, &str); 9] = [
    ("L1Sampled", "Hovakimyan and Cao"),
    ("L1", "Hashim ("),
    ("Fuzzy", "Hashim ("),
    ("MracPpf", "Hashim ("),
    ("Mrac", "Lavretsky and Wise"),
    ("Neuro", "Hashim ("),
    ("Observer", "Hashim ("),
    ("Ladrc", "Herbst"),
    ("Funnel", "Berger"),
];

#[test]
fn equations_are_shown_with_their_source() {
    for name in description_names() {
        let model = Model::from_description(Description::read(&description(&name)).unwrap(), REGISTRY).unwrap();
        let files = source::files(&model).unwrap();
        let unit = &files.iter().find(|(file, _)| file == "unit.c").unwrap().1;
        let evaluate = unit.split("static void unit_evaluate(").nth(1).unwrap().split("\n}\n").next().unwrap();
        let cited: Vec<&str> =
            model.variables().iter().map(|variable| variable.source).filter(|s| !s.is_empty()).collect();
        cited.iter().for_each(|source| assert!(evaluate.contains(&format!("; /* {source} */")), "{name}: {source}"));
        let whose = LAWS.iter().find(|(law, _)| name.starts_with(law));
        assert!(whose.is_none_or(|(_, source)| cited.iter().any(|s| s.starts_with(source))), "{name}: {cited:?}");
    }
}
