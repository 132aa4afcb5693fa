//! Functions that equations call and that no arithmetic expresses: each stands here once for every scalar.

/// A function of numbers that is called as it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum Opaque {
    /// The number of a sample of Gaussian noise, from seed, channel and sample.
    Noise,
}

impl Opaque {
    /// Its value.
    pub fn of(self, mut arguments: impl Iterator<Item = f64>) -> f64 {
        let mut next = || arguments.next().unwrap_or(f64::NAN);
        match self {
            Opaque::Noise => {
                let (seed, channel, sample) = (next(), next(), next());
                normal(seed as i32, channel as usize, sample)
            }
        }
    }
}

/// The number of a sample of a channel, with mean 0 and standard deviation 1. It needs no generator's state: each number
/// depends on seed, channel and sample alone.
fn normal(seed: i32, channel: usize, sample: f64) -> f64 {
    let stream = [seed as u64, channel as u64, sample as i64 as u64].into_iter().fold(0, scrambled);
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
