//! Is there an agent? Asked without a session.

use crate::SeqNum;
use crate::wire::{
    BaseRequest, Body, ClientKey, GetInfo, Header, INFO_ACTIVITY, Info, Message, MessageWriter,
    ObjectId, RequestId, SessionId, StreamId, WireError,
};

/// The longest ping in bytes.
pub const PING_LEN: usize = 24;

/// The message that asks, with or without a key in its header.
///
/// # Errors
/// [`WireError::NoRoom`] if `buf` is shorter than [`PING_LEN`].
pub fn ping(
    request: RequestId,
    key: Option<ClientKey>,
    buf: &mut [u8],
) -> Result<&[u8], WireError> {
    let (session, key) = match key {
        Some(key) => (SessionId::NONE_WITH_KEY, key),
        None => (SessionId::NONE_WITHOUT_KEY, ClientKey([0; 4])),
    };
    let header = Header::new(session, StreamId::NONE, SeqNum(0), key);
    let object = ObjectId::AGENT;
    let mut writer = MessageWriter::new(buf, &header)?;
    writer.push(&GetInfo {
        base: BaseRequest { request, object },
        mask: INFO_ACTIVITY,
    })?;
    Ok(writer.finish())
}

/// The agent's answer to that `request`, if `datagram` is it.
#[must_use]
pub fn pong(request: RequestId, datagram: &[u8]) -> Option<Info> {
    let message = Message::parse(datagram).ok()?;
    let mut submessages = message.submessages().map_while(Result::ok);
    submessages.find_map(|submessage| match submessage.body() {
        Ok(Body::Info(info)) if info.base.request == request && info.status.is_ok() => Some(info),
        _ => None,
    })
}
