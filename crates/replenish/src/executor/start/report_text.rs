//! A report for people: a table of threads, a table of handles, and a line for everything that
//! needs a sentence. Services without a request share one line.

use super::report::{HandleReport, Report, ThreadReport};
use super::table::Table;
use crate::Nanos;
use alloc::format;
use alloc::string::{String, ToString};
use core::fmt;

const MS: Nanos = 1_000_000;
const US: Nanos = 1_000;

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for line in &self.fallbacks {
            writeln!(f, "not guaranteed: {line}")?;
        }
        for line in &self.admission.notes {
            writeln!(f, "note: {line}")?;
        }
        write!(f, "{}", threads(self))?;
        for line in self.admission.additions() {
            writeln!(f, "{line}")?;
        }
        write!(f, "{}", handles(self))?;
        idle_services(self, f)?;
        memory(self, f)?;
        chains(self, f)?;
        for rounds in &self.rounds {
            writeln!(f, "{rounds}")?;
        }
        for name in &self.stuck {
            writeln!(
                f,
                "stuck: {name} did not end in time; demoted and left behind"
            )?;
        }
        Ok(())
    }
}

fn threads(report: &Report) -> Table<7> {
    let mut table = Table::new(
        3,
        [
            "thread",
            "requested",
            "granted",
            "high ms",
            "background ms",
            "exhausted",
            "overrun us p50/p99",
        ],
    );
    for t in &report.threads {
        let overrun = match t.overruns.count {
            0 => String::from("-"),
            _ => format!("{}/{}", t.overruns.median / 1000, t.overruns.p99 / 1000),
        };
        let cells = [
            t.name.clone(),
            t.requested.to_string(),
            t.granted.to_string(),
            (t.usage.cpu_high / MS).to_string(),
            (t.usage.cpu_low / MS).to_string(),
            t.usage.exhaustions.to_string(),
            overrun,
        ];
        table.add(cells, "");
    }
    table
}

/// The handles whose samples take a megabyte or more.
fn memory(report: &Report, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    for h in report.handles.iter().filter(|h| h.memory >= 1_000_000) {
        let (mega, tenth) = (h.memory / 1_000_000, h.memory / 100_000 % 10);
        writeln!(f, "memory: {mega}.{tenth} MB for samples of {}", h.id)?;
    }
    Ok(())
}

/// Whether this is a service without any request.
fn is_idle_service(handle: &HandleReport) -> bool {
    let s = &handle.stats;
    handle.id.contains("/srv:") && s.received == 0 && unserved(handle) == 0 && s.errors == 0
}

/// Samples and releases that came to no callback.
fn unserved(handle: &HandleReport) -> u64 {
    let s = &handle.stats;
    s.dropped + s.oversize + s.undecodable + s.discarded + s.lost + s.skipped
}

fn handles(report: &Report) -> Table<8> {
    let mut table = Table::new(
        1,
        [
            "handle",
            "received",
            "executed",
            "not run",
            "errors",
            "late",
            "latency us p50/p99/worst",
            "CPU us worst",
        ],
    );
    for h in report.handles.iter().filter(|h| !is_idle_service(h)) {
        let s = &h.stats;
        let latency = match h.latency.count() {
            0 => (s.worst_latency / US).to_string(),
            _ => {
                let at = |percent| h.latency.percentile(percent).min(s.worst_latency) / US;
                format!("{}/{}/{}", at(50), at(99), s.worst_latency / US)
            }
        };
        let cells = [
            h.id.clone(),
            s.received.to_string(),
            s.executed.to_string(),
            unserved(h).to_string(),
            s.errors.to_string(),
            s.deadline_misses.to_string(),
            latency,
            (s.worst_execution / US).to_string(),
        ];
        table.add(cells, if s.panicked { "panicked" } else { "" });
    }
    table
}

/// One line for each chain: in times, as a handle's latency.
fn chains(report: &Report, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    for c in &report.chains {
        let worst = c.worst.map_or(0, |worst| worst.latency);
        let at = |percent| c.latency.percentile(percent).min(worst) / US;
        write!(f, "chain {:?}: {} of {} ended, ", c.name, c.ended, c.begun)?;
        write!(f, "us p50/p99/worst {}/{}/{}", at(50), at(99), worst / US)?;
        if let Some(bound) = c.bound {
            write!(f, ", bound {}", bound / US)?;
        }
        if let Some(limit) = c.limit {
            write!(f, ", {} beyond the limit of {}", c.exceeded, limit / US)?;
        }
        writeln!(f)?;
    }
    Ok(())
}

/// One line per worker for its services without any request.
fn idle_services(report: &Report, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let mut before = "no request: ";
    for ThreadReport { name, .. } in &report.threads {
        let idle = |h: &&HandleReport| h.worker == *name && is_idle_service(h);
        let mut services = report.handles.iter().filter(idle);
        let Some(first) = services.next() else {
            continue;
        };
        match services.count() {
            0 => write!(f, "{before}{}", first.id)?,
            others => write!(f, "{before}{} services of {name}", others + 1)?,
        }
        before = ", ";
    }
    if before == ", " {
        writeln!(f)?;
    }
    Ok(())
}
