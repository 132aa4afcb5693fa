//! Design report of a funnel controller: how its plant follows, its bounds, how steep it is in the middle of
//! them, and its limits.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector};

use super::{Bounds, Errors, FunnelControl};
use crate::controllers::at_limit::unit;
use crate::design::funnel_loop::{Channel, FOLLOWED, Followed, Loop, SMOOTH_START, smooth_start};
use crate::design::robustness::place::Place;
use crate::design::robustness::report::{Described, Unit, report_number};
use crate::design::robustness::uncertain::Uncertain;
use crate::design::{digits, percent};
use crate::mathematics::limits::UNLIMITED;
use crate::mathematics::performance;
use crate::picture::{Curve, CurveOf, Picture};
use crate::system::{DesignReport, Values, Verdict};
use crate::template::three_digits;

/// Most samples of loops that are computed.
const MOST_SAMPLES: f64 = 2e6;
/// Points of a bound in a picture.
const POINTS: u32 = 120;

impl FunnelControl {
    pub(super) fn report_design(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.report_loop(v, report);
        report.section("Funnel");
        report_bounds(&self.bounds, v, report);
        match &self.errors {
            Errors::Filtered { tau: Some(tau) } => {
                report.add(&v.name(*tau), &row(&v[*tau]), "s", "in the middle the error decays with it");
            }
            Errors::Filtered { tau: None } => {}
            Errors::TwoFunnels { g_0, second } => {
                report.section("Funnel of the second error");
                report_bounds(second, v, report);
                report.add(&v.name(*g_0), &row(&v[*g_0]), "1/s", "in the middle the error decays at this rate");
            }
        }
        report.section("Gain");
        let note = "how much a channel asks for, over the last error in parts of its bound: in the middle of it, and ever \
                    more towards it";
        report.add(&v.name(self.g), &row(&v[self.g]), "", note);
        let note =
            "the plant's input gain times it, plus its transpose, must be positive definite; this is not checked";
        report.add(&v.name(self.G), &v.matrix(self.G).into_owned(), "", note);
        let is_limited = |j: &usize| v[self.u_min][*j] > -UNLIMITED || v[self.u_max][*j] < UNLIMITED;
        for j in (0..self.u.len()).filter(is_limited) {
            let note = "without limits the error stays in its funnel, whatever the plant is; with them only where they don't act";
            report.judge(&format!("limits of {}", v.name(self.u.at(j))), "given", "", Verdict::Warning, note);
        }
    }

    /// The loop with the plant of the description, which follows a reference that starts smoothly.
    fn report_loop(&self, v: &Values<f64>, report: &mut DesignReport) {
        let (m, degree) = (self.u.len(), self.r.len());
        let Errors::Filtered { tau } = &self.errors else { return };
        let Some(described) = report.nominal().and_then(|nominal| Described::new(nominal, m)) else { return };
        let W = described.plant.bandwidth;
        let channel = |i: usize| Channel {
            reference: described.reference[i],
            psi_0: v[self.bounds.start][i],
            psi_inf: v[self.bounds.end][i],
            decay_rate: v[self.bounds.decay_rate][i] / W,
            tau: tau.map_or(0.0, |tau| v[tau][i] * W),
            g: v[self.g][i],
        };
        let funnels = Funnels { channels: (0..m).map(channel).collect(), G: v.matrix(self.G).into_owned(), degree };
        funnels.report(&described, &unit(self.u, [self.u_min, self.u_max], v, report.step), report);
    }
}

/// Numbers of the controller, in parts of the plant's bandwidth.
struct Funnels {
    channels: Vec<Channel>,
    G: DMatrix<f64>,
    degree: usize,
}

impl Funnels {
    fn report(&self, described: &Described, unit: &Unit, report: &mut DesignReport) {
        let plant = &described.plant;
        report.section("Nominal loop");
        if plant.delay > 0.0 {
            let note = "a funnel is guaranteed for plants without one. Use pid or ladrc";
            return report.judge("dead time", plant.delay / plant.bandwidth, "s", Verdict::NotSound, note);
        }
        let nominal = Place::nominal(plant.size());
        let followed = self.follow(plant, &nominal, 1, unit);
        self.report_followed(&followed, described, unit, report);
        let mut summary = self.words(&followed, unit);
        let mut shown = vec![(CurveOf::Nominal, nominal)];
        if described.assumed.is_known() && followed.stayed() {
            let (worst, places) = self.report_uncertain(described, unit, report);
            summary.push_str(&worst);
            shown.splice(0..0, places.into_iter().map(|place| (CurveOf::Worst, place)));
        }
        report.summarise(summary);
        self.show(&shown, described, unit, report);
    }

    /// The worst of the uncertain plants in words, and those that are worst.
    fn report_uncertain(&self, described: &Described, unit: &Unit, report: &mut DesignReport) -> (String, Vec<Place>) {
        let plant = &described.plant;
        let (drawn, seed) = described.drawn;
        let mut places = vec![Place::nominal(plant.size())];
        places.extend(plant.bounds.drawn(drawn, seed));
        report_number(&places, report);
        let follow = |place: &Place| self.follow(plant, place, places.len(), unit);
        let all: Vec<_> = places.iter().map(follow).collect();
        let mut worst = all.iter().fold(all[0].clone(), |worst, one| worst.or_worse(one));
        let mut shown = Vec::new();
        for respect in 0..=2 * unit.controls.len() {
            let value = |one: &Followed| one.respects().nth(respect).unwrap_or(0.0);
            let largest = (0..all.len()).max_by(|&one, &other| value(&all[one]).total_cmp(&value(&all[other])));
            let largest = largest.unwrap_or(0);
            let (place, _) = plant.worse(places[largest].clone(), value(&all[largest]), |other| {
                let followed = follow(other);
                worst = worst.clone().or_worse(&followed);
                Some(value(&followed))
            });
            shown.push(place);
        }
        report.worst = described.worst_plants(&shown, &["largest error"], unit);
        self.report_followed(&worst, described, unit, report);
        shown.dedup();
        let text = format!("; worst of {} plants: {}", places.len(), self.words(&worst, unit));
        (text, shown)
    }

    /// Adds pictures of outputs and controls.
    fn show(&self, shown: &[(CurveOf, Place)], described: &Described, unit: &Unit, report: &mut DesignReport) {
        let (m, W) = (self.channels.len(), described.plant.bandwidth);
        let numbered = |what: &str, i: usize| if m > 1 { format!("{what} {}", i + 1) } else { what.to_owned() };
        let (mut outputs, mut controls) = (Vec::new(), Vec::new());
        for (of, place) in shown {
            let mut points = vec![Vec::new(); 2 * m];
            self.of(&described.plant, place).watch(|t, y, u| {
                for (points, value) in points.iter_mut().zip(y.iter().chain(u.iter())) {
                    points.push([t / W, *value]);
                }
            });
            for (k, points) in points.into_iter().enumerate() {
                let name = if k < m { numbered("output", k) } else { unit.controls[k - m].clone() };
                if k < m { &mut outputs } else { &mut controls }.push(Curve { name, of: *of, points });
            }
        }
        let bounds = [("upper bound", 1.0), ("lower bound", -1.0)].into_iter();
        outputs.extend(bounds.flat_map(|(what, sign)| {
            self.channels.iter().enumerate().map(move |(i, channel)| {
                let points = (0..=POINTS).map(|k| FOLLOWED * f64::from(k) / f64::from(POINTS));
                let points = points.map(|t| [t / W, channel.reference * smooth_start(t)[0] + sign * channel.bound(t)]);
                Curve { name: numbered(what, i), of: CurveOf::Bound, points: points.collect() }
            })
        }));
        for (title, y, curves) in
            [("Smooth start of the reference", "outputs", outputs), ("Controls", "controls", controls)]
        {
            let (title, x, y) = (title.to_owned(), "time in s".to_owned(), y.to_owned());
            report.pictures.push(Picture { title, x, y, logarithmic: false, curves });
        }
    }

    /// Response of one of so many plants, with a control constant within communication steps unless they are too many.
    fn follow(&self, plant: &Uncertain, place: &Place, count: usize, unit: &Unit) -> Followed {
        let (loop_, H) = (self.of(plant, place), unit.step * plant.bandwidth);
        let is_sampled = H > 0.0 && FOLLOWED / H * count as f64 <= MOST_SAMPLES;
        let mut followed = if is_sampled { loop_.follow_sampled(H) } else { loop_.follow() };
        // What the outputs hardly show may move for longer: the control that holds them at their references.
        let Some(rest) = self.at_rest(plant, place) else { return followed };
        for ([low, high], &end) in followed.control.iter_mut().zip(rest.iter()) {
            (*low, *high) = (low.min(end), high.max(end));
        }
        followed.largest_part = followed.largest_part.max(self.part_at_rest(&rest).unwrap_or(0.0));
        followed
    }

    /// The controls with which the outputs stay at their references.
    fn at_rest(&self, plant: &Uncertain, place: &Place) -> Option<DVector<f64>> {
        let ([A, B], (n, m)) = (plant.at(place), plant.size());
        let mut whole = DMatrix::zeros(n + m, n + m);
        whole.view_mut((0, 0), (n, n)).copy_from(&A);
        whole.view_mut((0, n), (n, m)).copy_from(&B);
        whole.view_mut((n, 0), (m, n)).copy_from(&plant.C);
        let mut ends = DVector::zeros(n + m);
        self.channels.iter().enumerate().for_each(|(i, channel)| ends[n + i] = channel.reference);
        let rest = whole.lu().solve(&ends)?;
        Some(rest.rows(n, m).into_owned()).filter(|u| u.iter().all(|u| u.is_finite()))
    }

    /// The largest error of all levels that asks for controls which stay as they are.
    fn part_at_rest(&self, u: &DVector<f64>) -> Option<f64> {
        let asked = self.G.clone().lu().solve(u)?;
        // That of the last level, e/(1 − e²) = asked/g.
        let last = |(asked, channel): (&f64, &Channel)| {
            let v = (asked / channel.g).abs();
            if v == 0.0 { 0.0 } else { 2.0 * v / (1.0 + (1.0 + 4.0 * v * v).sqrt()) }
        };
        asked.iter().zip(&self.channels).map(last).reduce(f64::max)
    }

    /// The loop of a plant within the bounds.
    fn of(&self, plant: &Uncertain, place: &Place) -> Loop<'_> {
        let [A, B] = plant.at(place);
        Loop::new([&A, &B, &plant.C], self.degree, &self.G, &self.channels)
    }

    /// "follows within 0.55 of its funnel, 0.6 % left in the end, peak of voltage 5 of 24"
    fn words(&self, followed: &Followed, unit: &Unit) -> String {
        if !followed.stayed() {
            return "the error leaves its funnel".to_owned();
        }
        format!(
            "follows within {} of the funnel, {} % of the reference left in the end{}",
            digits(followed.largest_part),
            percent(100.0 * self.left(followed)),
            unit.peaks(&followed.control)
        )
    }

    /// The largest error in the end, in parts of the reference, if all channels have that part of their bounds.
    fn left(&self, followed: &Followed) -> f64 {
        let part = |channel: &Channel| channel.psi_inf / channel.reference;
        followed.left * self.channels.iter().map(part).fold(0.0, f64::max)
    }

    fn report_followed(&self, followed: &Followed, described: &Described, unit: &Unit, report: &mut DesignReport) {
        let W = described.plant.bandwidth;
        if !followed.stayed() {
            let note = "when the error leaves its funnel, for a reference that starts smoothly. Use a larger g, a shorter tau, or a shorter step";
            return report.judge("leaves the funnel", three_digits(followed.until / W), "s", Verdict::NotSound, note);
        }
        let note = format!(
            "of all levels, in parts of its bound, for a reference that starts smoothly (smooth_start_rate = {} 1/s)",
            digits(SMOOTH_START * W)
        );
        report.add("largest error", three_digits(followed.largest_part), "", &note);
        let note = format!("of the reference at most, after {} s", digits(FOLLOWED / W));
        report.add("error at the end", three_digits(100.0 * self.left(followed)), "%", &note);
        described.report_ranges(&followed.control, Verdict::Warning, unit, report);
    }
}

fn report_bounds(bounds: &Bounds, v: &Values<f64>, report: &mut DesignReport) {
    performance::report([bounds.start, bounds.end, bounds.decay_rate], v, report);
}

fn row(values: &[f64]) -> DMatrix<f64> {
    DMatrix::from_row_slice(1, values.len(), values)
}
