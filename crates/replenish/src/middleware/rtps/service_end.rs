//! [`ServiceEnd`]: which request a sample is or answers, in the forms that ROS 2 has.
//!
//! ```text
//!   rmw_fastrtps      inline quality of service: {reader of the replies, number}
//!   ros2-client       nothing with a request, and {writer of the request, number} with its reply
//!   rmw_cyclonedds    in front of the payload: {client 8 bytes, number 8 bytes}
//! ```
//!
//! A server answers in the form of the request, and the client's participant alone. A client asks
//! in the form of the server that it has found.

use crate::middleware::RequestIdentity;
use alloc::vec::Vec;
use replenish_rtps::endpoint::Sample;
use replenish_rtps::wire::Guid;

/// Cyclone's clients that a server remembers; the oldest is forgotten for a new one.
const CLIENTS: usize = 64;
/// The vendor id of Eclipse Cyclone DDS.
pub(super) const CYCLONE: [u8; 2] = [1, 0x10];
/// Bytes in front of the payload in Cyclone's form.
pub(super) const HEAD: usize = 16;

/// A reader's end of a service, with the names and numbers that identify requests.
pub(super) enum ServiceEnd {
    /// Requests come in.
    Server {
        /// The writers of requests in Cyclone's form, with the name of their client.
        clients: Vec<(Guid, [u8; 8])>,
    },
    /// Replies come in.
    Client {
        /// The reader's own name.
        own: Guid,
        /// The name of the writer of requests.
        writer: Guid,
        /// Requests that were sent.
        sent: u64,
    },
}

impl ServiceEnd {
    pub(super) fn server() -> Self {
        Self::Server {
            clients: Vec::with_capacity(CLIENTS),
        }
    }

    /// The request that a sample is or answers, and its payload; `None` if it answers another
    /// client.
    pub(super) fn identify<'p>(
        &mut self,
        sample: &Sample<'_>,
        payload: &'p [u8],
    ) -> Option<(RequestIdentity, &'p [u8])> {
        match (self, sample.related) {
            (Self::Server { .. }, Some(request)) => {
                let own = request.sn <= 0;
                let number = if own { sample.sn } else { request.sn };
                let guid = request.guid.to_bytes();
                Some((RequestIdentity::of(guid, number.unsigned_abs()), payload))
            }
            (Self::Server { .. }, None) if !is_cyclone(sample.writer) => {
                let guid = sample.writer.to_bytes();
                let number = sample.sn.unsigned_abs();
                Some((RequestIdentity::of(guid, number), payload))
            }
            (Self::Server { clients }, None) => {
                let (client, number, rest) = cyclone(payload)?;
                let known = clients
                    .iter_mut()
                    .find(|(writer, _)| *writer == sample.writer);
                match known {
                    Some((_, id)) => *id = client,
                    None => {
                        if clients.len() >= CLIENTS {
                            clients.remove(0);
                        }
                        clients.push((sample.writer, client));
                    }
                }
                let guid = sample.writer.to_bytes();
                Some((RequestIdentity::of(guid, number), rest))
            }
            (Self::Client { own, writer, .. }, Some(request)) => {
                let number = request.sn.unsigned_abs();
                let ours = [*own, *writer].contains(&request.guid);
                ours.then(|| (RequestIdentity::reply(number), payload))
            }
            (Self::Client { own, .. }, None) => {
                let (client, number, rest) = cyclone(payload)?;
                (client == cyclone_name(*own)).then(|| (RequestIdentity::reply(number), rest))
            }
        }
    }
}

/// Whether it is an endpoint of Cyclone DDS: its prefixes begin with its vendor id.
fn is_cyclone(endpoint: Guid) -> bool {
    endpoint.prefix.0.starts_with(&CYCLONE)
}

/// Splits a payload in Cyclone's form: client, number, and the rest.
fn cyclone(payload: &[u8]) -> Option<([u8; 8], u64, &[u8])> {
    let (head, rest) = payload.split_at_checked(HEAD)?;
    let number = head.last_chunk().copied()?;
    Some((*head.first_chunk()?, u64::from_le_bytes(number), rest))
}

pub(super) fn cyclone_head(client: [u8; 8], number: u64) -> [u8; HEAD] {
    let mut head = [0; HEAD];
    let (first, last) = head.split_at_mut(8);
    first.copy_from_slice(&client);
    last.copy_from_slice(&number.to_le_bytes());
    head
}

/// The client's name in Cyclone's form: the parts of its reader's name that differ between clients.
pub(super) fn cyclone_name(own: Guid) -> [u8; 8] {
    let [.., a, b, c, d] = own.prefix.0;
    let [e, f, g, h] = own.entity.0;
    [a, b, c, d, e, f, g, h]
}

#[cfg(test)]
mod tests {
    use super::*;
    use replenish_rtps::wire::{EntityId, GuidPrefix, INFINITE, SampleIdentity};

    const THEIRS: GuidPrefix = GuidPrefix([3; 12]);
    const CYCLONES: GuidPrefix = GuidPrefix([1, 16, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3]);

    fn sample(prefix: GuidPrefix, writer: u32, related: Option<SampleIdentity>) -> Sample<'static> {
        Sample {
            payload: &[],
            writer: Guid::new(prefix, EntityId::writer(writer)),
            sn: 5,
            source: None,
            gone: None,
            related,
            origins: Default::default(),
            lifespan: INFINITE,
        }
    }

    #[test]
    fn a_server_knows_each_form_of_a_request() {
        let mut server = ServiceEnd::server();
        let guid = Guid::new(THEIRS, EntityId::reader(9));
        let sn = SampleIdentity::OWN;
        let fast = sample(THEIRS, 1, Some(SampleIdentity { guid, sn }));
        let (request, rest) = server.identify(&fast, &[7; 4]).unwrap();
        assert_eq!(
            (request.guid(), request.number(), rest),
            (guid.to_bytes(), 5, &[7; 4][..])
        );

        let payload = [cyclone_head([8; 8], 41).as_slice(), &[7; 4]].concat();
        let (request, rest) = server
            .identify(&sample(CYCLONES, 2, None), &payload)
            .unwrap();
        assert_eq!((request.number(), rest), (41, &[7; 4][..]));
        let short = server.identify(&sample(CYCLONES, 2, None), &payload[..15]);
        assert!(short.is_none());

        let bare = sample(THEIRS, 2, None);
        let (request, rest) = server.identify(&bare, &[7; 16]).unwrap();
        assert_eq!(
            (request.guid(), request.number(), rest),
            (bare.writer.to_bytes(), 5, &[7; 16][..])
        );
    }

    #[test]
    fn a_server_remembers_a_bounded_number_of_cyclones_clients() {
        let mut server = ServiceEnd::server();
        let payload = cyclone_head([8; 8], 1);
        for writer in 0..200 {
            let request = sample(CYCLONES, writer, None);
            server.identify(&request, &payload).unwrap();
        }
        let ServiceEnd::Server { clients } = server else {
            panic!("a server");
        };
        assert_eq!((clients.len(), clients.capacity()), (CLIENTS, CLIENTS));
    }

    #[test]
    fn a_client_takes_its_own_replies_alone() {
        let own = Guid::new(GuidPrefix([4; 12]), EntityId::reader(1));
        let writer = Guid::new(own.prefix, EntityId::writer(1));
        let mut client = ServiceEnd::Client {
            own,
            writer,
            sent: 9,
        };
        let reply = |guid| sample(THEIRS, 1, Some(SampleIdentity { guid, sn: 9 }));
        let taken = client.identify(&reply(own), &[]).unwrap().0;
        assert_eq!(taken, RequestIdentity::reply(9));
        assert_eq!(client.identify(&reply(writer), &[]).unwrap().0, taken);
        let other = Guid::new(own.prefix, EntityId::reader(2));
        assert!(client.identify(&reply(other), &[]).is_none());
        let ours = cyclone_head(cyclone_name(own), 9);
        assert_eq!(
            client
                .identify(&sample(CYCLONES, 1, None), &ours)
                .unwrap()
                .0,
            taken
        );
        let theirs = cyclone_head(cyclone_name(other), 9);
        assert!(
            client
                .identify(&sample(CYCLONES, 1, None), &theirs)
                .is_none()
        );
    }
}
