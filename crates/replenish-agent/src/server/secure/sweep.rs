//! The upkeep of the DTLS port: repetitions, deadlines, silence, and a new access list.

use super::super::found::Found;
use super::super::peer::Peer;
use super::association::Event;
use super::dtls::DtlsPort;
use crate::config::AccessList;
use crate::report::Reason;
use replenish_xrce::Nanos;
use replenish_xrce::wire::ClientKey;
use std::net::SocketAddr;

/// Addresses with associations of one client: one for each start that its agent has not forgotten.
const OF_A_CLIENT: usize = 4;

impl DtlsPort {
    /// Ends the association of a client that has too many, the one that was silent longest.
    pub(super) fn crowd_out(&mut self, newest: SocketAddr, key: ClientKey, found: &mut Found) {
        let own = || {
            let live = self
                .slots
                .iter()
                .filter_map(|(at, slot)| Some((at, slot.live.as_ref()?)));
            live.filter(|(_, live)| live.key == key)
        };
        if own().count() > OF_A_CLIENT {
            let oldest = own().filter(|(at, _)| **at != newest);
            let oldest = oldest.min_by_key(|(_, live)| live.heard).map(|(at, _)| *at);
            if let Some(addr) = oldest {
                self.end(addr, found);
            }
        }
    }

    /// Repeats what was lost of handshakes, and ends those that take too long.
    pub(in super::super) fn tick(&mut self, now: Nanos, found: &mut Found) {
        for at in (0..self.pending.len()).rev() {
            let Self { udp, buf, .. } = self;
            let Some(addr) = self.pending.get(at).copied() else {
                continue;
            };
            let next = self
                .slots
                .get_mut(&addr)
                .and_then(|slot| slot.next.as_mut());
            let Some(next) = next.filter(|next| now >= next.at.min(next.deadline)) else {
                continue;
            };
            let on = &mut |event: Event<'_>| {
                if let Event::Send(datagram) = event {
                    udp.send(addr, datagram);
                }
            };
            let taken = next.tick(now, (buf, on));
            self.advance(now, addr, taken, found);
        }
    }

    /// Ends associations in which nothing has come for too long, and those of which `is_used` does
    /// not know a session.
    pub(in super::super) fn upkeep(
        &mut self,
        now: Nanos,
        log_in: Nanos,
        is_used: impl Fn(&Peer) -> bool,
        found: &mut Found,
    ) {
        let mut over = Vec::new();
        for (addr, slot) in &self.slots {
            let Some(live) = &slot.live else {
                continue;
            };
            let (addr, key) = (*addr, live.key);
            let silent = now.saturating_sub(live.heard);
            let peer = Peer::Dtls { addr, key };
            if silent > log_in && !is_used(&peer) {
                found.refuse(peer, Some(key), Reason::NoLogIn { limit: log_in });
                over.push(addr);
            } else if silent > self.silence || live.association.closed {
                over.push(addr);
            }
        }
        over.into_iter().for_each(|addr| self.end(addr, found));
    }

    /// Goes by `list` from now on, and ends associations whose key has gone or is another one.
    pub(in super::super) fn set_access(&mut self, list: &AccessList, found: &mut Found) {
        let before = self.identities.replace(list.clone());
        let mut over = Vec::new();
        for (addr, slot) in &mut self.slots {
            let is_same = |key| self.identities.is_same(&before, key);
            if let Some(live) = slot.live.as_ref().filter(|live| !is_same(live.key)) {
                let peer = Peer::Dtls {
                    addr: *addr,
                    key: live.key,
                };
                let reason = Reason::NotListed {
                    field: "psk",
                    session: true,
                };
                found.refuse(peer, Some(live.key), reason);
                over.push(*addr);
            }
            slot.next = None;
        }
        self.pending.clear();
        over.into_iter().for_each(|addr| self.end(addr, found));
        self.slots.retain(|_, slot| slot.live.is_some());
    }

    /// Ends the association that an address has; a handshake under way goes on.
    pub(super) fn end(&mut self, addr: SocketAddr, found: &mut Found) {
        let Some(slot) = self.slots.get_mut(&addr) else {
            return;
        };
        if let Some(mut live) = slot.live.take() {
            let udp = &self.udp;
            let on = &mut |event: Event<'_>| {
                if let Event::Send(datagram) = event {
                    udp.send(addr, datagram);
                }
            };
            live.association.close((&mut self.buf, on));
            found.end(Peer::Dtls {
                addr,
                key: live.key,
            });
        }
        if slot.next.is_none() {
            self.slots.remove(&addr);
        }
    }
}
