//! The course of a loop while one of its references steps.

use crate::results::StepResponse;

/// The course of a loop, all signals at the same times.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Course {
    /// Times, s.
    pub times: Vec<f64>,
    /// Controlled outputs of the plant.
    pub outputs: Vec<Vec<f64>>,
    /// Controls as the controller gives them.
    pub controls: Vec<Vec<f64>>,
}

/// Figures of a step of a reference.
#[derive(Debug, Clone, PartialEq)]
pub struct Followed {
    /// Settling time of all outputs to within 2 % of the step about their ends, s; `None` if one doesn't settle.
    pub settling: Option<f64>,
    /// Overshoot beyond the reference, in parts of the step.
    pub overshoot: f64,
    /// Steady-state error, in parts of the step.
    pub off: f64,
    /// The largest size of each control.
    pub peaks: Vec<f64>,
    /// Change of an output over the last third of the run, in parts of its step.
    pub drift: f64,
}

impl Course {
    /// An empty one.
    pub fn new(outputs: usize, controls: usize) -> Self {
        Course { times: Vec::new(), outputs: vec![Vec::new(); outputs], controls: vec![Vec::new(); controls] }
    }

    /// The course from a communication point on, whose time counts as 0 s.
    #[must_use]
    pub fn from(mut self, time: f64) -> Self {
        // Times are multiples of the step up to rounding.
        let first = self.times.partition_point(|&other| other < time * (1.0 - 1e-9));
        self.times.drain(..first);
        self.times.iter_mut().for_each(|other| *other -= time);
        self.outputs.iter_mut().chain(&mut self.controls).for_each(|values| _ = values.drain(..first));
        self
    }

    /// Figures of a step of the reference of output `i`, where outputs have steps of these sizes.
    pub fn followed(&self, i: usize, sizes: &[f64]) -> Followed {
        let figures = |(y, size): (&Vec<f64>, &f64)| {
            let mut response = StepResponse::new(0.0, *size, self.times.first().copied().unwrap_or_default());
            self.times.iter().zip(y).for_each(|(time, value)| response.add(*time, *value));
            response.figures()
        };
        let all: Vec<_> = self.outputs.iter().zip(sizes).map(figures).collect();
        let settling =
            all.iter().map(|one| one.as_ref()?.settling).try_fold(0.0, |latest, one| Some(f64::max(latest, one?)));
        let (overshoot, end) = all[i].map_or((0.0, f64::NAN), |one| (one.overshoot, one.end));
        let size = |u: &Vec<f64>| u.iter().map(|value| value.abs()).fold(0.0, f64::max);
        let peaks = self.controls.iter().map(size).collect();
        Followed { settling, overshoot, off: (end - 1.0).abs(), peaks, drift: self.drift(sizes) }
    }

    fn drift(&self, sizes: &[f64]) -> f64 {
        let [Some(first), Some(last)] = [self.times.first(), self.times.last()] else { return 0.0 };
        let place = self.times.partition_point(|&time| time < first + (last - first) * 2.0 / 3.0);
        let change = |(y, size): (&Vec<f64>, &f64)| ((y[y.len() - 1] - y[place]) / size).abs();
        self.outputs.iter().zip(sizes).map(change).fold(0.0, f64::max)
    }

    /// The standard deviation of each control in the last half.
    pub fn deviations(&self) -> Vec<f64> {
        let deviation = |u: &Vec<f64>| {
            let late = &u[u.len() / 2..];
            let mean = late.iter().sum::<f64>() / late.len() as f64;
            (late.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / late.len() as f64).sqrt()
        };
        self.controls.iter().map(deviation).collect()
    }
}

impl Followed {
    /// The worse of both in each respect.
    #[must_use]
    pub fn or_worse(self, other: &Self) -> Self {
        let worse = |(mine, theirs): (f64, &f64)| mine.max(*theirs);
        Followed {
            settling: self.settling.zip(other.settling).map(|(mine, theirs)| mine.max(theirs)),
            overshoot: self.overshoot.max(other.overshoot),
            off: self.off.max(other.off),
            peaks: self.peaks.into_iter().zip(&other.peaks).map(worse).collect(),
            drift: self.drift.max(other.drift),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 2 (1 − e^−t), and a control that falls from 3.
    fn lag() -> Course {
        let times: Vec<_> = (0..=10_000).map(|k| 1e-3 * f64::from(k)).collect();
        let y = times.iter().map(|t| 2.0 * (1.0 - (-t).exp())).collect();
        let u = times.iter().map(|t| 3.0 * (-t).exp()).collect();
        Course { times, outputs: vec![y], controls: vec![u] }
    }

    #[test]
    fn a_lag_settles_to_2_per_cent_in_3_9_of_its_time_constant() {
        let followed = lag().followed(0, &[2.0]);
        assert!((followed.settling.unwrap() - 50_f64.ln()).abs() < 0.01, "{followed:?}");
        assert_eq!((followed.overshoot, followed.peaks.as_slice()), (0.0, &[3.0][..]));
        assert!(followed.off < 1e-4);
        // Relative to a step to 1, it ends at twice that.
        let followed = lag().followed(0, &[1.0]);
        assert!((followed.overshoot - 1.0).abs() < 1e-3 && (followed.off - 1.0).abs() < 1e-3);
    }

    #[test]
    fn what_still_moves_at_the_end_has_not_settled() {
        let mut course = lag();
        let last = course.times.len() - 1;
        course.outputs[0][last - 10] = 3.0;
        assert_eq!(course.followed(0, &[2.0]).settling, None);
        course.outputs[0][last] = f64::NAN;
        assert_eq!(course.followed(0, &[2.0]).settling, None);
    }

    #[test]
    fn a_drift_is_what_an_output_moves_by_in_the_last_third() {
        let mut course = lag();
        assert!(course.followed(0, &[2.0]).drift < 2e-3);
        for (time, y) in course.times.iter().zip(&mut course.outputs[0]) {
            *y -= 0.03 * time / 10.0;
        }
        let followed = course.followed(0, &[2.0]);
        assert!((followed.drift - 0.005).abs() < 2e-3 && followed.settling.is_some(), "{followed:?}");
    }

    #[test]
    fn the_worse_of_two_is_worse_in_each_respect() {
        let one = Followed { settling: Some(1.0), overshoot: 0.2, off: 0.0, peaks: vec![1.0, 5.0], drift: 0.0 };
        let other = Followed { settling: Some(2.0), overshoot: 0.1, off: 0.1, peaks: vec![2.0, 4.0], drift: 0.3 };
        let both = one.clone().or_worse(&other);
        let worst = Followed { settling: Some(2.0), overshoot: 0.2, off: 0.1, peaks: vec![2.0, 5.0], drift: 0.3 };
        assert_eq!(both, worst);
        assert_eq!(both.or_worse(&Followed { settling: None, ..one }).settling, None);
    }
}
