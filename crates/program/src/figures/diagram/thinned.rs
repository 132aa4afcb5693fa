//! Curves with as few points as look the same.

/// A curve of at most about twice as many points as groups. The smallest and the largest value of each group of
/// neighbours stay, so no peak is lost. So do the first and the last point, and values that aren't finite.
pub fn thinned(times: &[f64], values: &[f64], groups: usize) -> Vec<(f64, f64)> {
    let last = times.len().min(values.len()).saturating_sub(1);
    let size = times.len().div_ceil(groups).max(1);
    if size == 1 {
        return times.iter().copied().zip(values.iter().copied()).collect();
    }
    let mut drawn = Vec::new();
    for (group, part) in values.chunks(size).enumerate() {
        let places = group * size..group * size + part.len();
        let by_value = |a: &usize, b: &usize| values[*a].total_cmp(&values[*b]);
        drawn.extend(places.clone().min_by(by_value));
        drawn.extend(places.clone().max_by(by_value));
        drawn.extend(places.clone().find(|&place| !values[place].is_finite()));
        drawn.extend(places.filter(|&place| place == 0 || place == last));
    }
    drawn.sort_unstable();
    drawn.dedup();
    drawn.into_iter().map(|place| (times[place], values[place])).collect()
}

/// Places of points of a line that stays within a distance of all its points: the first and the last, and of every part
/// the farthest point from the straight line between its ends (U. Ramer; D. Douglas and T. Peucker). Points must be
/// finite.
pub fn simplified(points: &[(f64, f64)], distance: f64) -> Vec<usize> {
    let last = points.len().saturating_sub(1);
    let mut chosen = vec![0];
    chosen.truncate(points.len());
    let mut parts = vec![(0, last)];
    while let Some((from, to)) = parts.pop() {
        match farthest(points, (from, to), distance) {
            Some(place) => parts.extend([(place, to), (from, place)]),
            None if to > from => chosen.push(to),
            None => {}
        }
    }
    chosen
}

/// The farthest point from the line between two others, the last of several; none if no distance is larger than this
/// one.
fn farthest(points: &[(f64, f64)], (from, to): (usize, usize), distance: f64) -> Option<usize> {
    // There may be no points at all.
    let away = from_segment(*points.get(from)?, *points.get(to)?);
    // A distance takes far longer than its square, which decides for all points but those within its rounding.
    let nearly = |distance: f64| distance * distance * (1.0 - 1e-12);
    let (mut found, mut largest, mut square) = (None, distance, nearly(distance));
    let inner = from + 1..to;
    for (place, point) in inner.clone().zip(points.get(inner).unwrap_or_default()) {
        let (x, y) = away(*point);
        if x * x + y * y >= square {
            let distance_of_it = x.hypot(y);
            if distance_of_it > distance && distance_of_it >= largest {
                (found, largest, square) = (Some(place), distance_of_it, nearly(distance_of_it));
            }
        }
    }
    found
}

/// Returns the distance of a point from the line between two others, by each coordinate.
fn from_segment(from: (f64, f64), to: (f64, f64)) -> impl Fn((f64, f64)) -> (f64, f64) {
    let (dx, dy) = (to.0 - from.0, to.1 - from.1);
    let length = dx * dx + dy * dy;
    move |(x, y)| {
        let (x, y) = (x - from.0, y - from.1);
        let along = if length > 0.0 { ((x * dx + y * dy) / length).clamp(0.0, 1.0) } else { 0.0 };
        (x - along * dx, y - along * dy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(count: u32) -> Vec<f64> {
        (0..count).map(f64::from).collect()
    }

    #[test]
    fn a_peak_of_one_point_stays_and_so_do_the_ends() {
        let times = times(100_000);
        let mut values = vec![0.5; times.len()];
        (values[0], values[33_333], values[77_777], values[99_999]) = (0.1, 9.0, -9.0, 0.2);
        let curve = thinned(&times, &values, 500);
        assert!(curve.len() <= 1002, "{} points", curve.len());
        for place in [0, 33_333, 77_777, 99_999] {
            assert!(curve.contains(&(times[place], values[place])), "the point at {place} is gone");
        }
        assert!(curve.is_sorted_by(|a, b| a.0 < b.0), "time goes on");
    }

    #[test]
    fn a_short_curve_stays_as_it_is() {
        let (times, values) = (times(4), vec![1.0, 3.0, 2.0, 0.0]);
        assert_eq!(thinned(&times, &values, 4), [(0.0, 1.0), (1.0, 3.0), (2.0, 2.0), (3.0, 0.0)]);
        assert_eq!(thinned(&[], &[], 4), []);
    }

    #[test]
    fn a_simplified_line_stays_near_all_its_points_and_keeps_corners() {
        let sine: Vec<_> = times(1001).into_iter().map(|t| (t, 100.0 * (t / 100.0).sin())).collect();
        let drawn = simplified(&sine, 0.1);
        assert!(drawn.len() < 120 && drawn.is_sorted() && drawn.first() == Some(&0) && drawn.last() == Some(&1000));
        for ends in drawn.windows(2) {
            let away = from_segment(sine[ends[0]], sine[ends[1]]);
            let worst = (ends[0]..=ends[1]).map(|k| away(sine[k])).map(|(x, y)| x.hypot(y));
            assert!(worst.fold(0.0, f64::max) <= 0.1);
        }
        let square = [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.0, 5.0), (3.0, 5.0), (9.0, 5.0)];
        assert_eq!(simplified(&square, 0.1), [0, 2, 3, 5]);
        assert_eq!((simplified(&[], 1.0), simplified(&square[..1], 1.0)), (vec![], vec![0]));
    }

    #[test]
    fn of_points_that_are_equally_far_the_last_stays() {
        let zigzag: Vec<_> = times(9).into_iter().map(|t| (t, if t % 4.0 == 2.0 { 1.0 } else { 0.0 })).collect();
        assert_eq!(farthest(&zigzag, (0, 8), 0.5), Some(6));
        assert_eq!(farthest(&zigzag, (0, 8), 1.0), None);
    }

    #[test]
    fn a_gap_stays_a_gap() {
        let times = times(1000);
        let mut values = vec![0.0; 1000];
        values[500] = f64::NAN;
        assert!(thinned(&times, &values, 10).iter().any(|(time, value)| *time == 500.0 && value.is_nan()));
    }
}
