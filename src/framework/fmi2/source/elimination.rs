//! The linear equations of the stiff method as straight-line C: what [`Elimination`](crate::integrator) does over the pattern of
//! a system, operation by operation, without a look at the pattern.

use std::fmt::Write;

use crate::integrator::{LOST, Pattern, Sparsity};

/// An elimination of more operations is left to the integrator.
const LARGEST: usize = 6000;

/// Functions `unit_decompose` and `unit_solve`, and how many numbers lie between them.
pub(super) struct Solver {
    pub text: String,
    pub size: usize,
}

/// For a Jacobian's pattern, where it has an elimination that is worth it.
pub(super) fn write(sparsity: &Sparsity) -> Option<Solver> {
    let pattern = sparsity.pattern()?;
    let rows: Vec<(&[u32], &[u32])> = pattern.rows().collect();
    let operations = |(left, right): &(&[u32], &[u32])| {
        left.iter().map(|&k| 2 + rows[k as usize].1.len()).sum::<usize>() + left.len() + right.len()
    };
    if rows.iter().map(operations).sum::<usize>() > LARGEST {
        return None;
    }
    let places = Places::new(&rows);
    let size = places.size;
    let text = decompose(sparsity, pattern, &places, &rows) + &solve(pattern, &places, &rows);
    Some(Solver { text, size })
}

/// Where entries of the decomposition lie: row by row, the inverse pivot in the diagonal's place.
struct Places {
    of_rows: Vec<Vec<(u32, usize)>>,
    size: usize,
}

impl Places {
    fn new(rows: &[(&[u32], &[u32])]) -> Self {
        let mut size = 0;
        let mut of_row = |(i, (left, right)): (usize, &(&[u32], &[u32]))| {
            let columns = left.iter().copied().chain([i as u32]).chain(right.iter().copied());
            let first = size;
            size += left.len() + 1 + right.len();
            columns.zip(first..).collect()
        };
        let of_rows = rows.iter().enumerate().map(&mut of_row).collect();
        Places { of_rows, size }
    }

    fn of(&self, row: usize, column: u32) -> usize {
        let row = &self.of_rows[row];
        row[row.partition_point(|(known, _)| *known < column)].1
    }
}

fn decompose(sparsity: &Sparsity, pattern: &Pattern, places: &Places, rows: &[(&[u32], &[u32])]) -> String {
    let mut entries = vec![Vec::new(); rows.len()];
    let of_columns = sparsity.columns().iter().enumerate().flat_map(|(j, rows)| rows.iter().map(move |&i| (i, j)));
    for (number, (i, j)) in of_columns.enumerate() {
        entries[pattern.place(i as usize)].push((pattern.place(j) as u32, number));
    }
    let mut text = "static int unit_decompose(real diagonal, const real *jacobian, real *a)\n{\n".to_owned();
    let mut line = |line: std::fmt::Arguments| _ = writeln!(text, "    {line}");
    for (i, (left, right)) in rows.iter().enumerate() {
        for column in left.iter().copied().chain([i as u32]).chain(right.iter().copied()) {
            let begun = if column as usize == i { "diagonal" } else { "R(0.0)" };
            let entry = entries[i].iter().find(|(known, _)| *known == column);
            let less = entry.map(|(_, number)| format!(" - jacobian[{number}]")).unwrap_or_default();
            line(format_args!("real r{i}_{column} = {begun}{less};"));
        }
        line(format_args!("const real held{i} = F(fabs)(r{i}_{i});"));
        line(format_args!("real sum{i} = held{i};"));
        for &k in *left {
            line(format_args!("r{i}_{k} *= a[{}];", places.of(k as usize, k)));
            // What a row above holds right of its diagonal, this one holds too.
            for &j in rows[k as usize].1 {
                let source = places.of(k as usize, j);
                if j as usize == i {
                    line(format_args!("sum{i} += F(fabs)(r{i}_{k} * a[{source}]);"));
                }
                line(format_args!("r{i}_{j} -= r{i}_{k} * a[{source}];"));
            }
        }
        line(format_args!(
            "if (!(sum{i} <= REAL_MAX && F(fabs)(r{i}_{i}) > R({LOST:?}) * sum{i} && held{i} > R({LOST:?}) * sum{i})) {{"
        ));
        line(format_args!("    return 0;\n    }}"));
        for column in left.iter().copied().chain(right.iter().copied()) {
            line(format_args!("a[{}] = r{i}_{column};", places.of(i, column)));
        }
        line(format_args!("a[{}] = R(1.0) / r{i}_{i};", places.of(i, i as u32)));
    }
    text + "    return 1;\n}\n\n"
}

fn solve(pattern: &Pattern, places: &Places, rows: &[(&[u32], &[u32])]) -> String {
    let mut text = "static void unit_solve(const real *a, real *b)\n{\n".to_owned();
    let order = pattern.order();
    let terms = |i: usize, columns: &[u32]| {
        let term = |&k: &u32| format!(" - a[{}] * x{k}", places.of(i, k));
        columns.iter().map(term).collect::<String>()
    };
    for (i, (left, _)) in rows.iter().enumerate() {
        let _ = writeln!(text, "    real x{i} = b[{}]{};", order[i], terms(i, left));
    }
    for (i, (_, right)) in rows.iter().enumerate().rev() {
        let _ = writeln!(text, "    x{i} = (x{i}{}) * a[{}];", terms(i, right), places.of(i, i as u32));
        let _ = writeln!(text, "    b[{}] = x{i};", order[i]);
    }
    text + "}\n\n"
}
