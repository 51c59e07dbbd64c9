//! The metrics of chains, which a recording counts from the start of its program on.

use super::text::{Labels, Text, seconds};
use replenish_recorder::{ChainView, bucket_end};

/// The labels of a program, and its chains.
pub(super) type OfProgram<'a> = ([(&'a str, &'a str); 2], &'a [ChainView]);

/// A metric of chains: name, kind, unit, help, value; `None` leaves the chain out.
type OfChain = (
    &'static str,
    &'static str,
    &'static str,
    &'static str,
    fn(&ChainView) -> Option<String>,
);

const CHAINS: [OfChain; 6] = [
    ("begun", "counter", "", "Instances that have begun.", |c| {
        Some(c.begun.to_string())
    }),
    ("ended", "counter", "", "Instances that have ended.", |c| {
        Some(c.ended.to_string())
    }),
    (
        "exceeded",
        "counter",
        "",
        "Ended instances that took longer than the limit.",
        |c| c.limit.map(|_| c.exceeded.to_string()),
    ),
    (
        "limit_seconds",
        "gauge",
        "seconds",
        "The longest latency that is allowed.",
        |c| c.limit.map(seconds),
    ),
    (
        "bound_seconds",
        "gauge",
        "seconds",
        "The analysed bound.",
        |c| c.bound.map(seconds),
    ),
    (
        "worst_latency_seconds",
        "gauge",
        "seconds",
        "The longest latency since the start.",
        |c| c.worst.map(|(_, latency)| seconds(latency)),
    ),
];

/// Every fourth bucket of a recording ends an octave.
const OCTAVE: usize = 4;

pub(super) fn of_chains(programs: &[OfProgram<'_>], text: &mut Text) {
    for (name, kind, unit, help, value) in CHAINS {
        text.family(&format!("replenish_chain_{name}"), kind, unit, help);
        let suffix = if kind == "counter" { "_total" } else { "" };
        each(programs, text, |labels, chain, text| {
            if let Some(value) = value(chain) {
                text.sample(suffix, labels, &value);
            }
        });
    }
    let help = "From the origin of an instance to the end of its last stage.";
    text.family(
        "replenish_chain_latency_seconds",
        "histogram",
        "seconds",
        help,
    );
    each(programs, text, |labels, chain, text| {
        let mut below: u64 = 0;
        for (n, own) in chain.histogram.iter().enumerate() {
            below = below.saturating_add(*own);
            let end = bucket_end(n);
            let bound = match (n % OCTAVE, end) {
                (_, u64::MAX) => "+Inf".into(),
                (0, end) => seconds(end),
                _ => continue,
            };
            let labels = [labels, &[("le", bound.as_str())]].concat();
            text.sample("_bucket", &labels, &below.to_string());
        }
        text.sample("_count", labels, &below.to_string());
        text.sample("_sum", labels, &seconds(chain.sum));
    });
}

/// Each chain once, with its labels.
fn each(
    programs: &[OfProgram<'_>],
    text: &mut Text,
    mut write: impl FnMut(&Labels<'_>, &ChainView, &mut Text),
) {
    for ([name, pid], chains) in programs {
        for chain in *chains {
            let labels = [*name, *pid, ("chain", &*chain.name)];
            if text.is_new(&labels) {
                write(&labels, chain, text);
            }
        }
    }
}
