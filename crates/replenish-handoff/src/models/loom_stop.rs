//! Every interleaving of a stop request with threads that join late, work, or fall asleep: all end.

use crate::Stop;
use crate::sync::{Arc, Notify};
use loom::thread;

/// A worker without work: it sleeps on its bell until it is told to stop.
fn sleeper(stop: &Arc<Stop>) -> thread::JoinHandle<()> {
    let stop = Arc::clone(stop);
    thread::spawn(move || {
        let bell = Arc::new(Notify::new());
        stop.join(Arc::clone(&bell));
        while !stop.is_requested() {
            bell.wait();
        }
    })
}

#[test]
fn a_thread_that_joins_at_any_moment_hears_of_the_stop() {
    loom::model(|| {
        let stop = Arc::new(Stop::new());
        let worker = sleeper(&stop);
        stop.request();
        worker.join().unwrap();
    });
}

#[test]
fn two_requests_at_once_end_two_threads() {
    loom::model(|| {
        let stop = Arc::new(Stop::new());
        let worker = sleeper(&stop);
        let other = {
            let stop = Arc::clone(&stop);
            thread::spawn(move || stop.request())
        };
        stop.request();
        worker.join().unwrap();
        other.join().unwrap();
    });
}

#[test]
fn a_wake_up_for_work_does_not_swallow_the_stop() {
    loom::model(|| {
        let stop = Arc::new(Stop::new());
        let bell = Arc::new(Notify::new());
        stop.join(Arc::clone(&bell));
        let worker = {
            let (stop, bell) = (Arc::clone(&stop), Arc::clone(&bell));
            thread::spawn(move || {
                while !stop.is_requested() {
                    bell.wait();
                }
            })
        };
        bell.set(); // a sample
        stop.request();
        worker.join().unwrap();
    });
}
