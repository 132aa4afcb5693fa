//! Places in C that results are written to where they are computed, not at the end of their function.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use super::functions::Written;
use super::lanes::Rolled;
use crate::fmi2::source::expression::Kind;
use crate::fmi2::source::loops::{Input, Loops, element, elements};
use crate::fmi2::source::written::Targets;
use crate::recording::{Node, Operation};

/// The operations and loops of a function, whose results have targets where these can be, and the targets of selections.
pub(super) fn of(rolled: Rolled, wanted: &[Node], written: &[Written]) -> (Vec<Operation>, Loops, Targets) {
    let Rolled { operations, moved, mut loops } = rolled;
    let moved = |node: &Node| moved[node.index()];
    let uses = uses(&operations, wanted.iter().filter_map(moved));
    let is_part = |node: Node| matches!(operations[node.index()], Operation::Part(..)) && uses[node.index()] == 1;
    let (mut selections, mut of_parts) = (BTreeMap::new(), HashMap::new());
    for one in written {
        // A whole number that isn't a condition may be computed as a real one.
        let is_number = one.kind == Kind::Whole && one.name.is_some();
        let Some(node) = moved(&one.node).filter(|_| !is_number) else { continue };
        let readers = readers_of(&one.to, &loops).filter(|_| one.kind == Kind::Real);
        if is_part(node) {
            of_parts.insert(node, one.to.clone());
        }
        if let (Operation::Select(_, yes, no), Some(readers), 1) =
            (&operations[node.index()], readers, uses[node.index()])
        {
            selections.insert(node.index(), (one.to.clone(), readers));
            of_parts.extend([yes, no].into_iter().filter(|arm| is_part(**arm)).map(|arm| (*arm, one.to.clone())));
        }
    }
    let mut parts: BTreeMap<(usize, usize), BTreeMap<usize, &str>> = BTreeMap::new();
    for (place, operation) in operations.iter().enumerate() {
        if let (Operation::Part(from, number), Some(to)) = (operation, of_parts.get(&Node::at(place)))
            && let Some(lanes) = loops.get(&from.index()).filter(|lanes| lanes.call.is_none())
        {
            let (result, lane) = (*number as usize / lanes.count, *number as usize % lanes.count);
            parts.entry((from.index(), result)).or_default().insert(lane, to);
        }
    }
    let mut found = Vec::new();
    for ((place, result), texts) in parts {
        if let Some(target) = elements(texts.values().copied())
            && texts.len() == loops[&place].count
            && may_be_written(&target, place, &loops)
        {
            found.push((place, result, target));
        }
    }
    for (place, result, target) in found {
        loops.get_mut(&place).expect("it is there").targets[result] = Some(target);
    }
    (operations, loops, selections)
}

/// Selections that nothing reads but as whole numbers: those that are wanted so, and their arms.
pub(super) fn whole(
    operations: &[Operation],
    written: impl Iterator<Item = Node>,
    wanted: impl Iterator<Item = Node>,
) -> BTreeSet<usize> {
    let uses = uses(operations, wanted);
    let (mut left, mut found) = (written.collect::<Vec<_>>(), BTreeSet::new());
    while let Some(node) = left.pop() {
        if let (Operation::Select(_, yes, no), 1) = (&operations[node.index()], uses[node.index()]) {
            found.insert(node.index());
            left.extend([yes, no]);
        }
    }
    found
}

/// Number of uses of each operation.
fn uses(operations: &[Operation], wanted: impl Iterator<Item = Node>) -> Vec<usize> {
    let mut uses = vec![0; operations.len()];
    wanted.chain(operations.iter().flat_map(Operation::operands)).for_each(|node| uses[node.index()] += 1);
    uses
}

/// The loops that read an array, with the element of the first lane, and those from lane to lane.
fn readers(array: &str, loops: &Loops) -> BTreeSet<(usize, usize, usize)> {
    let mut all = BTreeSet::new();
    for (place, lanes) in loops {
        for input in &lanes.inputs {
            match input {
                Input::Elements((other, first, step), _) if other == array => _ = all.insert((*place, *first, *step)),
                _ => {}
            }
        }
    }
    all
}

/// The loops that read a place; none where it is no place that is written at the end. What isn't read by loops is read where a
/// function begins.
fn readers_of(to: &str, loops: &Loops) -> Option<Vec<usize>> {
    let is_one = ["dx->", "c->", "y->", "x->", "d->"].iter().any(|pointer| to.starts_with(pointer));
    let readers = readers(element(to).map_or(to, |(array, _)| array), loops);
    is_one.then(|| readers.into_iter().map(|(place, ..)| place).collect())
}

/// True if a loop may write its results to an array: no other loop reads that, and this one in each lane what it writes there.
fn may_be_written((array, first, step): &(String, usize, usize), place: usize, loops: &Loops) -> bool {
    let is_state = array.starts_with("x->") || array.starts_with("d->");
    let is_own = |reader: &(usize, usize, usize)| *reader == (place, *first, *step);
    ["dx->", "c->", "y->"].iter().any(|pointer| array.starts_with(pointer))
        || is_state && readers(array, loops).iter().all(is_own)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fmi2::source::loops::Lanes;

    #[test]
    fn a_loop_writes_to_states_only_where_no_other_lane_or_loop_reads_them() {
        let reads = |array: &str, first| {
            let inputs = vec![Input::Elements((array.to_owned(), first, 1), Kind::Real)];
            Lanes { count: 3, inputs, targets: Vec::new(), call: None }
        };
        let loops = Loops::from([(4, reads("x->own", 0)), (5, reads("x->neighbour", 1)), (9, reads("x->read", 0))]);
        let may = |array: &str| may_be_written(&(array.to_owned(), 0, 1), 4, &loops);
        assert!(may("x->own") && may("x->unread") && may("d->unread") && may("dx->x"));
        assert!(!may("x->neighbour") && !may("x->read") && !may("p->gain"));
        // Where another loop reads them, too, its own lane's reading isn't all.
        let loops = Loops::from([(4, reads("x->own", 0)), (9, reads("x->own", 0))]);
        assert!(!may_be_written(&("x->own".to_owned(), 0, 1), 4, &loops));
    }
}
