//! The sum of all submessage bodies, for decoding by id.

use super::{
    AckNack, Create, CreateClient, Data, Delete, Fragment, GetInfo, Heartbeat, Info, ReadData,
    Reader, Reset, StatusAgent, StatusReply, Timestamp, TimestampReply, WireError, WriteData,
    Writer,
};
use super::{Encode, FLAG_LITTLE_ENDIAN, SubmessageId};

/// A decoded submessage body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "each variant is documented at its content")]
pub enum Body<'a> {
    CreateClient(CreateClient<'a>),
    Create(Create<'a>),
    GetInfo(GetInfo),
    Delete(Delete),
    StatusAgent(StatusAgent<'a>),
    Status(StatusReply),
    Info(Info),
    WriteData(WriteData<'a>),
    ReadData(ReadData<'a>),
    Data(Data<'a>),
    AckNack(AckNack),
    Heartbeat(Heartbeat),
    Reset(Reset),
    Fragment(Fragment<'a>),
    Timestamp(Timestamp),
    TimestampReply(TimestampReply),
}

impl<'a> Body<'a> {
    /// Decodes the body of submessage `id`. Bytes after it are ignored, as newer peers may append
    /// fields.
    ///
    /// # Errors
    /// Every [`WireError`] but `NoRoom` and `TooLong`.
    pub fn decode(id: SubmessageId, flags: u8, payload: &'a [u8]) -> Result<Self, WireError> {
        let r = &mut Reader::new(payload, flags & FLAG_LITTLE_ENDIAN != 0);
        Ok(match id {
            SubmessageId::CreateClient => Body::CreateClient(CreateClient::decode(r)?),
            SubmessageId::Create => Body::Create(Create::decode(r, flags)?),
            SubmessageId::GetInfo => Body::GetInfo(GetInfo::decode(r)?),
            SubmessageId::Delete => Body::Delete(Delete::decode(r)?),
            SubmessageId::StatusAgent => Body::StatusAgent(StatusAgent::decode(r)?),
            SubmessageId::Status => Body::Status(StatusReply::decode(r)?),
            SubmessageId::Info => Body::Info(Info::decode(r)?),
            SubmessageId::WriteData => Body::WriteData(WriteData::decode(r, flags)?),
            SubmessageId::ReadData => Body::ReadData(ReadData::decode(r)?),
            SubmessageId::Data => Body::Data(Data::decode(r, flags)?),
            SubmessageId::AckNack => Body::AckNack(AckNack::decode(r)?),
            SubmessageId::Heartbeat => Body::Heartbeat(Heartbeat::decode(r)?),
            SubmessageId::Reset => Body::Reset(Reset),
            SubmessageId::Fragment => Body::Fragment(Fragment::decode(r, flags)),
            SubmessageId::Timestamp => Body::Timestamp(Timestamp::decode(r)?),
            SubmessageId::TimestampReply => Body::TimestampReply(TimestampReply::decode(r)?),
        })
    }

    fn inner(&self) -> &dyn Encode {
        match self {
            Body::CreateClient(body) => body,
            Body::Create(body) => body,
            Body::GetInfo(body) => body,
            Body::Delete(body) => body,
            Body::StatusAgent(body) => body,
            Body::Status(body) => body,
            Body::Info(body) => body,
            Body::WriteData(body) => body,
            Body::ReadData(body) => body,
            Body::Data(body) => body,
            Body::AckNack(body) => body,
            Body::Heartbeat(body) => body,
            Body::Reset(body) => body,
            Body::Fragment(body) => body,
            Body::Timestamp(body) => body,
            Body::TimestampReply(body) => body,
        }
    }
}

impl Encode for Body<'_> {
    fn id(&self) -> SubmessageId {
        self.inner().id()
    }

    fn flags(&self) -> u8 {
        self.inner().flags()
    }

    fn write(&self, w: &mut Writer<'_>) {
        self.inner().write(w);
    }
}
