//! Figures of a step response, measured point by point without storing the points.

/// Half-width of the settling band about the end, relative to the step.
const SETTLED: f64 = 0.02;
/// Latest time of leaving that band, relative to the duration; if it leaves later, it hasn't settled.
const RESTING: f64 = 0.9;
/// Largest excess over the reference that counts as rounding, not as overshoot.
const ROUNDING: f64 = 1e-6;
/// Largest number of records of one kind; of more, every other one is dropped.
const MOST_RECORDS: usize = 1 << 16;

/// A signal that should go from one value to another.
#[derive(Debug)]
pub struct StepResponse {
    from: f64,
    size: f64,
    start: f64,
    last: Option<Point>,
    is_finite: bool,
    rising: Records,
    above: Records,
    below: Records,
}

/// Figures of a step response, relative to the step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepFigures {
    /// Rise time from 10 % to 90 % of the way to its end, s; `None` if it doesn't go there.
    pub rise: Option<f64>,
    /// Settling time to within 2 % of the step about its end, s; `None` if it still moves at the end.
    pub settling: Option<f64>,
    /// Overshoot beyond the reference.
    pub overshoot: f64,
    /// Final value: 1 at the reference.
    pub end: f64,
}

impl StepResponse {
    /// A step from a value by a size, which isn't 0, at a time in s.
    pub fn new(from: f64, size: f64, start: f64) -> Self {
        let [rising, above, below] = [(); 3].map(|()| Records::default());
        StepResponse { from, size, start, last: None, is_finite: true, rising, above, below }
    }

    /// Adds a point; times in s don't decrease.
    pub fn add(&mut self, time: f64, value: f64) {
        let point = Point { time, value: (value - self.from) / self.size };
        self.is_finite &= point.value.is_finite();
        let before = self.last.replace(point).unwrap_or(point);
        self.rising.add_if_higher(point, before);
        // The last point is the end, not a point that leaves the band.
        self.above.add_above_what_follows(before, point);
        self.below.add_above_what_follows(before.turned(), point.turned());
    }

    /// The figures; `None` without points.
    pub fn figures(&self) -> Option<StepFigures> {
        let Point { time, value: end } = self.last?;
        let highest = self.rising.0.last().map_or(end, |record| record.at.value);
        let overshoot = Some(highest - 1.0).filter(|beyond| *beyond > ROUNDING).unwrap_or(0.0);
        let of_end = |part: f64| self.rising.first_at(part * end);
        let rise = of_end(0.1).zip(of_end(0.9)).map(|(first, last)| last - first);
        let left = [self.above.last_above(end + SETTLED), self.below.last_above(SETTLED - end)];
        let settled = left.into_iter().flatten().fold(self.start, f64::max);
        let rests = self.is_finite && settled - self.start <= RESTING * (time - self.start);
        Some(StepFigures {
            rise: rise.filter(|_| self.is_finite && end > 0.0),
            settling: rests.then_some(settled - self.start),
            overshoot,
            end,
        })
    }
}

#[derive(Debug, Clone, Copy)]
struct Point {
    time: f64,
    value: f64,
}

impl Point {
    fn turned(self) -> Self {
        Point { value: -self.value, ..self }
    }
}

/// Points that are higher than all before, or than all after, each with its neighbour on that side.
#[derive(Debug, Default)]
struct Records(Vec<Record>);

#[derive(Debug, Clone, Copy)]
struct Record {
    at: Point,
    other: Point,
}

impl Records {
    fn add_if_higher(&mut self, at: Point, before: Point) {
        if self.0.last().is_none_or(|highest| at.value > highest.at.value) {
            self.push(Record { at, other: before });
        }
    }

    fn add_above_what_follows(&mut self, at: Point, next: Point) {
        while self.0.pop_if(|record| record.at.value <= at.value).is_some() {}
        self.push(Record { at, other: next });
    }

    fn push(&mut self, record: Record) {
        if self.0.len() == MOST_RECORDS {
            let mut number = 0;
            self.0.retain(|_| {
                number += 1;
                number % 2 == 0
            });
        }
        self.0.push(record);
    }

    /// Time at which rising records first reach a level.
    fn first_at(&self, level: f64) -> Option<f64> {
        let place = self.0.partition_point(|record| record.at.value < level);
        self.0.get(place).map(|record| record.crossing(level))
    }

    /// Time at which falling records last leave a level.
    fn last_above(&self, level: f64) -> Option<f64> {
        let place = self.0.partition_point(|record| record.at.value > level);
        place.checked_sub(1).map(|place| self.0[place].crossing(level))
    }
}

impl Record {
    /// Time at which the line to its neighbour crosses a level; its own time if it doesn't.
    fn crossing(&self, level: f64) -> f64 {
        let Record { at, other } = self;
        let part = (at.value - level) / (at.value - other.value);
        if (0.0..=1.0).contains(&part) { at.time + part * (other.time - at.time) } else { at.time }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figures(from: f64, size: f64, step: f64, y: impl Fn(f64) -> f64) -> StepFigures {
        let mut response = StepResponse::new(from, size, 5.0);
        (0..=(20.0 / step) as u32).map(|k| f64::from(k) * step).for_each(|t| response.add(5.0 + t, y(t)));
        response.figures().unwrap()
    }

    #[test]
    fn a_lag_rises_in_2_2_and_settles_in_3_9_time_constants_whatever_the_step() {
        for (size, step) in [(2.0, 0.1), (-3.0, 0.01), (1e-6, 0.001)] {
            let lag = figures(7.0, size, step, |t| 7.0 + size * (1.0 - (-t).exp()));
            assert!((lag.rise.unwrap() - 9_f64.ln()).abs() < 2e-3, "{lag:?}");
            assert!((lag.settling.unwrap() - 50_f64.ln()).abs() < 2e-3, "{lag:?}");
            assert!(lag.overshoot == 0.0 && (lag.end - 1.0).abs() < 1e-8);
        }
    }

    #[test]
    fn a_swing_overshoots_and_settles_where_it_last_leaves_the_band() {
        // d = 0.3, ω_n = 2.
        let (d, w) = (0.3_f64, 2.0);
        let damped = w * (1.0 - d * d).sqrt();
        let y = |t: f64| 1.0 - (-d * w * t).exp() * ((damped * t).cos() + d * w / damped * (damped * t).sin());
        let found = figures(0.0, 1.0, 1e-3, y);
        let overshoot = (-std::f64::consts::PI * d / (1.0 - d * d).sqrt()).exp();
        assert!((found.overshoot - overshoot).abs() < 1e-5, "{found:?}");
        let end = y(20.0);
        let left = (0..200_000).rev().map(|k| f64::from(k) * 1e-4).find(|t| (y(*t) - end).abs() > 0.02).unwrap();
        assert!((found.settling.unwrap() - left).abs() < 2e-4, "{found:?} {left}");
    }

    #[test]
    fn what_still_moves_has_not_settled_and_what_goes_the_wrong_way_has_not_risen() {
        assert_eq!(figures(0.0, 1.0, 0.01, |t| t).settling, None);
        assert_eq!(figures(0.0, 1.0, 0.01, |t| if t < 19.5 { 1.0 } else { f64::NAN }).settling, None);
        assert_eq!(figures(0.0, 1.0, 0.01, |t| if t == 3.0 { f64::NAN } else { 1.0 }).settling, None);
        let wrong = figures(0.0, 1.0, 0.01, |t| (-t).exp() - 1.0);
        assert_eq!((wrong.rise, wrong.overshoot), (None, 0.0));
        assert_eq!(figures(0.0, 1.0, 0.01, |_| 1.0).settling, Some(0.0));
    }

    #[test]
    fn a_response_of_more_points_than_records_is_measured_nearly_as_well() {
        let lag = figures(0.0, 1.0, 1e-4, |t| 1.0 - (-t).exp());
        assert!((lag.settling.unwrap() - 50_f64.ln()).abs() < 2e-3, "{lag:?}");
        assert!((lag.rise.unwrap() - 9_f64.ln()).abs() < 2e-3, "{lag:?}");
    }
}
