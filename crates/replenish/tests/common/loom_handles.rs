//! What the files of single handles name besides, for the models that include them: without
//! protocols of their own.

pub(crate) mod clock {
    pub(crate) fn monotonic() -> u64 {
        1
    }
}

pub(crate) mod platform {
    use loom::sync::atomic::{AtomicBool, Ordering};
    use std::sync::OnceLock;

    /// Everything is given back in its time.
    pub(crate) type Static<T> = T;

    pub(crate) fn make_static<T>(value: T) -> Static<T> {
        value
    }

    /// `OnceLock` with what others see of it in the hands of the model.
    pub(crate) struct Once<T> {
        value: OnceLock<T>,
        there: AtomicBool,
    }

    impl<T> Default for Once<T> {
        fn default() -> Self {
            Self::new()
        }
    }

    impl<T> Once<T> {
        pub(crate) fn new() -> Self {
            Self {
                value: OnceLock::new(),
                there: AtomicBool::new(false),
            }
        }
        pub(crate) fn set(&self, value: T) -> Result<(), T> {
            self.value.set(value)?;
            self.there.store(true, Ordering::Release);
            Ok(())
        }
        pub(crate) fn get(&self) -> Option<&T> {
            match self.there.load(Ordering::Acquire) {
                true => self.value.get(),
                false => None,
            }
        }
    }
}

pub(crate) mod doorbell {
    use crate::sync::{Arc, Notify};

    #[derive(Clone)]
    pub(crate) struct Line(pub(crate) Arc<Notify>);

    impl Line {
        pub(crate) fn call(&self) {
            self.0.set();
        }
        pub(crate) fn ring(&self, _: u64) {
            self.0.set();
        }
    }
}

pub(crate) mod lazy_now {
    pub(crate) struct LazyNow;

    impl LazyNow {
        pub(crate) fn get(&self) -> u64 {
            super::clock::monotonic()
        }
    }
}

pub(crate) mod run_queue {
    pub(crate) struct RunQueue;

    impl RunQueue {
        pub(crate) const fn next_release_of(&mut self, _: usize, _: Option<u64>) {}
    }
}

pub(crate) mod handle {
    use super::doorbell::Line;
    use super::lazy_now::LazyNow;
    use super::run_queue::RunQueue;
    use std::sync::atomic::{AtomicU64, Ordering};

    /// Statistics are not part of the protocol: not seen by the model.
    #[derive(Default)]
    pub(crate) struct Counter(AtomicU64);

    impl Counter {
        pub(crate) fn add(&self, n: u64) {
            self.0.fetch_add(n, Ordering::Relaxed);
        }
        pub(crate) fn get(&self) -> u64 {
            self.0.load(Ordering::Relaxed)
        }
    }

    #[derive(Default)]
    pub(crate) struct Counters {
        pub(crate) received: Counter,
        pub(crate) skipped: Counter,
    }

    #[derive(Default)]
    pub(crate) struct HandleState {
        pub(crate) counters: Counters,
    }

    impl HandleState {
        pub(crate) fn failed(&self, _: &dyn core::fmt::Display, _: &()) {}
    }

    pub(crate) struct Env<'a> {
        pub(crate) events: &'a (),
    }

    pub(crate) struct Taken {
        pub(crate) due: u64,
        pub(crate) deadline: Option<Deadline>,
    }

    /// Nobody judges here.
    pub(crate) struct Deadline;

    impl Deadline {
        pub(crate) const fn of(_: u64) -> Self {
            Self
        }
    }

    pub(crate) trait Handle {
        fn begin(&mut self, start: u64, line: &Line);
        fn is_ready(&mut self, now: &LazyNow) -> bool;
        fn next_release(&mut self) -> Option<u64> {
            None
        }
        fn note_release(&mut self, _position: usize, _agenda: &mut RunQueue) {}
        fn take(&mut self, env: &Env<'_>) -> Option<Taken>;
        fn execute(&mut self, env: &Env<'_>, started: u64);
    }
}

pub(crate) mod callback {
    use super::handle::{Env, HandleState};
    use core::marker::PhantomData;

    pub(crate) struct CallbackContext<'a> {
        pub(crate) skipped: u64,
        pub(crate) stub: PhantomData<&'a ()>,
    }

    impl<'a> CallbackContext<'a> {
        pub(crate) fn new(_: &Env<'a>, _: &HandleState, _: u64, _: u64) -> Self {
            Self {
                skipped: 0,
                stub: PhantomData,
            }
        }
    }

    pub(crate) trait CallbackResult {
        fn inspect(self, report: &mut dyn FnMut(&dyn core::fmt::Display));
    }

    impl CallbackResult for () {
        fn inspect(self, _: &mut dyn FnMut(&dyn core::fmt::Display)) {}
    }
}
