//! Selections that are written to their places in C where they are computed.

use std::collections::BTreeMap;
use std::mem::{replace, take};

use super::expression::{Expression, Kind};
use super::function::{Function, Scope};

/// Places in C by those of selections that are written there, each with the loops that read it.
pub type Targets = BTreeMap<usize, (String, Vec<usize>)>;

impl Function<'_> {
    /// Lines of an arm that give places and variables their values, but for those that places have.
    pub(super) fn given(&mut self, names: &[(String, Kind)], values: &[Expression]) -> String {
        let outer = take(&mut self.lines);
        self.indent += 1;
        for ((name, kind), value) in names.iter().zip(values) {
            let value = if *kind == Kind::Real { value.real() } else { value.whole() };
            let read = format!(" {} = {name};", value.text);
            let is_read = || self.declared.iter().any(|(_, line)| line.contains(&read));
            if value.text != *name && (self.is_written_by_loops(name) || !is_read()) {
                self.line(&format!("{name} = {};", value.text));
            }
        }
        self.indent -= 1;
        replace(&mut self.lines, outer)
    }

    /// The place in C that a selection is written to, if no loop that is still to come reads it: lines of blocks further in
    /// come later.
    pub(super) fn target(&self, place: usize, scope: &Scope) -> Option<String> {
        let (target, readers) = self.targets.get(&place)?;
        let is_innermost = scope.current + 1 == scope.open.len();
        (is_innermost && readers.iter().all(|reader| scope.found[*reader].is_some())).then(|| target.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::super::loops::Lanes;
    use super::super::names::Names;
    use super::*;
    use crate::recording::{Binary, Node, Operation};

    /// C of `a = c ? r·r·(r·r) : a`, `b = c ? r·r : 0`, with a loop that reads `a` or not and one that writes it or not.
    fn written(readers: Vec<usize>, is_written: bool) -> String {
        let (at, product) = (Node::at, |a, b| Operation::Binary(Binary::Mul, Node::at(a), Node::at(b)));
        let select = |yes, no| Operation::Select(Node::at(0), Node::at(yes), Node::at(no));
        let inputs = (0..3).map(Operation::Carried);
        let own = [Operation::Constant(0), product(2, 2), product(4, 4), select(5, 1), select(4, 3)];
        let operations: Vec<_> = inputs.chain(own).collect();
        let mut names = Names::default();
        let mut function = Function::new(&mut names, "bool");
        let given: Vec<Expression> =
            [("c", Kind::Whole, "c"), ("a", Kind::Real, "x->a[0]"), ("r", Kind::Real, "in->r")]
                .into_iter()
                .map(|(name, kind, text)| function.named(name, kind, text, ""))
                .collect();
        let of = |operation: &Operation| match operation {
            Operation::Carried(number) => given[*number as usize].clone(),
            _ => Expression::number(f64::NAN),
        };
        function.targets = [(6, ("x->a[0]".to_owned(), readers)), (7, ("x->b".to_owned(), Vec::new()))].into();
        let target = is_written.then(|| ("x->a".to_owned(), 0, 1));
        function.loops.insert(99, Lanes { count: 1, inputs: Vec::new(), targets: vec![target], call: None });
        function.compute(&operations, &[(at(6), None), (at(7), None)], &|_| None, &of);
        function.lines()
    }

    #[test]
    fn a_place_that_stays_as_it_is_is_not_written() {
        let text = written(Vec::new(), false);
        assert_eq!(text.matches("x->a[0] = ").count(), 1, "{text}");
        assert_eq!(text.matches("x->b = ").count(), 2, "{text}");
        assert!(!text.contains("const real a ="), "{text}");
    }

    #[test]
    fn a_place_that_a_loop_writes_gets_its_value_back() {
        let text = written(Vec::new(), true);
        assert!(text.contains("        x->a[0] = a;\n") && text.contains("const real a = x->a[0];"), "{text}");
    }

    #[test]
    fn a_place_that_a_later_loop_reads_is_not_written_yet() {
        let text = written(vec![0], false);
        assert_eq!(text.matches("x->a[0] = ").count(), 1, "the loop was before: {text}");
        let text = written(vec![7], false);
        assert!(!text.contains("x->a[0] = ") && text.contains("x->b = "), "{text}");
    }
}
