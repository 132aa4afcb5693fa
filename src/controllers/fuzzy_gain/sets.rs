//! The output sets of the inference, by their corners.
#![allow(non_snake_case)] // sets have the names of the thesis

use super::numbers::{Channels, Held, Limits, Number, NumberUnit, Sharing};
use crate::mathematics::fuzzy::{SETS, Triangle};
use crate::system::{Declaration, Invalid, Parameter, Point, Scalar, ScalarOf, Values};

/// The least width of `zero` where channels have something of their own, as searches of their corners keep it.
const LEAST_WIDTH: f64 = 0.01;

/// The corners of the output sets, of which neighbours share some.
#[derive(Debug)]
pub struct Sets {
    VL_c: ScalarOf<Parameter>,
    VL_l: ScalarOf<Parameter>,
    L_l: ScalarOf<Parameter>,
    L_c: ScalarOf<Parameter>,
    L_h: ScalarOf<Parameter>,
    S_l: ScalarOf<Parameter>,
    S_c: ScalarOf<Parameter>,
    VS_l: ScalarOf<Parameter>,
    VS_c: ScalarOf<Parameter>,
    /// None where any width will do.
    least_width: Option<f64>,
}

impl Sets {
    /// Those of each channel, or the one that all have. Each corner starts in the middle of its bounds.
    pub fn declare(sharing: Sharing, channels: Channels, d: &mut Declaration) -> Vec<Self> {
        let mut corner = |name: &str, text: &str, min: f64, max: f64| {
            let text = format!("output set {text}");
            let limits = Limits::Within(min, max);
            let number = Number { name, text: &text, unit: NumberUnit::Is("1"), start: 0.5 * (min + max), limits };
            number.declare(sharing.sets, channels, d)
        };
        let corners = [
            corner("VL_c", "`very large`: centre and upper end", 8.0, 12.0),
            corner("VL_l", "`very large`: lower end, and upper end of `small`", 4.0, 8.0),
            corner("L_l", "`large`: lower end, and upper end of `very small`", 1.5, 3.0),
            corner("L_c", "`large`: centre", 3.0, 6.0),
            corner("L_h", "`large`: upper end", 6.0, 10.0),
            corner("S_l", "`small`: lower end, and upper end of `zero`", 0.3, 1.5),
            corner("S_c", "`small`: centre", 1.5, 4.0),
            corner("VS_l", "`very small`: lower end, and lower end and centre of `zero`", 0.0, 0.5),
            corner("VS_c", "`very small`: centre", 0.5, 1.5),
        ];
        let least_width = (sharing != Sharing::default()).then_some(LEAST_WIDTH);
        let of = |i: usize| {
            let [VL_c, VL_l, L_l, L_c, L_h, S_l, S_c, VS_l, VS_c] = corners.each_ref().map(|all| all[i]);
            Sets { VL_c, VL_l, L_l, L_c, L_h, S_l, S_c, VS_l, VS_c, least_width }
        };
        (0..if sharing.sets == Held::Own { channels.count() } else { 1 }).map(of).collect()
    }

    /// Each set has a width; by the bounds of single corners the others are in order.
    pub fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        match self.least_width {
            None => v.require_below(self.VS_l, self.S_l),
            Some(width) => {
                let is_narrow = !v[self.VS_l].at_most(v[self.S_l] - width);
                v.refuse(is_narrow, |v| {
                    let [S_l, most] = [v[self.S_l].to_text(), (v[self.S_l] - width).to_text()];
                    let allowed = format!("must be at most {most}, {width} below {} = {S_l}", v.name(self.S_l));
                    Invalid::new(v.name(self.VS_l), v[self.VS_l].to_text(), allowed)
                });
            }
        }
        v.require_below(self.VL_l, self.VL_c);
    }

    /// Zero, very small, small, large, very large.
    pub fn triangles<S: Scalar>(&self, v: &Values<S>) -> [Triangle<S>; SETS] {
        let Sets { VL_c, VL_l, L_l, L_c, L_h, S_l, S_c, VS_l, VS_c, .. } = self;
        [(VS_l, VS_l, S_l), (VS_l, VS_c, L_l), (S_l, S_c, VL_l), (L_l, L_c, L_h), (VL_l, VL_c, VL_c)]
            .map(|(&low, &centre, &high)| Triangle { low: v[low], centre: v[centre], high: v[high] })
    }
}
