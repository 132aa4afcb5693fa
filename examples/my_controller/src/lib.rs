//! A controller of one's own, the least that is one: model reference adaptive control (MRAC) of a motor's speed.
//!
//! To make one of yours from it, change the names, the parameters and the equations below, then build, export and run it as
//! docs/own_controller.md shows. Derivatives, both interfaces of FMI and C source follow from the equations.

use adaptive_fmu::system::*;

/// The variables of the controller, as handles: values live outside.
pub struct SpeedController {
    // Set before the run, or while it runs.
    bandwidth: ScalarOf<Parameter>,
    adaptation_gain: ScalarOf<Parameter>,
    // Set once, before the run.
    initial_gains: VectorOf<Parameter>,
    // From other FMUs.
    speed_reference: ScalarOf<Input>,
    speed: ScalarOf<Input>,
    // Integrated.
    model_speed: ScalarOf<State>,
    gains: VectorOf<State>,
    // To other FMUs.
    voltage: ScalarOf<Signal>,
}

impl System for SpeedController {
    /// Sizes and options of the model, read from its description; this one has none.
    type Structure = NoStructure;
    /// The name in descriptions: `model = "speed-controller"`.
    const NAME: &'static str = "speed-controller";
    /// The page in the FMU.
    const DOCUMENTATION: &'static str = r"The speed $y$ of a motor $\dot y = -a y + b u$, $b > 0$, whose $a$ and $b$ are unknown, follows the
reference model $\dot y_m = a_m (r - y_m)$ by the voltage $u = k_r r + k_y y$. The gains adapt to the error $e = y - y_m$:
$\dot k_r = -\Gamma e r$, $\dot k_y = -\Gamma e y$. Then $e^2/2 + b |k - k^*|^2/(2 \Gamma)$ falls at the rate $a_m e^2$, so the
error goes to zero. Neither limits of the voltage nor disturbances are taken care of.";

    /// Declares each variable once: name, description, unit, start value, limits.
    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let adaptation_gain = scalar("adaptation_gain", "Gamma: larger is faster").unit("V.s2/rad3").start(1e-5);
        let bandwidth = scalar("bandwidth", "a_m of the reference model").unit("rad/s").start(5.0).positive();
        let of_gains = ["k_r, of the reference", "k_y, of the speed"];
        Ok(SpeedController {
            bandwidth: d.parameter(bandwidth),
            adaptation_gain: d.parameter(adaptation_gain.min(0.0)),
            initial_gains: d.parameter(vector("initial_gains", 2, "").each(&of_gains).unit("V.s/rad").fixed()),
            speed_reference: d.input(scalar("speed_reference", "r").unit("rad/s")),
            speed: d.input(scalar("speed", "y, measured").unit("rad/s")),
            model_speed: d.state(scalar("model_speed", "y_m, as the motor should move").unit("rad/s").output()),
            gains: d.state(vector("gains", 2, "").each(&of_gains).unit("V.s/rad").output()),
            voltage: d.output(scalar("voltage", "u").unit("V")),
        })
    }

    /// Sets the states at the start.
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.copy(self.initial_gains, self.gains);
        v[self.model_speed] = v[self.speed];
    }

    /// The control law.
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        let [k_r, k_y] = v.array(self.gains);
        y[self.voltage] = k_r * v[self.speed_reference] + k_y * v[self.speed];
    }

    /// The reference model, and the adaptation.
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let (r, y, y_m) = (v[self.speed_reference], v[self.speed], v[self.model_speed]);
        dx[self.model_speed] = v[self.bandwidth] * (r - y_m);
        let rate = -v[self.adaptation_gain] * (y - y_m);
        dx.set(self.gains, [rate * r, rate * y]);
    }
}

adaptive_fmu::export_fmi2![SpeedController];
