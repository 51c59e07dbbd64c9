//! The bridge to DDS in a build without the feature `dds`: its options are refused by that name.

use crate::outcome::Failure;
use replenish_agent::AgentConfig;

/// The options, which this build does not have.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "ROS 2")]
pub(crate) struct Bridge {
    /// Make the clients' topics those of DDS, too: not in this build, which lacks the feature dds.
    #[arg(long, num_args = 0.., allow_hyphen_values = true)]
    dds: Option<Vec<String>>,
}

impl Bridge {
    /// Whether there is a bridge: this program has none.
    #[expect(
        clippy::unused_self,
        reason = "with the feature dds it depends on an option"
    )]
    pub(crate) fn is_on(&self) -> bool {
        false
    }

    /// Refuses `--dds`.
    pub(crate) fn add_to(&self, config: AgentConfig) -> Result<AgentConfig, Failure> {
        match self.dds {
            None => Ok(config),
            Some(_) => Err(Failure::Usage(
                "--dds: this program was built without the bridge to DDS; build it with the feature \
                 dds: cargo install replenish-cli, or in a clone cargo run --release -p \
                 replenish-cli -- agent --dds"
                    .into(),
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        bridge: Bridge,
    }

    #[test]
    fn the_bridge_is_refused_with_the_feature_that_brings_it() {
        let refusal = |line: &[&str]| {
            let line = Line::try_parse_from(line).unwrap();
            line.bridge.add_to(AgentConfig::default()).err()
        };
        assert_eq!(refusal(&["agent"]), None);
        let Some(Failure::Usage(why)) = refusal(&["agent", "--dds", "--interface", "all"]) else {
            panic!("not refused");
        };
        assert!(why.contains("feature dds"), "{why}");
    }
}
