//! What the dispatcher and the parts beside it name, for the models that include them: without
//! protocols of their own. The middleware is the seam's contract.

/// Time passes while somebody waits for it, and otherwise stands still. Each model runs on one thread of
/// the test, whatever threads it has itself.
pub(crate) mod clock {
    use std::cell::Cell;

    thread_local!(static NOW: Cell<u64> = const { Cell::new(0) });

    pub(crate) fn set(now: u64) {
        NOW.set(now);
    }
    pub(crate) fn monotonic() -> u64 {
        NOW.get()
    }
    pub(crate) fn sleep_until(_: u64) {
        loom::thread::yield_now();
    }
}

pub(crate) mod handle {
    use crate::event::{Event, Events};
    use crate::handoff::Inbox;
    use crate::middleware::ReaderId;
    use crate::stats::Counter;
    use crate::sync::{Arc, AtomicBool, Notify};

    #[derive(Default)]
    pub(crate) struct Counters {
        pub(crate) received: Counter,
        pub(crate) skipped: Counter,
        pub(crate) dropped: Counter,
        pub(crate) discarded: Counter,
        pub(crate) oversize: Counter,
    }

    pub(crate) struct HandleState {
        pub(crate) id: String,
        pub(crate) input: Option<(ReaderId, Arc<Inbox>)>,
        pub(crate) counters: Counters,
        pub(crate) removed: AtomicBool,
        pub(crate) unrouted: AtomicBool,
        pub(crate) gone: Notify,
    }

    impl HandleState {
        pub(crate) fn new(input: Option<(ReaderId, Arc<Inbox>)>) -> Arc<Self> {
            Arc::new(Self {
                id: String::new(),
                input,
                counters: Counters::default(),
                removed: AtomicBool::new(false),
                unrouted: AtomicBool::new(false),
                gone: Notify::new(),
            })
        }
        pub(crate) fn report(&self, _: u64, _: &Event<'_>, _: &Events) {}
        pub(crate) fn failed(&self, _: &dyn core::fmt::Display, _: &Events) {}
    }
}

pub(crate) mod stats {
    use std::sync::atomic::{AtomicU64, Ordering};

    pub(crate) struct HandleStats;

    /// Statistics are not part of any protocol: not seen by the model.
    #[derive(Debug, Default)]
    pub(crate) struct Counter(AtomicU64);

    impl Counter {
        pub(crate) fn add(&self, n: u64) -> u64 {
            self.0.fetch_add(n, Ordering::Relaxed) + n
        }
        pub(crate) fn count(&self, n: u64) {
            self.add(n);
        }
        pub(crate) fn get(&self) -> u64 {
            self.0.load(Ordering::Relaxed)
        }
    }
}

pub(crate) mod event {
    use crate::middleware::{Clash, MiddlewareError};

    #[derive(Default)]
    pub(crate) struct Events;

    pub(crate) enum Event<'a> {
        Incompatible {
            endpoint: &'a str,
            clash: &'a Clash,
        },
        Link {
            up: bool,
        },
        Oversize {
            handle: &'a str,
            size: usize,
            count: u64,
        },
        MiddlewareFailed {
            error: &'a MiddlewareError,
            count: u64,
        },
    }

    impl Events {
        pub(crate) fn emit(&self, _: &Event<'_>) {}
        pub(crate) fn emit_rarely(&self, _: u64, _: &Event<'_>) {}
    }
}

/// A middleware as the seam demands it: level-triggered on the interest set, sticky wake-ups. A wait
/// that finds nothing ends at its deadline, which has come then.
pub(crate) mod middleware {
    use crate::clock;
    pub(crate) use crate::handoff::SampleInfo;
    pub(crate) use crate::interest::{Interest, MAX_READERS};
    use loom::sync::{Condvar, Mutex};

    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub(crate) struct ReaderId(pub(crate) u16);

    #[derive(Debug, PartialEq, Eq)]
    pub(crate) enum MiddlewareError {}

    #[derive(Debug, PartialEq, Eq)]
    pub(crate) enum LinkState {
        Up,
    }

    #[derive(Debug, PartialEq, Eq)]
    pub(crate) enum Room {
        Left,
        Full,
    }

    type Sink<'a> = &'a mut dyn FnMut(ReaderId, &SampleInfo, &[u8]) -> Room;

    pub(crate) trait Middleware: Send + Sync {
        fn wait(&self, interest: &Interest, deadline: Option<u64>) -> Result<(), MiddlewareError>;
        fn take(&self, interest: &mut Interest, sink: Sink<'_>) -> Result<usize, MiddlewareError>;
        fn delete_reader(&self, reader: ReaderId) -> Result<(), MiddlewareError>;
        fn publish(&self, reader: ReaderId, sample: u8);
        fn wake(&self);
        fn link(&self) -> LinkState;
        fn news(&self) -> Option<usize> {
            None
        }
        fn next_oversize(&self) -> Option<(ReaderId, usize)> {
            None
        }
        fn next_clash(&self) -> Option<Clash> {
            None
        }
    }

    /// There is none in a model.
    pub(crate) enum Clash {}

    impl Clash {
        pub(crate) fn writer(&self) -> String {
            match *self {}
        }
        pub(crate) fn reader(&self) -> Option<ReaderId> {
            match *self {}
        }
    }

    struct State {
        buffered: Vec<(u16, u8)>,
        woken: bool,
        deleted: usize,
    }

    pub(crate) struct Fake {
        state: Mutex<State>,
        changed: Condvar,
    }

    impl Fake {
        pub(crate) fn holding(samples: &[(u16, u8)]) -> Self {
            Self {
                state: Mutex::new(State {
                    buffered: samples.to_vec(),
                    woken: false,
                    deleted: 0,
                }),
                changed: Condvar::new(),
            }
        }
        pub(crate) fn deleted(&self) -> usize {
            self.state.lock().unwrap().deleted
        }
    }

    impl Middleware for Fake {
        fn wait(&self, interest: &Interest, deadline: Option<u64>) -> Result<(), MiddlewareError> {
            let mut state = self.state.lock().unwrap();
            let ready = |s: &State| {
                s.buffered
                    .iter()
                    .any(|(r, _)| interest.contains(ReaderId(*r)))
            };
            while !ready(&state) && !state.woken {
                if let Some(at) = deadline {
                    clock::set(clock::monotonic().max(at));
                    return Ok(());
                }
                state = self.changed.wait(state).unwrap();
            }
            state.woken = false;
            Ok(())
        }

        fn take(&self, interest: &mut Interest, sink: Sink<'_>) -> Result<usize, MiddlewareError> {
            let mut state = self.state.lock().unwrap();
            let mut taken = 0;
            state.buffered.retain(|(id, sample)| {
                let id = ReaderId(*id);
                if !interest.contains(id) {
                    return true;
                }
                taken += 1;
                if sink(id, &SampleInfo::at(0), &[*sample]) == Room::Full {
                    interest.remove(id);
                }
                false
            });
            Ok(taken)
        }

        fn delete_reader(&self, _: ReaderId) -> Result<(), MiddlewareError> {
            self.state.lock().unwrap().deleted += 1;
            Ok(())
        }

        fn publish(&self, reader: ReaderId, sample: u8) {
            self.state.lock().unwrap().buffered.push((reader.0, sample));
            self.changed.notify_one();
        }

        fn wake(&self) {
            self.state.lock().unwrap().woken = true;
            self.changed.notify_one();
        }

        fn link(&self) -> LinkState {
            LinkState::Up
        }
    }
}
