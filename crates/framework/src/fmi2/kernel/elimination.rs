//! The linear equations of the stiff method as recorded operations: what [`Elimination`](crate::integrator) does over the
//! pattern of a system, operation by operation, without a look at the pattern.

use super::{Solver, Write};
use crate::integrator::{LOST, Pattern, Sparsity};
use crate::recording::{Condition, Leaf, Node, Operation, Recorded, Tape, on_tape};
use crate::scalar::Scalar;

/// An elimination of more operations is left to the integrator.
const LARGEST: usize = 6000;

/// Records an elimination for a Jacobian's pattern, if it is worth it.
pub(super) fn record(sparsity: &Sparsity) -> Option<Solver> {
    let pattern = sparsity.pattern()?;
    let rows: Vec<(&[u32], &[u32])> = pattern.rows().collect();
    let operations = |(left, right): &(&[u32], &[u32])| {
        left.iter().map(|&k| 2 + rows[k as usize].1.len()).sum::<usize>() + left.len() + right.len()
    };
    if rows.iter().map(operations).sum::<usize>() > LARGEST {
        return None;
    }
    let places = Places::new(&rows);
    let ((factors, accurate), decompose) = on_tape(LARGEST, || decompose(sparsity, pattern, &rows));
    let (solution, solve) = on_tape(LARGEST, || solve(pattern, &places, &rows));
    let writes = |numbers: Vec<(usize, Recorded)>| -> Vec<Write> {
        numbers.into_iter().map(|(place, number)| (place as u32, number.node())).collect()
    };
    let factors = factors.into_iter().enumerate().collect();
    let operations = |tape: Tape| tape.operations().to_vec();
    Some(Solver {
        decompose: operations(decompose),
        accurate,
        factors: writes(factors),
        solve: operations(solve),
        solution: writes(solution),
    })
}

fn given(leaf: Leaf) -> Recorded {
    Recorded::of(Operation::Leaf(leaf))
}

/// Places of the decomposition's entries: row by row, with the inverse pivot in place of the diagonal.
struct Places {
    of_rows: Vec<Vec<(u32, u32)>>,
}

impl Places {
    fn new(rows: &[(&[u32], &[u32])]) -> Self {
        let mut size = 0;
        let mut of_row = |(i, (left, right)): (usize, &(&[u32], &[u32]))| {
            let columns = left.iter().copied().chain([i as u32]).chain(right.iter().copied());
            let first = size;
            size += (left.len() + 1 + right.len()) as u32;
            columns.zip(first..).collect()
        };
        Places { of_rows: rows.iter().enumerate().map(&mut of_row).collect() }
    }

    /// The factor that lies there.
    fn factor(&self, row: usize, column: u32) -> Recorded {
        let row = &self.of_rows[row];
        given(Leaf::Real(row[row.partition_point(|(known, _)| *known < column)].1))
    }
}

/// A row of what is decomposed: what lies in its columns, in increasing order.
type Row = Vec<(u32, Recorded)>;

/// The factors, row by row, and whether they are accurate.
fn decompose(sparsity: &Sparsity, pattern: &Pattern, rows: &[(&[u32], &[u32])]) -> (Vec<Recorded>, Node) {
    let mut entries = vec![Vec::new(); rows.len()];
    let of_columns = sparsity.columns().iter().enumerate().flat_map(|(j, rows)| rows.iter().map(move |&i| (i, j)));
    for (number, (i, j)) in (0..).zip(of_columns) {
        entries[pattern.place(i as usize)].push((pattern.place(j) as u32, number));
    }
    let mut done: Vec<Row> = Vec::with_capacity(rows.len());
    let mut accurate = Condition::from(true);
    for (i, (left, right)) in rows.iter().enumerate() {
        let begun = |column: u32| {
            let begun = if column as usize == i { given(Leaf::Time) } else { Recorded::from(0.0) };
            let entry = entries[i].iter().find(|(known, _)| *known == column);
            (column, entry.map_or(begun, |(_, number)| begun - given(Leaf::Real(*number))))
        };
        let columns = left.iter().copied().chain([i as u32]).chain(right.iter().copied());
        let (row, is_accurate) = eliminated(columns.map(begun).collect(), i, left, &done);
        accurate = accurate & is_accurate;
        done.push(row);
    }
    (done.into_iter().flatten().map(|(_, factor)| factor).collect(), accurate.node())
}

/// A row less those above, and whether its pivot is accurate.
fn eliminated(mut row: Row, i: usize, left: &[u32], above: &[Row]) -> (Row, Condition) {
    let place = |row: &Row, column: u32| row.partition_point(|(known, _)| *known < column);
    let diagonal = place(&row, i as u32);
    let size = row[diagonal].1.abs();
    let mut sum = size;
    for (at, &k) in left.iter().enumerate() {
        let source = &above[k as usize];
        let pivot = place(source, k);
        row[at].1 *= source[pivot].1;
        let factor = row[at].1;
        // What a row above holds right of its diagonal, this one holds too.
        for &(j, other) in &source[pivot + 1..] {
            let less = factor * other;
            if j as usize == i {
                sum += less.abs();
            }
            let target = place(&row, j);
            row[target].1 -= less;
        }
    }
    let pivot = row[diagonal].1;
    let least = sum * LOST;
    let is_accurate = sum.at_most(Recorded::from(f64::MAX)) & least.below(pivot.abs()) & least.below(size);
    row[diagonal].1 = Recorded::from(1.0) / pivot;
    (row, is_accurate)
}

/// The places of a right-hand side, and the solution that goes there.
fn solve(pattern: &Pattern, places: &Places, rows: &[(&[u32], &[u32])]) -> Vec<(usize, Recorded)> {
    let order = pattern.order();
    let mut x: Vec<Recorded> = Vec::with_capacity(rows.len());
    let less = |begun: Recorded, i: usize, columns: &[u32], x: &[Recorded]| {
        columns.iter().fold(begun, |sum, &k| sum - places.factor(i, k) * x[k as usize])
    };
    for (i, (left, _)) in rows.iter().enumerate() {
        x.push(less(given(Leaf::Change(order[i])), i, left, &x));
    }
    for (i, (_, right)) in rows.iter().enumerate().rev() {
        x[i] = less(x[i], i, right, &x) * places.factor(i, i as u32);
    }
    order.iter().map(|&row| row as usize).zip(x).collect()
}
