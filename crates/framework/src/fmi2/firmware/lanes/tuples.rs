//! Operations that are alike, one a lane, and what they read.

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::rc::Rc;

use super::Known;
use crate::fmi2::source::blocks::is_total;
use crate::fmi2::source::loops::elements;
use crate::recording::{Binary, Guard, Node, Operation, Unary, guards, needed};

/// Bytes of code, about: of a number that a loop reads in an array of its own, and of a result, for each lane; of an operation, and of the
/// loop. Where a function is called again and again in a step, what a loop saves counts less, as it takes time.
const OF_READ: usize = 8;
const OF_RESULT: usize = 4;
const ONCE: [usize; 2] = [10, 40];
const REPEATED: [usize; 2] = [5, 60];
/// More rounds than that mean that loops follow from each other.
const MOST_ROUNDS: usize = 60;

/// Operations that are alike, one a lane.
#[derive(Debug, Clone)]
pub(super) struct Tuple {
    pub nodes: Vec<Node>,
    pub operands: Vec<Operand>,
    /// The condition under which its loop is needed.
    pub home: Rc<Guard>,
    /// Loops before its own that it follows from.
    pub level: usize,
}

/// An operand of each lane: computed in the loop, or read by it.
#[derive(Debug, Clone)]
pub(super) enum Operand {
    Computed(usize),
    Read(Vec<Node>),
}

/// A search among operations.
pub(super) struct Search<'a> {
    pub operations: &'a [Operation],
    pub wanted: &'a [Node],
    pub needed: Vec<bool>,
    pub guards: Vec<Rc<Guard>>,
    pub tuples: Vec<Option<Tuple>>,
    /// The tuple and the lane of each operation that has one.
    pub owners: HashMap<Node, (usize, usize)>,
}

/// Operations that look alike from above have one number.
pub(super) fn shape(operations: &[Operation], node: Node) -> u64 {
    fn mix(operations: &[Operation], node: Node, depth: u32, hasher: &mut DefaultHasher) {
        let operation = &operations[node.index()];
        if operation.operands().next().is_none() {
            return 0.hash(hasher);
        }
        operation.over(|_| Node::at(0)).hash(hasher);
        if depth > 0 {
            operation.operands().for_each(|operand| mix(operations, operand, depth - 1, hasher));
        }
    }
    let mut hasher = DefaultHasher::new();
    mix(operations, node, 3, &mut hasher);
    hasher.finish()
}

impl<'a> Search<'a> {
    pub fn of(operations: &'a [Operation], wanted: &'a [Node]) -> Self {
        let all: Vec<_> = wanted.iter().map(|&node| (node, None)).collect();
        let needed = needed(operations, wanted);
        let guards = guards(operations, &needed, &all);
        Search { operations, wanted, needed, guards, tuples: Vec::new(), owners: HashMap::new() }
    }

    /// The tuple of some nodes, with those of their operands; none where they aren't alike.
    pub fn expand(&mut self, nodes: &[Node], home: &Rc<Guard>) -> Option<usize> {
        if let Some(&(number, 0)) = self.owners.get(&nodes[0])
            && let Some(known) = &self.tuples[number]
            && known.nodes == nodes
        {
            return (known.home == *home).then_some(number);
        }
        if !self.are_alike(nodes) {
            return None;
        }
        // What is needed elsewhere, too, has a loop of its own.
        let own = Rc::clone(&self.guards[nodes[0].index()]);
        if !nodes.iter().all(|node| self.guards[node.index()].implies(home)) {
            if nodes.iter().all(|node| self.guards[node.index()].implies(&own)) {
                self.expand(nodes, &own);
            }
            return None;
        }
        let number = self.tuples.len();
        self.tuples.push(None);
        nodes.iter().enumerate().for_each(|(lane, &node)| _ = self.owners.insert(node, (number, lane)));
        let of_lanes: Vec<Vec<Node>> = nodes.iter().map(|node| self.operands(*node)).collect();
        let operands = (0..of_lanes[0].len()).map(|k| {
            let each: Vec<Node> = of_lanes.iter().map(|lane| lane[k]).collect();
            self.expand(&each, home).map_or(Operand::Read(each), Operand::Computed)
        });
        let operands = operands.collect();
        self.tuples[number] = Some(Tuple { nodes: nodes.to_vec(), operands, home: Rc::clone(home), level: 0 });
        Some(number)
    }

    fn operands(&self, node: Node) -> Vec<Node> {
        self.operations[node.index()].operands().collect()
    }

    /// True for one operation on different numbers, none of which follows from another lane's result.
    fn are_alike(&self, nodes: &[Node]) -> bool {
        let operation = |node: &Node| &self.operations[node.index()];
        let alone =
            matches!(operation(&nodes[0]), Operation::Opaque(..) | Operation::Iterate { .. } | Operation::Part(..))
                || operation(&nodes[0]).operands().next().is_none();
        let kind = operation(&nodes[0]).over(|_| Node::at(0));
        !alone
            && nodes.iter().all(|node| !self.owners.contains_key(node) && operation(node).over(|_| Node::at(0)) == kind)
            && nodes.iter().enumerate().all(|(k, node)| !nodes[..k].contains(node))
            && !self.depends(nodes)
    }

    /// True if one of some nodes follows from another.
    fn depends(&self, nodes: &[Node]) -> bool {
        let first = nodes.iter().map(|node| node.index()).min().unwrap_or(0);
        let mut seen = vec![false; self.operations.len()];
        let mut left: Vec<Node> = nodes.iter().flat_map(|node| self.operands(*node)).collect();
        while let Some(node) = left.pop() {
            if nodes.contains(&node) {
                return true;
            }
            if node.index() > first && !std::mem::replace(&mut seen[node.index()], true) {
                left.extend(self.operations[node.index()].operands());
            }
        }
        false
    }

    /// Takes back what can't be in a loop, or isn't worth it.
    pub fn settle(&mut self, known: &Known) {
        loop {
            if !self.find_levels() {
                (self.tuples, self.owners) = (Vec::new(), HashMap::new());
                return;
            }
            self.part_loops();
            let wrong = self.wrong(known);
            let left_out = if wrong.is_empty() { self.not_worth_it(known) } else { wrong };
            if left_out.is_empty() {
                return;
            }
            left_out.into_iter().for_each(|number| self.remove(number));
        }
    }

    /// Finds how many loops come before each; false where they follow from each other.
    fn find_levels(&mut self) -> bool {
        self.tuples.iter_mut().flatten().for_each(|tuple| tuple.level = 0);
        let mut available = vec![0_usize; self.operations.len()];
        for _ in 0..MOST_ROUNDS {
            let before: Vec<usize> =
                self.tuples.iter().map(|tuple| tuple.as_ref().map_or(0, |one| one.level)).collect();
            for place in 0..self.operations.len() {
                let of = |node: Node| available[node.index()];
                available[place] = match self.owners.get(&Node::at(place)) {
                    Some((number, _)) => before[*number] + 1,
                    None => self.operations[place].operands().map(of).max().unwrap_or(0),
                };
            }
            for number in 0..self.tuples.len() {
                let Some(tuple) = &self.tuples[number] else { continue };
                let of = |operand: &Operand| match operand {
                    Operand::Computed(other) => before[*other],
                    Operand::Read(nodes) => nodes.iter().map(|node| available[node.index()]).max().unwrap_or(0),
                };
                let level = tuple.operands.iter().map(of).max().unwrap_or(0);
                self.tuples[number].as_mut().expect("it is there").level = level;
            }
            if self
                .tuples
                .iter()
                .zip(before)
                .all(|(tuple, before)| tuple.as_ref().is_none_or(|one| one.level == before))
            {
                self.move_to_users();
                return true;
            }
        }
        false
    }

    /// Moves to later loops what only these read.
    fn move_to_users(&mut self) {
        let outside = self.read_outside();
        for _ in 0..MOST_ROUNDS {
            let mut first: Vec<Option<usize>> = vec![None; self.tuples.len()];
            for tuple in self.tuples.iter().flatten() {
                for operand in &tuple.operands {
                    if let Operand::Computed(of) = operand {
                        first[*of] = Some(first[*of].map_or(tuple.level, |level| level.min(tuple.level)));
                    }
                }
            }
            let mut is_moved = false;
            for (number, tuple) in self.tuples.iter_mut().enumerate() {
                if let (Some(tuple), Some(level), false) = (tuple, first[number], outside[number]) {
                    is_moved |= level != tuple.level;
                    tuple.level = level;
                }
            }
            if !is_moved {
                return;
            }
        }
    }

    /// True for tuples that something reads besides others, lane by lane.
    pub fn read_outside(&self) -> Vec<bool> {
        let mut outside = vec![false; self.tuples.len()];
        let mut read = |node: &Node| {
            if let Some((number, _)) = self.owners.get(node) {
                outside[*number] = true;
            }
        };
        self.wanted.iter().for_each(&mut read);
        for place in (0..self.operations.len()).filter(|&place| self.needed[place]) {
            if !self.owners.contains_key(&Node::at(place)) {
                self.operations[place].operands().for_each(|node| read(&node));
            }
        }
        for operand in self.tuples.iter().flatten().flat_map(|tuple| &tuple.operands) {
            if let Operand::Read(nodes) = operand {
                nodes.iter().for_each(&mut read);
            }
        }
        outside
    }

    /// A loop reads what another one computes.
    fn part_loops(&mut self) {
        let of: Vec<Option<(usize, Vec<Node>)>> =
            self.tuples.iter().map(|tuple| tuple.as_ref().map(|one| (one.level, one.nodes.clone()))).collect();
        for tuple in self.tuples.iter_mut().flatten() {
            for operand in &mut tuple.operands {
                if let Operand::Computed(number) = operand
                    && let Some((level, nodes)) = &of[*number]
                    && *level != tuple.level
                {
                    *operand = Operand::Read(nodes.clone());
                }
            }
        }
    }

    /// Tuples whose results can't be in an array, or that read what isn't there wherever their loop is needed.
    fn wrong(&self, known: &Known) -> Vec<usize> {
        let outside = self.read_outside();
        let is_wrong = |number: &usize| {
            let Some(tuple) = &self.tuples[*number] else { return false };
            let mut found = HashMap::new();
            let mut are_there =
                |nodes: &[Node]| nodes.iter().all(|node| self.is_there(*node, &tuple.home, known, &mut found));
            outside[*number] && !are_there(&tuple.nodes)
                || tuple.operands.iter().any(|operand| matches!(operand, Operand::Read(nodes) if !are_there(nodes)))
        };
        (0..self.tuples.len()).filter(is_wrong).collect()
    }

    /// True if a node is needed wherever a loop is, or can be computed there all the same.
    fn is_there(&self, node: Node, home: &Guard, known: &Known, found: &mut HashMap<Node, bool>) -> bool {
        if home.implies(&self.guards[node.index()]) {
            return true;
        }
        if let Some(is) = found.get(&node) {
            return *is;
        }
        let operation = &self.operations[node.index()];
        let owner = self.owners.get(&node).and_then(|(number, _)| self.tuples[*number].as_ref());
        let is_root = matches!(operation, Operation::Unary(Unary::Sqrt, of) if self.is_positive(*of, known));
        let mut are_operands = || operation.operands().all(|operand| self.is_there(operand, home, known, found));
        let is = match owner {
            // Another loop's results are there wherever that is.
            Some(owner) if *owner.home != *home => home.implies(&owner.home),
            _ => (is_total(operation) || is_root) && are_operands(),
        };
        found.insert(node, is);
        is
    }

    /// True for a number that has a root, whatever parameters are.
    fn is_positive(&self, node: Node, known: &Known) -> bool {
        match &self.operations[node.index()] {
            Operation::Binary(Binary::Add | Binary::Mul, a, b) => {
                [a, b].into_iter().all(|&of| self.is_positive(of, known))
            }
            operation => (known.least)(operation).is_some_and(|least| least >= 0.0),
        }
    }

    /// Those of loops that take more than they save: bytes of code, about.
    fn not_worth_it(&self, known: &Known) -> Vec<usize> {
        let outside = self.read_outside();
        for number in 0..self.tuples.len() {
            if self.tuples[number].is_none() {
                continue;
            }
            let all = self.with(number);
            let count = self.tuples[number].as_ref().map_or(0, |one| one.nodes.len());
            let results = all.iter().filter(|&&number| outside[number]).count();
            let mut read: Vec<&Vec<Node>> = Vec::new();
            for operand in all.iter().filter_map(|&number| self.tuples[number].as_ref()).flat_map(|one| &one.operands) {
                match operand {
                    Operand::Read(nodes) if self.is_gathered(nodes, known) && !read.contains(&nodes) => {
                        read.push(nodes)
                    }
                    _ => {}
                }
            }
            let [of_operation, overhead] = if known.is_repeated { REPEATED } else { ONCE };
            let taken = OF_READ * count * read.len() + OF_RESULT * count * results + overhead;
            if of_operation * (count - 1) * all.len() <= taken {
                return all;
            }
        }
        Vec::new()
    }

    /// The tuples of one loop.
    pub fn with(&self, number: usize) -> Vec<usize> {
        let Some(one) = &self.tuples[number] else { return Vec::new() };
        let is_one =
            |other: &Tuple| other.level == one.level && other.nodes.len() == one.nodes.len() && other.home == one.home;
        (0..self.tuples.len()).filter(|&other| self.tuples[other].as_ref().is_some_and(is_one)).collect()
    }

    /// True for numbers that have to be written into an array.
    fn is_gathered(&self, nodes: &[Node], known: &Known) -> bool {
        let operations = || nodes.iter().map(|node| &self.operations[node.index()]);
        let is_one = nodes.windows(2).all(|pair| pair[0] == pair[1]);
        let is_loop = self
            .owners
            .get(&nodes[0])
            .is_some_and(|(number, _)| self.tuples[*number].as_ref().is_some_and(|tuple| tuple.nodes == nodes));
        let texts: Option<Vec<(String, _)>> = operations().map(|one| (known.element)(one)).collect();
        // Constants of a step that are read so are written so.
        let are_constants = operations().all(|one| matches!(one, Operation::Carried(_)));
        let is_array =
            are_constants || texts.is_some_and(|all| elements(all.iter().map(|one| one.0.as_str())).is_some());
        !(is_one || is_loop || is_array || operations().all(|one| (known.number)(one).is_some()))
    }

    fn remove(&mut self, number: usize) {
        let Some(removed) = self.tuples[number].take() else { return };
        removed.nodes.iter().for_each(|node| _ = self.owners.remove(node));
        for operand in self.tuples.iter_mut().flatten().flat_map(|tuple| &mut tuple.operands) {
            if matches!(operand, Operand::Computed(other) if *other == number) {
                *operand = Operand::Read(removed.nodes.clone());
            }
        }
    }
}
