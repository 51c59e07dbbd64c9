//! Clients of other libraries, and of the same ones without our code: `openssl s_client` where it
//! is installed, and bare `rustls`.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]

#[path = "it/agent.rs"]
#[allow(dead_code, reason = "`it` uses the rest")]
mod agent;

use agent::{LIMIT, Secure};
use replenish_testkit::harness::{run, skip, trial};
use replenish_testkit::watchdog::watchdog;
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use rustls::{ClientConfig, ClientConnection, DigitallySignedStruct, Error, SignatureScheme};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};
use std::sync::Arc;

fn main() {
    run(vec![
        trial(
            "openssl_is_refused_without_a_listed_certificate_and_taken_with_it",
            openssl_is_refused_without_a_listed_certificate_and_taken_with_it,
        ),
        trial(
            "openssl_shakes_hands_over_dtls_with_the_right_psk_alone",
            openssl_shakes_hands_over_dtls_with_the_right_psk_alone,
        ),
        trial(
            "bare_rustls_is_refused_without_a_listed_certificate_and_taken_with_it",
            bare_rustls_is_refused_without_a_listed_certificate_and_taken_with_it,
        ),
        trial(
            "a_plain_client_at_an_encrypted_port_is_refused_and_logged",
            a_plain_client_at_an_encrypted_port_is_refused_and_logged,
        ),
    ]);
}

/// `openssl s_client` with these options, until it ends; all that it says.
fn openssl(args: &[&str]) -> Option<String> {
    let child = Command::new("timeout")
        .args(["10", "openssl", "s_client"])
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .ok()?;
    let output = child.wait_with_output().ok()?;
    let text = [output.stdout, output.stderr].concat();
    let text = String::from_utf8_lossy(&text).into_owned();
    (!text.contains("No such file or directory")).then_some(text)
}

fn openssl_is_refused_without_a_listed_certificate_and_taken_with_it() {
    let _dog = watchdog("openssl", LIMIT);
    let agent = Secure::start("");
    let at = agent.tls.to_string();
    let with = |name: &str| {
        let (cert, key) = (
            agent.path(&format!("{name}.pem")),
            agent.path(&format!("{name}.key")),
        );
        let (cert, key) = (cert.display().to_string(), key.display().to_string());
        openssl(&["-connect", &at, "-cert", &cert, "-key", &key, "-tls1_3"])
    };
    let Some(taken) = with("1") else {
        skip("no openssl here");
    };
    assert!(
        taken.contains("TLSv1.3") && !taken.contains("alert"),
        "{taken}"
    );
    assert_eq!(agent.stats().handshakes_refused, 0);
    let refused = with("stranger").unwrap();
    agent.logged(&["tcp 127.0.0.1:", "does not have its certificate sha256:"]);
    assert!(!refused.is_empty());
    openssl(&["-connect", &at, "-tls1_3"]).unwrap();
    agent.logged(&["tcp 127.0.0.1:", "it shows no certificate"]);
    let old = openssl(&["-connect", &at, "-tls1_2"]).unwrap();
    assert!(old.contains("protocol version"), "{old}");
    agent.logged(&["tcp 127.0.0.1:", "no version and cipher"]);
}

fn openssl_shakes_hands_over_dtls_with_the_right_psk_alone() {
    let _dog = watchdog("openssl dtls", LIMIT);
    let agent = Secure::start("");
    let at = agent.dtls.to_string();
    let with = |identity: &str, psk: &str| {
        let suite = "PSK-AES128-CCM8:@SECLEVEL=0";
        let identity = ["-psk_identity", identity, "-psk", psk, "-cipher", suite];
        openssl(&[&["-dtls1_2", "-connect", &at], &identity[..]].concat())
    };
    let right = "01".repeat(16);
    let Some(taken) = with("01010101", &right) else {
        skip("no openssl here");
    };
    assert!(taken.contains("Cipher is PSK-AES128-CCM8"), "{taken}");
    assert_eq!(agent.stats().handshakes_refused, 0);
    with("01010101", &"02".repeat(16)).unwrap();
    agent.logged(&[
        "client 01010101 at udp 127.0.0.1:",
        "its psk is not the one",
    ]);
    with("07070707", &right).unwrap();
    agent.logged(&["udp 127.0.0.1:", "no psk for the identity"]);
}

/// Takes any agent.
#[derive(Debug)]
struct Anyone;

impl ServerCertVerifier for Anyone {
    fn verify_server_cert(
        &self,
        _: &CertificateDer<'_>,
        _: &[CertificateDer<'_>],
        _: &ServerName<'_>,
        _: &[u8],
        _: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        Ok(ServerCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        _: &[u8],
        _: &CertificateDer<'_>,
        _: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        Ok(HandshakeSignatureValid::assertion())
    }

    fn verify_tls13_signature(
        &self,
        _: &[u8],
        _: &CertificateDer<'_>,
        _: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        Ok(HandshakeSignatureValid::assertion())
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        let provider = rustls::crypto::ring::default_provider();
        provider
            .signature_verification_algorithms
            .supported_schemes()
    }
}

/// A handshake of bare `rustls`; what the agent says to it.
fn rustls_client(agent: &Secure, certificate: Option<(&str, &str)>) -> std::io::Result<usize> {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])
        .unwrap()
        .dangerous()
        .with_custom_certificate_verifier(Arc::new(Anyone));
    let config = match certificate {
        Some((certificate, key)) => {
            let certificate = CertificateDer::from_pem_file(agent.path(certificate)).unwrap();
            let key = PrivateKeyDer::from_pem_file(agent.path(key)).unwrap();
            config
                .with_client_auth_cert(vec![certificate], key)
                .unwrap()
        }
        None => config.with_no_client_auth(),
    };
    let name = ServerName::from(agent.tls.ip());
    let mut tls = ClientConnection::new(Arc::new(config), name).unwrap();
    let mut tcp = TcpStream::connect(agent.tls).unwrap();
    let mut stream = rustls::Stream::new(&mut tls, &mut tcp);
    // A ping, which the agent answers to all who may talk to it.
    let ping = [0x80, 0, 0, 0, 2, 1, 8, 0, 0, 0x0a, 0xff, 0xfd, 2, 0, 0, 0];
    stream.write_all(&[16, 0])?;
    stream.write_all(&ping)?;
    stream.flush()?;
    stream.read(&mut [0; 100])
}

fn bare_rustls_is_refused_without_a_listed_certificate_and_taken_with_it() {
    let _dog = watchdog("rustls", LIMIT);
    let agent = Secure::start("");
    assert_eq!(rustls_client(&agent, Some(("1.pem", "1.key"))).unwrap(), 38);
    assert!(rustls_client(&agent, None).is_err());
    agent.logged(&["tcp 127.0.0.1:", "it shows no certificate"]);
    assert!(rustls_client(&agent, Some(("stranger.pem", "stranger.key"))).is_err());
    agent.logged(&["tcp 127.0.0.1:", "does not have its certificate"]);
}

fn a_plain_client_at_an_encrypted_port_is_refused_and_logged() {
    let _dog = watchdog("plain at tls", LIMIT);
    let agent = Secure::start("");
    let mut tcp = TcpStream::connect(agent.tls).unwrap();
    let ping = [
        16, 0, 0x80, 0, 0, 0, 2, 1, 8, 0, 0, 0x0a, 0xff, 0xfd, 2, 0, 0, 0,
    ];
    tcp.write_all(&ping).unwrap();
    agent.logged(&["tcp 127.0.0.1:", "no version and cipher"]);
}
