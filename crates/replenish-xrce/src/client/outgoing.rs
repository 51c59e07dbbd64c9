//! The session's sending half: what goes out next, and when.

use super::streams::header;
use super::{Session, SessionState};
use crate::SeqNum;
use crate::counter::count;
use crate::features::{DELIVERY as DELIVERY_FEATURE, QUERIES};
use crate::time::{Nanos, ever};
use crate::wire::{
    BaseRequest, CreateClient, DELIVERY, DELIVERY_BACK, DELIVERY_NEW, Encode, INFO_ACTIVITY,
    ObjectId, Properties, RawBody, RequestId, SessionId, StreamId, SubmessageId, Timestamp, VENDOR,
    VERSION, append, submessage_len,
};

/// Properties that are sent at most if the session's own is among them.
const MAX_PROPERTIES: usize = 8;

/// The value of the property [`DELIVERY`].
fn delivery(sessions: u64, companions: u8, room: &mut [u8; 7]) -> &str {
    if sessions == 0 {
        return DELIVERY_NEW;
    }
    let digit = |n: u8| {
        if n < 10 {
            n | b'0'
        } else {
            n.wrapping_add(b'a' - 10)
        }
    };
    let digits = [digit(companions >> 4), digit(companions & 0xf)];
    let text = DELIVERY_BACK.bytes().chain(digits);
    room.iter_mut()
        .zip(text)
        .for_each(|(room, byte)| *room = byte);
    core::str::from_utf8(room).unwrap_or(DELIVERY_NEW)
}

impl<S, const N: usize, const E: usize, const B: usize, const R: usize> Session<S, N, E, B, R>
where
    S: AsRef<[u8]> + AsMut<[u8]>,
{
    /// Time at which [`Session::tick`] and [`Session::poll_transmit`] have something to do even if
    /// nothing else happens; `None`: never.
    pub fn next_deadline(&self) -> Option<Nanos> {
        let mut next = self.link.deadline(&self.config);
        if self.link.has_session() {
            next = next.min(self.streams.deadline()).min(self.answer_due());
        }
        ever(next)
    }

    /// The next datagram to send, if there is one.
    pub fn poll_transmit(&mut self, now: Nanos) -> Option<&[u8]> {
        if self.link.take_request(now, &self.config) {
            return self.login_or_logout();
        }
        if !self.link.has_session() {
            return None;
        }
        if let Some(ack) = self.streams.take_ack(now) {
            return self.control(SubmessageId::AckNack, &ack.to_bytes());
        }
        if let Some(heartbeat) = self.streams.take_heartbeat(now) {
            return self.control(SubmessageId::Heartbeat, &heartbeat.to_bytes());
        }
        if QUERIES {
            if let Some(transmit) = self.time_request.take() {
                return self.message(self.link.session, &Timestamp { transmit });
            }
            if let Some(mask) = self.info_request.take() {
                let asked = self.ask_agent(mask);
                self.info_asked = Some(self.requests);
                return self.control(SubmessageId::GetInfo, &asked);
            }
        }
        if self.link.take_ping(now, &self.config) {
            let asked = self.ask_agent(INFO_ACTIVITY);
            return self.control(SubmessageId::GetInfo, &asked);
        }
        self.watch_answers(now);
        self.streams.next_message(now)
    }

    /// The body of a question to the agent about itself.
    fn ask_agent(&mut self, mask: u32) -> [u8; 8] {
        self.requests = self.requests.next();
        let base = BaseRequest {
            request: self.requests,
            object: ObjectId::AGENT,
        };
        let ([a, b, c, d], [e, f, g, h]) = (base.to_bytes(), mask.to_le_bytes());
        [a, b, c, d, e, f, g, h]
    }

    fn login_or_logout(&mut self) -> Option<&[u8]> {
        if self.link.state == SessionState::Closing {
            let base = BaseRequest {
                request: RequestId::LOGOUT,
                object: ObjectId::CLIENT,
            };
            return self.control(SubmessageId::Delete, &base.to_bytes());
        }
        if !DELIVERY_FEATURE {
            return self.login();
        }
        let mut body = CreateClient {
            version: VERSION,
            vendor: VENDOR,
            key: self.config.key,
            session: self.link.session,
            properties: self.config.properties,
            mtu: self.config.mtu,
        };
        let (mut list, mut value) = ([("", ""); MAX_PROPERTIES], [0; 7]);
        if self.config.confirm_delivery {
            let value = delivery(self.link.stats.sessions, self.companions, &mut value);
            let mut used = 0_usize;
            let mut add = |name, value| {
                if let Some(slot) = list.get_mut(used) {
                    *slot = (name, value);
                    used = used.saturating_add(1);
                }
            };
            add(DELIVERY, value);
            body.properties.for_each(add);
            body.properties = Properties::List(list.get(..used).unwrap_or(&[]));
        }
        let room = self.scratch.len().saturating_sub(8);
        if !submessage_len(&body).is_ok_and(|len| len <= room) {
            body.properties = Properties::None;
            let omitted = &mut self.link.stats.properties_omitted;
            count(omitted);
        }
        self.message(self.link.session.before_login(), &body)
    }

    /// The log-in without properties.
    fn login(&mut self) -> Option<&[u8]> {
        if self.config.properties != Properties::None {
            let omitted = &mut self.link.stats.properties_omitted;
            count(omitted);
        }
        let session = self.link.session;
        let body = CreateClient::plain(self.config.key, session, self.config.mtu);
        let body = RawBody::new(SubmessageId::CreateClient, &body);
        self.message(session.before_login(), &body)
    }

    fn control(&mut self, id: SubmessageId, body: &[u8]) -> Option<&[u8]> {
        self.message(self.link.session, &RawBody::new(id, body))
    }

    /// A message outside of streams.
    fn message<T: Encode>(&mut self, session: SessionId, body: &T) -> Option<&[u8]> {
        let header = header(&self.config, session, StreamId::NONE);
        let begun = header.put(SeqNum(0), &mut self.scratch)?;
        let len = append(&mut self.scratch, begun, body, false)?;
        self.scratch.get(..len)
    }
}
