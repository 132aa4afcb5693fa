//! Nonzero entries of the exact Jacobian ∂f/∂x, whatever the numbers are, and the instructions that compute them.

use std::sync::OnceLock;

use super::elimination::Pattern;
use crate::differentiation::{Differentiator, LARGEST};
use crate::recording::{Leaf, Method, Recording};
use crate::system::{DynSystem, Section, Variables};

/// The pattern of ∂f/∂x, and columns that one direction takes together.
#[derive(Debug)]
pub struct Sparsity {
    /// The states whose rates depend on each state, in increasing order: by columns.
    columns: Vec<Vec<u32>>,
    /// States of which no two move the same rate: one direction a group.
    groups: Vec<Vec<u32>>,
    /// The pattern of its elimination, where that is worth it.
    pattern: Option<Pattern>,
    /// The instructions that compute its entries.
    differentiator: OnceLock<Differentiator>,
}

/// Place of an entry in the Jacobian.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub row: usize,
    pub column: usize,
}

impl Sparsity {
    /// Finds the pattern in the equations of a system.
    pub fn of(system: &dyn DynSystem, variables: &Variables) -> Self {
        let recording = Recording::of(system, Method::Evaluate, &variables.layout());
        let (states, rates) = (variables.reals(Section::State), variables.reals(Section::Derivative));
        let state = |leaf: Leaf| match leaf {
            Leaf::Real(place) => (place as usize).checked_sub(states.start).filter(|&state| state < states.len()),
            _ => None,
        };
        let mut columns = vec![Vec::new(); variables.states()];
        let on = recording.tape.dependence(&recording.reals[rates], |leaf| state(leaf).is_some());
        for (row, leaves) in on.into_iter().enumerate() {
            leaves.into_iter().filter_map(state).for_each(|column| columns[column].push(row as u32));
        }
        Sparsity::new(columns)
    }

    /// Builds it from a pattern by columns.
    pub fn new(columns: Vec<Vec<u32>>) -> Self {
        let mut groups: Vec<Vec<u32>> = Vec::new();
        let mut taken: Vec<Vec<bool>> = Vec::new();
        // The fullest columns first: the others fit into the gaps.
        let mut order: Vec<usize> = (0..columns.len()).collect();
        order.sort_by_key(|&column| std::cmp::Reverse(columns[column].len()));
        for column in order {
            let free = |taken: &Vec<bool>| columns[column].iter().all(|&row| !taken[row as usize]);
            let group = taken.iter().position(free).unwrap_or_else(|| {
                groups.push(Vec::new());
                taken.push(vec![false; columns.len()]);
                groups.len() - 1
            });
            groups[group].push(column as u32);
            columns[column].iter().for_each(|&row| taken[group][row as usize] = true);
        }
        let pattern = Pattern::new(&columns);
        Sparsity { columns, groups, pattern, differentiator: OnceLock::new() }
    }

    /// The instructions that compute the entries, and the rates' changes by time: recorded when they are first asked for.
    pub fn differentiator(&self, system: &dyn DynSystem, variables: &Variables) -> &Differentiator {
        let evaluate = || Recording::of(system, Method::Evaluate, &variables.layout());
        let pattern = (&self.columns[..], &self.groups[..]);
        self.differentiator.get_or_init(|| Differentiator::of(variables, pattern, evaluate, LARGEST))
    }

    /// Places of the entries, column by column.
    pub(super) fn places(&self) -> impl Iterator<Item = Place> {
        let columns = self.columns.iter().enumerate();
        columns.flat_map(|(column, rows)| rows.iter().map(move |&row| Place { row: row as usize, column }))
    }

    /// The rows of each column.
    pub fn columns(&self) -> &[Vec<u32>] {
        &self.columns
    }

    /// The pattern of its elimination, where that is worth it.
    pub(crate) fn pattern(&self) -> Option<&Pattern> {
        self.pattern.as_ref()
    }

    /// Number of entries.
    pub fn entries(&self) -> usize {
        self.columns.iter().map(Vec::len).sum()
    }

    /// The columns of each direction.
    pub fn groups(&self) -> &[Vec<u32>] {
        &self.groups
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_of_a_group_share_no_row() {
        // An arrow: a full column and row, and the diagonal.
        let n = 9;
        let columns: Vec<Vec<u32>> = (0..n).map(|j| if j == 0 { (0..n).collect() } else { vec![0, j] }).collect();
        let sparsity = Sparsity::new(columns);
        let mut all: Vec<u32> = sparsity.groups().concat();
        all.sort_unstable();
        assert_eq!(all, (0..n).collect::<Vec<_>>(), "every column once");
        for group in sparsity.groups() {
            let mut rows: Vec<u32> =
                group.iter().flat_map(|&column| sparsity.columns()[column as usize].clone()).collect();
            let count = rows.len();
            rows.sort_unstable();
            rows.dedup();
            assert_eq!(rows.len(), count, "{group:?}");
        }
        let diagonal = Sparsity::new((0..n).map(|j| vec![j]).collect());
        assert_eq!(diagonal.groups().len(), 1);
    }
}
