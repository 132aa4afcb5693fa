//! From records to a model, where only outputs are measured.

mod companion;
mod order;
mod output_error;
mod subspace;

use nalgebra::DMatrix;

use crate::cells::{self, Cell};
use crate::checks::{self, Estimates};
use crate::data::{Data, Source};
use crate::faults::{self, Names};
use crate::finding::{Cause, Finding, Kind, Refusal};
use crate::held_out::{HeldOut, bandwidth, disturbance, held_out, take_wrong_out};
use crate::layout::{Continuous, Layout, factor};
use crate::linear::spectral_radius;
use crate::marquardt::{Fit, search};
use crate::model::{Fits, Model, rows};
use crate::options::{Identified, Options, OrderFit};
use crate::poles::poles;
use crate::problem::Problem;
use crate::record::{Record, Signals};
use crate::request::{parts, without_fixed};
use crate::residuals::Residuals;
use crate::sampled::Hold;
use crate::text::number;
use crate::uncertainty::{Uncertainty, physical};
use crate::written::{estimated, free, record_of, units};

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
    let (signals, options) = &without_fixed(signals, options, &mut findings)?;
    let source = Source::new(records, signals, &options.delays, order::FEWEST)?;
    let (first, last) = parts(records, held_out.is_some(), options)?;
    let mut data = order::uniform(source.data(&first, None, Some(&mut findings))?);
    let names = Names::new(signals, &records[0]);
    let most = order::most(&data)?;
    faults::inputs(&data, &names, options.offsets, false)?;
    faults::warnings(&data, &names, &mut findings);
    let tested = match held_out {
        Some(records) => {
            let source = Source::new(records, signals, &options.delays, order::FEWEST)?;
            let part = records.iter().map(|record| 0..record.len()).collect();
            Some(source.data(&part, Some(&data.scaling), None)?)
        }
        None => source.data(&last, Some(&data.scaling), None).ok(),
    };
    let mut tested = tested.map(order::uniform);
    let mut choice = Choice::new(&data, tested.as_ref(), options.order, most)?;
    let failed = || {
        Refusal::new(Cause::NoModel, "no model of these outputs follows the record: its companion form isn't finite")
    };
    let mut found = Found::new(&data, &choice).ok_or_else(failed)?;
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
        choice = Choice::new(&data, tested.as_ref(), options.order, most)?;
        found = Found::new(&data, &choice).ok_or_else(failed)?;
    }
    cells::report(&data, &wrong, records, &mut findings);
    let tested_records = held_out.unwrap_or(records);
    if let Some(tested) = &tested {
        cells::report(tested, &wrong_tested, tested_records, &mut findings);
    }
    let wrong = cells::listed(&data, &wrong, signals);
    let request = Request { records, names: &names, options };
    let identified = request.identified(&found, tested.as_ref(), choice.orders, findings)?;
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
    fn new(data: &Data, choice: &Choice) -> Option<Self> {
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
    records: &'a [Record],
    names: &'a Names<'a>,
    options: &'a Options,
}

impl Request<'_> {
    fn identified(
        &self,
        found: &Found,
        tested: Option<&Data>,
        orders: Vec<OrderFit>,
        mut findings: Vec<Finding>,
    ) -> Result<Identified, Refusal> {
        let failed = || Refusal::new(Cause::NoModel, "no model of these outputs follows the record: it isn't finite");
        let (data, layout, problem) = (&found.data, &found.layout, found.problem());
        let uncertainty = Uncertainty::of(&problem, &found.fit).ok_or_else(failed)?;
        let residuals = Residuals::of(&problem, &found.fit).ok_or_else(failed)?;
        let (model, h) = (found.model(), data.scaling.h);
        let band = self.options.bandwidth.map_or_else(|| bandwidth(&model.a, data.rows()), |wanted| wanted * h);
        let noise = &found.fit.value.rms;
        let tested = tested.map(|tested| found.companion.data(tested, data.state_scaling()));
        let hold = Hold::ZeroOrder;
        let fits = tested.as_ref().and_then(|data| held_out(&model, data, hold, (&[], band), noise));
        let whiteness = residuals.whiteness(data.n);
        self.refuse_bad(fits.as_ref(), &whiteness, noise)?;
        let disturbed =
            tested.as_ref().and_then(|data| disturbance(&model, data, hold, band, noise)).unwrap_or_default();
        let pole_list: Vec<_> =
            poles(&model.a, layout, &uncertainty.covariance).into_iter().map(|pole| pole.scaled(1.0 / h)).collect();
        let factors = layout.unknowns.iter().map(|unknown| factor(unknown.place, data.state_scaling())).collect();
        let unknowns = &found.fit.unknowns;
        let estimates = Estimates { layout, names: self.names, unknowns, uncertainty: &uncertainty, factors };
        estimates.information(&pole_list, h, checks::CONDITION_OF_COMPANION, &mut findings);
        let duration: f64 = self.records.iter().map(|record| record.time[record.len() - 1] - record.time[0]).sum();
        checks::unstable(&pole_list, None, duration, &mut findings);
        checks::duration(&pole_list, duration / self.records.len() as f64, &mut findings);
        if let Some(fits) = &fits {
            checks::fits(fits, self.names, &mut findings);
        }
        let n = found.companion.states.len();
        findings.push(Finding::note(Kind::Order, order_text(&orders, n)));
        Ok(Identified {
            model: self.file(found, &model, &uncertainty, (fits.as_ref(), whiteness), disturbed.matched.clone()),
            entries: estimated(&estimates),
            poles: pole_list,
            condition: uncertainty.condition,
            ceiling: fits.map_or_else(Vec::new, |fits| fits.ceiling),
            unmatched: disturbed.unmatched,
            disturbance_over_time: Vec::new(),
            losses: [Some(found.fit.value.loss), None],
            gain: None,
            wrong_cells: Vec::new(),
            orders,
            findings,
        })
    }

    fn refuse_bad(&self, fits: Option<&HeldOut>, whiteness: &[f64], noise: &[f64]) -> Result<(), Refusal> {
        let Some((signal, best)) = fits.and_then(|fits| fits.not_followed(noise, whiteness)) else { return Ok(()) };
        let text = format!(
            "no model of these outputs follows the record (best: {} % of the held-out motion of {}): is an input missing?",
            number(best),
            self.names.signals.measured[signal]
        );
        Err(Refusal::new(Cause::NoModel, text))
    }

    fn file(
        &self,
        found: &Found,
        model: &Continuous,
        uncertainty: &Uncertainty,
        (fits, whiteness): (Option<&HeldOut>, Vec<f64>),
        disturbance: Vec<f64>,
    ) -> Model {
        let (data, layout, signals) = (&found.data, &found.layout, self.names.signals);
        let mut in_units = model.physical(data.state_scaling());
        found.companion.entries().restore(&mut in_units.a, &mut in_units.b);
        let covariance = physical(&uncertainty.covariance, layout, |place| factor(place, data.state_scaling()));
        let noise: Vec<f64> = found.fit.value.rms.iter().zip(&data.scaling.x).map(|(rms, scale)| rms * scale).collect();
        let state = |(output, order): &(usize, usize)| format!("{}{}", signals.measured[*output], "'".repeat(*order));
        Model {
            A: rows(&in_units.a),
            B: rows(&in_units.b),
            C: rows(&found.companion.outputs(data)),
            states: found.companion.states.iter().map(state).collect(),
            inputs: signals.inputs.clone(),
            outputs: signals.measured.clone(),
            // Units of derivatives are for a caller that knows units.
            units: units(self.names).map(|all| crate::model::Units { x: Vec::new(), ..all }),
            delay: self.options.delays.clone(),
            sample_time: data.scaling.h,
            offset: rows(&in_units.d.transpose()),
            free: layout.unknowns.iter().map(|unknown| free(unknown.place)).collect(),
            covariance: rows(&covariance),
            kappa: uncertainty.kappa.clone(),
            noise,
            disturbance,
            level: self.options.level,
            fit: fits.map_or_else(Fits::default, |fits| Fits {
                held_out: fits.whole.clone().unwrap_or_default(),
                windows: fits.windows.clone(),
            }),
            whiteness,
            records: self.records.iter().map(record_of).collect(),
            method: "output error, outputs only".to_owned(),
            ..Model::default()
        }
    }
}

fn order_text(orders: &[OrderFit], chosen: usize) -> String {
    if orders.len() < 2 {
        return format!("order {chosen}, as given");
    }
    let text = |fit: &OrderFit| {
        let held_out = fit.held_out.map_or("none".to_owned(), |fit| format!("{} %", crate::text::digits(fit, 4)));
        format!("{}: {held_out}", fit.order)
    };
    let all: Vec<String> = orders.iter().map(text).collect();
    format!("order {chosen} is the least that follows the held-out part as well as others do ({})", all.join(", "))
}
