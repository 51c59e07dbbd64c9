//! The contract of whatever carries the bytes.

use super::error::{MiddlewareError, PublishError};
use super::ids::{ReaderId, WriterId};
use super::incompatible_qos::IncompatibleQos;
use super::interest::Interest;
use super::source::Source;
use super::watch::{End, Watch};
use crate::Nanos;
use crate::handoff::{RequestIdentity, SampleInfo, Shared};
use crate::platform::{LocalReader, SourceSet, label};
use crate::qos::{IngressLimit, Qos};
use crate::sync::Arc;
use alloc::boxed::Box;

/// The topic, type and QoS of a reader or writer. Names are valid ROS names when they get here.
#[derive(Debug, Clone, Copy)]
pub struct EndpointSpec<'a> {
    /// Fully qualified node name, `"/pong"`.
    pub node: &'a str,
    /// Fully qualified topic name, `"/high_ping"`.
    pub topic: &'a str,
    /// `"std_msgs/msg/Int32"`.
    pub type_name: &'a str,
    /// `"std_msgs::msg::dds_::Int32_"`.
    pub dds_type_name: &'a str,
    /// The type's hash, `RIHS01_` and 64 hexadecimal digits, if it is known. Without feature `std`
    /// it is not passed on.
    pub type_hash: Option<&'a str>,
    /// Reliability, history, depth.
    pub qos: Qos,
    /// The largest payload in bytes, without encapsulation header.
    pub max_size: usize,
    /// The samples that the peer may send for a reader.
    pub ingress: IngressLimit,
    /// Keep last, and what waits for a reader is kept: a new sample is lost while there is no room.
    pub keep_oldest: bool,
}

/// The service, types and QoS of a client or server.
#[derive(Debug, Clone, Copy)]
pub struct ServiceSpec<'a> {
    /// Fully qualified node name.
    pub node: &'a str,
    /// Fully qualified service name, `"/add"`.
    pub service: &'a str,
    /// `"example_interfaces/srv/AddTwoInts"`.
    pub type_name: &'a str,
    /// The DDS type of requests, `"example_interfaces::srv::dds_::AddTwoInts_Request_"`.
    pub request_type: &'a str,
    /// The DDS type of replies.
    pub response_type: &'a str,
    /// The service's hash, as that of [`EndpointSpec`].
    pub type_hash: Option<&'a str>,
    /// Reliability, history, depth of requests and replies.
    pub qos: Qos,
    /// The largest request in bytes.
    pub max_request: usize,
    /// The largest reply in bytes.
    pub max_response: usize,
}

/// An endpoint of the graph, of this program or of another one.
#[derive(Debug, Clone, Copy)]
pub struct GraphEnd<'a> {
    /// Fully qualified name of its topic or service, `"/chatter"`.
    pub name: &'a str,
    /// `"std_msgs/msg/Int32"`, `"example_interfaces/srv/AddTwoInts"`.
    pub type_name: &'a str,
    /// Whether it is an end of a service: a server reads, a client writes.
    pub service: bool,
    /// Whether it writes.
    pub writes: bool,
    /// Its quality, as far as it says it.
    pub qos: Qos,
    /// Fully qualified name of its node, as far as that is known.
    pub node: Option<&'a str>,
}

/// The answer to a delivered sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Room {
    /// The reader may be given more in the same [`Middleware::take`].
    Left,
    /// The sample was accepted, but no further one of this reader until the next call.
    Full,
}

/// Whether samples can be exchanged at the moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LinkState {
    /// The peer answers (or there is no peer to lose).
    Up,
    /// The peer has not been heard of since this instant.
    Down {
        /// When it was last heard of.
        since: Nanos,
    },
}

/// Carries samples between writers and readers.
///
/// # Threads
/// Every method may be called from any thread, with one exception: [`wait`](Self::wait) and
/// [`take`](Self::take) are called by one thread at a time. Locks inside have priority inheritance.
///
/// # Allocation
/// After the endpoints exist, no method allocates.
pub trait Middleware: Send + Sync + 'static {
    /// Creates a writer. Set-up only: it may wait for a peer's answer and allocate.
    ///
    /// # Errors
    /// When the peer refuses or does not answer, or a bound is reached.
    fn create_writer(&self, spec: &EndpointSpec<'_>) -> Result<WriterId, MiddlewareError>;

    /// Creates a reader. Set-up only, like [`create_writer`](Self::create_writer).
    ///
    /// # Errors
    /// When the peer refuses or does not answer, or a bound is reached.
    fn create_reader(&self, spec: &EndpointSpec<'_>) -> Result<ReaderId, MiddlewareError>;

    /// The longest sample, in bytes, of a reader with this quality of service, or of a writer if
    /// `writes`. An endpoint whose program states no size is made for samples of the type's usual
    /// size or of this one, whichever is less.
    fn longest(&self, qos: &Qos, writes: bool) -> usize {
        let _ = (qos, writes);
        usize::MAX
    }

    /// Whether it is ROS 2 itself, whose tools listen to `/diagnostics` and `/statistics`: an
    /// executor publishes them then, unless its program says otherwise.
    fn is_ros(&self) -> bool {
        false
    }

    /// Whether [`source`](Self::source) may give any: workers then wait in a way that costs them a
    /// few descriptors.
    fn has_sources(&self) -> bool {
        false
    }

    /// From now on the thread of its callback takes the samples of `reader`, and waits for them in
    /// `set`, to which the descriptors are added under `key`: no [`take`](Self::take) hands them
    /// over any more. `None`: the dispatcher takes them as before. Set-up, like the reader.
    fn source(&self, reader: ReaderId, set: &SourceSet, key: u32) -> Option<Box<dyn Source>> {
        let _ = (reader, set, key);
        None
    }

    /// Deletes a reader; its id may be given out again. Any thread, like
    /// [`create_reader`](Self::create_reader). [`wait`](Self::wait) and [`take`](Self::take) have
    /// no interest in it any more.
    ///
    /// # Errors
    /// [`MiddlewareError::Unsupported`] where readers stay until the end.
    fn delete_reader(&self, reader: ReaderId) -> Result<(), MiddlewareError> {
        let _ = reader;
        Err(MiddlewareError::Unsupported(label("deleting readers")))
    }

    /// A writer is not used any more: its id may be given out again. That of a service or client
    /// goes when its reader was [deleted](Self::delete_reader), too. What was published before is
    /// still sent. Any thread; waits for nobody.
    fn delete_writer(&self, writer: WriterId) {
        let _ = writer;
    }

    /// Sends one encoded sample: CDR without encapsulation header.
    ///
    /// Takes the session lock for as long as the bytes need, never waits for a peer, for room or
    /// for the dispatcher.
    ///
    /// # Errors
    /// When the sample was not sent: too large, no room in the output stream, link down.
    fn publish(&self, writer: WriterId, payload: &[u8]) -> Result<(), PublishError>;

    /// As [`publish`](Self::publish), with a sample that `encode` writes where its writer keeps it:
    /// nothing is copied in between. `encode` is called once, without a lock of the middleware. It
    /// gets room for the longest sample, and returns the sample's length, or `None` to send none.
    ///
    /// `None`: nothing was done, and the caller publishes bytes. There is no such place at the
    /// moment, or in this middleware.
    fn publish_with(
        &self,
        _writer: WriterId,
        _encode: &mut dyn FnMut(&mut [u8]) -> Option<usize>,
    ) -> Option<Result<(), PublishError>> {
        None
    }

    /// The handle of this reader takes messages of its Rust type as they are in memory from now on,
    /// by [`publish_shared`](Self::publish_shared), and everything else as bytes. Set-up, like the
    /// reader. A middleware that does not know of it hands over bytes.
    fn share_with(&self, reader: ReaderId, local: LocalReader<dyn Middleware>) {
        let _ = (reader, local);
    }

    /// Sends a message that is in memory to the readers that [take it as it is](Self::share_with),
    /// and its `payload` to the others. Waits for nothing, like [`publish`](Self::publish).
    ///
    /// `false`: nothing was sent, for want of the payload. The caller writes it and asks again.
    ///
    /// # Errors
    /// As [`publish`](Self::publish).
    fn publish_shared(
        &self,
        writer: WriterId,
        message: &Shared,
        payload: Option<&[u8]>,
    ) -> Result<bool, PublishError> {
        let _ = message;
        let Some(payload) = payload else {
            return Ok(false);
        };
        self.publish(writer, payload).map(|()| true)
    }

    /// A writer whose liveliness is manual shows that it is alive, without a sample. Waits for
    /// nothing, like [`publish`](Self::publish).
    ///
    /// # Errors
    /// [`PublishError::UnknownWriter`], also where the middleware does not know of liveliness.
    fn assert_liveliness(&self, writer: WriterId) -> Result<(), PublishError> {
        let _ = writer;
        Err(PublishError::UnknownWriter)
    }

    /// Creates a service's server: the reader of its requests, which come with their
    /// [identity](SampleInfo::request), and the writer of its replies. Set-up, like a reader.
    ///
    /// # Errors
    /// As [`create_reader`](Self::create_reader).
    fn create_server(
        &self,
        spec: &ServiceSpec<'_>,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        let _ = spec;
        Err(MiddlewareError::Unsupported(label("services")))
    }

    /// Creates a service's client: the reader of its replies, which come with the
    /// [number](RequestIdentity::number) of their request, and the writer of its requests.
    ///
    /// # Errors
    /// As [`create_reader`](Self::create_reader).
    fn create_client(
        &self,
        spec: &ServiceSpec<'_>,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        let _ = spec;
        Err(MiddlewareError::Unsupported(label("services")))
    }

    /// Sends a request; its number. Waits for nothing, like [`publish`](Self::publish).
    ///
    /// # Errors
    /// When it was not sent.
    fn request(&self, client: WriterId, payload: &[u8]) -> Result<u64, PublishError> {
        let _ = (client, payload);
        Err(PublishError::UnknownWriter)
    }

    /// Sends the reply to a request. Waits for nothing, like [`publish`](Self::publish).
    ///
    /// # Errors
    /// When it was not sent.
    fn reply(
        &self,
        server: WriterId,
        to: &RequestIdentity,
        payload: &[u8],
    ) -> Result<(), PublishError> {
        let _ = (server, to, payload);
        Err(PublishError::UnknownWriter)
    }

    /// Whether this client's service has a server; `None` where the middleware does not know. Does
    /// not wait.
    fn has_server(&self, client: WriterId) -> Option<bool> {
        let _ = client;
        None
    }

    /// How many readers this writer's samples reach, those of other programs included; `None` where
    /// the middleware does not know. Does not wait.
    fn matched_readers(&self, writer: WriterId) -> Option<usize> {
        let _ = writer;
        None
    }

    /// How many writers' samples this reader gets; `None` where the middleware does not know. Does
    /// not wait.
    fn matched_writers(&self, reader: ReaderId) -> Option<usize> {
        let _ = reader;
        None
    }

    /// Calls `each` for every endpoint that is known; `false` where the middleware does not know of
    /// any but its own. `each` does not call back into the middleware.
    fn graph(&self, _each: &mut dyn FnMut(&GraphEnd<'_>)) -> bool {
        false
    }

    /// A node of this program has come: others see it even while it has no endpoint. Set-up only.
    ///
    /// # Errors
    /// A bound is reached.
    fn enter_node(&self, node: &str) -> Result<(), MiddlewareError> {
        let _ = node;
        Ok(())
    }

    /// The node is gone: one call for each [`enter_node`](Self::enter_node). It is seen for as long
    /// as it has endpoints.
    fn leave_node(&self, node: &str) {
        let _ = node;
    }

    /// Calls `each` with the fully qualified name of every node that is known, beyond those of the
    /// [graph](Self::graph)'s endpoints. `each` does not call back into the middleware.
    fn nodes(&self, _each: &mut dyn FnMut(&str)) {}

    /// Tells `watch` of what becomes of an endpoint, first of what has become of it so far, then of
    /// each change, from the thread that calls [`take`](Self::take). An endpoint has one watch at a
    /// time. Set-up, like a reader.
    ///
    /// # Errors
    /// [`MiddlewareError::Unsupported`] where the middleware does not know;
    /// [`MiddlewareError::Capacity`] if it has a watch that is not
    /// [closed](Watch::is_closed).
    fn watch(&self, end: End, watch: &Arc<dyn Watch>) -> Result<(), MiddlewareError> {
        let _ = (end, watch);
        Err(MiddlewareError::Unsupported(label(
            "events of endpoints, which no agent tells",
        )))
    }

    /// The next pair of incompatible endpoints, one of them of this end; each pair once. The
    /// dispatcher calls it when [`status_generation`](Self::status_generation) has changed.
    fn next_incompatible_qos(&self) -> Option<IncompatibleQos> {
        None
    }

    /// The next sample for one of its readers that was longer than the reader takes, and how long
    /// it was; each is told once. For a middleware that does not hand such samples to
    /// [`take`](Self::take)'s `sink`, which is to refuse them. Called by the dispatcher when there
    /// are [news](Self::status_generation); without feature `texts` it is not called. What is told
    /// here is not among those [lost](Self::lost).
    fn next_oversize(&self) -> Option<(ReaderId, usize)> {
        None
    }

    /// Waits until a reader in `interest` has data, [`wake`](Self::wake) was called, the middleware
    /// has housekeeping to do in [`take`](Self::take), or `deadline` has passed.
    ///
    /// Holds no lock while it waits. Returns at once if buffered data of a reader in `interest` is
    /// there, or if `wake` was called since the last `wait` returned. Early returns are
    /// allowed as long as they are rare; data of readers outside `interest` is no reason to return
    /// more than once per datagram.
    ///
    /// # Errors
    /// When it cannot wait. The dispatcher counts it and tries again after a pause.
    fn wait(&self, interest: &Interest, deadline: Option<Nanos>) -> Result<(), MiddlewareError>;

    /// Hands a bounded batch of samples of the readers in `interest` to `sink`, in order of arrival
    /// per reader, and returns how many.
    ///
    /// Called after every `wait`, also with an empty `interest`: acknowledgements, heartbeats and
    /// the like are handled here, on the dispatcher's priority. With [`Room::Full`] the reader
    /// leaves `interest`, and gets no further sample in this call. `sink` only copies bytes; it may
    /// be called with the session lock held and never calls back into the middleware.
    ///
    /// # Errors
    /// When bytes could not be read. Samples already handed to `sink` count.
    fn take(
        &self,
        interest: &mut Interest,
        sink: &mut dyn FnMut(ReaderId, &SampleInfo, &[u8]) -> Room,
    ) -> Result<usize, MiddlewareError>;

    /// Ends the current [`wait`](Self::wait), or the next one if nobody waits.
    fn wake(&self);

    /// A number that changes whenever [`link`](Self::link) or
    /// [`next_incompatible_qos`](Self::next_incompatible_qos) or
    /// [`next_oversize`](Self::next_oversize) may have a new answer; `None`: the dispatcher
    /// asks each time. Called by the dispatcher in every round.
    fn status_generation(&self) -> Option<usize> {
        None
    }

    /// Whether samples can be exchanged at the moment.
    fn link(&self) -> LinkState;

    /// Bytes that the middleware itself has taken for samples of `reader`.
    fn memory(&self, reader: ReaderId) -> usize {
        let _ = reader;
        0
    }

    /// Samples of `reader` that the middleware itself had to drop because its own buffer was full.
    fn lost(&self, reader: ReaderId) -> u64 {
        let _ = reader;
        0
    }
}
