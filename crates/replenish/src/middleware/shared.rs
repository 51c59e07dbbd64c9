//! A middleware that program and context share, for methods that a context does not pass on:
//! [`Xrce::agent_clock_offset`](super::xrce::Xrce::agent_clock_offset).

use super::contract::{EndpointSpec, GraphEnd, LinkState, Middleware, Room, ServiceSpec};
use super::error::{MiddlewareError, PublishError};
use super::ids::{ReaderId, WriterId};
use super::incompatible_qos::IncompatibleQos;
use super::interest::Interest;
use super::source::Source;
use super::watch::{End, Watch};
use crate::Nanos;
use crate::handoff::{RequestIdentity, SampleInfo, Shared};
use crate::platform::{LocalReader, SourceSet};
use crate::qos::Qos;
use crate::sync::Arc;
use alloc::boxed::Box;

impl<M: Middleware> Middleware for Arc<M> {
    fn create_writer(&self, spec: &EndpointSpec<'_>) -> Result<WriterId, MiddlewareError> {
        (**self).create_writer(spec)
    }

    fn create_reader(&self, spec: &EndpointSpec<'_>) -> Result<ReaderId, MiddlewareError> {
        (**self).create_reader(spec)
    }

    fn longest(&self, qos: &Qos, writes: bool) -> usize {
        (**self).longest(qos, writes)
    }

    fn is_ros(&self) -> bool {
        (**self).is_ros()
    }

    fn has_sources(&self) -> bool {
        (**self).has_sources()
    }

    fn source(&self, reader: ReaderId, set: &SourceSet, key: u32) -> Option<Box<dyn Source>> {
        (**self).source(reader, set, key)
    }

    fn delete_reader(&self, reader: ReaderId) -> Result<(), MiddlewareError> {
        (**self).delete_reader(reader)
    }

    fn delete_writer(&self, writer: WriterId) {
        (**self).delete_writer(writer);
    }

    fn publish(&self, writer: WriterId, payload: &[u8]) -> Result<(), PublishError> {
        (**self).publish(writer, payload)
    }

    fn publish_with(
        &self,
        writer: WriterId,
        encode: &mut dyn FnMut(&mut [u8]) -> Option<usize>,
    ) -> Option<Result<(), PublishError>> {
        (**self).publish_with(writer, encode)
    }

    fn share_with(&self, reader: ReaderId, local: LocalReader<dyn Middleware>) {
        (**self).share_with(reader, local);
    }

    fn publish_shared(
        &self,
        writer: WriterId,
        message: &Shared,
        payload: Option<&[u8]>,
    ) -> Result<bool, PublishError> {
        (**self).publish_shared(writer, message, payload)
    }

    fn create_server(
        &self,
        spec: &ServiceSpec<'_>,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        (**self).create_server(spec)
    }

    fn create_client(
        &self,
        spec: &ServiceSpec<'_>,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        (**self).create_client(spec)
    }

    fn request(&self, client: WriterId, payload: &[u8]) -> Result<u64, PublishError> {
        (**self).request(client, payload)
    }

    fn reply(
        &self,
        server: WriterId,
        to: &RequestIdentity,
        payload: &[u8],
    ) -> Result<(), PublishError> {
        (**self).reply(server, to, payload)
    }

    fn has_server(&self, client: WriterId) -> Option<bool> {
        (**self).has_server(client)
    }

    fn matched_readers(&self, writer: WriterId) -> Option<usize> {
        (**self).matched_readers(writer)
    }

    fn matched_writers(&self, reader: ReaderId) -> Option<usize> {
        (**self).matched_writers(reader)
    }

    fn graph(&self, each: &mut dyn FnMut(&GraphEnd<'_>)) -> bool {
        (**self).graph(each)
    }

    fn enter_node(&self, node: &str) -> Result<(), MiddlewareError> {
        (**self).enter_node(node)
    }

    fn leave_node(&self, node: &str) {
        (**self).leave_node(node);
    }

    fn nodes(&self, each: &mut dyn FnMut(&str)) {
        (**self).nodes(each);
    }

    fn watch(&self, end: End, watch: &Arc<dyn Watch>) -> Result<(), MiddlewareError> {
        (**self).watch(end, watch)
    }

    fn next_incompatible_qos(&self) -> Option<IncompatibleQos> {
        (**self).next_incompatible_qos()
    }

    fn next_oversize(&self) -> Option<(ReaderId, usize)> {
        (**self).next_oversize()
    }

    fn wait(&self, interest: &Interest, deadline: Option<Nanos>) -> Result<(), MiddlewareError> {
        (**self).wait(interest, deadline)
    }

    fn take(
        &self,
        interest: &mut Interest,
        sink: &mut dyn FnMut(ReaderId, &SampleInfo, &[u8]) -> Room,
    ) -> Result<usize, MiddlewareError> {
        (**self).take(interest, sink)
    }

    fn wake(&self) {
        (**self).wake();
    }

    fn status_generation(&self) -> Option<usize> {
        (**self).status_generation()
    }

    fn link(&self) -> LinkState {
        (**self).link()
    }

    fn memory(&self, reader: ReaderId) -> usize {
        (**self).memory(reader)
    }

    fn lost(&self, reader: ReaderId) -> u64 {
        (**self).lost(reader)
    }
}
