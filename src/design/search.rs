//! The search over the speed of a design.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{Complex, DMatrix};

use super::channels::Fixed;
use super::controller::Controller;
use super::criteria::{Merit, sensitivity};
use super::nominal::{Channel, Nominal, poles_of};
use super::response::logarithmic;

/// Speeds in a decade, and how many are tried below W, and above it for an unstable plant.
const PER_DECADE: f64 = 8.0;
const SPEEDS: i32 = 24;
/// Number of slower speeds that are tried where none of these serves: a control that doesn't damp a light mode must be slow.
const SLOWER: i32 = 8;
/// Factor of M_s that several channels may have.
const SEVERAL: f64 = 1.1;

/// Peaks of the sensitivity above this part of the largest are looked at more closely, at so many points.
const NEARLY: f64 = 0.8;
const BETWEEN: usize = 30;

/// A control law of single channels for which gains are searched.
pub trait Law {
    /// Gains of a channel.
    type Gains: Clone;

    /// M_s at most: where designs exist, and where the first allows none at any speed.
    const MODULUS: [f64; 2];

    /// Forms that a single channel tries one after the other.
    const ALONE: &'static [Option<usize>];

    /// Forms that all channels take together, in this order; none leaves it to each channel.
    const TOGETHER: &'static [Option<usize>];

    /// Sound candidates for a channel, the best first, in a form where one is given, with the sign of the control; gains
    /// have as many digits as a description.
    fn candidates(channel: &Channel, asked: &Asked, form: Option<usize>) -> impl Iterator<Item = (Self::Gains, f64)>;

    /// The linear controller of a channel with time in 1/W.
    fn controller(gains: &Self::Gains, bandwidth: f64) -> Controller;

    /// K(j ω) of that controller.
    fn response(gains: &Self::Gains, bandwidth: f64) -> impl Fn(f64) -> Complex<f64>;
}

/// Demands on a channel.
#[derive(Debug, Clone, Copy)]
pub struct Asked {
    /// The speed v, in W.
    pub speed: f64,
    /// M_s at most.
    pub modulus: f64,
    /// True if damping and speed count; without them a loop must only be stable.
    pub all: bool,
}

/// A design that was found.
#[derive(Debug, Clone)]
pub struct Found<G> {
    /// A channel each.
    pub gains: Vec<G>,
    /// From what the channels ask for to the controls.
    pub S: DMatrix<f64>,
    /// The speed v, in W.
    pub speed: f64,
    /// Properties of its nominal loop.
    pub has: Has,
    /// The linear controller, with time in 1/W.
    pub controller: Controller,
}

/// Properties of a nominal loop.
#[derive(Debug, Clone, Copy)]
pub struct Has {
    /// Speed and damping of its poles.
    pub merit: Merit,
    /// M_s.
    pub modulus: f64,
}

/// The first design at the speeds W, W 10^(−1/8), …, for an unstable plant at faster ones then; with a smaller modulus
/// margin where none has the usual one; at still slower ones where none has either.
pub fn search<L: Law>(plant: &Nominal) -> Option<Found<L::Gains>> {
    let factor = factor(plant);
    let asked = speeds(plant).into_iter().flat_map(|speeds| {
        let each = move |modulus| speeds.clone().into_iter().map(move |speed| Asked { speed, modulus, all: true });
        L::MODULUS.map(|modulus| factor * modulus).into_iter().flat_map(each)
    });
    if plant.channels() > 1 {
        let fixed = Fixed::new(plant);
        return asked.into_iter().find_map(|asked| fixed.at::<L>(plant, &asked));
    }
    let channel = plant.single();
    asked.into_iter().find_map(|asked| at::<L>(plant, &channel, &asked))
}

/// Factor of the largest M_s, in parts of that of a single channel.
pub fn factor(plant: &Nominal) -> f64 {
    if plant.channels() > 1 { SEVERAL } else { 1.0 }
}

/// The usual speeds, in W, and slower ones for where none of them serves.
pub fn speeds(plant: &Nominal) -> [Vec<f64>; 2] {
    let slower = (0..=SPEEDS).map(|k| -k);
    let faster = (1..=SPEEDS).filter(|_| plant.is_unstable());
    let still_slower = (SPEEDS + 1..=SPEEDS + SLOWER).map(|k| -k);
    [slower.chain(faster).map(speed).collect(), still_slower.map(speed).collect()]
}

fn speed(eighths: i32) -> f64 {
    10_f64.powf(f64::from(eighths) / PER_DECADE)
}

/// A design of a single channel for one speed.
fn at<L: Law>(plant: &Nominal, channel: &Channel, asked: &Asked) -> Option<Found<L::Gains>> {
    let mut candidates = L::ALONE.iter().flat_map(|&form| L::candidates(channel, asked, form));
    candidates.find_map(|(gains, sign)| {
        let S = DMatrix::from_element(1, 1, sign);
        found::<L>(plant, vec![gains], S, asked)
    })
}

/// The design of some gains, if the complete loop is sound.
pub fn found<L: Law>(plant: &Nominal, gains: Vec<L::Gains>, S: DMatrix<f64>, asked: &Asked) -> Option<Found<L::Gains>> {
    let (controller, poles, merit) = closed::<L>(plant, &gains, &S)?;
    if !merit.is_sound(asked.speed) {
        return None;
    }
    let has = Has { merit, modulus: modulus::<L>(plant, &gains, &S, &poles) };
    (has.modulus <= asked.modulus).then_some(Found { gains, S, speed: asked.speed, has, controller })
}

/// The controller of some gains, and the poles of its nominal loop; `None` where that isn't stable.
fn closed<L: Law>(
    plant: &Nominal,
    gains: &[L::Gains],
    S: &DMatrix<f64>,
) -> Option<(Controller, Vec<Complex<f64>>, Merit)> {
    let of_channels: Vec<_> = gains.iter().map(|gains| L::controller(gains, plant.bandwidth)).collect();
    let controller = Controller::of_channels(&of_channels, S);
    let poles = poles_of(&controller.closed(&plant.A, &plant.B, &plant.C))?;
    let merit = plant.unmoved.merit(&poles)?;
    Some((controller, poles, merit))
}

/// M_s of a nominal loop; `None` where it isn't stable.
pub fn modulus_of<L: Law>(plant: &Nominal, gains: &[L::Gains], S: &DMatrix<f64>) -> Option<f64> {
    let (_, poles, _) = closed::<L>(plant, gains, S)?;
    Some(modulus::<L>(plant, gains, S, &poles))
}

/// M_s on the plant's frequencies and at those of the loop's own modes, and 1 beyond them, where no plant follows.
fn modulus<L: Law>(plant: &Nominal, gains: &[L::Gains], S: &DMatrix<f64>, poles: &[Complex<f64>]) -> f64 {
    let responses: Vec<_> = gains.iter().map(|gains| L::response(gains, plant.bandwidth)).collect();
    let S = S.map(Complex::from);
    let sensitivity = |omega: f64, G: &DMatrix<Complex<f64>>| {
        // G S diag(K)
        let mut gain = G * &S;
        gain.column_iter_mut().zip(&responses).for_each(|(mut column, response)| column *= response(omega));
        sensitivity(&gain)
    };
    let on_grid = plant.frequencies.iter().zip(plant.on_grid()).map(|(&omega, G)| sensitivity(omega, G));
    let on_grid: Vec<_> = on_grid.collect();
    let largest = on_grid.iter().copied().fold(0.0, f64::max);
    let at = |omega: f64| sensitivity(omega, &plant.response.at(omega));
    // A peak lies between the points of the grid: about each that is nearly the largest, and at the loop's own modes.
    let is_peak = |i: &usize| {
        let before = i.checked_sub(1).map_or(0.0, |before| on_grid[before]);
        on_grid[*i] > NEARLY * largest
            && on_grid[*i] >= before
            && on_grid[*i] >= on_grid.get(i + 1).copied().unwrap_or(0.0)
    };
    let between = |i: usize| {
        let frequencies = &plant.frequencies;
        let (from, to) = (frequencies[i.saturating_sub(1)], frequencies[(i + 1).min(frequencies.len() - 1)]);
        logarithmic(from, to, BETWEEN)
    };
    let about_peaks = (0..on_grid.len()).filter(is_peak).flat_map(between).map(at);
    let modes = poles.iter().filter(|pole| pole.im > 0.0).flat_map(|pole| [pole.im, pole.norm()]);
    // The grid is that of the plant: a loop may be slower.
    let slowest = 0.1 * poles.iter().map(|pole| pole.norm()).fold(f64::INFINITY, f64::min);
    let first = plant.frequencies.first().copied().filter(|first| slowest < *first);
    let below = first.map(|first| logarithmic(slowest, first, 0)).unwrap_or_default();
    about_peaks.chain(modes.chain(below).map(at)).fold(largest.max(1.0), f64::max)
}
