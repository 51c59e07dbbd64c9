//! One way through the agent: a client that reads what it writes.

use super::credentials::{Credentials, KEYS};
use crate::load::{MS, Nanos, SEC};
use replenish::Qos;
use replenish::middleware::xrce::{Xrce, XrceConfig};
use replenish::middleware::{EndpointSpec, Interest, Middleware, Room, WriterId};
use replenish::qos::IngressLimit;
use replenish_agent::Agent;
use replenish_cli::outcome::Failure;
use replenish_os::clock;
use replenish_secure::{connect_dtls, connect_tls};
use replenish_xrce::client::PingPolicy;
use std::net::SocketAddr;

/// The paths; the plain one of each pair first.
pub(super) const PATHS: [&str; 4] = ["udp", "dtls", "tcp", "tls"];

/// The longest sample.
pub(super) const LONGEST: usize = 1024;

/// Time in ns after which a round trip counts as lost.
const PATIENCE: Nanos = SEC;

/// The agent's addresses, in the order of the paths.
pub(super) struct Place([SocketAddr; 4]);

/// A client on one path.
pub(super) struct Path {
    session: Xrce,
    writer: WriterId,
    interest: Interest,
}

impl Place {
    pub(super) fn of(agent: &Agent) -> Result<Self, Failure> {
        let none = || Failure::refused("the agent does not listen at all its ports");
        Ok(Self([
            agent.local_addr(),
            agent.dtls_addr().ok_or_else(none)?,
            agent.tcp_addr().ok_or_else(none)?,
            agent.tls_addr().ok_or_else(none)?,
        ]))
    }

    /// A client on each path.
    pub(super) fn connect(&self, credentials: &Credentials) -> Result<[Path; 4], Failure> {
        let [udp, dtls, tcp, tls] = self.0.map(|at| at.to_string());
        let [of_udp, of_dtls, of_tcp, of_tls] = KEYS.map(config);
        let plain = Xrce::udp_with(&udp, of_udp).map_err(Failure::refused)?;
        let psk = credentials.psk()?;
        let sealed = connect_dtls(&dtls, &psk, of_dtls).map_err(Failure::refused)?;
        let stream = Xrce::tcp_with(&tcp, of_tcp).map_err(Failure::refused)?;
        let secret = credentials.tls()?;
        let sealed_stream = connect_tls(&tls, &secret, of_tls).map_err(Failure::refused)?;
        Ok([
            Path::new(plain, "/secure/udp")?,
            Path::new(sealed, "/secure/dtls")?,
            Path::new(stream, "/secure/tcp")?,
            Path::new(sealed_stream, "/secure/tls")?,
        ])
    }
}

fn config(key: [u8; 4]) -> XrceConfig {
    XrceConfig {
        key: Some(key),
        // Each sample is one datagram, and one record.
        mtu: 1400,
        // A path is not looked after while the others have their turns.
        ping: PingPolicy {
            after: SEC,
            silence_limit: 60 * SEC,
        },
        connect_timeout: 10 * SEC,
        request_timeout: 10 * SEC,
        ..XrceConfig::default()
    }
}

impl Path {
    fn new(session: Xrce, topic: &str) -> Result<Self, Failure> {
        let spec = EndpointSpec {
            node: "/bench",
            topic,
            type_name: "std_msgs/msg/UInt8MultiArray",
            dds_type_name: "std_msgs::msg::dds_::UInt8MultiArray_",
            type_hash: None,
            qos: Qos::reliable(),
            max_size: LONGEST,
            ingress: IngressLimit::none(),
            keep_oldest: false,
        };
        let writer = session.create_writer(&spec).map_err(Failure::refused)?;
        let reader = session.create_reader(&spec).map_err(Failure::refused)?;
        let mut interest = Interest::empty();
        interest.insert(reader);
        Ok(Self {
            session,
            writer,
            interest,
        })
    }

    /// Makes one round trip; returns its time, or `None` if the sample did not come back.
    pub(super) fn round_trip(&mut self, sample: &[u8]) -> Result<Option<Nanos>, Failure> {
        let sent = clock::monotonic();
        let published = self.session.publish(self.writer, sample);
        published.map_err(Failure::refused)?;
        let mut back = None;
        while back.is_none() {
            if clock::monotonic() >= sent + PATIENCE {
                return Ok(None);
            }
            self.drive(sent + PATIENCE, &mut |got| {
                if got == sample {
                    back = Some(clock::monotonic());
                }
            })?;
        }
        Ok(back.map(|back| back.saturating_sub(sent)))
    }

    /// Lets what is under way settle, so that it does not disturb the next path's window.
    pub(super) fn settle(&mut self) -> Result<(), Failure> {
        let until = clock::monotonic() + SEC;
        while self.session.stats().unacknowledged > 0 && clock::monotonic() < until {
            self.drive(clock::monotonic() + MS, &mut |_| ())?;
        }
        self.drive(clock::monotonic() + MS, &mut |_| ())
    }

    /// Does one turn of a dispatcher: waits until `until` at most, then takes the samples.
    fn drive(&mut self, until: Nanos, got: &mut dyn FnMut(&[u8])) -> Result<(), Failure> {
        let waited = self.session.wait(&self.interest, Some(until));
        waited.map_err(Failure::refused)?;
        let mut sink = |_, _: &_, sample: &[u8]| {
            got(sample);
            Room::Left
        };
        let taken = self.session.take(&mut self.interest, &mut sink);
        taken.map(drop).map_err(Failure::refused)
    }
}
