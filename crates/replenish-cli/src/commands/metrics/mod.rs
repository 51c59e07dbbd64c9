//! `replenish metrics`: the figures of this host's programs as OpenMetrics text, once or on a port.
//!
//! ```text
//!   files of programs ─► follow: callbacks, misses, drops since the look before
//!                     └► families: one of each metric ─► text: the format's rules
//!                          └► chains
//!   server: GET on a loopback address ─► the same text
//! ```

mod chains;
mod families;
mod follow;
mod server;
mod text;

use crate::outcome::Outcome;
use follow::Follower;
use std::net::{IpAddr, SocketAddr};

/// Options of `metrics`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Serve the text to `GET /metrics` on this loopback address, until SIGINT or SIGTERM; a port
    /// of 0 takes any free one.
    #[arg(long, value_name = "ADDRESS", value_parser = loopback)]
    listen: Option<SocketAddr>,

    /// Programs that were killed or have crashed, too.
    #[arg(long)]
    ended: bool,
}

/// The port of an address without one: that of OpenTelemetry's exporters for Prometheus.
const PORT: u16 = 9464;

/// `--listen 127.0.0.1:9464`: a client reads names and figures of programs, so the address
/// is of this host alone.
fn loopback(text: &str) -> Result<SocketAddr, String> {
    let bare = text.strip_prefix('[').and_then(|t| t.strip_suffix(']'));
    let host = || bare.unwrap_or(text).parse::<IpAddr>().ok();
    let address = text.parse().ok().or_else(|| Some((host()?, PORT).into()));
    address
        .filter(|address: &SocketAddr| address.ip().is_loopback())
        .ok_or_else(|| format!("allowed is a loopback address: 127.0.0.1:{PORT}, [::1]:{PORT}"))
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let mut follower = Follower::new(args.ended);
    let Some(address) = args.listen else {
        let found = follower.look();
        found.warnings.iter().for_each(|w| remark!("{w}"));
        print!(
            "{}",
            families::all(&found, &follower, families::Span::Recording)
        );
        return Ok(());
    };
    server::serve(address, &mut follower)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_loopback_addresses_are_listened_on() {
        for (text, meant) in [
            ("127.0.0.1", "127.0.0.1:9464"),
            ("127.0.0.2:0", "127.0.0.2:0"),
            ("[::1]", "[::1]:9464"),
            ("[::1]:7", "[::1]:7"),
        ] {
            assert_eq!(loopback(text), Ok(meant.parse().unwrap()), "{text}");
        }
        for text in [
            "0.0.0.0:9464",
            "[::]:1",
            "192.168.7.1:9464",
            "localhost",
            "9464",
            "",
        ] {
            let why = loopback(text).unwrap_err();
            assert!(why.contains("127.0.0.1:9464"), "{text}: {why}");
        }
    }
}
