//! A sampled controller and its loop written out, with any filter and with unmatched uncertainty: only by the classical
//! Runge–Kutta method and elimination.
#![allow(non_snake_case)] // matrices have the names of the thesis

pub type Matrix = Vec<Vec<f64>>;

/// A v
pub fn times(A: &[Vec<f64>], v: &[f64]) -> Vec<f64> {
    A.iter().map(|row| row.iter().zip(v).map(|(a, v)| a * v).sum()).collect()
}

/// a + b
fn sum(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

/// The matrix with these columns.
pub fn of_columns(columns: &[Vec<f64>]) -> Matrix {
    (0..columns[0].len()).map(|i| columns.iter().map(|column| column[i]).collect()).collect()
}

pub fn column(A: &[Vec<f64>], j: usize) -> Vec<f64> {
    A.iter().map(|row| row[j]).collect()
}

/// v with A v = b, by elimination.
pub fn solve(A: &[Vec<f64>], b: &[f64]) -> Vec<f64> {
    let n = b.len();
    let mut rows: Matrix = A.iter().zip(b).map(|(row, &b)| row.iter().copied().chain([b]).collect()).collect();
    for k in 0..n {
        let best = (k..n).max_by(|&i, &j| rows[i][k].abs().total_cmp(&rows[j][k].abs())).unwrap();
        rows.swap(k, best);
        for i in (0..n).filter(|&i| i != k) {
            let factor = rows[i][k] / rows[k][k];
            let known = rows[k].clone();
            rows[i].iter_mut().zip(&known).skip(k).for_each(|(entry, known)| *entry -= factor * known);
        }
    }
    (0..n).map(|i| rows[i][n] / rows[i][i]).collect()
}

/// The state x after a time, in so many steps.
pub fn flow(x: &[f64], t: f64, duration: f64, steps: usize, rates: &dyn Fn(f64, &[f64]) -> Vec<f64>) -> Vec<f64> {
    let h = duration / steps as f64;
    let along = |x: &[f64], k: &[f64], h: f64| x.iter().zip(k).map(|(x, k)| x + h * k).collect::<Vec<_>>();
    (0..steps).fold(x.to_vec(), |x, s| {
        let t = t + s as f64 * h;
        let k1 = rates(t, &x);
        let k2 = rates(t + 0.5 * h, &along(&x, &k1, 0.5 * h));
        let k3 = rates(t + 0.5 * h, &along(&x, &k2, 0.5 * h));
        let k4 = rates(t + h, &along(&x, &k3, h));
        (0..x.len()).map(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])).collect()
    })
}

/// Rates by the filter's states, W_0 σ̂_1 − K_g r and σ̂_2.
type FilterRates = dyn Fn(&[f64], &[f64], &[f64]) -> Vec<f64>;
/// Output by the filter's states and σ̂_2.
type FilterOutput = dyn Fn(&[f64], &[f64]) -> Vec<f64>;
/// Rates by the time, a plant's states, the controls and the reference.
type PlantRates<'a> = dyn Fn(f64, &[f64], [&[f64]; 2]) -> Vec<f64> + 'a;
/// A reference and its rate, of the time and a plant's states.
type Asked<'a> = dyn Fn(f64, &[f64]) -> [Vec<f64>; 2] + 'a;

/// The filter's rates, of its states, of W_0 σ̂_1 − K_g r and of σ̂_2; and what it gives, of its states and σ̂_2.
pub struct Filter {
    pub order: usize,
    pub rates: Box<FilterRates>,
    pub output: Box<FilterOutput>,
}

/// u = W_0⁻¹ (ζ − K_d x_p) for x' = A x + B̄ (u + σ_1, σ_2), ζ by a filter, d samples late.
pub struct Law {
    pub T: f64,
    pub d: usize,
    pub A_d: Matrix,
    /// Effects of unit inputs in an interval: those of B W_0, then unmatched ones.
    pub L_d: Matrix,
    pub W_0: Matrix,
    pub K_d: Matrix,
    pub K_g: Matrix,
    pub filter: Filter,
    pub limit: f64,
    pub published: Option<Published>,
    q: Vec<f64>,
    x_before: Option<Vec<f64>>,
    acted: Vec<f64>,
    queue: Vec<Vec<f64>>,
}

/// Steps of a sample time in which constant inputs drive a linear system.
const FINE: usize = 40;

/// x̂ moves by x̂' = A_m x̂ + B (W_0 u + K_m x) + B̄ σ̂ with the rest constant, and σ̂ cancels its error:
/// ∫ e^(A_m s) ds B̄ σ̂ = −e^(A_m T) (x̂ − x).
pub struct Published {
    pub A_m: Matrix,
    pub K_m: Matrix,
    pub directions: Matrix,
    pub x_hat: Option<Vec<f64>>,
    pub sigma: Vec<f64>,
}

impl Published {
    fn estimate(&mut self, T: f64, x: &[f64], [before, u]: [&[f64]; 2], W_0: &[Vec<f64>]) -> Vec<f64> {
        let (n, m) = (x.len(), u.len());
        let (E, reached) = zero_order_hold(&self.A_m, &self.directions, T);
        // B K_m x, in columns of B W_0.
        let fed = solve(W_0, &times(&self.K_m, before));
        let input: Vec<_> = (0..n).map(|j| self.sigma[j] + if j < m { u[j] + fed[j] } else { 0.0 }).collect();
        let x_hat = self.x_hat.clone().unwrap_or_else(|| before.to_vec());
        let moved = sum(&times(&E, &x_hat), &times(&reached, &input));
        let error: Vec<_> = moved.iter().zip(x).map(|(x_hat, x)| x - x_hat).collect();
        self.sigma = solve(&reached, &times(&E, &error));
        self.x_hat = Some(moved);
        self.sigma.clone()
    }
}

/// A_d and L_d of x' = A x + B̄ σ over a time.
pub fn zero_order_hold(A: &[Vec<f64>], directions: &[Vec<f64>], T: f64) -> (Matrix, Matrix) {
    let n = A.len();
    let unit = |j: usize| (0..n).map(|i| f64::from(u8::from(i == j))).collect::<Vec<_>>();
    let A_d: Vec<_> = (0..n).map(|j| flow(&unit(j), 0.0, T, FINE, &|_, x| times(A, x))).collect();
    let L_d: Vec<_> = (0..directions[0].len())
        .map(|j| {
            let along = column(directions, j);
            flow(&vec![0.0; n], 0.0, T, FINE, &|_, x| sum(&times(A, x), &along))
        })
        .collect();
    (of_columns(&A_d), of_columns(&L_d))
}

impl Law {
    /// A controller with which C x follows r; `place` returns K_d from A_d and B_d W_0⁻¹.
    pub fn new(
        [T, limit]: [f64; 2],
        d: usize,
        [A, directions, C, W_0]: [&Matrix; 4],
        place: &dyn Fn(&Matrix, &Matrix) -> Matrix,
        filter: &dyn Fn(&Matrix) -> Filter,
    ) -> Self {
        let (n, m) = (A.len(), C.len());
        let (A_d, L_d) = zero_order_hold(A, directions, T);
        // B_d W_0⁻¹, column by column: W_0ᵀ (row of it)ᵀ = (row of B_d)ᵀ.
        let transposed = of_columns(W_0);
        let B_v: Matrix = L_d.iter().map(|row| solve(&transposed, &row[..m])).collect();
        let K_d = place(&A_d, &B_v);
        // (C (I − A_d + B_v K_d)⁻¹ B_v)⁻¹
        let rest: Matrix = (0..n)
            .map(|i| {
                (0..n)
                    .map(|j| {
                        let fed: f64 = (0..m).map(|l| B_v[i][l] * K_d[l][j]).sum();
                        f64::from(u8::from(i == j)) - A_d[i][j] + fed
                    })
                    .collect()
            })
            .collect();
        let gain: Vec<_> = (0..m).map(|j| times(C, &solve(&rest, &column(&B_v, j)))).collect();
        let gain = of_columns(&gain);
        let unit = |j: usize| (0..m).map(|i| f64::from(u8::from(i == j))).collect::<Vec<_>>();
        let K_g = of_columns(&(0..m).map(|j| solve(&gain, &unit(j))).collect::<Vec<_>>());
        let filter = filter(&K_d);
        Law {
            T,
            d,
            A_d,
            L_d,
            W_0: W_0.clone(),
            K_d,
            K_g,
            q: vec![0.0; filter.order],
            filter,
            limit,
            published: None,
            x_before: None,
            acted: vec![0.0; m],
            queue: vec![vec![0.0; m]; d],
        }
    }

    /// The control before the first measurement has passed; there is such where something is late.
    pub fn begin(&mut self, x: &[f64]) {
        let wanted: Vec<_> = times(&self.K_d, x).iter().map(|v| -v).collect();
        let u: Vec<_> = solve(&self.W_0, &wanted).iter().map(|u| u.clamp(-self.limit, self.limit)).collect();
        self.queue.fill(u.clone());
        self.acted = u;
    }

    /// σ̂ of the last interval, of the controls and then of what none reaches.
    fn estimate(&mut self, x: &[f64]) -> Vec<f64> {
        let (n, m) = (x.len(), self.acted.len());
        let Some(before) = &self.x_before else { return vec![0.0; n] };
        if let Some(published) = &mut self.published {
            return published.estimate(self.T, x, [before, &self.acted], &self.W_0);
        }
        let moved = times(&self.A_d, before);
        let by_u: Vec<f64> = self.L_d.iter().map(|row| (0..m).map(|j| row[j] * self.acted[j]).sum()).collect();
        let lacked: Vec<_> = (0..n).map(|i| x[i] - moved[i] - by_u[i]).collect();
        solve(&self.L_d, &lacked)
    }

    /// The control that begins to act now, from what is measured and asked for now.
    pub fn sample(&mut self, x: &[f64], r: &[f64], dr: &[f64]) -> Vec<f64> {
        let (n, m) = (x.len(), r.len());
        let sigma = self.estimate(x);
        self.x_before = Some(x.to_vec());
        let ahead = self.d as f64 * self.T;
        let r_d: Vec<_> = r.iter().zip(dr).map(|(r, dr)| r + ahead * dr).collect();
        let (lacks, asked) = (times(&self.W_0, &sigma[..m]), times(&self.K_g, &r_d));
        let w: Vec<_> = lacks.iter().zip(&asked).map(|(lack, asked)| lack - asked).collect();
        let other = &sigma[m..];
        self.q = flow(&self.q, 0.0, self.T, FINE, &|_, q| (self.filter.rates)(q, &w, other));
        let zeta = (self.filter.output)(&self.q, other);
        let x_p = self.queue.iter().fold(x.to_vec(), |x, u| {
            let driven: Vec<_> = (0..n).map(|j| sigma[j] + if j < m { u[j] } else { 0.0 }).collect();
            sum(&times(&self.A_d, &x), &times(&self.L_d, &driven))
        });
        let wanted: Vec<_> = zeta.iter().zip(times(&self.K_d, &x_p)).map(|(zeta, fed)| zeta - fed).collect();
        self.queue.push(solve(&self.W_0, &wanted).iter().map(|u| u.clamp(-self.limit, self.limit)).collect());
        self.acted = self.queue.remove(0);
        self.acted.clone()
    }
}

/// K of one control with the poles e^(p T) of x⁺ = A_d x + b u, after Ackermann: (0 … 0 1) (b, A b, …)⁻¹ Π(A_d − e^(p T)).
pub fn placed(A_d: &Matrix, b: &[f64], poles: &[f64], T: f64) -> Vec<f64> {
    let n = b.len();
    let reached: Vec<_> = std::iter::successors(Some(b.to_vec()), |b| Some(times(A_d, b))).take(n).collect();
    // Rows of the left factor: solve with the transposed.
    let last: Vec<f64> = (0..n).map(|i| f64::from(u8::from(i + 1 == n))).collect();
    let mut row = solve(&reached, &last);
    let transposed = of_columns(A_d);
    for pole in poles {
        let moved = times(&transposed, &row);
        row = moved.iter().zip(&row).map(|(moved, row)| moved - (pole * T).exp() * row).collect();
    }
    row
}

/// Results of a loop.
#[derive(Debug, Clone, Default)]
pub struct Ran {
    pub states: Vec<Vec<f64>>,
    pub controls: Vec<Vec<f64>>,
    /// rms of each error late in the run, and its largest size at all.
    pub rms: Vec<f64>,
    pub largest: Vec<f64>,
    pub largest_u: Vec<f64>,
}

/// A plant with its law: x measured is the first so many of the plant's states.
pub fn run(
    law: &mut Law,
    (start, measured): (&[f64], usize),
    [until, from, h]: [f64; 3],
    rates: &PlantRates<'_>,
    reference: &Asked<'_>,
    errors: &dyn Fn(f64, &[f64]) -> Vec<f64>,
) -> Ran {
    let (T, mut s, mut ran, mut count) = (law.T, start.to_vec(), Ran::default(), 0.0);
    let steps = (T / h).round() as usize;
    law.begin(&s[..measured]);
    for k in 0..(until / T).round() as usize {
        let t = k as f64 * T;
        let [r, dr] = reference(t, &s);
        let u = law.sample(&s[..measured], &r, &dr);
        ran.states.push(s.clone());
        ran.largest_u.resize(u.len(), 0.0);
        (0..u.len()).for_each(|i| ran.largest_u[i] = ran.largest_u[i].max(u[i].abs()));
        for j in 0..steps {
            let (t, h) = (t + j as f64 * T / steps as f64, T / steps as f64);
            s = flow(&s, t, h, 1, &|t, s| rates(t, s, [&u, &r]));
            let e = errors(t + h, &s);
            ran.rms.resize(e.len(), 0.0);
            ran.largest.resize(e.len(), 0.0);
            let late = f64::from(u8::from(t + h >= from - 1e-9));
            count += late;
            for ((largest, sum), e) in ran.largest.iter_mut().zip(&mut ran.rms).zip(&e) {
                *largest = largest.max(e.abs());
                *sum += late * e * e;
            }
        }
        ran.controls.push(u);
    }
    ran.rms.iter_mut().for_each(|sum| *sum = (*sum / f64::max(count, 1.0)).sqrt());
    ran
}
