//! Topics inside one process: for tests, and for nodes that live together.
//!
//! One lock with priority inheritance guards a bus; it is held while one short sample's bytes are
//! copied into the queues of its readers, or while one buffer changes hands, never across a wait.
//! Long samples are copied without it (`long`). Every queue is allocated when its reader is
//! created.
//!
//! ```text
//!   bus: the state under the lock ──► clashes · matched · watched ──► notices
//!     │                                 promises: deadlines and leases
//!     └──► services      long: long samples      in_memory: messages that are lent
//! ```

mod bus;
mod clashes;
mod in_memory;
mod long;
mod matched;
mod notices;
mod promises;
mod services;
mod watched;

use super::places::{free_number, put};
use super::watch::{End, EndStatus, Watch, Watches};
use super::{
    EndpointSpec, GraphEnd, IncompatibleQos, Interest, LinkState, Middleware, MiddlewareError,
    PublishError, ReaderId, RequestIdentity, Room, SampleInfo, ServiceSpec, WriterId,
};
use crate::Nanos;
use crate::handoff::{Ring, Shared};
use crate::platform;
use crate::platform::{LocalReader, label};
use crate::qos::{Durability, History, IngressLimit, Reliability};
use crate::sync::{Arc, Mutex, Notify};
use alloc::vec::Vec;
use bus::{Bus, LONG, LONG_SAMPLES, Participant, Reader, Writer, id};
use core::fmt;
use notices::{Clashes, Oversizes};
use promises::{deadline, earlier, lease, promised};
use replenish_os::clock;

/// Samples that one `take` hands over at most.
const BATCH: usize = 64;

/// Carries samples between the contexts made from it. Clones are the same bus.
///
/// ```
/// use replenish::{Context, middleware::InProcessBus};
/// let bus = InProcessBus::new();
/// let (ping, pong) = (Context::new(bus.participant()), Context::new(bus.participant()));
/// # let _ = (ping, pong);
/// ```
#[derive(Clone)]
pub struct InProcessBus {
    state: Arc<Mutex<Bus>>,
}

impl InProcessBus {
    /// A bus without participants.
    #[must_use]
    pub fn new() -> Self {
        Self {
            state: Arc::new(Mutex::new(Bus::default())),
        }
    }

    /// One end of the bus, for one context. At most 64 at a time; a further one cannot create
    /// endpoints. When it is dropped, its place and all its endpoints are free again.
    #[must_use]
    pub fn participant(&self) -> InProcess {
        let bell = Arc::new(Notify::new());
        let clashes = Clashes::new(false);
        let oversizes = Oversizes::new(true);
        let me = self.state.lock().enter(Participant {
            bell: Arc::clone(&bell),
            waits_for: None,
            next: 0,
            readers: Vec::new(),
            writers: Vec::new(),
            nodes: Vec::new(),
            clashes: Arc::clone(&clashes),
            watches: Watches::default(),
        });
        InProcess {
            bus: self.clone(),
            bell,
            clashes,
            oversizes,
            me,
        }
    }

    /// Rings the participants of these bits. Not under the lock: it would wake a thread into it.
    fn ring(&self, mut wake: u64) {
        while wake != 0 {
            let bell = self.bell(wake.trailing_zeros() as usize);
            bell.iter().for_each(|bell| bell.set());
            wake &= wake - 1;
        }
    }

    fn bell(&self, participant: usize) -> Option<Arc<Notify>> {
        let bus = self.state.lock();
        bus.participant(participant).map(|p| Arc::clone(&p.bell))
    }
}

impl Default for InProcessBus {
    fn default() -> Self {
        Self::new()
    }
}

impl fmt::Debug for InProcessBus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("InProcessBus").finish_non_exhaustive()
    }
}

/// One end of an [`InProcessBus`].
pub struct InProcess {
    bus: InProcessBus,
    bell: Arc<Notify>,
    clashes: Arc<Clashes>,
    oversizes: Arc<Oversizes>,
    me: usize,
}

impl Drop for InProcess {
    fn drop(&mut self) {
        let (gone, told) = {
            let mut bus = self.bus.state.lock();
            (bus.leave(self.me), bus.watchers())
        };
        drop(gone); // its memory is freed without the lock
        self.bus.ring(told);
    }
}

impl fmt::Debug for InProcess {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("InProcess")
            .field("participant", &self.me)
            .finish_non_exhaustive()
    }
}

impl Middleware for InProcess {
    fn create_writer(&self, spec: &EndpointSpec<'_>) -> Result<WriterId, MiddlewareError> {
        let late = spec.qos.durability == Durability::TransientLocal;
        let mut bus = self.bus.state.lock();
        let writers = &bus.me(self.me)?.writers;
        let id = free_number(writers, |w| w.deleted, "writers of one context")?;
        let topic = bus.join(spec)?;
        let mut status = EndStatus::default();
        let told = bus.compare_writer(self.me, topic, spec.qos, &mut status);
        let writer = Writer {
            node: spec.node.into(),
            topic,
            offers: spec.qos,
            limit: spec.max_size,
            sent: 0,
            replies: None,
            wrote_bytes: false,
            kept: late.then(|| Ring::new(spec.qos.depth.into(), spec.max_size)),
            status,
            deadline: deadline(spec.qos),
            lease: lease(spec.qos),
            deleted: false,
        };
        put(&mut bus.me(self.me)?.writers, id.into(), writer);
        drop(bus);
        self.bus.ring(told);
        Ok(WriterId(id))
    }

    fn create_reader(&self, spec: &EndpointSpec<'_>) -> Result<ReaderId, MiddlewareError> {
        if spec.ingress != IngressLimit::none() {
            return Err(MiddlewareError::Unsupported(label(
                "limits on what peers send",
            )));
        }
        let depth = spec.qos.depth.into();
        let mut reader = Reader {
            id: ReaderId(0),
            node: spec.node.into(),
            topic: 0,
            limit: spec.max_size,
            oversizes: Arc::clone(&self.oversizes),
            requests: spec.qos,
            queue: Ring::new(depth, spec.max_size),
            local: None,
            last_share: 0,
            lent: false,
            keep_all: spec.qos.history == History::KeepAll,
            keep_oldest: spec.keep_oldest,
            reliable: spec.qos.reliability == Reliability::Reliable,
            lost: 0,
            status: EndStatus::default(),
            deadline: deadline(spec.qos),
            deleted: false,
            stamp: 0,
        };
        let mut bus = self.bus.state.lock();
        let readers = &bus.me(self.me)?.readers;
        let id = free_number(readers, |r| r.deleted, "readers of one context")?;
        let topic = bus.join(spec)?;
        (reader.id, reader.topic) = (ReaderId(id), topic);
        reader.stamp = bus.next_stamp();
        if spec.qos.durability == Durability::TransientLocal {
            bus.catch_up(topic, &mut reader);
        }
        put(&mut bus.me(self.me)?.readers, id.into(), reader);
        if let Some(topic) = bus.topics.get_mut(topic) {
            topic.readers.push((self.me, id.into()));
        }
        let told = bus.compare_reader(self.me, ReaderId(id), topic, spec.qos);
        drop(bus);
        self.bus.ring(told);
        Ok(ReaderId(id))
    }

    fn delete_reader(&self, reader: ReaderId) -> Result<(), MiddlewareError> {
        let told = {
            let mut bus = self.bus.state.lock();
            bus.delete_reader(self.me, reader.0.into());
            bus.watchers()
        };
        self.bus.ring(told);
        Ok(())
    }

    fn delete_writer(&self, writer: WriterId) {
        let told = {
            let mut bus = self.bus.state.lock();
            bus.delete_writer(self.me, writer.0.into());
            bus.watchers()
        };
        self.bus.ring(told);
    }

    /// Delivers to every reader of the topic. [`PublishError::Full`] if a reliable reader that
    /// keeps all had no room; the others have got the sample.
    fn publish(&self, writer: WriterId, payload: &[u8]) -> Result<(), PublishError> {
        if LONG_SAMPLES && payload.len() >= LONG {
            return self.publish_long(writer, payload, None);
        }
        let (wake, full) = {
            let mut bus = self.bus.state.lock();
            let (writer, info) = bus.begin(self.me, writer, payload.len())?;
            let begins = writer.renew(info.arrival);
            writer.wrote_bytes = true;
            let topic = (writer.topic, writer.offers);
            if let Some(kept) = &mut writer.kept
                && let Some(mut slot) = kept.spare()
            {
                slot.fill(payload, &info);
                if let Some(oldest) = kept.push(slot) {
                    kept.give_back(oldest);
                }
            }
            let told = if begins { bus.watchers() } else { 0 };
            let (wake, full) = bus.distribute(topic, payload, &info);
            (wake | told, full)
        };
        self.bus.ring(wake);
        if full {
            Err(PublishError::Full)
        } else {
            Ok(())
        }
    }

    fn share_with(&self, reader: ReaderId, local: LocalReader<dyn Middleware>) {
        self.reader(reader.0.into(), |r| r.local = Some(local));
    }

    fn publish_shared(
        &self,
        writer: WriterId,
        message: &Shared,
        payload: Option<&[u8]>,
    ) -> Result<bool, PublishError> {
        self.share(writer, message, payload)
    }

    fn create_server(
        &self,
        spec: &ServiceSpec<'_>,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        self.service_server(spec)
    }

    fn create_client(
        &self,
        spec: &ServiceSpec<'_>,
    ) -> Result<(ReaderId, WriterId), MiddlewareError> {
        self.service_client(spec)
    }

    fn request(&self, client: WriterId, payload: &[u8]) -> Result<u64, PublishError> {
        self.send_request(client, payload)
    }

    fn reply(
        &self,
        server: WriterId,
        to: &RequestIdentity,
        payload: &[u8],
    ) -> Result<(), PublishError> {
        self.send_reply(server, to, payload)
    }

    fn has_server(&self, client: WriterId) -> Option<bool> {
        self.knows_server(client)
    }

    fn matched_readers(&self, writer: WriterId) -> Option<usize> {
        self.bus.state.lock().count_readers(self.me, writer)
    }

    fn graph(&self, each: &mut dyn FnMut(&GraphEnd<'_>)) -> bool {
        self.every_end(each);
        true
    }

    fn enter_node(&self, node: &str) -> Result<(), MiddlewareError> {
        // Without a place in the bus, its first endpoint is refused.
        if let Ok(me) = self.bus.state.lock().me(self.me) {
            me.nodes.push(node.into());
        }
        Ok(())
    }

    fn leave_node(&self, node: &str) {
        if let Ok(me) = self.bus.state.lock().me(self.me) {
            let at = me.nodes.iter().position(|known| &**known == node);
            at.map(|at| me.nodes.swap_remove(at));
        }
    }

    fn nodes(&self, each: &mut dyn FnMut(&str)) {
        let bus = self.bus.state.lock();
        let nodes = bus.participants().flat_map(|(_, p)| &p.nodes);
        nodes.for_each(|node| each(node));
    }

    fn matched_writers(&self, reader: ReaderId) -> Option<usize> {
        self.bus.state.lock().count_writers(self.me, reader)
    }

    fn watch(&self, end: End, watch: &Arc<dyn Watch>) -> Result<(), MiddlewareError> {
        self.add_watch(end, watch)
    }

    fn assert_liveliness(&self, writer: WriterId) -> Result<(), PublishError> {
        self.show_life(writer)
    }

    fn wait(&self, interest: &Interest, deadline: Option<Nanos>) -> Result<(), MiddlewareError> {
        let deadline = {
            let mut bus = self.bus.state.lock();
            let me = bus.me(self.me)?;
            let mut readers = me.readers.iter().enumerate();
            if readers.any(|(r, reader)| reader.queue.len() > 0 && interest.contains(id(r))) {
                return Ok(());
            }
            me.waits_for = Some(*interest);
            earlier(deadline, bus.next_promise(self.me))
        };
        match deadline {
            Some(at) => drop(self.bell.wait_until(at)),
            None => self.bell.wait(),
        }
        self.bus.state.lock().me(self.me)?.waits_for = None;
        Ok(())
    }

    fn take(
        &self,
        interest: &mut Interest,
        sink: &mut dyn FnMut(ReaderId, &SampleInfo, &[u8]) -> Room,
    ) -> Result<usize, MiddlewareError> {
        let mut taken = 0;
        let (mut at, readers, watched) = {
            let mut bus = self.bus.state.lock();
            let me = bus.me(self.me)?;
            (me.next, me.readers.len(), !me.watches.is_empty())
        };
        let mut idle = 0; // readers in a row that had nothing
        while taken < BATCH && idle < readers {
            at = (at + 1) % readers;
            let reader = id(at);
            let slot = if interest.contains(reader) {
                self.reader(at, Reader::lend).flatten()
            } else {
                None
            };
            let Some((slot, stamp)) = slot else {
                idle += 1;
                continue;
            };
            idle = 0;
            taken += 1;
            let info = *slot.info();
            if sink(reader, &info, slot.payload()) == Room::Full {
                interest.remove(reader);
            }
            // Another reader may have its place by now, with buffers of another size.
            self.reader(at, |r| {
                if r.stamp == stamp {
                    r.lent = false;
                    r.queue.give_back(slot);
                } else {
                    drop(slot);
                }
            });
        }
        self.bus.state.lock().me(self.me)?.next = at;
        if watched {
            self.tell_watches();
        }
        Ok(taken)
    }

    fn wake(&self) {
        self.bell.set();
    }

    fn link(&self) -> LinkState {
        LinkState::Up
    }

    fn next_incompatible_qos(&self) -> Option<IncompatibleQos> {
        self.clashes.next()
    }

    fn next_oversize(&self) -> Option<(ReaderId, usize)> {
        self.oversizes.next()
    }

    fn memory(&self, reader: ReaderId) -> usize {
        self.reader(reader.0.into(), |r| r.queue.memory())
            .unwrap_or(0)
    }

    fn lost(&self, reader: ReaderId) -> u64 {
        self.reader(reader.0.into(), |r| r.lost).unwrap_or(0)
    }
}

impl Bus {
    /// The writer of a sample of `size` bytes, and the sample's facts.
    fn begin(
        &mut self,
        me: usize,
        writer: WriterId,
        size: usize,
    ) -> Result<(&mut Writer, SampleInfo), PublishError> {
        let mine = self.participant_mut(me);
        let writer = mine.and_then(|p| p.writers.get_mut(usize::from(writer.0)));
        let writer = writer.filter(|w| !w.deleted);
        let writer = writer.ok_or(PublishError::UnknownWriter)?;
        let limit = writer.limit;
        if size > limit {
            return Err(PublishError::TooLarge { size, limit });
        }
        writer.sent += 1;
        let arrival = clock::monotonic();
        let info = SampleInfo {
            source_timestamp: wall_clock(),
            sequence: Some(writer.sent),
            origins: platform::chain::current(),
            expires: promised(writer.offers.lifespan).map(|time| arrival.saturating_add(time)),
            ..SampleInfo::at(arrival)
        };
        Ok((writer, info))
    }
}

impl InProcess {
    fn reader<T>(&self, at: usize, f: impl FnOnce(&mut Reader) -> T) -> Option<T> {
        let mut bus = self.bus.state.lock();
        bus.me(self.me).ok()?.readers.get_mut(at).map(f)
    }
}

/// Nanoseconds since the Unix epoch.
fn wall_clock() -> Option<Nanos> {
    u64::try_from(platform::wall_clock()?.as_nanos()).ok()
}
