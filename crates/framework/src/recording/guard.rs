//! Conditions under which operations are needed for the wanted results. Some hosts trap floating-point exceptions, so a
//! quotient that equations don't ask for must not be computed.

use std::collections::HashMap;
use std::mem::take;
use std::rc::Rc;

use super::tangent::needed;
use super::tape::{Comparison, Node, Operation, Tape};

/// A condition, and whether it holds.
pub type Literal = (Node, bool);

/// More terms than that are one, of what they have in common.
const MOST: usize = 12;

/// Holds where all literals of any of its terms do. Each is sorted, and an empty one always holds.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Guard {
    terms: Vec<Vec<Literal>>,
}

impl Guard {
    /// Holds always.
    pub fn always() -> Self {
        Guard { terms: vec![Vec::new()] }
    }

    /// True if it holds always.
    pub fn is_always(&self) -> bool {
        self.terms.iter().any(Vec::is_empty)
    }

    /// Its terms.
    pub fn terms(&self) -> impl Iterator<Item = &[Literal]> {
        self.terms.iter().map(Vec::as_slice)
    }

    /// True if another one holds wherever this does.
    pub fn implies(&self, other: &Guard) -> bool {
        self.terms.iter().all(|term| other.terms.iter().any(|of| of.iter().all(|literal| term.contains(literal))))
    }

    /// Its remaining condition if these literals hold.
    pub fn within(&self, operations: &[Operation], known: &[Literal]) -> Self {
        let mut left = Guard::default();
        for term in &self.terms {
            let decided = |(node, holds): &Literal| decided(operations, *node, known).map(|found| found == *holds);
            if term.iter().all(|literal| decided(literal) != Some(false)) {
                left.or(operations, term.iter().filter(|literal| decided(literal).is_none()).copied().collect());
            }
        }
        left
    }

    /// The value of a condition, if it is the same wherever this holds.
    fn decides(&self, operations: &[Operation], condition: Node) -> Option<bool> {
        let mut values = self.terms.iter().map(|term| decided(operations, condition, term));
        let first = values.next()??;
        values.all(|value| value == Some(first)).then_some(first)
    }

    /// Holds where both do.
    fn and(&self, operations: &[Operation], literals: &[Literal]) -> Self {
        let mut both = Guard::default();
        for term in &self.terms {
            let mut term = term.clone();
            term.extend(literals);
            term.sort_unstable();
            term.dedup();
            if term.windows(2).all(|pair| pair[0].0 != pair[1].0) {
                both.or(operations, term);
            }
        }
        both
    }

    /// Holds where the literals of one more term do, too. A literal that decides nothing is left out.
    fn or(&mut self, operations: &[Operation], term: Vec<Literal>) {
        let mut waiting = vec![term];
        while let Some(term) = waiting.pop() {
            if self.terms.iter().any(|known| is_part(known, &term)) {
                continue;
            }
            if let Some(shorter) = self.terms.iter().find_map(|known| shortened(operations, &term, known)) {
                waiting.push(shorter);
                continue;
            }
            for known in take(&mut self.terms).into_iter().filter(|known| !is_part(&term, known)) {
                match shortened(operations, &known, &term) {
                    Some(shorter) => waiting.push(shorter),
                    None => self.terms.push(known),
                }
            }
            self.terms.push(term);
        }
        if self.terms.len() > MOST {
            let common = self.terms[0].iter().filter(|literal| self.terms.iter().all(|term| term.contains(literal)));
            self.terms = vec![common.copied().collect()];
        }
    }
}

impl Tape {
    /// The result of an operation where a guard holds, and 0 elsewhere.
    pub(crate) fn where_needed(&mut self, node: Node, guard: &Guard) -> Node {
        if guard.is_always() {
            return node;
        }
        let mut any: Option<Node> = None;
        for term in guard.terms() {
            let mut all: Option<Node> = None;
            for &(condition, holds) in term {
                let literal = if holds { condition } else { self.add(Operation::Not(condition)) };
                all = Some(all.map_or(literal, |all| self.add(Operation::And(all, literal))));
            }
            any = all.map(|all| any.map_or(all, |any| self.add(Operation::Or(any, all)))).or(any);
        }
        let zero = self.number(0.0);
        any.map_or(zero, |condition| self.add(Operation::Select(condition, node, zero)))
    }
}

/// True if all literals of one term are in another.
fn is_part(term: &[Literal], of: &[Literal]) -> bool {
    term.iter().all(|literal| of.contains(literal))
}

/// A term without literals that decide nothing, as another one holds: where a literal of one is the opposite of literals of the other,
/// and the rest of the other is part of the term, the rest of the term is enough.
fn shortened(operations: &[Operation], term: &[Literal], other: &[Literal]) -> Option<Vec<Literal>> {
    let opposite = |(node, holds): Literal| literals(operations, (node, !holds));
    let of_term = term.iter().map(|&own| (vec![own], opposite(own)));
    let of_other = other.iter().map(|&own| (opposite(own), vec![own]));
    let mut pairs = of_term.chain(of_other).filter(|(own, theirs)| is_part(own, term) && is_part(theirs, other));
    let left = |term: &[Literal], without: &[Literal]| -> Vec<Literal> {
        term.iter().filter(|literal| !without.contains(literal)).copied().collect()
    };
    pairs.find_map(|(own, theirs)| {
        let rest = left(term, &own);
        is_part(&left(other, &theirs), &rest).then_some(rest)
    })
}

/// Guard of each operation for the wanted results, each of which may have a condition. Many operations share a guard.
pub fn guards(operations: &[Operation], needed: &[bool], wanted: &[(Node, Option<Node>)]) -> Vec<Rc<Guard>> {
    // One that has no terms yet is replaced, not changed.
    let none = Rc::new(Guard::default());
    let mut guards: Vec<Rc<Guard>> = operations.iter().map(|_| Rc::clone(&none)).collect();
    let always = Rc::new(Guard::always());
    for (node, condition) in wanted {
        let under = condition.map(|node| Rc::new(always.and(operations, &literals(operations, (node, true)))));
        merge(operations, &mut guards[node.index()], under.as_ref().unwrap_or(&always));
    }
    for place in (0..operations.len()).rev().filter(|&place| needed[place]) {
        let own = Rc::clone(&guards[place]);
        let mut ask = |node: Node, under: Option<Literal>| {
            let of = &mut guards[node.index()];
            match under {
                _ if of.is_always() => {}
                None => merge(operations, of, &own),
                Some(under) => merge(operations, of, &Rc::new(own.and(operations, &literals(operations, under)))),
            }
        };
        match &operations[place] {
            Operation::Select(condition, yes, no) => {
                ask(*condition, None);
                ask(*yes, Some((*condition, true)));
                ask(*no, Some((*condition, false)));
            }
            // The second is needed only if the first doesn't decide, as in C.
            Operation::And(a, b) => {
                ask(*a, None);
                ask(*b, Some((*a, true)));
            }
            Operation::Or(a, b) => {
                ask(*a, None);
                ask(*b, Some((*a, false)));
            }
            operation => operation.operands().for_each(|operand| ask(operand, None)),
        }
    }
    guards
}

/// The most rounds in which operands are followed.
const MOST_ROUNDS: usize = 8;

/// The operations, where an operand that is a selection is the operand which that takes, if its condition is known wherever the
/// operation is needed: what only the other one needs is then needed less often.
pub fn followed(operations: &[Operation], wanted: &[(Node, Option<Node>)]) -> Vec<Operation> {
    let mut operations = operations.to_vec();
    let nodes: Vec<Node> = wanted.iter().flat_map(|(node, condition)| [Some(*node), *condition]).flatten().collect();
    for _ in 0..MOST_ROUNDS {
        let needed = needed(&operations, &nodes);
        let guards = guards(&operations, &needed, wanted);
        let follow = |guard: &Guard, mut node: Node| loop {
            node = match operations[node.index()] {
                Operation::Select(condition, yes, no) => match guard.decides(&operations, condition) {
                    Some(holds) => {
                        if holds {
                            yes
                        } else {
                            no
                        }
                    }
                    None => return node,
                },
                // The same condition as a number, compared with that of the condition.
                Operation::Compare(Comparison::Equals, number, with) => match same(&operations, number, with) {
                    Some(condition) => condition,
                    None => return node,
                },
                _ => return node,
            }
        };
        let places = (0..operations.len()).filter(|&place| needed[place]);
        let changed = places.filter_map(|place| {
            let guard = &guards[place];
            let other = match operations[place] {
                Operation::Select(condition, yes, no) => {
                    let within = |holds| guard.and(&operations, &literals(&operations, (condition, holds)));
                    let (yes, no) = (follow(&within(true), yes), follow(&within(false), no));
                    Operation::Select(follow(guard, condition), yes, no)
                }
                ref operation => operation.over(|node| follow(guard, node)),
            };
            (other != operations[place]).then_some((place, other))
        });
        let changed: Vec<_> = changed.collect();
        if changed.is_empty() {
            break;
        }
        changed.into_iter().for_each(|(place, other)| operations[place] = other);
        share(&mut operations);
    }
    operations
}

/// Has operations that are equal now share one result, but for loops over lanes, whose inputs aren't among the operations.
fn share(operations: &mut [Operation]) {
    let (mut first, mut places) = (HashMap::new(), Vec::with_capacity(operations.len()));
    for (place, operation) in operations.iter_mut().enumerate() {
        *operation = operation.over(|node| places[node.index()]);
        if matches!(operation, Operation::Iterate { start, .. } if start.is_empty()) {
            places.push(Node::at(place));
            continue;
        }
        places.push(*first.entry(operation.clone()).or_insert(Node::at(place)));
    }
}

/// The condition that holds where a number is equal to another one: `condition ? number : other` compared with `number`.
fn same(operations: &[Operation], number: Node, with: Node) -> Option<Node> {
    let constant = |node: Node| match operations[node.index()] {
        Operation::Constant(bits) => Some(f64::from_bits(bits)),
        _ => None,
    };
    let Operation::Select(condition, yes, no) = operations[number.index()] else { return None };
    let (yes, no, with) = (constant(yes)?, constant(no)?, constant(with)?);
    (yes == with && no != with).then_some(condition)
}

/// Takes the terms of another guard in.
fn merge(operations: &[Operation], guard: &mut Rc<Guard>, other: &Rc<Guard>) {
    if guard.terms.is_empty() {
        *guard = Rc::clone(other);
    } else if !Rc::ptr_eq(guard, other) {
        let guard = Rc::make_mut(guard);
        other.terms.iter().for_each(|term| guard.or(operations, term.clone()));
    }
}

/// Literals that a literal is composed of.
pub fn literals(operations: &[Operation], (node, holds): Literal) -> Vec<Literal> {
    match (&operations[node.index()], holds) {
        (Operation::Not(a), _) => literals(operations, (*a, !holds)),
        (Operation::And(a, b), true) | (Operation::Or(a, b), false) => {
            let mut both = literals(operations, (*a, holds));
            both.extend(literals(operations, (*b, holds)));
            both
        }
        _ => vec![(node, holds)],
    }
}

/// The value of a condition, if it follows from the known literals.
pub fn decided(operations: &[Operation], condition: Node, known: &[Literal]) -> Option<bool> {
    [true, false].into_iter().find_map(|holds| {
        let parts = literals(operations, (condition, holds));
        let is_wrong = |(node, holds): &Literal| known.contains(&(*node, !holds));
        if parts.iter().all(|part| known.contains(part)) {
            Some(holds)
        } else {
            parts.iter().any(is_wrong).then_some(!holds)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::{Guard, MOST, followed, guards};
    use crate::recording::{Binary, Node, Operation};

    /// A guard that holds if any of these terms does; a literal is a node's place, negative if it must not hold. Node 20 is
    /// that both 1 and 2 hold, 21 that 3 or 20 does.
    fn any(terms: &[&[i32]]) -> Guard {
        let mut guard = Guard::default();
        let both = Operation::And(Node::at(1), Node::at(2));
        let either = Operation::Or(Node::at(3), Node::at(20));
        let operations: Vec<_> = (0..20).map(Operation::Carried).chain([both, either]).collect();
        let literal = |&place: &i32| (Node::at(place.unsigned_abs() as usize), place > 0);
        terms.iter().for_each(|term| guard.or(&operations, term.iter().map(literal).collect()));
        guard
    }

    #[test]
    fn what_decides_nothing_is_left_out() {
        assert_eq!(any(&[&[1], &[1, 2]]), any(&[&[1]]));
        assert_eq!(any(&[&[1, 2], &[1]]), any(&[&[1]]));
        assert!(any(&[&[1], &[-1]]).is_always());
        assert_eq!(any(&[&[1, 2], &[1, -2]]), any(&[&[1]]));
        assert_eq!(any(&[&[1], &[-1, 2]]), any(&[&[1], &[2]]));
        assert!(any(&[&[1, 2], &[-2], &[2, -1]]).is_always());
        assert!(!any(&[&[1, 2], &[-1, -2]]).is_always());
        assert!(any(&[&[1, 2], &[-20]]).is_always());
        assert_eq!(any(&[&[4, -20], &[1, 2, 4, 5], &[1, 2, 4, -5]]), any(&[&[4]]));
        assert_eq!(any(&[&[1, 2, 4], &[-20, 4, 5]]), any(&[&[1, 2, 4], &[4, 5]]));
        assert_eq!(any(&[&[-3, -20, 4], &[4, 21]]), any(&[&[4]]));
    }

    #[test]
    fn many_terms_are_what_they_have_in_common() {
        let terms: Vec<[i32; 2]> = (0..=MOST as i32).map(|place| [1, place + 2]).collect();
        assert_eq!(any(&terms.iter().map(<[i32; 2]>::as_slice).collect::<Vec<_>>()), any(&[&[1]]));
    }

    #[test]
    fn an_operand_is_needed_where_the_branches_are_that_use_it() {
        let at = Node::at;
        // a, b, x, y; then !a, !a && b, !a ? x : y, and (!a && b) ? (!a ? x : y) : y.
        let operations = [
            Operation::Carried(0),
            Operation::Carried(1),
            Operation::Carried(2),
            Operation::Carried(3),
            Operation::Not(at(0)),
            Operation::And(at(4), at(1)),
            Operation::Select(at(4), at(2), at(3)),
            Operation::Select(at(5), at(6), at(3)),
        ];
        let found = guards(&operations, &[true; 8], &[(at(7), None)]);
        let where_all = |literals: &[(Node, bool)]| Guard::always().and(&operations, literals);
        let of_inner = where_all(&[(at(0), false), (at(1), true)]);
        assert!([0, 4, 5, 7].iter().all(|&place: &usize| found[place].is_always()));
        assert_eq!((&*found[6], &*found[2]), (&of_inner, &of_inner), "the inner selection, and x");
        assert_eq!(*found[3], where_all(&[(at(5), false)]), "y: of the inner selection it is never asked for");
        assert_eq!(*found[1], where_all(&[(at(0), false)]), "b: where a doesn't decide");
        let of_message = guards(&operations, &[true; 8], &[(at(2), Some(at(0)))]);
        assert_eq!(*of_message[2], where_all(&[(at(0), true)]), "a message under a condition");
    }

    #[test]
    fn an_operand_is_what_a_selection_takes_wherever_it_is_needed() {
        let (at, sum) = (Node::at, |a, b| Operation::Binary(Binary::Add, Node::at(a), Node::at(b)));
        let select = |condition, yes, no| Operation::Select(Node::at(condition), Node::at(yes), Node::at(no));
        // c, x, y; then c ? x : y, its sum with y, and that sum where c doesn't hold, else x.
        let inputs = (0..3).map(Operation::Carried);
        let mut operations: Vec<_> = inputs.chain([select(0, 1, 2), sum(3, 2), select(0, 1, 4)]).collect();
        let found = followed(&operations, &[(at(5), None)]);
        assert_eq!((&found[4], &found[5]), (&sum(2, 2), &operations[5]));
        // With a second use of the sum, where c may hold, it stays.
        operations.push(sum(4, 5));
        assert_eq!(followed(&operations, &[(at(6), None)]), operations);
    }
}
