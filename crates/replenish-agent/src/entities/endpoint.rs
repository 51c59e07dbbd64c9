//! Data writers and data readers.

use crate::sample::{Queue, Sample};
use crate::topics::TopicId;
use replenish_xrce::wire::{BaseRequest, DeliveryControl, StreamId};

/// A data writer.
#[derive(Debug)]
pub(crate) struct Writer {
    pub(crate) topic: TopicId,
}

/// A data reader: its samples, and whether and how the client wants them.
///
/// Samples are kept from the reader's creation on, so that nothing written between CREATE and
/// `READ_DATA` is lost within the queue's depth.
#[derive(Debug)]
pub(crate) struct Reader {
    pub(crate) topic: TopicId,
    queue: Queue,
    request: Option<Request>,
}

/// A client's `READ_DATA`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Request {
    /// Repeated in every DATA.
    pub(crate) base: BaseRequest,
    /// Where the client wants it.
    pub(crate) stream: StreamId,
    /// Samples still to deliver; `None` for no end.
    left: Option<u16>,
}

impl Request {
    /// The request, or `None` if it asks for nothing (which cancels).
    pub(crate) fn new(
        base: BaseRequest,
        stream: StreamId,
        control: Option<DeliveryControl>,
    ) -> Option<Self> {
        let left = match control.map_or(1, |control| control.max_samples) {
            0 => return None,
            DeliveryControl::UNLIMITED_SAMPLES => None,
            limit => Some(limit),
        };
        Some(Self { base, stream, left })
    }
}

impl Reader {
    pub(crate) fn new(topic: TopicId, depth: usize) -> Self {
        Self {
            topic,
            queue: Queue::new(depth),
            request: None,
        }
    }

    /// Keeps a sample; returns whether the oldest one had to go.
    pub(crate) fn push(&mut self, sample: Sample) -> bool {
        self.queue.push(sample)
    }

    /// Replaces or (with `None`) cancels the read request.
    pub(crate) fn request(&mut self, request: Option<Request>) {
        self.request = request;
    }

    /// The stream it has something to say on, if it has.
    pub(crate) fn ready(&self) -> Option<StreamId> {
        let request = self.request.as_ref()?;
        (!self.queue.is_empty()).then_some(request.stream)
    }

    /// The next sample the client wants on `stream`, with the request it answers.
    pub(crate) fn next_on(&self, stream: StreamId) -> Option<(BaseRequest, &Sample)> {
        let request = self
            .request
            .as_ref()
            .filter(|request| request.stream == stream)?;
        Some((request.base, self.queue.front()?))
    }

    /// The next sample is on its way; the request's count goes down.
    pub(crate) fn delivered(&mut self) {
        self.queue.pop();
        if let Some(left) = self
            .request
            .as_mut()
            .and_then(|request| request.left.as_mut())
        {
            *left = left.saturating_sub(1);
            if *left == 0 {
                self.request = None;
            }
        }
    }

    /// The next sample cannot be delivered.
    pub(crate) fn discard(&mut self) {
        self.queue.pop();
    }
}
