//! `cargo xtask board round-trip`: a message from the board to the host and back, in the board's
//! time, next to the time that its bytes take on the wire.

use super::testbench::{Bench, Host};
use crate::output::{Outcome, write};
use serde_json::{Value, json};
use std::path::Path;

/// Round trips at each rate.
const COUNT: usize = 200;

/// One round trip: ns, bytes from the board, bytes to it.
type Trip = (u64, u64, u64);

/// Runs at each of the `rates`, prints a table, writes JSON.
pub(crate) fn run(rates: &[u32], path: Option<&Path>) -> Outcome {
    println!(
        "The board (emulated, 8 ns per instruction; the line paced at 10 bits a byte) sends an Int32,\n\
         `replenish ping --echo` sends it back through `replenish agent`. Times are the board's; its\n\
         clock stands still while agent and ping work, so they and the emulator's line take none."
    );
    println!(
        "\n    baud   bytes there + back    wire us    p50 us    p99 us    max us   p50 - wire"
    );
    let bench = Bench::build("trip")?;
    let (mut points, mut wrong) = (Vec::new(), Vec::new());
    for baud in rates {
        let words = [COUNT.to_string(), baud.to_string()];
        let host = Host {
            echo: true,
            ..Host::default()
        };
        // Best effort: a loaded host may drop a datagram between agent and ping.
        let run = bench.run_until(&words, host, |run| trips(&run.board).len() == COUNT)?;
        let mut trips = trips(&run.board);
        trips.sort_unstable();
        if trips.len() != COUNT {
            wrong.push(format!("{baud} baud: {} of {COUNT} came back", trips.len()));
        }
        let rank = |percent: usize| {
            trips
                .get((trips.len() * percent / 100).min(COUNT - 1))
                .copied()
        };
        let (Some(half), Some(most), Some(last)) = (rank(50), rank(99), trips.last()) else {
            continue;
        };
        // Heartbeats and pings may pass besides: the fewest bytes are the message's.
        let there = trips.iter().map(|t| t.1).min().unwrap_or(0);
        let back = trips.iter().map(|t| t.2).min().unwrap_or(0);
        let wire = (there + back) * 10_000_000_000 / u64::from((*baud).max(1));
        if trips.first().is_some_and(|first| first.0 < wire) {
            wrong.push(format!(
                "{baud} baud: a round trip was faster than the wire"
            ));
        }
        let us = |ns: u64| ns as f64 / 1e3;
        println!(
            "{baud:>8} {:>21} {:>10.1} {:>9.1} {:>9.1} {:>9.1} {:>12.1}",
            format!("{there} + {back}"),
            us(wire),
            us(half.0),
            us(most.0),
            us(last.0),
            us(half.0) - us(wire),
        );
        points.push(json!({
            "baud": baud,
            "round_trips": trips.len(),
            "bytes_from_board": there,
            "bytes_to_board": back,
            "wire_ns": wire,
            "p50_ns": half.0,
            "p99_ns": most.0,
            "max_ns": last.0,
            "ping": run.ping,
        }));
    }
    let result = json!({
        "what": "Int32 from the board to ping and back, best effort, stock serial framing",
        "emulated": "board, line and their time; agent and ping take no time",
        "points": points,
        "off": wrong,
    });
    write(path, &result)?;
    if wrong.is_empty() {
        Ok(())
    } else {
        Err(wrong.join("\n"))
    }
}

/// The board's measurements.
fn trips(board: &Value) -> Vec<Trip> {
    let all = board.get("trips").and_then(Value::as_array);
    let number = |trip: &Value, i: usize| trip.get(i).and_then(Value::as_u64);
    all.into_iter()
        .flatten()
        .filter_map(|t| Some((number(t, 0)?, number(t, 1)?, number(t, 2)?)))
        .collect()
}
