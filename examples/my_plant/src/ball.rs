//! A ball on a floor: a contact that turns a motion back, and a mode in which it has come to rest.

use adaptive_fmu::system::*;

/// A ball that falls, bounces and comes to rest.
pub struct Ball {
    height_0: ScalarOf<Parameter>,
    gravity: ScalarOf<Parameter>,
    restitution: ScalarOf<Parameter>,
    rest_speed: ScalarOf<Parameter>,
    height: ScalarOf<State>,
    speed: ScalarOf<State>,
    rests: BooleanOf<Discrete>,
    bounces: IntegerOf<Discrete>,
}

impl System for Ball {
    type Structure = NoStructure;
    const NAME: &'static str = "ball";
    const DOCUMENTATION: &'static str = r"A ball, $\ddot h = -g$, that bounces from a floor at $h = 0$ with the part
$\varepsilon$ of its speed. Bounces follow each other ever faster, infinitely many until
$\sqrt{2 h_0 / g}\,(1 + \varepsilon) / (1 - \varepsilon)$ after it fell from $h_0$. So it comes to rest at the bounce
behind which its speed is at most `rest_speed`.";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let restitution = scalar("restitution", "part of the speed that a bounce leaves").start(0.7).min(0.0).max(0.99);
        let rest_speed =
            scalar("rest_speed", "the ball rests when a bounce leaves no more speed").unit("m/s").start(1e-3);
        d.indicators(["height above the floor"]);
        Ok(Ball {
            height_0: d.parameter(scalar("height_0", "initial height").unit("m").start(1.0).positive().fixed()),
            gravity: d.parameter(scalar("gravity", "acceleration of gravity").unit("m/s2").start(9.81).positive()),
            restitution: d.parameter(restitution),
            rest_speed: d.parameter(rest_speed.positive()),
            height: d.state(scalar("height", "height above the floor").unit("m").output()),
            speed: d.state(scalar("speed", "upward speed").unit("m/s").output()),
            rests: d.discrete(boolean("rests", "whether the ball has come to rest").output()),
            bounces: d.discrete(integer("bounces", "number of bounces").output()),
        })
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v[self.height] = v[self.height_0];
    }

    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let rests = v.get(self.rests);
        dx[self.height] = S::select(rests, S::from(0.0), v[self.speed]);
        dx[self.speed] = S::select(rests, S::from(0.0), -v[self.gravity]);
    }

    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        z[0] = v[self.height];
    }

    fn event<S: Scalar>(&self, _t: S, crossed: &[S::Flag], v: &mut Point<S>) {
        v.when(crossed[0] & !v.get(self.rests), |v| {
            let speed = -v[self.restitution] * v[self.speed];
            let rests = speed.at_most(v[self.rest_speed]);
            v[self.height] = S::from(0.0);
            v[self.speed] = S::select(rests, S::from(0.0), speed);
            v.put(self.rests, rests);
            let bounces = S::from_integer(v.get(self.bounces)) + 1.0;
            v.put(self.bounces, bounces.to_integer());
        });
    }
}
