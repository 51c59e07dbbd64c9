//! A middleware as the seam demands it: level-triggered on the interest set, with sticky wake-ups.
//!
//! A wait that finds nothing ends at its deadline, to which the clock moves.

use crate::Nanos;
use crate::executor::wake::doorbell::{Doorbell, WakeHandle};
use crate::executor::wake::stop::StopHandle;
use crate::middleware::{
    EndpointSpec, Interest, LinkState, Middleware, MiddlewareError, PublishError, ReaderId, Room,
    SampleInfo, WriterId,
};
use crate::sync::Arc;
use loom::sync::{Condvar, Mutex};
use replenish_os::clock;

#[derive(Default)]
struct State {
    readers: u16,
    buffered: Vec<(ReaderId, u8)>,
    woken: bool,
    deleted: usize,
}

struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

/// One middleware; clones are the same.
#[derive(Clone)]
pub(super) struct Fake(Arc<Shared>);

impl Fake {
    /// A middleware that holds these samples of one byte each.
    pub(super) fn holding(samples: &[(ReaderId, u8)]) -> Self {
        let state = State {
            buffered: samples.to_vec(),
            ..State::default()
        };
        Self(Arc::new(Shared {
            state: Mutex::new(state),
            changed: Condvar::new(),
        }))
    }

    /// The stop of an executor over it.
    pub(super) fn stop_handle(&self) -> StopHandle {
        StopHandle::new(Arc::new(self.clone()))
    }

    /// Number of readers that were deleted.
    pub(super) fn deleted(&self) -> usize {
        self.0.state.lock().unwrap().deleted
    }

    fn change(&self, change: impl FnOnce(&mut State)) {
        change(&mut self.0.state.lock().unwrap());
        self.0.changed.notify_one();
    }
}

impl Middleware for Fake {
    fn create_writer(&self, _: &EndpointSpec<'_>) -> Result<WriterId, MiddlewareError> {
        Ok(WriterId(0))
    }

    fn create_reader(&self, _: &EndpointSpec<'_>) -> Result<ReaderId, MiddlewareError> {
        let mut state = self.0.state.lock().unwrap();
        state.readers += 1;
        Ok(ReaderId(state.readers - 1))
    }

    fn delete_reader(&self, _: ReaderId) -> Result<(), MiddlewareError> {
        self.0.state.lock().unwrap().deleted += 1;
        Ok(())
    }

    /// A writer's samples go to the reader with the same number.
    fn publish(&self, writer: WriterId, payload: &[u8]) -> Result<(), PublishError> {
        self.change(|state| state.buffered.push((ReaderId(writer.0), payload[0])));
        Ok(())
    }

    fn wait(&self, interest: &Interest, deadline: Option<Nanos>) -> Result<(), MiddlewareError> {
        let mut state = self.0.state.lock().unwrap();
        let ready = |state: &State| state.buffered.iter().any(|(r, _)| interest.contains(*r));
        while !ready(&state) && !state.woken {
            if let Some(at) = deadline {
                clock::reach(at);
                return Ok(());
            }
            state = self.0.changed.wait(state).unwrap();
        }
        state.woken = false;
        Ok(())
    }

    fn take(
        &self,
        interest: &mut Interest,
        sink: &mut dyn FnMut(ReaderId, &SampleInfo, &[u8]) -> Room,
    ) -> Result<usize, MiddlewareError> {
        let mut state = self.0.state.lock().unwrap();
        let mut taken = 0;
        state.buffered.retain(|(reader, sample)| {
            if !interest.contains(*reader) {
                return true;
            }
            taken += 1;
            if sink(*reader, &SampleInfo::at(0), &[*sample]) == Room::Full {
                interest.remove(*reader);
            }
            false
        });
        Ok(taken)
    }

    fn wake(&self) {
        self.change(|state| state.woken = true);
    }

    fn link(&self) -> LinkState {
        LinkState::Up
    }
}

/// Wakes a worker of one handle.
pub(super) fn wake_handle() -> WakeHandle {
    WakeHandle::new(&Arc::new(Doorbell::new(1)), 0)
}
