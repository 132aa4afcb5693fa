//! Heated rooms: a model with a structure, units, a prepared value, an input, events and a counter.

use adaptive_fmu::system::*;
use serde::Deserialize;

/// How many rooms there are.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Building {
    rooms: usize,
}

/// Rooms in a row, each with a heater that a thermostat switches.
pub struct Rooms {
    temperature_0: VectorOf<Parameter>,
    heat_capacity: ScalarOf<Parameter>,
    heat_loss: ScalarOf<Parameter>,
    heat_exchange: ScalarOf<Parameter>,
    heater_power: ScalarOf<Parameter>,
    set_point: ScalarOf<Parameter>,
    hysteresis: ScalarOf<Parameter>,
    /// Where a heater is switched on, and off.
    band: VectorOf<Prepared>,
    outside: ScalarOf<Input>,
    temperature: VectorOf<State>,
    heating: VectorOf<Discrete>,
    switchings: IntegerOf<Discrete>,
    power: ScalarOf<Signal>,
}

impl System for Rooms {
    type Structure = Building;
    const NAME: &'static str = "rooms";
    const DOCUMENTATION: &'static str = r"Rooms in a row,
$C \dot T_i = P h_i - G (T_i - T_{out}) + W (T_{i-1} - T_i) + W (T_{i+1} - T_i)$, without the last terms at the ends.
A thermostat switches the heater $h_i$ of each room on where $T_i$ falls below the set point by the hysteresis, and off
where it rises above it by as much.";

    fn declare(Building { rooms }: Building, d: &mut Declaration) -> Result<Self, Invalid> {
        if !(1..=100).contains(&rooms) {
            return Err(Invalid::new("rooms", rooms, "must be within 1 … 100"));
        }
        let initial = vector("temperature_0", rooms, "initial temperature").unit("K").start(288.15);
        let band = vector("band", 2, "").each(&["heaters are switched on below", "heaters are switched off above"]);
        // Each room has two: where its temperature is above either end of its band.
        d.indicators((1..=rooms).flat_map(|i| ["cold", "warm"].map(|end| format!("{end} end of room {i}'s band"))));
        Ok(Rooms {
            temperature_0: d.parameter(initial.nominal(300.0).fixed()),
            heat_capacity: d.parameter(scalar("heat_capacity", "of a room").unit("J/K").start(3e5).positive()),
            heat_loss: d.parameter(scalar("heat_loss", "conductance to the outside").unit("W/K").start(40.0).min(0.0)),
            heat_exchange: d.parameter(
                scalar("heat_exchange", "conductance of a wall between rooms").unit("W/K").start(20.0).min(0.0),
            ),
            heater_power: d.parameter(scalar("heater_power", "of a room").unit("W").start(1500.0).min(0.0)),
            set_point: d.parameter(scalar("set_point", "wanted temperature").unit("K").start(293.15).nominal(300.0)),
            hysteresis: d.parameter(
                scalar("hysteresis", "deviation at which a heater is switched").unit("K").start(0.5).positive(),
            ),
            band: d.prepared(band.unit("K").nominal(300.0)),
            outside: d.input(scalar("outside", "temperature outside").unit("K").start(273.15).nominal(300.0)),
            temperature: d.state(vector("temperature", rooms, "temperature").unit("K").nominal(300.0).output()),
            heating: d.discrete(vector("heating", rooms, "1 while the heater is on").output()),
            switchings: d.discrete(integer("switchings", "how often a heater was switched").output()),
            power: d.output(scalar("power", "of all heaters").unit("W")),
        })
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        v.require_below(self.hysteresis, self.set_point);
        let (set_point, hysteresis) = (v[self.set_point], v[self.hysteresis]);
        v.set(self.band, [set_point - hysteresis, set_point + hysteresis]);
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.copy(self.temperature_0, self.temperature);
        for i in 0..self.temperature.len() {
            v[self.heating.at(i)] = self.wanted(i, v);
        }
    }

    fn parameters_changed<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        let [on, off] = v.array(self.band);
        for i in 0..self.temperature.len() {
            let temperature = v[self.temperature.at(i)];
            v.when(temperature.below(on) | temperature.above(off), |v| self.switch(i, v));
        }
    }

    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        let on = v[self.heating].iter().fold(S::from(0.0), |sum, &heating| sum + heating);
        y[self.power] = on * v[self.heater_power];
    }

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let temperature = &v[self.temperature];
        for (i, &own) in temperature.iter().enumerate() {
            let mut heat = v[self.heating][i] * v[self.heater_power] + v[self.heat_loss] * (v[self.outside] - own);
            let before = i.checked_sub(1).map(|before| temperature[before]);
            for &neighbour in before.iter().chain(temperature.get(i + 1)) {
                heat += v[self.heat_exchange] * (neighbour - own);
            }
            dx[self.temperature.at(i)] = heat / v[self.heat_capacity];
        }
    }

    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        let [on, off] = v.array(self.band);
        for (i, &temperature) in v[self.temperature].iter().enumerate() {
            (z[2 * i], z[2 * i + 1]) = (temperature - on, temperature - off);
        }
    }

    fn event<S: Scalar>(&self, _t: S, crossed: &[S::Flag], v: &mut Point<S>) {
        for i in 0..self.temperature.len() {
            v.when(crossed[2 * i] | crossed[2 * i + 1], |v| self.switch(i, v));
        }
    }
}

impl Rooms {
    /// What a thermostat wants at an end of its band: 1 on the cold side of the set point, else 0.
    fn wanted<S: Scalar>(&self, i: usize, v: &Point<S>) -> S {
        S::from_flag(v[self.temperature.at(i)].below(v[self.set_point]))
    }

    fn switch<S: Scalar>(&self, i: usize, v: &mut Point<S>) {
        let wanted = self.wanted(i, v);
        v.when(!v[self.heating.at(i)].equals(wanted), |v| {
            v[self.heating.at(i)] = wanted;
            let switchings = S::from_integer(v.get(self.switchings)) + 1.0;
            v.put(self.switchings, switchings.to_integer());
        });
    }
}
