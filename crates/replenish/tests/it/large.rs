//! Samples of a megabyte and more: in one process, and between participants of ROS 2,
//! and through an agent.

use crate::common::agent::TestAgent;
use crate::common::{eventually, executor};
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::middleware::xrce::{Xrce, XrceConfig};
use replenish::middleware::{
    EndpointSpec, InProcessBus, Interest, Middleware, ReaderId, Room, WriterId,
};
use replenish::{Budget, Context, IngressLimit, Node, PublishError, Publisher, Qos, Topic};
use replenish_agent::{AgentConfig, DdsBridge, Limits};
use replenish_interfaces::sensor_msgs::msg::{Image, ImageView};
use replenish_testkit::domain::domain;
use replenish_testkit::watchdog::watchdog;
use std::sync::{Arc, Mutex};
use std::time::Duration;

pub(crate) const MEGABYTE: usize = 1_000_000;
/// A sample of a megabyte of pixels.
pub(crate) const SIZE: usize = MEGABYTE + 100;

/// Pixels that tell the number of their image at every place.
pub(crate) fn pixels(number: u32) -> Vec<u8> {
    let mut state = number.wrapping_mul(2_654_435_761) | 1;
    let words = std::iter::repeat_with(|| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        state.to_le_bytes()
    });
    words.take(MEGABYTE / 4).flatten().collect()
}

/// Sends an image; `false` if there is no room for it now.
fn send(out: &Publisher<Image>, number: u32, data: &[u8]) -> bool {
    let image = ImageView {
        height: number,
        encoding: "mono8",
        data,
        ..ImageView::default()
    };
    match out.publish_view(&image) {
        Err(PublishError::Full) => false,
        sent => {
            sent.unwrap();
            true
        }
    }
}

type Heard = Arc<Mutex<Vec<u32>>>;

/// A callback that notes the number of each image whose bytes are right.
fn note(heard: &Heard) -> impl FnMut(&ImageView<'_>, &replenish::CallbackContext<'_>) + use<> {
    let heard = Arc::clone(heard);
    move |image, _| {
        assert!(image.data == pixels(image.height), "image {}", image.height);
        heard.lock().unwrap().push(image.height);
    }
}

/// Three workers each get 20 images of a megabyte, in order, and send them back to a fourth.
#[test]
fn a_megabyte_reaches_three_workers_in_one_process_and_comes_back() {
    const IMAGES: u32 = 20;
    let _dog = watchdog("a megabyte in one process", Duration::from_secs(120));
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let there = Topic::named("there").max_size(SIZE);
    let qos = Qos::reliable().keep_all(3);
    let out = node.publisher::<Image>(there, qos).unwrap();
    let (mut exec, log) = executor(&ctx);
    let [a, b, c, back]: [Heard; 4] = Default::default();
    let names = ["back0", "back1", "back2"];
    for (name, heard) in names.into_iter().zip([&a, &b, &c]) {
        let topic = Topic::named(name).max_size(SIZE);
        let answer = node.publisher::<Image>(topic, qos).unwrap();
        let mut note = note(heard);
        exec.worker(name)
            .subscribe_view::<Image, _, _>(&node, there, qos, move |image, cx| {
                note(image, cx);
                while answer.publish_view(image) == Err(PublishError::Full) {
                    std::thread::sleep(Duration::from_micros(200));
                }
            })
            .unwrap();
    }
    let mut worker = exec.worker("back");
    for name in names {
        let topic = Topic::named(name).max_size(SIZE);
        let note = note(&back);
        worker = worker
            .subscribe_view::<Image, _, _>(&node, topic, qos, note)
            .unwrap();
    }
    let running = exec.start().unwrap();
    for number in 0..IMAGES {
        let data = pixels(number);
        assert!(eventually(|| {
            let (sent, room) = (send(&out, number, &data), a.lock().unwrap().len());
            // Each reader with room has got the image: a second one is not sent for the others.
            sent || panic!("no room for image {number} with {room} taken")
        }));
        let all = |heard: &Heard| heard.lock().unwrap().len() > number as usize;
        assert!(eventually(|| [&a, &b, &c].into_iter().all(all)));
    }
    assert!(
        eventually(|| back.lock().unwrap().len() == 3 * IMAGES as usize),
        "{:?}",
        log.lines()
    );
    for heard in [a, b, c] {
        assert_eq!(*heard.lock().unwrap(), (0..IMAGES).collect::<Vec<_>>());
    }
    let report = running.stop();
    let line = "memory: 10.0 MB for samples of /n/sub:/there";
    assert!(report.to_string().contains(line), "{report}");
    let memory = report.handle("/n/sub:/there").unwrap().memory;
    assert_eq!(
        memory,
        2 * (3 + 2) * SIZE,
        "inbox and bus, with two in hand each"
    );
}

/// A late reader gets the long samples that the writer has kept; one too short learns of it.
#[test]
fn long_samples_are_kept_for_late_readers_and_refused_by_short_ones() {
    let bus = InProcessBus::new();
    let (ours, theirs) = (bus.participant(), bus.participant());
    let latched = Qos::reliable().keep_last(2).transient_local();
    let short = ours.create_reader(&spec("/t", latched, 4)).unwrap();
    let writer = theirs.create_writer(&spec("/t", latched, SIZE)).unwrap();
    for number in 0..6 {
        theirs.publish(writer, &pixels(number)).unwrap();
    }
    let late = ours.create_reader(&spec("/t", latched, SIZE)).unwrap();
    let mut heard = Vec::new();
    let mut interest = Interest::empty();
    interest.insert(short);
    interest.insert(late);
    ours.take(&mut interest, &mut |reader, _, bytes| {
        heard.push((reader, bytes == pixels(4), bytes == pixels(5)));
        Room::Left
    })
    .unwrap();
    assert_eq!(heard, [(late, true, false), (late, false, true)]);
    assert_eq!(ours.next_oversize(), Some((short, MEGABYTE)));
}

pub(crate) fn spec(topic: &str, qos: Qos, max_size: usize) -> EndpointSpec<'_> {
    EndpointSpec {
        node: "/n",
        topic,
        type_name: "sensor_msgs/msg/Image",
        dds_type_name: "sensor_msgs::msg::dds_::Image_",
        type_hash: None,
        qos,
        max_size,
        ingress: IngressLimit::none(),
        keep_oldest: false,
    }
}

/// A domain for each test: tests run side by side.
fn config() -> RtpsConfig {
    RtpsConfig {
        domain: domain(),
        range: DiscoveryRange::Localhost,
        interfaces: vec![std::net::Ipv4Addr::LOCALHOST],
        ..RtpsConfig::default()
    }
}

fn node(config: &RtpsConfig, name: &str) -> Node {
    let ctx = Context::new(Rtps::open(config).unwrap());
    ctx.node(&format!("p{}/{name}", std::process::id()))
        .unwrap()
}

/// A hundred images of a megabyte, reliable, through a worker with a budget: all, in order, with
/// their bytes.
#[test]
fn a_hundred_megabytes_pass_between_participants_in_order() {
    let _dog = watchdog("two hundred megabytes", Duration::from_secs(300));
    for shared_memory in [false, true] {
        a_hundred_megabytes(&RtpsConfig {
            shared_memory,
            ..config()
        });
    }
}

fn a_hundred_megabytes(config: &RtpsConfig) {
    const IMAGES: u32 = 100;
    let (camera, viewer) = (node(config, "camera"), node(config, "viewer"));
    let topic = Topic::named("image").max_size(SIZE);
    let qos = Qos::reliable().keep_all(3);
    let out = camera.publisher::<Image>(topic, qos).unwrap();
    let heard = Heard::default();
    let (mut exec, _) = executor(viewer.context());
    let budget = Budget::of(Duration::from_millis(80)).every(Duration::from_millis(100));
    exec.worker("viewer")
        .budget(budget)
        .subscribe_view::<Image, _, _>(&viewer, topic, qos, note(&heard))
        .unwrap();
    let viewer = exec.start().unwrap();
    let camera = executor(camera.context()).0.start().unwrap();
    // Volatile: what is sent before they know each other is delivered to none.
    let first = pixels(IMAGES);
    assert!(eventually(|| {
        send(&out, IMAGES, &first);
        std::thread::sleep(Duration::from_millis(50));
        !heard.lock().unwrap().is_empty()
    }));
    for number in 0..IMAGES {
        let data = pixels(number);
        assert!(eventually(|| send(&out, number, &data)), "image {number}");
    }
    let done = || heard.lock().unwrap().last() == Some(&(IMAGES - 1));
    assert!(eventually(done), "{:?}", heard.lock().unwrap());
    let all = heard.lock().unwrap().clone();
    let numbers: Vec<u32> = all.into_iter().skip_while(|n| *n == IMAGES).collect();
    assert_eq!(numbers, (0..IMAGES).collect::<Vec<_>>());
    drop((camera.stop(), viewer.stop()));
}

/// A client of the agent sends back images of a megabyte that a participant of ROS 2 publishes.
#[test]
fn a_megabyte_crosses_the_agent_s_bridge_both_ways() {
    const IMAGES: u32 = 10;
    let _dog = watchdog("a megabyte over the bridge", Duration::from_secs(120));
    let config = config();
    let mut bridge = DdsBridge {
        domain: config.domain,
        ..DdsBridge::default()
    };
    bridge.dds.limits.sample = SIZE;
    let agent = TestAgent::with(&AgentConfig {
        addr: "127.0.0.1:0".parse().unwrap(),
        limits: Limits {
            sample: SIZE,
            client_bytes: 64 << 20,
            ..Limits::DEFAULT
        },
        dds: Some(bridge),
        ..AgentConfig::default()
    });
    let [there, back] = ["there", "back"].map(|name| Topic::named(name).max_size(SIZE));
    let qos = Qos::reliable().keep_all(3);
    let small = XrceConfig {
        mtu: 8192,
        max_sample: SIZE,
        ..XrceConfig::default()
    };
    let client = Context::new(Xrce::udp_with(&agent.address.to_string(), small).unwrap());
    let echo = client.node("echo").unwrap();
    let answer = echo.publisher::<Image>(back, qos).unwrap();
    let (mut exec, _) = executor(&client);
    exec.worker("echo")
        .subscribe_view::<Image, _, _>(&echo, there, qos, move |image, _| {
            while answer.publish_view(image) == Err(PublishError::Full) {
                std::thread::sleep(Duration::from_millis(1));
            }
        })
        .unwrap();
    let echo = exec.start().unwrap();
    let camera = Context::new(Rtps::open(&config).unwrap());
    let camera = camera.node("camera").unwrap();
    let (out, heard) = (
        camera.publisher::<Image>(there, qos).unwrap(),
        Heard::default(),
    );
    let (mut exec, _) = executor(camera.context());
    exec.worker("back")
        .subscribe_view::<Image, _, _>(&camera, back, qos, note(&heard))
        .unwrap();
    let camera = exec.start().unwrap();
    let first = pixels(IMAGES);
    assert!(eventually(|| {
        send(&out, IMAGES, &first);
        std::thread::sleep(Duration::from_millis(100));
        !heard.lock().unwrap().is_empty()
    }));
    for number in 0..IMAGES {
        let data = pixels(number);
        assert!(eventually(|| send(&out, number, &data)), "image {number}");
        let came = || heard.lock().unwrap().last() == Some(&number);
        assert!(eventually(came), "{:?}", heard.lock().unwrap());
    }
    drop((camera.stop(), echo.stop()));
}

/// Forty megabytes, where they are asked for: in one process, in shared memory, in fragments.
#[test]
fn a_map_of_forty_megabytes_passes_where_it_is_asked_for() {
    const BYTES: usize = 40 * MEGABYTE;
    let map = |number: u32| pixels(number).repeat(40);
    let spec = spec("/map", Qos::reliable().keep_last(1), BYTES);
    let bus = InProcessBus::new();
    let (ours, theirs) = (bus.participant(), bus.participant());
    let (reader, writer) = (
        ours.create_reader(&spec).unwrap(),
        theirs.create_writer(&spec).unwrap(),
    );
    theirs.publish(writer, &map(1)).unwrap();
    let mut interest = Interest::empty();
    interest.insert(reader);
    let mut heard = None;
    ours.take(&mut interest, &mut |_, _, bytes| {
        heard = Some(bytes == map(1));
        Room::Left
    })
    .unwrap();
    assert_eq!(heard, Some(true));
    for shared_memory in [false, true] {
        let config = RtpsConfig {
            shared_memory,
            ..config()
        };
        let (mut ours, mut theirs) = (Hand::new(&config), Hand::new(&config));
        let reader = ours.of.create_reader(&spec).unwrap();
        let writer = theirs.of.create_writer(&spec).unwrap();
        while ours.has(reader) == 0 {
            theirs.of.publish(writer, &[0; 4]).unwrap();
            theirs.round(&[]);
            ours.round(&[reader]);
        }
        theirs.of.publish(writer, &map(2)).unwrap();
        while ours
            .heard
            .last()
            .is_none_or(|(_, bytes)| bytes.len() < BYTES)
        {
            theirs.round(&[]);
            ours.round(&[reader]);
        }
        assert!(ours.heard.last().is_some_and(|(_, bytes)| *bytes == map(2)));
    }
}

/// A participant that is driven by hand.
pub(crate) struct Hand {
    pub(crate) of: Rtps,
    pub(crate) heard: Vec<(ReaderId, Vec<u8>)>,
}

impl Hand {
    pub(crate) fn new(config: &RtpsConfig) -> Self {
        let of = Rtps::open(config).unwrap();
        Self {
            of,
            heard: Vec::new(),
        }
    }

    /// A round: receives for `readers`, sends what is due.
    pub(crate) fn round(&mut self, readers: &[ReaderId]) {
        let mut interest = Interest::empty();
        readers.iter().for_each(|reader| interest.insert(*reader));
        let deadline = replenish_os::clock::monotonic() + 2_000_000;
        self.of.wait(&interest, Some(deadline)).unwrap();
        let heard = &mut self.heard;
        self.of
            .take(&mut interest, &mut |reader, _, bytes| {
                heard.push((reader, bytes.to_vec()));
                Room::Left
            })
            .unwrap();
    }

    pub(crate) fn has(&self, reader: ReaderId) -> usize {
        self.heard.iter().filter(|(of, _)| *of == reader).count()
    }
}

/// A long sample leaves in bursts, on one host of at most a megabyte. A short sample of another
/// publisher goes out between two of them, each time, and is there before the long one is.
#[test]
fn a_control_message_overtakes_a_camera() {
    let _dog = watchdog("camera and control", Duration::from_secs(120));
    let config = RtpsConfig {
        shared_memory: false,
        ..config()
    };
    let (mut ours, mut theirs) = (Hand::new(&config), Hand::new(&config));
    let names = ["camera", "control"].map(|name| format!("/p{}/{name}", std::process::id()));
    let qos = Qos::reliable().keep_last(1);
    let sizes = [16 << 20, 4];
    let readers: [ReaderId; 2] = [0, 1].map(|at| {
        let qos = if at == 0 {
            qos
        } else {
            Qos::reliable().keep_last(100)
        };
        ours.of
            .create_reader(&spec(&names[at], qos, sizes[at]))
            .unwrap()
    });
    let [camera, control]: [WriterId; 2] = [0, 1].map(|at| {
        theirs
            .of
            .create_writer(&spec(&names[at], qos, sizes[at]))
            .unwrap()
    });
    // Until both topics are heard, and nothing more is on its way.
    while readers.iter().any(|reader| ours.has(*reader) == 0) {
        theirs.of.publish(camera, &[0; 4]).unwrap();
        theirs.of.publish(control, &[0; 4]).unwrap();
        theirs.round(&[]);
        ours.round(&readers);
    }
    for _ in 0..50 {
        theirs.round(&[]);
        ours.round(&readers);
    }
    ours.heard.clear();
    let data = pixels(7).repeat(sizes[0] / SIZE);
    theirs.of.publish(camera, &data).unwrap();
    let mut sent = 0_usize;
    while ours.has(readers[0]) == 0 {
        // Its datagram is sent by this call, whatever the camera has left.
        sent += 1;
        let number = u32::try_from(sent).unwrap();
        theirs.of.publish(control, &number.to_le_bytes()).unwrap();
        for _ in 0..100 {
            if ours.has(readers[1]) >= sent || ours.has(readers[0]) > 0 {
                break;
            }
            ours.round(&readers);
        }
        theirs.round(&[]);
    }
    let (_, image) = ours.heard.iter().find(|(of, _)| *of == readers[0]).unwrap();
    assert!(*image == data, "byte by byte");
    let first = ours.heard.iter().position(|(of, _)| *of == readers[0]);
    let before = first.unwrap();
    assert!(
        before >= 10,
        "{before} control messages came before the image, of {sent}"
    );
    let numbers = ours.heard[..before].iter().map(|(_, bytes)| bytes.clone());
    let expected = (1_u32..).map(|number| number.to_le_bytes().to_vec());
    assert!(numbers.eq(expected.take(before)), "in order, none twice");
}

/// A depth that needs more memory than an endpoint may take is refused with the range.
#[test]
fn too_many_large_samples_are_refused_with_the_range() {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let topic = Topic::named("map").max_size(16 << 20);
    let error = node.publisher::<Image>(topic, Qos::reliable().keep_last(65));
    assert_eq!(
        error.unwrap_err().to_string(),
        "topic /map: qos.depth = 65 is not allowed: 1..=64 samples of 16777216 bytes, 1 GiB"
    );
    let error = node.publisher::<Image>(topic.keep_oldest(), Qos::reliable());
    assert_eq!(
        error.unwrap_err().to_string(),
        "topic /map: keep_oldest, ingress_limit = set is not allowed: of a subscription only"
    );
}

/// There are as many buffers as a writer keeps samples, and one more. Each sample is encoded in
/// that of the oldest.
#[test]
fn samples_are_encoded_where_their_writer_keeps_them() {
    const DEPTH: u16 = 4;
    let rtps = Rtps::open(&config()).unwrap();
    let buffers = usize::from(DEPTH) + 1;
    for (name, size) in [("/short", 100), ("/long", SIZE)] {
        let qos = Qos::reliable().keep_last(DEPTH);
        let writer = rtps.create_writer(&spec(name, qos, size)).unwrap();
        let mut places = Vec::new();
        for _ in 0..2 * buffers {
            let sent = rtps.publish_with(writer, &mut |room| {
                assert_eq!(room.len(), size);
                room.fill(7);
                places.push(room.as_ptr());
                Some(size)
            });
            assert_eq!(sent, Some(Ok(())));
        }
        let (first, again) = places.split_at(buffers);
        assert_eq!(first, again);
        let mut distinct = first.to_vec();
        distinct.sort_unstable();
        distinct.dedup();
        assert_eq!(distinct.len(), buffers);
        // Where nothing is encoded nothing is sent, and the next sample has the same buffer.
        let nothing = rtps.publish_with(writer, &mut |_| None);
        assert_eq!(nothing, Some(Ok(())));
        rtps.publish_with(writer, &mut |room| {
            assert_eq!(room.as_ptr(), first[0]);
            Some(0)
        });
    }
    let bus = InProcessBus::new().participant();
    let writer = bus.create_writer(&spec("/short", Qos::reliable(), 100));
    assert_eq!(bus.publish_with(writer.unwrap(), &mut |_| Some(0)), None);
}
