//! The recorded equations are the equations: carried out on numbers they give every bit that the generic ones give, at
//! points that reach every branch.

use std::collections::BTreeMap;

use adaptive_fmu::framework::differentiation::Differentiator;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Block, Description, Model};
use adaptive_fmu::recording::{Given, Leaf, Method, Node, Operation, Recording, Registers};
use adaptive_fmu::system::*;
use common::loops::{loop_names, whole};
use common::random::Random;
use common::sample::{sampled, sampled_names};
use common::{description, description_names};

/// The loops of this package, each as a single FMU.
pub fn composites() -> Vec<Model> {
    let model = |name: String| Model::from_description(Description::read(&whole(&name)).unwrap(), REGISTRY).unwrap();
    loop_names().into_iter().map(model).collect()
}

/// Tries for a condition that random points don't change: in an FMU, and in a composite, whose parts are FMUs.
const TRIES: [usize; 2] = [300, 10];

/// A place to evaluate a method at.
#[derive(Clone)]
pub struct Draw {
    pub time: f64,
    pub step: f64,
    pub block: Block,
    pub crossed: Vec<bool>,
}

impl Draw {
    /// Around the start values, and beyond: zeros, small and large numbers, numbers that are equal to each other, limits
    /// that are tight, all items of all choices.
    pub fn new(model: &Model, random: &mut Random) -> Self {
        let variables = model.variables();
        let mut block = model.start().clone();
        let spread = 10_f64.powf(3.0 * random.next());
        for section in [Section::Parameter, Section::Prepared, Section::Input, Section::State, Section::Discrete] {
            for index in variables.reals(section) {
                let before = block.reals[index];
                let other = block.reals[(random.next().abs() * index as f64) as usize];
                block.reals[index] = match (random.next() * 4.0 + 4.0) as usize {
                    0 | 1 => before,
                    2 | 3 => before * (1.0 + random.next()),
                    4 => spread * random.next(),
                    5 => other,
                    6 => random.next().round(),
                    _ => random.next(),
                };
            }
        }
        for variable in variables.iter().filter(|variable| !variable.is_real()) {
            for element in variable.elements() {
                let most = match &variable.data {
                    Data::Choice { items, .. } => (1, items.len() as i32),
                    Data::Integer { limits: Some((least, most)), .. } => (*least, (*most).min(least + 9)),
                    Data::Integer { .. } => (0, 3),
                    _ => (0, 1),
                };
                let width = f64::from(most.1 - most.0 + 1);
                let drawn = most.0 + ((random.next() * 0.5 + 0.5) * width) as i32;
                block.integers[variables.index(element)] = drawn.min(most.1);
            }
        }
        for flag in variables.integers(Section::Memory) {
            block.integers[flag] = i32::from(random.next() > 0.0);
        }
        // Signals as they follow, so that what reads them meets what it may meet.
        let prepares = random.next() > 0.0;
        if prepares {
            let mut log = MessageLog::new();
            let _ = model.system().prepare(&mut block.point(model, &mut log));
            model.equations().relate(&mut block.point(model, &mut log));
        }
        let time = if random.next() > 0.5 { 0.0 } else { 10.0 * random.next().abs() };
        let equations = model.equations();
        equations.evaluate(time, &mut block.reals, &block.integers, variables.offsets());
        let crossed = variables.indicators().iter().map(|_| random.next() > 0.0).collect();
        Draw { time, step: 0.1 * random.next().abs(), block, crossed }
    }

    /// Arguments of a recording.
    pub fn given(&self) -> Given<'_> {
        let Draw { time, step, block, crossed } = self;
        Given { time: *time, step: *step, reals: &block.reals, integers: &block.integers, crossed }
    }

    /// The entries of the Jacobian and the rates' change by time, where inputs move along these slopes.
    pub fn jacobian(&self, model: &Model, slopes: Option<&[f64]>) -> Vec<f64> {
        self.jacobian_by(model.sparsity().differentiator(model.system(), model.variables()), model, slopes)
    }

    /// The same, computed direction by direction.
    fn jacobian_by_directions(&self, model: &Model, slopes: Option<&[f64]>) -> Vec<f64> {
        let evaluate = || Recording::of(model.system(), Method::Evaluate, &model.variables().layout());
        let pattern = (model.sparsity().columns(), model.sparsity().groups());
        self.jacobian_by(&Differentiator::of(model.variables(), pattern, evaluate, 0), model, slopes)
    }

    fn jacobian_by(&self, by: &Differentiator, model: &Model, slopes: Option<&[f64]>) -> Vec<f64> {
        let given = self.given();
        let leaf = |leaf: Leaf| match leaf {
            Leaf::Time => given.time,
            Leaf::Real(place) => given.reals[place as usize],
            Leaf::Integer(place) => f64::from(given.integers[place as usize]),
            Leaf::Slope(input) => slopes.map_or(0.0, |slopes| slopes[input as usize]),
            other => panic!("the equations of rates don't read {other:?}"),
        };
        let (sparsity, states) = (model.sparsity(), model.variables().states());
        let mut found = vec![0.0; sparsity.entries() + states];
        let results = found.split_at_mut(sparsity.entries());
        by.carry_out(sparsity.columns(), leaf, &mut Registers::new(), results);
        found
    }

    /// The same but for some of what is given: zero, small and large numbers, numbers that are equal to each other.
    fn changed(&self, model: &Model, leaves: &[Leaf], random: &mut Random) -> Self {
        let Draw { mut time, step, mut block, mut crossed } = self.clone();
        for leaf in leaves {
            if random.next() > 0.5 {
                continue;
            }
            match *leaf {
                Leaf::Time => time = 10_f64.powf(4.0 * random.next()),
                Leaf::Crossed(number) => crossed[number as usize] ^= true,
                Leaf::Step | Leaf::TimeChange | Leaf::Change(_) | Leaf::Slope(_) => {}
                Leaf::Integer(place) => {
                    let drawn = Draw::new(model, random);
                    block.integers[place as usize] = drawn.block.integers[place as usize];
                }
                Leaf::Real(place) => {
                    let other = leaves[(random.next().abs() * leaves.len() as f64) as usize];
                    let before = block.reals[place as usize];
                    block.reals[place as usize] = match (random.next() * 3.0 + 3.0) as usize {
                        0 => 0.0,
                        1 => -before,
                        2 => 10_f64.powf(12.0 * random.next()),
                        3 => -(10_f64.powf(6.0 * random.next())),
                        4 => before * 10_f64.powf(3.0 * random.next()),
                        _ => {
                            if let Leaf::Real(other) = other {
                                block.reals[other as usize]
                            } else {
                                time
                            }
                        }
                    };
                }
            }
        }
        Draw { time, step, block, crossed }
    }

    /// Result of the generic equations.
    pub fn generic(&self, model: &Model, method: Method) -> (Block, Vec<f64>) {
        let (variables, equations, t) = (model.variables(), model.equations(), self.time);
        let (mut block, mut results, mut log) = (self.block.clone(), Vec::new(), MessageLog::new());
        let offsets = variables.offsets();
        let evaluate = |block: &mut Block| equations.evaluate(t, &mut block.reals, &block.integers, offsets);
        let (mut same, mut unheard) = (self.block.clone(), MessageLog::new());
        let point = same.point(model, &mut unheard);
        let values = point.values();
        match method {
            Method::Relate => equations.relate(&mut block.point(model, &mut log)),
            Method::Evaluate => evaluate(&mut block),
            Method::Start => {
                equations.initialise(t, &mut block.point(model, &mut log));
                evaluate(&mut block);
            }
            Method::ParametersChanged => equations.parameters_changed(t, &mut block.point(model, &mut log)),
            Method::Check => equations.check(t, &mut block.point(model, &mut log)),
            Method::NextTimeEvent => results.push(equations.next_time_event(&values)),
            Method::Indicators => {
                results.resize(self.crossed.len(), 1.0);
                equations.event_indicators(t, &values, &mut results);
            }
            Method::Event => equations.event(t, &self.crossed, &mut block.point(model, &mut log)),
            Method::StepCompleted => equations.step_completed(t, self.step, &mut block.point(model, &mut log)),
        }
        (block, results)
    }
}

pub fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan()
}

/// Results of a recording's conditions: false, true or both.
#[derive(Default)]
struct Branches(BTreeMap<Node, [bool; 2]>);

impl Branches {
    fn see(&mut self, recording: &Recording, values: &[f64]) {
        for operation in recording.tape.operations() {
            if let Operation::Select(condition, ..) = operation {
                self.0.entry(*condition).or_default()[usize::from(values[condition.index()] != 0.0)] = true;
            }
        }
    }

    /// The conditions that were always or never true.
    fn missed(&self) -> Vec<Node> {
        self.0.iter().filter(|(_, seen)| !(seen[0] && seen[1])).map(|(condition, _)| *condition).collect()
    }
}

/// A method of a model, recorded and generic.
struct Compared<'a> {
    model: &'a Model,
    method: Method,
    recording: Recording,
    branches: Branches,
}

impl<'a> Compared<'a> {
    fn new(model: &'a Model, method: Method) -> Self {
        let recording = Recording::of(model.system(), method, &model.variables().layout());
        Compared { model, method, recording, branches: Branches::default() }
    }

    fn at(&mut self, draw: &Draw) {
        let (name, method) = (&self.model.description().name, self.method);
        let given = draw.given();
        let (expected, expected_results) = draw.generic(self.model, method);
        let (reals, integers, results) = self.recording.carry_out(&given);
        self.branches.see(&self.recording, &self.recording.tape.values(&given));
        for (place, (found, expected)) in reals.iter().zip(&expected.reals).enumerate() {
            assert!(same(*found, *expected), "{name}, {method:?}, real {place}: {found:e}, not {expected:e}");
        }
        assert_eq!(integers, expected.integers, "{name}, {method:?}");
        for (found, expected) in results.iter().zip(&expected_results) {
            assert!(same(*found, *expected), "{name}, {method:?}: {found:e}, not {expected:e}");
        }
    }

    /// Looks for results that random points didn't reach: changes only the variables of conditions always or never
    /// true.
    fn at_what_is_missed(&mut self, draws: &[Draw], tries: usize, random: &mut Random) {
        for condition in self.branches.missed() {
            let leaves = self.recording.tape.dependence(&[condition], |_| true).concat();
            for attempt in 0..tries {
                if self.branches.0[&condition] == [true, true] {
                    break;
                }
                let draw = draws[attempt % draws.len()].changed(self.model, &leaves, random);
                self.at(&draw);
            }
        }
    }
}

/// Compares a model's methods; how many conditions there are, how many never went one of both ways, and how many of these follow
/// from changed parameters.
fn compare(model: &Model, random: &mut Random, (points, tries): (usize, usize)) -> (usize, usize, usize) {
    let (mut all, mut missed, mut of_parameters) = (0, 0, 0);
    let draws: Vec<_> = (0..points).map(|_| Draw::new(model, random)).collect();
    for method in Method::ALL {
        let mut compared = Compared::new(model, method);
        draws.iter().for_each(|draw| compared.at(draw));
        compared.at_what_is_missed(&draws, tries, random);
        all += compared.branches.0.len();
        let one_way = compared.branches.missed().len();
        missed += one_way;
        of_parameters += if method == Method::ParametersChanged { one_way } else { 0 };
    }
    (all, missed, of_parameters)
}

#[test]
fn recordings_of_all_units_give_the_bits_of_the_equations_in_every_branch() {
    for name in sampled(sampled_names()) {
        // Of its own, so that what one unit draws doesn't depend on others.
        let mut random = Random::new(24);
        let model = Model::from_description(Description::read(&description(&name)).unwrap(), REGISTRY).unwrap();
        let (all, missed, of_parameters) = compare(&model, &mut random, (400, TRIES[0]));
        println!("{name}: {missed} of {all} conditions went one way only");
        // The remaining ones can't change: the start within its limits, an item that a controller lacks, and pivots of
        // the matrix exponential of a sampled model, in three methods.
        let others = missed - missed.min(3 * of_parameters);
        assert!(others <= 10.max(all / 10), "{name}: {others} of {all}, {of_parameters} of parameters");
    }
}

#[test]
fn recordings_of_all_composites_give_the_bits_of_the_equations() {
    let mut random = Random::new(25);
    for model in sampled(composites()) {
        let (all, missed, _) = compare(&model, &mut random, (60, TRIES[1]));
        println!("{}: {missed} of {all} conditions went one way only", model.description().name);
    }
}

/// A system whose equations look at a number.
struct Looks {
    x: ScalarOf<State>,
}

impl System for Looks {
    type Structure = NoStructure;
    const NAME: &'static str = "looks";
    const DOCUMENTATION: &'static str = "It looks.";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Looks { x: d.state(scalar("x", "state").output()) })
    }

    fn initialise<S: Scalar>(&self, _t: S, _v: &mut Point<S>) {}

    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let is_zero = v[self.x] == S::from(0.0);
        dx.set(self.x, if is_zero { [S::from(1.0)] } else { [-v[self.x]] });
    }
}

#[test]
fn equations_that_look_at_a_number_are_refused_by_name() {
    let refused = Model::new::<Looks>("Looks", &toml::Table::new()).unwrap().check_recorded().unwrap_err().to_string();
    assert!(refused.contains("looks") && refused.contains("outputs or derivatives"), "{refused}");
    assert!(refused.contains("equals") && !refused.contains("next_time_event"), "{refused}");
}

#[test]
fn no_equations_of_this_package_look_at_a_number() {
    let units = description_names().into_iter().map(|name| description(&name));
    let units = units.map(|text| Model::from_description(Description::read(&text).unwrap(), REGISTRY).unwrap());
    for model in units.chain(composites()) {
        assert!(model.check_recorded().is_ok(), "{:?}", model.check_recorded());
    }
}

/// Jacobians that are too large for it are computed so. A change of zero that meets an infinite slope has no number.
#[test]
fn a_jacobian_by_directions_has_the_bits_of_one_by_entries() {
    let mut random = Random::new(27);
    for name in sampled_names() {
        let model = Model::from_description(Description::read(&description(&name)).unwrap(), REGISTRY).unwrap();
        let slopes: Vec<f64> = model.variables().reals(Section::Input).map(|_| random.next()).collect();
        for _ in 0..20 {
            let draw = Draw::new(&model, &mut random);
            let expected = draw.jacobian(&model, Some(&slopes));
            let found = draw.jacobian_by_directions(&model, Some(&slopes));
            for (place, (found, expected)) in found.into_iter().zip(expected).enumerate() {
                assert!(found == expected || found.is_nan(), "{name}, Jacobian {place}: {found:e}, not {expected:e}");
            }
        }
    }
}
