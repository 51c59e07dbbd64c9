//! `cargo xtask board experiment noise`: flips one bit in every Nth byte of the line. Reliable
//! samples arrive once and in order on both sides; losses of the others are counted.

use super::report;
use super::testbench::{Bench, Host};
use crate::output::{Outcome, write};
use serde_json::{Value, json};
use std::path::Path;

/// Numbers on each topic.
const COUNT: u64 = 300;
/// Every so manieth byte loses a bit.
const EVERY: u64 = 500;

/// Runs, prints, writes JSON.
pub(crate) fn run(path: Option<&Path>) -> Outcome {
    let bench = Bench::build("noise")?;
    let host = Host {
        echo: true,
        ..Host::default()
    };
    let run = bench.run(&[COUNT.to_string(), EVERY.to_string()], host)?;
    let mut wrong = Vec::new();
    let mut hold = |what: bool, why: String| {
        if !what {
            wrong.push(why);
        }
    };
    let top = |key| report::number(&run.board, key);
    println!(
        "one bit of every {EVERY}th byte: {} bytes damaged, {} damaged frames seen by the board",
        top("bytes_damaged"),
        top("frames_damaged"),
    );
    println!("(ping also counts the loose messages before the noise begins)");
    println!("topic   sent by the board   received by ping   sent back   received by the board");
    for (i, name) in ["sure", "loose"].into_iter().enumerate() {
        let board = run.board.get(name).cloned().unwrap_or_default();
        let echo = run.ping.pointer(&format!("/echoed/{i}"));
        let echo = echo.cloned().unwrap_or_default();
        let n = |of: &Value, key| report::number(of, key);
        let way = [
            n(&board, "sent"),
            n(&echo, "received"),
            n(&echo, "sent"),
            n(&board, "back"),
        ];
        let [sent, there, again, back] = way;
        println!("{name:<7} {sent:>17} {there:>18} {again:>11} {back:>23}");
        let twice = n(&board, "again") + n(&echo, "again");
        if name == "sure" {
            let all = way.iter().all(|n| *n == COUNT as f64);
            hold(all, format!("reliable: {way:?} instead of {COUNT} each"));
            hold(
                twice == 0.0,
                format!("reliable: {twice} came twice or out of order"),
            );
        } else {
            hold(
                back < sent,
                "best effort: nothing was lost in the noise".into(),
            );
        }
    }
    hold(top("bytes_damaged") > 0.0, "no byte was damaged".into());
    for key in ["link_lost", "heap_refused"] {
        hold(top(key) == 0.0, format!("{key} is {}", top(key)));
    }
    let result = json!({
        "experiment": "noise",
        "damaged_every_bytes": EVERY,
        "board": run.board,
        "ping": run.ping,
        "off": wrong,
    });
    write(path, &result)?;
    if wrong.is_empty() {
        println!("Everything reliable arrived once, in order.");
        Ok(())
    } else {
        Err(wrong.join("\n"))
    }
}
