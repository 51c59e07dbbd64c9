//! The file as it is written: names, types and places; `parse` decides what it means.

use crate::{Nanos, guarantee, span};
use replenish_sim::Span;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::fmt;
use toml::Spanned;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct File {
    #[serde(default)]
    pub(super) machine: Machine,
    #[serde(default)]
    pub(super) executor: Executor,
    #[serde(default)]
    pub(super) worker: Vec<Worker>,
    #[serde(default)]
    pub(super) chain: Vec<Chain>,
    #[serde(default)]
    pub(super) program: Vec<Program>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Machine {
    pub(super) cpus: Option<Spanned<Cpus>>,
    pub(super) priorities: Option<Spanned<[u8; 2]>>,
    pub(super) enforcer_priority: Option<Spanned<u8>>,
    pub(super) real_time_share: Option<Spanned<f64>>,
    #[serde(default)]
    pub(super) overheads: Overheads,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Overheads {
    pub(super) context_switch: Option<Spanned<Time>>,
    pub(super) callback: Option<Spanned<Time>>,
    pub(super) dispatch: Option<Spanned<Time>>,
    pub(super) release_interrupt: Option<Spanned<Time>>,
    pub(super) latency: Option<Spanned<Time>>,
    pub(super) enforcement: Option<Spanned<Time>>,
    pub(super) slack: Option<Spanned<Time>>,
    pub(super) min_rearm: Option<Spanned<Time>>,
    pub(super) max_backoff: Option<Spanned<Time>>,
}

impl Overheads {
    /// All of them, in the order of [`crate::Overheads::NAMES`].
    pub(super) fn all(&self) -> [&Option<Spanned<Time>>; 9] {
        [
            &self.context_switch,
            &self.callback,
            &self.dispatch,
            &self.release_interrupt,
            &self.latency,
            &self.enforcement,
            &self.slack,
            &self.min_rearm,
            &self.max_backoff,
        ]
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Executor {
    pub(super) cpu: Option<Spanned<usize>>,
    pub(super) policy: Option<Spanned<Policy>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Worker {
    pub(super) name: Spanned<String>,
    #[serde(default)]
    pub(super) handles: Vec<Spanned<String>>,
    pub(super) cpu: Option<Spanned<usize>>,
    pub(super) guarantee: Option<Spanned<Guarantee>>,
    pub(super) policy: Option<Spanned<Policy>>,
    pub(super) deadline: Option<Spanned<Time>>,
    pub(super) runs: Option<Spanned<Times>>,
    pub(super) blocks: Option<Spanned<Times>>,
    pub(super) releases: Option<Spanned<Releases>>,
    pub(super) queue: Option<Spanned<usize>>,
    pub(super) overflow: Option<Overflow>,
    #[serde(default)]
    pub(super) sends: Vec<Spanned<String>>,
    #[serde(default)]
    pub(super) locks: Vec<Spanned<Lock>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Guarantee {
    pub(super) budget: Option<Spanned<Time>>,
    pub(super) period: Option<Spanned<Time>>,
    pub(super) rate: Option<Spanned<Rate>>,
    pub(super) takes: Option<Spanned<Time>>,
    pub(super) deadline: Option<Spanned<Time>>,
    pub(super) importance: Option<Spanned<u8>>,
    pub(super) minimum: Option<Spanned<Time>>,
    pub(super) desired: Option<Spanned<Time>>,
    #[serde(default)]
    pub(super) suspend: bool,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Policy {
    pub(super) kind: Kind,
    pub(super) priority: Option<Spanned<u8>>,
    pub(super) background: Option<Spanned<u8>>,
    pub(super) suspend: Option<Spanned<bool>>,
    pub(super) budget: Option<Spanned<Time>>,
    pub(super) period: Option<Spanned<Time>>,
    pub(super) max_repl: Option<Spanned<u16>>,
    pub(super) runtime: Option<Spanned<Time>>,
    pub(super) deadline: Option<Spanned<Time>>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Kind {
    TimeShared,
    Fifo,
    Sporadic,
    Deadline,
}

impl Kind {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::TimeShared => "time-shared",
            Self::Fifo => "fifo",
            Self::Sporadic => "sporadic",
            Self::Deadline => "deadline",
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Releases {
    pub(super) every: Option<Spanned<Time>>,
    pub(super) offset: Option<Spanned<Time>>,
    pub(super) jitter: Option<Spanned<Time>>,
    pub(super) gap: Option<Spanned<Times>>,
    pub(super) burst: Option<Spanned<u32>>,
    pub(super) spacing: Option<Spanned<Time>>,
    pub(super) at: Option<Spanned<Vec<Time>>>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Overflow {
    DropOldest,
    DropNewest,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Lock {
    pub(super) name: String,
    pub(super) holds: Option<Time>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Chain {
    pub(super) name: Spanned<String>,
    pub(super) workers: Spanned<Vec<Spanned<String>>>,
    pub(super) deadline: Option<Spanned<Time>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Program {
    pub(super) name: Spanned<String>,
    #[serde(rename = "match")]
    pub(super) pattern: Spanned<String>,
    pub(super) cpu: Option<Spanned<usize>>,
    #[serde(default)]
    pub(super) thread: Vec<ProgramThread>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ProgramThread {
    #[serde(rename = "match")]
    pub(super) pattern: Spanned<String>,
    pub(super) guarantee: Option<Spanned<Guarantee>>,
    pub(super) policy: Option<Spanned<Policy>>,
}

/// `30 ms`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Time(pub(super) Nanos);

impl<'de> Deserialize<'de> for Time {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Read;
        impl Visitor<'_> for Read {
            type Value = Time;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a duration in quotes with its unit, for example \"30 ms\"")
            }
            fn visit_str<E: Error>(self, text: &str) -> Result<Time, E> {
                time(text).map(Time)
            }
        }
        deserializer.deserialize_any(Read)
    }
}

/// A time of at most a day, so that sums and products stay within 64 bits.
fn time<E: Error>(text: &str) -> Result<Nanos, E> {
    let time = span::parse(text).map_err(E::custom)?;
    if time > guarantee::MAX_PERIOD {
        return Err(E::custom(format!("{text:?}: allowed up to 86400 s")));
    }
    Ok(time)
}

/// `100 Hz`, as its period.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rate(pub(super) Nanos);

impl<'de> Deserialize<'de> for Rate {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Read;
        impl Visitor<'_> for Read {
            type Value = Rate;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a rate in quotes with its unit, for example \"100 Hz\"")
            }
            fn visit_str<E: Error>(self, text: &str) -> Result<Rate, E> {
                let scaled = |unit: &str, scale: f64| {
                    let number = text.trim().strip_suffix(unit)?.trim().parse::<f64>().ok()?;
                    guarantee::period_of(number * scale)
                };
                let read = scaled("kHz", 1000.0).or_else(|| scaled("Hz", 1.0));
                read.map(Rate).ok_or_else(|| {
                    E::custom(format!(
                        "{text:?} is not a rate: allowed is a number above 0 with a unit (Hz or kHz), for example \"100 Hz\""
                    ))
                })
            }
        }
        deserializer.deserialize_any(Read)
    }
}

/// A number of CPUs, or a list of them.
#[derive(Debug, Clone)]
pub(super) struct Cpus(pub(super) Vec<usize>);

impl<'de> Deserialize<'de> for Cpus {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Read;
        impl<'de> Visitor<'de> for Read {
            type Value = Cpus;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number of CPUs (1 to 1024) or a list of CPU numbers")
            }
            fn visit_i64<E: Error>(self, count: i64) -> Result<Cpus, E> {
                match usize::try_from(count) {
                    Ok(count @ 1..=1024) => Ok(Cpus((0..count).collect())),
                    _ => Err(E::custom(format!("{count} CPUs: allowed 1 to 1024"))),
                }
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Cpus, A::Error> {
                let mut cpus = Vec::new();
                while let Some(cpu) = seq.next_element()? {
                    if cpus.contains(&cpu) || cpu > 4095 {
                        let why = format!("CPU {cpu}: allowed 0 to 4095, each once");
                        return Err(A::Error::custom(why));
                    }
                    cpus.push(cpu);
                }
                Ok(Cpus(cpus))
            }
        }
        deserializer.deserialize_any(Read)
    }
}

/// A time that is constant or drawn.
#[derive(Debug, Clone)]
pub(super) struct Times(pub(super) Span);

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Drawn {
    min: Option<Time>,
    max: Option<Time>,
    usual: Option<Time>,
    worst: Option<Time>,
    one_in: Option<u32>,
    samples: Option<Vec<Time>>,
}

impl Drawn {
    fn span(self) -> Option<Span> {
        match self {
            Self {
                min: Some(min),
                max: Some(max),
                usual: None,
                worst: None,
                one_in: None,
                samples: None,
            } if min.0 <= max.0 => Some(Span::Uniform {
                min: min.0,
                max: max.0,
            }),
            Self {
                min: None,
                max: None,
                usual: Some(usual),
                worst: Some(worst),
                one_in: Some(one_in),
                samples: None,
            } if one_in > 0 => Some(Span::Rare {
                usual: usual.0,
                worst: worst.0,
                one_in,
            }),
            Self {
                min: None,
                max: None,
                usual: None,
                worst: None,
                one_in: None,
                samples: Some(samples),
            } if !samples.is_empty() => Some(Span::Samples(samples.iter().map(|t| t.0).collect())),
            _ => None,
        }
    }
}

impl<'de> Deserialize<'de> for Times {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Read;
        impl<'de> Visitor<'de> for Read {
            type Value = Times;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(
                    "a duration like \"3 ms\", or { min, max }, { usual, worst, one_in } or { samples = […] } of such",
                )
            }
            fn visit_str<E: Error>(self, text: &str) -> Result<Times, E> {
                Ok(Times(Span::Constant(time(text)?)))
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Times, A::Error> {
                let drawn = Drawn::deserialize(MapAccessDeserializer::new(map))?;
                drawn.span().map(Times).ok_or_else(|| {
                    A::Error::custom(
                        "allowed are { min, max } with min <= max, { usual, worst, one_in } with one_in >= 1, or { samples } with at least one",
                    )
                })
            }
        }
        deserializer.deserialize_any(Read)
    }
}
