//! Requests without a session: to open one, and to ask whether the agent is there.

use super::state::{AgentCore, Now};
use super::takeover::Takeover;
use crate::clients::{Client, ClientOrigin, Echo};
use crate::report::Reason;
use replenish_xrce::Nanos;
use replenish_xrce::wire::{
    AgentInfo, Body, ClientKey, CreateClient, DELIVERY, DELIVERY_BACK, DELIVERY_CONFIRMED,
    DELIVERY_NEW, GetInfo, Header, Info, Message, ObjectId, Properties, Status, StatusAgent,
    VENDOR, VERSION,
};
use std::hash::Hash;

/// A `CREATE_CLIENT` this soon after another of the same client may be a duplicate, or be late: it
/// must not reset streams that may be in use by now. A client does not start again that fast.
const DUPLICATE: Nanos = 100_000_000;

/// A `CREATE_CLIENT` this soon after another of the same client, whose session is in use, is not
/// answered: it is late, or from a client that has started again and will ask again.
const LATE: Nanos = 500_000_000;

/// A session in which nothing has come this long after its log-in makes room for another, if there
/// are as many as there may be.
const UNUSED: Nanos = 500_000_000;

/// The shortest message length a client may announce: room for a header, a FRAGMENT and some bytes.
const MIN_MTU: u16 = 64;

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// A message without a session.
    pub(super) fn outside(&mut self, now: Now, peer: P, message: &Message<'_>) {
        for submessage in message.submessages() {
            let body = submessage.and_then(|submessage| submessage.body());
            match body {
                Ok(Body::CreateClient(create)) => {
                    self.create_client(now, peer, &message.header, &create);
                }
                Ok(Body::GetInfo(get)) => self.info(peer, &message.header, &get),
                Ok(_) => {
                    self.counters.unsupported.hit();
                    self.note(peer, message.header.key, Reason::Unsupported);
                }
                Err(_) => {
                    self.counters.malformed.hit();
                    let bytes = message.body.len();
                    self.note(peer, message.header.key, Reason::Malformed { bytes });
                    return;
                }
            }
        }
    }

    /// `GET_INFO`, in or outside of a session.
    pub(super) fn info(&mut self, peer: P, header: &Header, get: &GetInfo) {
        let known = get.base.object == ObjectId::AGENT;
        let info = Info {
            base: get.base,
            status: if known {
                Status::OK
            } else {
                Status::UNKNOWN_REFERENCE
            },
            // eProsima's agents send 1 in a session, 0 outside.
            implementation: u8::from(!header.session.is_none()),
            agent: known.then_some(AgentInfo {
                version: VERSION,
                vendor: VENDOR,
            }),
            availability: known.then_some(1),
        };
        let key = header.key.unwrap_or(ClientKey([0; 4]));
        self.reply(peer, header.session, key, &info);
    }

    fn create_client(&mut self, now: Now, peer: P, header: &Header, create: &CreateClient<'_>) {
        let Some(status) = self.open(now.monotonic, peer, header, create) else {
            return;
        };
        if !status.is_ok() {
            self.counters.refused.hit();
        }
        let reply = StatusAgent {
            status,
            implementation: 0,
            version: VERSION,
            vendor: VENDOR,
            properties: match client_origin(&create.properties) {
                Some(_) => Properties::List(&[(DELIVERY, DELIVERY_CONFIRMED)]),
                None => Properties::None,
            },
        };
        self.reply(peer, create.session, create.key, &reply);
        if status.is_ok()
            && let Some(index) = self.clients.by_route(peer, create.session)
        {
            self.keep_allowance(index);
        }
    }

    /// Opens the session. A client with the same key, or at the same place with the same session
    /// id, is replaced: the newer one wins, unless the older one lives at another address. `None`
    /// for a log-in that is out of date, or that has no answer yet.
    fn open(
        &mut self,
        now: Nanos,
        peer: P,
        header: &Header,
        create: &CreateClient<'_>,
    ) -> Option<Status> {
        let (key, session) = (create.key, create.session);
        if let Some((status, field)) = refusal(header, create) {
            self.note(peer, Some(key), Reason::LogIn { field, status });
            return Some(status);
        }
        let grant = match self.granted(&peer, key) {
            Ok(grant) => grant,
            Err(field) => {
                let session = false;
                self.counters.denied.hit();
                self.note(peer, Some(key), Reason::NotListed { field, session });
                return Some(Status::DENIED);
            }
        };
        let longest = self.limits.message.max(MIN_MTU.into());
        let mtu = usize::from(create.mtu).min(longest);
        let same = self.clients.by_key(key);
        let (mut before, mut arrived) = (None, false);
        if let Some(client) = same.and_then(|index| self.clients.get_mut(index)) {
            let age = now.saturating_sub(client.created);
            let recent = client.peer == peer && age < DUPLICATE;
            let again = (client.session, client.mtu) == (session, mtu);
            if recent && again {
                return Some(Status::OK);
            }
            let in_use = client.heard > client.created;
            if client.peer == peer && again && in_use && age < LATE {
                return None;
            }
            if recent && client.before == Some(session) {
                return None;
            }
            before = Some(client.session);
            arrived = client.arrived;
        }
        if let Some(index) = same
            && let Takeover::Refused(status) = self.takeover(now, peer, key, index)
        {
            return status;
        }
        for index in [same, self.clients.by_route(peer, session)]
            .into_iter()
            .flatten()
        {
            if self.clients.get_mut(index).is_some() {
                self.counters.clients_replaced.hit();
                self.remove(index);
            }
        }
        let vacancy = self.clients.vacancy();
        let Some(index) = vacancy.or_else(|| self.vacate(now, peer)) else {
            let limit = self.limits.clients;
            self.note(peer, Some(key), Reason::Clients { limit });
            return Some(Status::RESOURCES);
        };
        let limits = self.limits_of(grant.as_ref());
        let mut client = Client::new(index, peer, (key, session), mtu, now, &limits);
        client.grant = grant;
        if !self.is_trusted(&peer) {
            client.echo = Echo::awaited(0);
        }
        client.before = before;
        client.arrived = arrived;
        client.origin = client_origin(&create.properties);
        self.clients.insert(index, client);
        self.count_companions();
        self.serve(now, index);
        self.counters.clients_created.hit();
        self.counters.clients.set(self.clients.len());
        Some(Status::OK)
    }

    /// Ends the session of another client, so that `peer` has a place: the oldest in which nothing
    /// has come since the log-in, or the one that was silent longest of an address, or a host, that
    /// has more than half of all places, and more than one. The place, if there is such a client.
    fn vacate(&mut self, now: Nanos, peer: P) -> Option<usize> {
        let limit = self.limits.clients;
        let clients = || self.clients.iter_slots();
        let unused = clients().filter(|(_, c)| !c.arrived);
        let unused = unused.filter(|(_, c)| now.saturating_sub(c.created) >= UNUSED);
        let unused = unused.min_by_key(|(_, c)| c.created).map(|(at, _)| at);
        let host = |of: &P| (self.host)(of);
        let silent = |same: &dyn Fn(&P, &P) -> bool| {
            let crowd = |of: &P| clients().filter(|(_, c)| same(&c.peer, of)).count();
            let others = clients().filter(|(_, c)| !same(&c.peer, &peer));
            let crowded = others.filter(|(_, c)| crowd(&c.peer) > (limit / 2).max(1));
            crowded.min_by_key(|(_, c)| c.heard).map(|(at, _)| at)
        };
        let crowded = || silent(&|a, b| a == b).or_else(|| silent(&|a, b| host(a) == host(b)));
        let (index, reason) = match unused {
            Some(index) => (index, Reason::Unused { limit: UNUSED }),
            None => (crowded()?, Reason::Crowded { limit }),
        };
        self.counters.clients_displaced.hit();
        self.note_of(index, reason);
        self.remove(index);
        Some(index)
    }
}

/// The client's origin, if it asks for confirmations.
fn client_origin(properties: &Properties<'_>) -> Option<ClientOrigin> {
    let mut origin = None;
    properties.for_each(|name, value| match (name, value) {
        (DELIVERY, DELIVERY_NEW) => origin = Some(ClientOrigin::New),
        (DELIVERY, value) => {
            let companions = value.strip_prefix(DELIVERY_BACK);
            let companions = companions.map(|digits| u8::from_str_radix(digits, 16));
            origin = companions.map(|n| ClientOrigin::Returned(n.unwrap_or(0)));
        }
        _ => {}
    });
    origin
}

/// The status that refuses a malformed log-in, and its wrong part.
fn refusal(header: &Header, create: &CreateClient<'_>) -> Option<(Status, &'static str)> {
    let (key, session) = (create.key, create.session);
    let other_form = session.has_key() != header.session.has_key();
    let other_key = header.key.is_some_and(|in_header| in_header != key);
    if key == ClientKey([0; 4]) || other_key {
        return Some((Status::INVALID_DATA, "the key is zero, or not the header's"));
    }
    if session.is_none() || other_form {
        return Some((
            Status::INVALID_DATA,
            "the session id is none, or not the header's form",
        ));
    }
    if create.version.first() != VERSION.first() {
        return Some((Status::INCOMPATIBLE, "another version of the protocol"));
    }
    let short = create.mtu < MIN_MTU;
    short.then_some((Status::INVALID_DATA, "the MTU is below 64 bytes"))
}
