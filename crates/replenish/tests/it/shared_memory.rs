//! Images of a megabyte between processes of one host, through memory of the publisher.

use crate::common::{eventually, executor};
use crate::large::{Hand, MEGABYTE, SIZE, pixels, spec};
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::middleware::{Middleware, PublishError, ReaderId};
use replenish::{Budget, Context, Qos, Topic};
use replenish_interfaces::sensor_msgs::msg::ImageView;
use replenish_testkit::domain::domain;
use replenish_testkit::program::Running;
use replenish_testkit::watchdog::watchdog;
use std::process::Command;
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const IMAGES: u32 = 100;
pub(crate) const TOPIC: &str = "/shared/image";
const RELIABLE: Qos = Qos::reliable().keep_all(3);

/// A lease of a second: others notice soon that a process was killed.
pub(crate) fn config(domain: u16) -> RtpsConfig {
    RtpsConfig {
        domain,
        range: DiscoveryRange::Localhost,
        interfaces: vec![std::net::Ipv4Addr::LOCALHOST],
        lease: Duration::from_secs(1),
        ..RtpsConfig::default()
    }
}

/// An image as its camera publishes it: a number and pixels.
fn image(number: u32) -> Vec<u8> {
    [&number.to_le_bytes(), &pixels(number)[4..]].concat()
}

pub(crate) fn number(bytes: &[u8]) -> u32 {
    assert_eq!(bytes.len(), MEGABYTE);
    let number = u32::from_le_bytes(bytes[..4].try_into().unwrap());
    assert!(bytes == image(number), "image {number}, byte by byte");
    number
}

/// Publishes an image as soon as there is room for it.
pub(crate) fn publish(of: &mut Hand, writer: replenish::middleware::WriterId, number: u32) {
    let bytes = image(number);
    while of.of.publish(writer, &bytes) == Err(PublishError::Full) {
        of.round(&[]);
    }
}

/// A process that is one of the ignored tests below.
fn process(test: &str, domain: u16) -> Running {
    process_under(&[], test, domain)
}

fn process_under(wrapper: &[&str], test: &str, domain: u16) -> Running {
    let program = std::env::current_exe().unwrap();
    let variable = format!("SHARED_DOMAIN={domain}");
    let name = format!("shared_memory::{test}");
    let test = [
        program.to_str().unwrap(),
        "--ignored",
        "--exact",
        &name,
        "--nocapture",
    ];
    let all = [&[variable.as_str()], wrapper, &test].concat();
    Running::start("/usr/bin/env", &all)
}

fn domain_of_process() -> u16 {
    std::env::var("SHARED_DOMAIN").unwrap().parse().unwrap()
}

#[test]
#[ignore = "a process that tests below start"]
fn a_camera() {
    let mut camera = Hand::new(&config(domain_of_process()));
    let writer = camera
        .of
        .create_writer(&spec(TOPIC, RELIABLE, SIZE))
        .unwrap();
    while camera.of.matched_readers(writer) == Some(0) {
        camera.round(&[]);
    }
    // The reader knows the memory before the first image.
    (0..100).for_each(|_| camera.round(&[]));
    for number in 0..IMAGES {
        publish(&mut camera, writer, number);
        camera.round(&[]);
    }
    println!("memory {} all sent", mapped()[0]);
    loop {
        camera.round(&[]);
    }
}

#[test]
#[ignore = "a process that tests below start"]
fn a_viewer() {
    let ctx = Context::new(Rtps::open(&config(domain_of_process())).unwrap());
    let node = ctx.node("viewer").unwrap();
    let (mut exec, _) = executor(&ctx);
    let topic = Topic::named(TOPIC).max_size(SIZE);
    let budget = Budget::of(Duration::from_millis(80)).every(Duration::from_millis(100));
    exec.worker("viewer")
        .budget(budget)
        .subscribe_view::<replenish_interfaces::sensor_msgs::msg::Image, _, _>(
            &node,
            topic,
            RELIABLE,
            |image: &ImageView<'_>, _| {
                assert!(image.data == pixels(image.height), "image {}", image.height);
                println!("image {}.", image.height);
            },
        )
        .unwrap();
    exec.spin().unwrap();
}

/// Takes images until their camera's last one; all of them, in order, from `first` on.
fn see(viewer: &mut Hand, reader: ReaderId, first: u32) {
    let mut next = first;
    while next < IMAGES {
        viewer.round(&[reader]);
        for (_, bytes) in viewer.heard.drain(..) {
            assert_eq!(number(&bytes), next, "once, in order");
            next += 1;
        }
    }
}

/// The numbers of the memories of publishers that this process has mapped.
fn mapped() -> Vec<String> {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    let memories = maps
        .lines()
        .filter(|line| line.contains("memfd:replenish-samples"));
    let inode = |line: &str| line.split_whitespace().nth(4).map(str::to_owned);
    memories.filter_map(inode).collect()
}

/// A camera in another process: each image once, in order, byte by byte, and next to nothing of it
/// in datagrams. The camera is killed; the memory goes, and the next camera is seen as well.
#[test]
fn images_pass_between_processes_through_memory() {
    let _dog = watchdog("images between processes", Duration::from_secs(240));
    let domain = domain();
    let mut viewer = Hand::new(&config(domain));
    let reader = viewer
        .of
        .create_reader(&spec(TOPIC, RELIABLE, SIZE))
        .unwrap();
    for round in 1..=2 {
        let mut camera = process("a_camera", domain);
        let before = viewer.of.stats();
        see(&mut viewer, reader, 0);
        let stats = viewer.of.stats();
        // The first ones may have left before the camera knew that the memory is open.
        let shared = stats.shared - before.shared;
        assert!(
            (u64::from(IMAGES) - 10..=u64::from(IMAGES)).contains(&shared),
            "{shared}"
        );
        // A fragment has 64 kB: a megabyte would take 16 of them.
        let datagrams = stats.received - before.received;
        assert!(
            datagrams < 4 * u64::from(IMAGES) + 400,
            "{datagrams} datagrams"
        );
        assert_eq!(viewer.of.lost(reader), 0);
        let said = camera.expect_line("all sent", LIMIT);
        let (_, memory) = said.split_once("memory ").unwrap();
        let memory = memory.trim_end_matches(" all sent").to_owned();
        assert!(mapped().contains(&memory), "{said}");
        drop(camera); // killed
        while viewer.of.matched_writers(reader) != Some(0) {
            viewer.round(&[reader]);
        }
        viewer.round(&[reader]);
        assert!(!mapped().contains(&memory), "after camera {round}");
        let left = std::fs::read_dir("/dev/shm").unwrap().flatten();
        let mut left = left.filter(|file| file.file_name().to_string_lossy().contains("samples"));
        assert!(left.next().is_none(), "nothing is left in /dev/shm");
    }
}

/// A viewer is killed while it sees images, and a second one is started. The camera goes on.
#[test]
fn a_killed_viewer_holds_nothing_up() {
    let _dog = watchdog("a killed viewer", Duration::from_secs(240));
    let domain = domain();
    let ctx = Context::new(Rtps::open(&config(domain)).unwrap());
    let node = ctx.node("camera").unwrap();
    let topic = Topic::named(TOPIC).max_size(SIZE);
    let out = node
        .publisher::<replenish_interfaces::sensor_msgs::msg::Image>(topic, RELIABLE)
        .unwrap();
    let running = executor(&ctx).0.start().unwrap();
    let mut sent = 0;
    let mut send = || {
        let data = pixels(sent);
        let image = ImageView {
            height: sent,
            data: &data,
            ..ImageView::default()
        };
        sent += u32::from(out.publish_view(&image).is_ok());
        std::thread::sleep(Duration::from_millis(5));
        sent
    };
    for _ in 0..3 {
        let mut viewer = process("a_viewer", domain);
        assert!(eventually(|| out.subscriptions() == Some(1)));
        let from = send();
        while send() < from + 30 {}
        let line = viewer.expect_line("image ", LIMIT);
        let (_, line) = line.split_once("image ").unwrap();
        let first: u32 = line.trim_end_matches('.').parse().unwrap();
        for next in first + 1..first + 10 {
            viewer.expect_line(&format!("image {next}."), LIMIT);
        }
        drop(viewer); // killed
        assert!(eventually(|| out.subscriptions() == Some(0)));
    }
    drop(running.stop());
}

/// The camera is in another space of processes, as in a container: its memory cannot be found, and
/// its images come in datagrams.
#[test]
fn a_viewer_that_cannot_open_the_memory_gets_datagrams() {
    let _dog = watchdog("a camera in another space", Duration::from_secs(240));
    let wrapper = ["unshare", "--pid", "--fork", "--kill-child"];
    let able = Command::new(wrapper[0])
        .args(&wrapper[1..])
        .arg("true")
        .status();
    if !able.is_ok_and(|status| status.success()) {
        eprintln!("skipped: unshare(1) is not permitted here");
        return;
    }
    let domain = domain();
    let mut viewer = Hand::new(&config(domain));
    let reader = viewer
        .of
        .create_reader(&spec(TOPIC, RELIABLE, SIZE))
        .unwrap();
    let _camera = process_under(&wrapper, "a_camera", domain);
    see(&mut viewer, reader, 0);
    let stats = viewer.of.stats();
    assert_eq!((stats.shared, viewer.of.lost(reader)), (0, 0));
    assert!(stats.received > 16 * u64::from(IMAGES));
}

/// Switched off at either end, samples come in datagrams.
#[test]
fn memory_is_not_shared_if_either_end_says_so() {
    let _dog = watchdog("memory that is not shared", Duration::from_secs(120));
    for (ours, theirs, shared) in [(true, true, 1), (false, true, 0), (true, false, 0)] {
        let domain = domain();
        let with = |shared_memory| RtpsConfig {
            shared_memory,
            ..config(domain)
        };
        let (mut viewer, mut camera) = (Hand::new(&with(ours)), Hand::new(&with(theirs)));
        let latched = Qos::reliable().keep_last(1).transient_local();
        let writer = camera
            .of
            .create_writer(&spec(TOPIC, latched, SIZE))
            .unwrap();
        publish(&mut camera, writer, 7);
        let reader = viewer
            .of
            .create_reader(&spec(TOPIC, latched, SIZE))
            .unwrap();
        while viewer.has(reader) == 0 {
            camera.round(&[]);
            viewer.round(&[reader]);
        }
        assert_eq!(number(&viewer.heard[0].1), 7);
        // The late image may be on its way in fragments before the memory is open.
        viewer.heard.clear();
        for _ in 0..20 {
            camera.round(&[]);
            viewer.round(&[reader]);
        }
        let before = viewer.of.stats().shared;
        publish(&mut camera, writer, 8);
        while viewer.has(reader) == 0 {
            camera.round(&[]);
            viewer.round(&[reader]);
        }
        assert_eq!(number(&viewer.heard[0].1), 8);
        assert_eq!(viewer.of.stats().shared - before, shared);
    }
}

/// A publisher takes memory for its depth and two samples more, and of long ones not over 64 MB.
#[test]
fn the_memory_of_a_publisher_is_bounded() {
    let camera = Hand::new(&config(domain()));
    let page = 4096_usize;
    for (size, depth, slots) in [(3_000_001, 50, 22), (17_777, 7, 9), (20_001, 1, 3)] {
        let qos = Qos::reliable().keep_last(depth);
        let writer = camera.of.create_writer(&spec(TOPIC, qos, size)).unwrap();
        // The encapsulation, and the padding of a sample.
        let bytes = page + slots * (size + 7).next_multiple_of(page);
        let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
        let memories = maps
            .lines()
            .filter(|line| line.contains("memfd:replenish-samples"));
        let mut sizes = memories.map(|line| {
            let (range, _) = line.split_once(' ').unwrap();
            let (from, to) = range.split_once('-').unwrap();
            let address = |hex| usize::from_str_radix(hex, 16).unwrap();
            address(to) - address(from)
        });
        assert!(sizes.any(|size| size == bytes), "{bytes} of\n{maps}");
        camera.of.delete_writer(writer);
    }
}

/// Three latched images for a viewer that comes late, best effort and reliable ones besides; the
/// memory is that of one publisher in this process.
#[test]
fn late_and_best_effort_viewers_fetch_images_too() {
    let _dog = watchdog("late viewers", Duration::from_secs(120));
    let config = config(domain());
    let (mut viewer, mut camera) = (Hand::new(&config), Hand::new(&config));
    let latched = Qos::reliable().keep_last(3).transient_local();
    let writer = camera
        .of
        .create_writer(&spec(TOPIC, latched, SIZE))
        .unwrap();
    (0..9).for_each(|number| publish(&mut camera, writer, number));
    let late = viewer
        .of
        .create_reader(&spec(TOPIC, latched, SIZE))
        .unwrap();
    let effort = Qos::best_effort().keep_last(5);
    let effort = viewer.of.create_reader(&spec(TOPIC, effort, SIZE)).unwrap();
    let readers = [late, effort];
    while viewer.has(late) < 3 {
        camera.round(&[]);
        viewer.round(&readers);
    }
    let numbers = |viewer: &Hand, of: ReaderId| -> Vec<u32> {
        let of = viewer.heard.iter().filter(|(reader, _)| *reader == of);
        of.map(|(_, bytes)| number(bytes)).collect()
    };
    assert_eq!(numbers(&viewer, late), [6, 7, 8]);
    // Until both are matched, and the camera has heard that both fetch: each has this image, and
    // none from before.
    loop {
        viewer.heard.clear();
        let before = viewer.of.stats().shared;
        publish(&mut camera, writer, 9);
        for _ in 0..50 {
            camera.round(&[]);
            viewer.round(&readers);
        }
        let one_each = readers.iter().all(|reader| viewer.has(*reader) == 1);
        if one_each && viewer.of.stats().shared == before + 2 {
            break;
        }
    }
    viewer.heard.clear();
    let before = viewer.of.stats().shared;
    for number in 10..20 {
        publish(&mut camera, writer, number);
        let lack = |viewer: &Hand, reader: &ReaderId| viewer.has(*reader) < number as usize - 9;
        while readers.iter().any(|reader| lack(&viewer, reader)) {
            camera.round(&[]);
            viewer.round(&readers);
        }
    }
    let expected: Vec<u32> = (10..20).collect();
    assert_eq!(numbers(&viewer, late), expected);
    assert_eq!(numbers(&viewer, effort), expected);
    assert_eq!(viewer.of.stats().shared - before, 20);
}
