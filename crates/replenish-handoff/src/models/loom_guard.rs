//! Every interleaving of a guard condition's triggers with the worker that serves them.

use crate::sync::{Arc, Notify};
use crate::{Flag, Stop};
use loom::thread;

/// The worker's loop: look, serve, sleep. Until it has served `all` triggers.
fn serve(flag: &Flag, bell: &Notify, all: u64) {
    let mut served = 0;
    while served < all {
        if flag.is_raised() {
            served += flag.take()
        } else {
            bell.wait()
        }
    }
    assert_eq!(served, all);
}

#[test]
fn no_trigger_is_lost_or_counted_twice() {
    loom::model(|| {
        let flag = Arc::new(Flag::new());
        let bell = Arc::new(Notify::new());
        let threads: Vec<_> = (0..2)
            .map(|_| {
                let (flag, bell) = (Arc::clone(&flag), Arc::clone(&bell));
                thread::spawn(move || flag.raise(|| bell.set()))
            })
            .collect();
        serve(&flag, &bell, 2);
        threads.into_iter().for_each(|t| t.join().unwrap());
    });
}

#[test]
fn a_trigger_and_a_stop_at_once_end_the_worker() {
    loom::model(|| {
        let (flag, stop) = (Arc::new(Flag::new()), Arc::new(Stop::new()));
        let bell = Arc::new(Notify::new());
        stop.join(Arc::clone(&bell));
        let trigger = {
            let (flag, bell) = (Arc::clone(&flag), Arc::clone(&bell));
            thread::spawn(move || flag.raise(|| bell.set()))
        };
        let stopper = {
            let stop = Arc::clone(&stop);
            thread::spawn(move || stop.request())
        };
        while !stop.is_requested() {
            if flag.take() == 0 {
                bell.wait();
            }
        }
        trigger.join().unwrap();
        stopper.join().unwrap();
    });
}
