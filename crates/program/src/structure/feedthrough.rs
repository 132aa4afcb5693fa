//! Algebraic loops: connections that close a loop without a delay in any component.

use crate::model_description::{Affine, ModelDescription};

/// A connection by the places of components and variables.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// Source of the value: component and variable.
    pub from: (usize, usize),
    /// Target of the value.
    pub to: (usize, usize),
    /// Conversion of the value on the way.
    pub conversion: Affine,
}

/// Followers of each link through a component without a delay.
#[derive(Debug)]
pub(super) struct Feedthrough {
    /// Followers through components that declare that their output depends on the input.
    declared: Vec<Vec<usize>>,
    /// Followers through components that declare nothing.
    possible: Vec<Vec<usize>>,
}

impl Feedthrough {
    pub fn new(links: &[Link], descriptions: &[&ModelDescription]) -> Self {
        let mut leaving = vec![Vec::new(); descriptions.len()];
        links.iter().enumerate().for_each(|(k, link)| leaving[link.from.0].push(k));
        let of = |link: &Link, wanted: Option<bool>| {
            let (unit, input) = link.to;
            let is_wanted = |next: &&usize| descriptions[unit].is_fed_through(input, links[**next].from.1) == wanted;
            leaving[unit].iter().filter(is_wanted).copied().collect()
        };
        Feedthrough {
            declared: links.iter().map(|link| of(link, Some(true))).collect(),
            possible: links.iter().map(|link| of(link, None)).collect(),
        }
    }

    /// The links of an algebraic loop in which every component declares the dependence, in order, if there is one.
    pub fn declared_loop(&self) -> Option<Vec<usize>> {
        algebraic_loop(&self.declared)
    }

    /// The links of a possible algebraic loop, in order, if there is one.
    pub fn possible_loop(&self) -> Option<Vec<usize>> {
        algebraic_loop(&self.followers())
    }

    /// The links into components that may close an algebraic loop, since they declare nothing.
    pub fn undeclared(&self) -> Vec<usize> {
        let components = strong_components(&self.followers());
        let closes = |k: &usize| self.possible[*k].iter().any(|&next| components[next] == components[*k]);
        (0..self.possible.len()).filter(closes).collect()
    }

    fn followers(&self) -> Vec<Vec<usize>> {
        let both = self.declared.iter().zip(&self.possible);
        both.map(|(declared, possible)| declared.iter().chain(possible).copied().collect()).collect()
    }
}

/// The links of one loop, in order, if there is one.
fn algebraic_loop(next: &[Vec<usize>]) -> Option<Vec<usize>> {
    let mut visited = vec![false; next.len()];
    (0..next.len()).find_map(|start| loop_from(start, next, &mut visited))
}

/// Depth first; the path has the links that were entered and not yet left.
fn loop_from(start: usize, next: &[Vec<usize>], visited: &mut [bool]) -> Option<Vec<usize>> {
    if std::mem::replace(&mut visited[start], true) {
        return None;
    }
    let mut path = vec![(start, 0)];
    while let Some((link, tried)) = path.last_mut() {
        let Some(&follower) = next[*link].get(*tried) else {
            path.pop();
            continue;
        };
        *tried += 1;
        if let Some(begin) = path.iter().position(|(link, _)| *link == follower) {
            return Some(path[begin..].iter().map(|(link, _)| *link).collect());
        }
        if !std::mem::replace(&mut visited[follower], true) {
            path.push((follower, 0));
        }
    }
    None
}

/// Numbers of the links, equal for those that reach each other (Kosaraju).
fn strong_components(next: &[Vec<usize>]) -> Vec<usize> {
    let mut before = vec![Vec::new(); next.len()];
    next.iter().enumerate().for_each(|(k, next)| next.iter().for_each(|&other| before[other].push(k)));
    let (mut left, mut visited) = (Vec::new(), vec![false; next.len()]);
    (0..next.len()).for_each(|start| leave(start, next, &mut visited, &mut left));
    let mut number = vec![usize::MAX; next.len()];
    while let Some(first) = left.pop() {
        // Links that reach it and have no number yet, unless it has one itself.
        let mut waiting = if number[first] == usize::MAX { vec![first] } else { Vec::new() };
        while let Some(link) = waiting.pop() {
            if number[link] == usize::MAX {
                number[link] = first;
                waiting.extend(&before[link]);
            }
        }
    }
    number
}

/// Depth first, the links in the order in which they are left.
fn leave(start: usize, next: &[Vec<usize>], visited: &mut [bool], left: &mut Vec<usize>) {
    let mut path = vec![(start, 0)];
    if std::mem::replace(&mut visited[start], true) {
        return;
    }
    while let Some((link, tried)) = path.last_mut() {
        match next[*link].get(*tried) {
            None => {
                left.push(*link);
                path.pop();
            }
            Some(&follower) => {
                *tried += 1;
                if !std::mem::replace(&mut visited[follower], true) {
                    path.push((follower, 0));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_of_one_component_where_each_reaches_the_other() {
        // 0 → 1 → 2 → 0, from there to 3, which leads into 4 ⇄ 5; 6 follows itself.
        let next = [vec![1], vec![2], vec![0, 3], vec![4], vec![5], vec![4], vec![6]].to_vec();
        let found = strong_components(&next);
        let together = |a: usize, b: usize| found[a] == found[b];
        assert!(together(0, 1) && together(1, 2) && together(4, 5));
        assert!(!together(2, 3) && !together(3, 4) && !together(5, 6) && !together(0, 4));
        let path = algebraic_loop(&next[3..].iter().map(|_| vec![]).collect::<Vec<_>>());
        assert_eq!((path, algebraic_loop(&next).map(|path| path.len())), (None, Some(3)));
    }

    #[test]
    fn a_unit_between_two_algebraic_loops_closes_none() {
        let (declared, possible) =
            (vec![vec![1], vec![0], vec![], vec![4], vec![3]], vec![vec![2], vec![], vec![3], vec![], vec![]]);
        let links = Feedthrough { declared, possible };
        assert_eq!(links.undeclared(), Vec::<usize>::new());
        let links = Feedthrough { declared: vec![vec![1], vec![]], possible: vec![vec![], vec![0]] };
        assert_eq!(
            (links.undeclared(), links.declared_loop(), links.possible_loop()),
            (vec![1], None, Some(vec![0, 1]))
        );
    }
}
