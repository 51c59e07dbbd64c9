//! The encrypted ports among the others: their way into the core and out.

use super::link::Link;
use super::peer::Peer;
use super::ports::{BATCH, LOG_IN, Ports};
use crate::agent_core::{AgentCore, Now};
use crate::config::AccessList;
use crate::error::AgentError;
use crate::report::Reason;
use replenish_xrce::Nanos;
use std::io::ErrorKind;
use std::net::SocketAddr;

impl Ports {
    /// The address that the agent listens at for DTLS.
    pub(super) fn dtls_addr(&self) -> Option<SocketAddr> {
        self.dtls.as_ref().map(super::secure::DtlsPort::local_addr)
    }

    /// The address that the agent listens at for TLS.
    pub(super) fn tls_addr(&self) -> Option<SocketAddr> {
        self.tls.as_ref().map(super::secure::TlsPort::local_addr)
    }

    /// The SHA-256 of the agent's certificate.
    pub(super) fn tls_fingerprint(&self) -> Option<String> {
        let print = self.tls.as_ref().map(super::secure::TlsPort::fingerprint)?;
        let digits: String = print.iter().map(|byte| format!("{byte:02x}")).collect();
        Some(format!("sha256:{digits}"))
    }

    /// Takes waiting DTLS datagrams; calls `after` after each message.
    pub(super) fn receive_dtls(
        &mut self,
        core: &mut AgentCore<Peer>,
        clock: impl Fn() -> Now,
        mut after: impl FnMut(&mut Self, &mut AgentCore<Peer>),
    ) -> Result<(), AgentError> {
        for _ in 0..BATCH {
            let mut found = std::mem::take(&mut self.found);
            let more = match &mut self.dtls {
                Some(dtls) => dtls.receive(clock().monotonic, &mut found),
                None => Ok(false),
            };
            found.tell(core);
            for (from, message) in found.messages.iter() {
                core.receive(clock(), from, message);
                after(self, core);
            }
            found.messages.clear();
            self.found = found;
            if !more? {
                break;
            }
        }
        Ok(())
    }

    /// Takes TLS connections that wait.
    pub(super) fn accept_tls(&mut self, core: &mut AgentCore<Peer>, now: Nanos) {
        for _ in 0..BATCH {
            let Some(tls) = &mut self.tls else {
                return;
            };
            let (stream, addr) = match tls.listener.accept() {
                Ok(accepted) => accepted,
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(_) => {
                    self.accept_paused = true;
                    return;
                }
            };
            self.connections += 1;
            let number = self.connections;
            let others = self.links.iter().flatten().filter_map(Link::shakes_hands);
            match tls.accept(now, (stream, addr), others) {
                Ok(stream) => {
                    let link = Link::tls(stream, number, addr, now);
                    self.add(link, addr, core, now);
                }
                Err(reason) => {
                    core.counters().handshakes_refused.hit();
                    core.note(Peer::Tcp { number, addr }, None, reason);
                }
            }
        }
    }

    /// Notes why the other end of link `at` did not authenticate; whether there is a reason.
    pub(super) fn note_failure(
        &mut self,
        at: usize,
        late: bool,
        core: &mut AgentCore<Peer>,
    ) -> bool {
        let link = self.links.get(at).and_then(Option::as_ref);
        let failure = link.and_then(|link| Some((link.peer(), link.failure(late)?)));
        let Some((peer, reason)) = failure else {
            return false;
        };
        core.counters().handshakes_refused.hit();
        core.note(peer, None, reason);
        true
    }

    /// Looks after handshakes, and, if it is `due`, after associations without a session.
    pub(super) fn upkeep_secure(&mut self, due: bool, core: &mut AgentCore<Peer>, now: Nanos) {
        let Some(dtls) = &mut self.dtls else {
            return;
        };
        dtls.tick(now, &mut self.found);
        if due {
            let is_used = |peer: &Peer| core.has_session(|other| other == peer);
            dtls.upkeep(now, LOG_IN, is_used, &mut self.found);
        }
        self.found.tell(core);
    }

    /// Goes by `list` from now on: ends connections and associations that it does not have.
    pub(super) fn set_access(&mut self, list: &AccessList, core: &mut AgentCore<Peer>) {
        if let Some(dtls) = &mut self.dtls {
            dtls.set_access(list, &mut self.found);
            self.found.tell(core);
        }
        if let Some(tls) = &mut self.tls {
            tls.set_access(list);
        }
        for at in 0..self.links.len() {
            let link = self.links.get(at).and_then(Option::as_ref);
            if let Some(link) = link.filter(|link| !link.is_listed()) {
                let (peer, field) = (link.peer(), "certificate");
                let reason = Reason::NotListed {
                    field,
                    session: true,
                };
                core.counters().denied.hit();
                core.note(peer, peer.identity(), reason);
                self.lose(at, core);
            }
        }
    }
}
