//! Compiled equations take the place of the generic ones while a unit runs: they must give the same bits, at any parameters.

use adaptive_fmu::execution::{Execution, Settled};
use adaptive_fmu::fmi2::describe::{self, read_kernel};
use adaptive_fmu::fmi2::kernel::Functions;
use adaptive_fmu::jit;
use adaptive_fmu::kernel::Kernel;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::system::*;
use common::description;
use common::random::Random;
use common::sample::{sampled, sampled_names};

use crate::recording::{Draw, composites, same};

/// A compiled kernel, as the program makes it.
fn compiled(model: &Model) -> jit::Compiled {
    let text = describe::kernel(Functions::of(model, Settled::default()));
    jit::Compiled::of(&read_kernel(&text).unwrap().unwrap()).unwrap()
}

/// A kernel that is compiled for the parameters of a block.
fn folded(model: &Model, settled: &Settled) -> jit::Compiled {
    let text = describe::kernel(Functions::of(model, settled.clone()));
    jit::Compiled::of(&read_kernel(&text).unwrap().unwrap()).unwrap()
}

/// The same as [`compare`], of kernels that are compiled for the parameters of each block.
pub fn compare_folded(model: &Model, random: &mut Random) {
    let (name, variables) = (&model.description().name, model.variables());
    for _ in 0..2 {
        let draw = Draw::new(model, random);
        let Draw { time, block, .. } = &draw;
        let settled = Settled::of(model, block);
        let compiled = folded(model, &settled);
        let (mut expected, mut found) = (block.clone(), block.clone());
        model.equations().evaluate(*time, &mut expected.reals, &expected.integers, variables.offsets());
        compiled.kernel().evaluate(*time, &mut found.reals, &found.integers);
        for (place, (found, expected)) in found.reals.iter().zip(&expected.reals).enumerate() {
            assert!(same(*found, *expected), "{name}, folded, real {place}: {found:e}, not {expected:e}");
        }
        compare_jacobian(model, (compiled.kernel(), true), &draw, random);
        assert!(compiled.kernel().holds(&block.reals, &block.integers));
    }
}

pub fn compare(model: &Model, points: usize, random: &mut Random) {
    let (name, variables) = (&model.description().name, model.variables());
    let compiled = compiled(model);
    let first = jit::Compiled::evaluation(&Functions::of(model, Settled::default()).unwrap()).unwrap();
    let kernel = compiled.kernel();
    assert!(kernel.fits(variables, model.sparsity().entries()), "{name}");
    assert!(first.kernel().fits(variables, model.sparsity().entries()) && first.kernel().factors().is_none());
    for _ in 0..points {
        let draw = Draw::new(model, random);
        let Draw { time, block, .. } = &draw;
        for (with_rates, kernel) in [(false, kernel), (true, kernel), (false, first.kernel()), (true, first.kernel())] {
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
        compare_jacobian(model, (kernel, false), &draw, random);
    }
}

/// The kernel's derivatives are those of the generic form: neither rounding nor order is another. A zero may have another sign
/// where parameters are folded in. Where such a parameter is a 0 that something is divided by, out of its range, the generic form
/// may have 0 · ∞ in a sum, which folding leaves out.
fn compare_jacobian(model: &Model, (kernel, is_folded): (&Kernel, bool), draw: &Draw, random: &mut Random) {
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
        let is_same = *found == expected || expected.is_nan() && (found.is_nan() || is_folded);
        assert!(is_same, "{name}, Jacobian {place}: {found:e}, not {expected:e}");
    }
}

/// The same steps by generic and by compiled equations, with the stiff method, which solves linear equations.
fn compare_steps(mut description: Description) {
    let name = description.name.clone();
    description.start.insert("integration_method".to_owned(), "stiff".into());
    let model = Model::from_description(description, REGISTRY).unwrap();
    let kernel = compiled(&model);
    let model = std::sync::Arc::new(model);
    let [mut generic, mut unit, mut own] = [(); 3].map(|()| Execution::new(std::sync::Arc::clone(&model)));
    assert!(unit.take_kernel(*kernel.kernel()));
    [&mut generic, &mut unit, &mut own].into_iter().for_each(|unit| unit.initialise().unwrap());
    let of_own = folded(&model, &Settled::of(&model, own.block()));
    assert!(own.take_kernel(*of_own.kernel()));
    let step = model.description().experiment.step;
    for k in 0..50 {
        let [one, other, third] = [&mut generic, &mut unit, &mut own].map(|unit| unit.step(f64::from(k) * step, step));
        assert_eq!(one.is_ok(), other.is_ok() && third.is_ok(), "{name}, step {k}: {one:?}, {other:?}, {third:?}");
        for unit in [&unit, &own] {
            let equal = generic.block().reals.iter().zip(&unit.block().reals).all(|(a, b)| same(*a, *b));
            assert!(equal && generic.block().integers == unit.block().integers, "{name}, step {k}");
            assert!(unit.has_kernel(), "{name}, step {k}");
        }
        if one.is_err() {
            return;
        }
    }
}

#[test]
fn stiff_steps_by_kernels_have_the_bits_of_generic_ones() {
    for name in ["NonlinearSiso", "L1TwoLinkRobot", "L1Quadrotor", "L1CoupledMimo", "MaresAuv"] {
        compare_steps(Description::read(&description(name)).unwrap());
    }
    let wanted = ["Loop_3_3_1_case2", "Loop_3_4_2", "Loop_4_case1_fuzzy"];
    composites().into_iter().filter(|m| wanted.contains(&&*m.description().name)).for_each(|model| {
        compare_steps(model.description().clone());
    });
}

#[test]
fn the_kernels_of_all_units_give_the_bits_of_the_equations() {
    let mut random = Random::new(28);
    for name in sampled_names() {
        let model = Model::from_description(Description::read(&description(&name)).unwrap(), REGISTRY).unwrap();
        compare(&model, 100, &mut random);
        compare_folded(&model, &mut random);
    }
}

#[test]
fn the_kernels_of_all_composites_give_the_bits_of_the_equations() {
    let mut random = Random::new(29);
    sampled(composites()).iter().for_each(|model| compare(model, 20, &mut random));
}

#[test]
fn a_kernel_of_another_model_is_refused() {
    let model = |name| Model::from_description(Description::read(&description(name)).unwrap(), REGISTRY).unwrap();
    let kernel = compiled(&model("TwoLinkRobot"));
    assert!(!Execution::new(model("Quadrotor")).take_kernel(*kernel.kernel()));
    assert!(Execution::new(model("TwoLinkRobot")).take_kernel(*kernel.kernel()));
}

/// Checks the solver: the matrix that it decomposes, times the solution, is the right-hand side.
#[test]
fn what_a_kernel_solves_is_the_solution() {
    let mut random = Random::new(30);
    for name in ["NonlinearSiso", "L1Quadrotor", "MaresAuv"] {
        let model = Model::from_description(Description::read(&description(name)).unwrap(), REGISTRY).unwrap();
        let (compiled, sparsity) = (compiled(&model), model.sparsity());
        let (kernel, n) = (compiled.kernel(), model.variables().states());
        let Some(size) = kernel.factors() else { continue };
        let (mut factors, diagonal) = (vec![0.0; size], 100.0);
        let entries: Vec<f64> = (0..sparsity.entries()).map(|_| random.next()).collect();
        assert!(kernel.decompose(diagonal, &entries, &mut factors), "{name}");
        let b: Vec<f64> = (0..n).map(|_| random.next()).collect();
        let mut x = b.clone();
        kernel.solve(&factors, &mut x);
        let mut found: Vec<f64> = x.iter().map(|x| diagonal * x).collect();
        let of_columns = sparsity.columns().iter().zip(&x).flat_map(|(rows, x)| rows.iter().map(move |row| (*row, *x)));
        of_columns.zip(&entries).for_each(|((row, x), entry)| found[row as usize] -= entry * x);
        assert!(found.iter().zip(&b).all(|(found, b)| (found - b).abs() < 1e-12), "{name}: {found:?}, not {b:?}");
        // It reports a lost pivot: a diagonal like that of the Jacobian there.
        let none = vec![0.0; entries.len()];
        assert!(!kernel.decompose(0.0, &none, &mut factors) && !kernel.decompose(f64::NAN, &entries, &mut factors));
    }
}

/// A linear plant with so many states, each of which moves all.
fn dense(states: usize) -> Model {
    let row = |columns: usize| vec!["-0.5"; columns].join(", ");
    let rows = |rows: usize, columns: usize| format!("[{}]", vec![format!("[{}]", row(columns)); rows].join(", "));
    let matrices = [("A", rows(states, states)), ("B", rows(states, 1)), ("C", rows(1, states))];
    let structure = matrices.map(|(name, rows)| format!("{name} = {rows}\n")).concat();
    let text = description("StateSpace");
    let begin = text.split("[structure]").next().unwrap();
    Model::from_description(Description::read(&format!("{begin}[structure]\n{structure}")).unwrap(), REGISTRY).unwrap()
}

#[test]
fn the_making_of_a_kernel_is_bounded() {
    let mut random = Random::new(31);
    // Its Jacobian is left out: it has an entry for each of 1600 pairs.
    let model = dense(40);
    compare(&model, 3, &mut random);
    let begun = std::time::Instant::now();
    let reason = Functions::of(&dense(150), Settled::default()).unwrap_err().to_string();
    assert!(reason.contains("operations are more than"), "{reason}");
    assert!(begun.elapsed().as_secs() < 20, "{:?}", begun.elapsed());
}

/// Numbers folded into the code are no longer used after any change of a parameter.
#[test]
fn a_folded_kernel_is_left_as_soon_as_a_parameter_is_another() {
    let text = description("L1NonlinearSiso");
    let model = std::sync::Arc::new(Model::from_description(Description::read(&text).unwrap(), REGISTRY).unwrap());
    let tunable = model.variables().iter().find(|it| it.name == "adaptation_gain").unwrap();
    let place = model.variables().index(tunable.elements().next().unwrap());
    let started = || {
        let mut unit = Execution::new(std::sync::Arc::clone(&model));
        unit.initialise().unwrap();
        unit
    };
    let step = model.description().experiment.step;
    let advanced = |unit: &mut Execution, from: i32| {
        (from..from + 20).for_each(|k| _ = unit.step(f64::from(k) * step, step).unwrap());
        unit.block().reals.iter().map(|value| value.to_bits()).collect::<Vec<u64>>()
    };
    let set = |unit: &mut Execution| unit.set_real(place, 2e3);
    let other = {
        let mut unit = started();
        set(&mut unit);
        unit.initialise().unwrap();
        unit.block().clone()
    };
    type Change<'a> = &'a dyn Fn(&mut Execution);
    let ways: [(&str, Change); 3] = [
        ("set as a master does", &set),
        ("a saved state of other parameters", &|unit| unit.block_mut().copy_from(&other)),
        ("reset, and set before the start", &|unit| {
            unit.reset();
            set(unit);
            unit.initialise().unwrap();
        }),
    ];
    for (way, changed) in ways {
        let [mut generic, mut unit] = [started(), started()];
        let kernel = folded(&model, &Settled::of(&model, unit.block()));
        assert!(unit.take_kernel(*kernel.kernel()));
        assert_eq!(advanced(&mut unit, 0), advanced(&mut generic, 0), "{way}");
        assert!(unit.has_kernel(), "{way}");
        [&mut generic, &mut unit].into_iter().for_each(changed);
        let from = (unit.time() / step).round() as i32;
        assert_eq!(advanced(&mut unit, from), advanced(&mut generic, from), "{way}");
        assert!(!unit.has_kernel(), "{way}");
        // What was compiled for others isn't taken, either.
        assert!(!unit.take_kernel(*kernel.kernel()), "{way}");
    }
}

/// Instances that differ in one parameter share a kernel for all others.
#[test]
fn a_kernel_of_common_parameters_serves_all_values_of_the_others() {
    let text = description("L1NonlinearSiso");
    let model = std::sync::Arc::new(Model::from_description(Description::read(&text).unwrap(), REGISTRY).unwrap());
    let place = |name: &str| {
        let variable = model.variables().iter().find(|it| it.name == name).unwrap();
        model.variables().index(variable.elements().next().unwrap())
    };
    let started = |name: &str, factor: f64| {
        let (mut unit, place) = (Execution::new(std::sync::Arc::clone(&model)), place(name));
        unit.set_real(place, factor * unit.block().reals[place]);
        unit.initialise().unwrap();
        unit
    };
    let free = |factor| started("adaptation_gain", factor);
    let kernel = folded(&model, &Settled::common(&model, free(1.0).block(), free(1.1).block()));
    let step = model.description().experiment.step;
    for factor in [0.5, 1.0, 3.0] {
        let [mut generic, mut unit] = [free(factor), free(factor)];
        assert!(unit.take_kernel(*kernel.kernel()));
        for k in 0..20 {
            [&mut generic, &mut unit].into_iter().for_each(|unit| _ = unit.step(f64::from(k) * step, step).unwrap());
        }
        assert!(unit.has_kernel());
        let bits = |unit: &Execution| unit.block().reals.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&unit), bits(&generic), "{factor}");
    }
    assert!(!started("theta_bound", 1.1).take_kernel(*kernel.kernel()));
}
