//! The outer loop of a quadrotor: from the trajectory of its position to its thrust and the angles that turn it.

use crate::system::{
    Declaration, Input, Parameter, Scalar, ScalarOf, Signal, Signals, Values, VectorOf, larger, scalar, vector,
};

/// Thrust, roll and pitch that give the body the acceleration p_d'' + k_v (p_d' − p') + k_p (p_d − p).
#[derive(Debug)]
pub(super) struct PositionLoop {
    m: ScalarOf<Parameter>,
    g: ScalarOf<Parameter>,
    position_gain: VectorOf<Parameter>,
    velocity_gain: VectorOf<Parameter>,
    lift_min: ScalarOf<Parameter>,
    tilt_max: ScalarOf<Parameter>,
    tilt_cosine_min: ScalarOf<Parameter>,
    /// Position in space, and yaw.
    pub r: VectorOf<Input>,
    pub dr: VectorOf<Input>,
    pub ddr: VectorOf<Input>,
    /// Roll, pitch and yaw that are wanted.
    pub angles: VectorOf<Signal>,
    /// Thrust that is wanted.
    pub thrust: ScalarOf<Signal>,
}

impl PositionLoop {
    pub fn declare(d: &mut Declaration) -> Self {
        let references =
            ["position in x", "position in y", "height", "yaw, psi"].map(|text| format!("reference of the {text}"));
        let references = references.each_ref().map(String::as_str);
        let of_position = |order: &str| [0, 1, 2].map(|i| format!("{order} time derivative of the {}", references[i]));
        let (first, second) = (of_position("first"), of_position("second"));
        let angles = ["phi, roll, that the position needs", "theta, pitch, that the position needs", "psi, yaw"];
        let angles = angles.map(|angle| format!("wanted {angle}"));
        PositionLoop {
            m: d.parameter(scalar("m", "nominal mass").unit("kg").start(0.5).positive()),
            g: d.parameter(scalar("g", "acceleration of gravity").unit("m/s2").start(9.81).positive()),
            position_gain: d
                .parameter(vector("position_gain", 3, "gain of the position's error").unit("1/s2").start(4.0).min(0.0)),
            velocity_gain: d
                .parameter(vector("velocity_gain", 3, "gain of the velocity's error").unit("1/s").start(4.0).min(0.0)),
            lift_min: d.parameter(
                scalar("lift_min", "smallest wanted vertical acceleration against gravity, as a part of g")
                    .start(0.3)
                    .positive(),
            ),
            tilt_max: d.parameter(
                scalar("tilt_max", "largest wanted roll and pitch").unit("rad").start(0.6).positive().max(1.5),
            ),
            tilt_cosine_min: d.parameter(
                scalar("tilt_cosine_min", "smallest cosine of the tilt for which the thrust makes up")
                    .start(0.3)
                    .positive()
                    .max(1.0),
            ),
            r: d.input(vector("r", 4, "").each(&references).units(&["m", "m", "m", "rad"])),
            dr: d.input(vector("dr", 3, "").each(&first.each_ref().map(String::as_str)).unit("m/s")),
            ddr: d.input(vector("ddr", 3, "").each(&second.each_ref().map(String::as_str)).unit("m/s2")),
            angles: d.output(
                vector("angle_reference", 3, "").each(&angles.each_ref().map(String::as_str)).unit("rad").nominal(0.1),
            ),
            thrust: d.local(scalar("thrust_reference", "wanted thrust").unit("N").nominal(5.0)),
        }
    }

    /// From the position, velocity and angles of the body.
    pub fn outputs<S: Scalar>(&self, [p, velocity, angles]: [[S; 3]; 3], v: &Values<S>, y: &mut Signals<S>) {
        let [phi, theta, psi] = angles;
        let [a_x, a_y, a_z]: [S; 3] = std::array::from_fn(|i| {
            let (position, rate) = (v[self.r][i] - p[i], v[self.dr][i] - velocity[i]);
            v[self.ddr][i] + v[self.velocity_gain][i] * rate + v[self.position_gain][i] * position
        });
        let g_z = larger(v[self.g] + a_z, v[self.lift_min] * v[self.g]);
        let limit = v[self.tilt_max];
        let tilt = |along: S| larger(-larger(-(along / g_z).atan(), -limit), -limit);
        let theta_d = tilt(a_x * psi.cos() + a_y * psi.sin());
        let phi_d = tilt(theta_d.cos() * (a_x * psi.sin() - a_y * psi.cos()));
        y.set(self.angles, [phi_d, theta_d, v[self.r][3]]);
        y[self.thrust] = v[self.m] * g_z / larger(phi.cos() * theta.cos(), v[self.tilt_cosine_min]);
    }
}
