//! Distinct steps of a record.

/// Steps that differ by less, relative to the step, are the same.
const SAME: f64 = 1e-6;
/// The most distinct steps that have a matrix exponential each.
const MOST: usize = 64;

/// Distinct steps, in samples, and how they are found.
#[derive(Debug, Clone)]
pub(crate) struct Steps {
    /// The steps in growing order; 1 is among them.
    pub lengths: Vec<f64>,
    /// The place of the step that is one sample.
    pub common: usize,
    extremes: [f64; 2],
    is_single: bool,
    /// True where steps are known by nodes only.
    is_dense: bool,
}

/// Means of groups of steps that are the same, and how many there are in each.
fn groups(lengths: &[f64]) -> Vec<(f64, usize)> {
    let mut sorted = lengths.to_vec();
    sorted.sort_by(f64::total_cmp);
    // First member, sum, count.
    let mut groups: Vec<(f64, f64, usize)> = Vec::new();
    for length in sorted {
        match groups.last_mut() {
            Some((first, sum, count)) if length <= *first * (1.0 + SAME) => {
                *sum += length;
                *count += 1;
            }
            _ => groups.push((length, length, 1)),
        }
    }
    groups.into_iter().map(|(_, sum, count)| (sum / count as f64, count)).collect()
}

impl Steps {
    /// The commonest step; where hardly any are the same, the median.
    pub fn commonest(lengths: &[f64]) -> f64 {
        let groups = groups(lengths);
        let &(length, count) = groups.iter().max_by_key(|(_, count)| *count).unwrap_or(&(1.0, 0));
        if groups.len() <= MOST || 10 * count > lengths.len() {
            return length;
        }
        let mut sorted = lengths.to_vec();
        sorted.sort_by(f64::total_cmp);
        sorted[sorted.len() / 2]
    }

    /// The steps of these lengths, s, with samples of h, s.
    pub fn new(lengths: &[f64], h: f64) -> Self {
        let scaled: Vec<f64> = lengths.iter().map(|length| length / h).collect();
        let mut found: Vec<f64> = groups(&scaled).into_iter().map(|(length, _)| length).collect();
        let extremes = [found[0], found[found.len() - 1]];
        let is_single = found.len() == 1;
        let is_dense = found.len() > MOST;
        if is_dense {
            let [least, most] = extremes;
            let ratio = (most / least).ln() / (MOST - 1) as f64;
            found = (0..MOST).map(|k| least * (ratio * k as f64).exp()).collect();
        }
        let near = |length: &f64| (length - 1.0).abs() < 2.0 * SAME;
        let common = found.iter().position(near).unwrap_or_else(|| {
            let place = found.partition_point(|length| *length < 1.0);
            found.insert(place, 1.0);
            place
        });
        found[common] = 1.0;
        Steps { lengths: found, common, extremes, is_single, is_dense }
    }

    /// The nearest step to a length in samples, and what it lacks.
    pub fn place(&self, length: f64) -> (usize, f64) {
        let after = self.lengths.partition_point(|known| *known < length).min(self.lengths.len() - 1);
        let before = after.saturating_sub(1);
        let distance = |place: usize| (self.lengths[place] - length).abs();
        let place = if distance(before) < distance(after) { before } else { after };
        let rest = length - self.lengths[place];
        (place, if !self.is_dense && rest.abs() <= 4.0 * SAME * length { 0.0 } else { rest })
    }

    /// True if all steps are the same.
    pub fn is_single(&self) -> bool {
        self.is_single
    }

    /// The least and the largest step, in samples.
    pub fn extremes(&self) -> [f64; 2] {
        self.extremes
    }
}
