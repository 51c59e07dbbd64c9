//! Options of `bench soak`.

use replenish_cli::options::JsonOption;
use std::net::SocketAddr;

/// Options of `bench soak`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Samples. Fewer are written if `--seconds` are over before.
    #[arg(long, value_name = "N", default_value_t = 100_000,
          value_parser = clap::value_parser!(u32).range(100..=10_000_000))]
    pub(super) samples: u32,

    /// The longest run in seconds, besides the time that the faults take.
    #[arg(long, value_name = "N", default_value_t = 600,
          value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub(super) seconds: u64,

    /// The same seed damages the same datagrams of each direction.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub(super) seed: u64,

    /// The faults, in this order; between two of them an equal part of the samples is written.
    #[arg(
        long,
        value_name = "FAULTS",
        value_delimiter = ',',
        default_value = "agent,stall,reader,agent,publisher,stall,agent,stall,reader,agent,\
                           publisher,stall,agent,stall"
    )]
    pub(super) faults: Vec<Fault>,

    /// Standstill of the reader in a stall, in milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 5000,
          value_parser = clap::value_parser!(u64).range(1..=25_000))]
    pub(super) stall: u64,

    /// Datagrams lost in either direction, in percent.
    #[arg(long, value_name = "PERCENT", default_value_t = 10,
          value_parser = clap::value_parser!(u8).range(0..=50))]
    pub(super) loss: u8,

    #[command(flatten)]
    pub(super) json: JsonOption,

    /// The part of the soak that this process plays, if the soak started the process.
    #[arg(long, hide = true, requires = "at")]
    pub(super) part: Option<Part>,

    /// The agent's address.
    #[arg(long, hide = true)]
    pub(super) at: Option<SocketAddr>,

    /// Its key: a part that starts again takes the session of the one before.
    #[arg(long, hide = true, default_value_t = 1)]
    pub(super) key: u8,

    /// The number of the first sample.
    #[arg(long, hide = true, default_value_t = 0)]
    pub(super) first: u32,
}

/// A fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Fault {
    /// The agent is killed.
    Agent,
    /// The publisher is killed.
    Publisher,
    /// The other reader is killed.
    Reader,
    /// The reader is stopped, and goes on.
    Stall,
}

/// One of the soak's processes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Part {
    /// Writes samples.
    Publisher,
    /// Reads them.
    Reader,
}
