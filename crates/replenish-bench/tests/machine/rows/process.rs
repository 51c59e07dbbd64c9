//! A15, A17, A19: the agent's output, its memory, its scheduling.

use super::{agent, program, row, within};
use crate::agent::{policies, stuck};
use crate::common::{Running, Scratch, free_port};
use crate::memory::attacks::{CLIENTS, long_names};
use replenish_testkit::harness::{Trial, skip_rt, trial};
use std::net::UdpSocket;
use std::process::Command;
use std::time::Duration;

/// b209253 wrote its log from the thread that keeps the JSON and waits for signals.
fn a15_nobody_reads_standard_error() {
    let scratch = Scratch::new("a15");
    let path = scratch.path("agent.json");
    let address = format!("127.0.0.1:{}", free_port());
    let json = path.to_str().unwrap();
    let args = ["agent", "--udp", &address, "--watch", "--json", json];
    let (mut agent, _reader) = stuck(&program(), &args, false);
    let uptime = || {
        let text = std::fs::read_to_string(&path).ok()?;
        let state: serde_json::Value = serde_json::from_str(&text).ok()?;
        state["uptime_seconds"].as_f64()
    };
    assert!(within(super::SOON, || uptime().is_some()), "control");
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.send_to(b"rubbish", &address).unwrap(); // a line of the log
    std::thread::sleep(Duration::from_millis(1500));
    let then = uptime();
    let limit = Duration::from_secs(5);
    let goes_on = within(limit, || uptime() > then);
    let pid = agent.id().to_string();
    Command::new("kill").arg(&pid).status().unwrap();
    let ends = within(limit, || agent.try_wait().unwrap().is_some());
    agent.kill().ok();
    agent.wait().unwrap();
    let word = |yes| if yes { "yes" } else { "not in 5 s" };
    let figure = format!(
        "JSON goes on: {}; SIGTERM ends it: {}",
        word(goes_on),
        word(ends)
    );
    row("A15", "standard error is full", &figure, goes_on && ends);
}

/// b209253 counted no names. Growth is that of the resident memory.
fn a17_names_of_maximal_length() {
    const MEMORY: u64 = 256 << 10;
    let scratch = Scratch::new("a17");
    let limits = [
        &*format!("--clients={CLIENTS}"),
        "--entities=4096",
        &format!("--client-memory={MEMORY}"),
    ];
    let victim = agent(&scratch, &limits);
    let idle = victim.peak();
    let open = long_names(victim.at);
    let state = victim.shows();
    assert!(state["clients"].as_array().unwrap().len() > 8, "control");
    let growth = victim.peak() - idle;
    drop(open);
    // Of each client its part, a message that is read, and 16 KiB of tables and JSON for each of
    // the 32 requesters that its part takes; a quarter for the allocator (`docs/agent.md`).
    let allowed = u64::from(CLIENTS) * (MEMORY + (64 << 10) + 32 * (16 << 10)) * 5 / 4;
    let mb = |bytes: u64| bytes as f64 / 1e6;
    let figure = format!(
        "{:.1} MB for clients that may have {:.1} MB",
        mb(growth),
        mb(u64::from(CLIENTS) * MEMORY)
    );
    row(
        "A17",
        "9600 requesters with four names",
        &figure,
        growth <= allowed,
    );
}

/// b209253 put its thread into time sharing, however it was started.
fn a19_the_agent_is_started_at_real_time_priority() {
    if !replenish_os::privilege::may_be_real_time() {
        skip_rt("no real-time priority on this machine");
    }
    let program = program();
    let args = ["-f", "70", &program, "agent", "--udp", "127.0.0.1:0"];
    let mut agent = Running::start("chrt", &args);
    agent.expect_line("listening at", super::SOON);
    let threads = policies(agent.id());
    let (_, policy, priority) = threads
        .iter()
        .find(|(name, ..)| name == "xrce-agent")
        .expect("control");
    agent.signal("TERM");
    assert!(agent.end(super::SOON).success(), "control");
    let figure = match policy {
        0 => "its thread has SCHED_OTHER".to_owned(),
        1 => format!("its thread has SCHED_FIFO {priority}"),
        other => format!("its thread has policy {other}"),
    };
    row(
        "A19",
        "chrt -f 70",
        &figure,
        (*policy, *priority) == (1, 70),
    );
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial(
            "a15_nobody_reads_standard_error",
            a15_nobody_reads_standard_error,
        ),
        trial("a17_names_of_maximal_length", a17_names_of_maximal_length),
        trial(
            "a19_the_agent_is_started_at_real_time_priority",
            a19_the_agent_is_started_at_real_time_priority,
        ),
    ]
}
