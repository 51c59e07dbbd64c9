//! Own endpoints, which come and go.

use super::announcements::{announce, dispose};
use super::config::{ConfigError, EndpointSpec};
use super::promises::Promises;
use super::remote::{RemoteEndpoint, Text};
use super::state::{Own, Participant, ReaderId, WriterId};
use super::status::EndpointStatus;
use crate::endpoint::{Reader, ReaderLimits, Writer, WriterLimits};
use crate::wire::{EndpointData, EntityId, Guid, Nanos};

impl Participant {
    /// Makes a writer and announces it.
    ///
    /// # Errors
    /// [`ConfigError`].
    pub fn create_writer(
        &mut self,
        spec: &EndpointSpec<'_>,
        now: Nanos,
    ) -> Result<WriterId, ConfigError> {
        let (samples, topic, type_name) = checked(spec)?;
        if self.writers.len() >= self.most_own {
            return Err(ConfigError::Full);
        }
        let guid = Guid::new(self.prefix, EntityId::writer(self.take_key()));
        let limits = WriterLimits {
            samples,
            sample_bytes: spec.sample_bytes,
            readers: self.peers_of(spec),
            fragment_bytes: self.fragment,
            memory: spec.memory,
            host: self.host,
        };
        self.writers.push(Own {
            endpoint: Writer::new(guid, spec.qos, &limits),
            topic,
            type_name,
            announced: announce(&mut self.publications.0, guid, spec, now),
            status: EndpointStatus::default(),
            promises: Promises::of(&spec.qos),
            moved: false,
        });
        self.promise(&spec.qos);
        self.plan_assertions(now);
        self.match_writer(guid.entity, now);
        self.meet_own(guid, spec, now);
        Ok(WriterId(guid.entity))
    }

    /// Makes a reader and announces it.
    ///
    /// # Errors
    /// [`ConfigError`].
    pub fn create_reader(
        &mut self,
        spec: &EndpointSpec<'_>,
        now: Nanos,
    ) -> Result<ReaderId, ConfigError> {
        let (samples, topic, type_name) = checked(spec)?;
        if self.readers.len() >= self.most_own {
            return Err(ConfigError::Full);
        }
        let guid = Guid::new(self.prefix, EntityId::reader(self.take_key()));
        let mut spec = *spec;
        if spec.per_participant {
            spec.unicast = self.discovery;
        }
        let spec = &spec;
        let limits = ReaderLimits {
            samples,
            sample_bytes: spec.sample_bytes,
            writers: self.peers_of(spec),
        };
        self.readers.push(Own {
            endpoint: Reader::new(guid, spec.qos, &limits),
            topic,
            type_name,
            announced: announce(&mut self.subscriptions.0, guid, spec, now),
            status: EndpointStatus::default(),
            promises: Promises::of(&spec.qos),
            moved: false,
        });
        self.promise(&spec.qos);
        self.match_reader(guid.entity, now);
        self.meet_own(guid, spec, now);
        Ok(ReaderId(guid.entity))
    }

    /// Own endpoints of one topic exchange samples like those of two participants: through the
    /// sockets.
    fn meet_own(&mut self, guid: Guid, spec: &EndpointSpec<'_>, now: Nanos) {
        if self.apart || spec.per_participant {
            return;
        }
        let mut data = EndpointData::new(guid, spec.topic, spec.type_name, spec.qos);
        data.segment = spec.segment;
        let (reach, own) = (self.reach, &self.discovery);
        let to = spec.unicast.best(reach, own);
        let to = to.or_else(|| self.user.best(reach, own));
        if let (Some(mut own), Some(to)) = (RemoteEndpoint::new(&data), to) {
            own.to = to;
            own.type_hash = spec.type_hash;
            self.learn(own, now);
        }
    }

    /// The most peers of an endpoint.
    fn peers_of(&self, spec: &EndpointSpec<'_>) -> usize {
        if spec.per_participant {
            self.matches.max(self.most_participants)
        } else {
            self.matches
        }
    }

    fn take_key(&mut self) -> u32 {
        let key = self.next_key;
        self.next_key = key.wrapping_add(1) & 0x00ff_ffff;
        key
    }

    /// Removes a writer; its peers hear of it.
    pub fn remove_writer(&mut self, id: WriterId, now: Nanos) {
        let Some(at) = self
            .writers
            .iter()
            .position(|own| own.endpoint.entity() == id.0)
        else {
            return;
        };
        let own = self.writers.swap_remove(at);
        self.plan_assertions(now);
        self.unlearn(own.endpoint.guid(), now);
        dispose(
            &mut self.publications.0,
            own.endpoint.guid(),
            own.announced,
            now,
        );
    }

    /// Removes a reader; its peers hear of it.
    pub fn remove_reader(&mut self, id: ReaderId, now: Nanos) {
        let found = self
            .readers
            .iter()
            .position(|own| own.endpoint.guid().entity == id.0);
        let Some(at) = found else {
            return;
        };
        let own = self.readers.swap_remove(at);
        self.unlearn(own.endpoint.guid(), now);
        dispose(
            &mut self.subscriptions.0,
            own.endpoint.guid(),
            own.announced,
            now,
        );
    }
}

fn checked(spec: &EndpointSpec<'_>) -> Result<(usize, Text, Text), ConfigError> {
    let samples = spec.check()?;
    let text = |text| Text::new(text).ok_or(ConfigError::Full);
    Ok((samples, text(spec.topic)?, text(spec.type_name)?))
}
