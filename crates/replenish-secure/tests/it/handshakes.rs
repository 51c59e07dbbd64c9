//! Floods of handshakes: what strangers can make the agent hold.

use crate::agent::{LIMIT, Secure, eventually};
use crate::raw::Raw;
use replenish_testkit::watchdog::watchdog;
use std::net::{TcpStream, UdpSocket};
use std::time::{Duration, Instant};

#[test]
fn hellos_without_a_cookie_cost_nothing_and_get_less_than_they_send() {
    let _dog = watchdog("hellos", LIMIT);
    let agent = Secure::start("");
    let mut raw = Raw::new("127.0.0.1", agent.dtls, "01010101", &[1; 16]);
    let hello = raw.drain().remove(0);
    let sockets: Vec<UdpSocket> = (0..50)
        .map(|_| {
            let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
            socket.connect(agent.dtls).unwrap();
            socket.set_nonblocking(true).unwrap();
            socket
        })
        .collect();
    let (mut sent, mut got, mut buf) = (0, 0, [0; 2048]);
    for round in 0..400_u32 {
        for socket in &sockets {
            let mut hello = hello.clone();
            hello[40..44].copy_from_slice(&round.to_be_bytes()); // another random number
            sent += socket.send(&hello).unwrap_or(0);
        }
        for socket in &sockets {
            while let Ok(len) = socket.recv(&mut buf) {
                assert_eq!((len, buf[13]), (60, 3), "a cookie, and nothing else");
                got += len;
            }
        }
    }
    println!("{sent} bytes of 20000 hellos, {got} bytes of answers");
    assert!(got > 0 && got < sent);
    // None of them is a handshake: nothing was refused, and there is room.
    assert_eq!(agent.stats().handshakes_refused, 0);
    let begun = Instant::now();
    drop(agent.over_dtls(1));
    println!("an honest log-in took {:?}", begun.elapsed());
    assert_eq!(agent.stats().handshakes_refused, 0);
}

#[test]
fn unfinished_handshakes_are_bounded_for_each_host_and_end() {
    let _dog = watchdog("unfinished", LIMIT);
    let agent = Secure::start("");
    // They have a cookie, and go no further.
    let raw = |_| Raw::new("127.0.0.2", agent.dtls, "01010101", &[1; 16]);
    let mut stuck: Vec<Raw> = (0..40).map(raw).collect();
    let mut hellos = Vec::new();
    for raw in &mut stuck {
        let hello = raw.drain().remove(0);
        let mut buf = [0; 2048];
        raw.socket
            .set_read_timeout(Some(Duration::from_secs(60)))
            .unwrap();
        let len = raw.socket.recv(&mut buf).unwrap();
        assert_eq!(len, 60);
        hellos.push(with_cookie(&hello, &buf[28..60]));
    }
    for (raw, hello) in stuck.iter().zip(&hellos) {
        raw.socket.send(hello).unwrap();
    }
    agent.logged(&["udp 127.0.0.2:", "16 are the most"]);
    eventually("the others are refused", || {
        agent.stats().handshakes_refused >= 24
    });
    println!("{} of 40 refused", agent.stats().handshakes_refused);
    // Another host has its share.
    drop(agent.over_dtls(1));
    agent.logged(&["udp 127.0.0.2:", "not finished after 5 s"]);
}

/// The hello again, with a cookie, as record and message 1.
fn with_cookie(hello: &[u8], cookie: &[u8]) -> Vec<u8> {
    // Version, random number, and an empty session id are before the cookie.
    let at = 13 + 12 + 35;
    assert_eq!((hello[at - 1], hello[at]), (0, 0));
    let mut second = hello[..at].to_vec();
    second.push(cookie.len() as u8);
    second.extend(cookie);
    second.extend(&hello[at + 1..]);
    let body = (second.len() - 25) as u16;
    second[10] = 1;
    second[11..13].copy_from_slice(&(body + 12).to_be_bytes());
    second[15..17].copy_from_slice(&body.to_be_bytes());
    second[18] = 1;
    second[23..25].copy_from_slice(&body.to_be_bytes());
    second
}

#[test]
fn a_cookie_is_good_for_the_address_that_got_it() {
    let _dog = watchdog("cookies", LIMIT);
    let agent = Secure::start("");
    let mut raw = Raw::new("127.0.0.1", agent.dtls, "01010101", &[1; 16]);
    let hello = raw.drain().remove(0);
    let mut buf = [0; 2048];
    raw.socket
        .set_read_timeout(Some(Duration::from_secs(60)))
        .unwrap();
    let len = raw.socket.recv(&mut buf).unwrap();
    let second = with_cookie(&hello, &buf[28..len]);
    let thief = UdpSocket::bind("127.0.0.1:0").unwrap();
    thief
        .set_read_timeout(Some(Duration::from_secs(60)))
        .unwrap();
    thief.send_to(&second, agent.dtls).unwrap();
    let len = thief.recv(&mut buf).unwrap();
    assert_eq!((len, buf[13]), (60, 3), "a cookie of its own");
    raw.socket.send(&second).unwrap();
    raw.socket.recv(&mut buf).unwrap();
    assert_eq!(buf[13], 2, "ServerHello");
}

#[test]
fn connections_that_do_not_shake_hands_are_bounded_and_closed() {
    let _dog = watchdog("idle", LIMIT);
    let agent = Secure::start("");
    let idle: Vec<TcpStream> = (0..40)
        .map(|_| TcpStream::connect(agent.tls).unwrap())
        .collect();
    agent.logged(&["tcp 127.0.0.1:", "16 are the most"]);
    agent.logged(&["tcp 127.0.0.1:", "not finished after 5 s"]);
    drop(agent.over_tls(1));
    drop(idle);
}
