//! Option groups and value ranges that several commands share.
//!
//! Ranges are checked by clap, whose messages name the option and the range.

use crate::time::{MS, Nanos};
use clap::Args;
use clap::builder::RangedU64ValueParser;
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;

/// `--json PATH`, on every command.
#[derive(Debug, Clone, Args)]
pub struct JsonOption {
    /// Also write the result to this file, as JSON.
    #[arg(long, value_name = "PATH")]
    pub json: Option<PathBuf>,
}

/// Periods of budgets: long enough to enforce, short enough for the RT throttle (95 % of 1 s).
pub fn period() -> RangedU64ValueParser {
    clap::value_parser!(u64).range(2..=900)
}

/// Milliseconds of an option in nanoseconds.
pub fn ms(value: u64) -> Nanos {
    value.saturating_mul(MS)
}

/// `--last 5s`: a whole number of seconds or milliseconds, with its unit.
///
/// # Errors
/// The allowed form.
pub fn last(text: &str) -> Result<Nanos, String> {
    let number = |digits: &str, unit: Nanos| {
        let n = digits.parse::<u64>().ok().filter(|n| *n > 0);
        n.and_then(|n| n.checked_mul(unit))
    };
    let time = match text.strip_suffix("ms") {
        Some(ms) => number(ms, MS),
        None => text.strip_suffix('s').and_then(|s| number(s, 1000 * MS)),
    };
    time.ok_or_else(|| "allowed is a whole number above 0 with its unit: 5s, 200ms".into())
}

/// The port that stock agents use, and the one of an address without a port.
pub const AGENT_PORT: u16 = 8888;
/// The same of encrypted transports.
const ENCRYPTED_PORT: u16 = 8889;

/// `--udp 192.168.7.1:8888`: an address, with [`AGENT_PORT`] if it names none.
///
/// # Errors
/// The allowed forms.
pub fn address(text: &str) -> Result<SocketAddr, String> {
    address_or(text, AGENT_PORT)
}

/// `--dtls 192.168.7.1:8889`: an address, with port 8889 if it names none.
///
/// # Errors
/// The allowed forms.
pub fn encrypted_address(text: &str) -> Result<SocketAddr, String> {
    address_or(text, ENCRYPTED_PORT)
}

fn address_or(text: &str, port: u16) -> Result<SocketAddr, String> {
    if let Ok(address) = text.parse() {
        return Ok(address);
    }
    let bare = text.strip_prefix('[').and_then(|t| t.strip_suffix(']'));
    if let Ok(host) = bare.unwrap_or(text).parse::<IpAddr>() {
        return Ok((host, port).into());
    }
    let hint = match text.strip_prefix(':').unwrap_or(text).parse::<u16>() {
        Ok(alone) => format!("; for a port alone write 0.0.0.0:{alone} or 127.0.0.1:{alone}"),
        Err(_) => String::new(),
    };
    Err(format!(
        "allowed is an IP address, with a port or without one (then {port}): 192.168.7.1:{port}, \
         [::1]:{port}{hint}"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_a_unit() {
        assert_eq!(last("5s"), Ok(5_000 * MS));
        assert_eq!(last("200ms"), Ok(200 * MS));
        for wrong in ["5", "0s", "-1s", "s", "1.5s", "99999999999999999999s"] {
            assert!(last(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn an_address_without_a_port_has_the_agents() {
        for (text, meant) in [
            ("127.0.0.1", "127.0.0.1:8888"),
            ("127.0.0.1:7", "127.0.0.1:7"),
            ("::1", "[::1]:8888"),
            ("[::1]", "[::1]:8888"),
            ("[::1]:7", "[::1]:7"),
        ] {
            assert_eq!(address(text), Ok(meant.parse().unwrap()), "{text}");
        }
        assert!(address(":8888").unwrap_err().contains("0.0.0.0:8888"));
        for wrong in ["localhost", "127.0.0.1:99999", "", "1.2.3", "8888"] {
            let error = address(wrong).unwrap_err();
            assert!(error.contains("192.168.7.1:8888"), "{wrong}: {error}");
        }
    }
}
