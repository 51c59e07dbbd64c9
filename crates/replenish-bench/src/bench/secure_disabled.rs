//! `replenish bench secure` in a build without the feature `secure`, which says so.

use replenish_cli::options::JsonOption;
use replenish_cli::outcome::{Failure, Outcome};

/// Options of `bench secure`, which this build does not have.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Round trips on each path, of each size.
    #[arg(long, value_name = "N")]
    samples: Option<u64>,

    #[command(flatten)]
    json: JsonOption,
}

/// Refuses.
pub(crate) fn run(_args: &Args) -> Outcome {
    Err(Failure::Usage(
        "bench secure: this program was built without encryption; build it with the feature \
         secure: cargo run --release --features secure -- bench secure"
            .into(),
    ))
}
