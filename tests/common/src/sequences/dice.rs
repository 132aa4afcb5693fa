//! Choices, arguments included, out of a number: 0 is the simplest call, so that a failing one can be made simpler.

/// Random choices of a call: one number, of which each choice takes its part.
pub struct Dice(pub u128);

impl Dice {
    pub fn below(&mut self, n: usize) -> usize {
        let chosen = self.0 % n as u128;
        self.0 /= n as u128;
        chosen as usize
    }

    /// Never where nothing is left to choose from.
    pub fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == n - 1
    }

    pub fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len())]
    }

    /// A finite number: often about as large as one that is known to be reasonable, sometimes at the ends of the range.
    pub fn number(&mut self, near: f64) -> f64 {
        match self.below(256) {
            0..=39 => near,
            40..=127 => near * self.pick(&[0.5, 0.9, 1.1, 2.0, -1.0, 10.0]),
            128..=135 => self.pick(&[0.0, 1.0, -0.0, 5e-324, f64::MIN_POSITIVE, -1e-310, f64::EPSILON]),
            136 => self.pick(&[1e6, -1e6, 1e12, -1e12, 1e100, -1e200, f64::MAX, f64::MIN]),
            _ => (self.below(4001) as f64 - 2000.0) / 1000.0,
        }
    }

    pub fn not_finite(&mut self) -> f64 {
        self.pick(&[f64::NAN, f64::INFINITY, f64::NEG_INFINITY])
    }

    /// A derivative of an input: rarely one that takes all the substeps that a step may have.
    pub fn slope(&mut self) -> f64 {
        match self.below(8192) {
            0..=8190 => (self.below(4001) as f64 - 2000.0) / 1000.0,
            _ => self.number(1e3),
        }
    }

    /// The length of a step, mostly as a master takes it.
    pub fn step(&mut self) -> f64 {
        match self.below(8192) {
            0..=7599 => self.pick(&[1e-3, 1e-4, 1e-5, 2e-3]),
            7600..=8151 => self.pick(&[1e-2, 5e-2, 1e-9, 5e-324]),
            8152..=8190 => self.pick(&[0.3, 1.0]),
            // The most substeps that a step may have: seconds in some units.
            _ => self.pick(&[1e3, 1e9, 1e300, f64::MAX]),
        }
    }
}
