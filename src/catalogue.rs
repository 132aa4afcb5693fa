//! The catalogue of kinds: the properties of a kind of system that its file declares in addition to its equations.
//!
//! All code that goes through kinds reads them here: the schema of descriptions, `new`, roles in a loop, icons of FMUs,
//! the tables in the documentation, and tests that start every kind.

use crate::pages::{self, Guide, Icon, Page};
use crate::system::{Kind, System};
use crate::template::Template;

/// Role of an FMU in a loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// It makes a control of references and measurements.
    Controller,
    /// It estimates what isn't measured.
    Observer,
    /// It is controlled.
    Plant,
    /// It gives what is to be followed.
    Reference,
    /// It moves a plant's inputs so that a record shows the plant.
    Excitation,
    /// It hands on each signal of a plant as it is measured.
    Sensor,
    /// It hands on each command as what a plant gets of it.
    Actuator,
    /// It holds a loop, or parts of one.
    Composite,
}

impl Role {
    /// True if it passes on signals of any sort, channel by channel: its own names don't describe them.
    pub fn hands_on(self) -> bool {
        matches!(self, Role::Sensor | Role::Actuator)
    }
}

/// Start values by which tests try any unit of a kind, as lines of `[start]`. A number stands for every element of a
/// vector; a unit takes those that it has.
#[derive(Debug, Clone, Copy)]
pub struct Trial {
    /// With them a unit takes inputs that no plant answers.
    pub alone: &'static str,
    /// With them, further, it moves in both interfaces alike, and at any step.
    pub smooth: &'static str,
    /// With them it has a steady state.
    pub steady: &'static str,
    /// With them it isn't silent, where it would be without inputs.
    pub moving: &'static str,
}

impl Trial {
    /// The kind's own start values do.
    pub const NONE: Trial = Trial { alone: "", smooth: "", steady: "", moving: "" };
}

/// The first element of a parameter, by the model's own name of it, or a number of the structure; of `key = text` 1 where the
/// structure has that, else 0.
pub type Of<'a> = &'a dyn Fn(&str) -> f64;

/// A demonstration of a standalone FMU. The pages of kinds that are in no loop of this package show its result.
#[derive(Debug, Clone, Copy)]
pub struct Demonstration {
    /// The model's own name of the input whose first element is given something; empty where there is none.
    pub input: &'static str,
    /// Stimulus at that input.
    pub stimulus: Stimulus,
    /// Inputs that are 0 meanwhile.
    pub constant_inputs: &'static [&'static str],
    /// The model's own name of the output that is shown.
    pub output: &'static str,
    /// True if all distinguishable elements are shown; else only the first one.
    pub shows_all: bool,
    /// Size and duration of the stimulus, from the first elements of parameters and the stop time of the default
    /// experiment; none if the FMU does nothing with its default parameters.
    pub scale: fn(Of, f64) -> Option<Scale>,
    /// Lines of `[start]` by which a unit is shown that does nothing as it is set.
    pub example: &'static str,
}

/// Stimulus of an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stimulus {
    /// Nothing: the unit moves by itself.
    Nothing,
    /// One step.
    Step,
    /// Steps up and down.
    Steps,
    /// A sine.
    Sine,
    /// An angle that turns evenly and wraps.
    Turns,
}

/// Size and duration of a stimulus.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Value at the start.
    pub about: f64,
    /// Change from there.
    pub size: f64,
    /// Duration of the experiment, s.
    pub duration: f64,
}

/// A system in this package's catalogue.
pub trait Catalogued: System<Structure: schemars::JsonSchema> {
    /// Its page; [`System::DOCUMENTATION`] is the text.
    const PAGE: Page;
    /// Title in a few words: "L1 adaptive controller".
    const TITLE: &'static str = Self::PAGE.title;
    /// Role of its FMUs in a loop.
    const ROLE: Role = Role::Plant;
    /// Template for `new`; none if the kind needs no other description than the one that is there.
    const TEMPLATE: Option<Template> = None;
    /// Start values for tests.
    const TRIAL: Trial = Trial::NONE;
    /// Demonstration on the page of a kind that is in no loop; none if a standalone FMU shows nothing of its work.
    const DEMONSTRATION: Option<Demonstration> = None;
    /// The kind of the adaptive law that tends to it as adaptation gets fast, if it is such a limit. A description of that
    /// kind is one of this, too.
    const LIMIT_OF: Option<&'static str> = None;
}

/// A kind in the catalogue.
#[derive(Debug, Clone, Copy)]
pub struct Entry {
    /// The kind, with its name and its documentation.
    pub kind: Kind,
    /// See [`Catalogued::TITLE`].
    pub title: &'static str,
    /// Its page below `docs`, without an ending.
    pub page: &'static str,
    /// See [`Catalogued::ROLE`].
    pub role: Role,
    /// See [`Catalogued::TEMPLATE`].
    pub template: Option<Template>,
    /// See [`Page::guide`].
    pub guide: Guide,
    /// See [`Page::choice`].
    pub choice: &'static [&'static str],
    /// See [`Catalogued::TRIAL`].
    pub trial: Trial,
    /// See [`Catalogued::DEMONSTRATION`].
    pub demonstration: Option<Demonstration>,
    /// See [`Catalogued::LIMIT_OF`].
    pub limit_of: Option<&'static str>,
    /// The schema of its structure.
    pub schema: fn(schemars::SchemaGenerator) -> schemars::Schema,
}

impl Entry {
    /// The entry of a system.
    pub const fn of<M: Catalogued>() -> Entry {
        Entry {
            kind: Kind::of::<M>(),
            title: M::TITLE,
            page: M::PAGE.place,
            role: M::ROLE,
            template: M::TEMPLATE,
            guide: M::PAGE.guide,
            choice: M::PAGE.choice,
            trial: M::TRIAL,
            demonstration: M::DEMONSTRATION,
            limit_of: M::LIMIT_OF,
            schema: schemars::SchemaGenerator::into_root_schema_for::<M::Structure>,
        }
    }

    /// Entry of composites.
    pub const COMPOSITE: Entry = Entry {
        kind: Kind::COMPOSITE,
        title: "Composite: a loop as a single FMU",
        page: "composite",
        role: Role::Composite,
        template: None,
        guide: Guide {
            purpose: "A loop, or a part of one, as a single FMU: its components are integrated together, without \
                      sampling or delay between them. Use it with any communication step, or as a reference.",
            alone: "With nothing connected it runs: its components are connected inside.",
            gains: &[],
            limits: "- Nothing is sampled or delayed between the components: a controller on a target gets sampled signals, \
                     which this FMU doesn't show.\n\
                     - A component can't be replaced: export the loop without it, and connect another one.\n\
                     - The limitations of each component apply to the composite, too.",
        },
        choice: &[],
        trial: Trial::NONE,
        demonstration: None,
        limit_of: None,
        schema: schemars::SchemaGenerator::into_root_schema_for::<crate::system::CompositeStructure>,
    };

    /// The picture of its units, which has the name of the kind.
    pub fn icon(&self) -> Icon {
        pages::icon(self.kind.name)
    }

    /// The kinds of these entries: all that a library needs of the catalogue.
    pub const fn kinds<const N: usize>(entries: &[Entry]) -> [Kind; N] {
        let mut kinds = [Kind::COMPOSITE; N];
        let mut k = 0;
        while k < N {
            kinds[k] = entries[k].kind;
            k += 1;
        }
        kinds
    }

    /// The same as libraries in FMUs need them.
    pub const fn kinds_in_fmu<const N: usize>(entries: &[Entry]) -> [Kind; N] {
        let mut kinds = Entry::kinds(entries);
        let mut k = 0;
        while k < N {
            kinds[k] = kinds[k].in_fmu();
            k += 1;
        }
        kinds
    }
}
