//! Quality of service and names, as DDS has them.

use crate::Nanos;
use crate::middleware::MiddlewareError;
use crate::platform::label;
use crate::qos::{Durability, History, Liveliness, Qos, Reliability};
use core::time::Duration;
use replenish_rtps::participant::{ConfigError, Policy};
use replenish_rtps::wire::{self, INFINITE, TypeHash};

/// Bytes in front of a sample: its representation. Peers pad the end to a multiple of four.
pub(super) const ENCAPSULATION: usize = 4;
pub(super) const PADDING: usize = 3;
/// Places of a reliable reader at least: samples that wait for a lost one; of long samples fewer,
/// as many as take so many bytes, and two in any case.
const WAITING: usize = 16;
const WAITING_BYTES: usize = 1 << 20;
/// Samples from this length on, in bytes, are copied without the lock.
pub(super) const LONG: usize = 16 * 1024;

/// The quality of service that is announced and carried out.
pub(super) fn dds(qos: Qos, keep_oldest: bool) -> wire::Qos {
    let keep_all = qos.history == History::KeepAll || keep_oldest;
    wire::Qos {
        reliability: match qos.reliability {
            Reliability::BestEffort => wire::Reliability::BestEffort,
            Reliability::Reliable => wire::Reliability::Reliable,
        },
        durability: match qos.durability {
            Durability::Volatile => wire::Durability::Volatile,
            Durability::TransientLocal => wire::Durability::TransientLocal,
        },
        deadline: promised(qos.deadline).unwrap_or(INFINITE),
        lifespan: promised(qos.lifespan).unwrap_or(INFINITE),
        liveliness: match qos.liveliness {
            Liveliness::Automatic => wire::LivelinessKind::Automatic,
            Liveliness::ManualByTopic => wire::LivelinessKind::ManualByTopic,
        },
        liveliness_lease: promised(qos.lease).unwrap_or(INFINITE),
        depth: if keep_all { 0 } else { qos.depth.into() },
        ..wire::Qos::ros()
    }
}

/// The quality of service of an endpoint that was announced.
pub(super) fn ros(qos: &wire::Qos) -> Qos {
    let time = |time: Nanos| (time != INFINITE).then(|| Duration::from_nanos(time));
    let depth = u16::try_from(qos.depth).unwrap_or(u16::MAX);
    Qos {
        reliability: match qos.reliability {
            wire::Reliability::BestEffort => Reliability::BestEffort,
            wire::Reliability::Reliable => Reliability::Reliable,
        },
        durability: match qos.durability {
            wire::Durability::Volatile => Durability::Volatile,
            _ => Durability::TransientLocal,
        },
        deadline: time(qos.deadline),
        lifespan: time(qos.lifespan),
        liveliness: match qos.liveliness {
            wire::LivelinessKind::ManualByTopic => Liveliness::ManualByTopic,
            _ => Liveliness::Automatic,
        },
        lease: time(qos.liveliness_lease),
        history: if depth == 0 {
            History::KeepAll
        } else {
            History::KeepLast
        },
        depth,
        ..Qos::reliable()
    }
}

/// Places for samples of `bytes` that a reader has.
pub(super) fn places(qos: Qos, bytes: usize) -> usize {
    let depth = usize::from(qos.depth);
    let waiting = WAITING_BYTES.checked_div(bytes).unwrap_or(WAITING);
    match qos.reliability {
        Reliability::Reliable => depth.max(waiting.clamp(2, WAITING)),
        Reliability::BestEffort => depth,
    }
}

/// A time in nanoseconds; `None` if it is zero, which says nothing.
fn promised(time: Option<Duration>) -> Option<Nanos> {
    let time = time.filter(|time| !time.is_zero())?;
    Some(u64::try_from(time.as_nanos()).unwrap_or(INFINITE))
}

/// The hash from its text, `RIHS01_` and 64 hexadecimal digits.
pub(super) fn type_hash(text: Option<&str>) -> Option<TypeHash> {
    let text = alloc::format!("typehash={};", text?);
    TypeHash::find(text.as_bytes())
}

/// The policies as the bits of `IncompatibleQos::known_by_policy`.
pub(super) fn policy_bit(policy: Policy) -> u8 {
    match policy {
        Policy::Reliability => 1,
        Policy::Durability => 2,
        Policy::Deadline => 4,
        Policy::Liveliness => 8,
        _ => 0,
    }
}

pub(super) fn refused(error: ConfigError, own_endpoints: usize) -> MiddlewareError {
    match error {
        ConfigError::Range {
            field: "sample_bytes",
            value,
            most,
            ..
        } => MiddlewareError::TooLarge {
            size: usize::try_from(value).unwrap_or(usize::MAX),
            limit: usize::try_from(most).unwrap_or(usize::MAX),
            setting: label("that of a sample with its encapsulation is fixed"),
        },
        ConfigError::Range { .. } => {
            MiddlewareError::Unsupported(label("names of topics and types over 255 bytes"))
        }
        _ => MiddlewareError::Capacity {
            what: label("endpoints of the participant (RtpsConfig::own_endpoints)"),
            limit: own_endpoints,
        },
    }
}

pub(super) fn name_too_long() -> MiddlewareError {
    MiddlewareError::Unsupported(label("names of topics and types over 255 bytes"))
}
