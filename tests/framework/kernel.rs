//! Compiled equations take the place of the generic ones while a unit runs: they must give the same bits, at any parameters.

use std::path::Path;
use std::process::Command;

use adaptive_fmu::execution::Execution;
use adaptive_fmu::fmi2::source::kernel::{self, ENTRY};
use adaptive_fmu::kernel::Kernel;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::system::*;
use common::description;
use common::random::Random;
use common::sample::{sampled, sampled_names};
use libloading::Library;

use crate::recording::{Draw, same, whole_loops};

/// A compiled kernel, and the library that it is of.
fn compiled(model: &Model, folder: &Path, optimised: &str) -> (Kernel, Library) {
    let name = &model.description().name;
    let (source, library) = (folder.join(format!("{name}.c")), folder.join(format!("{name}.so")));
    std::fs::write(&source, kernel::text(model).unwrap()).unwrap();
    let mut command = Command::new("cc");
    command.args(["-std=c99", "-Wall", "-Wextra", "-Werror", optimised, "-ffp-contract=off", "-fPIC", "-shared"]);
    let output = command.arg(source).arg("-o").arg(&library).arg("-lm").output().unwrap();
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    // SAFETY: it has no code that runs when it is loaded, and its one function this type.
    unsafe {
        let library = Library::new(library).unwrap();
        let kernel = *library.get::<unsafe extern "C" fn() -> *const Kernel>(ENTRY).unwrap()();
        (kernel, library)
    }
}

fn compare(model: &Model, (points, optimised): (usize, &str), random: &mut Random, folder: &Path) {
    let (name, variables) = (&model.description().name, model.variables());
    let (kernel, _library) = compiled(model, folder, optimised);
    assert!(kernel.fits(variables, model.sparsity().entries()), "{name}");
    for _ in 0..points {
        let draw = Draw::new(model, random);
        let Draw { time, block, .. } = &draw;
        for with_rates in [false, true] {
            let (mut expected, mut found) = (block.clone(), block.clone());
            if with_rates {
                model.equations().evaluate(*time, &mut expected.reals, &expected.integers, variables.offsets());
                kernel.evaluate(*time, &mut found.reals, &found.integers);
            } else {
                model.equations().outputs(*time, &mut expected.reals, &expected.integers, variables.offsets());
                kernel.outputs(*time, &mut found.reals, &found.integers);
            }
            for (place, (found, expected)) in found.reals.iter().zip(&expected.reals).enumerate() {
                assert!(same(*found, *expected), "{name}, real {place}: {found:e}, not {expected:e}");
            }
            assert_eq!(found.integers, expected.integers, "{name}");
        }
        compare_jacobian(model, &kernel, &draw, random);
    }
}

/// The kernel's derivatives are those of the generic form: neither rounding nor order is another.
fn compare_jacobian(model: &Model, kernel: &Kernel, draw: &Draw, random: &mut Random) {
    let (name, variables, sparsity) = (&model.description().name, model.variables(), model.sparsity());
    let mut entries = vec![0.0; sparsity.entries()];
    let mut by_time = vec![0.0; variables.states()];
    let slopes: Vec<f64> = variables.reals(Section::Input).map(|_| random.next()).collect();
    let block = (&*draw.block.reals, &*draw.block.integers);
    if !kernel.jacobian(draw.time, block, Some(&slopes), &mut entries, &mut by_time) {
        // Neuro laws have too many weights for it.
        assert!(variables.states() == 0 || variables.states() > 30, "{name}: {}", variables.states());
        return;
    }
    let found = entries.iter().chain(&by_time);
    for (place, (found, expected)) in found.zip(draw.jacobian(model, Some(&slopes))).enumerate() {
        assert!(same(*found, expected), "{name}, Jacobian {place}: {found:e}, not {expected:e}");
    }
}

/// The same steps by generic and by compiled equations, with the stiff method, which solves linear equations.
fn compare_steps(mut description: Description, folder: &Path) {
    let name = description.name.clone();
    description.start.insert("integration_method".to_owned(), "stiff".into());
    let model = Model::from_description(description, REGISTRY).unwrap();
    let (kernel, _library) = compiled(&model, folder, "-O1");
    let model = std::sync::Arc::new(model);
    let [mut generic, mut compiled] = [(); 2].map(|()| Execution::new(std::sync::Arc::clone(&model)));
    assert!(compiled.take_kernel(kernel));
    [&mut generic, &mut compiled].into_iter().for_each(|unit| unit.initialise().unwrap());
    let step = model.description().experiment.step;
    for k in 0..50 {
        let [one, other] = [&mut generic, &mut compiled].map(|unit| unit.step(f64::from(k) * step, step));
        assert_eq!(one.is_ok(), other.is_ok(), "{name}, step {k}: {one:?}, {other:?}");
        let equal = generic.block().reals.iter().zip(&compiled.block().reals).all(|(a, b)| same(*a, *b));
        assert!(equal && generic.block().integers == compiled.block().integers, "{name}, step {k}");
        if one.is_err() {
            return;
        }
    }
}

#[test]
fn stiff_steps_by_kernels_have_the_bits_of_generic_ones() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["NonlinearSiso", "L1TwoLinkRobot", "L1Quadrotor", "L1CoupledMimo", "MaresAuv"] {
        compare_steps(Description::read(&description(name)).unwrap(), folder.path());
    }
    let wanted = ["Loop_3_3_1_case2", "Loop_3_4_2", "Loop_4_case1_fuzzy"];
    whole_loops().into_iter().filter(|m| wanted.contains(&&*m.description().name)).for_each(|model| {
        compare_steps(model.description().clone(), folder.path());
    });
}

#[test]
fn the_kernels_of_all_units_give_the_bits_of_the_equations() {
    let mut random = Random::new(28);
    let folder = tempfile::tempdir().unwrap();
    for name in sampled_names() {
        let model = Model::from_description(Description::read(&description(&name)).unwrap(), REGISTRY).unwrap();
        compare(&model, (100, "-O1"), &mut random, folder.path());
    }
}

#[test]
fn the_kernels_of_all_whole_loops_give_the_bits_of_the_equations() {
    let mut random = Random::new(29);
    let folder = tempfile::tempdir().unwrap();
    // Large sources take a compiler long to optimise.
    sampled(whole_loops()).iter().for_each(|model| compare(model, (20, "-O0"), &mut random, folder.path()));
}

#[test]
fn a_kernel_of_another_model_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let model = |name| Model::from_description(Description::read(&description(name)).unwrap(), REGISTRY).unwrap();
    let (kernel, _library) = compiled(&model("TwoLinkRobot"), folder.path(), "-O0");
    assert!(!Execution::new(model("Quadrotor")).take_kernel(kernel));
    assert!(Execution::new(model("TwoLinkRobot")).take_kernel(kernel));
}
