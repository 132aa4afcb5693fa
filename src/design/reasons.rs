//! Why a plant has no first design.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{Complex, DMatrix};

use super::nominal::Nominal;
use super::search::{Asked, Law, modulus_of, speeds};
use super::{complex, digits};

/// Sizes below this count as 0, in W.
const AT_REST: f64 = 1e-6;
/// A singular value that is so small, in parts of ‖A‖, is 0: the mode doesn't show, or isn't moved.
const HIDDEN: f64 = 1e-9;
/// An unstable pole p with a dead time τ has a margin up to about this p τ.
const MOST_LAG: f64 = 0.3;
/// An M_s of any controller above this may be why there is none.
const TELLING: f64 = 1.5;
/// A dead time so many times 1/W is long.
const LONG: f64 = 30.0;
/// Modulus of the worst loop that is worth telling, and how much better the next must be.
const WORST: f64 = 100.0;
const BETTER: f64 = 0.9;

/// The speeds that were tried.
pub fn searched(plant: &Nominal) -> String {
    let W = digits(plant.bandwidth);
    if plant.is_unstable() { format!("any speed about {W} rad/s") } else { format!("{W} rad/s or slower") }
}

/// The reason that is known before any search: an unstable mode that is hidden; an unstable pole and a zero on the right that
/// leave no controller a margin.
pub fn at_once(plant: &Nominal, most_modulus: f64) -> Option<String> {
    let W = plant.bandwidth;
    if let Some(pole) = plant.poles.iter().find(|pole| pole.re > -AT_REST && is_hidden(plant, pole)) {
        return Some(format!(
            "a mode of the plant at {} rad/s isn't stable, and the inputs don't move it or the outputs don't show it",
            complex(pole * W)
        ));
    }
    let (p, z, modulus) = unstable_with_zero(plant)?;
    (modulus > most_modulus).then(|| {
        format!(
            "the plant has an unstable pole at {} rad/s and a zero on the right at {} rad/s. Any controller of these outputs has \
             a maximum sensitivity M_s of at least {}. Control another output, or use a controller of all states",
            digits(p * plant.bandwidth),
            digits(z * plant.bandwidth),
            digits(modulus)
        )
    })
}

/// Reason why a search found nothing, if the plant shows it.
pub fn of_failure<L: Law>(plant: &Nominal, most_integrators: usize) -> String {
    let W = plant.bandwidth;
    let integrators = plant.poles.iter().filter(|pole| pole.norm() < 1e-3).count();
    if integrators > most_integrators {
        return format!(
            "the plant has {integrators} poles at 0 or slower than {} rad/s, and this controller can stabilise up to \
             {most_integrators} of them",
            digits(1e-3 * W)
        );
    }
    if plant.zeros.iter().any(|zero| zero.norm() < AT_REST) {
        return "the plant has a zero at 0, so that no constant control holds the output at a reference".to_owned();
    }
    // A zero that is far from the pole costs little.
    if let Some((p, z, modulus)) = unstable_with_zero(plant).filter(|(.., modulus)| *modulus > TELLING) {
        return format!(
            "with its unstable pole at {} rad/s and its zero on the right at {} rad/s, any controller of these outputs has a \
             maximum sensitivity M_s of at least {}",
            digits(p * W),
            digits(z * W),
            digits(modulus)
        );
    }
    let longest = plant.delay.iter().copied().fold(0.0, f64::max);
    let fastest = plant.poles.iter().map(|pole| pole.re).fold(0.0, f64::max);
    if fastest * longest > MOST_LAG {
        return format!(
            "the plant has an unstable pole at {} rad/s and a dead time of {} s. Their product must be at most {MOST_LAG} for a \
             loop with margins",
            digits(fastest * W),
            digits(longest / W)
        );
    }
    let none = match plant.channels() {
        1 => "no loop was stable at any speed that was tried",
        _ => "the outputs can't be decoupled well enough. Choose other outputs, or use a controller of all states",
    };
    let unstable = plant.poles.iter().filter(|pole| pole.re > AT_REST).max_by(|one, other| one.re.total_cmp(&other.re));
    let unstable = unstable.map_or(String::new(), |pole| {
        format!(". It is hard to stabilise: it has an unstable pole at {} rad/s", complex(pole * W))
    });
    best::<L>(plant).unwrap_or_else(|| none.to_owned()) + &unstable
}

/// The least M_s of stable loops, damping and speed not asked.
fn best<L: Law>(plant: &Nominal) -> Option<String> {
    if plant.channels() > 1 {
        return None;
    }
    let (channel, mut best) = (plant.single(), None);
    let mut modulus = WORST;
    for speed in speeds(plant).concat() {
        while let Some((gains, sign)) = L::candidates(&channel, &Asked { speed, modulus, all: false }, None).next() {
            let Some(found) = modulus_of::<L>(plant, &[gains], &DMatrix::from_element(1, 1, sign)) else { break };
            best = Some((speed, found));
            modulus = found.min(modulus) * BETTER;
        }
    }
    let (speed, modulus) = best?;
    let longest = plant.delay.iter().copied().fold(0.0, f64::max);
    Some(if longest > LONG {
        format!("its dead time of {} s is long for that. Give a lower --bandwidth", digits(longest / plant.bandwidth))
    } else if modulus <= L::MODULUS[1] {
        "stable loops with margins were found, but none that is also damped and fast enough".to_owned()
    } else {
        format!(
            "the stable loop with the best margins that was found, for {} rad/s, has a maximum sensitivity M_s of {}, and at most {} \
             is asked for",
            digits(speed * plant.bandwidth),
            digits(modulus),
            L::MODULUS[1]
        )
    })
}

/// A real unstable pole and a real zero on the right that leave the least margin, in W, with M_s ≥ |z + p|/|z − p|.
fn unstable_with_zero(plant: &Nominal) -> Option<(f64, f64, f64)> {
    let on_the_right = |values: &[Complex<f64>]| -> Vec<f64> {
        values.iter().filter(|value| value.im == 0.0 && value.re > 1e-3).map(|value| value.re).collect()
    };
    let (poles, zeros) = (on_the_right(&plant.poles), on_the_right(&plant.zeros));
    let pairs = poles.iter().flat_map(|&p| zeros.iter().map(move |&z| (p, z, (z + p) / (z - p).abs())));
    pairs.max_by(|one, other| one.2.total_cmp(&other.2))
}

/// True if the inputs don't move a mode, or the outputs don't show it.
fn is_hidden(plant: &Nominal, pole: &Complex<f64>) -> bool {
    // Without what dead times add.
    let (n, m) = (plant.poles.len(), plant.channels());
    let (A, B, C) = (plant.A.view((0, 0), (n, n)), plant.B.rows(0, n), plant.C.columns(0, n));
    let (mut moved, mut shown) = (DMatrix::<Complex<f64>>::zeros(n, n + m), DMatrix::<Complex<f64>>::zeros(n + m, n));
    let shifted = A.map(Complex::from) - DMatrix::identity(n, n) * *pole;
    moved.columns_mut(0, n).copy_from(&shifted);
    moved.columns_mut(n, m).copy_from(&B.map(Complex::from));
    shown.rows_mut(0, n).copy_from(&shifted);
    shown.rows_mut(n, m).copy_from(&C.map(Complex::from));
    // Whatever the units of the inputs and outputs are.
    let size = if A.norm() > 0.0 { A.norm() } else { 1.0 };
    moved
        .column_iter_mut()
        .skip(n)
        .filter(|column| column.norm() > 0.0)
        .for_each(|mut column| column.unscale_mut(column.norm() / size));
    shown.row_iter_mut().skip(n).filter(|row| row.norm() > 0.0).for_each(|mut row| row.unscale_mut(row.norm() / size));
    let least = HIDDEN * size;
    [moved, shown].iter().any(|matrix| matrix.singular_values().min() < least)
}
