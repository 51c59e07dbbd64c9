//! Every interleaving of a pool's messages: lent, published, read by several, lent again. No
//! message is written while somebody reads it, and none is lost.

use crate::sync::{Arc as Outer, Mutex};
use crate::{Counted, Pool};
#[cfg(feature = "std")]
use crate::{DeliveryOutcome, Inbox, Keep, SampleInfo, Shared};
use loom::cell::UnsafeCell;
use loom::sync::Arc;
use loom::thread;

/// A reference whose count is modelled, to a number whose accesses are watched.
#[derive(Clone)]
struct Counter(Arc<UnsafeCell<u32>>);

impl Counter {
    fn new(value: u32) -> Self {
        Self(Arc::new(UnsafeCell::new(value)))
    }

    /// By the pointer's address alone: an access beside a write of somebody else fails the model.
    fn read(&self) -> usize {
        self.0.with(|value| value as usize)
    }

    fn write(&self) -> usize {
        self.0.with_mut(|value| value as usize)
    }
}

impl Counted for Counter {
    fn is_alone(&mut self) -> bool {
        Arc::get_mut(&mut self.0).is_some()
    }
}

type Lent = Pool<Counter>;

/// Lends a message, writes it, publishes it to so many readers.
fn publish(pool: &Lent, readers: usize) -> Option<Vec<Counter>> {
    let (place, message) = pool.take()?;
    message.write();
    let shared = (0..readers).map(|_| message.clone()).collect();
    pool.give_back(place, message);
    Some(shared)
}

#[test]
fn loom_a_message_is_written_again_only_when_its_last_reader_is_done() {
    loom::model(|| {
        let pool = Outer::new(Lent::new([Counter::new(0)]));
        let shared = publish(&pool, 2).unwrap();
        let readers = shared.into_iter().map(|message| {
            thread::spawn(move || {
                message.read();
                drop(message);
            })
        });
        let readers: Vec<_> = readers.collect();
        let early = publish(&pool, 0).is_some();
        for reader in readers {
            reader.join().unwrap();
        }
        // The message is free again once, whichever reader was the last.
        let (place, message) = pool.take().unwrap();
        assert!(pool.take().is_none(), "{early}");
        pool.give_back(place, message);
        assert_eq!(pool.free(), 1);
    });
}

#[test]
fn loom_two_publishers_never_get_the_same_message() {
    loom::model(|| {
        let pool = Outer::new(Lent::new([Counter::new(0), Counter::new(1)]));
        let seen = Outer::new(Mutex::new(Vec::new()));
        let publisher = {
            let (pool, seen) = (Outer::clone(&pool), Outer::clone(&seen));
            thread::spawn(move || {
                let shared = publish(&pool, 1).unwrap();
                seen.lock().push(shared[0].read());
                shared
            })
        };
        let mine = publish(&pool, 1).unwrap();
        seen.lock().push(mine[0].read());
        let theirs = publisher.join().unwrap();
        let seen = seen.lock().clone();
        assert!(seen[0] != seen[1]);
        assert!(pool.take().is_none());
        drop((mine, theirs));
        assert_eq!(pool.free(), 2);
    });
}

/// A publisher brings a message in memory while the dispatcher brings bytes and the worker reads:
/// both find room, and each is read or made room for the other.
#[cfg(feature = "std")]
#[test]
fn loom_publisher_and_dispatcher_share_one_inbox() {
    loom::model(|| {
        let inbox = Outer::new(Inbox::new(1, 1, Keep::Newest));
        let publisher = {
            let inbox = Outer::clone(&inbox);
            let message = Shared::of(&Outer::new(7_u8));
            thread::spawn(move || inbox.share(&message, &SampleInfo::at(0)))
        };
        let worker = {
            let inbox = Outer::clone(&inbox);
            thread::spawn(move || {
                let mut read = None;
                let popped = inbox.pop(&mut read).is_some();
                (usize::from(popped), read)
            })
        };
        let mut spare = None;
        let delivered = inbox.deliver(&mut spare, &[1], &SampleInfo::at(0));
        let (mut popped, mut read) = worker.join().unwrap();
        let fates = [delivered.outcome, publisher.join().unwrap()];
        while inbox.pop(&mut read).is_some() {
            popped += 1;
        }
        let stored = |fate: &&DeliveryOutcome| **fate == DeliveryOutcome::Stored;
        let replaced = |fate: &&DeliveryOutcome| **fate == DeliveryOutcome::ReplacedOldest;
        let replacing = fates.iter().filter(replaced).count();
        assert_eq!(fates.iter().filter(stored).count() + replacing, 2);
        assert_eq!(popped + replacing, 2);
    });
}
