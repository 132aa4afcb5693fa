//! The text of a new MRAC for unmatched uncertainty.
#![allow(non_snake_case)] // matrices have the names of the field

use std::fmt::Write as _;

use nalgebra::DMatrix;

use super::MracPpfUnmatched;
use super::structure::reached_rows;
use crate::catalogue::Catalogued;
use crate::controllers::template::{design, require_no_delay, stop_time, write_nominal, write_plant};
use crate::error::Invalid;
use crate::mathematics::pole_placement;
use crate::template::{
    Begun, Plant, Request, Values, all, list, named, round_down, rows, three_digits, write_limits, write_magnitudes,
    write_names, write_quantities, write_units,
};

/// Rates of the barriers, in parts of the bandwidth: of a state that drives an unmatched row, of that row, and of the others.
const BARRIERS: [f64; 3] = [30.0, 10.0, 30.0];
/// Widths of their funnels in the end, in parts of the state's usual magnitude. The barrier of an unmatched row hands noise on to
/// the state that drives it, so many times as large as its rate is: noise of 1 % of the output is a tenth of that state.
const WIDTHS: [f64; 3] = [1.0, 0.1, 0.1];
/// Bounds of the estimates of an unmatched row, in parts of what drives it: below 1, so that it drives it the same way.
const OF_DRIVE: f64 = 0.5;
/// Ratio of a barrier's speed to the adaptation that it answers.
const SLOWER: f64 = 30.0;
/// Leakage of theta_hat for states of 1 and a bandwidth of 1 rad/s.
const LEAKAGE: f64 = 0.05;

/// A funnel about each state.
pub fn write(request: &Request) -> Result<Begun, Invalid> {
    let plant = request.plant(true)?;
    require_no_delay(&plant)?;
    let (n, m, _) = plant.sizes();
    let (bandwidth, references) = (request.speed(&plant)?, request.references(m)?);
    let driven = driven(&plant)?;
    let poles = design::poles(&plant.A, &plant.B, bandwidth)?;
    let A_m = &plant.A - &plant.B * pole_placement::place(&plant.A, &plant.B, &poles)?;
    let A_m = exact(&A_m, &plant.A, &driven);
    let numbers = Numbers::of([&plant.A, &A_m], &driven, bandwidth, &sizes(&plant, &references));
    let fastest = numbers.rates.iter().copied().fold(bandwidth, f64::max);
    let step = round_down(0.3 / fastest);
    let mut text = request.begin(&MracPpfUnmatched::PAGE, stop_time(bandwidth), step);
    text.table("structure");
    write_plant(&mut text, &plant, "outputs that follow the reference");
    if !driven.is_empty() {
        let mut listed = String::new();
        for (place, (row, by)) in driven.iter().enumerate() {
            let comma = if place > 0 { ", " } else { "" };
            let _ = write!(listed, "{comma}{{ row = {}, driven_by = {} }}", row + 1, by + 1);
        }
        text.set("unmatched", format!("[{listed}]"), "rows of zeros in B, and what drives each");
    }
    write_units(&mut text, &[("r", &plant.y, m), ("x", &plant.x, n), ("u", &plant.u, m)]);
    write_quantities(&mut text, &[("x", plant.x.quantities()), ("u", plant.u.quantities())]);
    let (r, x, u) = (named(&plant.y, "_reference"), named(&plant.x, ""), named(&plant.u, ""));
    write_names(&mut text, &[("r", r), ("x", x), ("u", u)]);
    text.table("start");
    text.set("A_m", rows(&A_m), "reference model; its unmatched rows are those of A");
    text.set("rho_0", list(&numbers.start), "bound of each error at the start");
    text.set("rho_inf", list(&numbers.end), "and in the end");
    text.set("decay_rate", all(three_digits(0.5 * bandwidth), n), "1/s, how fast the bounds narrow");
    text.set("on_funnel_exit", "\"reopen\"", "\"error\": a step in which an error leaves is refused");
    text.set("K_epsilon", list(&numbers.K), "gain of the barriers");
    text.set("gamma", list(&numbers.gamma), "adaptation gains; check reports the largest ones for unmatched rows");
    text.set("theta_bound", list(&numbers.theta), "bounds of the estimates");
    text.set("theta_leakage", list(&numbers.leakage), "so that noise doesn't drive theta_hat");
    text.set("sigma_bound", list(&numbers.sigma), "and of those of disturbances");
    write_limits(&mut text, Some(&plant), m);
    write_magnitudes(&mut text, request.plant.as_ref(), (&references, bandwidth), |of| {
        let theta = Values::Rows(DMatrix::from_fn(n, n, |i, _| numbers.theta[i]));
        let estimates = [("theta_hat", theta), ("sigma_hat", (&numbers.sigma).into())];
        let others = [("x_m", (&of.x).into()), ("u_b", (&of.u).into()), ("u", (&of.u).into())];
        estimates.into_iter().chain(others).collect()
    });
    write_nominal(&mut text, request, bandwidth, &request.uncertainty());
    Ok(text.finish())
}

/// Usual magnitudes of the states: of those that outputs show by the references, of others the largest.
fn sizes(plant: &Plant, references: &[f64]) -> Vec<f64> {
    let largest = references.iter().copied().fold(0.0, f64::max);
    let of = |i: usize| {
        let column = plant.C.column(i);
        let shown = column.iter().zip(references).filter(|(entry, _)| **entry != 0.0);
        shown.map(|(entry, size)| size / entry.abs()).reduce(f64::max).unwrap_or(largest)
    };
    (0..plant.A.nrows()).map(of).collect()
}

/// The unmatched rows, each with the state that drives it most and no other row.
fn driven(plant: &Plant) -> Result<Vec<(usize, usize)>, Invalid> {
    let reached = reached_rows(&plant.B);
    let mut found: Vec<(usize, usize)> = Vec::new();
    for row in (0..plant.A.nrows()).filter(|row| !reached.contains(row)) {
        let size = |&by: &usize| plant.A[(row, by)].abs();
        let free = reached.iter().copied().filter(|by| found.iter().all(|(_, taken)| taken != by));
        let by = free.max_by(|one, other| size(one).total_cmp(&size(other))).filter(|by| size(by) > 0.0);
        let because = || {
            let row = row + 1;
            Invalid::because(format!(
                "row {row} of B is zero, and row {row} of A has no free state that the controls reach: at most one \
                 integrator is allowed between a control and such a row"
            ))
        };
        found.push((row, by.ok_or_else(because)?));
    }
    Ok(found)
}

/// A_m with the rows of A where no control reaches: feedback changes nothing in them but by rounding.
fn exact(A_m: &DMatrix<f64>, A: &DMatrix<f64>, driven: &[(usize, usize)]) -> DMatrix<f64> {
    let mut exact = A_m.clone();
    driven.iter().for_each(|&(row, _)| exact.row_mut(row).copy_from(&A.row(row)));
    exact
}

/// Numbers of each row.
struct Numbers {
    start: Vec<f64>,
    end: Vec<f64>,
    rates: Vec<f64>,
    K: Vec<f64>,
    gamma: Vec<f64>,
    theta: Vec<f64>,
    leakage: Vec<f64>,
    sigma: Vec<f64>,
}

impl Numbers {
    fn of([A, A_m]: [&DMatrix<f64>; 2], driven: &[(usize, usize)], bandwidth: f64, sizes: &[f64]) -> Self {
        let n = A.nrows();
        let of_row = |i: usize| driven.iter().find(|(row, _)| *row == i).copied();
        let by = |i: usize| driven.iter().find(|(_, by)| *by == i).copied();
        // A state that drives a row is as large as that row needs it.
        let size = |i: usize| {
            let (row, by) = by(i)?;
            Some(sizes[row] * (bandwidth + A[(row, row)].abs()) / A[(row, by)].abs())
        };
        let size = |i: usize| size(i).unwrap_or(sizes[i]);
        let part = |i: usize| if by(i).is_some() { 0 } else { 2 - usize::from(of_row(i).is_some()) };
        let rates: Vec<_> = (0..n).map(|i| BARRIERS[part(i)] * bandwidth).collect();
        let end: Vec<_> = (0..n).map(|i| three_digits(WIDTHS[part(i)] * size(i))).collect();
        let answered = |i: usize| rates[of_row(i).map_or(i, |(_, by)| by)];
        let largest = 1.0 + (0..n).map(|i| size(i).powi(2)).sum::<f64>();
        let greatest = (0..n).map(size).fold(0.0, f64::max);
        let unknown = A.amax().max(A_m.amax()).max(bandwidth);
        let theta = |i: usize| of_row(i).map_or(unknown, |(row, by)| OF_DRIVE * A[(row, by)].abs());
        let numbers = |of: &dyn Fn(usize) -> f64| (0..n).map(|i| three_digits(of(i))).collect::<Vec<_>>();
        Numbers {
            start: numbers(&|i| 2.0 * size(i)),
            K: numbers(&|i| rates[i] * end[i] * end[i]),
            gamma: numbers(&|i| (end[i] * answered(i) / SLOWER).powi(2) / largest),
            theta: numbers(&theta),
            leakage: numbers(&|i| LEAKAGE * greatest * greatest / (bandwidth * size(i))),
            sigma: numbers(&|i| unknown * size(i)),
            rates,
            end,
        }
    }
}
