//! The options that `run` and `adopt` share.

use super::rules::{Amount, Asked, Background, Rule};
use crate::options::JsonOption;
use crate::outcome::Failure;
use std::path::PathBuf;

/// Share of a CPU that all budgets on it may have together, in percent: the kernel keeps the rest
/// of every second from real-time threads.
const MOST: u64 = 95;

/// Budgets and where they apply.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Options {
    /// One budget for all threads that no --thread names: CPU time in every period, as in
    /// 30ms/100ms; @70 behind it is its priority.
    #[arg(long, value_name = "TIME/PERIOD")]
    pub(super) budget: Option<Amount>,

    /// A budget for the threads of this name, which they share: 'dds.*=2ms/10ms'. `*` stands for
    /// any characters, `?` for one; tid:4711 is one thread. The first that fits counts.
    #[arg(
        long = "thread",
        value_name = "PATTERN=TIME/PERIOD",
        value_delimiter = ','
    )]
    pub(super) threads: Vec<Rule>,

    /// Take the budgets of a `[[program]]` from this deployment file: the first one whose `match`
    /// fits the program's name or its command line.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["budget", "threads"])]
    pub(crate) deployment: Option<PathBuf>,

    /// Take this program of the deployment file, whatever its `match`.
    #[arg(
        long = "program",
        id = "described",
        value_name = "NAME",
        requires = "deployment"
    )]
    pub(crate) described: Option<String>,

    /// FIFO priority of a thread that has budget left.
    #[arg(long, value_name = "N", default_value_t = 50,
          value_parser = clap::value_parser!(u8).range(1..=98))]
    pub(super) priority: u8,

    /// Without budget: `idle` (when nothing else wants the CPU), `other` (time-sharing), a FIFO
    /// priority below --priority, or `suspend` (not at all; needs control groups of version 2).
    #[arg(long, value_name = "CLASS", default_value_t = Background::IDLE)]
    pub(crate) background: Background,

    /// CPU of all threads that get a budget; a program that is started begins there. Default: the
    /// last one that this process may use.
    #[arg(long, value_name = "CPU")]
    pub(crate) cpu: Option<usize>,

    /// For how long, in seconds. A program that was started is ended then.
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u64).range(1..=31_536_000))]
    pub(crate) seconds: Option<u64>,

    #[command(flatten)]
    pub(crate) json: JsonOption,
}

impl Options {
    /// The budgets of the command line in the order in which they count; `--budget` is the last.
    pub(super) fn asked(&self) -> Result<Vec<Asked>, Failure> {
        let mut rules = self.threads.clone();
        rules.extend(self.budget.map(|amount| Rule {
            pattern: "*".into(),
            amount,
        }));
        if rules.is_empty() {
            return Err(Failure::Usage(
                "no budget: give --budget TIME/PERIOD, --thread PATTERN=TIME/PERIOD, or both; or \
                 --deployment FILE"
                    .into(),
            ));
        }
        let share = |rule: &Rule| rule.amount.amount as f64 * 100.0 / rule.amount.period as f64;
        let sum: f64 = rules.iter().map(share).sum();
        if sum > MOST as f64 {
            return Err(Failure::Usage(format!(
                "the budgets ask for {sum:.1} % of one CPU together: allowed is {MOST} %, the rest \
                 of every second is not the kernel's to give to real-time threads"
            )));
        }
        let asked = rules.iter();
        asked
            .map(|rule| rule.asked(self.priority, self.background))
            .collect()
    }
}
