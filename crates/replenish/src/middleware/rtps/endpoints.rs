//! Making and removing nodes, readers and writers.

use super::adapter::Rtps;
use super::ends::{ReaderEnd, WriterEnd};
use super::new_end::{NewEnd, failed};
use super::qos::{LONG, name_too_long, places, refused};
use super::shared::Spare;
use super::state::State;
use crate::middleware::places::{free_number, put};
use crate::middleware::watch::End;
use crate::middleware::{MiddlewareError, ReaderId, WriterId};
use crate::platform::zeroed;
use replenish_os::clock;
use replenish_rtps::participant as rtps;
use replenish_rtps::ros::dds_topic;
use replenish_rtps::wire::Locators;

impl Rtps {
    pub(super) fn add_writer(&self, new: &NewEnd<'_>) -> Result<WriterId, MiddlewareError> {
        let topic = dds_topic(new.prefix, new.name).ok_or_else(name_too_long)?;
        let depth = new.qos.depth.into();
        let spare = (new.head == 0).then(|| Spare::new(new.bytes(), depth, self.is_shared));
        let now = clock::monotonic();
        let state = &mut *self.state.lock();
        let free = |end: &WriterEnd| end.id.is_none();
        let number = free_number(&state.writers, free, "publishers of one context")?;
        let spec = rtps::EndpointSpec {
            segment: spare.as_ref().and_then(Spare::segment),
            ..new.spec(topic.as_str(), depth)
        };
        let made = state.participant.create_writer(&spec, now);
        let id = made.map_err(|error| refused(error, self.own_endpoints))?;
        let end = WriterEnd {
            id: Some(id),
            node: new.node.into(),
            topic: new.name.into(),
            limit: new.max_size,
            spare,
            partner: None,
        };
        put(&mut state.writers, number.into(), end);
        let entered = state
            .graph
            .enter(&mut state.participant, new.node, id.entity(), now);
        self.has_changed(state, now);
        let writer = WriterId(number);
        if let Err(error) = entered {
            state.drop_writer(writer, now);
            return Err(error);
        }
        Ok(writer)
    }

    pub(super) fn add_reader(&self, new: &NewEnd<'_>) -> Result<ReaderId, MiddlewareError> {
        let topic = dds_topic(new.prefix, new.name).ok_or_else(name_too_long)?;
        let socket = self.sockets.for_reader();
        let (socket, port) = socket.map_err(|e| failed("open a reader's socket", &e))?;
        let now = clock::monotonic();
        let mut inlets = self.inlets.lock();
        let state = &mut *self.state.lock();
        let free = |end: &ReaderEnd| end.id.is_none();
        let number = free_number(&state.readers, free, "subscriptions of one context")?;
        let (reader, at) = (ReaderId(number), number.into());
        let added = inlets.add(&self.set, reader, socket);
        added.map_err(|e| failed("wait for a reader's socket", &e))?;
        let unicast = state.interfaces.at(port);
        match state.new_reader(new, topic.as_str(), unicast, at, now) {
            Ok(()) => {}
            Err(error) => {
                inlets.remove(reader);
                return Err(refused(error, self.own_endpoints));
            }
        }
        let entity = state
            .readers
            .get(at)
            .and_then(|end| end.id)
            .map(rtps::ReaderId::entity);
        let entered = state.graph.enter(
            &mut state.participant,
            new.node,
            entity.unwrap_or_default(),
            now,
        );
        self.has_changed(state, now);
        if let Err(error) = entered {
            inlets.remove(reader);
            state.drop_reader(reader, now);
            return Err(error);
        }
        Ok(reader)
    }

    pub(super) fn remove_reader(&self, reader: ReaderId) {
        let now = clock::monotonic();
        self.inlets.lock().remove(reader);
        let state = &mut *self.state.lock();
        state.drop_reader(reader, now);
        self.has_changed(state, now);
    }

    pub(super) fn remove_writer(&self, writer: WriterId) {
        let now = clock::monotonic();
        let state = &mut *self.state.lock();
        state.drop_writer(writer, now);
        self.has_changed(state, now);
    }

    pub(super) fn add_node(&self, node: &str) -> Result<(), MiddlewareError> {
        let now = clock::monotonic();
        let state = &mut *self.state.lock();
        let participant = &mut state.participant;
        state.graph.enter_node(participant, node, now)?;
        state.housekeep(now, &self.alarm, &self.sockets);
        Ok(())
    }

    pub(super) fn remove_node(&self, node: &str) {
        let now = clock::monotonic();
        let state = &mut *self.state.lock();
        let participant = &mut state.participant;
        state.graph.leave_node(participant, node, now);
        state.housekeep(now, &self.alarm, &self.sockets);
    }

    /// An endpoint of ours has come or gone: sends what is due. The dispatcher tells watches.
    fn has_changed(&self, state: &mut State, now: crate::Nanos) {
        state.housekeep(now, &self.alarm, &self.sockets);
        if !state.watches.is_empty() {
            self.waker.wake();
        }
    }
}

impl State {
    fn new_reader(
        &mut self,
        new: &NewEnd<'_>,
        topic: &str,
        unicast: Locators,
        at: usize,
        now: crate::Nanos,
    ) -> Result<(), rtps::ConfigError> {
        let places = places(new.qos, new.bytes());
        let spec = rtps::EndpointSpec {
            unicast,
            ..new.spec(topic, places)
        };
        let id = self.participant.create_reader(&spec, now)?;
        let long = new.head == 0 && new.max_size >= LONG;
        let spare = if long { new.bytes() } else { 0 };
        let end = ReaderEnd {
            id: Some(id),
            node: new.node.into(),
            topic: new.name.into(),
            limit: new.max_size,
            memory: places.saturating_mul(new.bytes()).saturating_add(spare),
            dropped: 0,
            unreadable: 0,
            expired: 0,
            service: None,
            owner: None,
            spare: long.then(|| zeroed(new.bytes())),
        };
        put(&mut self.readers, at, end);
        Ok(())
    }

    fn drop_reader(&mut self, reader: ReaderId, now: crate::Nanos) {
        let Some(end) = self.readers.get_mut(usize::from(reader.0)) else {
            return;
        };
        let Some(id) = end.id.take() else {
            return;
        };
        end.service = None;
        end.owner = None;
        end.spare = None;
        self.watches.remove(End::Reader(reader));
        let node = core::mem::take(&mut end.node);
        self.participant.remove_reader(id, now);
        self.graph
            .leave(&mut self.participant, &node, id.entity(), now);
        // The writer of the same service goes with it.
        let partner = self
            .writers
            .iter()
            .position(|end| end.partner == Some(reader));
        if let Some(writer) = partner.and_then(|at| u16::try_from(at).ok()) {
            self.drop_writer(WriterId(writer), now);
        }
    }

    fn drop_writer(&mut self, writer: WriterId, now: crate::Nanos) {
        let Some(end) = self.writers.get_mut(usize::from(writer.0)) else {
            return;
        };
        end.partner = None;
        end.spare = None;
        self.watches.remove(End::Writer(writer));
        let Some(id) = end.id.take() else {
            return;
        };
        let node = core::mem::take(&mut end.node);
        self.participant.remove_writer(id, now);
        self.graph
            .leave(&mut self.participant, &node, id.entity(), now);
    }
}
