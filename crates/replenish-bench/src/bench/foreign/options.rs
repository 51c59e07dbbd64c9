//! Options of all measurements of foreign programs.

use replenish_cli::machine::cpus::{self, Cpus};
use replenish_cli::options::JsonOption;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::files;

/// Options of each measurement.
#[derive(Debug, clap::Args)]
pub(crate) struct Options {
    /// Windows of each case. A window in which CPU time was stolen is repeated.
    #[arg(long, value_name = "N", default_value_t = 5,
          value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(super) windows: u32,

    /// The CPU of the foreign programs.
    #[arg(long, value_name = "CPU")]
    cpu: Option<usize>,

    #[command(flatten)]
    json: JsonOption,
}

impl Options {
    /// The CPU of the programs, and another one for everything else.
    pub(super) fn cpus(&self) -> Result<Cpus, Failure> {
        cpus::check("--cpu", self.cpu)?;
        files::check_writable(self.json.json.as_deref())?;
        let chosen = Cpus::choose();
        let cpus = Cpus {
            measured: self.cpu.unwrap_or(chosen.measured),
            ..chosen
        };
        if cpus.is_single() {
            return Err(Failure::refused(
                "two CPUs are needed, one for the programs",
            ));
        }
        Ok(cpus)
    }

    pub(super) fn write<T: serde::Serialize>(&self, document: &str, value: &T) -> Outcome {
        files::write_json(self.json.json.as_deref(), document, value)
    }
}
