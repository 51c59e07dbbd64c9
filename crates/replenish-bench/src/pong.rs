//! `replenish pong`: pong alone.

use crate::load::spec::{BACKGROUND, HIGH_PRIORITY, High, INTERVAL, Spec};
use crate::options;
use crate::roles::monitor;
use crate::roles::pong::{self, Config};
use crate::roles::protocol::Event;
use crate::roles::supervised::{self, SharedGrid};
use replenish_cli::machine::cpus;
use replenish_cli::options::{JsonOption, address};
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::files;
use replenish_cli::report::table::Table;
use replenish_cli::signals::Stop;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Options of `pong`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The agent's address.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8888", value_parser = address)]
    agent: SocketAddr,

    /// Budget of the high worker in milliseconds, at most the period.
    #[arg(long, value_name = "MS", default_value_t = 30, value_parser = options::budget())]
    budget: u64,

    /// Period of the budget in milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 100, value_parser = options::period())]
    period: u64,

    /// Priority of the high worker when its budget is used up.
    #[arg(long, value_name = "PRIORITY", default_value_t = BACKGROUND,
          value_parser = clap::value_parser!(u8).range(1..i64::from(HIGH_PRIORITY)))]
    background: u8,

    /// Give the high worker plain FIFO instead of a budget.
    #[arg(long, conflicts_with_all = ["budget", "background"])]
    fifo: bool,

    /// CPU time that an answer takes, in milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 10,
          value_parser = clap::value_parser!(u64).range(0..=1_000))]
    burst: u64,

    /// The part of it that the low callback sleeps instead, in percent.
    #[arg(long, value_name = "PERCENT", default_value_t = 0,
          value_parser = clap::value_parser!(u8).range(0..=100))]
    low_sleep: u8,

    /// The CPU of workers, dispatcher and enforcer; budgets are exact on a CPU of their own only.
    #[arg(long, value_name = "CPU")]
    cpu: Option<usize>,

    /// Refuse to start if budgets cannot be enforced in the middle of a callback.
    #[arg(long)]
    strict: bool,

    #[command(flatten)]
    json: JsonOption,

    #[arg(long, hide = true)]
    monitor_cpu: Option<usize>,

    #[arg(long, hide = true)]
    supervised: bool,
}

/// Runs pong.
pub(crate) fn run(args: &Args) -> Outcome {
    if args.budget > args.period {
        let allowed = format!("1..={} (the period)", args.period);
        return Err(Failure::range("--budget", args.budget, allowed));
    }
    cpus::check("--cpu", args.cpu)?;
    files::check_writable(args.json.json.as_deref())?;
    let stop = Stop::on_signals()?;
    let grid = SharedGrid::default();
    if args.supervised {
        supervised::listen(SharedGrid::clone(&grid), stop.clone());
    }
    let config = config(args);
    let pong = pong::start(&config, &grid, args.supervised)?;
    let topics = [Arc::clone(&pong.high), Arc::clone(&pong.low)];
    let report = if args.supervised {
        supervised::emit(&Event::Ready(pong.ready()));
        monitor::watch(pong, &config, &grid, &stop)?
    } else {
        print_threads(&pong);
        let mut before = (0, 0);
        while !stop.wait(Duration::from_secs(1)) {
            let now = (
                pong.high.answered.load(Ordering::Relaxed),
                pong.low.answered.load(Ordering::Relaxed),
            );
            println!(
                "answered: high {}, low {}",
                now.0 - before.0,
                now.1 - before.1
            );
            before = now;
        }
        pong.running.stop()
    };
    let end = pong::end(&report, &topics, grid.get());
    if args.supervised {
        supervised::emit(&Event::PongEnd(end));
        return Ok(());
    }
    println!("\n{report}");
    let json = serde_json::json!({
        "threads": report.threads.iter().map(|t| serde_json::json!({
            "name": t.name,
            "requested": t.requested,
            "granted": t.granted,
            "cpu_high_ms": t.usage.cpu_high as f64 / 1e6,
            "cpu_low_ms": t.usage.cpu_low as f64 / 1e6,
            "exhaustions": t.usage.exhaustions,
        })).collect::<Vec<_>>(),
        "handles": report.handles.iter().map(|h| serde_json::json!({
            "id": h.id,
            "received": h.stats.received,
            "executed": h.stats.executed,
            "dropped": h.stats.dropped,
        })).collect::<Vec<_>>(),
        "overrun_us": end.overrun_us,
        "stuck": end.stuck,
    });
    files::write_json(args.json.json.as_deref(), "pong", &json)
}

fn config(args: &Args) -> Config {
    let (budget, period) = (options::ms(args.budget), options::ms(args.period));
    let high = if args.fifo {
        High::Fifo
    } else {
        High::Sporadic {
            budget,
            period,
            background: args.background,
        }
    };
    Config {
        agent: args.agent,
        spec: Spec {
            high,
            burst: options::ms(args.burst),
            low_sleep_percent: args.low_sleep,
            interval: INTERVAL,
            period,
        },
        cpu: args.cpu,
        monitor_cpu: args.monitor_cpu,
        strict: args.strict,
    }
}

fn print_threads(pong: &pong::Pong) {
    let mut table = Table::new(&["thread", "CPU", "requested", "granted"]);
    for t in pong.threads() {
        table.row([t.name, t.cpu, t.requested, t.granted]);
    }
    println!("{}", table.to_text());
}
