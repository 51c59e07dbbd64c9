//! `replenish ping`: ping alone.

use crate::options;
use crate::roles::ping::{self, Config, Totals};
use crate::roles::protocol::Event;
use crate::roles::supervised::{self, SharedGrid};
use replenish_cli::machine::cpus;
use replenish_cli::options::{JsonOption, address};
use replenish_cli::outcome::Outcome;
use replenish_cli::report::files;
use replenish_cli::signals::Stop;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

/// Options of `ping`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The agent's address.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8888", value_parser = address)]
    agent: SocketAddr,

    /// Milliseconds between two messages of one topic.
    #[arg(long, value_name = "MS", default_value_t = 10,
          value_parser = clap::value_parser!(u64).range(1..=10_000))]
    interval: u64,

    /// Send a pair, with its number, for each message on topic `tick` instead: the clock of a
    /// board, whose time is not that of this machine.
    #[arg(long, conflicts_with = "interval")]
    ticked: bool,

    /// Messages of the low topic on top of each pair.
    #[arg(long, value_name = "N", default_value_t = 0, requires = "ticked",
          value_parser = clap::value_parser!(u32).range(0..=100))]
    flood: u32,

    /// Also send back what comes on topics `sure` (reliable) and `loose` (best effort), on
    /// `sure_back` and `loose_back`.
    #[arg(long, requires = "ticked")]
    echo: bool,

    /// Stop after this time instead of at SIGINT or SIGTERM.
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..=86_400))]
    seconds: Option<u64>,

    /// The CPU of its threads.
    #[arg(long, value_name = "CPU")]
    cpu: Option<usize>,

    #[command(flatten)]
    json: JsonOption,

    #[arg(long, hide = true)]
    supervised: bool,
}

/// Runs ping.
pub(crate) fn run(args: &Args) -> Outcome {
    cpus::check("--cpu", args.cpu)?;
    files::check_writable(args.json.json.as_deref())?;
    let stop = Stop::on_signals()?;
    let grid = SharedGrid::default();
    let config = Config {
        agent: args.agent,
        interval: options::ms(args.interval),
        cpu: args.cpu,
        supervised: args.supervised,
        ticked: args.ticked,
        flood: args.flood,
        echo: args.echo,
    };
    if args.supervised {
        supervised::listen(SharedGrid::clone(&grid), stop.clone());
    }
    let ping = ping::start(&config, &grid, &stop)?;
    if args.supervised {
        supervised::emit(&Event::Ready(ping.ready()));
        stop.wait_forever();
    } else {
        let pace = if args.ticked {
            "for each tick".to_string()
        } else {
            format!("every {} ms", args.interval)
        };
        println!("sending high_ping and low_ping {pace} to {}", args.agent);
        let end = args
            .seconds
            .map(|s| Instant::now() + Duration::from_secs(s));
        let mut before = Totals::default();
        while !stop.wait(Duration::from_secs(1)) {
            let now = ping.totals();
            println!("{}", line(&before, &now));
            before = now;
            if end.is_some_and(|end| Instant::now() >= end) {
                stop.trigger();
            }
        }
    }
    let totals = ping.end()?;
    if !args.supervised {
        println!("in total: {}", line(&Totals::default(), &totals));
    }
    files::write_json(args.json.json.as_deref(), "ping", &totals)
}

fn line(before: &Totals, now: &Totals) -> String {
    let topic = |n: usize, name: &str| {
        let delta = |now: &[u64; 2], before: &[u64; 2]| match (now.get(n), before.get(n)) {
            (Some(now), Some(before)) => now.saturating_sub(*before),
            _ => 0,
        };
        let (sent, answered) = (
            delta(&now.sent, &before.sent),
            delta(&now.answered, &before.answered),
        );
        format!("{name} {sent} sent, {answered} answered")
    };
    let failed = match now.failed.saturating_sub(before.failed) {
        0 => String::new(),
        n => format!("; {n} could not be sent"),
    };
    format!("{}; {}{failed}", topic(0, "high"), topic(1, "low"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_tells_what_happened_since_the_last_one() {
        let before = Totals {
            sent: [10, 20],
            answered: [1, 2],
            failed: 0,
            echoed: None,
        };
        let now = Totals {
            sent: [110, 120],
            answered: [31, 72],
            failed: 3,
            echoed: None,
        };
        assert_eq!(
            line(&before, &now),
            "high 100 sent, 30 answered; low 100 sent, 70 answered; 3 could not be sent"
        );
    }
}
