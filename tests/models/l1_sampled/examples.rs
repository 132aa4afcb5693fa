//! Examples 3.4.1, 3.4.2 and 3.3.2 of the thesis under a sampled law, written out.
#![allow(non_snake_case)] // matrices have the names of the thesis

use super::by_hand::{Filter, Law, Matrix, Ran, flow, of_columns, placed, run};

/// The plant of 3.4.1 with its unmodeled dynamics, 7 states, and behind them the desired model, 3.
fn unmatched_rates(t: f64, s: &[f64], u: &[f64], r: &[f64]) -> Vec<f64> {
    let [x1, x2, x3, v1, v2, z1, z2, m1, m2, m3] = s else { panic!() };
    let (x1, x2, x3, v1, v2, z1, z2) = (*x1, *x2, *x3, *v1, *v2, *z1, *z2);
    let z = 0.1 * (v1 - v2) + z1;
    let w = [0.6 * u[0] - 0.2 * u[1], 0.2 * u[0] + 1.2 * u[1]];
    let f = [
        -(x1 * x1 + x2 * x2 + x3 * x3) / 3.0 + (0.5 * x1).tanh() * x1,
        0.5 * x2 / x2.cosh() + 0.2 * (1.0 - (-0.3 * t).exp()) + 0.5 * z,
        0.6 * x3 * (5.0 * t).cos() - 0.7 * z * z,
    ];
    let e = x1 - 2.0 * x2 + x3;
    vec![
        -x1 + 0.2 * x1 - 0.2 * x2 - 0.3 * x3 + w[0] + f[0],
        x3 - 0.2 * x1 - 0.2 * x2 + 0.6 * x3 + f[1],
        -x2 - 1.8 * x3 - 0.1 * x1 - 0.9 * x3 + w[0] + w[1] + f[2],
        v2,
        -v1 + 0.8 * (1.0 - v1 * v1) * v2,
        z2 - 0.08 * z1 - e / 100.0,
        (e - z1) / 100.0,
        -m1 + r[0],
        *m3,
        -m2 - 1.8 * m3 + r[0] + (r[1] - r[0]),
    ]
}

/// The controller of 3.4.1: D(s) = 1/(s (s/25 + 1)(s/70 + 1)(s²/1600 + 1.8 s/40 + 1)), and D(s) (s + 1.8) in channel 2.
pub fn unmatched_law(T: f64, d: usize) -> Law {
    let A = vec![vec![-1.0, 0.0, 0.0], vec![0.0, 0.0, 1.0], vec![0.0, -1.0, -1.8]];
    let directions = vec![vec![1.0, 0.0, 0.0], vec![0.0, 0.0, 1.0], vec![1.0, 1.0, 0.0]];
    let C = vec![vec![1.0, 0.0, 0.0], vec![0.0, 1.0, 0.0]];
    let W_0 = vec![vec![1.0, 0.0], vec![0.0, 1.0]];
    let filter = |_: &Matrix| Filter {
        order: 10,
        rates: Box::new(|q, w, sigma_2| {
            let mut rates = Vec::new();
            for i in 0..2 {
                let [integral, p, s, w1, w2] = q[5 * i..][..5] else { panic!() };
                let a_2 = if i == 1 { sigma_2[0] } else { 0.0 };
                rates.extend([
                    w[i] - 8.0 * w1 + 1.8 * a_2,
                    25.0 * (integral + a_2 - p),
                    70.0 * (p - s),
                    40.0 * w2,
                    40.0 * (s - w1) - 72.0 * w2,
                ]);
            }
            rates
        }),
        output: Box::new(|q, _| vec![-8.0 * q[3], -8.0 * q[8]]),
    };
    Law::new([T, f64::INFINITY], d, [&A, &directions, &C, &W_0], &|_, _| vec![vec![0.0; 3]; 2], &filter)
}

/// Its loop: the deviation from the desired model.
pub fn unmatched(T: f64, d: usize, until: f64) -> Ran {
    let mut law = unmatched_law(T, d);
    let r = |t: f64| if t < 15.0 - 1e-9 { vec![1.0, -0.5] } else { vec![-0.5, 1.0] };
    run(
        &mut law,
        (&[0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0], 3),
        [until, 0.0, 5e-4],
        // The step of r is at a sample: the interval that ends there is before it.
        &|t, s, [u, r]| unmatched_rates(t, s, u, r),
        &|t, _| [r(t), vec![0.0; 2]],
        &|_, s| vec![s[0] - s[7], s[1] - s[8]],
    )
}

/// The twin rotor: (ψ, ψ', φ, φ', τ1, τ2), and its lagged torque.
fn twin_rates(s: &[f64], u: &[f64]) -> Vec<f64> {
    let [psi, w1, _phi, w2, t1, t2, lag] = *s else { panic!() };
    let (m1, m2) = (0.0135 * t1 * t1 + 0.0924 * t1, 0.02 * t2 * t2 + 0.09 * t2);
    let friction = |viscous: f64, coulomb: f64, rate: f64| viscous * rate + coulomb * (rate / 0.01).tanh();
    // k_c (T_0 s + 1)/(T_p s + 1)
    let reaction = -0.2 * (3.5 / 2.0 * m1 + (1.0 - 3.5 / 2.0) * lag);
    let pitch = m1 - 0.32 * psi.sin() + 0.0163 * (2.0 * psi).sin() * w2 * w2
        - friction(0.006, 0.001, w1)
        - 0.05 * psi.cos() * w2 * m1;
    let yaw = m2 - friction(0.1, 0.01, w2) - reaction;
    vec![w1, pitch / 0.068, w2, yaw / 0.02, (-t1 + 1.1 * u[0]) / 1.1, -t2 + 0.8 * u[1], (m1 - lag) / 2.0]
}

/// Its reference, and the rate of that.
fn twin_reference(t: f64) -> [Vec<f64>; 2] {
    let e = (-0.5 * t).exp();
    let a = 1.0 - e * (1.0 + 0.5 * t + 0.125 * t * t);
    // a' = e (0.5 (1 + 0.5 t + 0.125 t²) − 0.5 − 0.25 t)
    let da = e * 0.0625 * t * t;
    let (p, dp) = (0.2 + 0.1 * (0.3 * t).sin(), 0.03 * (0.3 * t).cos());
    let (y, dy) = (0.3 * (0.2 * t).sin(), 0.06 * (0.2 * t).cos());
    [vec![a * p, a * y], vec![da * p + a * dp, da * y + a * dy]]
}

/// Its controller: D(s) = 1/s, and in each axis H_m⁻¹ H_um = (s + p)/(a b), with direct feedthrough of σ_2.
pub fn twin_law(T: f64, d: usize) -> Law {
    let (g, c1, a1, c2, a2) = (0.32 / 0.068, 0.006 / 0.068, 0.0924 / 0.068, 0.1 / 0.02, 0.09 / 0.02);
    let A = vec![
        vec![0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
        vec![-g, -c1, 0.0, 0.0, a1, 0.0],
        vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        vec![0.0, 0.0, 0.0, -c2, 0.0, a2],
        vec![0.0, 0.0, 0.0, 0.0, -1.0 / 1.1, 0.0],
        vec![0.0, 0.0, 0.0, 0.0, 0.0, -1.0],
    ];
    let unit = |k: usize, size: f64| (0..6).map(|i| if i == k { size } else { 0.0 }).collect::<Vec<_>>();
    // Controls, what enters ψ'' and φ'', and the kinematic rows.
    let directions = of_columns(&[unit(4, 1.0), unit(5, 0.8), unit(1, 1.0), unit(3, 1.0), unit(0, 1.0), unit(2, 1.0)]);
    let C = vec![unit(0, 1.0), unit(2, 1.0)];
    let W_0 = vec![vec![1.0, 0.0], vec![0.0, 1.0]];
    let axes = [[0usize, 1, 4], [2, 3, 5]];
    let place = move |A_d: &Matrix, B_v: &Matrix| {
        let mut K = vec![vec![0.0; 6]; 2];
        for (i, axis) in axes.iter().enumerate() {
            let A: Matrix = axis.iter().map(|&p| axis.iter().map(|&q| A_d[p][q]).collect()).collect();
            let b: Vec<_> = axis.iter().map(|&p| B_v[p][i]).collect();
            for (&place, gain) in axis.iter().zip(placed(&A, &b, &[-15.0, -17.0, -20.0], T)) {
                K[i][place] = gain;
            }
        }
        K
    };
    let filter = move |K_d: &Matrix| {
        // H_m⁻¹ H_um = (s + p)/(a b), with p of the dynamics with the sampled baseline.
        let b = [1.0, 0.8];
        let a = [a1, a2];
        let p = [1.0 / 1.1 + b[0] * K_d[0][4], 1.0 + b[1] * K_d[1][5]];
        Filter {
            order: 2,
            output: Box::new(move |q, s2| (0..2).map(|i| -5.0 * (q[i] + s2[i] / (a[i] * b[i]))).collect()),
            rates: Box::new(move |q, w, s2| {
                (0..2)
                    .map(|i| {
                        let zeta = -5.0 * (q[i] + s2[i] / (a[i] * b[i]));
                        zeta + w[i] + p[i] / (a[i] * b[i]) * s2[i]
                    })
                    .collect()
            }),
        }
    };
    Law::new([T, f64::INFINITY], d, [&A, &directions, &C, &W_0], &place, &filter)
}

/// Its loop with controls within ±limit: errors of both angles, rms from 10 s on.
pub fn twin(T: f64, d: usize, limit: f64, until: f64) -> Ran {
    let mut law = twin_law(T, d);
    law.limit = limit;
    run(
        &mut law,
        (&[0.0; 7], 6),
        [until, 10.0, 5e-4],
        &|_, s, [u, _]| twin_rates(s, u),
        &|t, _| twin_reference(t),
        &|t, s| {
            let [r, _] = twin_reference(t);
            vec![r[0] - s[0], r[1] - s[2]]
        },
    )
}

/// Moments of inertia of the quadrotor, and its angles at the start.
const INERTIA: [f64; 3] = [4.85e-3, 4.85e-3, 8.81e-3];
pub const START: [f64; 3] = [0.1, -0.1, 0.2];

/// The quadrotor: position, velocity, angles, rates; six states of the disturbances.
fn quadrotor_rates(t: f64, s: &[f64], u: &[f64], is_uncertain: bool) -> Vec<f64> {
    let (m, g, I) = (0.5, 9.81, INERTIA);
    let [phi, theta, psi] = s[6..9] else { panic!() };
    let [p, q, r] = s[9..12] else { panic!() };
    let (sp, cp, st, ct, ss, cs) = (phi.sin(), phi.cos(), theta.sin(), theta.cos(), psi.sin(), psi.cos());
    let lift = u[0].clamp(0.0, 15.0) / m;
    let f = [(I[1] - I[2]) / I[0] * q * r, (I[2] - I[0]) / I[1] * p * r, (I[0] - I[1]) / I[2] * p * q];
    let z = &s[12..];
    let (extra, gain, d) = if is_uncertain {
        (
            [
                0.2 * cp * st + 0.2 * phi * psi,
                0.2 * cp * ss + 0.2 * phi * psi * psi,
                0.2 * ct * sp + 0.2 * phi * theta * psi,
            ],
            [1.6, 0.7, 1.23],
            [z[0], z[1], z[3]],
        )
    } else {
        ([0.0; 3], [1.0; 3], [0.0; 3])
    };
    let a: Vec<f64> = (0..3).map(|i| f[i] + extra[i] + gain[i] * u[1 + i] / I[i] + d[i]).collect();
    vec![
        s[3],
        s[4],
        s[5],
        (cp * st * cs + sp * ss) * lift,
        (cp * st * ss - sp * cs) * lift,
        cp * ct * lift - g,
        p,
        q,
        r,
        a[0],
        a[1],
        a[2],
        -z[0] + 0.2 * (0.4 * t).sin(),
        z[2],
        -3.0 * z[1] - 2.0 * z[2] + 0.24 * (0.6 * t).sin(),
        z[4],
        -2.0 * z[3] - 3.0 * z[4] + 0.15 * (0.5 * t).sin(),
    ]
}
/// Reference and its rates: x, y, z, psi.
pub fn quadrotor_reference(t: f64) -> [[f64; 4]; 3] {
    let e = (-0.5 * t).exp();
    [
        [(0.4 * t).sin(), 1.0 - (0.4 * t).cos(), 2.0 * (1.0 - e * (1.0 + 0.5 * t)), 0.3 * (0.3 * t).sin()],
        [0.4 * (0.4 * t).cos(), 0.4 * (0.4 * t).sin(), 0.5 * t * e, 0.09 * (0.3 * t).cos()],
        [-0.16 * (0.4 * t).sin(), 0.16 * (0.4 * t).cos(), 0.5 * e * (1.0 - 0.5 * t), 0.0],
    ]
}
/// Thrust, and the angles of roll and pitch that are wanted.
pub fn position_loop(t: f64, s: &[f64]) -> [f64; 3] {
    let [r, dr, ddr] = quadrotor_reference(t);
    let a: Vec<f64> = (0..3).map(|i| ddr[i] + 4.0 * (dr[i] - s[3 + i]) + 4.0 * (r[i] - s[i])).collect();
    let (g, psi) = (9.81, s[8]);
    let g_z = (g + a[2]).max(0.3 * g);
    let theta = ((a[0] * psi.cos() + a[1] * psi.sin()) / g_z).atan().clamp(-0.6, 0.6);
    let phi = (theta.cos() * (a[0] * psi.sin() - a[1] * psi.cos()) / g_z).atan().clamp(-0.6, 0.6);
    [0.5 * g_z / (s[6].cos() * s[7].cos()).max(0.3), phi, theta]
}
/// The controller of its attitude: each angle is a double integrator.
pub fn attitude_law(T: f64, d: usize) -> Law {
    let unit = |k: usize, size: f64| (0..6).map(|i| if i == k { size } else { 0.0 }).collect::<Vec<_>>();
    let A: Matrix = (0..6).map(|i| if i < 3 { unit(i + 3, 1.0) } else { unit(0, 0.0) }).collect();
    let direction = |j: usize| if j < 3 { unit(3 + j, 1.0 / INERTIA[j]) } else { unit(j - 3, 1.0) };
    let directions = of_columns(&(0..6).map(direction).collect::<Vec<_>>());
    let C: Matrix = (0..3).map(|i| unit(i, 1.0)).collect();
    let W_0: Matrix = (0..3).map(|i| (0..3).map(|j| if i == j { 1.0 / INERTIA[i] } else { 0.0 }).collect()).collect();
    let place = |_: &Matrix, _: &Matrix| -> Matrix {
        let row = |(i, re): (usize, &f64)| {
            let (size, angle) = ((re * T).exp(), 0.5 * T);
            let (s, p) = (2.0 * size * angle.cos(), size * size);
            let mut row = unit(i, (1.0 - s + p) / (T * T));
            row[3 + i] = (3.0 - s - p) / (2.0 * T);
            row
        };
        [-30.0_f64, -35.0, -40.0].iter().enumerate().map(row).collect()
    };
    let filter = |_: &Matrix| Filter {
        order: 3,
        rates: Box::new(|q, w, _| (0..3).map(|i| -30.0 * (q[i] + w[i])).collect()),
        output: Box::new(|q, _| q.to_vec()),
    };
    Law::new([T, f64::INFINITY], d, [&A, &directions, &C, &W_0], &place, &filter)
}

/// Its loop, with the position loop computed at the samples and as late: errors of roll, pitch, yaw, x and y.
pub fn quadrotor(T: f64, d: usize, is_uncertain: bool, until: f64) -> Ran {
    let mut law = attitude_law(T, d);
    let mut s = vec![0.0; 17];
    s[6..9].copy_from_slice(&START);
    let mut ran = Ran { rms: vec![0.0; 5], largest: vec![0.0; 5], largest_u: vec![0.0; 4], ..Ran::default() };
    let (steps, mut count) = ((T / 5e-4).round() as usize, 0.0);
    law.begin(&s[6..12]);
    let mut thrusts = vec![position_loop(0.0, &s)[0]; d];
    for k in 0..(until / T).round() as usize {
        let t = k as f64 * T;
        let [thrust, phi, theta] = position_loop(t, &s);
        let [r, dr, _] = quadrotor_reference(t);
        let torque = law.sample(&s[6..12], &[phi, theta, r[3]], &[0.0, 0.0, dr[3]]);
        thrusts.push(thrust);
        let u = [thrusts.remove(0), torque[0], torque[1], torque[2]];
        (0..4).for_each(|i| ran.largest_u[i] = ran.largest_u[i].max(u[i].abs()));
        ran.states.push(s.clone());
        ran.controls.push(u.to_vec());
        for j in 0..steps {
            let (t, h) = (t + j as f64 * T / steps as f64, T / steps as f64);
            s = flow(&s, t, h, 1, &|t, s| quadrotor_rates(t, s, &u, is_uncertain));
            let ([r, ..], [_, phi, theta]) = (quadrotor_reference(t + h), position_loop(t + h, &s));
            let e = [phi - s[6], theta - s[7], r[3] - s[8], r[0] - s[0], r[1] - s[1]];
            let late = f64::from(u8::from(t + h >= 5.0 - 1e-9));
            count += late;
            for ((largest, sum), e) in ran.largest.iter_mut().zip(&mut ran.rms).zip(e) {
                *largest = largest.max(e.abs());
                *sum += late * e * e;
            }
        }
    }
    ran.rms.iter_mut().for_each(|sum| *sum = (*sum / f64::max(count, 1.0)).sqrt());
    ran
}
