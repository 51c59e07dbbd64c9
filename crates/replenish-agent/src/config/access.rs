//! The clients that may log in, from where, and the topics that each may write and read.

use super::limits::Limits;
use super::psk::Psk;
use super::rules::matches_topic;
use crate::entities::Plan;
use replenish_xrce::wire::ClientKey;
use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::Arc;

/// The clients that may log in.
///
/// Without a list every client may log in and write and read every topic. With one a client must be
/// in it by its key, or there must be an entry for all others. A UDP source can be forged:
/// addresses keep out mistakes and hosts that cannot send in the name of others.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AccessList {
    pub(super) grants: HashMap<ClientKey, Arc<Grant>>,
    /// Grant of the clients that are not in it.
    pub(super) others: Option<Arc<Grant>>,
    /// The clients that certificates belong to, by the SHA-256 of the certificate.
    pub(super) certificates: HashMap<[u8; 32], ClientKey>,
}

/// The rights of a client. `None`: as if there were no list.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Grant {
    pub(super) from: Option<Vec<Place>>,
    /// Secrets: a client with one of them logs in over DTLS or TLS alone.
    pub(super) psk: Option<Psk>,
    pub(super) certificate: Option<[u8; 32]>,
    pub(super) client_bytes: Option<usize>,
    pub(super) entities: Option<usize>,
    pub(super) datagrams_per_second: Option<u32>,
    /// Patterns as in [`TopicRule`](super::TopicRule).
    pub(super) write: Option<Vec<Box<str>>>,
    pub(super) read: Option<Vec<Box<str>>>,
}

/// A place from which a client may log in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    /// Hosts whose address begins with the same bits.
    Net { address: IpAddr, bits: u8 },
    /// A serial line.
    Serial,
}

impl AccessList {
    /// The number of entries.
    #[must_use]
    pub fn len(&self) -> usize {
        self.grants.len() + usize::from(self.others.is_some())
    }

    /// Whether the list admits no client.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether there are pre-shared keys in it, which others may not read.
    #[must_use]
    pub fn has_keys(&self) -> bool {
        self.grants.values().any(|grant| grant.psk.is_some())
    }

    /// The rights of a client at `host`, which is `None` on a serial line, whose transport has
    /// shown that it is `identity`; or the part of its log-in that is not in the list.
    pub(crate) fn find(
        &self,
        key: ClientKey,
        host: Option<IpAddr>,
        identity: Option<ClientKey>,
    ) -> Result<&Arc<Grant>, &'static str> {
        if identity.is_some_and(|identity| identity != key) {
            return Err("key for this identity");
        }
        let grant = self.grants.get(&key).or(self.others.as_ref());
        let grant = grant.ok_or("key")?;
        if grant.has_secret() && identity.is_none() {
            return Err("key without encryption");
        }
        let places = grant.from.as_deref();
        let listed = places.is_none_or(|places| places.iter().any(|place| place.contains(host)));
        listed.then_some(grant).ok_or("address")
    }
}

#[cfg(feature = "secure")]
impl AccessList {
    /// The pre-shared key of a client.
    pub(crate) fn psk(&self, key: ClientKey) -> Option<&Psk> {
        self.grants.get(&key)?.psk.as_ref()
    }

    /// The client that a certificate belongs to, by its SHA-256.
    pub(crate) fn owner(&self, certificate: &[u8; 32]) -> Option<ClientKey> {
        self.certificates.get(certificate).copied()
    }
}

impl Grant {
    /// Whether the client must authenticate.
    fn has_secret(&self) -> bool {
        self.psk.is_some() || self.certificate.is_some()
    }

    /// The limits of this client: those of all clients, or smaller ones.
    pub(crate) fn limits(&self, all: &Limits) -> Limits {
        let rate = match (self.datagrams_per_second, all.datagrams_per_second) {
            (Some(own), 0) => own,
            (Some(own), all) => own.min(all),
            (None, all) => all,
        };
        let least = |own: Option<usize>, all: usize| own.map_or(all, |own| own.min(all));
        Limits {
            client_bytes: least(self.client_bytes, all.client_bytes),
            entities: least(self.entities, all.entities),
            datagrams_per_second: rate,
            ..*all
        }
    }

    /// Whether the client may have this entity.
    pub(crate) fn allows(&self, plan: &Plan) -> bool {
        let any = |patterns: &Option<Vec<Box<str>>>, topic: &str| {
            let mut patterns = patterns.iter().flatten();
            patterns.any(|pattern| matches_topic(pattern, topic))
        };
        let writes = |topic: &str| self.write.is_none() || any(&self.write, topic);
        let reads = |topic: &str| self.read.is_none() || any(&self.read, topic);
        match plan {
            Plan::Participant { .. } | Plan::Topic { .. } | Plan::Group { .. } => true,
            Plan::Writer { key, .. } => writes(&key.name),
            Plan::Reader { key, .. } => reads(&key.name),
            Plan::Requester { request, reply } => writes(&request.name) && reads(&reply.name),
            Plan::Replier { request, reply } => reads(&request.name) && writes(&reply.name),
        }
    }
}

impl Place {
    fn contains(self, host: Option<IpAddr>) -> bool {
        let same = |a: u128, b: u128, all: u32, bits: u8| {
            let free = all.saturating_sub(bits.into());
            a.checked_shr(free) == b.checked_shr(free)
        };
        match (self, host.map(|host| host.to_canonical())) {
            (Self::Serial, None) => true,
            (Self::Net { address, bits }, Some(host)) => match (address, host) {
                (IpAddr::V4(net), IpAddr::V4(host)) => {
                    same(net.to_bits().into(), host.to_bits().into(), 32, bits)
                }
                (IpAddr::V6(net), IpAddr::V6(host)) => {
                    same(net.to_bits(), host.to_bits(), 128, bits)
                }
                _ => false,
            },
            _ => false,
        }
    }
}
