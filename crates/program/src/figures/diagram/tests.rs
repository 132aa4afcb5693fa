use super::*;

const TIMES: usize = 6001;

/// A curve over 60 s.
fn given(name: &str, unit: &str, part: Part, value: impl Fn(f64) -> f64) -> Given<'static> {
    let times: Vec<f64> = (0..TIMES).map(|k| k as f64 * 0.01).collect();
    let values: Vec<f64> = times.iter().map(|time| value(*time)).collect();
    let (name, unit) = (name.to_owned(), unit.to_owned());
    Given { shown: Shown::signal(&name), name, unit, part, times: times.into(), values: values.into() }
}

fn diagram(curves: Vec<Given<'static>>) -> Diagram<'static> {
    Diagram::new("output and reference", &time_label(), Scale::Linear, curves)
}

fn peak_then_sine(time: f64) -> f64 {
    1600.0 * (-8.0 * time).exp() + time.sin()
}

#[test]
fn axes_are_quantities_with_units_and_curves_of_several_units_name_theirs() {
    let one = diagram(vec![given("a.y", "rad", Part::Own, f64::sin), given("y_m", "", Part::ReferenceOf(0), f64::sin)]);
    assert_eq!((one.x.as_str(), one.y.as_str()), ("time (s)", "angle (rad)"));
    assert_eq!(one.curves[0].name, "a.y");
    let two = diagram(vec![given("a.f", "N", Part::Own, f64::sin), given("a.m", "N.m", Part::Own, f64::cos)]);
    assert_eq!((two.y.as_str(), two.curves[1].name.as_str()), ("force (N), torque (N m)", "a.m (N m)"));
}

#[test]
fn a_first_peak_is_shown_next_to_what_it_would_flatten_and_nothing_is_left_out() {
    let diagram = diagram(vec![given("c.u", "V", Part::Own, peak_then_sine)]);
    let peak = diagram.peak.unwrap();
    assert_eq!(peak.value, 1600.0);
    assert!(-1.3 < peak.low && peak.low < -1.0 && 1.0 < peak.high && peak.high < 1.3, "{peak:?}");
    let [start, rest] = diagram.parts()[..] else { panic!("two parts") };
    assert!(start.0 == 0.0 && rest.0 <= start.1 && rest.1 == 60.0, "every time is in one of them");
    // All curves are within their axes.
    for (from, to) in [start, rest] {
        let (axis, curve) = (diagram.axis(from, to), &diagram.curves[0]);
        assert!(curve.values[curve.rows(from, to)].iter().all(|value| (0.0..=1.0).contains(&axis.place(*value))));
    }
    let svg = svg("loop", &[diagram]);
    assert!(svg.contains("the start") && svg.contains("scale of its own"));
}

#[test]
fn a_loop_that_is_lost_at_its_end_shows_what_it_did_before() {
    let diagram = diagram(vec![given("c.u", "V", Part::Own, |time| time.sin() + (60.0 * (time - 59.9)).exp())]);
    let peak = diagram.peak.unwrap();
    assert!(peak.value > 400.0 && peak.from > 59.0 && peak.until == 60.0 && peak.high < 1.3, "{peak:?}");
    assert_eq!(diagram.peak_part(), Some(1));
    let [rest, end] = diagram.parts()[..] else { panic!("two parts") };
    assert!(rest.0 == 0.0 && end.0 <= rest.1 && end.1 == 60.0);
    assert!(svg("loop", &[diagram]).contains("the end"));
}

#[test]
fn a_step_that_settles_and_what_has_no_peak_are_shown_whole() {
    for value in
        [|time: f64| 1.0 - (-3.0 * time).exp(), f64::sin, |_| 0.0, |time: f64| if time < 1.0 { 1.0 } else { 0.0 }]
    {
        let diagram = diagram(vec![given("a.y", "", Part::Own, value)]);
        assert_eq!((diagram.peak, diagram.parts()), (None, vec![(0.0, 60.0)]));
    }
}

#[test]
fn a_logarithmic_axis_is_chosen_or_follows_from_the_values() {
    let decays = |scale| {
        let curve = given("|e|", "rad", Part::Own, |time| (-0.3 * time).exp());
        Diagram::new("errors", "time (s)", scale, vec![curve]).decades
    };
    assert_eq!(decays(Scale::Linear), None);
    let (low, high) = decays(Scale::Logarithmic).unwrap();
    assert!(low < 2e-8 && (high - 1.5).abs() < 1e-9, "{low} {high}");
    assert_eq!(decays(Scale::ByValues), decays(Scale::Logarithmic));
    let curve = || vec![given("y", "", Part::Own, f64::sin)];
    assert_eq!(Diagram::new("y", "time (s)", Scale::ByValues, curve()).decades, None);
}

#[test]
fn references_lie_beneath_dashed_and_the_legend_next_to_the_axes() {
    let curves = vec![
        given("plant.y[1]", "m", Part::Own, f64::sin),
        given("reference.r[1]", "m", Part::ReferenceOf(0), f64::sin),
    ];
    let svg = svg("loop", &[diagram(curves)]);
    let place = |words: &str| svg.find(words).unwrap_or_else(|| panic!("no {words} in {svg}"));
    // What is drawn first lies beneath.
    let (first, second) = svg[place("<svg x=")..].split_once("/>").unwrap();
    assert!(first.contains("stroke-dasharray") && !second.split_once("/>").unwrap().0.contains("stroke-dasharray"));
    let border = svg[place("<rect x=")..].split('"').collect::<Vec<_>>();
    let right: f64 = border[1].parse::<f64>().unwrap() + border[5].parse::<f64>().unwrap();
    let name: f64 =
        svg[..place(">plant.y[1]<")].rsplit("x=\"").next().unwrap().split('"').next().unwrap().parse().unwrap();
    assert!(name > right, "the name at {name} is right of the axes, which end at {right}");
}

#[test]
fn points_for_a_page_are_few_and_lie_on_the_curve_as_far_as_a_reader_zooms() {
    let diagram = diagram(vec![given("c.u", "V", Part::Own, peak_then_sine), given("y", "V", Part::Own, f64::sin)]);
    let page = diagram.with_points(1500);
    let range = diagram.peak.map_or(0.0, |peak| peak.high - peak.low);
    for curve in &diagram.curves {
        let shown = page["curves"]
            .as_array()
            .unwrap()
            .iter()
            .find(|curve_of_page| curve_of_page["name"] == curve.name.as_str())
            .unwrap();
        let numbers =
            |key: &str| shown[key].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect::<Vec<_>>();
        let (x, y) = (numbers("x"), numbers("y"));
        assert!(x.len() < 1300, "{} points", x.len());
        let mut behind = 1;
        for (time, value) in curve.times.iter().zip(curve.values.iter()) {
            while x[behind] < *time && behind + 1 < x.len() {
                behind += 1;
            }
            let part = (time - x[behind - 1]) / (x[behind] - x[behind - 1]);
            let line = y[behind - 1] + part * (y[behind] - y[behind - 1]);
            // This is a thousandth of the height, also on the scale without the peak.
            assert!((line - value).abs() <= 1e-3 * range + 1e-5 * value.abs(), "t = {time}: {line}, not {value}");
        }
    }
}

#[test]
fn wherever_a_pointer_is_a_point_is_near_also_on_a_straight_line() {
    let diagram = diagram(vec![given("y", "V", Part::Own, |time| 2.0 * time)]);
    let numbers = diagram.with_points(250);
    let x: Vec<f64> = numbers["curves"][0]["x"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    let (start, end) = diagram.span();
    assert!(x.len() <= 130 && x.windows(2).all(|pair| pair[1] - pair[0] <= 2.0 / 125.0 * (end - start)), "{x:?}");
}

#[test]
fn gaps_and_no_curves_are_no_fault() {
    let gap = given("y", "", Part::Own, |time| if time < 30.0 { f64::NAN } else { time });
    let diagram = diagram(vec![gap]);
    assert!(!svg("loop", std::slice::from_ref(&diagram)).contains("NaN"));
    assert!(diagram.with_points(500)["curves"][0]["y"][0].is_null());
    let none = Diagram::new("none", "time (s)", Scale::Logarithmic, Vec::new());
    assert!(svg("loop", &[none]).contains("none"));
}
