//! This package's own units: the catalogue of its systems.
//!
//! To add a kind: its own file (with the `mod` of its folder), its page, a description in `modelDescription/`, and a line
//! here.

use crate::catalogue::Entry;
use crate::controllers::watched::Watched;
use crate::error::{Invalid, Number};
use crate::execution::Execution;
use crate::model::{Description, Model};
use crate::plants::state_space::StateSpace;
use crate::system::{Causality, Registry, System, Variable};
use crate::template::{Begun, MOST, Request, Sizes};
use crate::{controllers, plants};

const ENTRIES: &[Entry] = &[
    Entry::of::<Watched<controllers::l1::L1>>(),
    Entry::of::<Watched<controllers::fuzzy_l1::FuzzyL1>>(),
    Entry::of::<Watched<controllers::l1_quadrotor::L1Quadrotor<false>>>(),
    Entry::of::<Watched<controllers::l1_quadrotor::L1Quadrotor<true>>>(),
    Entry::of::<Watched<controllers::l1_limit::L1Limit>>(),
    Entry::of::<Watched<controllers::l1_sampled::L1Sampled>>(),
    Entry::of::<controllers::l1_ppf::L1Ppf>(),
    Entry::of::<Watched<controllers::mrac::Mrac>>(),
    Entry::of::<controllers::mrac_ppf::MracPpf>(),
    Entry::of::<controllers::mrac_ppf_unmatched::MracPpfUnmatched>(),
    Entry::of::<controllers::neuro_ppf::NeuroPpf>(),
    Entry::of::<Watched<controllers::pid::Pid>>(),
    Entry::of::<Watched<controllers::ladrc::Ladrc>>(),
    Entry::of::<controllers::funnel_control::FunnelControl>(),
    Entry::of::<controllers::observer::Observer>(),
    Entry::of::<plants::state_space::StateSpace>(),
    Entry::of::<plants::nonlinear_siso::NonlinearSiso>(),
    Entry::of::<plants::two_link_robot::TwoLinkRobot>(),
    Entry::of::<plants::actuated_siso::ActuatedSiso>(),
    Entry::of::<plants::unmatched_mimo::UnmatchedMimo>(),
    Entry::of::<plants::twin_rotor::TwinRotor>(),
    Entry::of::<plants::coupled_mimo::CoupledMimo>(),
    Entry::of::<plants::quadrotor::Quadrotor>(),
    Entry::of::<plants::mares_auv::MaresAuv>(),
    Entry::of::<plants::reference::Reference>(),
    Entry::of::<plants::excitation::Excitation>(),
    Entry::of::<plants::sensor::Sensor>(),
    Entry::of::<plants::unwrap::Unwrap>(),
    Entry::of::<plants::actuator::Actuator>(),
    Entry::of::<controllers::quadrotor_mixer::QuadrotorMixer>(),
    Entry::COMPOSITE,
];

/// Every system of this package, in the order in which they are listed. A static, as what follows: whoever uses a constant
/// compiles all models once more.
pub static CATALOGUE: &[Entry] = ENTRIES;

/// Their kinds, from which the library makes units.
pub static REGISTRY: Registry = &Entry::kinds::<{ ENTRIES.len() }>(ENTRIES);

/// The same as libraries in FMUs need them.
pub static IN_FMU: Registry = &Entry::kinds_in_fmu::<{ ENTRIES.len() }>(ENTRIES);

/// Generation tool of FMUs.
pub const PACKAGE: &str = concat!("adaptive-fmu ", env!("CARGO_PKG_VERSION"));

/// Checksum of all sources of the library.
pub const SOURCE: &str = env!("ADAPTIVE_FMU_SOURCE");

/// The entry of this name, where there is one.
pub fn find(name: &str) -> Option<&'static Entry> {
    CATALOGUE.iter().find(|entry| entry.kind.name == name)
}

/// The kind of the linear controller that a kind's law tends to as its adaptation gets fast, where there is one.
pub fn limit_of(name: &str) -> Option<&'static Entry> {
    CATALOGUE.iter().find(|entry| entry.limit_of == Some(name))
}

/// The kinds that `new` begins.
pub fn begun() -> impl Iterator<Item = &'static Entry> {
    CATALOGUE.iter().filter(|entry| entry.template.is_some())
}

/// The text of a new description, ready to be exported as it stands.
///
/// # Errors
/// Sizes that the kind doesn't have, or why there is no such unit for this plant.
pub fn begin(request: &Request) -> Result<Begun, Invalid> {
    match named_for_plants(request) {
        Some((renamed, note)) => begin_own(&renamed).map(|begun| begun.with_note(note)),
        None => begin_own(request),
    }
}

/// A request with other names for signals whose names the FMU of a linear plant has for its own variables, and what they are; nothing
/// where there are none. Signals have the same names in all units of a loop.
pub fn named_for_plants<'a>(request: &Request<'a>) -> Option<(Request<'a>, String)> {
    request.plant.as_ref()?;
    let distinct = request.with_distinct_outputs();
    let plain = distinct.as_ref().map_or(request, |(renamed, _)| renamed).clone();
    let plain = Request { kind: <StateSpace as System>::NAME, uncertainty: None, ..plain };
    let other = made(&plain).err().and_then(|reason| plain.renamed(&reason));
    let (renamed, note) = match (distinct, other) {
        (Some((_, one)), Some((renamed, another))) => (renamed, format!("{one} {another}")),
        (distinct, other) => other.or(distinct)?,
    };
    Some((Request { kind: request.kind, uncertainty: request.uncertainty, ..renamed }, note))
}

/// Note on a unit that needs states which nobody has measured.
const OUTPUTS_ONLY: &str = "Only outputs of this plant were recorded: its states are the outputs and derivatives of them, which no sensor \
    has. Put an observer between the plant and this FMU (`new observer --plant`), or take `new pid`, `new ladrc` or `new funnel`.";

/// True if a unit takes the states of a plant of which only outputs were recorded.
fn guesses_states(request: &Request, model: &Model) -> bool {
    let records = request.plant.as_ref().and_then(|plant| plant.records.as_ref());
    let is_state = |variable: &Variable| variable.name == "x" && variable.causality == Causality::Input;
    records.is_some_and(|records| !records.measures_states) && model.variables().iter().any(is_state)
}

/// The same with names that no unit of a plant refuses.
fn begin_own(request: &Request) -> Result<Begun, Invalid> {
    let Sizes { states, inputs, outputs } = request.sizes;
    let mut sizes = [states, inputs, outputs].into_iter().flatten();
    if let Some(size) = sizes.find(|size| !(1..=MOST as usize).contains(size)) {
        return Err(Invalid::new("size", size, format!("must be within 1 … {MOST}")));
    }
    if let Some(uncertainty) = request.uncertainty {
        check_uncertainty(request.kind, "--uncertainty", request.plant.is_some(), uncertainty)?;
    }
    match made(request) {
        Ok((begun, model)) => {
            let guesses = guesses_states(request, &model);
            Execution::new(model).initialise().map_err(Invalid::because)?;
            Ok(if guesses { begun.with_note(OUTPUTS_ONLY.to_owned()) } else { begun })
        }
        // A name of the plant may be one that the model has for something else.
        Err(reason) => match request.renamed(&reason) {
            Some((renamed, note)) => begin_own(&renamed).map(|begun| begun.with_note(note)),
            None => Err(reason),
        },
    }
}

/// Refuses an option about the uncertainty of a plant where the kind has no use for it, or there is no plant.
///
/// # Errors
/// The option with its value, and the kinds that take it.
pub fn check_uncertainty(kind: &str, option: &str, has_plant: bool, value: f64) -> Result<(), Invalid> {
    let kinds = begun().filter(|entry| entry.template.is_some_and(|template| template.is_uncertain));
    let kinds: Vec<_> = kinds.map(|entry| entry.kind.name).collect();
    let allowed = if !kinds.contains(&kind) {
        format!("{kind} doesn't use it; the kinds that do are {}", kinds.join(", "))
    } else if has_plant {
        return Ok(());
    } else {
        "needs a nominal plant: give --plant".to_owned()
    };
    Err(Invalid::new(option, Number(value), allowed))
}

/// A text and its model: only what can be exported is worth beginning with.
fn made(request: &Request) -> Result<(Begun, Model), Invalid> {
    let Some(template) = find(request.kind).and_then(|entry| entry.template) else {
        let known: Vec<_> = begun().map(|entry| entry.kind.name).collect();
        return Err(Invalid::new("kind", request.kind, format!("must be one of {}", known.join(", "))));
    };
    let begun = (template.write)(request)?;
    let model = Model::from_description(Description::read(&begun.text)?, REGISTRY)?;
    Ok((begun, model))
}
