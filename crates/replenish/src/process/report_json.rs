//! A report as JSON, for programs. Its schema is `docs/schemas/report.json`; the command's tests
//! hold it to that. Written by hand: ten lines of writing are less than a dependency on `serde`.

use crate::chain::ChainReport;
use crate::executor::{HandleReport, Report, ThreadReport};
use crate::histogram::Histogram;
use std::fmt::{Display, Write};

/// The version of the document. It grows when a name or a meaning changes, not when one is added.
const VERSION: u32 = 1;

impl Report {
    /// The report as a JSON document of one line: `docs/schemas/report.json` is its schema, times
    /// are nanoseconds. It allocates; call it where [`Display`] would do.
    #[must_use]
    pub fn to_json(&self) -> String {
        object(|o| {
            o.text("document", "report").number("version", VERSION);
            o.number("elapsed_ns", self.elapsed);
            o.list("threads", &self.threads, thread);
            o.list("handles", &self.handles, handle);
            o.list("rounds", &self.rounds, |rounds| {
                object(|o| {
                    o.text("worker", &rounds.worker);
                    o.number("served", rounds.stats.served);
                    o.number("skipped", rounds.stats.skipped);
                })
            });
            o.list("chains", &self.chains, chain);
            let dispatcher = object(|o| {
                o.number("rounds", self.dispatcher.rounds);
                o.number("samples", self.dispatcher.samples);
                o.number("failures", self.dispatcher.failures);
            });
            o.number("dispatcher", dispatcher);
            o.list("enforcers", &self.enforcers, |enforcer| {
                object(|o| {
                    o.number("wakes", enforcer.wakes);
                    o.number("idle_wakes", enforcer.idle_wakes);
                    o.number("changes", enforcer.changes);
                    o.number("refused", enforcer.refused);
                    o.number("faults", enforcer.faults);
                    o.number("cpu_ns", enforcer.cpu);
                })
            });
            let notes = self.admission.notes.iter().map(ToString::to_string);
            let notes: Vec<String> = notes.chain(self.admission.additions()).collect();
            o.list("fallbacks", &self.fallbacks, quoted);
            o.list("notes", &notes, quoted);
            o.list("stuck", &self.stuck, quoted);
        })
    }
}

fn thread(t: &ThreadReport) -> String {
    object(|o| {
        o.text("name", &t.name).text("requested", &t.requested);
        o.text("granted", &t.granted).option("cpu", t.cpu);
        o.option("enforcement", t.enforcement.map(|e| quoted(&e)));
        o.number("cpu_high_ns", t.usage.cpu_high);
        o.number("cpu_background_ns", t.usage.cpu_low);
        o.number("available_ns", t.usage.available);
        o.number("in_background", t.usage.low);
        o.number("exhaustions", t.usage.exhaustions);
        o.number("replenishments", t.usage.replenishments);
        o.number("blocked_inside", t.usage.blocked_inside);
        let overruns = object(|o| {
            o.number("count", t.overruns.count);
            o.number("median_ns", t.overruns.median);
            o.number("p99_ns", t.overruns.p99);
            o.number("max_ns", t.overruns.max);
            o.number("stalls", t.overruns.stalls);
        });
        o.number("overruns", overruns);
    })
}

fn handle(h: &HandleReport) -> String {
    let s = &h.stats;
    object(|o| {
        o.text("id", &h.id).text("worker", &h.worker);
        o.number("received", s.received);
        o.number("dropped", s.dropped);
        o.number("oversize", s.oversize);
        o.number("undecodable", s.undecodable);
        o.number("discarded", s.discarded);
        o.number("waiting", s.waiting);
        o.number("lost", s.lost);
        o.number("executed", s.executed);
        o.number("without_input", s.without_input);
        o.number("errors", s.errors);
        o.number("panicked", s.panicked);
        o.number("skipped", s.skipped);
        o.number("deadline_misses", s.deadline_misses);
        o.number("exhaustions", s.exhaustions);
        o.number("cpu_high_ns", s.cpu_high);
        o.number("cpu_background_ns", s.cpu_background);
        o.number("worst_latency_ns", s.worst_latency);
        o.number("worst_execution_ns", s.worst_execution);
        o.number("worst_lateness_ns", s.worst_lateness);
        o.number("memory_bytes", h.memory);
        o.number("latency_ns", histogram(&h.latency));
        o.number("response_ns", histogram(&h.response));
        o.option("matched", h.matched);
        o.option("last_error", h.last_error.as_ref().map(quoted));
    })
}

fn chain(c: &ChainReport) -> String {
    object(|o| {
        o.text("name", &c.name);
        o.list("stages", &c.stages, quoted);
        o.option("limit_ns", c.limit).option("bound_ns", c.bound);
        o.number("begun", c.begun).number("ended", c.ended);
        o.number("exceeded", c.exceeded);
        o.number("latency_ns", histogram(&c.latency));
        let worst = c.worst.map(|worst| {
            object(|o| {
                o.number("origin_ns", worst.origin);
                o.number("latency_ns", worst.latency);
            })
        });
        o.option("worst", worst);
    })
}

fn histogram(h: &Histogram) -> String {
    object(|o| {
        o.number("count", h.count());
        for (name, percent) in [("p50", 50), ("p90", 90), ("p99", 99)] {
            o.number(name, h.percentile(percent));
        }
    })
}

/// An object that is being written.
struct Object(String);

/// The object that `fill` writes.
fn object(fill: impl FnOnce(&mut Object)) -> String {
    let mut object = Object(String::from("{"));
    fill(&mut object);
    object.0.push('}');
    object.0
}

impl Object {
    /// A value that is JSON as it prints: a number, a truth value, another object.
    fn number(&mut self, name: &str, value: impl Display) -> &mut Self {
        let comma = if self.0.len() > 1 { "," } else { "" };
        write!(self.0, "{comma}\"{name}\":{value}").ok();
        self
    }

    fn text(&mut self, name: &str, value: &(impl ToString + ?Sized)) -> &mut Self {
        let value = quoted(value);
        self.number(name, value)
    }

    fn option(&mut self, name: &str, value: Option<impl ToString>) -> &mut Self {
        let value = value.map_or_else(|| String::from("null"), |value| value.to_string());
        self.number(name, value)
    }

    fn list<T>(&mut self, name: &str, all: &[T], one: impl Fn(&T) -> String) -> &mut Self {
        let all: Vec<String> = all.iter().map(one).collect();
        self.number(name, format_args!("[{}]", all.join(",")))
    }
}

/// A text as JSON (RFC 8259, 7).
fn quoted(text: &(impl ToString + ?Sized)) -> String {
    let mut quoted = String::from("\"");
    for c in text.to_string().chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if u32::from(c) < 0x20 => {
                write!(quoted, "\\u{:04x}", u32::from(c)).ok();
            }
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}
