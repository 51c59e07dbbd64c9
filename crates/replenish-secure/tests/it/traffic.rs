//! Samples and services over DTLS and TLS, and what is seen of them on the wire.

use crate::agent::{LIMIT, Secure, eventually};
use crate::relay::{Relay, What};
use replenish::middleware::xrce::Xrce;
use replenish::msg::std_msgs::{BoundedString, Int32};
use replenish::msg::{Message, Service};
use replenish::{Context, Executor, Qos};
use replenish_secure::{connect_dtls, connect_tls};
use replenish_testkit::watchdog::watchdog;
use std::sync::{Arc, Mutex};
use std::time::Duration;

type Text = BoundedString;

/// A text that nothing else on the wire has.
const MARKER: &str = "the password of the arm is swordfish";

/// A service that gives a number for a number.
struct Echo;

impl Service for Echo {
    type Request = Int32;
    type Response = Int32;
    const TYPE_NAME: &'static str = "test_msgs/srv/Echo";
}

/// Publishes `samples` numbers and as many texts, reliably, and asks a service as often; expects
/// each back once, in order.
fn all_come_back(ctx: &Context, samples: i32) {
    let qos = Qos::reliable().keep_all(32);
    let node = ctx.node("echo").unwrap();
    let numbers = node.publisher::<Int32>("numbers", qos).unwrap();
    let texts = node.publisher::<Text>("texts", qos).unwrap();
    let heard = Arc::new(Mutex::new((Vec::new(), 0, Vec::new())));
    let (number, text, reply) = (Arc::clone(&heard), Arc::clone(&heard), Arc::clone(&heard));
    let client = node
        .client::<Echo>("double", qos, Duration::from_secs(60))
        .unwrap();
    let mut exec = Executor::new(ctx);
    exec.no_ledger();
    exec.on_event(|_| ());
    exec.worker("w")
        .subscribe(&node, "numbers", qos, move |m: &Int32, _| {
            number.lock().unwrap().0.push(m.data);
        })
        .unwrap()
        .subscribe(&node, "texts", qos, move |m: &Text, _| {
            assert_eq!(m.data.as_str(), MARKER);
            text.lock().unwrap().1 += 1;
        })
        .unwrap()
        .serve::<Echo, _>(&node, "double", qos, |n, answer, _| {
            answer.data = 2 * n.data;
        })
        .unwrap()
        .replies(&client, move |m, _| {
            reply.lock().unwrap().2.push(m.map(|m| m.data));
        })
        .unwrap();
    let running = exec.start().unwrap();
    let mut text = Text::default();
    text.data.push_str(MARKER).unwrap();
    let patience = Duration::from_secs(60);
    assert!(client.wait_for_server(patience).unwrap());
    for data in 0..samples {
        numbers.publish_within(&Int32 { data }, patience).unwrap();
        texts.publish_within(&text, patience).unwrap();
        client.call(&Int32 { data }).unwrap();
        let answered = || heard.lock().unwrap().2.len() > usize::try_from(data).unwrap();
        eventually("a reply", answered);
    }
    let count = usize::try_from(samples).unwrap();
    eventually("samples come back", || {
        let heard = heard.lock().unwrap();
        heard.0.len() >= count && heard.1 >= count
    });
    let doubled = (0..samples).map(|n| Ok(2 * n)).collect();
    assert_eq!(
        *heard.lock().unwrap(),
        ((0..samples).collect(), count, doubled)
    );
    running.stop();
    assert!(Text::TYPE_NAME.contains("String"));
}

#[test]
fn nothing_of_a_sample_is_seen_on_the_wire_over_dtls() {
    let _dog = watchdog("dtls", LIMIT);
    let agent = Secure::start("");
    let relay = Relay::udp(agent.dtls, |_| What::Pass);
    all_come_back(&Secure::dtls_at(relay.address, 1), 50);
    let (bytes, seen) = relay.seen(MARKER.as_bytes());
    println!("dtls: {bytes} bytes, marker seen: {seen}");
    assert!(bytes > 50 * 2 * MARKER.len() && !seen);
    // Names of topics are in the clear neither; the identity is: DTLS sends it before there is a
    // key.
    assert!(!relay.seen(b"numbers").1 && relay.seen(b"01010101").1);

    // The same without encryption: the relay would see it.
    let relay = Relay::udp(agent.running.local_addr(), |_| What::Pass);
    let plain = Xrce::udp_with(&relay.address.to_string(), Secure::config(9)).unwrap();
    all_come_back(&Context::new(plain), 5);
    assert!(relay.seen(MARKER.as_bytes()).1);
}

#[test]
fn nothing_of_a_sample_is_seen_on_the_wire_over_tls() {
    let _dog = watchdog("tls", LIMIT);
    let agent = Secure::start("");
    let relay = Relay::tcp(agent.tls);
    let at = relay.address.to_string();
    let xrce = connect_tls(&at, &agent.credentials("1"), Secure::config(1)).unwrap();
    all_come_back(&Context::new(xrce), 50);
    let (bytes, seen) = relay.seen(MARKER.as_bytes());
    println!("tls: {bytes} bytes, marker seen: {seen}");
    assert!(bytes > 50 * 2 * MARKER.len() && !seen);
    assert!(!relay.seen(b"numbers").1);

    let relay = Relay::tcp(agent.running.tcp_addr().unwrap());
    let plain = Xrce::tcp_with(&relay.address.to_string(), Secure::config(9)).unwrap();
    all_come_back(&Context::new(plain), 5);
    assert!(relay.seen(MARKER.as_bytes()).1);
}

#[test]
fn clients_over_all_transports_talk_to_each_other() {
    let _dog = watchdog("all transports", LIMIT);
    let agent = Secure::start("");
    let (one, two) = (agent.over_dtls(1), agent.over_tls(2));
    let qos = Qos::reliable().keep_all(32);
    let (from, to) = (one.node("from").unwrap(), two.node("to").unwrap());
    let numbers = from.publisher::<Int32>("numbers", qos).unwrap();
    let heard = Arc::new(Mutex::new(Vec::new()));
    let sink = Arc::clone(&heard);
    let mut reader = Executor::new(&two);
    reader.no_ledger();
    reader.on_event(|_| ());
    reader
        .worker("w")
        .subscribe(&to, "numbers", qos, move |m: &Int32, _| {
            sink.lock().unwrap().push(m.data);
        })
        .unwrap();
    let reader = reader.start().unwrap();
    let mut writer = Executor::new(&one);
    writer.no_ledger();
    writer.on_event(|_| ());
    let writer = writer.start().unwrap();
    for data in 0..300 {
        let patience = Duration::from_secs(60);
        numbers.publish_within(&Int32 { data }, patience).unwrap();
    }
    eventually("all samples", || heard.lock().unwrap().len() >= 300);
    assert_eq!(*heard.lock().unwrap(), (0..300).collect::<Vec<_>>());
    writer.stop();
    reader.stop();
}

#[test]
fn lost_doubled_and_reordered_handshakes_come_through() {
    let _dog = watchdog("handshakes", LIMIT);
    let agent = Secure::start("");
    let fates: [crate::relay::Fate; 6] = [
        |n| if n == 1 { What::Lose } else { What::Pass },
        |n| if n == 2 { What::Lose } else { What::Pass },
        |n| {
            if (3..=5).contains(&n) {
                What::Lose
            } else {
                What::Pass
            }
        },
        |_| What::Twice,
        |n| {
            if n % 2 == 1 { What::Later } else { What::Pass }
        },
        |n| {
            if n % 3 == 0 { What::Lose } else { What::Pass }
        },
    ];
    for fate in fates {
        let relay = Relay::udp(agent.dtls, fate);
        all_come_back(&Secure::dtls_at(relay.address, 1), 5);
    }
    assert_eq!(agent.stats().handshakes_refused, 0);
}

#[test]
fn a_large_datagram_is_refused_before_it_cannot_be_sent() {
    let agent = Secure::start("");
    let config = replenish::middleware::xrce::XrceConfig {
        mtu: 16_001,
        ..Secure::config(1)
    };
    let error = connect_dtls(&agent.dtls.to_string(), &crate::agent::psk(1), config);
    let error = error.unwrap_err().to_string();
    assert!(
        error.contains("mtu must be up to 16000 bytes over DTLS"),
        "{error}"
    );
}
