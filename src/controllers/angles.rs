//! Channels that are angles: values that differ by whole turns are the same to a controller.

use std::f64::consts::TAU;

use crate::mathematics::angle;
use crate::system::{Declaration, Discrete, Input, Invalid, Number, Point, Scalar, Values, VectorOf, Warning, vector};

/// The only unit of angles.
pub(super) const UNIT: &str = "rad";
/// Distance of a jump from a whole turn, rad, within which it is taken for one.
const NEAR_A_TURN: f64 = 0.5;

/// The channels that a description names as angles.
#[derive(Debug, Default, Clone)]
pub(super) struct Angles {
    is_angle: Vec<bool>,
}

impl Angles {
    /// Those of the key `angles`, counted from 1, of a signal that has these units.
    ///
    /// # Errors
    /// A channel that there isn't, is named twice, or has another unit than rad.
    pub fn of(named: &[usize], signal: &str, units: &[&'static str]) -> Result<Self, Invalid> {
        let mut is_angle = vec![false; units.len()];
        for &channel in named {
            let Some(i) = channel.checked_sub(1).filter(|&i| i < units.len()) else {
                return Err(Invalid::new("angles", channel, format!("must be within 1 … {}", units.len())));
            };
            if units[i] != UNIT {
                let allowed =
                    format!("must be an element with the unit {UNIT}; {signal}[{channel}] has `{}`", units[i]);
                return Err(Invalid::new("angles", channel, allowed));
            }
            if std::mem::replace(&mut is_angle[i], true) {
                return Err(Invalid::new("angles", channel, "must be there once"));
            }
        }
        Ok(Angles { is_angle })
    }

    /// These of so many channels.
    pub fn at(channels: impl Iterator<Item = usize>, many: usize) -> Self {
        let mut is_angle = vec![false; many];
        channels.for_each(|channel| is_angle[channel] = true);
        Angles { is_angle }
    }

    /// True if a channel is an angle.
    pub fn has(&self, channel: usize) -> bool {
        self.is_angle.get(channel).copied().unwrap_or(false)
    }

    /// The channels that are angles.
    pub fn each(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.is_angle.len()).filter(|&i| self.is_angle[i])
    }

    /// A difference of two values of a channel: of angles, the one within half a turn.
    pub fn difference<S: Scalar>(&self, channel: usize, difference: S) -> S {
        if self.has(channel) { difference.wrap() } else { difference }
    }

    /// A value of a channel: of an angle, the one nearest to another value.
    pub fn nearest<S: Scalar>(&self, channel: usize, value: S, to: S) -> S {
        if self.has(channel) { angle::nearest(value, to) } else { value }
    }
}

/// A watch on measured signals in rad that aren't known as angles: a jump by a whole turn is the seam of an angle that wraps.
#[derive(Debug)]
pub(super) struct Jumps {
    measured: VectorOf<Input>,
    /// Elements of the measured signal that are watched.
    watched: Vec<usize>,
    /// Their values at the last look.
    last: VectorOf<Discrete>,
    seen: Warning,
}

impl Jumps {
    /// The watch on a measured signal with these units; none where nothing is to be watched.
    pub fn declare(
        d: &mut Declaration,
        measured: VectorOf<Input>,
        units: &[&'static str],
        known: &Angles,
    ) -> Option<Self> {
        let watched: Vec<_> = (0..units.len()).filter(|&i| units[i] == UNIT && !known.has(i)).collect();
        (!watched.is_empty()).then(|| Jumps {
            last: d.discrete(vector("#last angles", watched.len(), "").hidden()),
            seen: d.warning("logAngleJump", "a measured angle that jumps by a whole turn and isn't declared in angles"),
            measured,
            watched,
        })
    }

    /// Begins to watch.
    pub fn begin<S: Scalar>(&self, v: &mut Point<S>) {
        for (k, &i) in self.watched.iter().enumerate() {
            v[self.last][k] = v[self.measured][i];
        }
    }

    /// Warns of a jump since the last look.
    pub fn look<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        for (k, &i) in self.watched.iter().enumerate() {
            let (before, now) = (v[self.last][k], v[self.measured][i]);
            v[self.last][k] = now;
            let jumps = ((now - before).abs() - TAU).abs().at_most(S::from(NEAR_A_TURN));
            v.when(jumps, |v| {
                v.warn(self.seen, |v| {
                    format!(
                        "{} has jumped from {} rad to {} rad by t = {} s, which is about a whole turn. The controller takes that for \
                         a motion. If it is an angle that wraps, declare it in angles of the description",
                        v.name(self.measured.at(i)),
                        before.rounded(),
                        now.rounded(),
                        t.to_text()
                    )
                });
            });
        }
    }
}

/// Refuses a bound of an error that is no bound of an angle: half a turn away an error has no sign.
pub(super) fn require_below_half_a_turn<S: Scalar>(
    bound: S,
    name: impl FnOnce(&Values<S>) -> String,
    v: &mut Point<S>,
) {
    let half = std::f64::consts::PI;
    v.refuse(bound.at_least(S::from(half)), |v| {
        let allowed = format!("must be below {} rad, half a turn: the error is that of an angle", Number(half));
        Invalid::new(name(v), bound.to_text(), allowed)
    });
}

#[cfg(test)]
mod tests {
    use super::Angles;

    #[test]
    fn only_channels_in_rad_are_angles() {
        let units = ["rad", "m", "rad"];
        let angles = Angles::of(&[3], "y", &units).unwrap();
        assert_eq!(angles.each().collect::<Vec<_>>(), [2]);
        assert_eq!([angles.difference(2, 6.0), angles.difference(0, 6.0)], [6.0 - std::f64::consts::TAU, 6.0]);
        for (named, part) in [
            (&[0][..], "angles = 0: must be within 1 … 3"),
            (&[4], "angles = 4: must be within 1 … 3"),
            (&[2], "angles = 2: must be an element with the unit rad; y[2] has `m`"),
            (&[1, 1], "angles = 1: must be there once"),
        ] {
            let error = Angles::of(named, "y", &units).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }
}
