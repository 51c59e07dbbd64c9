//! `cargo xtask board demo`: the paper's test bench in one command.

use super::case::{self, Worker};
use super::report;
use super::testbench::{Bench, Host};
use crate::output::{Outcome, write};
use serde_json::json;
use std::path::Path;

/// Budget and period of the high worker in ms.
const BUDGET: (u64, u64) = (30, 100);

/// Runs the demo for `seconds` of the board's time.
pub(crate) fn run(seconds: u64, path: Option<&Path>) -> Outcome {
    println!(
        "An emulated Olimex STM32-H405 runs pong: executor, XRCE client and two workers, over its\n\
         USART2 against `replenish agent`. `replenish ping` sends two messages for each of the\n\
         board's 10 ms; answering one takes 10 ms of CPU time. The worker of topic `high` has a\n\
         budget of 30 ms per 100 ms, so it must get 30 % and topic `low` what is left."
    );
    let bench = Bench::build("pong")?;
    let workers = case::pair(BUDGET.0, BUDGET.1);
    let mut words = vec![(seconds * 1_000).to_string()];
    words.extend(workers.iter().map(Worker::word));
    let run = bench.run_answered(&words, Host::default())?;
    let (board, ms) = (&run.board, seconds as f64 * 1e3);
    let names = ["high", "low"];
    println!("\ntopic   answers   CPU      budget");
    for (worker, (name, budget)) in report::workers(board).zip(names.iter().zip(["30 %", "-"])) {
        let cpu = report::number(worker, "cpu_high_ns") + report::number(worker, "cpu_low_ns");
        println!(
            "{name:<7} {:>7}   {:>5.2} %  {budget}",
            report::number(worker, "answered"),
            cpu / 1e4 / ms,
        );
    }
    println!(
        "executor: {:.2} % of the CPU; ping received {} and {} answers",
        report::support_ms(board) * 100.0 / ms,
        run.ping.pointer("/answered/0").unwrap_or(&json!(0)),
        run.ping.pointer("/answered/1").unwrap_or(&json!(0)),
    );
    println!(
        "line: {} bytes to the board, {} from it, {} lost",
        board.pointer("/uart/received").unwrap_or(&json!(0)),
        board.pointer("/uart/sent").unwrap_or(&json!(0)),
        board.pointer("/uart/dropped").unwrap_or(&json!(0)),
    );
    write(
        path,
        &json!({"seconds": seconds, "board": board, "ping": run.ping}),
    )?;
    let wrong = report::losses(&run);
    if wrong.is_empty() {
        Ok(())
    } else {
        Err(wrong.join("\n"))
    }
}
