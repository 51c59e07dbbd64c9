//! Boards behind an agent: `top` lists them, and what they send of their recordings stands beside
//! the host's programs in one trace. The board is a client in this process; `cargo xtask board
//! recorder` has the emulated one.

use crate::common::{BIN, Scratch, json, stderr, stdout};
use crate::perfetto::check;
use crate::recorded::Program;
use replenish::middleware::xrce::{Xrce, XrceConfig};
use replenish::msg::std_msgs::UInt8MultiArray;
use replenish::{Context, Publisher, Qos};
use replenish_os::clock;
use replenish_recorder::board::{BoardThread, CompactEvent, MAX_PIECE, Piece, TOPIC};
use replenish_recorder::{Event, Kind, NameKind, Role, RunningTotals};
use std::io::{BufRead, BufReader, Seek, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

const MS: u64 = 1_000_000;
/// Time in ns from the host's start to the board's.
const YOUNGER: u64 = 20_000 * MS;

struct Agent {
    child: Child,
    address: String,
}

impl Agent {
    fn start(directory: &Path) -> Self {
        let mut child = Command::new(BIN)
            .args([
                "agent",
                "--supervised",
                "--ordinary",
                "--udp",
                "127.0.0.1:0",
            ])
            .env("REPLENISH_LIVE", directory)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut ready = String::new();
        let out = child.stdout.as_mut().unwrap();
        BufReader::new(out).read_line(&mut ready).unwrap();
        let ready: serde_json::Value = serde_json::from_str(&ready).unwrap();
        let address = ready["address"].as_str().unwrap().to_owned();
        Self { child, address }
    }
}

impl Drop for Agent {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

struct Board {
    publisher: Publisher<UInt8MultiArray>,
    /// Events sent.
    sent: u64,
    _context: Context,
}

impl Board {
    fn connect(agent: &Agent) -> Self {
        let config = XrceConfig {
            key: Some(*b"arm0"),
            ..XrceConfig::default()
        };
        let context = Context::new(Xrce::udp_with(&agent.address, config).unwrap());
        let node = context.node("arm_node").unwrap();
        Self {
            publisher: node.publisher(TOPIC, Qos::best_effort()).unwrap(),
            sent: 0,
            _context: context,
        }
    }

    fn send(&self, piece: &Piece<'_>) {
        let mut room = [0; MAX_PIECE];
        let len = piece.write(&mut room);
        let mut message = UInt8MultiArray::default();
        message.data.extend_from_slice(&room[..len]).unwrap();
        self.publisher.publish(&message).unwrap();
    }

    fn describe(&self) {
        let name = |id, kind, text| Piece::Name { id, kind, text };
        self.send(&name(0, NameKind::Mark, "arm\u{1b}[2J"));
        for (index, name, role) in [
            (0, "dispatcher", Role::Dispatcher),
            (1, "reach", Role::Worker),
        ] {
            self.send(&Piece::Thread(BoardThread {
                index,
                threads: 2,
                task: u8::try_from(index).unwrap() + 1,
                role,
                budget: (index == 1).then_some((2 * MS, 20 * MS)),
                totals: RunningTotals {
                    exhaustions: 7,
                    ..RunningTotals::default()
                },
                name,
                policy: "priority 60",
            }));
        }
        self.send(&name(1, NameKind::Handle, "reach/timer:0"));
    }

    /// A callback of 3 ms that uses its budget up, in the board's time.
    fn callback(&mut self) {
        let now = clock::monotonic() - YOUNGER;
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
        let ahead = i64::try_from(unix.as_nanos()).unwrap() - i64::try_from(now).unwrap();
        let event = |of_budget, ago: u64, kind, a| {
            let time = now - ago * MS;
            let event = Event {
                time,
                kind,
                name: 1,
                a,
                b: 0,
            };
            CompactEvent::new(2, of_budget, &event).to_bytes()
        };
        let events = [
            event(false, 4, Kind::Begin, now - 4 * MS),
            event(true, 2, Kind::Exhausted, 0),
            event(false, 1, Kind::End, now - 4 * MS),
        ];
        let events = events.concat();
        self.send(&Piece::Events {
            first: self.sent,
            now,
            ahead: Some(ahead),
            events: &events,
        });
        self.sent += 3;
    }
}

#[test]
fn a_board_is_listed_and_its_recording_stands_on_the_hosts_timeline() {
    let scratch = Scratch::new("boards");
    let program = Program::start("boards");
    let out = scratch.path("top.json");
    program.wait(&out);
    let mut agent = Agent::start(program.directory());
    let mut board = Board::connect(&agent);
    let end = Instant::now() + Duration::from_secs(60);
    let top = loop {
        board.describe();
        board.callback();
        let top = program.top(&out);
        let row = &top["agents"][0]["boards"][0];
        // A rate takes two of the agent's looks.
        if row["recording"]["events"].as_u64() >= Some(6) && row["in_per_s"].as_f64() > Some(0.0) {
            break top;
        }
        assert!(Instant::now() < end, "{top:#}");
        std::thread::sleep(Duration::from_millis(50));
    };
    assert_eq!(top["warnings"].as_array().unwrap().len(), 0, "{top:#}");
    let listed = &top["agents"][0];
    assert_eq!(listed["agent_pid"], agent.child.id());
    assert_eq!(listed["agent"], agent.address);
    let [row] = &**listed["boards"].as_array().unwrap() else {
        panic!("{listed:#}");
    };
    assert_eq!(row["key"], "61726d30");
    let name = row["name"].as_str().unwrap();
    assert!(
        name.starts_with("arm") && !name.contains('\u{1b}'),
        "{name:?}"
    );
    assert_eq!(row["recording"]["clock"], "exchange", "{row:#}");
    let number = &row["recording"]["pid"];
    let pid = number.to_string();
    let programs = top["programs"].as_array().unwrap();
    let found = programs.iter().find(|p| p["pid"] == *number);
    let reach = &found.unwrap()["workers"][0];
    assert_eq!(
        (&reach["name"], &reach["exhaustions"]),
        (&"reach".into(), &7.into())
    );
    assert_eq!(reach["budget_ns"], 2 * MS);
    let text = stdout(&program.command(&["top", "--once"]));
    let line = text.lines().find(|line| line.contains("61726d30"));
    assert!(
        line.is_some_and(|line| line.contains(&agent.address)),
        "{text}"
    );

    // The board's clock is 20 s behind: only events on the host's are within 10 s of its last one.
    let (trace, summary) = (scratch.path("both.pftrace"), scratch.path("trace.json"));
    let [trace_path, summary_path] = [&trace, &summary].map(|p| p.to_str().unwrap());
    let host = program.child.id().to_string();
    let args = [
        "trace",
        &host,
        &pid,
        "--last",
        "10s",
        "--perfetto",
        trace_path,
    ];
    let output = program.command(&[&args[..], &["--json", summary_path]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let json = json(&summary);
    assert_eq!(json["pid"].to_string(), host);
    let [other] = &**json["others"].as_array().unwrap() else {
        panic!("{json:#}");
    };
    assert_eq!(
        (other["program"].as_str(), &other["alive"]),
        (Some(name), &true.into())
    );
    let rings = other["rings"].as_array().unwrap();
    let events = |ring| {
        rings
            .iter()
            .find(|r| r["thread"] == "reach" && r["ring"] == ring)
    };
    assert!(
        events("thread").unwrap()["events"].as_u64() >= Some(4),
        "{other:#}"
    );
    assert!(
        events("budget").unwrap()["events"].as_u64() >= Some(2),
        "{other:#}"
    );
    check(&std::fs::read(&trace).unwrap());
    let several = ["trace", &host, &pid, "--ctf", "never"];
    let output = program.command(&several);
    assert!(
        !output.status.success() && stderr(&output).contains("--ctf"),
        "{}",
        stderr(&output)
    );

    // The agent is killed: no client is listed, and the recording is one of the ended.
    agent.child.kill().unwrap();
    agent.child.wait().unwrap();
    let top = program.top(&out);
    assert_eq!(top["agents"].as_array().unwrap().len(), 0, "{top:#}");
    let programs = top["programs"].as_array().unwrap();
    let left = programs.iter().find(|p| p["pid"] == *number).unwrap();
    assert_eq!(left["alive"], false);
    // The next agent removes the list that the killed one left.
    let lists = || {
        let entries = std::fs::read_dir(program.directory()).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names
            .filter(|name| name.ends_with(".boards"))
            .collect::<Vec<_>>()
    };
    let old = format!("{}.boards", agent.child.id());
    assert_eq!(lists(), [&*old]);
    let next = Agent::start(program.directory());
    let new = format!("{}.boards", next.child.id());
    while lists() != [&*new] {
        assert!(Instant::now() < end, "{:?}", lists());
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Lists that a stranger wrote: left out and named, or shown without control characters.
#[test]
fn damaged_lists_of_boards_do_no_harm() {
    let scratch = Scratch::new("board-lists");
    let (directory, out) = (scratch.path("live"), scratch.path("top.json"));
    std::fs::create_dir(&directory).unwrap();
    let board = r#"{"key":"k","name":"\u001b[2Jname","peer":"p","age_ns":1,"silent_ns":18446744073709551615,"in_per_s":1e300,"out_per_s":0,"drops":3,"recording":null}"#;
    let list = format!(r#"{{"agent_pid":7,"agent":"a\u202e","at":5,"boards":[{board}]}}"#);
    let path = directory.join("7.boards");
    let mut file = std::fs::File::create(&path).unwrap();
    file.lock().unwrap(); // its agent runs
    let mut top = |content: &[u8]| {
        file.set_len(0).unwrap();
        file.rewind().unwrap();
        file.write_all(content).unwrap();
        let script = "ulimit -v 2000000 && exec timeout 60 \"$@\"";
        let mut command = Command::new("sh");
        command.args(["-c", script, "sh", BIN, "top", "--once", "--json"]);
        let output = command.arg(&out).env("REPLENISH_LIVE", &directory).output();
        let output = output.unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        assert!(!stdout(&output).contains(['\u{1b}', '\u{202e}']));
        let top = json(&out);
        let [agents, warnings] =
            ["agents", "warnings"].map(|key| top[key].as_array().unwrap().len());
        assert_eq!(agents + warnings, 1, "{top:#}");
        agents
    };
    assert_eq!(top(list.as_bytes()), 1);
    assert_eq!(top("[".repeat(1 << 20).as_bytes()), 0, "nested");
    let many = format!("{board},").repeat(40_000);
    let long = list.replace(board, many.trim_end_matches(','));
    assert_eq!(top(long.as_bytes()), 0, "more than a reader takes");
    assert_eq!(top(b"\xff\xfe"), 0, "no text");
    let mut seed = 7_u64;
    let mut below = |n: usize| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        usize::try_from(seed >> 33).unwrap() % n
    };
    for _ in 0..100 {
        let mut bytes = list.clone().into_bytes();
        for _ in 0..=below(3) {
            let at = below(bytes.len());
            bytes[at] = u8::try_from(below(256)).unwrap();
        }
        bytes.truncate(bytes.len() - below(8).saturating_sub(6) * below(bytes.len()));
        top(&bytes);
    }
}
