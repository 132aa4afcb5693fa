//! Longest substep at which the method treats the equations' modes correctly: decaying ones are not amplified, and
//! growing ones grow at their rate.
//!
//! Error control sees errors above the tolerance only. A mode that starts far below it, in a loop at rest or started on
//! its trajectory, is at the mercy of the method: its amplitude is multiplied by |R(λh)| in each substep, R being the
//! method's stability function (Hairer and Wanner, Solving Ordinary Differential Equations II, IV.3), in place of e^(Re
//! λ h). An L-stable method takes R near zero for all fast modes, those that grow included, and an explicit one damps
//! slow growth of oscillations as well. So all modes that grow, by the eigenvalues λ of the exact Jacobian, are
//! resolved: each method has its longest substep at which |R| grows at the right rate.

use nalgebra::Complex;

use super::spectrum::Spectrum;
use super::{dop853, dormand_prince, rosenbrock};
use crate::error::Number;

/// Growth of a mode is followed with an error of this part of its rate.
const GROWTH_ACCURACY: f64 = 0.01;
/// Part of a mode's frequency below which its growth counts as none.
const LEAST_GROWTH: f64 = 1e-8;
/// Exponent of the largest growth in a substep. If the growth is that of the way to a pole, the next substep sees how
/// much faster it has become.
const GROWTH_IN_A_SUBSTEP: f64 = 0.5;
/// Factor by which a followed limit is forgotten from one look to the next.
const FORGOTTEN: f64 = 0.5;
/// A mode that decays more slowly than this part of its frequency may soon grow: the stiff method follows it, with an
/// error of its growth of this part of its frequency too.
const HARDLY_DAMPED: f64 = 1e-6;
/// An oscillation that is damped by less than this part of its frequency carries errors on, the farther the less it is damped.
const CARRYING: f64 = 0.05;
/// Largest factor of that; and the factor for a mode that grows.
const FARTHEST: f64 = 100.0;
const GROWING: f64 = 1000.0;
/// Part of the factor that stays from one look to the next.
const REMAINING: f64 = 0.9;
/// Smallest tolerance that oscillations tighten to: rounding errors are as large.
const LEAST_TOLERATED: f64 = 1e-12;
/// The explicit method's substep stays at this part of its limit of stability. At the limit, errors of the tolerance's
/// size stay for ever.
const STABLE_PART: f64 = 0.8;
/// Stability along a ray is looked for from λh of this magnitude, in such steps, up to the farthest point: of order 5, and 8.
const RAY_5: (f64, f64, f64) = (0.4, 0.1, 3.8);
const RAY_8: (f64, f64, f64) = (5.6, 0.2, 7.0);
/// Magnitude of λh from which the search for a resolved substep goes down, and where it ends.
const RESOLVED: (f64, f64) = (8.0, 1e-3);
/// Factor from one trial of that search to the next.
const TRIAL: f64 = 0.85;
/// Number of shorter substeps in a row that must be resolved too: the error may pass zero at one of them.
const IN_A_ROW: usize = 3;

/// Factor by which one substep multiplies the solution of x' = λ x, for λh.
type Stability = fn(Complex<f64>) -> Complex<f64>;

/// A pair of eigenvalues, or a real one.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Mode {
    /// Its growth rate, 1/s.
    pub growth: f64,
    /// Its frequency, rad/s.
    pub frequency: f64,
}

impl Mode {
    /// Sentence of a message: the mode had to be followed.
    pub(super) fn followed(&self) -> String {
        let rounded = |x: f64| format!("{x:.3e}").parse::<f64>().unwrap_or(x);
        let (growth, frequency) = (Number(rounded(self.growth)), Number(rounded(self.frequency)));
        let does = if self.growth > 0.0 { format!("grows at {growth} 1/s") } else { String::from("is hardly damped") };
        let of = if self.frequency > 0.0 { format!(" of {frequency} rad/s") } else { String::new() };
        format!(". A mode{of} that {does} had to be followed")
    }
}

/// Limits of an explicit method from eigenvalues, as the reciprocals of substeps, 1/s; 0 for no limit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ExplicitLimits {
    /// Limit at which decaying modes decay.
    pub stable: f64,
    /// Limit at which growing modes grow at their rate.
    pub growing: f64,
}

impl ExplicitLimits {
    /// Keeps a damped mode stable by a method with this stability function, where it isn't yet.
    fn keep_stable(&mut self, value: Complex<f64>, (stability, ray): (Stability, (f64, f64, f64))) {
        let size = value.norm();
        if self.stable * (STABLE_PART * ray.0) < size {
            self.stable = self.stable.max(size / (STABLE_PART * stable_way(stability, ray, value / size)));
        }
    }

    /// The limit, as the reciprocal of its substep, 1/s.
    pub fn both(&self) -> f64 {
        self.stable.max(self.growing)
    }
}

/// Limits from eigenvalues, as the reciprocals of substeps, 1/s; 0 for no limit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Limits {
    /// The explicit method of order 5.
    pub order_5: ExplicitLimits,
    /// The explicit method of order 8.
    pub order_8: ExplicitLimits,
    /// The stiff one, that what grows does so at its rate.
    pub stiff: f64,
    /// The mode that sets the limit of growth.
    pub mode: Mode,
    /// Factor by which the least damped oscillation divides the tolerance, since it carries errors on; without effect
    /// up to 1.
    pub carried: f64,
}

impl Limits {
    /// The limits for the eigenvalues that were found.
    #[cfg(test)]
    pub fn of(spectrum: &Spectrum) -> Self {
        Self::with_damped(spectrum, false).0
    }

    /// The limits for the eigenvalues that were found, and the damped mode that sets the explicit method's. `open`: the
    /// system is a part of a loop that isn't known.
    pub fn with_damped(spectrum: &Spectrum, open: bool) -> (Self, Mode) {
        let (mut limits, mut damped) = (Limits::default(), Mode::default());
        for (value, noise) in spectrum.values().filter(|(value, _)| value.im >= 0.0) {
            let before = limits.order_5.stable;
            limits.add(value, noise, open);
            if limits.order_5.stable > before {
                damped = Mode { growth: value.re, frequency: value.im };
            }
        }
        (limits, damped)
    }

    /// Adds what an eigenvalue asks for whose rounding error may be as large as `noise`.
    fn add(&mut self, value: Complex<f64>, noise: f64, open: bool) {
        let (size, growth) = (value.norm(), value.re);
        if size <= noise {
            // Two integrators, of which the loop around them may make an oscillation that grows.
            if open && value.im > 0.0 {
                self.carried = GROWING;
            }
            // Whatever it is, it may grow as fast as that.
            return self.follow(noise / GROWTH_IN_A_SUBSTEP, value);
        }
        if value.im > 0.0 && -growth < CARRYING * size {
            self.carried = self.carried.max(match growth {
                growth if growth > noise => GROWING,
                growth if -growth * FARTHEST > CARRYING * size => CARRYING * size / -growth,
                _ => FARTHEST,
            });
        }
        if growth <= 0.0 {
            self.order_5.keep_stable(value, (dormand_prince::stability, RAY_5));
            self.order_8.keep_stable(value, (dop853::stability, RAY_8));
        }
        let stiff = |allowed| size / resolved_way(rosenbrock::stability, value / size, allowed);
        if growth > (LEAST_GROWTH * size).max(noise) {
            let allowed = GROWTH_ACCURACY * growth / size;
            let explicit = |stability| size / resolved_way(stability, value / size, allowed);
            self.order_5.growing = self.order_5.growing.max(explicit(dormand_prince::stability));
            self.order_8.growing = self.order_8.growing.max(explicit(dop853::stability));
            self.follow(stiff(allowed), value);
        } else if growth > -(HARDLY_DAMPED * size).max(noise) {
            self.follow(stiff(HARDLY_DAMPED), value);
        }
    }

    /// The stiff method follows a mode by substeps of the reciprocal of `limit`, 1/s.
    fn follow(&mut self, limit: f64, value: Complex<f64>) {
        if limit > self.stiff {
            (self.stiff, self.mode) = (limit, Mode { growth: value.re, frequency: value.im });
        }
    }

    /// Keeps most of how far errors were carried before: damping may change sign with the state, errors remain.
    pub fn keep_carrying(&mut self, before: f64) {
        self.carried = self.carried.max(REMAINING * before);
    }

    /// The relative error that a substep may have, so that what an oscillation carries on stays within `relative`.
    pub fn tolerated(&self, relative: f64) -> f64 {
        (relative / self.carried.max(1.0)).max(relative.min(LEAST_TOLERATED))
    }

    /// Keeps what was followed before, for substeps twice as long: where equations change faster than a substep sees,
    /// modes that grow come and go.
    pub fn remember(&mut self, before: &Limits) {
        if self.stiff < FORGOTTEN * before.stiff {
            (self.stiff, self.mode) = (FORGOTTEN * before.stiff, before.mode);
        }
    }
}

/// Largest stable |λh| of an explicit method in a direction of the complex plane.
fn stable_way(stability: Stability, (mut low, step, far): (f64, f64, f64), direction: Complex<f64>) -> f64 {
    let stable = |way: f64| stability(direction * way).norm() <= 1.0 + 1e-9;
    while low < far && stable(low + step) {
        low += step;
    }
    let mut high = low + step;
    for _ in 0..6 {
        let middle = 0.5 * (low + high);
        *(if stable(middle) { &mut low } else { &mut high }) = middle;
    }
    low
}

/// Largest |λh| of a method in a direction of the complex plane whose growth rate has an error of at most `allowed`,
/// all in units of |λ|.
fn resolved_way(stability: Stability, direction: Complex<f64>, allowed: f64) -> f64 {
    let (far, least) = RESOLVED;
    let mut way = if direction.re > 0.0 { far.min(GROWTH_IN_A_SUBSTEP / direction.re) } else { far };
    let (mut found, mut in_a_row) = (least, 0);
    while way > least && in_a_row < IN_A_ROW {
        let growth = stability(direction * way).norm().max(f64::MIN_POSITIVE).ln() / way;
        if (growth - direction.re).abs() <= allowed {
            if in_a_row == 0 {
                found = way;
            }
            in_a_row += 1;
        } else {
            (found, in_a_row) = (least, 0);
        }
        way *= TRIAL;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Growth rate of a method at substeps of length h, 1/s.
    fn growth(stability: Stability, value: Complex<f64>, h: f64) -> f64 {
        stability(value * h).norm().ln() / h
    }

    fn limits(eigenvalues: &[(f64, f64)]) -> Limits {
        let n: usize = eigenvalues.iter().map(|&(_, im)| if im == 0.0 { 1 } else { 2 }).sum();
        let mut a = vec![0.0; n * n];
        let mut k = 0;
        for &(re, im) in eigenvalues {
            a[k * n + k] = re;
            k += 1;
            if im != 0.0 {
                (a[k * n + k], a[(k - 1) * n + k], a[k * n + k - 1]) = (re, im, -im);
                k += 1;
            }
        }
        let mut spectrum = Spectrum::new(n);
        assert!(spectrum.find(&a));
        Limits::of(&spectrum)
    }

    #[test]
    fn both_methods_have_order_five() {
        for stability in [dormand_prince::stability, rosenbrock::stability] {
            for z in [Complex::new(0.02, 0.03), Complex::new(-0.04, 0.0), Complex::new(0.0, 0.05)] {
                assert!((stability(z) - z.exp()).norm() < 1e-2 * z.norm().powi(6));
            }
        }
        assert!(rosenbrock::stability(Complex::new(-1e9, 1e3)).norm() < 1e-6, "L-stable");
    }

    #[test]
    fn what_grows_grows_at_its_rate_at_any_substep_within_the_limit() {
        for growth_rate in [1e-3, 0.1, 3.0, 1e3, 1e5] {
            for frequency in [0.0, 0.1, 10.0, 2e3, 1e5] {
                if growth_rate < 1e-7 * frequency {
                    continue;
                }
                let limits = limits(&[(growth_rate, frequency), (-1e7, 0.0)]);
                let value = Complex::new(growth_rate, frequency);
                let methods: [(Stability, f64); 3] = [
                    (dormand_prince::stability, limits.order_5.growing),
                    (dop853::stability, limits.order_8.growing),
                    (rosenbrock::stability, limits.stiff),
                ];
                for (stability, limit) in methods {
                    for part in [1.0, 0.9, 0.7, 0.5, 0.2] {
                        let off = growth(stability, value, part / limit) / growth_rate - 1.0;
                        assert!(off.abs() < 1.5e-2, "{growth_rate}, {frequency}: off by {off:e} at {part}");
                    }
                }
            }
        }
    }

    #[test]
    fn what_is_damped_sets_the_stiff_method_no_limit_and_the_explicit_one_that_of_stability() {
        let of = limits(&[(-40.0, 1.2e4), (-3e6, 0.0), (-1.0, 2.0)]);
        assert_eq!([of.stiff, of.order_5.growing, of.order_8.growing], [0.0; 3]);
        assert!((3e6 / 3.31 / STABLE_PART..3e6 / 3.2 / STABLE_PART).contains(&of.order_5.stable), "{of:?}");
        assert!((3e6 / 6.4 / STABLE_PART..3e6 / 6.3 / STABLE_PART).contains(&of.order_8.stable), "{of:?}");
        // Along the imaginary axis the method is stable up to about 1, that of order 8 up to about 6.
        let fast = limits(&[(-31.0, 4e4)]);
        assert!((4e4 / 1.5..4e4 / 0.6).contains(&fast.order_5.stable), "{fast:?}");
        assert!((4e4 / 5.0..4e4 / 4.7).contains(&fast.order_8.stable), "{fast:?}");
    }

    #[test]
    fn an_undamped_mode_is_followed_by_the_stiff_method() {
        let of = limits(&[(0.0, 2e3), (-1e6, 0.0)]);
        assert!(of.stiff > 2e3 && of.order_5.growing == 0.0, "{of:?}");
        assert_eq!(of.mode.frequency, 2e3);
        let damped = |part: f64| limits(&[(-part * HARDLY_DAMPED * 2e3, 2e3), (-1.0, 0.0)]).stiff;
        assert!(damped(0.5) > 2e3 && damped(2.0) == 0.0, "hardly damped ones too, and no others");
        // Zero is no mode: an integrator neither grows nor oscillates.
        assert_eq!(limits(&[(0.0, 0.0), (-1.0, 0.0)]).stiff, 0.0);
    }

    #[test]
    fn weakly_damped_oscillations_tighten_the_tolerance_and_integrators_only_where_the_loop_is_unknown() {
        let carried = |growth: f64| limits(&[(growth, 2e3), (-3e5, 0.0)]).carried;
        assert_eq!([carried(1.0), carried(-0.05), carried(-200.0)], [GROWING, FARTHEST, 0.0]);
        assert!((carried(-20.0) - 5.0).abs() < 1e-2, "ζ = 0.01: {}", carried(-20.0));
        let mut limits = Limits::default();
        limits.add(Complex::new(1e-9, 2e3), 1e-8, true);
        assert_eq!(limits.carried, FARTHEST, "growth within rounding errors");
        limits.keep_carrying(GROWING);
        assert_eq!(limits.carried, REMAINING * GROWING, "errors of a former growth");
        // Two integrators with fast actuators, in other coordinates: the double eigenvalue 0 is found as a pair.
        let (mut pairs, mut spectrum) = (0, Spectrum::new(4));
        for k in 1..100 {
            let (c, s) = (f64::from(k).cos(), f64::from(k).sin());
            let rotated = |m: [[f64; 4]; 4], (i, j): (usize, usize)| {
                let mut m = m;
                (0..4).for_each(|r| (m[r][i], m[r][j]) = (c * m[r][i] - s * m[r][j], s * m[r][i] + c * m[r][j]));
                (0..4).for_each(|r| (m[i][r], m[j][r]) = (c * m[i][r] - s * m[j][r], s * m[i][r] + c * m[j][r]));
                m
            };
            let a = [[0.0; 4], [0.0; 4], [0.0, 0.0, -1e6, 0.0], [0.0, 0.0, 0.0, -3e5]];
            let a = rotated(rotated(rotated(a, (0, 2)), (1, 3)), (0, 1));
            assert!(spectrum.find(a.as_flattened()));
            let paired = spectrum.values().any(|(value, _)| value.im > 0.0);
            pairs += usize::from(paired);
            assert_eq!(Limits::of(&spectrum).carried, 0.0, "{k}");
            assert_eq!(Limits::with_damped(&spectrum, true).0.carried, if paired { GROWING } else { 0.0 }, "{k}");
        }
        assert!(pairs > 10, "{pairs}");
    }
}
