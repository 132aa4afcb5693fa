//! The text of a new PID controller: decoupled by the nominal plant, its poles where they are asked for.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, RowDVector};

use super::{Pid, inverse};
use crate::catalogue::Catalogued;
use crate::controllers::template::{design, stop_time};
use crate::eigenvalues;
use crate::error::Invalid;
use crate::template::{
    Plant, Request, all, list, named, number, round_down, rows, three_digits, write_limits, write_names,
    write_quantities, write_units,
};

/// How many times the bandwidth is tried, until the nominal loop is stable.
const FACTORS: [f64; 6] = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0];
/// How far the derivative's filter lies above the bandwidth.
const FILTER: f64 = 20.0;

/// An output of the nominal plant as the controller takes it, y' = α y + v or y'' = α y + β y' + v.
#[derive(Debug)]
enum Chain {
    First { alpha: f64 },
    Second { alpha: f64, beta: f64 },
}

/// Gains, one a channel.
#[derive(Debug, Default)]
struct Gains {
    K_p: Vec<f64>,
    K_i: Vec<f64>,
    K_d: Vec<f64>,
    N: f64,
}

/// PID control that makes each output a chain of its own.
pub fn write(request: &Request) -> Result<String, Invalid> {
    let plant = request.plant(true)?;
    let (_, m, _) = plant.sizes();
    let (chains, S) = decoupled(&plant)?;
    let least = design::bandwidth(&plant, request.bandwidth)?;
    let tried = FACTORS.map(|factor| three_digits(factor * least));
    let stable = tried.into_iter().find(|&bandwidth| is_stable(&plant, &S, &Gains::of(&chains, bandwidth)));
    let Some(bandwidth) = stable else {
        let [.., most] = tried;
        let reason = format!(
            "A, B, C: no such PID control of {least} … {most} rad/s makes the nominal plant stable: what doesn't show in \
             the outputs must be stable by itself"
        );
        return Err(Invalid::because(reason));
    };
    let Gains { K_p, K_i, K_d, N } = Gains::of(&chains, bandwidth);
    let step = round_down((0.1 / N).min(1e-3));
    let mut text = request.begin(&Pid::PAGE, stop_time(bandwidth), step);
    text.table("structure");
    text.set("channels", m, "outputs, each with a control of its own");
    write_units(&mut text, &[("y", &plant.y, m), ("u", &plant.u, m)]);
    write_quantities(&mut text, &[("y", plant.output_quantities()), ("u", plant.u.quantities())]);
    let (r, y, u) = (named(&plant.y, "_reference"), named(&plant.y, ""), named(&plant.u, ""));
    write_names(&mut text, &[("r", r), ("y", y), ("u", u)]);
    text.table("start");
    text.comment(&format!(
        "Poles of each channel at -{} 1/s, and where the plant itself is faster.",
        number(bandwidth)
    ));
    text.set("K_p", list(&K_p), "proportional gains");
    text.set("K_i", list(&K_i), "1/s, integral gains");
    text.set("K_d", list(&K_d), "s, derivative gains");
    text.set("b", all(1.0, m), "weight of the reference in the proportional part");
    text.set("c", all(1.0, m), "and in the derivative; 0 where the reference jumps");
    text.set("N", all(N, m), "rad/s, filter of the derivative: lower is less noise in the control");
    text.set("S", rows(&S), "from what the channels ask for to the controls: the inverse of how the plant answers");
    write_limits(&mut text, Some(&plant), m);
    text.set(
        "tracking_time",
        all(-1.0, m),
        "s, I follows what the limits leave; -1: by the gains, 0: off, it winds up",
    );
    Ok(text.finish())
}

/// Each output, differentiated until the control shows in it, and the inverse of how it does.
fn decoupled(plant: &Plant) -> Result<(Vec<Chain>, DMatrix<f64>), Invalid> {
    let Plant { A, B, C, .. } = plant;
    let mut G = DMatrix::zeros(C.nrows(), B.ncols());
    let mut chains = Vec::new();
    for (i, row) in C.row_iter().enumerate() {
        let y = row.into_owned();
        let rates = [&y * A, &y * A * A];
        let shows = |rate: &RowDVector<f64>| (rate * B).amax() > 1e-9 * rate.amax() * B.amax();
        let chain = if shows(&y) {
            G.set_row(i, &(&y * B));
            Chain::first(&y, &rates)
        } else if shows(&rates[0]) {
            G.set_row(i, &(&rates[0] * B));
            Chain::second(&y, &rates)
        } else {
            let allowed = "must be 1 or 2: the control must show in the first or the second derivative of each output";
            return Err(Invalid::new(format!("relative degree of output {}", i + 1), "3 or more", allowed));
        };
        chains.push(chain);
    }
    if !(G.norm_squared() + chains.iter().map(|chain| chain.gains(1.0)[0]).sum::<f64>()).is_finite() {
        return Err(Invalid::because("the entries of A, B and C differ by too many powers of ten"));
    }
    let text = "A, B, C: the controls must move the outputs, or their rates, independently of each other";
    let S = inverse::inverse(&G).map_err(|_| Invalid::because(text))?;
    Ok((chains, S.map(three_digits)))
}

impl Chain {
    /// What of y' = C A x is α y.
    fn first(y: &RowDVector<f64>, [rate, _]: &[RowDVector<f64>; 2]) -> Self {
        Chain::First { alpha: rate.dot(y) / y.norm_squared() }
    }

    /// What of y'' = C A² x is α y + β y', by least squares.
    fn second(y: &RowDVector<f64>, [rate, second]: &[RowDVector<f64>; 2]) -> Self {
        let (yy, yr, rr) = (y.norm_squared(), y.dot(rate), rate.norm_squared());
        let (of_y, of_rate) = (second.dot(y), second.dot(rate));
        let determinant = yy * rr - yr * yr;
        Chain::Second {
            alpha: (rr * of_y - yr * of_rate) / determinant,
            beta: (yy * of_rate - yr * of_y) / determinant,
        }
    }

    /// K_p, K_i and K_d that put all poles at −ω, but one of them farther where the plant is faster than that; no gain is
    /// below 0.
    fn gains(&self, omega: f64) -> [f64; 3] {
        let gains = match *self {
            Chain::First { alpha } => {
                let faster = omega.max(-alpha - omega);
                [omega + faster + alpha, omega * faster, 0.0]
            }
            Chain::Second { alpha, beta } => {
                let faster = omega.max(-beta - 2.0 * omega);
                [omega * (omega + 2.0 * faster) + alpha, omega * omega * faster, faster + 2.0 * omega + beta]
            }
        };
        gains.map(|gain| three_digits(gain.max(0.0)))
    }
}

impl Gains {
    fn of(chains: &[Chain], bandwidth: f64) -> Self {
        let mut gains = Gains { N: three_digits(FILTER * bandwidth), ..Gains::default() };
        for [K_p, K_i, K_d] in chains.iter().map(|chain| chain.gains(bandwidth)) {
            gains.K_p.push(K_p);
            gains.K_i.push(K_i);
            gains.K_d.push(K_d);
        }
        gains
    }
}

/// True if the nominal loop is, with the filter.
fn is_stable(plant: &Plant, S: &DMatrix<f64>, gains: &Gains) -> bool {
    let Plant { A, B, C, .. } = plant;
    let (n, m, _) = plant.sizes();
    let Gains { K_p, K_i, K_d, N } = gains;
    let BS = B * S;
    let mut M = DMatrix::zeros(n + 2 * m, n + 2 * m);
    M.view_mut((0, 0), (n, n)).copy_from(A);
    for i in 0..m {
        let (of_I, of_w) = (n + i, n + m + i);
        let (column, output) = (BS.column(i), C.row(i));
        let mut states = M.view_mut((0, 0), (n, n));
        states -= column * output * (K_p[i] + K_d[i] * N);
        M.view_mut((0, of_I), (n, 1)).copy_from(&column);
        M.view_mut((0, of_w), (n, 1)).copy_from(&(column * (-K_d[i] * N)));
        M.view_mut((of_I, 0), (1, n)).copy_from(&(output * -K_i[i]));
        M.view_mut((of_w, 0), (1, n)).copy_from(&(output * -*N));
        M[(of_w, of_w)] = -N;
    }
    let poles = eigenvalues::complex(&M);
    poles.is_some_and(|poles| poles.iter().all(|pole| pole.re < -1e-9 * pole.norm()))
}
