use crate::recording::{Recorded, slopes};

use super::*;

const CENTRES: [f64; SETS] = [0.08, 0.31, 0.54, 0.77, 1.0];

/// The names of the parameters in the order of `sets`: VS_l, VS_c, S_l, S_c, L_l, L_c, L_h, VL_l, VL_c.
const LOWER: [f64; 9] = [0.0, 0.5, 0.3, 1.5, 1.5, 3.0, 6.0, 4.0, 8.0];
const UPPER: [f64; 9] = [0.5, 1.5, 1.5, 4.0, 3.0, 6.0, 10.0, 8.0, 12.0];
const MIDDLE: [f64; 9] = [0.25, 1.0, 0.9, 2.75, 2.25, 4.5, 8.0, 6.0, 10.0];

fn sets([vs_l, vs_c, s_l, s_c, l_l, l_c, l_h, vl_l, vl_c]: [f64; 9]) -> [Triangle<f64>; SETS] {
    [(vs_l, vs_l, s_l), (vs_l, vs_c, l_l), (s_l, s_c, vl_l), (l_l, l_c, l_h), (vl_l, vl_c, vl_c)]
        .map(|(low, centre, high)| Triangle { low, centre, high })
}

/// Corners of the bounds but those where a triangle has no width, and the middle.
fn shapes() -> Vec<[f64; 9]> {
    let corner = |k: usize| std::array::from_fn(|i| if k >> i & 1 == 1 { UPPER[i] } else { LOWER[i] });
    let corners = (0..1 << 9).map(corner).filter(|p: &[f64; 9]| p[0] < p[2] && p[7] < p[8]);
    corners.chain([MIDDLE]).collect()
}

fn gain(a: f64, b: f64) -> f64 {
    infer([a, b], &CENTRES, &sets(MIDDLE))
}

/// Inputs of the whole range and beyond.
fn grid() -> impl Iterator<Item = (f64, f64)> {
    (0..=44).flat_map(|i| (0..=44).map(move |j| (0.025 * f64::from(i), 0.025 * f64::from(j))))
}

/// The rules as the thesis prints them: rows and columns from very large to zero.
const PRINTED: [[&str; 5]; 5] = [
    ["VL", "VL", "VL", "VL", "L"],
    ["VL", "VL", "VL", "L", "S"],
    ["VL", "VL", "L", "S", "VS"],
    ["VL", "L", "S", "VS", "VS"],
    ["L", "S", "VS", "VS", "Z"],
];

/// The same inference by brute force: sets as functions, rules one by one, integrals as sums over 200 000 points.
fn by_summation(a: f64, b: f64, sets: &[Triangle<f64>; SETS]) -> f64 {
    let tent = |x: f64, low: f64, centre: f64, high: f64| {
        if x < low || x > high {
            0.0
        } else if x < centre {
            (x - low) / (centre - low)
        } else if x > centre {
            (high - x) / (high - centre)
        } else {
            1.0
        }
    };
    // A shoulder is the slope of a triangle that stays constant beyond its end.
    let belongs = |x: f64, k: usize| {
        let (x, before) = (x.clamp(CENTRES[0], CENTRES[4]), if k > 0 { CENTRES[k - 1] } else { -1.0 });
        tent(x, before, CENTRES[k], *CENTRES.get(k + 1).unwrap_or(&3.0))
    };
    let names = ["Z", "VS", "S", "L", "VL"];
    let (mut area, mut moment) = (0.0, 0.0);
    for (name, set) in names.iter().zip(sets) {
        let rules = (0..5).flat_map(|i| (0..5).map(move |j| (i, j)));
        let of_set = rules.filter(|&(row, column)| PRINTED[row][column] == *name);
        let height = of_set.map(|(row, column)| belongs(a, 4 - column).min(belongs(b, 4 - row))).fold(0.0, f64::max);
        let (points, width) = (200_000, set.high - set.low);
        for k in 0..points {
            let x = set.low + width * (f64::from(k) + 0.5) / f64::from(points);
            let weight = height.min(tent(x, set.low, set.centre, set.high)) * width / f64::from(points);
            area += weight;
            moment += weight * x;
        }
    }
    moment / area
}

#[test]
fn it_is_what_summation_over_the_sets_gives() {
    let inputs =
        [(0.0, 0.0), (0.1, 0.0), (0.2, 0.43), (0.55, 0.2), (0.08, 0.9), (0.31, 0.77), (0.95, 0.12), (2.0, 0.6)];
    for parameters in [MIDDLE, LOWER, [0.5, 1.5, 1.4, 1.5, 1.5, 6.0, 6.0, 4.0, 12.0]] {
        let sets = sets(parameters);
        for (a, b) in inputs {
            let (found, expected) = (infer([a, b], &CENTRES, &sets), by_summation(a, b, &sets));
            assert!((found / expected - 1.0).abs() < 1e-8, "{parameters:?} at {a}, {b}: {found}, not {expected}");
        }
    }
}

#[test]
fn the_inputs_may_be_exchanged() {
    assert!(grid().all(|(a, b)| (gain(a, b) / gain(b, a) - 1.0).abs() < 1e-14));
}

#[test]
fn at_the_centres_it_is_the_centre_of_one_set_and_grows_with_both_inputs() {
    let centre = |set: Triangle<f64>| (set.low + set.centre + set.high) / 3.0;
    for parameters in shapes() {
        let sets = sets(parameters);
        let at = |i: usize, j: usize| infer([CENTRES[i], CENTRES[j]], &CENTRES, &sets);
        for (i, j) in (0..5).flat_map(|i| (0..5).map(move |j| (i, j))) {
            let name = PRINTED[4 - j][4 - i];
            let set = ["Z", "VS", "S", "L", "VL"].iter().position(|other| *other == name).unwrap();
            assert!((at(i, j) / centre(sets[set]) - 1.0).abs() < 1e-14, "{parameters:?} at {i}, {j}");
        }
        let grows = sets.windows(2).all(|pair| centre(pair[0]) < centre(pair[1]));
        let between = (0..4).flat_map(|i| (0..5).map(move |j| (i, j)));
        assert!(!grows || between.clone().all(|(i, j)| at(i, j) <= at(i + 1, j)), "{parameters:?}");
    }
}

#[test]
fn below_the_first_centre_and_above_the_last_nothing_changes() {
    for b in [0.0, 0.2, 0.5, 3.0] {
        assert_eq!(gain(0.0, b), gain(0.08, b));
        assert_eq!(gain(1.0, b), gain(1e6, b));
    }
    assert!((gain(0.0, 0.0) - (0.25 + 0.25 + 0.9) / 3.0).abs() < 1e-15, "the centre of zero");
    assert!((gain(9.0, 9.0) - (6.0 + 10.0 + 10.0) / 3.0).abs() < 1e-14, "the centre of very large");
}

#[test]
fn it_is_continuous_also_where_another_rule_takes_over() {
    let step = 1e-6;
    for (a, b) in grid() {
        let (change, along) = ((gain(a + step, b) - gain(a, b)).abs(), (gain(a, b + step) - gain(a, b)).abs());
        assert!(change < 100.0 * step && along < 100.0 * step, "at {a}, {b}: {change}, {along}");
    }
}

#[test]
fn within_the_bounds_of_its_sets_the_gain_is_at_least_a_tenth() {
    for parameters in shapes() {
        let sets = sets(parameters);
        let smallest = grid().map(|(a, b)| infer([a, b], &CENTRES, &sets)).fold(f64::INFINITY, f64::min);
        assert!(smallest > 0.1 - 1e-12, "{parameters:?}: {smallest}");
    }
}

#[test]
fn each_value_belongs_to_two_neighbours_that_share_it() {
    for k in 0..=120 {
        let sets = memberships(0.01 * f64::from(k), &CENTRES);
        assert!((sets.iter().sum::<f64>() - 1.0).abs() < 1e-14, "{sets:?}");
        assert!(sets.iter().filter(|part| **part > 0.0).count() <= 2, "{sets:?}");
    }
}

#[test]
fn a_set_of_which_little_is_left_has_its_centre_at_the_middle_of_its_base() {
    let triangle: Triangle<f64> = Triangle { low: 1.0, centre: 1.5, high: 4.0 };
    let (area, moment) = triangle.clipped(1e-12);
    assert!((area / 3e-12 - 1.0).abs() < 1e-11 && (moment / area - 2.5).abs() < 1e-11);
}

#[test]
fn a_recording_gives_its_slope() {
    let (a, b, step) = (0.2, 0.45, 1e-6);
    let constant = |triangle: Triangle<f64>| {
        let Triangle { low, centre, high } = triangle;
        Triangle { low: low.into(), centre: centre.into(), high: high.into() }
    };
    let of = |a| [infer([a, b.into()], &CENTRES.map(Recorded::from), &sets(MIDDLE).map(constant))];
    let [(_, slope)] = slopes(of, a);
    let difference = (gain(a + step, b) - gain(a - step, b)) / (2.0 * step);
    assert!((slope / difference - 1.0).abs() < 1e-6, "{slope}, {difference}");
}
