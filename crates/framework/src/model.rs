//! A model: a system built from its description, with all its variables, ready to run.

mod description;
mod preparing;
mod sizes;
mod stored;

pub use description::{Description, Experiment, Standard};
pub use sizes::{Extent, Sizes};

use std::collections::BTreeSet;
use std::sync::{Arc, OnceLock};

use crate::controls::Controls;
use crate::designed::designed;
use crate::differentiation::{self, Adjoint, Direction};
use crate::error::Invalid;
use crate::integrator::{Sparsity, Work, Workspace, Workspaces};
use crate::recording::{Method, Recording};
use crate::report::DesignReport;
use crate::structure::{Place, Structure, ends_aside};
use crate::system::{
    Data, Declaration, DynSystem, Equations, Handle, Kind, MessageLog, Names, NoStructure, Registry, Section, System,
    Variable, Variables,
};

/// The values of one instance. A copy of it is a copy of the instance.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Real values.
    pub reals: Vec<f64>,
    /// Integers, Booleans and choices.
    pub integers: Vec<i32>,
}

impl Block {
    /// Takes over the values of another block of the same model.
    pub fn copy_from(&mut self, other: &Block) {
        self.reals.copy_from_slice(&other.reals);
        self.integers.copy_from_slice(&other.integers);
    }
}

/// A system built from its description.
pub struct Model {
    description: Description,
    kind: Kind,
    documentation: String,
    system: Box<dyn DynSystem>,
    variables: Variables,
    controls: Controls,
    /// The start values, which every instance begins with.
    start: Block,
    /// The prepared section for these values, if preparing them changes nothing else.
    prepared: Option<Block>,
    /// Magnitudes of the states.
    nominals: Vec<f64>,
    sparsity: OnceLock<Arc<Sparsity>>,
    structure: OnceLock<Structure>,
    direction: OnceLock<Direction>,
    start_direction: OnceLock<Direction>,
    adjoint: OnceLock<Option<Adjoint>>,
    sizes: OnceLock<Sizes>,
    ends_aside: OnceLock<bool>,
    workspaces: Workspaces,
}

impl std::fmt::Debug for Model {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Model({})", self.description.name)
    }
}

impl Model {
    /// Makes the model that a description asks for.
    ///
    /// # Errors
    /// [`Invalid`] naming key, value and what is allowed.
    pub fn from_description(description: Description, registry: Registry) -> Result<Model, Invalid> {
        let kind = Kind::find(registry, &description.model)?;
        Model::build(description, kind, registry)
    }

    /// A model of one system under a name, with start values of your own.
    ///
    /// # Errors
    /// As [`Model::from_description`].
    pub fn new<M: System<Structure = NoStructure>>(name: &str, start: &toml::Table) -> Result<Model, Invalid> {
        let description = Description {
            name: name.to_owned(),
            model: M::NAME.to_owned(),
            description: String::new(),
            author: None,
            version: None,
            license: None,
            copyright: None,
            experiment: Experiment::default(),
            structure: toml::Table::new(),
            names: Names::new(),
            start: start.clone(),
            magnitudes: toml::Table::new(),
            nominal: None,
            fmi: None,
            designed: None,
        };
        Model::build(description, &Kind::of::<M>(), &[])
    }

    /// The variables that a description's structure makes, under the system's names: nothing is designed, and of start values
    /// only their shapes are looked at.
    ///
    /// # Errors
    /// A structure that contradicts itself.
    pub fn variables_of(description: &Description, registry: Registry) -> Result<Variables, Invalid> {
        let mut declaration = Declaration::of(&description.start);
        let kind = Kind::find(registry, &description.model)?;
        kind.declare(description.structure.clone(), &Names::new(), registry, &mut declaration)?;
        Controls::declare(&mut declaration);
        declaration.finish()
    }

    fn build(description: Description, kind: &Kind, registry: Registry) -> Result<Model, Invalid> {
        let mut declaration = Declaration::of(&description.start);
        let system = kind.declare(description.structure.clone(), &description.names, registry, &mut declaration)?;
        let set = |variables: &mut Variables| {
            set_each("start", &description.start, |name, value| variables.set_start(name, value))?;
            set_each("magnitudes", &description.magnitudes, |name, value| variables.set_magnitude(name, value))?;
            variables.make_constant(description.designed.as_deref().unwrap_or_default())
        };
        let mut model = Model::declared(&description, *kind, system, declaration, set)?;
        // Start values that the system refuses make no model.
        let (mut prepared, mut log) = (model.start.clone(), MessageLog::new());
        model.prepare(&mut prepared, &mut log)?;
        model.prepared = if log.is_empty() { model.prepared_alone(&prepared) } else { None };
        Ok(model)
    }

    /// A model of a system that was declared, whose variables get their start values by a function.
    fn declared(
        description: &Description,
        kind: Kind,
        system: Box<dyn DynSystem>,
        mut declaration: Declaration,
        set: impl FnOnce(&mut Variables) -> Result<(), Invalid>,
    ) -> Result<Model, Invalid> {
        let mut documentation = declaration.documentation();
        let controls = Controls::declare(&mut declaration);
        let mut variables = declaration.finish()?;
        set(&mut variables)?;
        if variables.states() > 0 {
            documentation = format!("{}\n\n{}", documentation.trim_end(), Work::of(&variables).documentation());
        }
        let start = start_block(&variables, &controls);
        let mut nominals = vec![1.0; variables.states()];
        for state in variables.iter().filter(|v| v.section == Section::State).flat_map(Variable::elements) {
            nominals[state.place()] = state.nominal();
        }
        Ok(Model {
            description: description.clone(),
            kind,
            documentation,
            system,
            variables,
            controls,
            start,
            prepared: None,
            nominals,
            sparsity: OnceLock::new(),
            structure: OnceLock::new(),
            direction: OnceLock::new(),
            start_direction: OnceLock::new(),
            adjoint: OnceLock::new(),
            sizes: OnceLock::new(),
            ends_aside: OnceLock::new(),
            workspaces: Workspaces::default(),
        })
    }

    /// The description.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// Its purpose, equations and source, in Markdown.
    pub fn documentation(&self) -> &str {
        &self.documentation
    }

    /// The variables.
    pub fn variables(&self) -> &Variables {
        &self.variables
    }

    /// The system.
    pub fn system(&self) -> &dyn DynSystem {
        self.system.as_ref()
    }

    /// Its equations over numbers.
    pub fn equations(&self) -> &dyn Equations<f64> {
        self.system.as_ref()
    }

    /// The pattern of its Jacobian, found when it is first asked for.
    pub fn sparsity(&self) -> &Arc<Sparsity> {
        let found = || Arc::new(Sparsity::of(self.system.as_ref(), &self.variables));
        self.sparsity.get_or_init(found)
    }

    /// Magnitudes of the states.
    pub(crate) fn nominals(&self) -> &[f64] {
        &self.nominals
    }

    /// Workspaces of its instances.
    pub(crate) fn workspaces(&self) -> &Workspaces {
        &self.workspaces
    }

    /// A workspace for its instances.
    pub(crate) fn workspace(&self) -> Workspace {
        Workspace::new(self.system(), &self.variables, self.sparsity())
    }

    /// Dependences between its variables, found at the first call.
    pub fn structure(&self) -> &Structure {
        self.structure.get_or_init(|| Structure::of(self.system(), &self.variables, Place::Real(self.time_place())))
    }

    /// The place of time among the reals of a block.
    pub fn time_place(&self) -> usize {
        self.variables.reals(Section::Memory).start + self.controls.time.span().range().start
    }

    /// Computes changes of signals and rates; recorded at the first call.
    pub fn direction(&self) -> &Direction {
        let recorded = || differentiation::directional(&self.variables, self.recorded(Method::Evaluate));
        self.direction.get_or_init(|| Direction::of(&recorded()))
    }

    /// Computes adjoint derivatives; none where these are found direction by direction.
    pub fn adjoint(&self) -> Option<&Adjoint> {
        let made = || Adjoint::of(&self.variables, self.time_place(), self.recorded(Method::Evaluate));
        self.adjoint.get_or_init(made).as_ref()
    }

    /// Computes changes of the start; recorded at the first call.
    pub fn start_direction(&self) -> &Direction {
        let recorded = || differentiation::start_directional(&self.variables, self.recorded(Method::Start));
        self.start_direction.get_or_init(|| Direction::of(&recorded()))
    }

    /// True if the end of a communication step stands aside; see [`ends_aside`].
    pub(crate) fn ends_aside(&self) -> bool {
        *self.ends_aside.get_or_init(|| ends_aside(&self.variables, |method| self.recorded(method)))
    }

    fn recorded(&self, method: Method) -> Recording {
        Recording::of(self.system(), method, &self.variables.layout())
    }

    /// Number of arithmetic operations in its recorded equations: of an evaluation of signals and rates, of an event, and of
    /// the end of a communication step.
    pub fn operations(&self) -> usize {
        let of = |method| {
            let Recording { tape, reals, integers, .. } = self.recorded(method);
            let wanted: Vec<_> = reals.into_iter().chain(integers).collect();
            let is_work = |place: usize| tape.operations()[place].operands().next().is_some();
            tape.needed(&wanted).into_iter().enumerate().filter(|(place, needed)| *needed && is_work(*place)).count()
        };
        [Method::Evaluate, Method::Event, Method::StepCompleted].map(of).iter().sum()
    }

    /// The names of the parameters that its design is computed from.
    pub fn designed_names(&self) -> Vec<String> {
        let designed = self.designed();
        let is_designed =
            |v: &&Variable| v.elements().any(|element| designed.contains(&Place::of(&self.variables, element)));
        let parameters = self.variables.iter().filter(|v| v.section == Section::Parameter);
        parameters.filter(is_designed).map(|v| v.name.clone()).collect()
    }

    /// The parameters that the design reads, [`System::prepare`]: in a unit of C sources they are fixed. It is found by
    /// trying many values, which takes a while.
    pub fn designed(&self) -> BTreeSet<Place> {
        designed(self.system(), &self.variables, (&self.start.reals, &self.start.integers))
    }

    /// Checks that a recording is complete: no method looks at a number.
    ///
    /// # Errors
    /// The kind, and the methods in which it looks at a number.
    pub fn check_recorded(&self) -> Result<(), Invalid> {
        let looks = |method: &Method| self.recorded(*method).tape.has_looked();
        let looking: Vec<_> = Method::ALL.iter().filter(|method| looks(method)).map(|method| method.name()).collect();
        if looking.is_empty() {
            return Ok(());
        }
        let how = "such a comparison can't be recorded; write `a.equals(b)` and select by it";
        let reason = format!("must not compare numbers by `==` in its {}: {how}", looking.join(", "));
        Err(Invalid::new("model", &self.description.model, reason))
    }

    /// The variables that every model has, and the simulation's memory.
    pub(crate) fn controls(&self) -> &Controls {
        &self.controls
    }

    /// Design report for the start values.
    pub fn report(&self) -> DesignReport {
        let mut report =
            DesignReport::new(self.description.experiment.step).with_nominal(self.description.nominal.clone());
        let mut block = self.start.clone();
        // They were prepared when the model was made, so nothing is refused here.
        if self.prepare(&mut block, &mut MessageLog::new()).is_ok() {
            let mut log = MessageLog::new();
            let point = block.point(self, &mut log);
            self.kind.report(self.system.as_ref(), &point.values(), &mut report);
            report.reworded(|text| self.variables.named(text));
        }
        report
    }

    /// The start values.
    pub fn start(&self) -> &Block {
        &self.start
    }
}

impl Block {
    /// The values as the system's own methods see them.
    pub fn point<'a>(&'a mut self, model: &'a Model, log: &'a mut MessageLog) -> crate::system::Point<'a> {
        crate::system::Point::new(&mut self.reals, &mut self.integers, model.variables.offsets(), log)
    }
}

fn start_block(variables: &Variables, controls: &Controls) -> Block {
    let mut reals = vec![0.0; variables.reals(Section::Memory).end];
    let mut integers = vec![0; variables.integers(Section::Memory).end];
    for element in variables.iter().flat_map(|variable| variable.elements()) {
        let index = variables.index(element);
        match &element.variable.data {
            Data::Real { .. } => reals[index] = element.start(),
            Data::Integer { start, .. } | Data::Choice { start, .. } => integers[index] = *start,
            Data::Boolean { start } => integers[index] = i32::from(*start),
        }
    }
    for (section, copy) in controls.copied_integers(variables) {
        integers.copy_within(variables.integers(section), copy);
    }
    Block { reals, integers }
}

/// The most reasons that a person wants to read at a time.
const MOST_REASONS: usize = 20;

/// Gives variables the values of a table of a description.
fn set_each(
    table: &str,
    values: &toml::Table,
    mut set: impl FnMut(&str, &toml::Value) -> Result<(), String>,
) -> Result<(), Invalid> {
    let mut invalid = Invalid::none();
    for (name, value) in values {
        if let Err(reason) = set(name, value) {
            invalid.and(Invalid::new(format!("[{table}] {name}"), value, reason));
        }
        if invalid.reasons().len() == MOST_REASONS {
            break;
        }
    }
    invalid.into_result()
}
