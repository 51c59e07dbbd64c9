//! DTLS and TLS under attack: as many handshakes, associations and connections as there may be,
//! each with as much as it can make the agent keep.

use super::attacks::{CLIENTS, starve};
use super::{MIB, Scratch, Victim, address, sum};
use crate::attacker::{Raw, SENT};
use replenish_secure::Fingerprint;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::{ClientConfig, RootCertStore};
use std::io::Write;
use std::net::{SocketAddr, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

#[path = "../../../../replenish-secure/tests/it/raw.rs"]
#[allow(dead_code, reason = "shared with the tests of another crate")]
mod raw;

use raw::Raw as Dtls;

/// Handshakes at a time, and of these of one host.
const HALF_OPEN: usize = 64;
const OF_A_HOST: usize = 16;

/// Associations at a time, and of these of one client.
const ASSOCIATIONS: usize = CLIENTS as usize + 64;
const OF_A_CLIENT: usize = 4;

/// The longest message over DTLS.
const MESSAGE: usize = 16_000;

/// Datagrams of a handshake that the agent keeps until an earlier one has come, but one.
const KEPT: u16 = 7;

/// Clients over DTLS in the access list, and the key before those over TLS.
const LISTED: usize = 32;
const OVER_TLS: u32 = 0x1000;

const SOON: Duration = Duration::from_secs(30);

fn psk(key: usize) -> [u8; 16] {
    [u8::try_from(key).unwrap(); 16]
}

fn write(path: &Path, text: &str) {
    std::fs::write(path, text).unwrap();
    std::fs::set_permissions(path, PermissionsExt::from_mode(0o600)).unwrap();
}

/// Writes certificates and the list; the options that name them.
fn credentials(files: &Scratch) -> Vec<String> {
    let mut list = String::new();
    for number in 0..=CLIENTS {
        let made = rcgen::generate_simple_self_signed(vec!["agent".to_owned()]).unwrap();
        let path = |kind: &str| files.path(&format!("{number}.{kind}"));
        write(&path("pem"), &made.cert.pem());
        write(&path("key"), &made.signing_key.serialize_pem());
        // 0 is the agent's.
        if number > 0 {
            let print = Fingerprint::of_file(&path("pem")).unwrap();
            let key = OVER_TLS + number;
            list += &format!("[[client]]\nkey = \"{key:08x}\"\ncertificate = \"{print}\"\n");
        }
    }
    for key in 1..=LISTED {
        let psk: String = psk(key).iter().map(|byte| format!("{byte:02x}")).collect();
        list += &format!("[[client]]\nkey = \"{key:08x}\"\npsk = \"{psk}\"\n");
    }
    write(&files.path("list"), &list);
    let option = |name: &str, file: &str| format!("--{name}={}", files.path(file).display());
    vec![
        "--dtls=127.0.0.1:0".into(),
        "--tls=127.0.0.1:0".into(),
        option("certificate", "0.pem"),
        option("key", "0.key"),
        option("access", "list"),
    ]
}

/// A client of TLS with certificate `number`, which knows the agent's.
fn tls(files: &Scratch, number: u32) -> ClientConfig {
    let pem = |number: u32| CertificateDer::from_pem_file(files.path(&format!("{number}.pem")));
    let mut roots = RootCertStore::empty();
    roots.add(pem(0).unwrap()).unwrap();
    let key = PrivateKeyDer::from_pem_file(files.path(&format!("{number}.key"))).unwrap();
    ClientConfig::builder_with_provider(Arc::new(rustls::crypto::ring::default_provider()))
        .with_protocol_versions(&[&rustls::version::TLS13])
        .unwrap()
        .with_root_certificates(roots)
        .with_client_auth_cert(vec![pem(number).unwrap()], key)
        .unwrap()
}

/// A datagram of handshake messages that come too early, so that they are kept: `pieces` in each of
/// `records` records, of `bytes` bytes each.
fn early(number: u16, records: u16, pieces: u16, bytes: usize) -> Vec<u8> {
    let mut datagram = Vec::new();
    for record in 0..records {
        let mut messages = Vec::new();
        for piece in 0..pieces {
            let seq = 100 + number * 64 + record * 8 + piece;
            let len = &u32::try_from(bytes).unwrap().to_be_bytes()[1..];
            messages.push(16); // ClientKeyExchange
            messages.extend(len);
            messages.extend(seq.to_be_bytes());
            messages.extend([0, 0, 0]);
            messages.extend(len);
            messages.extend(vec![7; bytes]);
        }
        datagram.extend([22, 0xfe, 0xfd, 0, 0, 0, 0, 0, 0]);
        datagram.extend((10 + number * 8 + record).to_be_bytes());
        datagram.extend(u16::try_from(messages.len()).unwrap().to_be_bytes());
        datagram.extend(messages);
    }
    datagram
}

/// Begins a handshake from host `host`, and has the agent keep what it can of it.
fn half_open(at: SocketAddr, host: usize, key: usize) -> Dtls {
    let mut raw = Dtls::new(
        &format!("127.2.0.{host}"),
        at,
        &format!("{key:08x}"),
        &psk(key),
    );
    // A hello, and the one with the cookie.
    raw.run(SOON, |raw| raw.sent >= 2);
    assert!(raw.sent >= 2, "no cookie");
    let long = (0..29).map(|number| early(number, 1, 1, 60_000));
    let many = (29..29 + KEPT).map(|number| early(number, 8, 8, 17));
    for datagram in long.chain(many) {
        send(&raw, &datagram);
        std::thread::sleep(Duration::from_micros(300));
    }
    raw
}

fn send(raw: &Dtls, datagram: &[u8]) {
    SENT.set(SENT.get() + datagram.len() as u64);
    raw.socket.send(datagram).ok();
}

/// As many associations as there may be. Each kept what came too early in its handshake, and gets a
/// message now and then, lest it end for want of a log-in.
fn associations(at: SocketAddr) -> Vec<Dtls> {
    let mut all: Vec<Dtls> = Vec::new();
    for number in 0..ASSOCIATIONS {
        let mut raw = half_open(at, 1 + number / OF_A_HOST, 1 + number / OF_A_CLIENT);
        raw.run(SOON, |raw| raw.connected);
        assert!(raw.connected, "association {number}");
        all.push(raw);
        if number % 4 == 3 {
            refresh(&mut all, 1);
        }
    }
    all
}

/// A message on each, of `bytes` bytes.
fn refresh(all: &mut [Dtls], bytes: usize) {
    for raw in all {
        SENT.set(SENT.get() + bytes as u64);
        raw.send(&vec![9; bytes]);
        std::thread::sleep(Duration::from_micros(300));
    }
}

/// Connections that begin the longest handshake message and never end it.
fn unfinished(at: SocketAddr) -> Vec<TcpStream> {
    let connect = |_| {
        let mut stream = TcpStream::connect(at).unwrap();
        // A ClientHello of 65 535 bytes, in records of the longest kind.
        let mut hello = vec![1, 0, 0xff, 0xff];
        hello.resize(65_000, 3);
        for piece in hello.chunks(16_384) {
            let [high, low] = u16::try_from(piece.len()).unwrap().to_be_bytes();
            SENT.set(SENT.get() + piece.len() as u64);
            stream.write_all(&[22, 3, 1, high, low]).ok();
            stream.write_all(piece).ok();
        }
        stream
    };
    (0..CLIENTS).map(connect).collect()
}

/// Clients over TLS that ask for everything, read next to nothing, and leave their longest record
/// unfinished.
fn sessions(at: SocketAddr, files: &Scratch) -> Vec<Raw> {
    let open = |number: u32, mtu| Raw::open_tls(at, OVER_TLS + number, mtu, tls(files, number));
    let mut all = starve(open(CLIENTS, 512), (1..CLIENTS).map(|n| open(n, u16::MAX)));
    for raw in &mut all {
        let mut record = vec![23, 3, 3, 0x41, 0x00];
        record.resize(16_600, 5);
        raw.stream.write_all(&record).ok();
    }
    all
}

/// Prints what the attack takes, as the ten in the clear.
#[test]
fn encryption_takes_no_more_memory_than_the_documented_bound() {
    let files = Scratch::new("encrypted");
    // Little beside encryption: the bound is that of its own term.
    let mut options = vec![
        "--memory=8388608".to_owned(),
        format!("--clients={CLIENTS}"),
        "--entities=64".into(),
        "--depth=65535".into(),
        // A loaded machine takes its time.
        "--silence=3600".into(),
    ];
    options.extend(credentials(&files));
    let victim = Victim::with(&files, "encrypted", &options);
    let bound = victim.bound();
    let idle = victim.peak();
    let at = |kind| address(&victim.line, kind);
    SENT.set(0);

    let hellos = unfinished(at("(TLS"));
    victim.shows();
    let of_hellos = victim.peak();
    drop(hellos);
    std::thread::sleep(Duration::from_secs(2)); // their places are free
    let readers = sessions(at("(TLS"), &files);
    let of_sessions = victim.peak();
    let mut live = associations(at("(DTLS)"));
    refresh(&mut live, MESSAGE);
    let of_associations = victim.peak();
    let mut pending = Vec::new();
    for number in 0..HALF_OPEN {
        pending.push(half_open(at("(DTLS)"), 100 + number / OF_A_HOST, 1));
        if number % 4 == 3 {
            refresh(&mut live, 1);
        }
    }
    refresh(&mut live, MESSAGE);
    let state = victim.shows();
    let peak = victim.peak();

    let mib = |bytes: u64| bytes as f64 / MIB;
    println!("| attack | sent MB | charged MiB | resident MiB | bound MiB |");
    println!("|---|---|---|---|---|");
    let charged = sum(&state, "clients", "memory_bytes");
    println!(
        "| handshakes, associations and connections | {:.1} | {:.1} | {:.1} | {:.1} |",
        SENT.get() as f64 / 1e6,
        mib(charged),
        mib(peak),
        mib(bound)
    );
    println!(
        "idle {:.1}, after hellos over TLS {:.1}, sessions over TLS {:.1}, {} associations {:.1}, \
         {HALF_OPEN} handshakes {:.1} MiB",
        mib(idle),
        mib(of_hellos),
        mib(of_sessions),
        live.len(),
        mib(of_associations),
        mib(peak),
    );
    assert!(peak <= bound, "{peak} of {bound}");
    // The attack reaches what it is meant to reach.
    assert_eq!(state["clients"].as_array().unwrap().len(), CLIENTS as usize);
    let stages = [idle, of_hellos, of_sessions, of_associations, peak];
    assert!(
        stages.is_sorted_by(|before, after| before < after),
        "{stages:?}"
    );
    drop((readers, live, pending));
}
