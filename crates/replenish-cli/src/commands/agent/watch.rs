//! Looking after a running agent: the table, the JSON, the log, until it ends.

use super::log::Log;
use super::status::Status;
use super::view;
use crate::outcome::Outcome;
use crate::report::files;
use crate::signals::{Stop, Woken};
use crate::time::{MS, Nanos, SEC};
use replenish_agent::{Inspector, Limits, Snapshot, Stats};
use replenish_os::clock;
use serde_json::{Value, json};
use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::time::Duration;

/// How often the log is looked at.
const LOG: Nanos = 500 * MS;

/// How long the agent may take to say what it is doing.
const PATIENCE: Duration = Duration::from_secs(2);

/// Looks after an agent.
#[derive(Debug)]
pub(super) struct Watcher {
    pub(super) inspector: Inspector,
    /// Where it listens: what `address` has always been, and all.
    pub(super) address: String,
    pub(super) addresses: Vec<String>,
    pub(super) limits: Limits,
    /// Between two tables; `None`: only when asked.
    pub(super) every: Option<Nanos>,
    pub(super) json: Option<PathBuf>,
    /// Nothing for people: another process reads what this one says.
    pub(super) quiet: bool,
}

/// What a watcher knows at the end.
#[derive(Debug)]
pub(super) struct Seen {
    watcher: Watcher,
    log: Log,
    start: Nanos,
    last: Option<Snapshot>,
}

impl Watcher {
    /// Until `stop`.
    pub(super) fn watch(self, stop: &Stop) -> Seen {
        let start = clock::monotonic();
        let mut seen = Seen {
            watcher: self,
            log: Log::default(),
            start,
            last: None,
        };
        let every = seen.watcher.every;
        let mut table_at = every.map(|every| start + every);
        loop {
            let now = clock::monotonic();
            let next = table_at.map_or(now + LOG, |at| at.min(now + LOG));
            match stop.wait_or_asked(Duration::from_nanos(next.saturating_sub(now))) {
                Woken::Stopped => break,
                Woken::Asked => seen.refresh(true),
                Woken::Time => {}
            }
            seen.write_log();
            let now = clock::monotonic();
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

impl Seen {
    /// A table and the JSON; `all` rows and below what is there, or as much as a screen takes in
    /// the place of what is there.
    fn refresh(&mut self, all: bool) {
        let Some(now) = self.watcher.inspector.snapshot(PATIENCE) else {
            return;
        };
        let status = Status::new(&now, self.last.as_ref(), self.start);
        if !self.watcher.quiet {
            let mut out = std::io::stdout().lock();
            let clear = if !all && out.is_terminal() {
                "\x1b[H\x1b[2J"
            } else {
                ""
            };
            let text = format!("{clear}{}\n", view::tables(&status, all));
            // Nobody may listen any more; the agent serves its clients all the same.
            out.write_all(text.as_bytes())
                .and_then(|()| out.flush())
                .ok();
        }
        let json = self.json(&status, &now.stats);
        if let Err(failure) = files::replace_json(self.watcher.json.as_deref(), &json) {
            say(&failure.to_string());
        }
        self.last = Some(now);
    }

    /// The lines that are due.
    fn write_log(&mut self) {
        let rejections = self.watcher.inspector.rejections();
        let lines = self.log.lines(&rejections, clock::monotonic());
        self.say(&lines);
    }

    fn say(&self, lines: &[String]) {
        if !self.watcher.quiet {
            lines.iter().for_each(|line| say(line));
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
        files::replace_json(self.watcher.json.as_deref(), &json)
    }

    /// The JSON. The names are a contract.
    fn json(&self, status: &Status, stats: &Stats) -> Value {
        let Watcher {
            address,
            addresses,
            limits,
            ..
        } = &self.watcher;
        let uptime = clock::monotonic().saturating_sub(self.start) as f64 / 1e9;
        json!({
            "address": address,
            "addresses": addresses,
            "uptime_seconds": uptime,
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
            "refused": self.log.totals(),
            "stats": stats,
            "limits": {
                "clients": limits.clients,
                "entities": limits.entities,
                "streams": limits.streams,
                "message": limits.message,
                "sample": limits.sample,
                "queue_memory": limits.queued_bytes,
                "client_memory": limits.client_bytes,
                "depth": limits.max_depth,
                "rate": limits.datagrams_per_second,
                "strangers_rate": limits.unauthenticated_per_second,
                "silence_seconds": limits.silence as f64 / SEC as f64,
            },
        })
    }
}

/// One line of the log.
fn say(line: &str) {
    writeln!(std::io::stderr(), "agent: {line}").ok(); // there is nobody else to tell
}
