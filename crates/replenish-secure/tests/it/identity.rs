//! Log-in of clients: keys, certificates, client keys, topics, and sessions that a new list ends.

use crate::agent::{LIMIT, Secure, eventually, psk};
use crate::raw::Raw;
use replenish::middleware::LinkState;
use replenish::middleware::xrce::{Xrce, XrceConfig};
use replenish::msg::std_msgs::Int32;
use replenish::{Context, Executor, Qos, RunningExecutor};
use replenish_secure::{Fingerprint, TlsCredentials, connect_dtls, connect_tls};
use replenish_testkit::watchdog::watchdog;
use std::time::Duration;

/// One that does not wait long.
fn hasty(key: u8) -> XrceConfig {
    XrceConfig {
        connect_timeout: 3_000_000_000,
        ..Secure::config(key)
    }
}

/// `CREATE_CLIENT` of the client with this key.
fn log_in(key: u8) -> Vec<u8> {
    let mut message = vec![
        0x80, 0, 0, 0, 0, 1, 16, 0, 0x58, 0x52, 0x43, 0x45, 1, 0, 1, 15,
    ];
    message.extend([key; 4]);
    message.extend([0x81, 0, 0, 2]);
    message
}

/// An executor that does nothing but look after the session.
fn spin(ctx: &Context) -> RunningExecutor {
    let mut exec = Executor::new(ctx);
    exec.no_ledger();
    exec.on_event(|_| ());
    exec.start().unwrap()
}

#[test]
fn a_wrong_psk_and_an_unknown_identity_are_refused_and_logged() {
    let _dog = watchdog("wrong psk", LIMIT);
    let agent = Secure::start("");
    let at = agent.dtls.to_string();
    let error = connect_dtls(&at, &psk(2), hasty(1))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("does not have this psk for this client's key"),
        "{error}"
    );
    agent.logged(&[
        "client 01010101 at udp 127.0.0.1:",
        "its psk is not the one",
    ]);
    let error = connect_dtls(&at, &psk(7), hasty(7))
        .unwrap_err()
        .to_string();
    assert!(error.contains("does not have this psk"), "{error}");
    agent.logged(&["udp 127.0.0.1:", "no psk for the identity"]);
    // Client 9 is in the list, without a psk.
    connect_dtls(&at, &psk(9), hasty(9)).unwrap_err();
    assert!(agent.stats().handshakes_refused >= 3);
    assert_eq!(agent.stats().clients_created, 0);
    drop(connect_dtls(&at, &psk(1), Secure::config(1)).unwrap());
}

#[test]
fn a_wrong_certificate_and_none_are_refused_and_logged() {
    let _dog = watchdog("wrong certificate", LIMIT);
    let agent = Secure::start("");
    let stranger = Fingerprint::of_file(&agent.path("stranger.pem")).unwrap();
    let error = agent.tls_as("stranger", 1).unwrap_err().to_string();
    assert!(
        error.contains("no handshake with the agent at 127.0.0.1:"),
        "{error}"
    );
    agent.logged(&[
        "tcp 127.0.0.1:",
        "does not have its certificate",
        &stranger.to_string(),
    ]);
    // An agent with another certificate gets nothing either.
    let credentials = TlsCredentials {
        agent: stranger,
        ..agent.credentials("1")
    };
    let error = connect_tls(&agent.tls.to_string(), &credentials, hasty(1)).unwrap_err();
    assert!(
        error.to_string().contains("invalid peer certificate"),
        "{error}"
    );
    assert_eq!(agent.stats().clients_created, 0);
    drop(agent.tls_as("1", 1).unwrap());
}

#[test]
fn a_client_logs_in_with_no_key_but_its_own() {
    let _dog = watchdog("keys", LIMIT);
    let agent = Secure::start("");
    let mut raw = Raw::new("127.0.0.1", agent.dtls, "01010101", &[1; 16]);
    raw.run(Duration::from_secs(30), |raw| raw.connected);
    assert!(raw.connected);
    for key in [2, 9] {
        raw.send(&log_in(key));
        let key = format!("{key:02x}").repeat(4);
        agent.logged(&[
            &format!("client {key} at dtls 127.0.0.1:"),
            "key for this identity",
        ]);
    }
    assert_eq!(agent.stats().clients_created, 0);
    raw.send(&log_in(1));
    eventually("its own key is taken", || {
        agent.stats().clients_created == 1
    });
    let error = agent.tls_as("1", 2).unwrap_err().to_string();
    assert!(error.contains("refused a session"), "{error}");
    agent.logged(&["client 02020202 at tls 127.0.0.1:", "key for this identity"]);
}

#[test]
fn a_client_with_a_secret_does_not_log_in_without_it() {
    let _dog = watchdog("plain", LIMIT);
    let agent = Secure::start("");
    let (udp, tcp) = (
        agent.running.local_addr(),
        agent.running.tcp_addr().unwrap(),
    );
    for error in [
        Xrce::udp_with(&udp.to_string(), hasty(1)).unwrap_err(),
        Xrce::tcp_with(&tcp.to_string(), hasty(1)).unwrap_err(),
    ] {
        assert!(error.to_string().contains("refused a session"), "{error}");
    }
    agent.logged(&[
        "client 01010101 at udp 127.0.0.1:",
        "key without encryption",
    ]);
    agent.logged(&[
        "client 01010101 at tcp 127.0.0.1:",
        "key without encryption",
    ]);
    drop(Xrce::udp_with(&udp.to_string(), Secure::config(9)).unwrap());
}

#[test]
fn its_topics_follow_its_entry() {
    let _dog = watchdog("topics", LIMIT);
    let agent = Secure::start("write = [\"/allowed\"]");
    for tls in [false, true] {
        let ctx = if tls {
            agent.over_tls(2)
        } else {
            agent.over_dtls(2)
        };
        let node = ctx.node("n").unwrap();
        let qos = Qos::reliable();
        node.publisher::<Int32>("allowed", qos).unwrap();
        let error = node
            .publisher::<Int32>("other", qos)
            .err()
            .unwrap()
            .to_string();
        assert!(
            error.contains("denied") || error.contains("DENIED"),
            "{error}"
        );
    }
}

#[test]
fn a_key_that_is_taken_out_ends_the_session() {
    let _dog = watchdog("reload", LIMIT);
    let agent = Secure::start("");
    let (gone, stays) = ([agent.over_dtls(1)], agent.over_tls(2));
    let running: Vec<_> = gone.iter().chain([&stays]).map(spin).collect();
    agent.allow(&[2]);
    agent.logged(&[
        "client 01010101 at dtls 127.0.0.1:",
        "ended a session",
        "psk",
    ]);
    eventually("the client is told", || gone[0].link() != LinkState::Up);
    assert_eq!(stays.link(), LinkState::Up);
    // It comes back with its entry, by itself.
    agent.logged(&["no psk for the identity"]);
    agent.allow(&[1, 2]);
    eventually("it is back", || gone[0].link() == LinkState::Up);
    agent.allow(&[1]);
    agent.logged(&[
        "client 02020202 at tls 127.0.0.1:",
        "ended a session",
        "certificate",
    ]);
    eventually("the client is told", || stays.link() != LinkState::Up);
    assert_eq!(gone[0].link(), LinkState::Up);
    running.into_iter().for_each(|running| drop(running.stop()));
}

#[test]
fn a_client_finds_an_agent_that_was_started_again() {
    let _dog = watchdog("restart", LIMIT);
    let mut agent = Secure::start("");
    let config = |key| XrceConfig {
        ping: XrceConfig::default().ping,
        ..Secure::config(key)
    };
    let credentials = agent.credentials("2");
    let over_dtls = connect_dtls(&agent.dtls.to_string(), &psk(1), config(1)).unwrap();
    let over_tls = connect_tls(&agent.tls.to_string(), &credentials, config(2)).unwrap();
    let all = [Context::new(over_dtls), Context::new(over_tls)];
    let running: Vec<_> = all.iter().map(spin).collect();
    // It forgets every association and connection, and sends no word of it.
    agent.restart();
    eventually("the new agent has both", || agent.stats().clients == 2);
    eventually("they are up", || {
        all.iter().all(|ctx| ctx.link() == LinkState::Up)
    });
    running.into_iter().for_each(|running| drop(running.stop()));
}
