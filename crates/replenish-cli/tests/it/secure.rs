//! The command's encrypted ports: its options, and an access list that is read again.

use crate::common::{BIN, Scratch, json, run, stderr};
use replenish::middleware::LinkState;
use replenish::middleware::xrce::XrceConfig;
use replenish::{Context, Executor, RunningExecutor};
use replenish_secure::{Fingerprint, Psk, SecureError, TlsCredentials, connect_dtls, connect_tls};
use replenish_testkit::program::Running;
use replenish_xrce::client::PingPolicy;
use std::net::{TcpListener, UdpSocket};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::{Duration, Instant};

const SOON: Duration = Duration::from_secs(20);

/// A pre-shared key.
fn psk(byte: u8) -> String {
    format!("{byte:02x}").repeat(16)
}

/// Writes a file that its owner alone can read.
fn write(path: &Path, text: &str) {
    std::fs::write(path, text).unwrap();
    mode(path, 0o600);
}

fn mode(path: &Path, mode: u32) {
    std::fs::set_permissions(path, PermissionsExt::from_mode(mode)).unwrap();
}

/// A certificate and its private key as `name.pem` and `name.key`.
fn certificate(files: &Scratch, name: &str) {
    let made = rcgen::generate_simple_self_signed(vec![name.to_owned()]).unwrap();
    write(&files.path(&format!("{name}.pem")), &made.cert.pem());
    let key = made.signing_key.serialize_pem();
    write(&files.path(&format!("{name}.key")), &key);
}

/// Wrong combinations, files that cannot be used, and their modes: each message as it is.
#[test]
fn wrong_options_and_files_are_refused_in_these_words() {
    let files = Scratch::new("secure-options");
    for name in ["agent", "other"] {
        certificate(&files, name);
    }
    let path = |name: &str| files.path(name).display().to_string();
    write(&files.path("empty"), "");
    write(
        &files.path("list"),
        &format!("[[client]]\nkey = \"01010101\"\npsk = \"{}\"\n", psk(1)),
    );
    for (copy, of, bits) in [
        ("open-list", "list", 0o644),
        ("open-key", "agent.key", 0o604),
        ("group-key", "agent.key", 0o640),
    ] {
        std::fs::copy(files.path(of), files.path(copy)).unwrap();
        mode(&files.path(copy), bits);
    }
    let (udp, tcp) = (
        UdpSocket::bind("127.0.0.1:0").unwrap(),
        TcpListener::bind("127.0.0.1:0").unwrap(),
    );
    let taken = (udp.local_addr().unwrap(), tcp.local_addr().unwrap());
    // `@list`, `@pem` and `@key` are good files, `@dir` is where all are.
    let missing = |what: &str| {
        format!("error: the following required arguments were not provided:\n  {what}\n")
    };
    let cases = [
        (
            "--dtls 127.0.0.1:0".to_owned(),
            2,
            missing("--access <FILE>"),
        ),
        (
            "--tls 127.0.0.1:0".into(),
            2,
            missing("--access <FILE>\n  --certificate <FILE>\n  --key <FILE>"),
        ),
        (
            "--tls 127.0.0.1:0 --access @list --certificate @pem".into(),
            2,
            missing("--key <FILE>"),
        ),
        (
            "--certificate @pem --key @key --access @list".into(),
            2,
            missing("--tls <ADDRESS>"),
        ),
        (
            "--dtls localhost --access @list".into(),
            2,
            "error: invalid value 'localhost' for '--dtls <ADDRESS>': allowed is an IP address, \
             with a port or without one (then 8889): 192.168.7.1:8889, [::1]:8889\n"
                .into(),
        ),
        (
            "--dtls 127.0.0.1:0 --access @dir/none".into(),
            1,
            "replenish: cannot read @dir/none: No such file or directory (os error 2)\n".into(),
        ),
        (
            "--dtls 127.0.0.1:0 --access @dir/open-list".into(),
            1,
            "replenish: cannot use @dir/open-list: its mode is 0644, with which every account has \
             its secrets: allowed are modes without access for others, as 0600 or 0640 (chmod o= \
             @dir/open-list)\n"
                .into(),
        ),
        (
            format!("--dtls {} --access @list", taken.0),
            1,
            format!(
                "replenish: address {} is in use; another agent may be running there\n",
                taken.0
            ),
        ),
        (
            format!(
                "--tls {} --access @list --certificate @pem --key @key",
                taken.1
            ),
            1,
            format!(
                "replenish: address {} is in use; another agent may be running there\n",
                taken.1
            ),
        ),
        (
            "--tls 127.0.0.1:0 --access @list --certificate @dir/none --key @key".into(),
            1,
            "replenish: cannot use @dir/none: I/O error: No such file or directory (os error 2)\n"
                .into(),
        ),
        (
            "--tls 127.0.0.1:0 --access @list --certificate @dir/empty --key @key".into(),
            1,
            "replenish: cannot use @dir/empty: it has no certificate in PEM form\n".into(),
        ),
        (
            "--tls 127.0.0.1:0 --access @list --certificate @pem --key @dir/none".into(),
            1,
            "replenish: cannot use @dir/none: No such file or directory (os error 2)\n".into(),
        ),
        (
            "--tls 127.0.0.1:0 --access @list --certificate @pem --key @dir/empty".into(),
            1,
            "replenish: cannot use @dir/empty: it has no private key in PEM form\n".into(),
        ),
        (
            "--tls 127.0.0.1:0 --access @list --certificate @pem --key @dir/open-key".into(),
            1,
            "replenish: cannot use @dir/open-key: its mode is 0604, with which every account has \
             its secrets: allowed are modes without access for others, as 0600 or 0640 (chmod o= \
             @dir/open-key)\n"
                .into(),
        ),
        (
            "--tls 127.0.0.1:0 --access @list --certificate @pem --key @dir/other.key".into(),
            1,
            "replenish: cannot use @dir/other.key: it is not the private key of @pem\n".into(),
        ),
    ];
    for (options, code, expected) in cases {
        let full = |text: &str| {
            let good = [
                ("@list", "list"),
                ("@pem", "agent.pem"),
                ("@key", "agent.key"),
            ];
            let text = text.replace("@dir", &files.dir().display().to_string());
            let put = |text: String, (name, file): &(&str, &str)| text.replace(name, &path(file));
            good.iter().fold(text, put)
        };
        let options = full(&options);
        let words: Vec<&str> = options.split(' ').collect();
        let output = run(&[&["agent"], &words[..]].concat());
        let text = stderr(&output);
        let said = text.split("\nUsage:").next().unwrap();
        let said = said.split("\nFor more").next().unwrap();
        assert_eq!(said, full(&expected), "{options}");
        assert_eq!(output.status.code(), Some(code), "{options}");
    }
    // The group may read it: it is the service's.
    let group = format!(
        "agent --tls 127.0.0.1:0 --access {} --certificate {} --key {}",
        path("list"),
        path("agent.pem"),
        path("group-key")
    );
    let mut agent = Running::start(BIN, &group.split(' ').collect::<Vec<_>>());
    let line = agent.expect_line("listening at", SOON);
    assert!(
        line.contains("(TLS, sha256:") && !line.contains("(UDP)"),
        "{line}"
    );
    agent.signal("TERM");
    assert!(agent.end(SOON).success());
}

/// An agent with a list of clients: `(key, line with its secret)`.
struct Agent {
    running: Running,
    files: Scratch,
    dtls: String,
    tls: String,
}

impl Agent {
    fn start(clients: &[(u8, String)]) -> Self {
        let files = Scratch::new("secure-reload");
        for name in ["agent", "3"] {
            certificate(&files, name);
        }
        let path = |name: &str| files.path(name).display().to_string();
        let print = Fingerprint::of_file(&files.path("3.pem")).unwrap();
        let clients = [clients, &[(3, format!("certificate = \"{print}\""))]].concat();
        write(&files.path("list"), &list(&clients));
        let (access, pem, key, json) = (
            path("list"),
            path("agent.pem"),
            path("agent.key"),
            path("json"),
        );
        let args = ["agent", "--dtls", "127.0.0.1:0", "--tls", "127.0.0.1:0"];
        let with = [
            "--access",
            &access,
            "--certificate",
            &pem,
            "--key",
            &key,
            "--json",
            &json,
        ];
        let mut running = Running::start(BIN, &[&args[..], &with].concat());
        let line = running.expect_line("listening at", SOON);
        let at = |kind: &str| {
            let before = line.split(kind).next().unwrap().trim_end();
            before.rsplit(' ').next().unwrap().to_owned()
        };
        let (dtls, tls) = (at("(DTLS)"), at("(TLS,"));
        Self {
            running,
            files,
            dtls,
            tls,
        }
    }

    /// Makes the list this text, and has it read; the line that says what has become of it.
    fn reload(&mut self, text: &str, says: &str) -> String {
        write(&self.files.path("list"), text);
        self.running.signal("HUP");
        self.running.expect_line(says, SOON)
    }

    /// Waits for a line of the log with all of `parts`.
    fn logged(&mut self, parts: [&str; 2]) {
        let end = Instant::now() + SOON;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let line = self.running.expect_line(parts[0], left);
            if line.contains(parts[1]) {
                return;
            }
        }
    }

    fn log_in(&self, key: u8, secret: u8) -> Result<Client, SecureError> {
        let secret = Psk::from_hex(&psk(secret)).unwrap();
        connect_dtls(&self.dtls, &secret, config(key, PATIENT)).map(Client::new)
    }

    /// The error of a log-in that the agent refuses.
    fn refused(&self, key: u8, secret: u8) -> String {
        let secret = Psk::from_hex(&psk(secret)).unwrap();
        let error = connect_dtls(&self.dtls, &secret, config(key, HASTY));
        error.err().unwrap().to_string()
    }

    fn log_in_over_tls(&self, patience: u64) -> Result<Client, SecureError> {
        let credentials = TlsCredentials {
            certificate: self.files.path("3.pem"),
            key: self.files.path("3.key"),
            agent: Fingerprint::of_file(&self.files.path("agent.pem")).unwrap(),
        };
        connect_tls(&self.tls, &credentials, config(3, patience)).map(Client::new)
    }
}

/// A session, and an executor that does nothing but look after it.
struct Client {
    context: Context,
    _running: RunningExecutor,
}

impl Client {
    fn new(session: replenish::middleware::xrce::Xrce) -> Self {
        let context = Context::new(session);
        let mut exec = Executor::new(&context);
        exec.no_ledger();
        exec.on_event(|_| ());
        let _running = exec.start().unwrap();
        Self { context, _running }
    }

    fn is_up(&self) -> bool {
        self.context.link() == LinkState::Up
    }
}

fn list(clients: &[(u8, String)]) -> String {
    let entries = clients.iter().map(|(key, secret)| {
        let key = format!("{key:02x}").repeat(4);
        format!("[[client]]\nkey = \"{key}\"\n{secret}\n")
    });
    entries.collect()
}

/// The time that a log-in may take, in nanoseconds, where it is to succeed, and where not.
const PATIENT: u64 = 20_000_000_000;
const HASTY: u64 = 2_500_000_000;

/// A client that does not take a loaded machine for a lost agent.
fn config(key: u8, patience: u64) -> XrceConfig {
    XrceConfig {
        key: Some([key; 4]),
        connect_timeout: patience,
        ping: PingPolicy {
            after: 1_000_000_000,
            silence_limit: 60_000_000_000,
        },
        ..XrceConfig::default()
    }
}

fn eventually(what: &str, holds: impl Fn() -> bool) {
    let end = Instant::now() + SOON;
    while !holds() {
        assert!(Instant::now() < end, "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_list_that_is_read_again_ends_sessions_and_lets_new_secrets_in() {
    let secret = |byte: u8| format!("psk = \"{}\"", psk(byte));
    let mut agent = Agent::start(&[(1, secret(1)), (2, secret(2)), (4, secret(4))]);
    let print = Fingerprint::of_file(&agent.files.path("3.pem")).unwrap();
    let third = (3, format!("certificate = \"{print}\""));
    let (gone, stays) = (agent.log_in(1, 1).unwrap(), agent.log_in(2, 2).unwrap());
    let over_tls = agent.log_in_over_tls(PATIENT).unwrap();

    // A broken file changes nothing, and the log has its line.
    let broken = list(&[(2, "psk = \"00\"".into())]);
    let line = agent.reload(&broken, "kept the access list as it was");
    let says = "line 3: client.psk: allowed are 32 to 128 hexadecimal digits, an even number";
    assert!(line.ends_with(says), "{line}");
    drop(agent.log_in(4, 4).unwrap());

    // A list that others can read is refused as well.
    let path = agent.files.path("list");
    write(&path, &list(&[(2, secret(2))]));
    mode(&path, 0o644);
    agent.running.signal("HUP");
    let line = agent
        .running
        .expect_line("kept the access list as it was", SOON);
    assert!(line.contains("its mode is 0644"), "{line}");
    assert!(
        [&gone, &stays, &over_tls]
            .iter()
            .all(|client| client.is_up())
    );

    // Clients 1 and 4 are taken out: a session ends, and does not come back.
    let two = [(2, secret(2)), third];
    agent.reload(&list(&two), "read the access list again: 2 entries");
    agent.logged([
        "client 01010101 at dtls 127.0.0.1:",
        "ended a session: the access list does not have its psk",
    ]);
    eventually("the client over DTLS is told", || !gone.is_up());
    drop(gone);
    assert!(agent.refused(1, 1).contains("does not have this psk"));
    agent.logged([
        "refused a handshake",
        "the access list has no psk for the identity",
    ]);
    assert!(stays.is_up() && over_tls.is_up());

    // Client 1 has another key from now on, and client 3 is out.
    let two = [(1, secret(7)), (2, secret(2))];
    agent.reload(&list(&two), "read the access list again: 2 entries");
    agent.logged([
        "client 03030303 at tls 127.0.0.1:",
        "ended a session: the access list does not have its certificate",
    ]);
    eventually("the client over TLS is told", || !over_tls.is_up());
    drop(over_tls);
    let back = agent.log_in(1, 7).unwrap();
    assert!(back.is_up() && stays.is_up());
    drop(back);
    assert!(agent.refused(1, 1).contains("does not have this psk"));
    assert!(agent.log_in_over_tls(HASTY).is_err());

    drop(stays);
    agent.running.signal("TERM");
    assert!(agent.running.end(SOON).success());
    let told = json(&agent.files.path("json"));
    let access = &told["access"];
    for (field, value) in [("loaded", 3), ("failed", 2), ("entries", 2)] {
        assert_eq!(access[field], value, "{field}: {access}");
    }
    let refused = &told["refused"];
    assert!(refused["handshake"].as_u64() >= Some(3), "{refused}");
    assert!(refused["not_listed"].as_u64() >= Some(2), "{refused}");
}
