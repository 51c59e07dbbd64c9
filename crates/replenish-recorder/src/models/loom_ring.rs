//! A writer that laps its ring against a reader that copies it meanwhile.

use crate::{Event, Kind, Writer, read};
use loom::sync::Arc;
use loom::sync::atomic::AtomicU64;
use loom::thread;

fn event(n: u64) -> Event {
    Event {
        time: n,
        kind: Kind::Mark,
        name: 7,
        a: n,
        b: !n,
    }
}

/// The reader gets whole records alone, in order, and each that it does not get is counted. A
/// writer that stores its records before `begun`, or a reader without its fence, fails this.
#[test]
fn loom_a_reader_gets_whole_records() {
    loom::model(|| {
        let ring: Arc<Vec<AtomicU64>> = Arc::new((0..12).map(|_| AtomicU64::new(0)).collect());
        let theirs = Arc::clone(&ring);
        let writer = thread::spawn(move || {
            let mut writer = Writer::new(theirs.len()).unwrap();
            (1..=3).for_each(|n| writer.write(&theirs, &event(n)));
        });
        let (mut copy, mut seen) = ([[0; 4]; 1], Vec::new());
        let copied = read(&ring, 0, &mut copy, |event| seen.push(event));
        assert_eq!(copied.torn, 0);
        assert_eq!(copied.read + copied.overwritten, copied.next);
        for got in seen {
            assert_eq!(got, event(got.time));
            assert_eq!(got.time, copied.next);
        }
        writer.join().unwrap();
    });
}
