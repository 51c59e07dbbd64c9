//! The agent as a process: where it listens, what it shows, what it refuses, how it ends.

use crate::common::{BIN, Running, Scratch, free_port, json, run, start, stderr};
use replenish_os::tty::Pty;
use replenish_testkit::harness::{Trial, skip, skip_rt, trial};
use replenish_xrce::client::{PING_LEN, ping, pong};
use replenish_xrce::framing::{
    SERIAL_AGENT, SERIAL_CLIENT, Serial, serial_frame, serial_frame_len,
};
use replenish_xrce::wire::RequestId;
use serde_json::Value;
use std::net::{TcpListener, UdpSocket};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The longest time that any step may take on a busy machine.
const SOON: Duration = Duration::from_secs(60);

/// The request that a ping is.
const ASKED: RequestId = RequestId::FIRST;

/// An agent on a free port of loopback with more options, and its address.
fn agent(more: &[&str]) -> (Running, String) {
    let mut agent = start(&[&["agent", "--udp", "127.0.0.1:0"], more].concat());
    let address = address_in(&agent.expect_line("listening at", SOON));
    (agent, address)
}

/// The first `127.0.0.1:port` in a line.
fn address_in(line: &str) -> String {
    let from = line.find("127.0.0.1:").unwrap();
    line[from..]
        .chars()
        .take_while(|c| c.is_ascii_digit() || ".:".contains(*c))
        .collect()
}

/// Two clients that talk: pong and ping.
fn clients(address: &str) -> (Running, Running) {
    let mut pong = start(&["pong", "--agent", address, "--burst", "0"]);
    pong.expect_line("granted", SOON);
    let mut ping = start(&["ping", "--agent", address, "--interval", "20"]);
    ping.expect_line("answered", SOON);
    (pong, ping)
}

/// Asks again until it holds.
fn eventually(what: &str, mut holds: impl FnMut() -> bool) {
    let until = Instant::now() + SOON;
    while !holds() {
        assert!(Instant::now() < until, "{what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn list<'a>(value: &'a Value, name: &str) -> &'a [Value] {
    value[name].as_array().unwrap_or_else(|| panic!("{name}"))
}

fn it_listens_at_several_addresses_of_both_families_and_over_tcp() {
    if UdpSocket::bind("[::1]:0").is_err() {
        skip("no IPv6 on this machine");
    }
    let scratch = Scratch::new("agent-addresses");
    let path = scratch.path("agent.json");
    let (mut agent, address) = agent(&[
        "--udp",
        "[::1]:0",
        "--tcp",
        "127.0.0.1:0",
        "--json",
        path.to_str().unwrap(),
    ]);
    let mut request = [0; PING_LEN];
    let request = ping(ASKED, None, &mut request).unwrap();
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.send_to(request, &address).unwrap();
    socket.set_read_timeout(Some(SOON)).unwrap();
    let mut buf = [0; 64];
    let len = socket.recv(&mut buf).unwrap();
    assert!(pong(ASKED, &buf[..len]).is_some());
    agent.signal("INT");
    assert!(agent.end(SOON).success());
    let told = json(&path);
    let places = list(&told, "addresses");
    assert_eq!(places.len(), 3, "{places:?}");
    for (place, part) in places.iter().zip(["127.0.0.1:", "[::1]:", "(TCP)"]) {
        assert!(place.as_str().unwrap().contains(part), "{place}");
    }
}

fn wrong_options_name_the_field_and_the_range() {
    let cases: [(&[&str], &str, &str); 17] = [
        (&["--udp", "localhost"], "--udp", "invalid"),
        (&["--clients", "0"], "--clients", "1..=4096"),
        (&["--entities", "5000"], "--entities", "1..=4096"),
        (&["--streams", "17"], "--streams", "1..=16"),
        (&["--client-memory", "100"], "--client-memory", "4096..="),
        (&["--memory", "200000"], "--memory", "at least 262144"),
        (&["--message", "63"], "--message", "64..=65535"),
        (&["--sample", "16777217"], "--sample", "1..=16777216"),
        (&["--sample", "4000000"], "--client-memory", "16000000 to"),
        (&["--rate", "10000001"], "--rate", "0..=10000000"),
        (&["--silence", "0"], "--silence", "1..=86400"),
        (&["--watch", "0"], "--watch", "1..=3600"),
        (&["--policy", "fifo:100"], "--policy", "fifo:1 to fifo:99"),
        (
            &["--priority", "/a=8"],
            "--priority",
            "priority is 8, allowed is 0 to 7",
        ),
        (
            &["--serial", "/dev/null", "--baud", "12345"],
            "--baud",
            "115200",
        ),
        (
            &[
                "--serial", "a", "--serial", "b", "--serial", "c", "--baud", "9600", "--baud",
                "1200",
            ],
            "--baud",
            "once for each",
        ),
        (&["--baud", "9600"], "--baud", "--serial"),
    ];
    for (args, option, range) in cases {
        let output = run(&[&["agent"], args].concat());
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{args:?}: {text}");
        assert!(
            text.contains(option) && text.contains(range),
            "{args:?}: {text}"
        );
    }
}

fn what_it_cannot_listen_at_is_named_at_once() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let cases: [(&[&str], &str); 4] = [
        (&["--tcp", &address], &address),
        (&["--serial", "/dev/no-such-line"], "/dev/no-such-line"),
        (&["--serial", "/dev/null"], "/dev/null"),
        (&["--refs", "/nonexistent.refs"], "/nonexistent.refs"),
    ];
    for (args, named) in cases {
        let begun = Instant::now();
        let output = run(&[&["agent"], args].concat());
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{args:?}: {text}");
        assert!(text.contains(named), "{args:?}: {text}");
        assert!(begun.elapsed() < SOON);
    }
}

fn a_line_without_permission_is_named() {
    let pty = Pty::open().unwrap();
    std::fs::set_permissions(pty.path(), PermissionsExt::from_mode(0o000)).unwrap();
    let mut command = Command::new(BIN);
    command.args(["agent", "--serial"]).arg(pty.path());
    // Root may open everything: another user is needed.
    if std::fs::metadata("/proc/self").is_ok_and(|me| std::os::unix::fs::MetadataExt::uid(&me) == 0)
    {
        command.uid(65_534);
    }
    let Ok(output) = command.stdin(Stdio::null()).output() else {
        skip("another user cannot run the program");
    };
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    let path = pty.path().to_str().unwrap();
    assert!(text.contains(path) && text.contains("ermission"), "{text}");
}

fn a_serial_line_alone_is_served_and_opens_no_port() {
    let pty = Pty::open().unwrap();
    let path = pty.path().to_str().unwrap();
    let mut agent = start(&["agent", "--serial", path, "--baud", "921600"]);
    let line = agent.expect_line("listening at", SOON);
    assert!(line.contains(path) && line.contains("921600"), "{line}");
    assert!(!line.contains("UDP"), "{line}");
    let mut request = [0; PING_LEN];
    let request = ping(ASKED, None, &mut request).unwrap();
    let mut frame = vec![0; serial_frame_len(request.len())];
    let len = serial_frame(SERIAL_CLIENT, SERIAL_AGENT, request, &mut frame).unwrap();
    assert_eq!(pty.tty.write(&frame[..len]).unwrap(), len);
    let mut decoder = Serial::new(SERIAL_CLIENT, vec![0; 512]);
    let mut answered = false;
    eventually("an answer", || {
        let mut buf = [0; 256];
        if let Ok(len) = pty.tty.read(&mut buf) {
            decoder.push(&buf[..len], |_, message| {
                answered |= pong(ASKED, message).is_some();
            });
        }
        answered
    });
    agent.signal("TERM");
    assert!(agent.end(SOON).success());
}

/// The `--json` report of two clients that talk, checked.
fn check_json(path: &Path) -> Value {
    let told = json(path);
    assert_eq!(list(&told, "clients").len(), 2, "{told:#}");
    for client in list(&told, "clients") {
        for key in [
            "key",
            "session",
            "peer",
            "mtu",
            "age_seconds",
            "silent_seconds",
            "entities",
            "memory_bytes",
            "datagrams_in_per_second",
            "bytes_out_per_second",
            "rate_limited",
            "retransmitted",
            "unacknowledged",
        ] {
            assert!(client.get(key).is_some(), "{key}: {client}");
        }
    }
    let topic = list(&told, "topics")
        .iter()
        .find(|topic| topic["topic"] == "rt/high_ping")
        .unwrap_or_else(|| panic!("{told:#}"));
    assert_eq!(
        (&topic["writers"], &topic["readers"]),
        (&1.into(), &1.into())
    );
    assert!(topic["type"].as_str().unwrap().contains("Int32"), "{topic}");
    for key in [
        "messages_in_per_second",
        "bytes_in_per_second",
        "messages_out_per_second",
        "bytes_out_per_second",
    ] {
        assert!(topic[key].as_f64().unwrap() > 0.0, "{key}: {topic}");
    }
    let reader = list(&told, "entities")
        .iter()
        .find(|entity| entity["kind"] == "data_reader" && entity["topic"] == "rt/high_ping");
    let half = &reader.unwrap()["reads"];
    assert_eq!(half["matched"], 1, "{half}");
    assert_eq!(half["priority"], 7, "the rule's");
    assert!(half["messages"].as_u64().unwrap() > 0, "{half}");
    told
}

fn it_shows_who_does_what_on_demand_and_ends_cleanly_with_clients_connected() {
    let scratch = Scratch::new("agent-shows");
    let path = scratch.path("agent.json");
    let (mut agent, address) =
        agent(&["--json", path.to_str().unwrap(), "--priority", "/high_*=7"]);
    let (_pong, _ping) = clients(&address);
    agent.signal("USR1");
    agent.expect_line("2 clients, ", SOON);
    let row = agent.expect_line("rt/high_ping", SOON);
    assert!(row.contains("Int32"), "{row}");
    let row = agent.expect_line("data_reader", SOON);
    assert!(row.contains("last "), "its QoS: {row}");
    eventually("the file is there", || {
        std::fs::read_to_string(&path).is_ok_and(|text| !text.is_empty())
    });
    check_json(&path);
    agent.signal("TERM");
    assert!(agent.end(SOON).success());
    let told = check_json(&path);
    assert_eq!(told["limits"]["clients"], 64);
    assert_eq!(told["sessions"], 2);
    let files = std::fs::read_dir(scratch.dir()).unwrap().count();
    assert_eq!(files, 1, "nothing is left beside the JSON");
}

fn a_watched_agent_shows_itself_again_and_again() {
    let (mut agent, _) = agent(&["--watch"]);
    for _ in 0..2 {
        agent.expect_line("0 clients, 0 topics", SOON);
    }
    agent.signal("INT");
    assert!(agent.end(SOON).success());
}

fn a_flood_of_rubbish_is_counted_and_costs_a_few_lines() {
    let scratch = Scratch::new("agent-flood");
    let path = scratch.path("agent.json");
    let (mut agent, address) = agent(&["--json", path.to_str().unwrap()]);
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    for i in 0..20_000_u32 {
        socket.send_to(&i.to_le_bytes()[..3], &address).unwrap();
        if i % 100 == 0 {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    let line = agent.expect_line("no DDS-XRCE message", SOON);
    let from = socket.local_addr().unwrap().to_string();
    assert!(line.contains(&from), "{line}");
    agent.signal("TERM");
    assert!(agent.end(SOON).success());
    let told = json(&path);
    let counted = told["refused"]["malformed"].as_u64().unwrap();
    assert_eq!(told["malformed"].as_u64(), Some(counted));
    assert!(counted > 5_000, "{counted}");
    let lines = agent.rest();
    assert!(lines.len() < 10, "{lines:#?}");
    let more = lines.iter().find(|line| line.contains("were not logged"));
    assert!(
        more.is_some_and(|line| line.contains("malformed")),
        "{lines:#?}"
    );
}

fn a_client_too_many_is_refused_with_its_key_its_place_and_the_limit() {
    let (mut agent, address) = agent(&["--clients", "1"]);
    let mut pong = start(&["pong", "--agent", &address, "--burst", "0"]);
    pong.expect_line("granted", SOON);
    let ping = run(&["ping", "--agent", &address, "--seconds", "1"]);
    assert_eq!(ping.status.code(), Some(1), "{}", stderr(&ping));
    let line = agent.expect_line("limits.clients = 1", SOON);
    assert!(
        line.contains("agent: client ") && line.contains("udp 127.0.0.1:"),
        "{line}"
    );
    agent.signal("TERM");
    assert!(agent.end(SOON).success());
}

fn an_access_list_is_read_again_on_sighup_and_a_wrong_one_changes_nothing() {
    let scratch = Scratch::new("agent-access");
    let (path, list) = (scratch.path("agent.json"), scratch.path("clients.toml"));
    let write = |text: &str| std::fs::write(&list, text).unwrap();
    let access = ["--access", list.to_str().unwrap()];
    let wrong = "[[client]]\nkey = \"0\"\n";
    write(wrong);
    let refused = run(&[&["agent", "--udp", "127.0.0.1:0"], &access[..]].concat());
    assert_eq!(refused.status.code(), Some(1));
    let why = stderr(&refused);
    assert!(
        why.contains("line 2: client.key: allowed are eight"),
        "{why}"
    );

    write("[[client]]\nkey = \"*\"\nfrom = [\"127.0.0.0/8\"]\n");
    let json_to = ["--json", path.to_str().unwrap()];
    let (mut agent, address) = agent(&[access, json_to].concat());
    let (mut pong, _ping) = clients(&address);
    write(wrong);
    agent.signal("HUP");
    agent.expect_line("kept the access list as it was", SOON);
    pong.signal("TERM");
    assert!(pong.end(SOON).success());

    write("");
    agent.signal("HUP");
    agent.expect_line("read the access list again: 0 entries", SOON);
    let line = agent.expect_line("the access list does not have its key", SOON);
    assert!(line.contains("udp 127.0.0.1:"), "{line}");
    agent.signal("TERM");
    assert!(agent.end(SOON).success());
    let told = json(&path);
    let access = &told["access"];
    assert_eq!(
        (&access["loaded"], &access["failed"]),
        (&2.into(), &1.into())
    );
    assert_eq!(access["entries"], 0);
    assert!(told["stats"]["denied"].as_u64() >= Some(1), "{told}");
}

/// A command whose output goes into a pipe that is full, and that is not read.
pub(crate) fn stuck(
    program: &str,
    args: &[&str],
    output: bool,
) -> (std::process::Child, std::io::PipeReader) {
    let (reader, mut writer) = std::io::pipe().unwrap();
    std::io::Write::write_all(&mut writer, &[b'x'; 65_536]).unwrap(); // what a pipe takes
    let mut command = Command::new(program);
    command.args(args).stdin(Stdio::null());
    if output {
        command.stdout(writer).stderr(Stdio::null());
    } else {
        command.stderr(writer).stdout(Stdio::null());
    }
    (command.spawn().unwrap(), reader)
}

/// b209253 wrote the log from the thread that keeps the JSON and waits for signals: with a full
/// pipe on standard error the JSON froze, and SIGTERM did not end the agent.
fn an_agent_whose_output_nobody_reads_keeps_its_json_and_ends() {
    for output in [true, false] {
        let scratch = Scratch::new(&format!("agent-stuck-{output}"));
        let path = scratch.path("agent.json");
        let address = format!("127.0.0.1:{}", free_port());
        let args = ["agent", "--udp", &address, "--watch", "--json"];
        let (mut agent, _reader) = stuck(
            BIN,
            &[&args[..], &[path.to_str().unwrap()]].concat(),
            output,
        );
        let uptime = || {
            let text = std::fs::read_to_string(&path).ok()?;
            let value: Value = serde_json::from_str(&text).ok()?;
            value["uptime_seconds"].as_f64()
        };
        eventually("there is JSON", || uptime().is_some());
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.send_to(b"rubbish", &address).unwrap(); // a line of the log
        std::thread::sleep(Duration::from_millis(700));
        let then = uptime();
        eventually("the JSON goes on", || uptime() > then);
        let pid = agent.id().to_string();
        Command::new("kill").arg(&pid).status().unwrap();
        eventually("SIGTERM ends it", || agent.try_wait().unwrap().is_some());
        assert!(agent.wait().unwrap().success());
        assert_eq!(json(&path)["refused"]["malformed"], 1);
    }
}

/// The policy and the priority of every thread of a process, by the thread's name: `SCHED_OTHER` is
/// 0, FIFO 1, RR 2.
pub(crate) fn policies(pid: u32) -> Vec<(String, u32, u32)> {
    let tasks = std::fs::read_dir(format!("/proc/{pid}/task")).unwrap();
    let stats =
        tasks.filter_map(|task| std::fs::read_to_string(task.ok()?.path().join("stat")).ok());
    let thread = |stat: String| {
        let (head, fields) = stat.rsplit_once(')').unwrap();
        let fields: Vec<&str> = fields.split_whitespace().collect();
        let name = head.split_once('(').unwrap().1.to_owned();
        (
            name,
            fields[38].parse().unwrap(),
            fields[37].parse().unwrap(),
        )
    };
    stats.map(thread).collect()
}

/// b209253 put its thread into time sharing, however it was started, and had no option.
fn its_thread_keeps_the_policy_it_was_started_with_or_has_the_one_that_is_named() {
    if !replenish_os::privilege::may_be_real_time() {
        skip_rt("no real-time priority on this machine");
    }
    let listening = ["agent", "--udp", "127.0.0.1:0"];
    for (start, more, expected) in [
        (&["chrt", "-f", "33"][..], &[][..], (1, 33)),
        (&["chrt", "-r", "12"], &[], (2, 12)),
        (&["chrt", "-f", "33"], &["--policy", "other"], (0, 0)),
        (&["chrt", "-o", "0"], &["--policy", "fifo:7"], (1, 7)),
        (&["chrt", "-o", "0"], &[], (0, 0)),
    ] {
        let args = [&start[1..], &[BIN], &listening, more].concat();
        let mut agent = Running::start(start[0], &args);
        agent.expect_line("listening at", SOON);
        let threads = policies(agent.id());
        for (name, policy, priority) in &threads {
            let of_agent = name == "xrce-agent";
            let expected = if of_agent { expected } else { (0, 0) };
            assert_eq!((*policy, *priority), expected, "{name}: {args:?}");
        }
        assert!(threads.iter().any(|(name, ..)| name == "xrce-agent"));
        agent.signal("TERM");
        assert!(agent.end(SOON).success());
    }
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial(
            "it_listens_at_several_addresses_of_both_families_and_over_tcp",
            it_listens_at_several_addresses_of_both_families_and_over_tcp,
        ),
        trial(
            "wrong_options_name_the_field_and_the_range",
            wrong_options_name_the_field_and_the_range,
        ),
        trial(
            "what_it_cannot_listen_at_is_named_at_once",
            what_it_cannot_listen_at_is_named_at_once,
        ),
        trial(
            "a_line_without_permission_is_named",
            a_line_without_permission_is_named,
        ),
        trial(
            "a_serial_line_alone_is_served_and_opens_no_port",
            a_serial_line_alone_is_served_and_opens_no_port,
        ),
        trial(
            "it_shows_who_does_what_on_demand_and_ends_cleanly_with_clients_connected",
            it_shows_who_does_what_on_demand_and_ends_cleanly_with_clients_connected,
        ),
        trial(
            "a_watched_agent_shows_itself_again_and_again",
            a_watched_agent_shows_itself_again_and_again,
        ),
        trial(
            "a_flood_of_rubbish_is_counted_and_costs_a_few_lines",
            a_flood_of_rubbish_is_counted_and_costs_a_few_lines,
        ),
        trial(
            "a_client_too_many_is_refused_with_its_key_its_place_and_the_limit",
            a_client_too_many_is_refused_with_its_key_its_place_and_the_limit,
        ),
        trial(
            "an_access_list_is_read_again_on_sighup_and_a_wrong_one_changes_nothing",
            an_access_list_is_read_again_on_sighup_and_a_wrong_one_changes_nothing,
        ),
        trial(
            "an_agent_whose_output_nobody_reads_keeps_its_json_and_ends",
            an_agent_whose_output_nobody_reads_keeps_its_json_and_ends,
        ),
        trial(
            "its_thread_keeps_the_policy_it_was_started_with_or_has_the_one_that_is_named",
            its_thread_keeps_the_policy_it_was_started_with_or_has_the_one_that_is_named,
        ),
    ]
}
