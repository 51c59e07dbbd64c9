//! Every interleaving of an executor without threads, which decides to sleep, with threads that
//! bring input: a message, a trigger, a timer's start, a stop. The executor loses none of it, and
//! does not sleep while there is something to do.

use super::fake::Fake;
use crate::middleware::{Middleware, WriterId};
use crate::msg::std_msgs::UInt8;
use crate::{
    CallbackContext, Context, Every, Executor, GuardCondition, LocalExecutor, Nanos, Qos, SpinEnd,
    TimerHandle,
};
use core::time::Duration;
use loom::thread;
use replenish_os::clock;

/// Time at which the executor starts.
const START: Nanos = 1;

/// An executor without handles, its context, and the middleware below.
fn executor() -> (Executor, Context, Fake) {
    clock::set(START);
    let middleware = Fake::holding(&[]);
    let context = Context::new(middleware.clone());
    (Executor::new(&context), context, middleware)
}

/// Guard conditions of one worker, with callbacks that do nothing.
fn guarded<const N: usize>(executor: &mut Executor) -> [GuardCondition; N] {
    let conditions = [(); N].map(|()| GuardCondition::new());
    let mut worker = executor.worker("w");
    for condition in &conditions {
        worker = worker.guard(condition, |_| ()).unwrap();
    }
    conditions
}

/// Runs callbacks, without any limit of time, until this many have run.
fn spin(mut local: LocalExecutor, callbacks: u64) -> LocalExecutor {
    let mut ran = 0;
    while ran < callbacks {
        let spun = local.spin_some(Duration::MAX);
        assert_eq!(spun.end, SpinEnd::Worked);
        ran += spun.callbacks;
    }
    assert_eq!(ran, callbacks);
    local
}

#[test]
fn a_trigger_ends_the_wait_whenever_it_comes() {
    loom::model(|| {
        let (mut executor, ..) = executor();
        let [condition] = guarded(&mut executor);
        let trigger = thread::spawn(move || condition.trigger());
        spin(executor.local().unwrap(), 1);
        trigger.join().unwrap();
    });
}

#[test]
fn triggers_of_two_threads_are_all_counted() {
    loom::model(|| {
        let (mut executor, ..) = executor();
        let conditions: [_; 2] = guarded(&mut executor);
        let triggers = conditions.map(|condition| thread::spawn(move || condition.trigger()));
        let local = spin(executor.local().unwrap(), 2);
        let received = ["w/guard:0", "w/guard:1"].map(|id| local.stats(id).unwrap().received);
        assert_eq!(received, [1, 1]);
        triggers.into_iter().for_each(|t| t.join().unwrap());
    });
}

/// The second message finds the inbox full: the reader leaves the interest set, and comes back.
#[test]
fn messages_are_taken_whenever_they_come_also_when_there_was_no_room() {
    loom::model(|| {
        let (mut executor, context, middleware) = executor();
        let nothing = |_: &UInt8, _: &CallbackContext<'_>| ();
        let node = context.node("n").unwrap();
        let qos = Qos::reliable().keep_all(1);
        let worker = executor.worker("w");
        worker.subscribe(&node, "t", qos, nothing).unwrap();
        let publisher = thread::spawn(move || {
            middleware.publish(WriterId(0), &[1]).unwrap();
            middleware.publish(WriterId(0), &[2]).unwrap();
        });
        let local = spin(executor.local().unwrap(), 2);
        let stats = local.stats("/n/sub:/t").unwrap();
        assert_eq!((stats.received, stats.dropped), (2, 0));
        publisher.join().unwrap();
    });
}

/// Nothing is due, so the executor sleeps without limit; the timer that is started meanwhile
/// fires one period after that.
#[test]
fn a_timer_that_is_started_while_it_falls_asleep_fires() {
    loom::model(|| {
        let (mut executor, ..) = executor();
        let handle = TimerHandle::new();
        let once = Every::once(Duration::from_nanos(10)).not_started();
        let worker = executor.worker("w");
        worker.timer_with(&handle, once, |_| ()).unwrap();
        let other = handle.clone();
        let starter = thread::spawn(move || other.start());
        spin(executor.local().unwrap(), 1);
        assert_eq!(clock::monotonic(), START + 10);
        starter.join().unwrap();
    });
}

#[test]
fn a_stop_ends_the_spin_whenever_it_comes() {
    loom::model(|| {
        let (executor, ..) = executor();
        let stop = executor.stop_handle();
        let stopper = thread::spawn(move || stop.stop());
        let spun = executor.local().unwrap().spin();
        assert_eq!((spun.callbacks, spun.end), (0, SpinEnd::Stopped));
        stopper.join().unwrap();
    });
}

#[test]
fn a_stop_ends_the_spin_after_a_restart_as_well() {
    loom::model(|| {
        let (executor, ..) = executor();
        let stop = executor.stop_handle();
        let mut local = executor.local().unwrap();
        stop.stop();
        assert_eq!(local.spin().end, SpinEnd::Stopped);
        local.restart();
        let stopper = thread::spawn(move || stop.stop());
        assert_eq!(local.spin().end, SpinEnd::Stopped);
        stopper.join().unwrap();
    });
}
