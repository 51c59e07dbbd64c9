//! Options of `bench load`.

use replenish_cli::options::JsonOption;

/// Options of `bench load`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Clients.
    #[arg(long, value_name = "N", default_value_t = 64,
          value_parser = clap::value_parser!(u16).range(2..=256))]
    pub(super) clients: u16,

    /// Topics that each client writes, and reads.
    #[arg(long, value_name = "N", default_value_t = 8,
          value_parser = clap::value_parser!(u16).range(1..=32))]
    pub(super) topics: u16,

    /// Samples a second on each topic.
    #[arg(long, value_name = "HZ", default_value_t = 100,
          value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub(super) rate: u64,

    /// Duration of the load.
    #[arg(long, value_name = "N", default_value_t = 60,
          value_parser = clap::value_parser!(u64).range(1..=3600))]
    pub(super) seconds: u64,

    /// Bytes of a sample.
    #[arg(long, value_name = "BYTES", default_value_t = 32,
          value_parser = clap::value_parser!(u64).range(16..=400))]
    pub(super) bytes: u64,

    /// Threads that are the clients.
    #[arg(long, value_name = "N", default_value_t = 1,
          value_parser = clap::value_parser!(u16).range(1..=16))]
    pub(super) threads: u16,

    #[command(flatten)]
    pub(super) json: JsonOption,
}
