//! Demands on the nominal loop of a first design.

use nalgebra::{Complex, DMatrix};

/// Damping ratio of each pole at least.
const DAMPING: f64 = 0.4;
/// −Re of each pole at least, in parts of the speed that the design is for.
const SPEED: f64 = 0.6;
/// A pole that is so near to a zero, in parts of its size, doesn't show in the output: it may be slow.
const NEAR: f64 = 0.3;
/// A pole whose size is within this factor of a lightly damped pole or zero of the plant is that mode.
const LIKE: f64 = 1.5;
/// Damping ratio below which a mode of the plant counts as one that no sound feedback moves far. It is a little more than what
/// is asked of other poles: a mode of 0.401 would have no design, as any feedback moves it a little.
const LIGHT: f64 = 0.42;
/// Such a mode keeps so much of its damping at least.
const LEFT: f64 = 0.7;

/// Poles and zeros of the plant that no sound feedback moves.
#[derive(Debug, Clone, Default)]
pub struct Unmoved {
    zeros: Vec<Complex<f64>>,
    /// Lightly damped poles and zeros, those with a positive imaginary part.
    modes: Vec<Complex<f64>>,
}

/// Speed and damping of the poles of a loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Merit {
    /// Least −Re of the poles that aren't exempt, in W; infinite where all are.
    pub slowest: f64,
    /// Least −Re of all poles, in W.
    pub rate: f64,
    /// Least damping ratio; that of an exempt mode in proportion to what it must keep.
    pub damping: f64,
}

impl Unmoved {
    /// Those of a plant.
    pub fn new(poles: &[Complex<f64>], zeros: &[Complex<f64>]) -> Self {
        let is_mode = |value: &&Complex<f64>| value.im > 0.0 && value.re < 0.0 && damping(value) < LIGHT;
        Unmoved { zeros: zeros.to_vec(), modes: poles.iter().chain(zeros).filter(is_mode).copied().collect() }
    }

    /// Speed and damping of a loop's poles; `None` where one isn't stable.
    pub fn merit(&self, poles: &[Complex<f64>]) -> Option<Merit> {
        let mut merit = Merit { slowest: f64::INFINITY, rate: f64::INFINITY, damping: 1.0 };
        for pole in poles {
            // What rounding leaves of a pole at 0 is not stable.
            if pole.re >= -1e-9 * pole.norm().max(1e-6) {
                return None;
            }
            merit.rate = merit.rate.min(-pole.re);
            if let Some(mode) = self.mode(pole) {
                merit.damping = merit.damping.min(damping(pole) * DAMPING / (LEFT * damping(mode)));
                continue;
            }
            merit.damping = merit.damping.min(damping(pole));
            if !self.is_hidden(pole) {
                merit.slowest = merit.slowest.min(-pole.re);
            }
        }
        Some(merit)
    }

    /// True if a pole is a lightly damped mode of the plant.
    pub fn is_mode(&self, pole: &Complex<f64>) -> bool {
        self.mode(pole).is_some()
    }

    /// True if a pole doesn't show in the outputs, by a zero.
    pub fn is_hidden(&self, pole: &Complex<f64>) -> bool {
        self.zeros.iter().any(|zero| (pole - zero).norm() <= NEAR * pole.norm())
    }

    /// The mode of the plant that a pole is, the nearest in size.
    fn mode(&self, pole: &Complex<f64>) -> Option<&Complex<f64>> {
        let apart = |mode: &Complex<f64>| (pole.norm() / mode.norm()).ln().abs();
        let like = self.modes.iter().filter(|mode| apart(mode) <= LIKE.ln());
        like.min_by(|one, other| apart(one).total_cmp(&apart(other)))
    }
}

impl Merit {
    /// True if all poles are damped, and as fast as a speed asks for.
    pub fn is_sound(&self, speed: f64) -> bool {
        self.damping >= DAMPING && self.slowest >= SPEED * speed
    }
}

/// ζ = −Re p/|p|.
pub fn damping(pole: &Complex<f64>) -> f64 {
    -pole.re / pole.norm()
}

/// True if M_s = max 1/|1 + L| of a loop's gains is at most a modulus.
pub fn keeps_away(mut gains: impl Iterator<Item = Complex<f64>>, modulus: f64) -> bool {
    let least = modulus.powi(-2);
    // A gain at a pole on the axis is no number, and far from −1.
    !gains.any(|gain| (gain + 1.0).norm_sqr() < least)
}

/// The largest singular value of (I + L)⁻¹.
pub fn sensitivity(gain: &DMatrix<Complex<f64>>) -> f64 {
    let difference = gain + DMatrix::identity(gain.nrows(), gain.ncols());
    if difference.len() == 1 {
        return difference[(0, 0)].norm().recip();
    }
    if difference.iter().any(|entry| !entry.is_finite()) {
        return 0.0;
    }
    difference.singular_values().min().recip()
}
