//! CTF 1.8 with the names of ROS 2's tracepoints: babeltrace2, `tracetools_analysis` and Trace
//! Compass read it as they read one of `LTTng`.
//!
//! ```text
//!   metadata ── the layout, in words       thread-N ── one packet for each thread:
//!                                          header │ context │ events, by time
//! ```
//!
//! A handle has one number, from which the pointers of its node, subscription and callback are
//! made. The events that introduce them come first, in the dispatcher's stream.

use replenish_recorder::{Clocks, Event, Kind, NameKind};
use std::fmt::Write;

/// A stretch of a thread's events, and what its stream says about it.
pub(super) struct Stream<'a> {
    pub(super) tid: u64,
    pub(super) name: &'a str,
    pub(super) events: &'a [Event],
}

/// A trace: its metadata, and the bytes of each stream.
pub(super) struct Ctf {
    pub(super) metadata: String,
    pub(super) streams: Vec<Vec<u8>>,
    /// Callbacks with both ends.
    pub(super) callbacks: usize,
}

/// The type of a field.
#[derive(Clone, Copy)]
enum Field {
    Pointer,
    Signed,
    Unsigned,
    Int,
    Text,
}

use Field::{Int, Pointer, Signed, Text, Unsigned};

/// A tracepoint of ROS 2: its name and its fields.
struct Point(&'static str, &'static [(&'static str, Field)]);

/// Every tracepoint that is written; its id is its place.
const POINTS: [Point; 14] = [
    Point(
        "rcl_init",
        &[("context_handle", Pointer), ("version", Text)],
    ),
    Point(
        "rcl_node_init",
        &[
            ("node_handle", Pointer),
            ("rmw_handle", Pointer),
            ("node_name", Text),
            ("namespace", Text),
        ],
    ),
    Point(
        "rcl_publisher_init",
        &[
            ("publisher_handle", Pointer),
            ("node_handle", Pointer),
            ("rmw_publisher_handle", Pointer),
            ("topic_name", Text),
            ("queue_depth", Unsigned),
        ],
    ),
    Point(
        "rcl_subscription_init",
        &[
            ("subscription_handle", Pointer),
            ("node_handle", Pointer),
            ("rmw_subscription_handle", Pointer),
            ("topic_name", Text),
            ("queue_depth", Unsigned),
        ],
    ),
    Point(
        "rclcpp_subscription_init",
        &[("subscription_handle", Pointer), ("subscription", Pointer)],
    ),
    Point(
        "rclcpp_subscription_callback_added",
        &[("subscription", Pointer), ("callback", Pointer)],
    ),
    Point(
        "rcl_timer_init",
        &[("timer_handle", Pointer), ("period", Signed)],
    ),
    Point(
        "rclcpp_timer_callback_added",
        &[("timer_handle", Pointer), ("callback", Pointer)],
    ),
    Point(
        "rclcpp_timer_link_node",
        &[("timer_handle", Pointer), ("node_handle", Pointer)],
    ),
    Point(
        "rclcpp_callback_register",
        &[("callback", Pointer), ("symbol", Text)],
    ),
    Point(
        "callback_start",
        &[("callback", Pointer), ("is_intra_process", Int)],
    ),
    Point("callback_end", &[("callback", Pointer)]),
    Point(
        "rcl_publish",
        &[("publisher_handle", Pointer), ("message", Pointer)],
    ),
    Point(
        "rmw_take",
        &[
            ("rmw_subscription_handle", Pointer),
            ("message", Pointer),
            ("source_timestamp", Signed),
            ("taken", Int),
        ],
    ),
];

/// The value of a field.
enum Value<'a> {
    Number(u64),
    Text(&'a str),
}

use Value::Number;

/// Pointers of the thing with this number: they differ in their last byte.
const fn pointer(id: u32, which: u64) -> u64 {
    0x7200_0000_0000 + ((id as u64) << 8) + which
}

const NODE: u64 = 0x10;
const RMW: u64 = 0x20;
const HANDLE: u64 = 0x30;
const OBJECT: u64 = 0x40;
const CALLBACK: u64 = 0x50;

/// The program's names by id.
type Names = [Option<(NameKind, String)>];

/// The trace of a program: its process id and clocks, its names, its threads.
pub(super) fn encode(pid: u32, clocks: Clocks, names: &Names, threads: &[Stream<'_>]) -> Ctf {
    let times = threads.iter().flat_map(|t| t.events.iter().map(|e| e.time));
    let start = times.min().unwrap_or(clocks.monotonic);
    let uuid = uuid(pid, clocks);
    let (mut streams, mut callbacks) = (Vec::new(), 0);
    for (n, thread) in threads.iter().enumerate() {
        let mut packet = Packet::new(pid, thread);
        if n == 0 {
            introduce(&mut packet, start, names);
        }
        callbacks += callbacks_of(thread.events, &mut packet);
        streams.push(packet.into_bytes(uuid, start));
    }
    Ctf {
        metadata: metadata(uuid, clocks),
        streams,
        callbacks,
    }
}

/// The events that say what the pointers are.
fn introduce(packet: &mut Packet<'_>, start: u64, names: &Names) {
    let mut say = |point, values: &[Value<'_>]| packet.event(start, point, values);
    say(
        "rcl_init",
        &[Number(pointer(0, HANDLE)), Value::Text("replenish")],
    );
    for (id, name) in (0_u32..).zip(names) {
        let Some((kind, name)) = name else { continue };
        let of = |which| Number(pointer(id, which));
        match kind {
            NameKind::Topic => say(
                "rcl_publisher_init",
                &[of(HANDLE), of(NODE), of(RMW), Value::Text(name), Number(0)],
            ),
            NameKind::Handle => {
                if let Some((node, topic)) = name.split_once("/sub:") {
                    let (space, short) = node.rsplit_once('/').unwrap_or(("", node));
                    let space = if space.is_empty() { "/" } else { space };
                    say(
                        "rcl_node_init",
                        &[of(NODE), of(RMW), Value::Text(short), Value::Text(space)],
                    );
                    say(
                        "rcl_subscription_init",
                        &[of(HANDLE), of(NODE), of(RMW), Value::Text(topic), Number(0)],
                    );
                    say("rclcpp_subscription_init", &[of(HANDLE), of(OBJECT)]);
                    say(
                        "rclcpp_subscription_callback_added",
                        &[of(OBJECT), of(CALLBACK)],
                    );
                } else if name.contains("/timer:") {
                    let (worker, _) = name.rsplit_once("/timer:").unwrap_or((name, ""));
                    say(
                        "rcl_node_init",
                        &[of(NODE), of(RMW), Value::Text(worker), Value::Text("/")],
                    );
                    say("rcl_timer_init", &[of(HANDLE), Number(0)]);
                    say("rclcpp_timer_callback_added", &[of(HANDLE), of(CALLBACK)]);
                    say("rclcpp_timer_link_node", &[of(HANDLE), of(NODE)]);
                }
                say(
                    "rclcpp_callback_register",
                    &[of(CALLBACK), Value::Text(name)],
                );
            }
            NameKind::Mark | NameKind::Chain => {}
        }
    }
}

/// Writes the events of a thread; how many callbacks have both ends. An end whose begin was
/// overwritten is left out.
fn callbacks_of(events: &[Event], packet: &mut Packet<'_>) -> usize {
    let (mut open, mut callbacks) = (None, 0);
    for (n, event) in events.iter().enumerate() {
        let of = |which| Number(pointer(event.name, which));
        let message = Number((event.time << 8) | (n as u64 & 0xff));
        match event.kind {
            Kind::Begin => {
                open = Some(event.name);
                packet.event(event.time, "callback_start", &[of(CALLBACK), Number(0)]);
            }
            Kind::End if open == Some(event.name) => {
                open = None;
                callbacks += 1;
                packet.event(event.time, "callback_end", &[of(CALLBACK)]);
            }
            Kind::Gap => open = None,
            Kind::Publish => packet.event(event.time, "rcl_publish", &[of(HANDLE), message]),
            Kind::Take => {
                packet.event(
                    event.time,
                    "rmw_take",
                    &[of(RMW), message, Number(0), Number(1)],
                );
            }
            _ => {}
        }
    }
    callbacks
}

/// The one packet of a stream.
struct Packet<'a> {
    pid: u32,
    thread: &'a Stream<'a>,
    events: Vec<u8>,
    /// Events are in the order of time; one that is not counts as of the time before it.
    last: u64,
}

impl<'a> Packet<'a> {
    const fn new(pid: u32, thread: &'a Stream<'a>) -> Self {
        Self {
            pid,
            thread,
            events: Vec::new(),
            last: 0,
        }
    }

    fn event(&mut self, time: u64, point: &str, values: &[Value<'_>]) {
        let Some(id) = POINTS.iter().position(|p| p.0 == point) else {
            return;
        };
        self.last = self.last.max(time);
        let out = &mut self.events;
        out.extend(u16::try_from(id).unwrap_or(0).to_le_bytes());
        out.extend(self.last.to_le_bytes());
        out.extend(self.pid.to_le_bytes());
        out.extend(u32::try_from(self.thread.tid).unwrap_or(0).to_le_bytes());
        text(out, self.thread.name);
        let fields = POINTS.get(id).map_or(&[][..], |p| p.1);
        for ((_, field), value) in fields.iter().zip(values) {
            match (field, value) {
                (_, Value::Text(value)) => text(out, value),
                (Int, Number(value)) => out.extend((*value as u32).to_le_bytes()),
                (_, Number(value)) => out.extend(value.to_le_bytes()),
            }
        }
    }

    fn into_bytes(self, uuid: [u8; 16], start: u64) -> Vec<u8> {
        const HEAD: usize = 4 + 16 + 4 + 5 * 8 + 4;
        let bits = (HEAD + self.events.len()) as u64 * 8;
        let mut bytes = Vec::with_capacity(HEAD + self.events.len());
        bytes.extend(0xC1FC_1FC1_u32.to_le_bytes());
        bytes.extend(uuid);
        bytes.extend(0_u32.to_le_bytes());
        for number in [start, self.last.max(start), bits, bits, 0] {
            bytes.extend(number.to_le_bytes());
        }
        bytes.extend(0_u32.to_le_bytes());
        bytes.extend(self.events);
        bytes
    }
}

/// Ends with a zero, and has none before it.
fn text(out: &mut Vec<u8>, text: &str) {
    out.extend(text.bytes().filter(|b| *b != 0));
    out.push(0);
}

/// The same for the same recording.
fn uuid(pid: u32, clocks: Clocks) -> [u8; 16] {
    let mut uuid = [0; 16];
    let words = clocks
        .realtime
        .to_le_bytes()
        .into_iter()
        .chain(clocks.monotonic.to_le_bytes());
    uuid.iter_mut().zip(words).for_each(|(to, from)| *to = from);
    uuid.iter_mut()
        .zip(pid.to_le_bytes())
        .for_each(|(to, from)| *to ^= from);
    uuid
}

fn metadata(uuid: [u8; 16], clocks: Clocks) -> String {
    let hex: Vec<String> = uuid.iter().map(|b| format!("{b:02x}")).collect();
    let part = |from: usize, to: usize| hex.get(from..to).unwrap_or_default().concat();
    let uuid = [
        part(0, 4),
        part(4, 6),
        part(6, 8),
        part(8, 10),
        part(10, 16),
    ]
    .join("-");
    let offset = clocks.realtime.saturating_sub(clocks.monotonic);
    let mut out = format!(
        "/* CTF 1.8 */
typealias integer {{ size = 8; align = 8; signed = false; }} := uint8_t;
typealias integer {{ size = 16; align = 8; signed = false; }} := uint16_t;
typealias integer {{ size = 32; align = 8; signed = false; }} := uint32_t;
typealias integer {{ size = 64; align = 8; signed = false; }} := uint64_t;
trace {{
    major = 1; minor = 8; uuid = \"{uuid}\"; byte_order = le;
    packet.header := struct {{ uint32_t magic; uint8_t uuid[16]; uint32_t stream_id; }};
}};
env {{ domain = \"ust\"; tracer_name = \"lttng-ust\"; tracer_major = 2; tracer_minor = 13; }};
clock {{ name = \"monotonic\"; description = \"CLOCK_MONOTONIC\"; freq = 1000000000; offset = {offset}; }};
typealias integer {{ size = 64; align = 8; signed = false; map = clock.monotonic.value; }} := time_t;
stream {{
    id = 0;
    packet.context := struct {{
        time_t timestamp_begin; time_t timestamp_end; uint64_t content_size; uint64_t packet_size;
        uint64_t events_discarded; uint32_t cpu_id;
    }};
    event.header := struct {{ uint16_t id; time_t timestamp; }};
    event.context := struct {{
        integer {{ size = 32; align = 8; signed = true; }} _vpid;
        integer {{ size = 32; align = 8; signed = true; }} _vtid;
        string {{ encoding = UTF8; }} _procname;
    }};
}};
"
    );
    for (id, Point(name, fields)) in POINTS.iter().enumerate() {
        write!(
            out,
            "event {{ name = \"ros2:{name}\"; id = {id}; stream_id = 0; fields := struct {{"
        )
        .ok();
        for (name, field) in *fields {
            let kind = match field {
                Pointer => "integer { size = 64; align = 8; signed = false; base = 16; }",
                Signed => "integer { size = 64; align = 8; signed = true; }",
                Unsigned => "uint64_t",
                Int => "integer { size = 32; align = 8; signed = true; }",
                Text => "string { encoding = UTF8; }",
            };
            write!(out, " {kind} _{name};").ok();
        }
        out.push_str(" }; };\n");
    }
    out
}
