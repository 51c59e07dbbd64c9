//! Every interleaving of callbacks of one group on two workers: one at a time, each known as the
//! holder for exactly as long as it is inside. The event of a long wait names the other one.

use super::fake::Fake;
use crate::event::{Event, Events};
use crate::executor::handles::env::Env;
use crate::executor::handles::group::Group;
use crate::executor::handles::state::HandleState;
use crate::sync::Arc;
use core::time::Duration;
use loom::cell::UnsafeCell;
use loom::thread;
use replenish_os::Account;

/// The value that callbacks of the group share; `loom` sees two that touch it at the same time.
type Content = UnsafeCell<()>;

/// A worker that runs one callback of the group; the handles that its events name as the holder.
fn work(group: &Group, content: &Content, id: &'static str) -> Vec<String> {
    let named = Arc::new(std::sync::Mutex::new(Vec::new()));
    let note = Arc::clone(&named);
    let events = Events::new(move |event| {
        let Event::Blocked { handle, by, .. } = event else {
            unreachable!("{event}");
        };
        assert_eq!(*handle, id);
        note.lock().unwrap().push((*by).into());
    });
    let shared = HandleState::new(id.into(), None);
    let middleware = Fake::holding(&[]);
    let stop = middleware.stop_handle();
    let env = Env {
        worker: "w",
        stop: &stop,
        events: &events,
        meter: &Account::unbudgeted().meter(),
        middleware: &middleware,
        live: None,
        outbox: None,
    };
    assert!(!group.is_mine());
    {
        let _held = group.enter(&shared, &env);
        content.with_mut(|_| ());
        assert!(group.is_mine(), "{id} is inside");
    }
    assert!(!group.is_mine(), "{id} has left");
    core::mem::take(&mut *named.lock().unwrap())
}

fn two_workers(patience: Duration) {
    loom::model(move || {
        let group = Group::new("g").patience(patience);
        let content = Arc::new(Content::new(()));
        let other = {
            let (group, content) = (group.clone(), Arc::clone(&content));
            thread::spawn(move || work(&group, &content, "other"))
        };
        let named = work(&group, &content, "this");
        // A holder that has just come in may not be known yet.
        let waited_for = |name| move |by: &String| by == name || by == "-";
        assert!(named.iter().all(waited_for("other")), "{named:?}");
        let named = other.join().unwrap();
        assert!(named.iter().all(waited_for("this")), "{named:?}");
        assert!(content.with_mut(|_| true));
    });
}

#[test]
fn one_at_a_time_and_each_knows_when_it_is_inside() {
    two_workers(Duration::MAX);
}

#[test]
fn whoever_loses_patience_is_told_of_the_other_and_waits_on() {
    two_workers(Duration::from_nanos(1));
}
