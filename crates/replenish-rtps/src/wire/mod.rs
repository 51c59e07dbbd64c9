//! The RTPS wire format: pure functions between bytes and types.
//!
//! ```text
//!   message    = "RTPS", version, vendor, participant (12 bytes), submessage*
//!   submessage = id, flags, length, body[length]
//!   payload    = representation (4 bytes), CDR or parameter list
//!
//!   message ──► submessage ──► sets (sequence numbers), guid, time
//!                    └───────► parameters ──► inline QoS: related (requests), origins (chains)
//!                    └───────► shared: references to samples in a writer's memory
//!   references ──► message, shared: how they are written
//!   participant (SPDP), endpoint (SEDP) ──► parameters, qos, locator, payload
//!   writer (and Reader, of replenish-wire): CDR     error: malformed bytes, short buffers
//! ```
//!
//! Encoding always writes little endian; decoding takes both byte orders. Decoding never panics:
//! whatever the bytes, the result is a value that borrows from them or a [`WireError`]. Source: OMG
//! DDSI-RTPS 2.5 (formal/22-04-01); every place where implementations differ from it says so.

mod endpoint;
mod error;
mod guid;
mod locator;
mod message;
mod origins;
mod parameters;
mod participant;
mod payload;
mod qos;
#[cfg_attr(not(feature = "shared"), path = "references_disabled.rs")]
mod references;
mod related;
mod sets;
#[cfg_attr(not(feature = "shared"), path = "shared_disabled.rs")]
mod shared;
mod submessage;
mod time;
mod writer;

pub use endpoint::{EndpointData, Partitions, TypeHash, disposal, disposed_entity, is_disposal};
pub use error::{Reader, WireError};
pub use guid::{EntityId, Guid, GuidPrefix};
pub use locator::{Locator, Locators, Reach};
pub use message::{HEADER, Message, MessageWriter, Submessages, VENDOR, VERSION};
pub use origins::{ChainOrigin, ChainOrigins, MOST_ORIGINS, chain_origins, put_chain_origins};
pub use parameters::{Parameter, ParameterWriter, Parameters, pid};
pub use participant::{ParticipantData, builtin};
pub use payload::{CDR_LE, Encapsulated, PL_CDR_LE};
pub use qos::{Durability, LivelinessKind, Qos, Reliability, Representations};
pub use related::{SampleIdentity, put_related_request, related_request};
pub use sets::{Bits, FragmentSet, MAX_SEQUENCE_NUMBER, SequenceNumber, SequenceSet};
pub use shared::{Reference, SegmentName, Shared, SharedPlace};
pub use submessage::{
    AckNack, Data, DataFrag, Gap, Heartbeat, HeartbeatFrag, NackFrag, Payload, Submessage,
};
pub use time::{INFINITE, Nanos, Timestamp};
pub use writer::Writer;
