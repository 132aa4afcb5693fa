//! Independent pieces of work on several threads.

use std::num::NonZeroUsize;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// The user's limit of parallel jobs; 0 for the number of cores.
static LIMIT: AtomicUsize = AtomicUsize::new(0);

/// Sets the number of parallel jobs from now on; the number of cores if none is given.
pub fn limit(jobs: Option<NonZeroUsize>) {
    LIMIT.store(jobs.map_or(0, NonZeroUsize::get), Ordering::Relaxed);
}

/// Number of parallel jobs: the number of threads of this machine, or the user's choice.
pub fn cores() -> usize {
    let own = || thread::available_parallelism().map_or(1, usize::from);
    NonZeroUsize::new(LIMIT.load(Ordering::Relaxed)).map_or_else(own, NonZeroUsize::get)
}

/// Results of `count` jobs, in their order. Each worker has a thread of its own, and takes the next job when it has
/// finished one.
pub fn each<W: Sync, T: Send>(workers: &[W], pieces: usize, work: impl Fn(&W, usize) -> T + Sync) -> Vec<T> {
    let (next, work) = (AtomicUsize::new(0), &work);
    let share = |worker: &W| {
        let mut done = Vec::new();
        loop {
            let piece = next.fetch_add(1, Ordering::Relaxed);
            if piece >= pieces {
                return done;
            }
            done.push((piece, work(worker, piece)));
        }
    };
    let mut done: Vec<(usize, T)> = thread::scope(|scope| {
        let threads: Vec<_> = workers.iter().map(|worker| scope.spawn(|| share(worker))).collect();
        threads.into_iter().flat_map(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic))).collect()
    });
    done.sort_by_key(|(piece, _)| *piece);
    done.into_iter().map(|(_, answer)| answer).collect()
}

/// The same, but the longest jobs start first, so that no worker is left with one at the end.
pub fn longest_first<W: Sync, T: Send>(workers: &[W], lengths: &[f64], work: impl Fn(&W, usize) -> T + Sync) -> Vec<T> {
    let mut order: Vec<usize> = (0..lengths.len()).collect();
    order.sort_by(|a, b| lengths[*b].total_cmp(&lengths[*a]));
    let answers = each(workers, order.len(), |worker, turn| work(worker, order[turn]));
    let mut done: Vec<(usize, T)> = order.into_iter().zip(answers).collect();
    done.sort_by_key(|(piece, _)| *piece);
    done.into_iter().map(|(_, answer)| answer).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_piece_is_answered_once_and_in_order() {
        let answers = each(&[10, 20, 30], 100, |worker, piece| (piece, *worker));
        assert_eq!(answers.iter().map(|(piece, _)| *piece).collect::<Vec<_>>(), (0..100).collect::<Vec<_>>());
        assert!(answers.iter().all(|(_, worker)| [10, 20, 30].contains(worker)));
        assert_eq!(each(&[()], 0, |(), piece| piece), Vec::<usize>::new());
    }

    #[test]
    fn the_longest_begin_and_answers_keep_their_order() {
        let begun = std::sync::Mutex::new(Vec::new());
        let answers = longest_first(&[()], &[1.0, 3.0, 2.0, 3.0], |(), piece| {
            begun.lock().unwrap().push(piece);
            10 * piece
        });
        assert_eq!((answers, begun.into_inner().unwrap()), (vec![0, 10, 20, 30], vec![1, 3, 2, 0]));
    }
}
