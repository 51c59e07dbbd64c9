//! [`EventSource`]: the endpoint whose events a callback hears.

use crate::executor::HandleId;
use crate::middleware::{Middleware, WriterId};
use crate::publisher::Publisher;
use crate::sync::Arc;
use alloc::string::String;
use core::fmt;

/// A publisher, or a subscription by its handle's id: [`on_event`](crate::AddHandles::on_event).
pub struct EventSource<'a>(pub(super) Source<'a>);

pub(super) enum Source<'a> {
    Publisher {
        middleware: &'a Arc<dyn Middleware>,
        writer: WriterId,
        topic: &'a str,
    },
    Handle(&'a str),
}

impl<'a, M: replenish_msg::Message> From<&'a Publisher<M>> for EventSource<'a> {
    fn from(publisher: &'a Publisher<M>) -> Self {
        let (middleware, writer) = publisher.target();
        Self(Source::Publisher {
            middleware,
            writer,
            topic: publisher.topic(),
        })
    }
}

impl<'a> From<&'a str> for EventSource<'a> {
    fn from(id: &'a str) -> Self {
        Self(Source::Handle(id))
    }
}

impl<'a> From<&'a String> for EventSource<'a> {
    fn from(id: &'a String) -> Self {
        Self(Source::Handle(id))
    }
}

impl<'a> From<&'a HandleId> for EventSource<'a> {
    fn from(id: &'a HandleId) -> Self {
        Self(Source::Handle(id))
    }
}

impl fmt::Debug for EventSource<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Source::Publisher { topic: name, .. } | Source::Handle(name)) = &self.0;
        f.debug_tuple("EventSource").field(name).finish()
    }
}
