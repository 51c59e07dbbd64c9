//! Two programs of `replenish_agent::dds` on one domain: samples, late readers, services, drops.

use crate::bridged::{Program, domain};
use replenish_agent::dds::{
    DdsConfig, DdsLimits, Durability, EndpointKind, EndpointState, History, Interfaces, OpenError,
    Outgoing, Qos, RequestId, ServiceMapping, Topic,
};
use std::time::Duration;

fn chatter() -> Topic {
    Topic::new("rt/chatter", "std_msgs::msg::dds_::Int32_")
}

fn best_effort() -> Qos {
    Qos {
        reliable: false,
        ..Qos::default()
    }
}

#[test]
fn samples_arrive_in_order_and_once() {
    for qos in [Qos::default(), best_effort()] {
        let domain = domain();
        let (mut a, mut b) = (Program::new(domain), Program::new(domain));
        let reader = b.reader(&chatter(), qos);
        // Its own reader gets nothing from its own writer.
        let echo = a.reader(&chatter(), qos);
        let writer = a.writer(&chatter(), qos);
        a.matched(writer, 1);
        b.matched(reader, 1);
        for i in 0..200_u32 {
            a.write(writer, &i.to_le_bytes());
            if !qos.reliable {
                assert_eq!(b.next(reader).payload, i.to_le_bytes());
            }
        }
        if qos.reliable {
            for i in 0..200_u32 {
                assert_eq!(b.next(reader).payload, i.to_le_bytes());
            }
        }
        assert_eq!(a.within(echo, Duration::from_millis(50)), None);
        let (sent, got) = (a.report(writer).counts, b.report(reader).counts);
        assert_eq!((sent.sent, sent.dropped_out), (200, 0));
        assert_eq!((got.received, got.dropped_in, got.missed), (200, 0, 0));
    }
}

#[test]
fn late_readers_get_what_transient_local_writers_keep() {
    let domain = domain();
    let (mut a, mut b) = (Program::new(domain), Program::new(domain));
    let durable = Qos {
        durability: Durability::TransientLocal,
        history: History::KeepLast(3),
        ..Qos::default()
    };
    let writer = a.writer(&chatter(), durable);
    for i in 0..5 {
        a.write(writer, &[i; 4]);
    }
    let late = b.reader(&chatter(), durable);
    for i in 2..5 {
        assert_eq!(b.next(late).payload, [i; 4]);
    }
    // A volatile reader of the same topic gets nothing from before it was there.
    let volatile = b.reader(&chatter(), Qos::default());
    b.matched(volatile, 1);
    a.matched(writer, 2);
    a.write(writer, &[9; 4]);
    assert_eq!(b.next(volatile).payload, [9; 4]);
    assert_eq!(b.next(late).payload, [9; 4]);
    // A reader that comes again is late again.
    b.dds.close(late);
    a.matched(writer, 1);
    let again = b.reader(&chatter(), durable);
    let mut got = vec![b.next(again).payload];
    while let Some(more) = b.within(again, Duration::from_millis(200)) {
        got.push(more.payload);
    }
    assert_eq!(got, [vec![3; 4], vec![4; 4], vec![9; 4]]);
}

#[test]
fn what_is_closed_is_gone_for_others() {
    let domain = domain();
    let (mut a, mut b) = (Program::new(domain), Program::new(domain));
    let writer = a.writer(&chatter(), Qos::default());
    let reader = b.reader(&chatter(), Qos::default());
    a.matched(writer, 1);
    b.dds.close(reader);
    a.matched(writer, 0);
    let again = b.reader(&chatter(), Qos::default());
    a.matched(writer, 1);
    b.matched(again, 1);
    drop(a);
    b.matched(again, 0);
}

#[test]
fn requests_are_answered_in_each_form() {
    for services in [
        ServiceMapping::Auto,
        ServiceMapping::Enhanced,
        ServiceMapping::Cyclone,
    ] {
        let domain = domain();
        let config = DdsConfig {
            services,
            ..DdsConfig::default()
        };
        let request = Topic::new("rq/addRequest", "Add_Request_");
        let reply = Topic::new("rr/addReply", "Add_Response_");
        let program = || Program::with(domain, &config);
        let (mut server, mut one, mut two) = (program(), program(), program());
        let (rq, rr) = (request.clone(), reply.clone());
        let replier = server.open(EndpointKind::Replier {
            request: rq,
            reply: rr,
        });
        let requester = |program: &mut Program| {
            let (request, reply) = (request.clone(), reply.clone());
            let id = program.open(EndpointKind::Requester { request, reply });
            program.matched(id, 2);
            id
        };
        let (first, second) = (requester(&mut one), requester(&mut two));
        server.matched(replier, 4);
        let name = |number| RequestId {
            guid: [7; 16],
            sequence: number,
        };
        // Both use the same names; they are their own.
        one.dds
            .write(first, Outgoing::call(name(1), b"ask1".to_vec()));
        two.dds
            .write(second, Outgoing::call(name(1), b"ask2".to_vec()));
        one.dds
            .write(first, Outgoing::call(name(2), b"ask3".to_vec()));
        let mut asked = vec![
            server.next(replier),
            server.next(replier),
            server.next(replier),
        ];
        asked.reverse();
        for ask in &asked {
            let text = [b"yes-", &ask.payload[..]].concat();
            let answer = Outgoing::call(ask.request.unwrap(), text);
            server.dds.write(replier, answer.clone());
            server.dds.write(replier, answer); // is not sent: nobody waits for it any more
        }
        let mut got = [one.next(first), one.next(first)];
        got.sort_by_key(|reply| reply.request.unwrap().sequence);
        let texts = got.map(|reply| (reply.request, reply.payload));
        assert_eq!(
            texts,
            [
                (Some(name(1)), b"yes-ask1".to_vec()),
                (Some(name(2)), b"yes-ask3".to_vec())
            ]
        );
        let reply = two.next(second);
        assert_eq!(
            (reply.request, &reply.payload[..]),
            (Some(name(1)), &b"yes-ask2"[..])
        );
        assert_eq!(one.within(first, Duration::from_millis(50)), None);
        let report = server.report(replier).counts;
        assert_eq!((report.sent, report.calls_lost), (3, 3), "{services:?}");
    }
}

/// A program asks as soon as it has found the server; the server may find the program's reader
/// later. Before, such a reply was lost: a foreign client waited for its first answer for ever.
#[test]
fn a_reply_waits_for_the_reader_of_the_program_that_asked() {
    let config = DdsConfig {
        services: ServiceMapping::Cyclone,
        ..DdsConfig::default()
    };
    let request = Topic::new("rq/addRequest", "Add_Request_");
    let reply = Topic::new("rr/addReply", "Add_Response_");
    let header = [*b"whoever!", 1_i64.to_le_bytes()].concat();
    // On a busy machine discovery takes longer than the reply waits.
    let arrives = |_| {
        let domain = domain();
        let (mut server, mut client) = (Program::with(domain, &config), Program::new(domain));
        let (rq, rr) = (request.clone(), reply.clone());
        let replier = server.open(EndpointKind::Replier {
            request: rq,
            reply: rr,
        });
        let asks = client.writer(&request, Qos::default());
        client.matched(asks, 1);
        server.matched(replier, 1);
        client.write(asks, &[&header[..], b"ask1"].concat());
        let asked = server.next(replier);
        let answer = Outgoing::call(asked.request.unwrap(), b"yes1".to_vec());
        server.dds.write(replier, answer);
        let answers = client.reader(&reply, Qos::default());
        let got = client.within(answers, Duration::from_secs(1));
        got.is_some_and(|got| got.payload == [&header[..], b"yes1"].concat())
    };
    assert!((0..10).any(arrives));
}

#[test]
fn what_dds_refuses_is_told() {
    let domain = domain();
    let config = DdsConfig {
        limits: DdsLimits {
            domains: 1,
            ..DdsLimits::DEFAULT
        },
        ..DdsConfig::default()
    };
    let mut a = Program::with(domain, &config);
    let failed = |a: &Program, id| {
        loop {
            match a.report(id).state {
                EndpointState::Failed(why) => return why,
                EndpointState::Opening => std::thread::sleep(Duration::from_millis(5)),
                EndpointState::Open => return String::new(),
            }
        }
    };
    let first = a.writer(&chatter(), Qos::default());
    assert_eq!(failed(&a, first), "");
    // As in DDS: a name with another type is another topic.
    let other_type = a.reader(&Topic::new("rt/chatter", "Other_"), Qos::default());
    assert_eq!(failed(&a, other_type), "");
    a.dds.close(other_type);
    a.domain = crate::bridged::domain();
    let elsewhere = a.writer(&chatter(), Qos::default());
    assert_eq!(
        failed(&a, elsewhere),
        "1 domains are in use, dds.limits.domains"
    );
    a.dds.close(first);
    let elsewhere = a.writer(&chatter(), Qos::default());
    assert_eq!(failed(&a, elsewhere), "", "the unused domain makes room");
    a.domain = 233;
    let endpoint = replenish_agent::dds::Endpoint {
        domain: 233,
        node: None,
        kind: EndpointKind::Writer {
            topic: chatter(),
            qos: Qos::default(),
        },
    };
    assert_eq!(a.dds.open(99, endpoint), Err(OpenError::Domain(233)));
    let nowhere = DdsConfig {
        interfaces: Interfaces::Only(vec!["192.0.2.77".parse().unwrap()]),
        ..DdsConfig::default()
    };
    let wake = std::sync::Arc::new(replenish_os::WakeFd::new().unwrap());
    let error = replenish_agent::dds::Dds::start(&nowhere, wake).unwrap_err();
    assert!(error.to_string().contains("192.0.2.77"), "{error}");
}

/// An address that the bridge cannot use is refused, and not left out.
#[test]
fn an_interface_of_ipv6_is_refused_by_its_option() {
    let loopback = std::net::Ipv4Addr::LOCALHOST.into();
    let config = DdsConfig {
        interfaces: Interfaces::Only(vec![loopback, std::net::Ipv6Addr::LOCALHOST.into()]),
        ..DdsConfig::default()
    };
    let wake = std::sync::Arc::new(replenish_os::WakeFd::new().unwrap());
    let error = replenish_agent::dds::Dds::start(&config, wake).unwrap_err();
    assert_eq!(
        error.to_string(),
        "dds.interfaces (--interface) has ::1, an address of IPv6: the bridge speaks IPv4; give an \
         IPv4 address of this machine, or all"
    );
}
