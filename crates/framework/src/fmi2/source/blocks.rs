//! Blocks of operations: the function itself, and arms of selections with what only they use. Such an arm is computed where the
//! selection takes it, and nowhere else.

use std::collections::BTreeMap;
use std::rc::Rc;

use crate::recording::{Binary, Guard, Literal, Node, Operation, Unary, decided, followed, guards, literals, needed};

/// A node that is wanted, and the condition under which it is.
pub type Wanted = (Node, Option<Node>);

/// A block: [`ROOT`], or an arm of the selection at a place.
pub type Block = usize;

/// The function, or an iteration's body, itself.
pub const ROOT: Block = usize::MAX;
/// The block of operations that only arms ask for that are never taken.
const NOWHERE: Block = ROOT - 1;

/// Selections within more arms than that have none: compilers have limits, and readers.
const DEEPEST: usize = 16;
/// Rounds in which operations find their places.
const MOST_ROUNDS: usize = 100;

/// The arm that a selection takes where its condition holds, or where it doesn't.
pub fn arm(selection: usize, holds: bool) -> Block {
    2 * selection + usize::from(!holds)
}

/// Blocks of operations.
pub struct Blocks {
    of: Vec<Block>,
    /// Conditions that are left to ask for where an operation is needed, once its block is entered.
    guards: Vec<Rc<Guard>>,
    /// Operations of each block, in their order.
    within: BTreeMap<Block, Vec<usize>>,
    /// Selections whose arms have what nothing else uses.
    arms: Vec<bool>,
    /// The selection whose arms each of them shares: the last one of a group with one condition.
    last: Vec<usize>,
    /// Selections whose condition follows from their block.
    decided: BTreeMap<usize, bool>,
}

impl Blocks {
    /// Places operations that are needed for what is wanted, perhaps under a condition. Conditions of guards must be known where what they
    /// guard is computed, if that may be guarded.
    pub fn of(
        operations: &[Operation],
        needed: &[bool],
        wanted: &[Wanted],
        may_be_guarded: &dyn Fn(usize) -> bool,
    ) -> Self {
        let whole = guards(operations, needed, wanted);
        let mut found = Blocks {
            of: vec![ROOT; operations.len()],
            guards: whole.clone(),
            within: BTreeMap::new(),
            arms: vec![false; operations.len()],
            last: (0..operations.len()).collect(),
            decided: BTreeMap::new(),
        };
        // Where guards ask for conditions, these move outwards with their operands: at most until all is outside.
        let mut asked: Vec<(usize, Node)> = Vec::new();
        for _ in 0..MOST_ROUNDS {
            let before = found.of.clone();
            found.place(operations, needed, wanted, &whole, &asked);
            let mut more = asked.clone();
            let stands = |place: &usize| needed[*place] && found.of[*place] != NOWHERE;
            for place in (0..operations.len()).filter(stands).filter(|&place| may_be_guarded(place)) {
                more.extend(found.guards[place].terms().flatten().map(|literal| (place, literal.0)));
            }
            more.sort_unstable();
            more.dedup();
            if more == asked && found.of == before {
                break;
            }
            asked = more;
        }
        for place in (0..operations.len()).filter(|&place| needed[place] && found.of[place] != NOWHERE) {
            found.within.entry(found.of[place]).or_default().push(place);
        }
        found
    }

    /// True if operations that only an arm of a selection uses are placed there.
    pub fn has_arms(&self, selection: usize) -> bool {
        self.arms[selection]
    }

    /// The selection whose arms a selection shares.
    pub fn shared(&self, selection: usize) -> usize {
        self.last[selection]
    }

    /// Selections that share their arms, in their order.
    pub fn group(&self, selection: usize) -> Vec<usize> {
        let last = self.last[selection];
        let is_member = |place: &usize| self.arms[*place] && self.last[*place] == last;
        self.within.get(&self.of[last]).map_or_else(Vec::new, |all| all.iter().copied().filter(is_member).collect())
    }

    /// The block of an operation.
    pub fn block(&self, place: usize) -> Block {
        self.of[place]
    }

    /// Conditions that are left to ask for where an operation is needed.
    pub fn guard(&self, place: usize) -> Rc<Guard> {
        Rc::clone(&self.guards[place])
    }

    /// True or false for a selection whose condition follows from its block.
    pub fn decided(&self, selection: usize) -> Option<bool> {
        self.decided.get(&selection).copied()
    }

    /// Operations of a block, in their order.
    pub fn places(&self, block: Block) -> Vec<usize> {
        self.within.get(&block).cloned().unwrap_or_default()
    }

    /// Finds the innermost block that has all uses of each operation, users first.
    fn place(
        &mut self,
        operations: &[Operation],
        needed: &[bool],
        wanted: &[Wanted],
        whole: &[Rc<Guard>],
        asked: &[(usize, Node)],
    ) {
        let before = self.of.clone();
        let mut asking: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        asked.iter().for_each(|(guarded, node)| asking.entry(node.index()).or_default().push(*guarded));
        let mut uses: Vec<Option<Block>> = vec![None; operations.len()];
        let mut users: Vec<Vec<usize>> = vec![Vec::new(); operations.len()];
        let mut groups: BTreeMap<(Node, Block), usize> = BTreeMap::new();
        wanted
            .iter()
            .flat_map(|(node, condition)| [Some(*node), *condition])
            .flatten()
            .for_each(|node| uses[node.index()] = Some(ROOT));
        for place in (0..operations.len()).rev().filter(|&place| needed[place]) {
            let mut block = uses[place];
            for &guarded in asking.get(&place).into_iter().flatten() {
                // Arms of selections that come before this operation were found in the last round.
                let mut outer = before[guarded];
                while outer < NOWHERE && outer / 2 <= place {
                    outer = before[outer / 2];
                }
                if outer == NOWHERE {
                    continue;
                }
                block = Some(block.map_or(outer, |block| self.common(block, outer)));
            }
            self.of[place] = block.unwrap_or(NOWHERE);
            let Some(block) = block else { continue };
            let (known, depth) = self.known(operations, block);
            self.guards[place] = Rc::new(whole[place].within(operations, &known));
            let has_arms = self.guards[place].is_always() && depth < DEEPEST;
            self.arms[place] = has_arms;
            self.last[place] = place;
            if let Operation::Select(condition, ..) = operations[place]
                && has_arms
            {
                let group = groups.entry((condition, block)).or_insert(place);
                // What follows from it in this block comes after all of the group.
                let is_after = |user: &usize| self.emitted(*user, block) > *group;
                if asking.contains_key(&place) || !users[place].iter().all(is_after) {
                    *group = place;
                }
                self.last[place] = *group;
            }
            let shared = self.last[place];
            let mut ask = |of: &Self, node: Node, block: Block| {
                users[node.index()].push(place);
                let known = &mut uses[node.index()];
                *known = Some(known.map_or(block, |known| of.common(known, block)));
            };
            match &operations[place] {
                Operation::Select(condition, yes, no) => match decided(operations, *condition, &known) {
                    Some(holds) => {
                        self.decided.insert(place, holds);
                        ask(self, if holds { *yes } else { *no }, block);
                    }
                    None => {
                        self.decided.remove(&place);
                        ask(self, *condition, block);
                        ask(self, *yes, if has_arms { arm(shared, true) } else { block });
                        ask(self, *no, if has_arms { arm(shared, false) } else { block });
                    }
                },
                operation => operation.operands().for_each(|operand| ask(self, operand, block)),
            }
        }
    }

    /// The place in a block at which an operation is computed, which may be within arms there.
    fn emitted(&self, place: usize, block: Block) -> usize {
        let (mut at, mut own) = (self.last[place], self.of[place]);
        while own != block && own < NOWHERE {
            (at, own) = (own / 2, self.of[own / 2]);
        }
        at
    }

    /// The innermost block that contains both: that of a later selection is further out.
    fn common(&self, mut one: Block, mut other: Block) -> Block {
        while one != other {
            let inner = if one < other { &mut one } else { &mut other };
            *inner = self.of[*inner / 2];
        }
        one
    }

    /// Literals that hold in a block, and the number of arms that it is within.
    fn known(&self, operations: &[Operation], mut block: Block) -> (Vec<Literal>, usize) {
        let (mut known, mut depth) = (Vec::new(), 0);
        while block < NOWHERE {
            let Operation::Select(condition, ..) = operations[block / 2] else { break };
            known.extend(literals(operations, (condition, block.is_multiple_of(2))));
            (block, depth) = (self.of[block / 2], depth + 1);
        }
        (known, depth)
    }
}

/// Operations that are needed for what is wanted.
pub struct Placed {
    /// The operations; some have operands that come sooner, where these have the same value.
    pub operations: Vec<Operation>,
    /// Number of uses of each.
    pub uses: Vec<u32>,
    /// Their blocks.
    pub blocks: Blocks,
}

/// Places what is needed.
pub fn placed(operations: &[Operation], wanted: &[Wanted]) -> Placed {
    let operations = followed(operations, wanted);
    let nodes: Vec<Node> = wanted.iter().map(|wanted| wanted.0).collect();
    // What results of conditions are wanted for is needed, too.
    let conditions = wanted.iter().filter_map(|wanted| wanted.1);
    let needed = needed(&operations, &nodes.iter().copied().chain(conditions).collect::<Vec<_>>());
    let uses = uses(&operations, &needed, &nodes);
    let partial = partial(&operations, &uses);
    Placed { blocks: Blocks::of(&operations, &needed, wanted, &|place| partial[place]), uses, operations }
}

/// True for operations that may be undefined for some numbers, themselves or in an operand without a name.
fn partial(operations: &[Operation], uses: &[u32]) -> Vec<bool> {
    let mut found = vec![false; operations.len()];
    for (place, operation) in operations.iter().enumerate() {
        found[place] =
            !is_total(operation) || operation.operands().any(|node| found[node.index()] && uses[node.index()] <= 1);
    }
    found
}

/// True for an operation that is defined for all numbers, and whose result is a number; for a loop over lanes, of such operations.
pub fn is_total(operation: &Operation) -> bool {
    if let Operation::Iterate { body, start, .. } = operation {
        return start.is_empty() && body.operations.iter().all(is_total);
    }
    matches!(
        operation,
        Operation::Constant(_)
            | Operation::Leaf(_)
            | Operation::Part(..)
            | Operation::Carried(_)
            | Operation::Unary(Unary::Neg | Unary::Abs | Unary::Signum, _)
            | Operation::Binary(Binary::Add | Binary::Sub | Binary::Mul, ..)
            | Operation::Compare(..)
            | Operation::Not(_)
            | Operation::And(..)
            | Operation::Or(..)
            | Operation::Select(..)
    )
}

/// Number of uses of each operation: by others, and by what is wanted. What a loop reads, and a square, counts more
/// than once.
fn uses(operations: &[Operation], needed: &[bool], wanted: &[Node]) -> Vec<u32> {
    let mut uses = vec![0; operations.len()];
    wanted.iter().for_each(|node| uses[node.index()] += 1);
    for (operation, _) in operations.iter().zip(needed).filter(|(_, needed)| **needed) {
        let often = if matches!(operation, Operation::Iterate { .. } | Operation::Powi(..)) { 2 } else { 1 };
        operation.operands().for_each(|operand| uses[operand.index()] += often);
    }
    uses
}

#[cfg(test)]
mod tests {
    use super::{Blocks, NOWHERE, ROOT, arm};
    use crate::recording::{Binary, Node, Operation};

    fn blocks(operations: &[Operation], wanted: usize, partial: &[usize]) -> Blocks {
        Blocks::of(operations, &vec![true; operations.len()], &[(Node::at(wanted), None)], &|place| {
            partial.contains(&place)
        })
    }

    fn sum(a: usize, b: usize) -> Operation {
        Operation::Binary(Binary::Add, Node::at(a), Node::at(b))
    }

    fn select(condition: usize, yes: usize, no: usize) -> Operation {
        Operation::Select(Node::at(condition), Node::at(yes), Node::at(no))
    }

    #[test]
    fn what_only_one_arm_uses_is_there_and_what_both_use_before_the_selection() {
        // c, d, x, y; then x + x, its sum with y, d ? (x + x) + y : y + y, and c ? that : x + x.
        let inputs = (0..4).map(Operation::Carried);
        let rest = [sum(2, 2), sum(4, 3), sum(3, 3), select(1, 5, 6), select(0, 7, 4)];
        let found = blocks(&inputs.chain(rest).collect::<Vec<_>>(), 8, &[]);
        let outer = arm(8, true);
        let expected = [ROOT, outer, ROOT, outer, ROOT, arm(7, true), arm(7, false), outer, ROOT];
        assert_eq!((0..9).map(|place| found.block(place)).collect::<Vec<_>>(), expected);
        assert_eq!(found.places(outer), [1, 3, 7]);
        // Within their blocks all are needed but x and its sum: neither where c holds and d doesn't.
        assert!((0..9).all(|place| found.guard(place).is_always() != [2, 4].contains(&place)));
    }

    #[test]
    fn selections_with_one_condition_share_their_arms_where_nothing_between_them_follows_from_the_first() {
        // c, x, y; then x + y, c ? x + y : x, c ? y : x + y, and a sum of the selections.
        let inputs = || (0..3).map(Operation::Carried);
        let pair = [sum(1, 2), select(0, 3, 1), select(0, 2, 3), sum(4, 5)];
        let found = blocks(&inputs().chain(pair).collect::<Vec<_>>(), 6, &[]);
        assert_eq!((found.group(4), found.shared(4)), (vec![4, 5], 5));
        // What both selections need in one arm is there: x + y where c holds, x + x where it doesn't.
        let rest = [sum(1, 2), sum(1, 1), select(0, 3, 4), select(0, 3, 4), sum(5, 6)];
        let found = blocks(&inputs().chain(rest).collect::<Vec<_>>(), 7, &[]);
        assert_eq!([found.block(3), found.block(4)], [arm(6, true), arm(6, false)]);
        // The second one needs a number that follows from the first.
        let chain = [select(0, 1, 2), sum(3, 1), select(0, 4, 2), sum(3, 5)];
        let found = blocks(&inputs().chain(chain).collect::<Vec<_>>(), 6, &[]);
        assert_eq!((found.group(3), found.group(5)), (vec![3], vec![5]));
    }

    #[test]
    fn a_selection_whose_condition_is_that_of_its_arm_takes_its_operand() {
        // c, x, y; c ? x : y within c ? … : x, where y is never needed.
        let operations: Vec<Operation> =
            (0..3).map(Operation::Carried).chain([select(0, 1, 2), select(0, 3, 1)]).collect();
        let found = blocks(&operations, 4, &[]);
        assert_eq!((found.decided(3), found.decided(4)), (Some(true), None));
        assert_eq!([found.block(1), found.block(2), found.block(3)], [ROOT, NOWHERE, arm(4, true)]);
    }

    #[test]
    fn conditions_of_a_guard_are_known_where_it_asks() {
        // c, d, x; then !d, x + x, which may have no result, !d ? x + x : x, c ? that : x, and c ? x : x + x. Of the two arms that use the
        // sum one is within !d: d must be known where the sum is computed.
        let rest =
            [Operation::Not(Node::at(1)), sum(2, 2), select(3, 4, 2), select(0, 5, 2), select(0, 2, 4), sum(6, 7)];
        let operations: Vec<Operation> = (0..3).map(Operation::Carried).chain(rest).collect();
        let found = blocks(&operations, 8, &[4]);
        assert_eq!((found.block(4), found.block(1)), (ROOT, ROOT));
        assert!(!found.guard(4).is_always());
        // Both selections by c share their arms.
        assert_eq!(blocks(&operations, 8, &[]).block(1), arm(7, true));
    }

    #[test]
    fn what_can_not_be_needed_is_nowhere_and_asks_for_nothing() {
        // a, b, x, y; then a && b, x / y, a && b ? x / y : y, its sum with x, and a && b ? x : that sum.
        let quotient = Operation::Binary(Binary::Div, Node::at(2), Node::at(3));
        let both = Operation::And(Node::at(0), Node::at(1));
        let rest = [both, quotient, select(4, 5, 3), sum(6, 2), select(4, 2, 7)];
        let operations: Vec<Operation> = (0..4).map(Operation::Carried).chain(rest).collect();
        let found = blocks(&operations, 8, &[5]);
        assert_eq!((found.block(5), found.decided(6)), (NOWHERE, Some(false)));
    }

    #[test]
    fn long_chains_of_selections_are_flat_behind_some() {
        // c, x; then c_k ? sum : rest, a hundred times, with conditions of their own.
        let mut operations: Vec<Operation> = (0..101).map(Operation::Carried).collect();
        let mut rest = 100;
        for k in 0..100 {
            operations.push(sum(rest, 100));
            operations.push(select(k, 100, operations.len() - 1));
            rest = operations.len() - 1;
        }
        let found = blocks(&operations, rest, &[]);
        let with_arms = (0..operations.len()).filter(|&place| found.has_arms(place) && place > 100);
        assert!(
            with_arms.filter(|place| matches!(operations[*place], Operation::Select(..))).count() <= super::DEEPEST
        );
    }
}
