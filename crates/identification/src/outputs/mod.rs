//! Identification of a model from records, with only outputs measured.

mod companion;
mod order;
mod output_error;
mod subspace;

use nalgebra::DMatrix;

use crate::cells::{self, Cell};
use crate::checks::{self, Estimates};
use crate::data::{Data, Segment, Source};
use crate::faults::{self, Names};
use crate::finding::{Cause, Finding, Kind, Refusal};
use crate::held_out::{bandwidth, take_wrong_out};
use crate::layout::{Continuous, Layout, factor};
use crate::linear::spectral_radius;
use crate::marquardt::{Fit, MOST_GROWTH, search};
use crate::model::{Model, Units, rows};
use crate::options::{Identified, Options, OrderFit};
use crate::problem::Problem;
use crate::record::{Record, Signals};
use crate::request::{act, duration, parts, tested, without_fixed};
use crate::results::Results;
use crate::sampled::Hold;
use crate::text::{digits, number};
use crate::written::{self, Parts};

use companion::Companion;
use order::Choice;

/// Steps of the search in the companion form's own unknowns, from where the sampled model's ended.
const STEPS: usize = 10;

/// Identifies a model from records in which only outputs are measured: its order, and x' = A x + B u + d, y = C x in observable
/// companion form. [`Signals::measured`] are the outputs.
///
/// # Errors
/// A request that doesn't fit the records, or records that can't give a model.
pub fn identify_outputs(
    records: &[Record],
    held_out: Option<&[Record]>,
    signals: &Signals,
    options: &Options,
) -> Result<Identified, Refusal> {
    let mut findings = Vec::new();
    check(options)?;
    let (signals, options) = &mut without_fixed(signals, options, &mut findings)?;
    let source = Source::new(records, signals, options, order::FEWEST)?;
    let (first, last) = parts(records, held_out.is_some(), options)?;
    let data = source.data(&first, None, Some(&mut findings))?;
    let rows = order::rows(&data);
    let data = order::uniform(data);
    order::report(&rows, &data, records, &mut findings);
    let most = order::most(&data)?;
    let (mut data, records) = data.of_records(records);
    act(options, signals, &data, &mut findings);
    let names = Names::new(signals, records[0]);
    faults::inputs(&data, &names, options.offsets, false)?;
    faults::warnings(&data, &names, &mut findings);
    let of = (&*signals, &*options);
    let (mut tested, tested_records) =
        tested(held_out, (&source, &last), of, (&data.scaling, order::uniform), &mut findings)?.unzip();
    let mut choice = Choice::new(&data, tested.as_ref(), options.order, most)?;
    let mut found = Found::new(&data, &choice)?;
    let (mut wrong, mut wrong_tested) = (Vec::new(), Vec::new());
    for _ in 0..cells::ROUNDS {
        let cells = cells::wrong_cells(&found.problem(), &found.fit);
        let of_tested = tested.as_mut().map_or_else(Vec::new, |tested| found.take_wrong_out(tested));
        if cells.is_empty() && of_tested.is_empty() {
            break;
        }
        cells::take_out(&mut data, &cells);
        wrong.extend(cells);
        wrong_tested.extend(of_tested);
        // The others follow once no cell is wrong any more.
        let order = found.companion.states.len();
        choice = Choice::new(&data, tested.as_ref(), Some(order), most)?;
        found = Found::new(&data, &choice)?;
    }
    if options.order.is_none() && !(wrong.is_empty() && wrong_tested.is_empty()) {
        choice = Choice::new(&data, tested.as_ref(), None, most)?;
        found = Found::new(&data, &choice)?;
    }
    cells::report(&data, &wrong, &records, &mut findings);
    if let (Some(tested), Some(records)) = (&tested, &tested_records) {
        cells::report(tested, &wrong_tested, records, &mut findings);
    }
    let wrong = cells::listed(&data, &wrong, signals);
    let request =
        Request { records: &records, tested: tested_records.as_deref().unwrap_or_default(), names: &names, options };
    let identified = request.identified(&found, tested.as_ref(), choice, findings)?;
    Ok(Identified { wrong_cells: wrong, ..identified })
}

/// Refuses options that have no meaning for outputs.
fn check(options: &Options) -> Result<(), Refusal> {
    let refuse = |text: &str| Err(Refusal::new(Cause::Request, text));
    if options.structure != Default::default() {
        return refuse("a structure needs measured states: those of a model from measured outputs have no names");
    }
    if options.hold != Hold::ZeroOrder {
        return refuse("models from measured outputs need inputs behind a zero-order hold");
    }
    if !options.offsets {
        return refuse(
            "models from measured outputs have a constant of each output in each record: it can't be left out",
        );
    }
    if options.longest_window.is_some() {
        return refuse("models from measured outputs follow whole records: there is no longest window");
    }
    Ok(())
}

/// The companion form with its own unknowns, estimated.
struct Found {
    companion: Companion,
    data: Data,
    layout: Layout,
    fit: Fit,
}

impl Found {
    fn new(data: &Data, choice: &Choice) -> Result<Self, Refusal> {
        let refusal =
            |why: &str| Refusal::new(Cause::NoModel, format!("no model of these outputs follows the record: {why}"));
        // A search ends at the most that errors of an initial state may grow.
        let rate = spectral_radius(&choice.model.f).ln();
        let longest = data.segments.iter().map(Segment::len).max().unwrap_or(0);
        if rate * longest as f64 > 0.99 * MOST_GROWTH.ln() {
            let pole = number(rate / data.scaling.h);
            return Err(refusal(&format!(
                "a pole of {pole} 1/s or more is unstable, over so long a record. Use shorter records, or measure the states"
            )));
        }
        Self::searched(data, choice).ok_or_else(|| refusal("its companion form isn't finite"))
    }

    fn searched(data: &Data, choice: &Choice) -> Option<Self> {
        let companion = Companion::new(&choice.model)?;
        let frequency = spectral_radius(&companion.a).max(1e-3);
        let scaling = companion.scaling(&data.scaling, frequency);
        let data = companion.data(data, &scaling);
        let layout = Layout::new(&companion.entries(), &scaling, data.records);
        // From samples and scaled outputs to the states' own scale.
        let size = |row: usize| frequency.powi(companion.states[row].1 as i32);
        let n = companion.states.len();
        let model = Continuous {
            a: DMatrix::from_fn(n, n, |i, j| companion.a[(i, j)] * size(j) / size(i)),
            b: DMatrix::from_fn(n, data.m, |i, j| companion.b[(i, j)] / size(i)),
            d: DMatrix::zeros(n, data.records),
        };
        let start = layout.unknowns_of(&model);
        let problem = Problem::new(&data, &layout, Hold::ZeroOrder, usize::MAX, false);
        let fit = search(&problem, &start, STEPS)?;
        Some(Found { companion, layout, fit, data })
    }

    fn problem(&self) -> Problem<'_> {
        Problem::new(&self.data, &self.layout, Hold::ZeroOrder, usize::MAX, false)
    }

    /// Takes wrong cells out of the held-out part; these cells.
    fn take_wrong_out(&self, tested: &mut Data) -> Vec<Cell> {
        let mut seen = self.companion.data(tested, self.data.state_scaling());
        let (model, noise) = (self.model(), &self.fit.value.rms);
        let band = bandwidth(&model.a, self.data.rows());
        let cells = take_wrong_out(&model, &mut seen, Hold::ZeroOrder, (&[], band), noise);
        cells::take_out(tested, &cells);
        cells
    }

    fn model(&self) -> Continuous {
        self.layout.matrices(&self.fit.unknowns)
    }
}

/// The request with what is needed to answer it.
struct Request<'a> {
    records: &'a [&'a Record],
    /// The records of the held-out part.
    tested: &'a [&'a Record],
    names: &'a Names<'a>,
    options: &'a Options,
}

impl Request<'_> {
    fn identified(
        &self,
        found: &Found,
        tested: Option<&Data>,
        choice: Choice,
        mut findings: Vec<Finding>,
    ) -> Result<Identified, Refusal> {
        let (data, layout, problem) = (&found.data, &found.layout, found.problem());
        let (model, h) = (found.model(), data.scaling.h);
        let band = self.options.bandwidth.map_or_else(|| bandwidth(&model.a, data.rows()), |wanted| wanted * h);
        let noise = &found.fit.value.rms;
        let tested = tested.map(|tested| found.companion.data(tested, data.state_scaling()));
        let results = Results::of((&problem, &found.fit, "outputs"), &model, tested.as_ref(), (&[], band), noise)?;
        let (fits, pole_list) = (results.fits.as_ref(), &results.poles);
        let noises = (&noise[..], &results.whiteness[..]);
        checks::refuse_not_followed(fits, noises, self.names, "outputs", "is an input missing?")?;
        let factors = layout.unknowns.iter().map(|unknown| factor(unknown.place, data.state_scaling())).collect();
        let unknowns = &found.fit.unknowns;
        let estimates = Estimates { layout, names: self.names, unknowns, uncertainty: &results.uncertainty, factors };
        estimates.information(pole_list, h, checks::CONDITION_OF_COMPANION, &mut findings);
        let duration = duration(self.records);
        checks::unstable(pole_list, None, duration, &mut findings);
        checks::duration(pole_list, duration / self.records.len() as f64, &mut findings);
        checks::fits(fits, results.own.as_ref(), self.names, &mut findings);
        let order = found.companion.states.len();
        findings.push(Finding::note(Kind::Order, order_text(&choice, order, (self.options.order, fits.is_some()))));
        let parts = Parts {
            data,
            layout,
            names: self.names,
            options: self.options,
            records: self.records,
            entries: &found.companion.entries(),
            model: &model,
            results: &results,
            rms: noise,
            method: "output error, outputs only",
            tested: tested.as_ref().map(|data| (data, self.tested)),
        };
        let whole = written::identified(parts, &estimates, findings);
        Ok(Identified {
            model: Model {
                C: rows(&found.companion.outputs(data)),
                states: state_names(&found.companion.states, self.names.signals),
                // Units of derivatives are for a caller that knows units.
                units: whole.model.units.clone().map(|all| Units { x: Vec::new(), ..all }),
                ..whole.model
            },
            losses: [Some(found.fit.value.loss), None],
            orders: choice.orders,
            ..whole
        })
    }
}

/// Names of the states: each output, and its derivatives as `y_1`, which controllers take as a name.
fn state_names(states: &[(usize, usize)], signals: &Signals) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for &(output, order) in states {
        let mut name = signals.measured[output].clone();
        if order > 0 {
            name += &format!("_{order}");
            while signals.inputs.contains(&name) || signals.measured.contains(&name) || names.contains(&name) {
                name.push('_');
            }
        }
        names.push(name);
    }
    names
}

/// The reason for an order, with those that were tried.
fn order_text(choice: &Choice, order: usize, (given, has_held_out): (Option<usize>, bool)) -> String {
    let list = |of: &dyn Fn(&OrderFit) -> String| {
        let all: Vec<String> = choice.orders.iter().map(|fit| format!("{}: {}", fit.order, of(fit))).collect();
        all.join(", ")
    };
    if given.is_some() {
        return format!("order {order}, as given");
    }
    if choice.is_by_fit {
        let all = list(&|fit| fit.held_out.map_or("none".to_owned(), |fit| format!("{} %", digits(fit, 4))));
        return format!("order {order} is the least that follows the held-out part as well as others do ({all})");
    }
    let why = if has_held_out { "the held-out part doesn't move" } else { "nothing is held out" };
    format!("{why}: order {order} is by BIC, of which less is better ({})", list(&|fit| digits(fit.bic, 5)))
}
