//! Functions that equations call and that no arithmetic expresses, each once for every scalar.

/// A function of numbers that is called as it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum Opaque {
    /// The number of a sample of Gaussian noise, from seed, channel and sample.
    Noise,
    /// A number of (0, 1], each as likely, from the same. It is the same to the bit on every platform.
    Uniform,
}

impl Opaque {
    /// Its value. It needs no generator's state: it depends only on seed, channel and sample, whole numbers, the first two of 32 bits
    /// (as C has them).
    pub fn of(self, mut arguments: impl Iterator<Item = f64>) -> f64 {
        // Whole numbers of one size, since other conversions may raise an invalid operation.
        let mut next = || arguments.next().unwrap_or_default() as i64 as u64;
        let stream = [next(), next(), next()].into_iter().fold(0, scrambled);
        match self {
            Opaque::Noise => normal(stream),
            Opaque::Uniform => uniform(scrambled(stream, 0)),
        }
    }
}

/// A number with mean 0 and standard deviation 1.
fn normal(stream: u64) -> f64 {
    let [radius, angle] = [0, 1].map(|half| uniform(scrambled(stream, half)));
    // Box and Muller's transformation.
    (-2.0 * radius.ln()).sqrt() * (std::f64::consts::TAU * angle).cos()
}

/// One more word taken into a number all of whose bits depend on all bits of the words (the output function of
/// SplitMix64).
fn scrambled(number: u64, word: u64) -> u64 {
    let mut bits = number.wrapping_add(word).wrapping_add(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

/// A number in (0, 1].
fn uniform(bits: u64) -> f64 {
    ((bits >> 11) + 1) as f64 / (1_u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_numbers_fill_their_interval_evenly_and_independently() {
        let of = |seed: f64, channel: f64, sample: f64| Opaque::Uniform.of([seed, channel, sample].into_iter());
        let count = 20_000;
        for (seed, channel) in [(1.0, 0.0), (2.0, 0.0), (-7.0, 3.0)] {
            let numbers: Vec<f64> = (0..count).map(|k| of(seed, channel, f64::from(k))).collect();
            assert!(numbers.iter().all(|number| *number > 0.0 && *number <= 1.0));
            // Each tenth has its part of them, within five standard deviations, and neighbours don't follow each other.
            for tenth in 0..10 {
                let part = numbers.iter().filter(|number| (**number * 10.0).ceil() as i32 == tenth + 1).count();
                assert!((part as f64 - 2000.0).abs() < 5.0 * 1800_f64.sqrt(), "{tenth}: {part}");
            }
            let pairs = numbers.windows(2).map(|pair| (pair[0] - 0.5) * (pair[1] - 0.5) * 12.0);
            let correlation = pairs.sum::<f64>() / f64::from(count);
            assert!(correlation.abs() < 5.0 / f64::from(count).sqrt(), "{correlation}");
        }
        assert_ne!(of(1.0, 0.0, 5.0), of(2.0, 0.0, 5.0));
        assert_ne!(of(1.0, 0.0, 5.0), of(1.0, 1.0, 5.0));
    }
}
