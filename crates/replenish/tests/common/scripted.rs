//! A middleware that delivers what a test puts into it, level-triggered, and fails on request.

use replenish::middleware::{
    EndpointSpec, Interest, LinkState, Middleware, MiddlewareError, PublishError, ReaderId,
    RequestIdentity, Room, SampleInfo, ServiceSpec, WriterId,
};
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex};

#[derive(Default)]
struct State {
    readers: u16,
    buffered: VecDeque<(ReaderId, Vec<u8>)>,
    woken: bool,
    failing: bool,
    down: bool,
    /// Order in which the executor took the readers' samples.
    taken: Vec<ReaderId>,
}

#[derive(Clone, Default)]
pub struct Scripted(Arc<(Mutex<State>, Condvar)>);

impl Scripted {
    fn change(&self, f: impl FnOnce(&mut State)) {
        f(&mut self.0.0.lock().unwrap());
        self.0.1.notify_all();
    }

    /// Buffers one sample.
    pub fn put(&self, reader: u16, bytes: &[u8]) {
        self.put_all(&[(reader, bytes)]);
    }

    /// Buffers several samples at once: they arrive in one batch.
    pub fn put_all(&self, samples: &[(u16, &[u8])]) {
        self.change(|s| {
            for (reader, bytes) in samples {
                s.buffered.push_back((ReaderId(*reader), bytes.to_vec()));
            }
        });
    }

    /// From now on waiting fails, or no longer.
    pub fn fail(&self, failing: bool) {
        self.change(|s| {
            s.failing = failing;
            s.woken = true;
        });
    }

    pub fn link_down(&self, down: bool) {
        self.change(|s| {
            s.down = down;
            s.woken = true;
        });
    }

    #[must_use]
    pub fn buffered(&self) -> usize {
        self.0.0.lock().unwrap().buffered.len()
    }
}

impl Middleware for Scripted {
    fn create_writer(&self, _: &EndpointSpec<'_>) -> Result<WriterId, MiddlewareError> {
        Ok(WriterId(0))
    }

    fn create_reader(&self, _: &EndpointSpec<'_>) -> Result<ReaderId, MiddlewareError> {
        let mut state = self.0.0.lock().unwrap();
        state.readers += 1;
        Ok(ReaderId(state.readers - 1))
    }

    fn create_server(&self, _: &ServiceSpec<'_>) -> Result<(ReaderId, WriterId), MiddlewareError> {
        let mut state = self.0.0.lock().unwrap();
        state.readers += 1;
        Ok((ReaderId(state.readers - 1), WriterId(0)))
    }

    fn reply(&self, _: WriterId, _: &RequestIdentity, _: &[u8]) -> Result<(), PublishError> {
        Err(PublishError::LinkDown)
    }

    fn publish(&self, _: WriterId, _: &[u8]) -> Result<(), PublishError> {
        Err(PublishError::LinkDown)
    }

    fn wait(&self, interest: &Interest, deadline: Option<u64>) -> Result<(), MiddlewareError> {
        assert!(deadline.is_none());
        let mut state = self.0.0.lock().unwrap();
        loop {
            if state.failing {
                return Err(MiddlewareError::LinkDown);
            }
            let ready = state.buffered.iter().any(|(r, _)| interest.contains(*r));
            if ready || std::mem::take(&mut state.woken) {
                return Ok(());
            }
            state = self.0.1.wait(state).unwrap();
        }
    }

    fn take(
        &self,
        interest: &mut Interest,
        sink: &mut dyn FnMut(ReaderId, &SampleInfo, &[u8]) -> Room,
    ) -> Result<usize, MiddlewareError> {
        let mut state = self.0.0.lock().unwrap();
        let mut taken = 0;
        let buffered = std::mem::take(&mut state.buffered);
        for (reader, bytes) in buffered {
            if !interest.contains(reader) {
                state.buffered.push_back((reader, bytes));
                continue;
            }
            taken += 1;
            state.taken.push(reader);
            if sink(reader, &SampleInfo::at(1), &bytes) == Room::Full {
                interest.remove(reader);
            }
        }
        Ok(taken)
    }

    fn wake(&self) {
        self.change(|s| s.woken = true);
    }

    fn link(&self) -> LinkState {
        if self.0.0.lock().unwrap().down {
            LinkState::Down { since: 1 }
        } else {
            LinkState::Up
        }
    }
}
