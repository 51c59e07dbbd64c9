//! Every interleaving of those who bring input with the worker that looks only where it is marked.

use crate::sync::{Arc, Notify};
use crate::{Flag, ReadySet};
use loom::thread;

/// Two handles, in different words of the set, each brought something by a thread of its own: the
/// worker finds both, and sleeps in between.
#[test]
fn input_that_was_marked_is_found_without_looking_elsewhere() {
    loom::model(|| {
        let marks = Arc::new(ReadySet::new(65));
        let bell = Arc::new(Notify::new());
        let input: [Arc<Flag>; 2] = [Arc::new(Flag::new()), Arc::new(Flag::new())];
        let slots = [3, 64];
        let threads: Vec<_> = (0..2)
            .map(|i| {
                let (marks, bell) = (Arc::clone(&marks), Arc::clone(&bell));
                let input = Arc::clone(&input[i]);
                thread::spawn(move || {
                    input.raise(|| {
                        marks.mark(slots[i]);
                        bell.set();
                    });
                })
            })
            .collect();
        let mut served = [0; 2];
        while served != [1, 1] {
            let mut any = false;
            marks.drain(|slot| {
                let i = usize::from(slot == slots[1]);
                served[i] += input[i].take();
                any = true;
            });
            if !any {
                bell.wait();
            }
        }
        threads.into_iter().for_each(|t| t.join().unwrap());
        marks.drain(|_| panic!("marked twice"));
    });
}
