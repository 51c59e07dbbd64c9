//! Announcements of a participant and of its endpoints.

use super::config::{EndpointSpec, ParticipantConfig};
use crate::endpoint::Writer;
use crate::wire::{
    EndpointData, Guid, Nanos, ParticipantData, SequenceNumber, TypeHash, Writer as Cdr, builtin,
};
use alloc::boxed::Box;
use alloc::vec;
use alloc::vec::Vec;

/// Bytes of the longest announcement of an endpoint of our own.
pub(super) const OWN_BYTES: usize = if cfg!(feature = "shared") { 1128 } else { 1100 };

/// Bytes of the longest announcement of a participant.
pub(super) const LONGEST: usize = 768;

/// Announcements of a participant that come quickly, at the beginning and after a move.
pub(super) const QUICK: u32 = 6;

/// The announcement of a participant with a name and an enclave of at most 128 bytes.
pub(super) fn announcement(config: &ParticipantConfig<'_>) -> Vec<u8> {
    let mut user_data = [0; 144];
    let mut w = Cdr::new(&mut user_data);
    w.put(b"enclave=");
    w.put(config.enclave.as_bytes());
    w.put(b";");
    let user_data = w.finish().unwrap_or(&[]);
    let data = ParticipantData {
        domain: Some(config.domain),
        metatraffic_unicast: config.discovery,
        default_unicast: config.user,
        lease: config.lease,
        name: config.name,
        user_data,
        builtin: builtin::DISCOVERY | builtin::LIVELINESS_WRITER | builtin::LIVELINESS_READER,
        ..ParticipantData::new(config.prefix)
    };
    encoded(LONGEST, |w| data.encode(w)).into()
}

fn encoded(room: usize, write: impl FnOnce(&mut Cdr<'_>)) -> Box<[u8]> {
    let mut bytes = vec![0; room];
    let mut w = Cdr::new(&mut bytes);
    write(&mut w);
    w.finish().map(Box::from).unwrap_or_default()
}

/// Writes the announcement of an endpoint and returns its number.
pub(super) fn announce(
    writer: &mut Writer,
    guid: Guid,
    spec: &EndpointSpec<'_>,
    now: Nanos,
) -> SequenceNumber {
    let user_data = spec.type_hash.as_ref().map(TypeHash::user_data);
    let mut data = EndpointData::new(guid, spec.topic, spec.type_name, spec.qos);
    data.user_data = user_data.as_ref().map_or(&[], |bytes| bytes.as_slice());
    data.unicast = spec.unicast;
    data.segment = spec.segment;
    let bytes = encoded(OWN_BYTES, |w| data.encode(w));
    writer.announce_instance(&bytes, now)
}

/// Replaces the announcement by its disposal.
pub(super) fn dispose(writer: &mut Writer, guid: Guid, announced: SequenceNumber, now: Nanos) {
    writer.forget(announced);
    writer.dispose(guid, now);
}
