//! `replenish bench xrce`: what a bad link costs the reliable streams, in virtual time.
//!
//! Client and agent use the same stream machines; here a sender and a receiver of them talk over a
//! link that loses, duplicates and delays. Next to it: the same sender, but answering each gap with
//! everything unacknowledged, as the stock client does.

use crate::lossy;
use replenish_cli::options::JsonOption;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::files;
use replenish_cli::report::table::Table;

/// Options of `bench xrce`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Datagrams lost in either direction, in percent, 0 to 90; several with commas.
    #[arg(long, value_name = "PERCENT", value_delimiter = ',', default_value = "0,1,10",
          value_parser = clap::value_parser!(u8).range(0..=90))]
    loss: Vec<u8>,

    /// Samples at each point, 16 to 300 bytes, every five-hundredth of 50 kB.
    #[arg(long, value_name = "N", default_value_t = lossy::SAMPLES,
          value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    samples: u32,

    /// The same seed gives the same figures.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,

    #[command(flatten)]
    json: JsonOption,
}

/// One of `points`. The names are a contract.
#[derive(Debug, serde::Serialize)]
struct Point {
    loss_percent: u8,
    sent: u64,
    delivered: u64,
    duplicated: u64,
    lost: u64,
    messages_per_second: f64,
    retransmitted_bytes: u64,
    go_back_n_bytes: u64,
}

impl From<lossy::Point> for Point {
    fn from(point: lossy::Point) -> Self {
        Self {
            loss_percent: point.loss_percent,
            sent: point.sent,
            delivered: point.delivered,
            duplicated: point.duplicated,
            lost: point.lost,
            messages_per_second: point.messages_per_second,
            retransmitted_bytes: point.retransmitted_bytes,
            go_back_n_bytes: point.go_back_n_bytes,
        }
    }
}

impl Point {
    fn is_whole(&self) -> bool {
        self.delivered == self.sent && self.duplicated == 0 && self.lost == 0
    }
}

/// `bench xrce --json`. The names are a contract.
#[derive(Debug, serde::Serialize)]
struct Json {
    samples: u32,
    seed: u64,
    points: Vec<Point>,
}

/// Runs the benchmark.
pub(crate) fn run(args: &Args) -> Outcome {
    files::check_writable(args.json.json.as_deref())?;
    let mut table = Table::new(&[
        "loss",
        "sent",
        "delivered",
        "twice",
        "lost",
        "messages/s",
        "sent again (bytes)",
        "go-back-N",
    ]);
    let mut points = Vec::new();
    for loss in &args.loss {
        let point = Point::from(lossy::point(*loss, args.samples, args.seed));
        table.row([
            format!("{loss} %"),
            point.sent.to_string(),
            point.delivered.to_string(),
            point.duplicated.to_string(),
            point.lost.to_string(),
            format!("{:.0}", point.messages_per_second),
            point.retransmitted_bytes.to_string(),
            point.go_back_n_bytes.to_string(),
        ]);
        points.push(point);
    }
    println!(
        "{}  virtual time: 1 to 5 ms each way, 1 % of the datagrams arrive twice",
        table.to_text()
    );
    let json = Json {
        samples: args.samples,
        seed: args.seed,
        points,
    };
    files::write_json(args.json.json.as_deref(), "bench-xrce", &json)?;
    match json.points.iter().find(|point| !point.is_whole()) {
        Some(point) => Err(Failure::refused(format!(
            "at {} % loss {} of {} samples were delivered, {} twice, {} lost",
            point.loss_percent, point.delivered, point.sent, point.duplicated, point.lost
        ))),
        None => Ok(()),
    }
}
