//! Keys, certificates and the access list of one run, in a directory that goes with it.

use replenish_agent::{AccessList, AgentConfig, SecureConfig, TlsConfig};
use replenish_cli::outcome::Failure;
use replenish_secure::{Fingerprint, Psk, TlsCredentials};
use std::fmt::Display;
use std::fs::{DirBuilder, File};
use std::io::Read;
use std::net::{Ipv4Addr, SocketAddr};
use std::os::unix::fs::DirBuilderExt;
use std::path::PathBuf;

/// The clients' keys, in the order of the paths.
pub(super) const KEYS: [[u8; 4]; 4] = [*b"sec0", *b"sec1", *b"sec2", *b"sec3"];

/// The secrets of agent and clients.
pub(super) struct Credentials {
    dir: PathBuf,
    psk: [u8; 16],
}

impl Credentials {
    /// New ones, that no other account can read.
    pub(super) fn make() -> Result<Self, Failure> {
        let mut psk = [0; 16];
        let random = File::open("/dev/urandom").and_then(|mut file| file.read_exact(&mut psk));
        random.map_err(|why| failed("a pre-shared key", &why))?;
        let name = format!("replenish-secure-{}", std::process::id());
        let dir = std::env::temp_dir().join(name);
        let made = DirBuilder::new().mode(0o700).create(&dir);
        made.map_err(|why| failed(dir.display(), &why))?;
        let this = Self { dir, psk };
        for name in ["agent", "client"] {
            let made = rcgen::generate_simple_self_signed(vec![name.to_owned()]);
            let made = made.map_err(|why| failed("a certificate", &why))?;
            this.write(&format!("{name}.pem"), &made.cert.pem())?;
            this.write(&format!("{name}.key"), &made.signing_key.serialize_pem())?;
        }
        Ok(this)
    }

    fn write(&self, name: &str, text: &str) -> Result<(), Failure> {
        let path = self.dir.join(name);
        std::fs::write(&path, text).map_err(|why| failed(path.display(), &why))
    }

    /// An agent with all four ports on loopback.
    pub(super) fn agent(&self) -> Result<AgentConfig, Failure> {
        let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let hex = |bytes: &[u8]| -> String { bytes.iter().map(|b| format!("{b:02x}")).collect() };
        let print = self.fingerprint("client")?;
        let secrets = [
            String::new(),
            format!("psk = \"{}\"", hex(&self.psk)),
            String::new(),
            format!("certificate = \"{print}\""),
        ];
        let entries = KEYS.iter().zip(secrets);
        let entries =
            entries.map(|(key, secret)| format!("[[client]]\nkey = \"{}\"\n{secret}\n", hex(key)));
        let list = AccessList::parse(&entries.collect::<String>()).map_err(Failure::refused)?;
        Ok(AgentConfig {
            addr: any,
            tcp: Some(any),
            access: Some(list),
            secure: SecureConfig {
                dtls: Some(any),
                tls: Some(TlsConfig {
                    addr: any,
                    certificate: self.dir.join("agent.pem"),
                    key: self.dir.join("agent.key"),
                }),
            },
            ..AgentConfig::default()
        })
    }

    pub(super) fn psk(&self) -> Result<Psk, Failure> {
        Psk::new(&self.psk).map_err(Failure::refused)
    }

    pub(super) fn tls(&self) -> Result<TlsCredentials, Failure> {
        Ok(TlsCredentials {
            certificate: self.dir.join("client.pem"),
            key: self.dir.join("client.key"),
            agent: self.fingerprint("agent")?,
        })
    }

    fn fingerprint(&self, name: &str) -> Result<Fingerprint, Failure> {
        let path = self.dir.join(format!("{name}.pem"));
        Fingerprint::of_file(&path).map_err(Failure::refused)
    }
}

impl Drop for Credentials {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.dir).ok();
    }
}

fn failed(what: impl Display, why: &dyn Display) -> Failure {
    Failure::refused(format!("cannot make {what}: {why}"))
}
