//! Memory that publishers share with the readers of their host, beside everything else that a topic
//! promises: IPv6, lifespans, lent messages, workers that receive for themselves.

use crate::common::{eventually, executor};
use crate::large::{Hand, MEGABYTE, SIZE, pixels, spec};
use crate::shared_memory::{TOPIC, config, number, publish};
use replenish::middleware::rtps::{IpVersions, Rtps, RtpsConfig};
use replenish::middleware::{ReaderId, WriterId};
use replenish::{Budget, Context, Qos, Topic};
use replenish_interfaces::sensor_msgs::msg::Image;
use replenish_testkit::domain::domain;
use replenish_testkit::watchdog::watchdog;
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(120);
const MS: Duration = Duration::from_millis(1);

/// Both ends of a topic, by hand; images are fetched from memory by now.
fn ends(config: &RtpsConfig, qos: Qos) -> ((Hand, WriterId), (Hand, ReaderId)) {
    use replenish::middleware::Middleware as _;
    let (mut camera, mut viewer) = (Hand::new(config), Hand::new(config));
    let spec = spec(TOPIC, qos, SIZE);
    let writer = camera.of.create_writer(&spec).unwrap();
    let reader = viewer.of.create_reader(&spec).unwrap();
    while viewer.of.stats().shared == 0 {
        publish(&mut camera, writer, 0);
        for _ in 0..50 {
            camera.round(&[]);
            viewer.round(&[reader]);
        }
    }
    viewer.heard.clear();
    ((camera, writer), (viewer, reader))
}

#[test]
fn images_pass_through_memory_between_participants_that_met_by_ipv6() {
    let _dog = watchdog("memory and IPv6", LIMIT);
    if std::net::UdpSocket::bind("[::1]:0").is_err() {
        eprintln!("skipped: this machine has no IPv6");
        return;
    }
    let config = RtpsConfig {
        ip: IpVersions::V6,
        ..config(domain())
    };
    let qos = Qos::reliable().keep_last(3);
    let ((mut camera, writer), (mut viewer, reader)) = ends(&config, qos);
    let before = viewer.of.stats().shared;
    for image in 1..=10 {
        publish(&mut camera, writer, image);
        while viewer.has(reader) < image as usize {
            camera.round(&[]);
            viewer.round(&[reader]);
        }
    }
    let images = viewer.heard.iter().map(|(_, bytes)| number(bytes));
    assert!(images.eq(1..=10));
    assert_eq!(viewer.of.stats().shared - before, 10);
}

/// An image waits in the publisher's memory until its lifespan is over, and is not seen after that;
/// the next one is.
#[test]
fn an_image_whose_lifespan_is_over_is_not_seen() {
    let _dog = watchdog("memory and lifespans", LIMIT);
    let qos = Qos::reliable().keep_last(3).lifespan(300 * MS);
    let ((mut camera, writer), (mut viewer, reader)) = ends(&config(domain()), qos);
    let lost = {
        use replenish::middleware::Middleware as _;
        publish(&mut camera, writer, 1);
        let before = viewer.of.lost(reader);
        std::thread::sleep(400 * MS);
        for _ in 0..100 {
            camera.round(&[]);
            viewer.round(&[reader]);
        }
        viewer.of.lost(reader) - before
    };
    assert_eq!((viewer.has(reader), lost), (0, 1));
    publish(&mut camera, writer, 2);
    while viewer.has(reader) == 0 {
        camera.round(&[]);
        viewer.round(&[reader]);
    }
    assert_eq!(number(&viewer.heard[0].1), 2);
}

/// A lent image is read in place in its own program, and through memory in another one. A worker
/// of a budget receives it for itself there, since it is best effort.
#[test]
fn a_lent_image_reaches_workers_that_receive_for_themselves() {
    const IMAGES: u32 = 20;
    let _dog = watchdog("memory and lent messages", LIMIT);
    let config = config(domain());
    let rtps = Arc::new(Rtps::open(&config).unwrap());
    let [here, there] = [
        Context::new(Rtps::open(&config).unwrap()),
        Context::new(Arc::clone(&rtps)),
    ];
    let topic = Topic::named(TOPIC).max_size(SIZE);
    let effort = Qos::best_effort().keep_last(4);
    let node = here.node("camera").unwrap();
    let blank = || Image {
        data: vec![0; MEGABYTE],
        ..Image::default()
    };
    let out = node.publisher::<Image>(topic, effort).unwrap();
    let pool = out.pool(8, blank).unwrap();
    let budget = Budget::of(80 * MS).every(100 * MS);
    let both = [&here, &there].map(|ctx| {
        let node = ctx.node("viewer").unwrap();
        let heard = Arc::new(Mutex::new(Vec::new()));
        let note = Arc::clone(&heard);
        let mut exec = executor(ctx).0;
        exec.worker("viewer")
            .budget(budget)
            .subscribe(&node, topic, effort, move |image: &Image, _| {
                assert!(image.data == pixels(image.height), "image {}", image.height);
                note.lock().unwrap().push(image.height);
            })
            .unwrap();
        (exec.start().unwrap(), heard)
    });
    let send = |number| {
        let mut image = pool.loan().unwrap();
        image.height = number;
        image.data.copy_from_slice(&pixels(number));
        image.publish().unwrap();
        let seen = |of: &Mutex<Vec<u32>>| of.lock().unwrap().last() == Some(&number);
        eventually(|| both.iter().all(|(_, heard)| seen(heard)))
    };
    // Best effort: none is seen before they know each other, nor while the memory is opened.
    assert!(eventually(|| out.subscriptions() == Some(2)));
    std::thread::sleep(300 * MS);
    let shared = rtps.stats().shared;
    for number in 1..=IMAGES {
        assert!(send(number), "image {number}");
    }
    let expected: Vec<u32> = (1..=IMAGES).collect();
    for (running, heard) in both {
        assert_eq!(*heard.lock().unwrap(), expected);
        drop(running.stop());
    }
    let shared = rtps.stats().shared - shared;
    assert!(shared >= u64::from(IMAGES) - 2, "{shared} through memory");
    assert!(eventually(|| pool.free() == 8), "{pool:?}");
}
