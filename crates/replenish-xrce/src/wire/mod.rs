//! The XRCE wire format: pure functions between bytes and types, for both client and agent.
//!
//! ```text
//!   message    = header (4 or 8 bytes), submessage*
//!   header     = session id, stream id, sequence number LE [, client key iff session id < 0x80]
//!   submessage = id, flags, length LE, body[length]      each starts 4-aligned in the message
//!
//!   message ──► body ──► login, info, create (entity, endpoint), access, service, notice,
//!      │                 reliability, time          one file for the submessages of a topic
//!      └──► header ──► ids                          encode: building messages
//!   writer (and Reader, of replenish-wire): CDR     error: malformed bytes, short buffers
//! ```
//!
//! Bodies are CDR with alignment counted from the body's own start and the byte order of flag bit
//! 0. Encoding always writes little endian; decoding takes both. Decoding never panics: whatever
//! the bytes, the result is a value that borrows from them or a [`WireError`].

mod access;
mod body;
mod create;
mod encode;
mod endpoint;
mod entity;
mod error;
mod header;
mod ids;
mod info;
mod login;
mod message;
mod notice;
mod reliability;
mod service;
mod time;
mod writer;

pub use access::{Data, DeliveryControl, ReadData, WriteData};
pub use body::Body;
pub use create::{Create, CreationMode, Delete, Entity, Representation};
pub use encode::{Encode, MessageWriter, encode_submessage, measure, submessage_len};
pub(crate) use encode::{RawBody, append, encode_joined, joined_len};
pub use endpoint::{
    DataReaderBinary, DataWriterBinary, EndpointQos, QOS_DURABILITY_PERSISTENT,
    QOS_DURABILITY_TRANSIENT, QOS_DURABILITY_TRANSIENT_LOCAL, QOS_HISTORY_KEEP_LAST, QOS_RELIABLE,
    ReaderQos, WriterQos,
};
pub use entity::{GroupBinary, ParticipantBinary, ServiceBinary, TopicBinary};
pub use error::{Reader, WireError};
pub use header::{FLAG_LITTLE_ENDIAN, Header, StreamHeader, SubmessageId};
pub use ids::{
    BaseRequest, ClientKey, ObjectId, ObjectKind, RequestId, SessionId, Status, StreamId,
};
pub use info::{AgentInfo, GetInfo, INFO_ACTIVITY, INFO_CONFIGURATION, Info};
pub use login::{COOKIE, CreateClient, Properties, StatusAgent, StatusReply, VENDOR, VERSION};
pub use message::{Message, Submessage, Submessages};
pub use notice::Notice;
pub use reliability::{
    AckNack, Confirmation, Confirmed, DELIVERY, DELIVERY_BACK, DELIVERY_CONFIRMED, DELIVERY_NEW,
    Fragment, Heartbeat, Reset,
};
pub(crate) use replenish_wire::padding;
pub use service::{SampleIdentity, WriteReply};
pub use time::{Timestamp, TimestampReply, WireTime};
pub use writer::Writer;
