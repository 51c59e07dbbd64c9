//! An agent with all its ports, an access list, and certificates.

use replenish::Context;
use replenish::middleware::xrce::Xrce;
use replenish::middleware::xrce::XrceConfig;
use replenish_agent::{
    AccessList, Agent, AgentConfig, Rejection, RunningAgent, SecureConfig, Stats, TlsConfig,
};
use replenish_secure::{Fingerprint, Psk, SecureError, TlsCredentials, connect_dtls, connect_tls};
use replenish_testkit::program::Scratch;
use replenish_xrce::client::PingPolicy;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

pub(crate) const LIMIT: Duration = Duration::from_secs(120);

/// The pre-shared key of client `n`, which has the key `n n n n`.
pub(crate) fn psk(n: u8) -> Psk {
    Psk::new(&[n; 16]).unwrap()
}

pub(crate) struct Secure {
    pub(crate) running: RunningAgent,
    config: AgentConfig,
    pub(crate) dtls: SocketAddr,
    pub(crate) tls: SocketAddr,
    files: Scratch,
    seen: std::sync::Mutex<Vec<Rejection>>,
}

impl Secure {
    /// An agent that knows clients 1 and 2 by a psk and a certificate each, with what `more` says
    /// of client 2.
    pub(crate) fn start(more: &str) -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let count = COUNT.fetch_add(1, Ordering::SeqCst);
        let files = Scratch::new(&format!("secure-{count}"));
        for name in ["agent", "1", "2", "stranger"] {
            let made = rcgen::generate_simple_self_signed(vec![name.to_owned()]).unwrap();
            std::fs::write(files.path(&format!("{name}.pem")), made.cert.pem()).unwrap();
            let key = made.signing_key.serialize_pem();
            std::fs::write(files.path(&format!("{name}.key")), key).unwrap();
        }
        let list = Self::list(&files, &[1, 2], more);
        let config = AgentConfig {
            addr: (Ipv4Addr::LOCALHOST, 0).into(),
            tcp: Some((Ipv4Addr::LOCALHOST, 0).into()),
            access: Some(AccessList::parse(&list).unwrap()),
            secure: SecureConfig {
                dtls: Some((Ipv4Addr::LOCALHOST, 0).into()),
                tls: Some(TlsConfig {
                    addr: (Ipv4Addr::LOCALHOST, 0).into(),
                    certificate: files.path("agent.pem"),
                    key: files.path("agent.key"),
                }),
            },
            ..AgentConfig::default()
        };
        let agent = Agent::bind(&config).unwrap();
        let (dtls, tls) = (agent.dtls_addr().unwrap(), agent.tls_addr().unwrap());
        Self {
            running: agent.spawn().unwrap(),
            config,
            dtls,
            tls,
            files,
            seen: std::sync::Mutex::default(),
        }
    }

    /// Ends the agent, and starts another at the same addresses.
    pub(crate) fn restart(&mut self) {
        let mut config = self.config.clone();
        config.secure.dtls = Some(self.dtls);
        config.secure.tls.as_mut().unwrap().addr = self.tls;
        self.config.without_udp = true;
        let idle = AgentConfig {
            secure: SecureConfig::default(),
            ..self.config.clone()
        };
        // The old one is gone before the new one takes its addresses.
        let idle = Agent::bind(&idle).unwrap().spawn().unwrap();
        drop(std::mem::replace(&mut self.running, idle));
        self.running = Agent::bind(&config).unwrap().spawn().unwrap();
    }

    fn list(files: &Scratch, clients: &[u8], more: &str) -> String {
        let entries = clients.iter().map(|n| {
            let print = Fingerprint::of_file(&files.path(&format!("{n}.pem"))).unwrap();
            let key = format!("{n:02x}").repeat(4);
            let psk = format!("{n:02x}").repeat(16);
            let more = if *n == 2 { more } else { "" };
            format!(
                "[[client]]\nkey = \"{key}\"\npsk = \"{psk}\"\ncertificate = \"{print}\"\n{more}\n"
            )
        });
        // Client 9 has no secret.
        entries.collect::<String>() + "[[client]]\nkey = \"09090909\"\n"
    }

    /// Makes the list one of these clients alone.
    pub(crate) fn allow(&self, clients: &[u8]) {
        let list = AccessList::parse(&Self::list(&self.files, clients, "")).unwrap();
        self.running.access_control().replace(list);
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.files.path(name)
    }

    /// The settings of a client that does not take a loaded machine for a lost agent.
    pub(crate) fn config(key: u8) -> XrceConfig {
        XrceConfig {
            key: Some([key; 4]),
            connect_timeout: 30_000_000_000,
            request_timeout: 30_000_000_000,
            ping: PingPolicy {
                after: 1_000_000_000,
                silence_limit: 60_000_000_000,
            },
            ..XrceConfig::default()
        }
    }

    pub(crate) fn over_dtls(&self, n: u8) -> Context {
        Self::dtls_at(self.dtls, n)
    }

    pub(crate) fn dtls_at(at: SocketAddr, n: u8) -> Context {
        Context::new(connect_dtls(&at.to_string(), &psk(n), Self::config(n)).unwrap())
    }

    /// As client `key` with the certificate of `name`.
    pub(crate) fn tls_as(&self, name: &str, key: u8) -> Result<Xrce, SecureError> {
        let config = XrceConfig {
            connect_timeout: 3_000_000_000,
            ..Self::config(key)
        };
        connect_tls(&self.tls.to_string(), &self.credentials(name), config)
    }

    pub(crate) fn credentials(&self, name: &str) -> TlsCredentials {
        TlsCredentials {
            certificate: self.path(&format!("{name}.pem")),
            key: self.path(&format!("{name}.key")),
            agent: Fingerprint::of_file(&self.path("agent.pem")).unwrap(),
        }
    }

    pub(crate) fn over_tls(&self, n: u8) -> Context {
        let at = self.tls.to_string();
        let credentials = self.credentials(&n.to_string());
        Context::new(connect_tls(&at, &credentials, Self::config(n)).unwrap())
    }

    pub(crate) fn stats(&self) -> Stats {
        self.running.stats()
    }

    /// Waits for a line of the agent's log with all of `parts`; the line.
    pub(crate) fn logged(&self, parts: &[&str]) -> String {
        let end = Instant::now() + Duration::from_secs(30);
        loop {
            let mut seen = self.seen.lock().unwrap();
            seen.extend(self.running.inspector().rejections().list);
            let lines: Vec<String> = seen.iter().map(ToString::to_string).collect();
            drop(seen);
            let found = lines
                .iter()
                .find(|line| parts.iter().all(|part| line.contains(part)));
            if let Some(line) = found {
                println!("{line}");
                return line.clone();
            }
            assert!(Instant::now() < end, "no {parts:?} in {lines:?}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

/// Waits until `condition` holds.
pub(crate) fn eventually(what: &str, condition: impl Fn() -> bool) {
    let end = Instant::now() + Duration::from_secs(60);
    while !condition() {
        assert!(Instant::now() < end, "{what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}
