//! The streams of a session: one best effort and one reliable, each way.

use super::{Buffers, Config, WriteError};
use crate::stream::{
    InputBestEffort, InputReliable, OutputBestEffort, OutputReliable, PushError, StreamHeader, Tail,
};
use crate::wire::{Encode, SessionId, StreamId};
use crate::{Nanos, SeqNum};

/// Output streams; apart from the input streams, whose messages change them.
#[derive(Debug)]
pub(super) struct Outputs<S, const N: usize> {
    pub(super) best_effort: OutputBestEffort<S>,
    pub(super) reliable: OutputReliable<S, N>,
}

/// Input streams.
#[derive(Debug)]
pub(super) struct Inputs<S, const N: usize> {
    pub(super) best_effort: InputBestEffort,
    pub(super) reliable: InputReliable<S, S, N>,
}

fn header(config: &Config, session: SessionId, stream: StreamId) -> StreamHeader {
    StreamHeader {
        session,
        stream,
        key: config.key,
    }
}

pub(super) fn make<S: AsRef<[u8]> + AsMut<[u8]>, const N: usize>(
    config: &Config,
    buffers: Buffers<S>,
) -> (Outputs<S, N>, Inputs<S, N>, S) {
    let mtu = usize::from(config.mtu);
    let head = |stream| header(config, config.session, stream);
    let outputs = Outputs {
        best_effort: OutputBestEffort::new(
            buffers.best_effort_out,
            head(StreamId::BEST_EFFORT),
            Tail::Padded,
        )
        .limited(mtu),
        reliable: OutputReliable::new(
            buffers.reliable_out,
            mtu,
            head(StreamId::RELIABLE),
            Tail::Padded,
            config.reliability,
        ),
    };
    let inputs = Inputs {
        best_effort: InputBestEffort::new(),
        reliable: InputReliable::new(
            StreamId::RELIABLE,
            buffers.reliable_in,
            mtu,
            buffers.fragments_in,
        ),
    };
    (outputs, inputs, buffers.journal)
}

impl<S: AsRef<[u8]> + AsMut<[u8]>, const N: usize> Outputs<S, N> {
    /// Everything from the start, for a new session.
    pub(super) fn reset(&mut self, config: &Config, session: SessionId) {
        self.best_effort
            .reset(header(config, session, StreamId::BEST_EFFORT));
        self.reliable
            .reset(header(config, session, StreamId::RELIABLE));
    }

    /// Pushes a sample's submessage.
    pub(super) fn write(
        &mut self,
        stream: StreamId,
        body: &impl Encode,
        size: usize,
    ) -> Result<(), WriteError> {
        let pushed = match stream {
            StreamId::BEST_EFFORT => self.best_effort.push(body),
            StreamId::RELIABLE => self.reliable.push(body),
            other => return Err(WriteError::UnknownStream(other)),
        };
        pushed.map_err(|error| WriteError::from_push(error, size))
    }

    /// The largest sample on `stream`.
    pub(super) fn limit(&self, stream: StreamId) -> Option<usize> {
        let limit = match stream {
            StreamId::BEST_EFFORT => self.best_effort.limit(),
            StreamId::RELIABLE => self.reliable.limit(),
            _ => return None,
        };
        Some(limit.saturating_sub(WriteError::OVERHEAD))
    }

    pub(super) fn acknowledge(
        &mut self,
        now: Nanos,
        stream: StreamId,
        first: SeqNum,
        missing: u16,
    ) {
        if stream == StreamId::RELIABLE {
            self.reliable.acknowledge(now, first, missing);
        }
    }

    /// Pushes a request.
    pub(super) fn request(&mut self, body: &impl Encode) -> Result<(), PushError> {
        self.reliable.push(body)
    }
}
