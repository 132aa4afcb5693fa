//! Random numbers that follow from a seed, the number of a sample and a name, in any order and on any machine.

use sha2::{Digest, Sha256};

/// Bits of a number's mantissa.
const BITS: u32 = 53;

/// Sources of random numbers of one sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct Random {
    /// The seed of the study.
    pub seed: u64,
    /// The number of the sample.
    pub sample: u64,
}

impl Random {
    /// A number of the quantity with this name, uniform above 0 and below 1.
    pub fn uniform(self, name: &str) -> f64 {
        ((self.bits(name) >> (u64::BITS - BITS)) as f64 + 0.5) / 2_f64.powi(BITS as i32)
    }

    /// A seed for the noise with this name, at least 1.
    pub fn seed(self, name: &str) -> i32 {
        (self.bits(name) % (i32::MAX as u64)) as i32 + 1
    }

    fn bits(self, name: &str) -> u64 {
        let mut hash = Sha256::new();
        hash.update(self.seed.to_le_bytes());
        hash.update(self.sample.to_le_bytes());
        hash.update(name);
        let digest = hash.finalize();
        digest[..8].iter().fold(0, |bits, byte| bits << 8 | u64::from(*byte))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Computed by Python's hashlib.
    const EXPECTED: [f64; 3] = [0.25358240885400435, 0.17591104686825726, 0.9963811481143079];

    #[test]
    fn the_numbers_of_a_seed_stay_what_they_are() {
        // SHA-256 of seed, sample and name. Other numbers would change the samples of every user's study.
        let found = [(1, 0), (1, 1), (2, 0)].map(|(seed, sample)| Random { seed, sample }.uniform("plant.m1"));
        assert_eq!(found, EXPECTED);
    }

    #[test]
    fn numbers_depend_on_seed_sample_and_name_and_are_uniform() {
        let of = |seed, sample, name| Random { seed, sample }.uniform(name);
        assert_eq!(of(1, 2, "plant.m"), of(1, 2, "plant.m"));
        assert!(of(1, 2, "plant.m") != of(2, 2, "plant.m") && of(1, 2, "plant.m") != of(1, 2, "plant.k"));
        let count = 10_000;
        let mut parts = [0; 10];
        (0..count).for_each(|k| parts[(10.0 * of(1, k, "a")) as usize] += 1);
        // χ² of 9 degrees of freedom: 27.9 is exceeded once in a thousand.
        let expected = count as f64 / 10.0;
        let chi_squared: f64 = parts.iter().map(|found| (f64::from(*found) - expected).powi(2) / expected).sum();
        assert!(chi_squared < 27.9, "{chi_squared}");
        // Neighbours in k and in names are uncorrelated.
        let pairs = [("a", 1, "a"), ("a", 0, "b")];
        for (one, ahead, other) in pairs {
            let product = |k| (of(1, k, one) - 0.5) * (of(1, k + ahead, other) - 0.5);
            let correlation = 12.0 * (0..count).map(product).sum::<f64>() / count as f64;
            assert!(correlation.abs() < 4.0 / (count as f64).sqrt(), "{correlation}");
        }
    }

    #[test]
    fn seeds_of_noise_are_positive() {
        assert!((0..1000).all(|sample| Random { seed: 7, sample }.seed("sensor.seed") >= 1));
    }
}
