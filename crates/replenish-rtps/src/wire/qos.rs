//! Quality of service as discovery carries it (DDS 1.4, 2.2.3; RTPS 2.5, 9.6.4).

use super::parameters::{ParameterWriter, pid};
use super::time::{duration, put_duration};
use super::{INFINITE, Nanos, Reader, WireError};

/// Whether lost samples are sent again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reliability {
    /// Lost samples are not sent again.
    BestEffort,
    /// Yes.
    Reliable,
}

/// The samples that reach readers which come later, weakest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Durability {
    /// Late readers get no earlier samples.
    Volatile,
    /// The samples that the writer keeps while it lives.
    TransientLocal,
    /// The samples that a service keeps while the system runs.
    Transient,
    /// The samples that a service keeps on disk.
    Persistent,
}

/// Ways for a writer to show that it is alive, weakest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LivelinessKind {
    /// The middleware does it.
    Automatic,
    /// Any writer of the participant does it.
    ManualByParticipant,
    /// The writer does it.
    ManualByTopic,
}

/// Bit set of the representations that an endpoint writes (one) or reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Representations(u8);

impl Representations {
    /// XCDR1, plain CDR: that of ROS 2, and of endpoints that name none.
    pub const XCDR1: Representations = Representations(1);
    /// XCDR2.
    pub const XCDR2: Representations = Representations(4);

    /// Whether a sample that `self` writes can be read by `reader`.
    #[must_use]
    pub const fn meets(self, reader: Representations) -> bool {
        self.0 & reader.0 != 0
    }
}

/// Quality of service of an endpoint. Partition and user data stand beside it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Qos {
    /// Whether lost samples are sent again.
    pub reliability: Reliability,
    /// The samples that reach readers which come later.
    pub durability: Durability,
    /// The longest time between two samples.
    pub deadline: Nanos,
    /// Time in ns for which a sample is of use. Writers only.
    pub lifespan: Nanos,
    /// The way in which a writer shows that it is alive.
    pub liveliness: LivelinessKind,
    /// Time in ns that a writer counts as alive after it has shown it.
    pub liveliness_lease: Nanos,
    /// Samples that are kept; 0: all. Peers do not match by it.
    pub depth: u32,
    /// Whether the strongest writer alone is heard.
    pub exclusive: bool,
    /// Whether samples are ordered by their source's time.
    pub by_source_time: bool,
    /// The representations that are written or read.
    pub representations: Representations,
}

impl Qos {
    /// The QoS of an endpoint that announces none: a writer is reliable, a reader best effort.
    #[must_use]
    pub const fn unnamed(writer: bool) -> Self {
        Qos {
            reliability: if writer {
                Reliability::Reliable
            } else {
                Reliability::BestEffort
            },
            durability: Durability::Volatile,
            deadline: INFINITE,
            lifespan: INFINITE,
            liveliness: LivelinessKind::Automatic,
            liveliness_lease: INFINITE,
            depth: 1,
            exclusive: false,
            by_source_time: false,
            representations: Representations::XCDR1,
        }
    }

    /// ROS 2's default: reliable, volatile, the last ten.
    #[must_use]
    pub const fn ros() -> Self {
        Qos {
            reliability: Reliability::Reliable,
            depth: 10,
            ..Self::unnamed(true)
        }
    }

    /// ROS 2's default with transient local durability, the last `depth` samples.
    #[must_use]
    pub const fn latched(depth: u32) -> Self {
        Qos {
            durability: Durability::TransientLocal,
            depth,
            ..Self::ros()
        }
    }

    /// ROS 2's sensor data: best effort, the last five.
    #[must_use]
    pub const fn sensor_data() -> Self {
        Qos {
            reliability: Reliability::BestEffort,
            depth: 5,
            ..Self::ros()
        }
    }

    /// Takes a parameter; `false` if it is not one of quality of service.
    pub(super) fn take(&mut self, id: u16, r: &mut Reader<'_>) -> Result<bool, WireError> {
        match id {
            pid::RELIABILITY => {
                self.reliability = match r.u32()? {
                    0 | 1 => Reliability::BestEffort,
                    // RTPS says 2; RTI's first versions and Fast DDS's `3` are reliable, too.
                    _ => Reliability::Reliable,
                };
            }
            pid::DURABILITY => {
                self.durability = match r.u32()? {
                    0 => Durability::Volatile,
                    1 => Durability::TransientLocal,
                    2 => Durability::Transient,
                    3 => Durability::Persistent,
                    _ => return Err(WireError::OutOfRange("DURABILITY (0 to 3)")),
                };
            }
            pid::DEADLINE => self.deadline = duration(r)?,
            pid::LIFESPAN => self.lifespan = duration(r)?,
            pid::LIVELINESS => {
                self.liveliness = match r.u32()? {
                    0 => LivelinessKind::Automatic,
                    1 => LivelinessKind::ManualByParticipant,
                    2 => LivelinessKind::ManualByTopic,
                    _ => return Err(WireError::OutOfRange("LIVELINESS (0 to 2)")),
                };
                self.liveliness_lease = duration(r)?;
            }
            pid::HISTORY => {
                let (kind, depth) = (r.u32()?, r.u32()?);
                self.depth = if kind == 1 { 0 } else { depth };
            }
            pid::OWNERSHIP => self.exclusive = r.u32()? == 1,
            pid::DESTINATION_ORDER => self.by_source_time = r.u32()? == 1,
            pid::DATA_REPRESENTATION => self.representations = representations(r)?,
            _ => return Ok(false),
        }
        Ok(true)
    }

    pub(super) fn encode(&self, list: &mut ParameterWriter<'_, '_>, writer: bool) {
        list.add(pid::RELIABILITY, |w| {
            w.u32(if self.reliability == Reliability::Reliable {
                2
            } else {
                1
            });
            put_duration(w, 100_000_000);
        });
        list.add(pid::DURABILITY, |w| w.u32(self.durability as u32));
        list.add(pid::DEADLINE, |w| put_duration(w, self.deadline));
        list.add(pid::LIVELINESS, |w| {
            w.u32(self.liveliness as u32);
            put_duration(w, self.liveliness_lease);
        });
        if writer {
            list.add(pid::LIFESPAN, |w| put_duration(w, self.lifespan));
        }
        list.add(pid::HISTORY, |w| {
            w.u32(u32::from(self.depth == 0));
            w.u32(self.depth.max(1));
        });
        list.add(pid::OWNERSHIP, |w| w.u32(u32::from(self.exclusive)));
        list.add(pid::DESTINATION_ORDER, |w| {
            w.u32(u32::from(self.by_source_time));
        });
        list.add(pid::DATA_REPRESENTATION, |w| {
            let ids = [(1, 0u16), (4, 2)];
            let named = ids
                .iter()
                .filter(|(bit, _)| self.representations.0 & bit != 0);
            w.u32(u32::try_from(named.clone().count()).unwrap_or(0));
            named.for_each(|(_, id)| w.u16(*id));
        });
    }
}

fn representations(r: &mut Reader<'_>) -> Result<Representations, WireError> {
    let mut bits = 0;
    for _ in 0..r.u32()? {
        if let Some(bit) = 1u8.checked_shl(u32::from(r.u16()?)) {
            bits |= bit;
        }
    }
    // An empty list stands for XCDR1 (XTypes 1.3, 7.6.3.1.1).
    Ok(Representations(if bits == 0 { 1 } else { bits }))
}
