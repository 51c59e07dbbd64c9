//! `cargo xtask board recorder`: what the board's tasks did last, on the host's timeline.
//!
//! The emulated board sends its ring through the agent; `top` lists it, and `trace` puts it beside
//! ping.

use super::report::number;
use super::testbench::{Bench, Host, Run, live, scratch};
use crate::output::{Outcome, write};
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;

/// The name that the image gives its board.
const BOARD: &str = "board of the test";
/// Time that the image works, in ms.
const LENGTH_MS: u64 = 4_000;

/// Runs, prints, writes JSON.
pub(crate) fn run(path: Option<&Path>) -> Outcome {
    let bench = Bench::recorded("recorder", look)?;
    let host = Host {
        echo: true,
        ..Host::default()
    };
    let run = bench.run_until(&[LENGTH_MS.to_string()], host, in_time);
    std::fs::remove_dir_all(live()).ok();
    let run = run?;
    let mut wrong = Vec::new();
    let mut hold = |what: bool, why: &str| {
        if !what {
            wrong.push(why.to_owned());
        }
    };
    let of = |key| number(&run.board, key);
    hold(of("back") > 0.0, "ping sent nothing back");
    hold(of("pieces") > 0.0, "the board sent no piece");
    hold(of("exchanges") > 0.0, "the agent told no time");
    for key in ["unsent", "heap_refused"] {
        hold(of(key) == 0.0, &format!("{key} is {}", of(key)));
    }
    let null = Value::Null;
    let at = |path: &str| run.looked.pointer(path).unwrap_or(&null);
    // The agent lists ping beside the board, by keys that are drawn.
    let board = find(at("/top/agents/0/boards"), "name", BOARD).unwrap_or(&null);
    let recording = board.get("recording").unwrap_or(&null);
    println!(
        "{BOARD}: {} events came, {} did not; its clock is known by {}",
        number(recording, "events"),
        number(recording, "missed"),
        recording.get("clock").unwrap_or(&null),
    );
    hold(!board.is_null(), "top does not list the board");
    hold(
        recording.get("clock") == Some(&"exchange".into()),
        "the exchange is not used",
    );
    hold(number(recording, "events") > 0.0, "no event came");
    let worker = find(at("/top/programs"), "program", BOARD)
        .and_then(|board| find(board.get("workers")?, "name", "hungry"))
        .unwrap_or(&null);
    let seen = number(worker, "exhaustions");
    println!(
        "hungry: {seen} budgets used up as `top` shows it, {} as the board counts at its end",
        of("exhaustions")
    );
    hold(
        seen > 0.0 && seen <= of("exhaustions"),
        "the exhaustions are not the board's",
    );
    hold(number(worker, "budget_ns") == 2e6, "the budget is not 2 ms");
    let rings = find(at("/trace/others"), "program", BOARD).and_then(|board| board.get("rings"));
    let rings = rings.and_then(Value::as_array).cloned().unwrap_or_default();
    for (thread, ring) in [
        ("hungry", "thread"),
        ("hungry", "budget"),
        ("talker", "thread"),
    ] {
        let is = |r: &&Value| {
            r.get("thread") == Some(&thread.into()) && r.get("ring") == Some(&ring.into())
        };
        let events = rings.iter().find(is).map_or(0.0, |r| number(r, "events"));
        println!("{thread}, {ring}: {events} events beside ping's, in the last 20 s of both");
        hold(
            events > 0.0,
            &format!("{thread}, {ring}: no events on ping's timeline"),
        );
    }
    let result = json!({
        "experiment": "recorder",
        "board": run.board,
        "looked": run.looked,
        "off": wrong,
    });
    write(path, &result)?;
    if wrong.is_empty() {
        println!("Board and host stand on one timeline.");
        Ok(())
    } else {
        Err(wrong.join("\n"))
    }
}

/// The board's clock runs on while a loaded host starts ping, takes the pieces and looks: a host
/// that was late with one of them shows nothing of the board.
fn in_time(run: &Run) -> bool {
    let of = |key| number(&run.board, key);
    of("back") > 0.0 && of("unsent") == 0.0 && run.looked.get("trace").is_some()
}

fn find<'a>(list: &'a Value, key: &str, name: &str) -> Option<&'a Value> {
    let mut list = list.as_array()?.iter();
    list.find(|item| item.get(key).is_some_and(|value| value == name))
}

/// The output of `top` and `trace` while the board is there.
fn look(bench: &Bench) -> Outcome<Value> {
    let top = read(bench.replenish().args(["top", "--once"]), "top")?;
    let pid = |what: &dyn Fn(&Value) -> bool| {
        let programs = top.get("programs").and_then(Value::as_array);
        let found = programs.into_iter().flatten().find(|program| what(program));
        found
            .and_then(|program| program.get("pid"))
            .map(Value::to_string)
    };
    let is_board = |program: &Value| program.get("program").is_some_and(|name| name == BOARD);
    let (board, host) = (pid(&is_board), pid(&|program| !is_board(program)));
    let (Some(board), Some(host)) = (board, host) else {
        eprintln!("top shows no board, or no ping:\n{top:#}");
        return Ok(json!({ "top": top }));
    };
    let out = scratch("perfetto");
    let mut trace = bench.replenish();
    trace
        .args(["trace", &host, &board, "--last", "20s", "--perfetto"])
        .arg(&out);
    let trace = read(&mut trace, "trace")?;
    std::fs::remove_file(&out).ok();
    Ok(json!({ "top": top, "trace": trace }))
}

/// The JSON of a command.
fn read(command: &mut Command, name: &str) -> Outcome<Value> {
    let out = scratch(name);
    let output = command.arg("--json").arg(&out).output();
    let output = output.map_err(|e| format!("{name}: {e}"))?;
    if !output.status.success() {
        return Err(format!(
            "{name}: {}",
            String::from_utf8_lossy(&output.stderr)
        ));
    }
    let text = std::fs::read_to_string(&out).map_err(|e| format!("{name}: {e}"))?;
    std::fs::remove_file(&out).ok();
    serde_json::from_str(&text).map_err(|e| format!("{name}: {e}"))
}
