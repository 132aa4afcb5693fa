//! New descriptions, from which a user's own FMU starts: ready to be exported as they are. Each model has the text of
//! its kind in a file next to it; this module has the shared parts.

mod magnitudes;
mod plant;
mod records;
mod text;

pub use magnitudes::{Magnitudes, Values, write_magnitudes};
pub use plant::{Plant, Signals};
pub use records::Records;
pub use text::{
    Begun, Text, all, as_written, counted, diagonal, list, number, quoted, round_down, round_up, rows, texts,
    three_digits,
};

use crate::eigenvalues;
use crate::error::Invalid;
use crate::nominal::Uncertainty;
use crate::pages::Page;
use crate::system::TAKEN;

/// Largest number of states, inputs or outputs.
pub const MOST: i64 = 50;

/// Longest chain of integrators that a control moves, or an output shows, if no number is given: the poles of longer
/// ones are lost in rounding from about 14 on.
const LONGEST_CHAIN: usize = 8;

/// Template of a kind's descriptions.
#[derive(Debug, Clone, Copy)]
pub struct Template {
    /// The text for a request; why there is none.
    pub write: fn(&Request) -> Result<Begun, Invalid>,
    /// True if its description has an uncertainty of the nominal plant.
    pub is_uncertain: bool,
    /// Signals that a kind which `design` may propose needs; none of other kinds.
    pub needs: Option<Needs>,
    /// Sizes that tests try.
    pub tried: &'static [Sizes],
}

/// Signals that a controller needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Needs {
    /// The controlled outputs.
    Outputs,
    /// The controlled outputs and, for a relative degree above 1, derivatives of them.
    Derivatives,
    /// All states of the plant.
    States,
}

/// Sizes that a user asks for.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sizes {
    /// Size of the plant's state.
    pub states: Option<usize>,
    /// Number of the plant's inputs.
    pub inputs: Option<usize>,
    /// Number of the plant's outputs, or of channels.
    pub outputs: Option<usize>,
}

impl Sizes {
    /// None: what the kind takes by itself.
    pub const NONE: Sizes = Sizes { states: None, inputs: None, outputs: None };

    /// Those of a plant, as many outputs as inputs.
    pub const fn plant(states: usize, inputs: usize) -> Self {
        Sizes { states: Some(states), inputs: Some(inputs), outputs: None }
    }

    /// A number of inputs only.
    pub const fn inputs(inputs: usize) -> Self {
        Sizes { inputs: Some(inputs), ..Sizes::NONE }
    }
}

/// An experiment that is to show a plant.
#[derive(Debug, Clone, Copy)]
pub struct Experiment<'a> {
    /// Name of the signal.
    pub signal: &'a str,
    /// Names of the inputs, where no plant gives them; none where they have none.
    pub names: &'a [String],
    /// Largest deviation of the inputs: one for all, or one for each.
    pub amplitude: &'a [f64],
    /// Operating point of the inputs, likewise.
    pub operating_point: &'a [f64],
    /// Settling time of the plant, s.
    pub settling_time: Option<f64>,
    /// Step of the signal, s.
    pub step: Option<f64>,
    /// Highest frequency, rad/s.
    pub up_to: Option<f64>,
    /// Seed of random signals.
    pub seed: i32,
}

impl Default for Experiment<'_> {
    fn default() -> Self {
        let (amplitude, operating_point) = (&[1.0], &[0.0]);
        let (settling_time, step, up_to) = (None, None, None);
        Experiment { signal: "levels", names: &[], amplitude, operating_point, settling_time, step, up_to, seed: 1 }
    }
}

/// Description that is to be written.
#[derive(Debug, Clone)]
pub struct Request<'a> {
    /// Name of the kind.
    pub kind: &'a str,
    /// Its name.
    pub name: &'a str,
    /// Its sizes, where no plant gives them.
    pub sizes: Sizes,
    /// The nominal plant.
    pub plant: Option<Plant>,
    /// Least bandwidth of the controlled system, rad/s.
    pub bandwidth: Option<f64>,
    /// Usual magnitude of the references: one for all, or one for each.
    pub reference: &'a [f64],
    /// Assumed uncertainty of the plant, as a part of each of its numbers: 0.2 is 20 %; none where the user gave none.
    pub uncertainty: Option<f64>,
    /// The experiment, for kinds that make one; a usual one where none is given.
    pub experiment: Option<&'a Experiment<'a>>,
}

/// Bandwidth where there is no plant, rad/s.
pub const USUAL_BANDWIDTH: f64 = 2.0;
/// Rows of a record in 1/W, at least, where no bandwidth is given.
const FEWEST_ROWS: f64 = 3.0;
/// Uncertainty of each entry of A and B where none is given.
pub const USUAL_UNCERTAINTY: f64 = 0.2;

/// Magnitudes of so many references, from one for all or one for each.
///
/// # Errors
/// Another number of them.
pub fn references(given: &[f64], count: usize) -> Result<Vec<f64>, Invalid> {
    match given {
        [one] => Ok(vec![*one; count]),
        each if each.len() == count => Ok(each.to_vec()),
        others => {
            let given = others.iter().copied().map(number).collect::<Vec<_>>().join(", ");
            let allowed = format!("must be one number, or {count}, one for each reference");
            Err(Invalid::new("--reference", given, allowed))
        }
    }
}

/// Numbers in words, as one where all are the same.
pub fn one_or_each(numbers: &[f64]) -> String {
    let is_one = numbers.windows(2).all(|pair| pair[0] == pair[1]);
    let listed = if is_one { &numbers[..numbers.len().min(1)] } else { numbers };
    listed.iter().map(|&value| crate::report::number(three_digits(value))).collect::<Vec<_>>().join(", ")
}

impl Request<'_> {
    /// Uncertainty of the plant, where one is known: the part that was asked for, or what its records leave.
    pub fn uncertainty(&self) -> Uncertainty {
        let of_records = || Some(Uncertainty::Model(self.plant.as_ref()?.records.as_ref()?.model.clone()));
        self.uncertainty.map(Uncertainty::Part).or_else(of_records).unwrap_or(Uncertainty::Unknown)
    }

    /// Uncertainty of the plant for a law that is designed for one: the usual part where none is known.
    pub fn uncertainty_or_usual(&self) -> Uncertainty {
        match self.uncertainty() {
            Uncertainty::Unknown => Uncertainty::Part(USUAL_UNCERTAINTY),
            known => known,
        }
    }

    /// Bandwidth of a controlled plant, rad/s: that of the request; else twice the plant's slowest stable pole that isn't at 0, or
    /// its largest one.
    ///
    /// # Errors
    /// A plant whose poles can't be found, or one with all poles at 0 where the request has no bandwidth.
    pub fn speed(&self, plant: &Plant) -> Result<f64, Invalid> {
        if let Some(wanted) = self.bandwidth {
            return Ok(wanted);
        }
        if self.plant.is_none() {
            return Ok(USUAL_BANDWIDTH);
        }
        let poles = plant.poles()?;
        let largest = poles.iter().map(|pole| pole.norm()).fold(0.0, f64::max);
        let stable = poles.iter().filter(|pole| pole.re < 0.0 && pole.norm() > 1e-6 * largest).map(|pole| pole.norm());
        let found = stable.reduce(f64::min).map_or(largest, |slowest| 2.0 * slowest);
        // What is faster than records show isn't known.
        let found = plant.sample_time().map_or(found, |step| found.min(1.0 / (FEWEST_ROWS * step)));
        let unknown =
            || Invalid::because("all poles of the plant are at 0: give --bandwidth, the speed of the loop in rad/s");
        (found > 0.0).then(|| three_digits(found)).ok_or_else(unknown)
    }

    /// Usual magnitudes of so many references.
    ///
    /// # Errors
    /// Neither one for all nor one for each.
    pub fn references(&self, count: usize) -> Result<Vec<f64>, Invalid> {
        references(self.reference, count)
    }

    /// The plant that was given, or integrators of the sizes asked for.
    ///
    /// # Errors
    /// Sizes that don't fit each other, or a plant that no controller takes.
    pub fn plant(&self, outputs_are_inputs: bool) -> Result<Plant, Invalid> {
        let Sizes { states, inputs, outputs } = self.sizes;
        let plant = match &self.plant {
            Some(plant) => plant.clone(),
            None => {
                let chains = states.map_or(1, |n| n.div_ceil(LONGEST_CHAIN));
                let m = inputs.or(outputs.filter(|_| outputs_are_inputs)).unwrap_or(chains);
                let p = outputs.unwrap_or(if outputs_are_inputs { m } else { chains });
                Plant::integrators(states.unwrap_or(2.max(m)), m, p)?
            }
        };
        let (_, m, p) = plant.sizes();
        if outputs_are_inputs && p != m {
            let allowed = format!(
                "must be {m}, the number of inputs: choose as many outputs as inputs (with --plant, by --outputs \
                 NAME,… and --inputs NAME,…)"
            );
            return Err(Invalid::new("outputs", p, allowed));
        }
        if outputs_are_inputs && plant.D.is_some() {
            return Err(Invalid::because(
                "D: must be zero: output and control would follow each other without delay. Every actuator and sensor has \
                 a lag: put the fastest of them into the plant",
            ));
        }
        Ok(plant)
    }

    /// The same with other names for outputs that are called like a state and aren't that state, and what they are; nothing
    /// where there are none. Signals of one name are connected, so a controller would get the state.
    pub fn with_distinct_outputs(&self) -> Option<(Self, String)> {
        let mut plant = self.plant.clone()?;
        let taken: Vec<_> = [&plant.x, &plant.u, &plant.y].into_iter().flat_map(|of| of.names.clone()).collect();
        let mut renamed = Vec::new();
        for (i, name) in plant.y.names.iter_mut().enumerate() {
            let Some(k) = plant.x.names.iter().position(|state| state == name) else { continue };
            let shows = |j: usize| plant.C[(i, j)] == if j == k { 1.0 } else { 0.0 };
            let has_feedthrough =
                plant.D.as_ref().is_some_and(|feedthrough| feedthrough.row(i).iter().any(|&entry| entry != 0.0));
            if has_feedthrough || !(0..plant.C.ncols()).all(shows) {
                let mut other = extended(name, OUTPUT);
                while taken.contains(&other) {
                    other = extended(&other, OUTPUT);
                }
                renamed.push(format!("Output `{name}` isn't the state of that name: it is called `{other}`."));
                *name = other;
            }
        }
        (!renamed.is_empty()).then(|| (Request { plant: Some(plant), ..self.clone() }, renamed.join(" ")))
    }

    /// The same with other names for signals of the plant that a model was refused for, since it has variables of these names,
    /// and what they are; nothing where it was refused for another reason.
    pub fn renamed(&self, reason: &Invalid) -> Option<(Self, String)> {
        let (mut plant, reason) = (self.plant.clone()?, reason.to_string());
        let mut renamed = Vec::new();
        for (signals, behind) in [(&mut plant.x, "state"), (&mut plant.u, "input"), (&mut plant.y, "output")] {
            for name in &mut signals.names {
                if reason.contains(&format!("`{name}` {TAKEN}")) {
                    let other = format!("{name}_{behind}");
                    renamed.push(format!("{behind} `{name}` is called `{other}`"));
                    *name = other;
                }
            }
        }
        let note = format!("This FMU has variables of its own with names of the plant: {}.", renamed.join(", "));
        (!renamed.is_empty()).then_some((Request { plant: Some(plant), ..self.clone() }, note))
    }

    /// Refuses sizes that a kind doesn't have.
    ///
    /// # Errors
    /// The size that was given, and those that there are.
    pub fn only(&self, allowed: &[&str]) -> Result<(), Invalid> {
        let Sizes { states, inputs, outputs } = self.sizes;
        let given = [("states", states), ("inputs", inputs), ("outputs", outputs)];
        let wrong = given.into_iter().find(|(name, size)| size.is_some() && !allowed.contains(name));
        wrong.map_or(Ok(()), |(name, size)| {
            let known = allowed.iter().map(|name| format!("--{name}")).collect::<Vec<_>>().join(", ");
            let text = format!("is no size of {}; its sizes are {known}", self.kind);
            Err(Invalid::new(format!("--{name}"), size.unwrap_or_default(), text))
        })
    }

    /// A text with the entries that begin every description: the title of its kind, its stop time and its step, s.
    pub fn begin(&self, page: &Page, stop_time: f64, step: f64) -> Text {
        let mut text = Text::default();
        text.comment(&format!("What each key means: docs/description.md; the equations: docs/{}.md.", page.place));
        text.set("name", quoted(self.name), "name of the FMU");
        text.set("model", quoted(self.kind), "");
        text.set("description", quoted(page.title), "in one line");
        text.suggest("author", quoted("your name"), "as version, license and copyright: written into the FMU");
        text.table("experiment");
        text.set("stop_time", number(stop_time), "s, default stop time of a master");
        text.set("step", number(step), "s, communication step");
        text
    }
}

/// End of the name of an output that is called like a state.
const OUTPUT: &str = "_output";

/// Default stop time and communication step of a plant or of its reference, s: usual ones, and longer ones for
/// a plant that is slow. A controller that needs shorter steps asks for them itself.
pub fn experiment(request: &Request) -> (f64, f64) {
    const USUAL: (f64, f64) = (10.0, 1e-3);
    let slowest = || {
        let poles = eigenvalues::eigenvalues(&request.plant.as_ref()?.A).ok()?;
        let largest = poles.iter().map(|pole| pole.frequency).fold(0.0, f64::max);
        poles.iter().map(|pole| pole.frequency).find(|&frequency| frequency > 1e-6 * largest)
    };
    let time = request.bandwidth.or_else(slowest).map_or(0.0, f64::recip);
    (round_up(20.0 * time).max(USUAL.0), round_down(0.01 * time).max(USUAL.1))
}

/// Names of signals with something behind each, before an index; none where they have none.
pub fn named(signals: &Signals, behind: &str) -> Vec<String> {
    signals.names.iter().map(|name| extended(name, behind)).collect()
}

/// A name with an ending, which stands before its indices.
fn extended(name: &str, behind: &str) -> String {
    let (name, index) = name.split_at(name.find('[').unwrap_or(name.len()));
    format!("{name}{behind}{index}")
}

/// Names of outputs in the FMU of their plant, none of which has the name of a state.
pub fn named_outputs(plant: &Plant) -> Vec<String> {
    let clash = plant.y.names.iter().any(|name| plant.x.names.contains(name));
    let has_ending = |name: &str| name.split('[').next().is_some_and(|base| base.ends_with(OUTPUT));
    let other = |name: &String| if clash && !has_ending(name) { extended(name, OUTPUT) } else { name.clone() };
    plant.y.names.iter().map(other).collect()
}

/// The table of names: those that are known, and how to give others.
pub fn write_names(text: &mut Text, signals: &[(&str, Vec<String>)]) {
    text.table("names");
    let mut any = false;
    for (variable, names) in signals.iter().filter(|(_, names)| !names.is_empty()) {
        text.set(variable, text::texts(names), if any { "" } else { "names in the FMU, one an element" });
        any = true;
    }
    if let Some((variable, _)) = signals.first().filter(|_| !any) {
        text.suggest(&format!("\"{variable}[1]\""), quoted("name_of_your_own"), "in place of the name in the FMU");
    }
}

/// Limits of a control, those of the plant where it has any.
pub fn write_limits(text: &mut Text, plant: Option<&Plant>, m: usize) {
    let own = plant.and_then(|plant| plant.limits.clone());
    let [min, max] = own.unwrap_or_else(|| [vec![-1e15; m], vec![1e15; m]]);
    text.set("u_min", list(&min), "smallest control that acts; -1e15 is no limit");
    text.set("u_max", list(&max), "largest control that acts; 1e15 is no limit");
}

/// Quantities of signals in one line, where they are known.
pub fn write_quantities(text: &mut Text, signals: &[(&str, Vec<String>)]) {
    let known = signals.iter().filter(|(_, quantities)| !quantities.is_empty());
    let entries = known.map(|(name, quantities)| format!("{name} = {}", text::texts(quantities))).collect::<Vec<_>>();
    if !entries.is_empty() {
        text.set(
            "quantities",
            format!("{{ {} }}", entries.join(", ")),
            "quantities of the signals, for descriptions of variables",
        );
    }
}

/// Units of signals in one line.
pub fn write_units(text: &mut Text, signals: &[(&str, &Signals, usize)]) {
    let units = |s: &Signals, len: usize| if s.units.is_empty() { vec![String::new(); len] } else { s.units.clone() };
    let entries = signals.iter().map(|(name, signals, len)| format!("{name} = {}", text::texts(&units(signals, *len))));
    let entries = entries.collect::<Vec<_>>().join(", ");
    text.set("units", format!("{{ {entries} }}"), "of the signals, as rad/s, V, N.m; \"\" is none");
}
