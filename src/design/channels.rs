//! Designs of several channels: combinations of the inputs that move one output each, a design for each channel, and an
//! assessment of the complete loop.
#![allow(non_snake_case)] // matrices have the names of the field

use std::cell::RefCell;
use std::collections::HashMap;

use nalgebra::{Complex, DMatrix};

use super::four_digits;
use super::nominal::{Channel, Nominal};
use super::search::{Asked, Found, Law, found};
use crate::mathematics::matrices;

/// The largest condition of a decoupling matrix with scaled columns.
const MOST_CONDITION: f64 = 1e6;
/// Slower speeds of a channel that are tried: v 10^(−k/4).
const SLOWER: i32 = 4;
/// C A^k B below this part of the product of norms counts as 0.
const SHOWS: f64 = 1e-9;
/// A pole that is so slow counts as one at 0, in W.
const AT_REST: f64 = 1e-9;

/// A plant with a matrix that moves its outputs one by one, and what was found for its channels.
pub struct Decoupled<'a, G> {
    S: DMatrix<f64>,
    channels: Vec<Option<Channel<'a>>>,
    found: RefCell<HashMap<Key, Option<(G, f64)>>>,
}

/// Channel, form, speed and modulus of a search: the speeds of neighbouring searches are the same ones.
type Key = (usize, Option<usize>, [u64; 2]);

/// The decouplings that don't depend on the speed.
pub struct Fixed<'a, G> {
    fast: Option<Decoupled<'a, G>>,
    at_rest: Option<Decoupled<'a, G>>,
    /// For an unstable plant: a single channel, the others open, may have no stable loop although the plant has one.
    chains: Option<Decoupled<'a, G>>,
}

impl<'a, G: Clone> Fixed<'a, G> {
    /// At high frequencies, and at rest.
    pub fn new(plant: &'a Nominal) -> Self {
        let integrates = plant.poles.iter().any(|pole| pole.norm() < AT_REST);
        let at_rest = || plant.response.at(0.0).map(|entry| entry.re).try_inverse();
        let fast = high_frequency(plant).and_then(|(degrees, gain)| Some((degrees, gain.clone().try_inverse()?, gain)));
        let chains = fast.clone().filter(|_| plant.is_unstable()).and_then(|(degrees, S, gain)| {
            let chain = |i: usize, S: &DMatrix<f64>| Some(plant.chain((gain.row(i) * S.column(i))[0], degrees[i]));
            Decoupled::new(plant, S, chain)
        });
        let of_plant = |S: DMatrix<f64>| Decoupled::of_plant(plant, S);
        Fixed {
            fast: fast.and_then(|(_, S, _)| of_plant(S)),
            at_rest: (!integrates).then(at_rest).flatten().and_then(of_plant),
            chains,
        }
    }

    /// The first design for a speed.
    pub fn at<L: Law<Gains = G>>(&self, plant: &'a Nominal, asked: &Asked) -> Option<Found<G>> {
        let of = |decoupled: &Option<Decoupled<'a, G>>| decoupled.as_ref().and_then(|it| it.at::<L>(plant, asked));
        let about_the_speed = || aligned(plant, asked.speed).and_then(|S| Decoupled::of_plant(plant, S));
        let tried = of(&self.fast).or_else(|| of(&about_the_speed())).or_else(|| of(&self.at_rest));
        tried.or_else(|| of(&self.chains))
    }
}

impl<'a, G: Clone> Decoupled<'a, G> {
    /// Scales columns so that the largest entry is 1; none if they are hardly independent.
    fn new(
        plant: &Nominal,
        mut S: DMatrix<f64>,
        channel: impl Fn(usize, &DMatrix<f64>) -> Option<Channel<'a>>,
    ) -> Option<Self> {
        S.column_iter_mut().for_each(|mut column| {
            let largest = column.amax();
            if largest > 0.0 {
                column /= largest;
            }
        });
        let S = S.map(four_digits);
        let is_usable =
            S.iter().all(|entry| entry.is_finite()) && matrices::inverse(&S, MOST_CONDITION.recip()).is_ok();
        is_usable.then(|| Decoupled {
            channels: (0..plant.channels()).map(|i| channel(i, &S)).collect(),
            found: RefCell::default(),
            S: S.clone(),
        })
    }

    /// Takes each channel of the plant, the others open.
    fn of_plant(plant: &'a Nominal, S: DMatrix<f64>) -> Option<Self> {
        Decoupled::new(plant, S, |i, S| plant.channel(&S.columns(i, 1).into_owned(), i))
    }

    /// The first sound design of all channels.
    fn at<L: Law<Gains = G>>(&self, plant: &Nominal, asked: &Asked) -> Option<Found<G>> {
        L::TOGETHER.iter().find_map(|&form| {
            let designs = (0..plant.channels()).map(|i| self.alone::<L>(i, asked, form));
            let designs = designs.collect::<Option<Vec<_>>>()?;
            let slowest = designs.iter().map(|design| design.speed).fold(f64::INFINITY, f64::min);
            let mut S = self.S.clone();
            designs.iter().enumerate().for_each(|(i, design)| S.column_mut(i).scale_mut(design.sign));
            let gains = designs.into_iter().map(|design| design.gains).collect();
            found::<L>(plant, gains, S, &Asked { speed: slowest, ..*asked })
        })
    }

    fn alone<L: Law<Gains = G>>(&self, i: usize, asked: &Asked, form: Option<usize>) -> Option<Alone<G>> {
        let channel = self.channels[i].as_ref()?;
        (0..=SLOWER).find_map(|k| {
            let speed = asked.speed * 10_f64.powf(f64::from(-k) / 4.0);
            // Digits that differ by rounding make no other speed.
            let key = (i, form, [four_digits(speed), asked.modulus].map(f64::to_bits));
            let search = || L::candidates(channel, &Asked { speed, ..*asked }, form).next();
            let (gains, sign) = self.found.borrow_mut().entry(key).or_insert_with(search).clone()?;
            Some(Alone { gains, sign, speed })
        })
    }
}

/// The design of a channel.
struct Alone<G> {
    gains: G,
    sign: f64,
    speed: f64,
}

/// The derivative of each output in which the controls show first, and how they do.
pub fn high_frequency(plant: &Nominal) -> Option<(Vec<usize>, DMatrix<f64>)> {
    let (m, n) = (plant.channels(), plant.poles.len());
    // Without what dead times add.
    let (A, B, C) = (plant.A.view((0, 0), (n, n)), plant.B.rows(0, n), plant.C.columns(0, n));
    let size = A.norm();
    // Whatever the units of the inputs are.
    let mut scaled = B.into_owned();
    scaled.column_iter_mut().filter(|column| column.norm() > 0.0).for_each(|mut column| column /= column.norm());
    let mut gain = DMatrix::zeros(m, m);
    let mut degrees = Vec::new();
    for i in 0..m {
        let mut row = C.row(i).into_owned();
        let mut bound = row.norm();
        let degree = (1..=n).find(|_| {
            if (&row * &scaled).amax() > SHOWS * bound {
                gain.row_mut(i).copy_from(&(&row * B));
                return true;
            }
            row = &row * A;
            bound *= size;
            false
        })?;
        degrees.push(degree);
    }
    Some((degrees, gain))
}

/// The real matrix nearest to G(j ω)⁻¹ (B. Kouvaritakis, Theory and practice of the characteristic locus design method, Proc.
/// IEE 126 (1979) 542–548): each column turned until its imaginary part is least.
fn aligned(plant: &Nominal, omega: f64) -> Option<DMatrix<f64>> {
    let V = plant.response.at(omega).try_inverse()?;
    let m = V.nrows();
    let turn = |i: usize| V.column(i).iter().map(|entry| entry * entry).sum::<Complex<f64>>().arg() / 2.0;
    let turns: Vec<_> = (0..m).map(turn).collect();
    Some(DMatrix::from_fn(m, m, |j, i| (V[(j, i)] * Complex::from_polar(1.0, -turns[i])).re))
}
