//! Identification of a model from records, with all states measured.

use nalgebra::DMatrix;

use crate::cells::{self, Cell, report, take_out, wrong_cells};
use crate::checks::{self, Estimates};
use crate::data::{Data, Source};
use crate::estimate::{Estimate, Method, estimate};
use crate::faults::{self, Names};
use crate::finding::{Cause, Finding, Kind, Refusal};
use crate::held_out::{Disturbance, bandwidth, take_wrong_out};
use crate::known_rows;
use crate::layout::{Continuous, Layout, Place, factor};
use crate::marquardt::Fit;
use crate::model::rows;
use crate::options::{Identified, Options};
use crate::poles::poles;
use crate::record::{Record, Signals};
use crate::request::{act, duration, parts, tested, without_fixed};
use crate::residuals::Residuals;
use crate::results::Results;
use crate::structure::Entries;
use crate::written::{self, Parts};

/// Identifies x' = A x + B u + d from records in which all states are measured. Without records that are held out as a whole, the last
/// part of each record is.
///
/// # Errors
/// A request that doesn't fit the records, or records that can't give a model.
pub fn identify_states(
    records: &[Record],
    held_out: Option<&[Record]>,
    signals: &Signals,
    options: &Options,
) -> Result<Identified, Refusal> {
    let mut findings = Vec::new();
    let (signals, options) = &mut without_fixed(signals, options, &mut findings)?;
    let fewest = signals.measured.len() + 2;
    let source = Source::new(records, signals, options, fewest)?;
    let (first, last) = parts(records, held_out.is_some(), options)?;
    let (data, records) = source.data(&first, None, Some(&mut findings))?.of_records(records);
    act(options, signals, &data, &mut findings);
    let entries = options.structure.entries(signals, options.offsets)?;
    let layout = Layout::new(&entries, &data.scaling, data.records);
    if layout.count() == 0 {
        return Err(Refusal::new(Cause::Request, "nothing is left to estimate: make an entry \"?\""));
    }
    faults::too_short(&data, layout.count(), "states")?;
    let names = Names::new(signals, records[0]);
    faults::inputs(&data, &names, options.offsets, true)?;
    faults::warnings(&data, &names, &mut findings);
    let data = data.centred(&entries);
    known_rows::check(&data, &entries, options.hold, &names, &mut findings);
    // A known row that is wrong is the reason for a model that isn't found.
    let wrong_row = findings.iter().find(|finding| finding.kind == Kind::WrongRow);
    let wrong_row =
        wrong_row.map(|row| if row.text.ends_with('?') { row.text.clone() } else { format!("{}.", row.text) });
    let with_reason = |refusal: Refusal| match &wrong_row {
        Some(row) if refusal.cause == Cause::NoModel => Refusal::new(Cause::NoModel, format!("{row} {}", refusal.text)),
        _ => refusal,
    };
    let found = Found::new(data, layout, options).map_err(with_reason)?;
    found.report(&records, &names, &mut findings);
    let of = (&*signals, &*options);
    let tested = tested(held_out, (&source, &last), of, (&found.data.scaling, |data| data), &mut findings)?;
    let (tested, tested_records) = tested.unzip();
    let tested_records = tested_records.unwrap_or_default();
    Request { records: &records, tested: &tested_records, names: &names, entries: &entries, options }
        .identified(found, tested, findings)
        .map_err(with_reason)
}

/// An estimate with the data that it is of.
struct Found {
    data: Data,
    layout: Layout,
    estimate: Estimate,
    wrong: Vec<Cell>,
    /// Entries with a sign that ended at 0.
    at_zero: Vec<Place>,
}

impl Found {
    /// Estimates, and again without the cells that are wrong.
    fn new(mut data: Data, layout: Layout, options: &Options) -> Result<Self, Refusal> {
        let longest = options.longest_window.map_or(usize::MAX, |window| (window / data.scaling.h).ceil() as usize);
        let mut found = estimate(&data, &layout, options.hold, longest)?;
        let mut wrong = Vec::new();
        for _ in 0..cells::ROUNDS {
            let cells = wrong_cells(&found.problem(&data, &layout, options.hold), found.fit());
            if cells.is_empty() {
                break;
            }
            take_out(&mut data, &cells);
            wrong.extend(cells);
            found = estimate(&data, &layout, options.hold, longest)?;
        }
        let mut found = Found { data, layout, estimate: found, wrong, at_zero: Vec::new() };
        found.fix_zeros();
        Ok(found)
    }

    /// Makes entries with a sign that ended at 0 known.
    fn fix_zeros(&mut self) {
        let unknowns = self.estimate.fit().unknowns.clone();
        let ended = |k: usize| self.layout.unknowns[k].sign != 0.0 && unknowns[k] == 0.0;
        let zero: Vec<usize> = (0..self.layout.count()).filter(|k| ended(*k)).collect();
        if zero.is_empty() {
            return;
        }
        self.at_zero = zero.iter().map(|k| self.layout.unknowns[*k].place).collect();
        let model = self.layout.matrices(&unknowns[..self.layout.count()]);
        let at_zero = self.at_zero.clone();
        self.layout = self.layout.only(|place| !at_zero.contains(&place), &model);
        let shorten = |fit: &mut Fit| {
            let remaining = fit.unknowns.iter().enumerate().filter(|(k, _)| !zero.contains(k));
            fit.unknowns = remaining.map(|(_, value)| *value).collect();
        };
        shorten(&mut self.estimate.innovation);
        self.estimate.output_error.iter_mut().for_each(shorten);
    }

    fn model_of(&self, fit: &Fit) -> Continuous {
        self.data.uncentred(self.layout.matrices(&fit.unknowns[..self.layout.count()]))
    }

    /// Findings about cells and signs.
    fn report(&self, records: &[&Record], names: &Names, findings: &mut Vec<Finding>) {
        for place in &self.at_zero {
            let name = names.entry(*place);
            let text = format!("{name} ended at 0, the bound of its sign, and counts as known");
            findings.push(Finding::note(Kind::EntryAtZero, text));
        }
        report(&self.data, &self.wrong, records, findings);
    }
}

/// The request with what is needed to answer it.
struct Request<'a> {
    records: &'a [&'a Record],
    /// The records of the held-out part.
    tested: &'a [&'a Record],
    names: &'a Names<'a>,
    entries: &'a Entries,
    options: &'a Options,
}

impl Request<'_> {
    fn identified(
        &self,
        found: Found,
        mut tested: Option<Data>,
        mut findings: Vec<Finding>,
    ) -> Result<Identified, Refusal> {
        let (data, layout, hold) = (&found.data, &found.layout, self.options.hold);
        let fit = found.estimate.fit();
        let problem = found.estimate.problem(data, layout, hold);
        let model = found.model_of(fit);
        let h = data.scaling.h;
        let band = self.options.bandwidth.map_or_else(|| bandwidth(&model.a, data.rows()), |wanted| wanted * h);
        let noise = found.estimate.output_error.as_ref().map_or(&fit.value.rms, |fit| &fit.value.rms);
        let free: Vec<usize> = (0..data.n).filter(|i| self.entries.d[*i].is_free()).collect();
        if let Some(tested) = &mut tested {
            let cells = take_wrong_out(&model, tested, hold, (&free, band), noise);
            report(tested, &cells, self.tested, &mut findings);
        }
        let tested = tested.as_ref();
        let of = (&problem, fit, "states");
        let results = Results::of(of, &model, tested, (&free, band), noise)?;
        let noises = (&found.estimate.innovation.value.rms[..], &results.whiteness[..]);
        checks::refuse_not_followed(results.fits.as_ref(), noises, self.names, "states", "is a state missing?")?;
        let unknowns = &layout.unknowns_of(&model);
        let factors = layout.unknowns.iter().map(|unknown| factor(unknown.place, &data.scaling)).collect();
        let estimates = Estimates { layout, names: self.names, unknowns, uncertainty: &results.uncertainty, factors };
        self.report(&found, &estimates, &results, &mut findings);
        let parts = Parts {
            data,
            layout,
            names: self.names,
            options: self.options,
            records: self.records,
            entries: self.entries,
            model: &model,
            results: &results,
            rms: &fit.value.rms,
            method: match found.estimate.method {
                Method::OutputError => "output error",
                Method::Innovation => "innovation form",
            },
            tested: tested.map(|data| (data, self.tested)),
        };
        Ok(Identified {
            disturbance_over_time: self.course(tested, &results.disturbed),
            losses: [
                found.estimate.output_error.as_ref().map(|fit| fit.value.loss),
                Some(found.estimate.innovation.value.loss),
            ],
            gain: gain(&found, fit),
            wrong_cells: cells::listed(&found.data, &found.wrong, self.names.signals),
            ..written::identified(parts, &estimates, findings)
        })
    }

    fn report(&self, found: &Found, estimates: &Estimates, results: &Results, findings: &mut Vec<Finding>) {
        let pole_list = &results.poles;
        let (data, h) = (&found.data, found.data.scaling.h);
        let duration = duration(self.records);
        estimates.information(pole_list, h, checks::CONDITION, findings);
        estimates.unseen(&found.model_of(found.estimate.fit()).a, data.rows(), findings);
        estimates.kinematics(findings);
        let others = found.estimate.output_error.as_ref().filter(|_| found.estimate.method == Method::Innovation);
        let others = others.map(|fit| {
            let nothing = DMatrix::zeros(found.layout.count(), found.layout.count());
            let all = poles(&found.model_of(fit).a, &found.layout, &nothing);
            all.into_iter().map(|pole| pole.scaled(1.0 / h)).collect::<Vec<_>>()
        });
        checks::unstable(pole_list, others.as_deref(), duration, findings);
        checks::duration(pole_list, duration / self.records.len() as f64, findings);
        let innovation = Estimate { method: Method::Innovation, ..found.estimate.clone() };
        let problem = innovation.problem(data, &found.layout, self.options.hold);
        if let Some(residuals) = Residuals::of(&problem, &found.estimate.innovation) {
            checks::delays(&residuals, data, (self.names, &self.options.delays), findings);
        }
        checks::fits(results.fits.as_ref(), results.own.as_ref(), self.names, findings);
    }

    fn course(&self, tested: Option<&Data>, disturbed: &Disturbance) -> Vec<(f64, Vec<f64>)> {
        let Some(tested) = tested else { return Vec::new() };
        let time = |segment: usize, row: usize| {
            let segment = &tested.segments[segment];
            self.tested.get(segment.record).and_then(|record| record.time.get(segment.first + row)).copied()
        };
        let all = disturbed.course.iter();
        all.map(|(window, values)| (time(window.segment, window.first).unwrap_or(f64::NAN), values.clone())).collect()
    }
}

/// K in units of the data.
fn gain(found: &Found, fit: &Fit) -> Option<Vec<Vec<f64>>> {
    if found.estimate.method == Method::OutputError {
        return None;
    }
    let (n, scale) = (found.data.n, &found.data.scaling.x);
    let scaled = DMatrix::from_row_slice(n, n, &fit.unknowns[found.layout.count()..]);
    Some(rows(&DMatrix::from_fn(n, n, |i, j| scaled[(i, j)] * scale[i] / scale[j])))
}
