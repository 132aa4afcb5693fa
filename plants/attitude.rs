//! Attitude of a body by roll φ, pitch θ and yaw ψ: it is turned by ψ about z, then by θ about its y, then by φ about
//! its x.

use crate::system::{Invalid, Parameter, Point, Scalar, ScalarOf};

/// Smallest cosine of the pitch at which the three angles distinguish roll from yaw.
const SMALLEST_COSINE: f64 = 1e-8;

/// Sines and cosines of the three angles.
#[derive(Debug)]
pub(super) struct Attitude<S> {
    sin: [S; 3],
    cos: [S; 3],
}

impl<S: Scalar> Attitude<S> {
    /// Sines and cosines of φ, θ and ψ.
    pub fn new(angles: [S; 3]) -> Self {
        Attitude { sin: angles.map(|angle| angle.sin()), cos: angles.map(|angle| angle.cos()) }
    }

    /// The body's x, y and z axis in earth axes: the columns of the rotation matrix R.
    pub fn axes(&self) -> [[S; 3]; 3] {
        let ([s_phi, s_theta, s_psi], [c_phi, c_theta, c_psi]) = (self.sin, self.cos);
        [
            [c_theta * c_psi, c_theta * s_psi, -s_theta],
            [s_phi * s_theta * c_psi - c_phi * s_psi, s_phi * s_theta * s_psi + c_phi * c_psi, s_phi * c_theta],
            [c_phi * s_theta * c_psi + s_phi * s_psi, c_phi * s_theta * s_psi - s_phi * c_psi, c_phi * c_theta],
        ]
    }

    /// R v: a vector in earth axes.
    pub fn to_earth(&self, [a, b, c]: [S; 3]) -> [S; 3] {
        let [x, y, z] = self.axes();
        std::array::from_fn(|i| x[i] * a + y[i] * b + z[i] * c)
    }

    /// Rᵀ v: a vector in body axes.
    pub fn to_body(&self, [a, b, c]: [S; 3]) -> [S; 3] {
        self.axes().map(|[x, y, z]| x * a + y * b + z * c)
    }

    /// W η': the body's rates from those of the angles.
    pub fn body_rates(&self, [d_phi, d_theta, d_psi]: [S; 3]) -> [S; 3] {
        let ([s_phi, s_theta, _], [c_phi, c_theta, _]) = (self.sin, self.cos);
        [d_phi - d_psi * s_theta, d_theta * c_phi + d_psi * c_theta * s_phi, -d_theta * s_phi + d_psi * c_theta * c_phi]
    }

    /// W' η': how fast the body's rates change while those of the angles stay.
    pub fn body_rate_drift(&self, [d_phi, d_theta, d_psi]: [S; 3]) -> [S; 3] {
        let ([s_phi, s_theta, _], [c_phi, c_theta, _]) = (self.sin, self.cos);
        [
            -d_psi * d_theta * c_theta,
            -d_theta * d_phi * s_phi + d_psi * (d_phi * c_theta * c_phi - d_theta * s_theta * s_phi),
            -d_theta * d_phi * c_phi - d_psi * (d_phi * c_theta * s_phi + d_theta * s_theta * c_phi),
        ]
    }

    /// W⁻¹ ω: the angles' rates from those of the body. No numbers where cos θ is not above zero.
    pub fn angle_rates(&self, [p, q, r]: [S; 3]) -> [S; 3] {
        let ([s_phi, s_theta, _], [c_phi, ..]) = (self.sin, self.cos);
        let d_psi = (s_phi * q + c_phi * r) * self.secant();
        [p + s_theta * d_psi, c_phi * q - s_phi * r, d_psi]
    }

    /// W⁻ᵀ τ: the moments about the body's axes that do the work of moments along the angles. No numbers where cos θ is
    /// not above zero.
    pub fn body_moments(&self, [along_phi, along_theta, along_psi]: [S; 3]) -> [S; 3] {
        let ([s_phi, s_theta, _], [c_phi, ..]) = (self.sin, self.cos);
        let tilted = (s_theta * along_phi + along_psi) * self.secant();
        [along_phi, c_phi * along_theta + s_phi * tilted, c_phi * tilted - s_phi * along_theta]
    }

    /// 1/cos θ; no number from where on the angles describe no attitude.
    fn secant(&self) -> S {
        let cos = self.cos[1];
        S::branch(cos.above(S::from(SMALLEST_COSINE)), || cos.recip(), || S::from(f64::NAN))
    }
}

/// Refuses an initial pitch at or beyond which roll and yaw can't be distinguished, if the angles' rates matter.
pub(super) fn require_regular<S: Scalar>(pitch: ScalarOf<Parameter>, matters: S::Flag, v: &mut Point<S>) {
    let theta = v[pitch];
    v.refuse(matters & !theta.cos().above(S::from(SMALLEST_COSINE)), |v| {
        let allowed = "must have a cosine above 0: the Euler angles are singular at a pitch of 90 degrees";
        Invalid::new(v.name(pitch), theta.to_text(), allowed)
    });
}
