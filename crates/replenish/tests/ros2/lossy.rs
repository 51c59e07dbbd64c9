//! Reliable samples of both directions arrive once and in order over a link that loses, doubles and
//! reorders datagrams. `lossy_link.py` is the link, between this program's child and the peer.

use crate::large::is_right;
use crate::peer::{Foreign, Peer};
use crate::support::{budget, executor};
use crate::{dds, presence, services};
use replenish::msg::std_msgs::Int32;
use replenish::{Budget, Context, Executor, Node, Qos, Topic};
use replenish_agent::dds::Interfaces;
use replenish_agent::{Agent, AgentConfig, DdsBridge, StopHandle};
use replenish_interfaces::sensor_msgs::msg::{Image, ImageView};
use std::process::Command;
use std::sync::mpsc::channel;
use std::time::Duration;

/// The variable by which this program runs as the node at our end: the mode and the count.
const CHILD: &str = "REPLENISH_ROS2_LOSSY_CHILD";
/// Images of a megabyte that go through the link; the variable asks for more.
const IMAGES: (&str, usize) = ("REPLENISH_LOSSY_IMAGES", 5);
const NUMBERS: usize = 300;
/// One after another: a lost one waits for the peer's next heartbeat, 3 s in Fast DDS.
const REQUESTS: usize = 4;
const MOVES: usize = 4;
const APART: &str = "REPLENISH_SHARED_MEMORY=0";
const LINK: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/ros2/lossy_link.py");

/// The link's kind, as in `lossy_link.py`, and the datagrams of a hundred that it loses.
#[derive(Clone, Copy)]
pub(crate) struct Link(pub(crate) &'static str, pub(crate) u32);

/// The reason why this machine has no such link.
pub(crate) fn missing() -> Option<String> {
    let probe = Command::new("python3").arg(LINK).output();
    let why = match probe {
        Ok(probe) if probe.status.success() => return None,
        Ok(probe) => String::from_utf8_lossy(&probe.stderr).trim().to_string(),
        Err(error) => format!("python3: {error}"),
    };
    Some(format!("{why}: a link between namespaces needs root"))
}

/// Numbers there and back, each way.
pub(crate) fn numbers(foreign: Foreign, link: Link) {
    let said = through_link(foreign, link, "topics", NUMBERS);
    assert_eq!(said, format!("reliable {NUMBERS} True"));
}

/// The same with a client of an agent, whose bridge is at our end.
pub(crate) fn numbers_through_a_bridge(foreign: Foreign, link: Link) {
    let command = link_to(link, "bridged", NUMBERS);
    let peer = Peer::start_behind(command, foreign, &["topics", &NUMBERS.to_string()]);
    let line = || peer.line_within(Duration::from_secs(90));
    assert_eq!(line(), Some(format!("ours {NUMBERS} in order")));
    assert_eq!(line(), Some(format!("reliable {NUMBERS} True")));
}

/// Requests to a service of ours, each answered once.
pub(crate) fn requests(foreign: Foreign, link: Link) {
    let said = through_link(foreign, link, "client", REQUESTS);
    assert_eq!(said, format!("answered {REQUESTS}"));
}

/// Rounds of pings and of numbers, between which our end gets another address: endpoints that the
/// peer makes after that are found.
pub(crate) fn moves(foreign: Foreign) {
    let command = link_to(Link("moving", 0), "moves", MOVES);
    let peer = Peer::start_behind(command, foreign, &["moves", &MOVES.to_string()]);
    let line = || peer.line_within(Duration::from_secs(90));
    for number in 1..=MOVES {
        assert_eq!(line(), Some(format!("answered {number}")));
        println!("{}: {}", foreign.name(), line().expect("the link's line"));
    }
}

/// Images of a megabyte there and back in fragments.
pub(crate) fn images(foreign: Foreign, link: Link) {
    let count = std::env::var(IMAGES.0).map_or(IMAGES.1, |text| text.parse().unwrap());
    let said = through_link(foreign, link, "images", count);
    assert_eq!(said, format!("images {count} of {count}"));
}

/// The same with a program of ours at both ends, as on two hosts: without shared memory.
pub(crate) fn images_of_our_own(link: Link) {
    let count = IMAGES.1;
    let mut command = link_to(link, "images", count);
    command.args(["--", "/usr/bin/env", APART]);
    command.arg(format!("{CHILD}=send_images {count}"));
    let peer = Peer::start_command(command.arg(std::env::current_exe().unwrap()));
    let limit = Duration::from_secs(90);
    let line = || peer.line_within(limit).expect("another line");
    assert_eq!(line(), format!("ours {count} in order"));
    assert_eq!(line(), format!("images {count} of {count}"));
    println!("ours, {}: {}", link.0, line());
}

/// The link, and the program at our end.
fn link_to(Link(kind, loss): Link, ours: &str, count: usize) -> Command {
    let mut command = Command::new("python3");
    command.args([
        LINK,
        kind,
        &seed(),
        &loss.to_string(),
        "/usr/bin/env",
        APART,
    ]);
    command.arg(format!("{CHILD}={ours} {count}"));
    command.arg(std::env::current_exe().unwrap());
    command
}

fn seed() -> String {
    std::env::var("REPLENISH_LOSSY_SEED").unwrap_or_else(|_| "1".to_string())
}

/// Last words of the peer, after our end has heard everything once and in order.
fn through_link(foreign: Foreign, link: Link, mode: &str, count: usize) -> String {
    // It asks a service of ours, and says what came back.
    let asks = mode == "client";
    let bare = asks && Foreign::DDS.contains(&foreign);
    let command = link_to(link, if bare { "adder" } else { mode }, count);
    let peer = Peer::start_behind(command, foreign, &[mode, &count.to_string()]);
    let limit = Duration::from_secs(90 + 5 * u64::try_from(count).unwrap());
    let line = || peer.line_within(limit).expect("another line");
    if !asks {
        assert_eq!(line(), format!("ours {count} in order"));
    }
    let said = line();
    let (name, Link(kind, loss)) = (foreign.name(), link);
    println!("{name}, {kind}, {loss} % loss, seed {}: {said}", seed());
    println!("{name}: {}", line());
    said
}

/// The node at our end, if this process is to be it.
pub(crate) fn child() {
    let Ok(task) = std::env::var(CHILD) else {
        return;
    };
    let (mode, count) = task.split_once(' ').unwrap();
    let count = count.parse().unwrap();
    let ctx = if mode == "bridged" {
        bridged()
    } else {
        Context::ros2().unwrap()
    };
    let node = ctx.node("/peer/ours").unwrap();
    let mut exec = executor(&node);
    match mode {
        "topics" | "bridged" => serve_numbers(&node, &mut exec, count),
        "client" => services::serve(&node, &mut exec),
        "adder" => dds::serve(&node, &mut exec),
        "moves" => presence::serve(&node, &mut exec),
        "send_images" => return send_images(&node, exec, count),
        _ => serve_images(&node, &mut exec, count),
    }
    exec.spin().unwrap();
    std::process::exit(0);
}

/// Through an agent's bridge on all interfaces.
fn bridged() -> Context {
    let mut bridge = DdsBridge::default();
    bridge.dds.interfaces = Interfaces::All;
    let config = AgentConfig {
        addr: "127.0.0.1:0".parse().unwrap(),
        dds: Some(bridge),
        ..AgentConfig::default()
    };
    let mut agent = Agent::bind(&config).unwrap();
    let address = agent.local_addr().to_string();
    std::thread::spawn(move || agent.run(&StopHandle::new()).unwrap());
    Context::xrce_udp(&address).unwrap()
}

fn serve_numbers(node: &Node, exec: &mut Executor, count: usize) {
    let qos = Qos::reliable().keep_last(500);
    let back = node.publisher::<Int32>("reliable_from_ours", qos).unwrap();
    let mut order = Order::new(count);
    exec.worker("numbers")
        .budget(budget())
        .subscribe(node, "reliable_to_ours", qos, move |m: &Int32, _| {
            order.next(usize::try_from(m.data).unwrap());
            back.publish(m)
        })
        .unwrap();
}

fn serve_images(node: &Node, exec: &mut Executor, count: usize) {
    let topic = |name| Topic::named(name).max_size(1_000_100);
    let qos = Qos::reliable().keep_last(3);
    let back = node
        .publisher::<Image>(topic("image_from_ours"), qos)
        .unwrap();
    let mut order = Order::new(count);
    exec.worker("images")
        .budget(Budget::of(Duration::from_millis(60)).every(Duration::from_millis(100)))
        .subscribe_view::<Image, _, _>(node, topic("image_to_ours"), qos, move |image, _| {
            order.next(usize::try_from(image.height).unwrap());
            back.publish_view(image)
        })
        .unwrap();
}

/// Sends an image when the one before it has come back.
fn send_images(node: &Node, mut exec: Executor, count: usize) {
    let topic = |name| Topic::named(name).max_size(1_000_100);
    let qos = Qos::reliable().keep_last(3);
    let out = node
        .publisher::<Image>(topic("image_to_ours"), qos)
        .unwrap();
    let (send, heard) = channel();
    exec.worker("back")
        .subscribe_view::<Image, _, _>(node, topic("image_from_ours"), qos, move |image, _| {
            send.send((image.height, is_right(image))).unwrap();
        })
        .unwrap();
    let running = exec.start().unwrap();
    let publish = |height| {
        let places = (0..10_000).map(|place| ((height * 31 + place) % 251) as u8);
        let data = places.collect::<Vec<_>>().repeat(100);
        let image = ImageView {
            height,
            data: &data,
            ..ImageView::default()
        };
        out.publish_view(&image).unwrap();
    };
    // Both ends know each other once something has come back; then until nothing more comes.
    publish(0);
    while heard.recv_timeout(Duration::from_secs(1)).is_err() {
        publish(0);
    }
    while heard.recv_timeout(Duration::from_secs(1)).is_ok() {}
    let mut right = 0;
    for number in 1..=u32::try_from(count).unwrap() {
        publish(number);
        // One of the first images may be that late.
        let back = heard.iter().find(|(height, _)| *height != 0);
        right += usize::from(back == Some((number, true)));
    }
    println!("images {right} of {count}");
    std::thread::sleep(Duration::from_secs(5)); // what is still under way is acknowledged
    drop(running.stop());
}

/// Samples are numbered from 1 on, after some with 0 by which both ends got to know each other.
struct Order {
    last: usize,
    count: usize,
}

impl Order {
    const fn new(count: usize) -> Self {
        Self { last: 0, count }
    }

    fn next(&mut self, number: usize) {
        if number == 0 && self.last == 0 {
            return;
        }
        if number != self.last + 1 {
            println!("ours had {number} after {}", self.last);
        }
        self.last = number;
        if number == self.count {
            println!("ours {number} in order");
        }
    }
}
