//! Expressions of operations.

use std::f64::consts::TAU;

use super::expression::Expression;
use super::function::Scope;
use crate::recording::{Binary, Node, Operation, Unary};
use crate::scalar::Opaque;

/// The expression of an operation whose operands have theirs.
pub(super) fn expression(operation: &Operation, scope: &Scope) -> Expression {
    let of = |node: &Node| scope.of(*node);
    if let Some(angle) = turned(operation, scope.operations, scope.named) {
        return Expression::of_one("turns", of(&angle));
    }
    match operation {
        Operation::Constant(bits) => Expression::number(f64::from_bits(*bits)),
        Operation::Unary(function, a) => Expression::unary(*function, of(a)),
        Operation::Binary(operation, a, b) => Expression::binary(*operation, of(a), of(b)),
        Operation::Powi(a, exponent) => Expression::powi(of(a), *exponent),
        Operation::Powf(a, bits) => Expression::powf(of(a), f64::from_bits(*bits)),
        Operation::Compare(comparison, a, b) => Expression::compare(*comparison, of(a), of(b)),
        Operation::Not(a) => Expression::not(of(a)),
        Operation::And(a, b) => Expression::and(of(a), of(b)),
        Operation::Or(a, b) => Expression::or(of(a), of(b)),
        Operation::Select(condition, yes, no) => Expression::select(of(condition), of(yes), of(no)),
        Operation::Opaque(function, arguments) => {
            let arguments: Vec<Expression> = arguments.iter().map(|argument| of(argument).clone()).collect();
            let name = match function {
                Opaque::Noise => "noise",
                Opaque::Uniform => "uniform_number",
            };
            Expression::call(name, &arguments)
        }
        // Handled where statements are made.
        Operation::Part(..) | Operation::Leaf(_) | Operation::Carried(_) | Operation::Iterate { .. } => {
            Expression::number(f64::NAN)
        }
    }
}

/// The angle a of whole turns ⌊(wrap(a) − a)/2π⌉ 2π, which lead from it to within a half turn. Laws of vehicles need them often:
/// they are a function in C.
fn turned(operation: &Operation, operations: &[Operation], named: &dyn Fn(Node) -> Option<String>) -> Option<Node> {
    let of = |node: Node| &operations[node.index()];
    let is_turn = |node: Node| *of(node) == Operation::Constant(TAU.to_bits());
    let Operation::Binary(Binary::Mul, rounded, turn) = *operation else { return None };
    let Operation::Unary(Unary::Round, turns) = *of(rounded) else { return None };
    let Operation::Binary(Binary::Div, difference, unit) = *of(turns) else { return None };
    let Operation::Binary(Binary::Sub, within, angle) = *of(difference) else { return None };
    let is_one = is_turn(turn) && is_turn(unit) && *of(within) == Operation::Unary(Unary::Wrap, angle);
    // A variable on the way is written in any case.
    (is_one && [rounded, turns, difference, within].into_iter().all(|node| named(node).is_none())).then_some(angle)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use super::turned;
    use crate::recording::{Binary, Node, Operation, Unary};

    #[test]
    fn whole_turns_of_an_angle_are_recognised() {
        let at = Node::at;
        let turns = |turn: f64, other: usize, named: usize| {
            let operations = vec![
                Operation::Carried(0),
                Operation::Carried(1),
                Operation::Constant(turn.to_bits()),
                Operation::Unary(Unary::Wrap, at(0)),
                Operation::Binary(Binary::Sub, at(3), at(other)),
                Operation::Binary(Binary::Div, at(4), at(2)),
                Operation::Unary(Unary::Round, at(5)),
            ];
            let name = |node: Node| (node == at(named)).then(|| "e".to_owned());
            turned(&Operation::Binary(Binary::Mul, at(6), at(2)), &operations, &name)
        };
        assert_eq!(turns(TAU, 0, 0), Some(at(0)));
        assert_eq!((turns(PI, 0, 0), turns(TAU, 1, 0), turns(TAU, 0, 3)), (None, None, None));
    }
}
