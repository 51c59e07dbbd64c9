//! Every interleaving of two writers of lines with the reader.

use crate::sync::Arc;
use crate::{LineQueue, LineReader};
use loom::thread;

/// Each line comes whole and once; a writer's lines come in its order; a line that was refused does
/// not come.
#[test]
fn lines_come_whole_once_and_in_their_writers_order() {
    loom::model(|| {
        let queue = Arc::new(LineQueue::<2>::new(2));
        let writers: Vec<_> = (1..=2)
            .map(|id| {
                let queue = Arc::clone(&queue);
                thread::spawn(move || {
                    let line = |n: u64| queue.push(&[id * 10 + n, id * 10 + n]);
                    u64::from(line(1)) + u64::from(id == 1 && line(2))
                })
            })
            .collect();
        let mut reader = LineReader::default();
        let mut seen = Vec::new();
        let mut take = |reader: &mut LineReader| {
            if let Some([a, b]) = queue.pop(reader) {
                assert_eq!(a, b, "half a line");
                seen.push(a);
            }
        };
        take(&mut reader);
        let accepted: u64 = writers.into_iter().map(|w| w.join().unwrap()).sum();
        for _ in 0..3 {
            take(&mut reader);
        }
        assert_eq!(seen.len() as u64, accepted);
        let of = |id| seen.iter().filter(move |n| **n / 10 == id);
        assert!(of(1).is_sorted() && of(2).is_sorted(), "{seen:?}");
    });
}
