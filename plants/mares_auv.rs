//! MARES, an autonomous underwater vehicle: example 3.3.3.
#![allow(non_snake_case)] // matrices have the names of their source

use nalgebra::DMatrixView;

use super::attitude::{Attitude, require_regular};
use crate::catalogue::Catalogued;
use crate::pages::{self, Page};
use crate::system::{
    Declaration, Input, Invalid, MatrixOf, Naming, NoStructure, Parameter, Point, Prepared, Rates, Scalar, ScalarOf,
    Signal, Signals, Spec, State, System, Values, VectorOf, matrix, scalar, vector,
};

/// From this ratio of length to diameter on, Lamb's formulas are not a difference of nearly equal numbers.
const SMALLEST_FINENESS: f64 = 1.001;
/// Place of the initial pitch angle.
const PITCH: usize = 4;

/// M ν_r' + C(ν_r) ν_r + D(ν_r) ν_r + g(η) = J(η)ᵀ u, η' = J(η) ν; ν_r is ν relative to the water, which moves evenly.
#[derive(Debug)]
pub struct MaresAuv {
    x0: VectorOf<Parameter>,
    /// Velocity of the water in earth axes.
    current: VectorOf<Parameter>,
    hull: Hull,
    u: VectorOf<Input>,
    eta: VectorOf<State>,
    nu: VectorOf<State>,
    y: VectorOf<Signal>,
    x: VectorOf<Signal>,
}

/// The vehicle as a body of revolution, and what follows from its measures.
#[derive(Debug)]
struct Hull {
    length: ScalarOf<Parameter>,
    diameter: ScalarOf<Parameter>,
    m: ScalarOf<Parameter>,
    z_g: ScalarOf<Parameter>,
    rho: ScalarOf<Parameter>,
    g: ScalarOf<Parameter>,
    roll_added_inertia: ScalarOf<Parameter>,
    linear_damping: VectorOf<Parameter>,
    axial_drag: ScalarOf<Parameter>,
    cross_flow_drag: ScalarOf<Parameter>,
    roll_damping: ScalarOf<Parameter>,
    inertia: VectorOf<Prepared>,
    added_mass: VectorOf<Prepared>,
    quadratic_damping: VectorOf<Prepared>,
    M: MatrixOf<Prepared>,
    inverse: MatrixOf<Prepared>,
}

impl System for MaresAuv {
    type Structure = NoStructure;
    const NAME: &'static str = "mares-auv";
    const DOCUMENTATION: &'static str = pages::MARES_AUV.text;

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let pose = ["position north", "position east", "depth", "phi, roll", "theta, pitch", "psi, yaw"];
        let motion = ["surge velocity", "sway velocity", "heave velocity", "roll rate", "pitch rate", "yaw rate"];
        let rates = pose.map(|text| format!("rate of {text}"));
        let state: Vec<_> = pose.into_iter().chain(rates.iter().map(String::as_str)).collect();
        let initial: Vec<_> = state.iter().map(|text| format!("initial {text}")).collect();
        let initial: Vec<_> = initial.iter().map(String::as_str).collect();
        let tracked = pose.map(|text| format!("tracked output, {text}"));
        let forces = ["force north", "force east", "force down", "moment of phi", "moment of theta", "moment of psi"];
        let currents = ["north", "east", "down"].map(|axis| format!("velocity of the water, {axis}"));
        let units = ["m", "rad", "m/s", "rad/s"].map(|unit| [unit; 3]).concat();
        let nominals = [[1.0; 3], [0.1; 3], [0.1; 3], [0.1; 3]].concat();
        let state_like = |name: &str, first: usize, last: usize, texts: &[&str]| {
            vector(name, last - first, "").each(texts).units(&units[first..last]).nominals(&nominals[first..last])
        };
        Ok(MaresAuv {
            x0: d.parameter(state_like("x0", 0, 12, &initial).fixed()),
            current: d.parameter(vector("current", 3, "").each(&texts(&currents)).unit("m/s")),
            hull: Hull::declare(d),
            u: d.input(
                vector("u", 6, "")
                    .each(&forces)
                    .units(&["N", "N", "N", "N.m", "N.m", "N.m"])
                    .nominals(&[10.0, 10.0, 10.0, 1.0, 1.0, 1.0]),
            ),
            eta: d.state(state_like("eta", 0, 6, &pose)),
            nu: d.state(state_like("nu", 6, 12, &motion).source("Fossen (1994), in the frame of the vehicle")),
            y: d.output(state_like("y", 0, 6, &texts(&tracked))),
            x: d.output(state_like("x", 0, 12, &state)),
        })
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        self.hull.relate(v);
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        let [pose, angles, velocity, rates] = thirds(&v[self.x0]);
        require_regular(self.x0.at(PITCH), true.into(), v);
        let attitude = Attitude::new(angles);
        v.set(self.eta, [pose, angles].as_flattened());
        v.set(self.nu, [attitude.to_body(velocity), attitude.body_rates(rates)].as_flattened());
    }

    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        let [position, angles] = thirds(&v[self.eta]);
        let [nu1, nu2] = thirds(&v[self.nu]);
        let attitude = Attitude::new(angles);
        y.set(self.y, [position, angles].as_flattened());
        y.set(self.x, [position, angles, attitude.to_earth(nu1), attitude.angle_rates(nu2)].as_flattened());
    }

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let [_, angles] = thirds(&v[self.eta]);
        let attitude = Attitude::new(angles);
        let [force, moment] = thirds(&v[self.u]);
        let nu: [S; 6] = v.array(self.nu);
        let current = attitude.to_body(v.array(self.current));
        let [_, turning] = thirds(&nu);
        // The velocity relative to the water; the water's own changes in body axes as these turn.
        let relative: [S; 6] = std::array::from_fn(|i| if i < 3 { nu[i] - current[i] } else { nu[i] });
        let turned = cross(current, turning);
        let acting = [attitude.to_body(force), attitude.body_moments(moment)];
        let (coriolis, damping) = (self.hull.coriolis(relative, v), self.hull.damping(relative, v));
        let restoring = self.hull.restoring(&attitude, v);
        let total = std::array::from_fn(|i| acting.as_flattened()[i] - coriolis[i] - damping[i] - restoring[i]);
        let by_forces = times(v.matrix(self.hull.inverse), total);
        dx.set(
            self.nu,
            std::array::from_fn::<_, 6, _>(|i| if i < 3 { by_forces[i] + turned[i] } else { by_forces[i] }),
        );
        // η' = J(η) ν is the second half of x.
        dx.set(self.eta, &v[self.x][6..]);
    }
}

impl Hull {
    fn declare(d: &mut Declaration) -> Self {
        let mut number = |name: &str, text: &str, unit, start| d.parameter(positive(name, text, unit, start));
        let (length, diameter) = (
            number("length", "length of the hull, a prolate spheroid", "m", 1.5),
            number("diameter", "diameter of the hull", "m", 0.2),
        );
        let (m, rho) = (number("m", "mass", "kg", 32.0), number("rho", "density of the water", "kg/m3", 1025.0));
        let g = number("g", "acceleration of gravity", "m/s2", 9.81);
        let roll_added_inertia = "added moment of inertia of roll, as a part of the body's own";
        let axial_drag = "drag coefficient along the hull, on its frontal area";
        let cross_flow_drag = "drag coefficient across the hull, on length times diameter";
        let axes = ["surge", "sway", "heave", "roll", "pitch", "yaw"];
        let each = |text: &str| axes.map(|axis| format!("{text} of {axis}"));
        let (linear, quadratic, added) =
            (each("linear damping"), each("quadratic damping"), each("added mass or moment of inertia"));
        let inertia = ["x", "y", "z"].map(|axis| format!("moment of inertia about the body's {axis} axis"));
        let of_parts = |unit, other| [unit, unit, unit, other, other, other];
        let M_units = std::array::from_fn::<_, 36, _>(|k| match (k % 6 < 3, k / 6 < 3) {
            (true, true) => "kg",
            (false, false) => "kg.m2",
            _ => "kg.m",
        });
        let M = "inertia matrix in body axes, with added mass";
        Hull {
            length,
            diameter,
            m,
            z_g: d.parameter(
                scalar("z_g", "how far the mass centre lies below the centre of buoyancy").unit("m").start(0.0044),
            ),
            rho,
            g,
            roll_added_inertia: d.parameter(scalar("roll_added_inertia", roll_added_inertia).start(0.05).min(0.0)),
            linear_damping: d.parameter(
                vector("linear_damping", 6, "")
                    .each(&texts(&linear))
                    .units(&of_parts("N.s/m", "N.m.s/rad"))
                    .starts(&[1.0, 5.0, 5.0, 0.2, 1.0, 1.0])
                    .min(0.0),
            ),
            axial_drag: d.parameter(scalar("axial_drag", axial_drag).start(0.2).min(0.0)),
            cross_flow_drag: d.parameter(scalar("cross_flow_drag", cross_flow_drag).start(1.1).min(0.0)),
            roll_damping: d
                .parameter(scalar("roll_damping", "quadratic damping of roll").unit("N.m.s2/rad2").start(0.1).min(0.0)),
            inertia: d.prepared(vector("inertia", 3, "").each(&texts(&inertia)).unit("kg.m2")),
            added_mass: d.prepared(vector("added_mass", 6, "").each(&texts(&added)).units(&of_parts("kg", "kg.m2"))),
            quadratic_damping: d.prepared(
                vector("quadratic_damping", 6, "").each(&texts(&quadratic)).units(&of_parts("kg/m", "N.m.s2/rad2")),
            ),
            M: d.prepared(matrix("M", 6, 6, M).units(&M_units)),
            inverse: d.prepared(matrix("#inverse of M", 6, 6, "").hidden()),
        }
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        let (length, diameter, m) = (v[self.length], v[self.diameter], v[self.m]);
        let is_long = length.at_least(diameter * SMALLEST_FINENESS);
        v.refuse(!is_long, |v| {
            let allowed = format!("must be at least {SMALLEST_FINENESS} times the diameter, {} m", diameter.to_text());
            Invalid::new(v.name(self.length), length.to_text(), allowed)
        });
        let (a, b) = (length * 0.5, diameter * 0.5);
        let lateral = m * 0.2 * (a * a + b * b);
        let inertia = [m * 0.4 * b * b, lateral, lateral];
        let none = || [S::from(0.0); 3];
        let [along, across, turning] = S::branch(is_long, || lamb(a, b, v[self.rho]), none);
        let added_mass = [along, across, across, v[self.roll_added_inertia] * inertia[0], turning, turning];
        let frontal = v[self.rho] * 0.5 * v[self.axial_drag] * std::f64::consts::PI * b * b;
        let broadside = v[self.rho] * 0.5 * v[self.cross_flow_drag] * length * diameter;
        // Strips at a distance x from the middle move across at q |x|: the integral of |x|³ over the length.
        let turned = broadside * length.powi(3) / 32.0;
        v.set(self.quadratic_damping, [frontal, broadside, broadside, v[self.roll_damping], turned, turned]);
        v.set(self.inertia, inertia);
        v.set(self.added_mass, added_mass);
        let own = [m, m, m, inertia[0], inertia[1], inertia[2]];
        let is_definite = self.relate_inertia(std::array::from_fn(|i| own[i] + added_mass[i]), v);
        v.refuse(is_long & !is_definite, |v| {
            let reason = "must be smaller: with this value the inertia matrix is not positive definite";
            Invalid::new(v.name(self.z_g), v[self.z_g].to_text(), reason)
        });
    }

    /// M of its diagonal, and M⁻¹; whether M is positive definite.
    fn relate_inertia<S: Scalar>(&self, diagonal: [S; 6], v: &mut Point<S>) -> S::Flag {
        let lever = v[self.m] * v[self.z_g];
        v[self.M.elements()].fill(S::from(0.0));
        v[self.inverse.elements()].fill(S::from(0.0));
        for (i, own) in diagonal.into_iter().enumerate() {
            (v[self.M.at(i, i)], v[self.inverse.at(i, i)]) = (own, own.recip());
        }
        // −m S(r_g) and its transpose, r_g = (0, 0, z_g), couple surge with pitch and sway with roll.
        let couplings = [(0, 4, lever), (1, 3, -lever)].map(|(i, j, coupling)| {
            let part = coupling / diagonal[i];
            let rest = diagonal[j] - coupling * part;
            (v[self.M.at(i, j)], v[self.M.at(j, i)]) = (coupling, coupling);
            v[self.inverse.at(i, i)] += part * part / rest;
            v[self.inverse.at(j, j)] = rest.recip();
            (v[self.inverse.at(i, j)], v[self.inverse.at(j, i)]) = (-part / rest, -part / rest);
            rest.above(S::from(0.0))
        });
        couplings[0] & couplings[1]
    }

    /// C(ν) ν by Fossen's parametrisation from M: with M ν = (h1, h2) it is (ν2 × h1, ν1 × h1 + ν2 × h2).
    fn coriolis<S: Scalar>(&self, nu: [S; 6], v: &Values<S>) -> [S; 6] {
        let [h1, h2] = thirds(&times(v.matrix(self.M), nu));
        let [nu1, nu2] = thirds(&nu);
        let (force, by_shift, by_turn) = (cross(nu2, h1), cross(nu1, h1), cross(nu2, h2));
        std::array::from_fn(|i| if i < 3 { force[i] } else { by_shift[i - 3] + by_turn[i - 3] })
    }

    /// D(ν) ν.
    fn damping<S: Scalar>(&self, nu: [S; 6], v: &Values<S>) -> [S; 6] {
        let (linear, quadratic) = (&v[self.linear_damping], &v[self.quadratic_damping]);
        std::array::from_fn(|i| (linear[i] + quadratic[i] * nu[i].abs()) * nu[i])
    }

    /// g(η): the couple of weight and buoyancy, which are equal.
    fn restoring<S: Scalar>(&self, attitude: &Attitude<S>, v: &Values<S>) -> [S; 6] {
        let (zero, lever) = (S::from(0.0), v[self.m] * v[self.g] * v[self.z_g]);
        // How far the body's x and y axis point down.
        let [x, y, _] = attitude.axes().map(|axis| axis[2]);
        [zero, zero, zero, lever * y, -lever * x, zero]
    }
}

fn positive(name: &str, text: &str, unit: &'static str, start: f64) -> Spec<Naming> {
    scalar(name, text).unit(unit).start(start).positive()
}

fn texts<const N: usize>(texts: &[String; N]) -> [&str; N] {
    texts.each_ref().map(String::as_str)
}

/// Added mass along and across a prolate spheroid of semi-axes a > b in water of density ρ, and added moment of inertia
/// of its turning about an axis across, by Lamb's formulas.
fn lamb<S: Scalar>(a: S, b: S, rho: S) -> [S; 3] {
    let displaced = rho * (4.0 / 3.0 * std::f64::consts::PI) * a * b * b;
    let e = (-(b / a).powi(2) + 1.0).sqrt();
    let (rest, atanh) = (-e * e + 1.0, (e * 2.0 / (-e + 1.0)).ln_1p() * 0.5);
    let alpha = rest * 2.0 / e.powi(3) * (atanh - e);
    let beta = (e * e).recip() - rest / e.powi(3) * atanh;
    let (difference, sum) = (a * a - b * b, a * a + b * b);
    let turning = difference.powi(2) * (beta - alpha) / (difference * 2.0 - sum * (beta - alpha));
    [alpha / (-alpha + 2.0) * displaced, beta / (-beta + 2.0) * displaced, displaced * 0.2 * turning]
}

/// Parts of three.
fn thirds<S: Scalar, const K: usize>(values: &[S]) -> [[S; 3]; K] {
    std::array::from_fn(|k| std::array::from_fn(|i| values[3 * k + i]))
}

fn cross<S: Scalar>([a1, a2, a3]: [S; 3], [b1, b2, b3]: [S; 3]) -> [S; 3] {
    [a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1]
}

fn times<S: Scalar>(matrix: DMatrixView<S>, vector: [S; 6]) -> [S; 6] {
    std::array::from_fn(|i| (0..6).fold(S::from(0.0), |sum, j| sum + matrix[(i, j)] * vector[j]))
}

impl Catalogued for MaresAuv {
    const PAGE: Page = pages::MARES_AUV;
}
