//! Algebraic loops: connections that close a circle without a delay in any unit.

use super::check::Link;
use super::description::Description;

/// The links of one such circle, in order, if there is any.
pub(super) fn algebraic_loop(links: &[Link], descriptions: &[&Description]) -> Option<Vec<usize>> {
    let follows = |first: usize, next: usize| {
        let ((unit, input), (other, output)) = (links[first].to, links[next].from);
        unit == other && descriptions[unit].is_fed_through(input, output)
    };
    let next: Vec<Vec<usize>> =
        (0..links.len()).map(|k| (0..links.len()).filter(|&other| follows(k, other)).collect()).collect();
    let mut visited = vec![false; links.len()];
    (0..links.len()).find_map(|start| circle_from(start, &next, &mut visited))
}

/// Depth first; the path is what was entered and not yet left.
fn circle_from(start: usize, next: &[Vec<usize>], visited: &mut [bool]) -> Option<Vec<usize>> {
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
