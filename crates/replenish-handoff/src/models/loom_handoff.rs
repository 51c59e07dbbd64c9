//! Every interleaving of the held_slot-off between dispatcher and worker, over the real inbox:
//! nothing is lost, nothing deadlocks, a full inbox comes back into the interest set.

use crate::sync::{Arc, AtomicBool, Mutex, Notify, Ordering};
use crate::{DeliveryOutcome, Inbox, Keep, RingSlot, SampleInfo};
use loom::thread;

/// A middleware as the dispatcher needs it: buffered samples, and a sticky wake-up.
struct Middleware {
    buffered: Mutex<Vec<u8>>,
    bell: Notify,
}

impl Middleware {
    fn holding(samples: &[u8]) -> Arc<Self> {
        Arc::new(Self {
            buffered: Mutex::new(samples.to_vec()),
            bell: Notify::new(),
        })
    }

    /// Level-triggered on the interest set: returns at once iff an interesting reader has data.
    fn wait(&self, interested: bool) {
        if interested && !self.buffered.lock().is_empty() {
            return;
        }
        self.bell.wait();
    }
}

/// The dispatcher's loop for one keep-all reader, as in `executor/dispatcher.rs`.
fn dispatch(middleware: &Middleware, inbox: &Inbox, bell: &Notify, done: &AtomicBool) {
    let (mut parked, mut held_slot) = (false, None);
    while !done.load(Ordering::Acquire) {
        if parked {
            parked = inbox.is_parked();
        }
        middleware.wait(!parked);
        while !parked {
            let Some(sample) = ({
                let mut buffered = middleware.buffered.lock();
                (!buffered.is_empty()).then(|| buffered.remove(0))
            }) else {
                break;
            };
            let delivery = inbox.deliver(&mut held_slot, &[sample], &SampleInfo::at(0));
            assert_eq!(delivery.outcome, DeliveryOutcome::Stored);
            parked = delivery.parked;
        }
        bell.set();
    }
}

/// The worker's part of one sample.
fn pop(inbox: &Inbox, held_slot: &mut Option<RingSlot>, middleware: &Middleware) -> Option<u8> {
    if inbox.pop(held_slot)? {
        middleware.bell.set();
    }
    Some(held_slot.as_ref()?.payload()[0])
}

#[test]
fn a_full_inbox_rejoins_the_interest_set_as_soon_as_there_is_room() {
    loom::model(|| {
        let middleware = Middleware::holding(&[1, 2, 3]);
        let inbox = Arc::new(Inbox::new(1, 1, Keep::All));
        let bell = Arc::new(Notify::new());
        let done = Arc::new(AtomicBool::new(false));
        let dispatcher = {
            let (middleware, inbox) = (Arc::clone(&middleware), Arc::clone(&inbox));
            let (bell, done) = (Arc::clone(&bell), Arc::clone(&done));
            thread::spawn(move || dispatch(&middleware, &inbox, &bell, &done))
        };
        let (mut got, mut held_slot) = (Vec::new(), None);
        while got.len() < 3 {
            match pop(&inbox, &mut held_slot, &middleware) {
                Some(sample) => got.push(sample),
                None => bell.wait(),
            }
        }
        assert_eq!(got, [1, 2, 3]);
        done.store(true, Ordering::Release);
        middleware.bell.set();
        dispatcher.join().unwrap();
    });
}

#[test]
fn keep_last_hands_over_the_newest_and_counts_every_other() {
    loom::model(|| {
        let inbox = Arc::new(Inbox::new(1, 1, Keep::Newest));
        let bell = Arc::new(Notify::new());
        let dispatcher = {
            let (inbox, bell) = (Arc::clone(&inbox), Arc::clone(&bell));
            thread::spawn(move || {
                let (mut dropped, mut held_slot) = (0, None);
                for sample in [1, 2, 3] {
                    let delivery = inbox.deliver(&mut held_slot, &[sample], &SampleInfo::at(0));
                    assert!(!delivery.parked);
                    dropped += usize::from(delivery.outcome == DeliveryOutcome::ReplacedOldest);
                    bell.set();
                }
                dropped
            })
        };
        let (mut got, mut held_slot) = (Vec::<u8>::new(), None::<RingSlot>);
        while got.last() != Some(&3) {
            match inbox.pop(&mut held_slot) {
                Some(wake) => {
                    assert!(!wake);
                    got.push(held_slot.as_ref().unwrap().payload()[0]);
                }
                None => bell.wait(),
            }
        }
        let dropped = dispatcher.join().unwrap();
        assert!(got.is_sorted());
        assert_eq!(got.len() + dropped, 3);
    });
}

#[test]
fn closing_a_full_inbox_wakes_the_middleware_and_accounts_for_every_sample() {
    loom::model(|| {
        let inbox = Arc::new(Inbox::new(1, 1, Keep::All));
        let middleware = Middleware::holding(&[]);
        let dispatcher = {
            let (inbox, middleware) = (Arc::clone(&inbox), Arc::clone(&middleware));
            thread::spawn(move || {
                let (mut discarded, mut held_slot) = (0, None);
                for sample in [1, 2] {
                    let delivery = inbox.deliver(&mut held_slot, &[sample], &SampleInfo::at(0));
                    discarded += usize::from(delivery.outcome == DeliveryOutcome::Closed);
                    if delivery.parked {
                        middleware.bell.wait(); // only a wake-up brings it back
                    }
                }
                discarded
            })
        };
        let (cleared, wake) = inbox.close();
        if wake {
            middleware.bell.set();
        }
        assert_eq!(cleared + dispatcher.join().unwrap(), 2);
        assert_eq!(inbox.waiting(), 0);
    });
}
