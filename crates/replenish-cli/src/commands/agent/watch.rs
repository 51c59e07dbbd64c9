//! Looking after a running agent: the table, the JSON, the log, until it ends.

use super::access::AccessFile;
use super::bridge_rows::BridgeLog;
use super::console::Console;
use super::log::Log;
use super::status::Status;
use super::view;
use crate::outcome::Outcome;
use crate::report::files;
use crate::signals::{Stop, Woken};
use crate::time::{MS, Nanos, SEC};
use replenish_agent::{Agent, Inspector, Limits, MemoryBound, Snapshot, Stats};
use replenish_os::{Policy, clock};
use serde_json::{Value, json};
use std::io::IsTerminal;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

/// Time between two looks at the log.
const LOG: Nanos = 500 * MS;

/// Time between two looks at the bridge for the log.
const BRIDGE: Nanos = 5 * SEC;

/// The longest wait for the agent's snapshot.
const PATIENCE: Duration = Duration::from_secs(2);

/// The longest wait at the end for a reader of standard output, and of standard error.
const LAST_WORDS: Duration = Duration::from_millis(500);

/// Looks after an agent.
#[derive(Debug)]
pub(super) struct Watcher {
    pub(super) inspector: Inspector,
    /// The address of the JSON field `address`, from before there were several.
    pub(super) address: String,
    pub(super) addresses: Vec<String>,
    pub(super) limits: Limits,
    /// The most memory of the process.
    pub(super) bound: MemoryBound,
    /// The clients that may log in.
    pub(super) access: Option<AccessFile>,
    /// Time between two tables; `None`: only when asked.
    pub(super) every: Option<Nanos>,
    pub(super) json: Option<PathBuf>,
    /// Prints nothing for people: another process reads the output.
    pub(super) quiet: bool,
    /// There is a bridge to DDS, whose events belong into the log.
    pub(super) bridged: bool,
    /// The policy that the agent's thread was given.
    pub(super) policy: String,
    pub(super) output: Console,
    pub(super) error: Console,
}

/// A watcher's findings at the end.
#[derive(Debug)]
pub(super) struct Seen {
    watcher: Watcher,
    log: Log,
    bridge: BridgeLog,
    start: Nanos,
    last: Option<Snapshot>,
}

impl Watcher {
    /// Says where it listens.
    pub(super) fn announce(&self, places: &[String], policy: &Policy) {
        let places = places.join(", ");
        let with = match policy {
            Policy::Other => String::new(),
            policy => format!(" with {policy}"),
        };
        self.output.write(format!(
            "agent listening at {places}{with}; end it with SIGINT or SIGTERM\n"
        ));
    }

    /// Says so when other hosts can reach it.
    pub(super) fn warn_of_strangers(&self, agent: &Agent) {
        let addresses = agent.udp_addrs().into_iter().chain(agent.tcp_addr());
        addresses
            .filter_map(|address| warning(address, self.access.is_some()))
            .for_each(|text| self.error.write(text));
    }

    /// Prints one line of the log.
    fn say(&self, line: &str) {
        self.error.write(format!("agent: {line}\n"));
    }

    /// Until `stop`.
    pub(super) fn watch(self, stop: &Stop) -> Seen {
        let start = clock::monotonic();
        let mut seen = Seen {
            watcher: self,
            log: Log::default(),
            bridge: BridgeLog::default(),
            start,
            last: None,
        };
        let every = seen.watcher.every;
        let mut bridge_at = start + BRIDGE;
        let mut table_at = every.map(|every| start + every);
        loop {
            let now = clock::monotonic();
            let next = table_at.map_or(now + LOG, |at| at.min(now + LOG));
            match stop.wait_or_asked(Duration::from_nanos(next.saturating_sub(now))) {
                Woken::Stopped => break,
                Woken::Asked => seen.refresh(true),
                Woken::Reload => seen.reload(),
                Woken::Time => {}
            }
            seen.write_log();
            let now = clock::monotonic();
            if seen.watcher.bridged && bridge_at <= now {
                seen.write_bridge_log();
                bridge_at = now + BRIDGE;
            }
            if let (Some(at), Some(every)) = (table_at, every)
                && at <= now
            {
                seen.refresh(false);
                table_at = Some(now.max(at + every));
            }
        }
        // Before the agent ends, and with it the sessions.
        seen.last = seen.watcher.inspector.snapshot(PATIENCE).or(seen.last);
        seen
    }
}

/// A text about a plain port that other hosts can reach.
fn warning(address: SocketAddr, listed: bool) -> Option<String> {
    let rights = if listed {
        "a host that knows a listed key can log in with it"
    } else {
        "any host that reaches it can read and write every topic (see --access)"
    };
    (!address.ip().is_loopback()).then(|| {
        format!(
            "note: {address} can be reached from other hosts, and XRCE knows no authentication: \
             {rights}\n"
        )
    })
}

impl Seen {
    /// A table and the JSON; `all` rows and below what is there, or as much as a screen takes in
    /// the place of what is there.
    fn refresh(&mut self, all: bool) {
        let Some(now) = self.watcher.inspector.snapshot(PATIENCE) else {
            return;
        };
        let status = Status::new(&now, self.last.as_ref(), self.start);
        if !self.watcher.quiet {
            let clear = if !all && std::io::stdout().is_terminal() {
                "\x1b[H\x1b[2J"
            } else {
                ""
            };
            let text = format!("{clear}{}\n", view::tables(&status, all));
            self.watcher.output.write(text);
        }
        let json = self.json(&status, &now.stats);
        if let Err(failure) = files::replace_json(self.watcher.json.as_deref(), "agent", &json) {
            self.watcher.say(&failure.to_string());
        }
        self.last = Some(now);
    }

    /// Reads the access list again.
    fn reload(&mut self) {
        let line = self.watcher.access.as_mut().map(AccessFile::reload);
        self.say(&line.into_iter().collect::<Vec<_>>());
    }

    /// The lines that are due.
    fn write_log(&mut self) {
        let rejections = self.watcher.inspector.rejections();
        let lines = self.log.lines(&rejections, clock::monotonic());
        self.say(&lines);
    }

    /// The lines about the bridge that are due.
    fn write_bridge_log(&mut self) {
        let snapshot = self.watcher.inspector.snapshot(PATIENCE);
        if let Some(rows) = snapshot.and_then(|snapshot| snapshot.bridge) {
            let now = clock::monotonic();
            let lines = self.bridge.lines(&rows, &mut self.log, now);
            self.say(&lines);
        }
    }

    fn say(&self, lines: &[String]) {
        if !self.watcher.quiet {
            lines.iter().for_each(|line| self.watcher.say(line));
        }
    }

    /// The last words, once the agent has ended with `stats`.
    pub(super) fn finish(mut self, stats: &Stats) -> Outcome {
        self.write_log();
        let rest = self.log.rest();
        self.say(&rest);
        let empty = Snapshot {
            at: clock::monotonic(),
            ..Snapshot::default()
        };
        let last = self.last.take().unwrap_or(empty);
        let status = Status::new(&last, None, self.start);
        let json = self.json(&status, stats);
        let outcome = files::replace_json(self.watcher.json.as_deref(), "agent", &json);
        if !self.watcher.quiet {
            self.watcher.output.write(format!(
                "{} sessions; {} samples in, {} out, {} dropped for want of room\n",
                stats.clients_created,
                stats.samples_in,
                stats.samples_out,
                stats.samples_dropped + stats.samples_refused
            ));
        }
        self.watcher.output.finish(LAST_WORDS);
        self.watcher.error.finish(LAST_WORDS);
        outcome
    }

    /// The JSON. The names are a contract.
    fn json(&self, status: &Status, stats: &Stats) -> Value {
        let Watcher {
            address,
            addresses,
            limits,
            bound,
            access,
            policy,
            output,
            error,
            ..
        } = &self.watcher;
        let uptime = clock::monotonic().saturating_sub(self.start) as f64 / 1e9;
        json!({
            "address": address,
            "addresses": addresses,
            "uptime_seconds": uptime,
            "policy": policy,
            "texts_dropped": output.lost() + error.lost(),
            "sessions": stats.clients_created,
            "datagrams_in": stats.datagrams_in,
            "datagrams_out": stats.datagrams_out,
            "malformed": stats.malformed,
            "samples_in": stats.samples_in,
            "samples_out": stats.samples_out,
            "samples_dropped": stats.samples_dropped + stats.samples_refused,
            "retransmitted": stats.retransmitted,
            "interval_seconds": status.interval_seconds,
            "queued_bytes": status.queued_bytes,
            "clients": status.clients,
            "topics": status.topics,
            "entities": status.entities,
            "bridge": status.bridge,
            "refused": self.log.totals(),
            "refusals": status.refusals,
            "access": access.as_ref().map(AccessFile::json),
            "stats": stats,
            "limits": {
                "clients": limits.clients,
                "entities": limits.entities,
                "streams": limits.streams,
                "message": limits.message,
                "sample": limits.sample,
                "memory": limits.memory(),
                "client_memory": limits.client_bytes,
                "process_memory": bound.total(),
                "depth": limits.max_depth,
                "rate": limits.datagrams_per_second,
                "strangers_rate": limits.unauthenticated_per_second,
                "reflection": limits.reflection,
                "patience_seconds": limits.writer_block_limit.map(|ns| ns as f64 / SEC as f64),
                "silence_seconds": limits.silence as f64 / SEC as f64,
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plain_port_that_other_hosts_reach_is_warned_of() {
        let at = |text: &str| text.parse().unwrap();
        for loopback in ["127.0.0.1:8888", "[::1]:8888"] {
            assert_eq!(warning(at(loopback), false), None);
        }
        for open in ["0.0.0.0:8888", "[::]:8888", "192.168.7.1:8888"] {
            let text = warning(at(open), false).unwrap();
            assert!(text.contains(open) && text.contains("every topic (see --access)"));
            let text = warning(at(open), true).unwrap();
            assert!(text.contains("a listed key"), "{text}");
        }
    }
}
