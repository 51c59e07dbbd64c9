//! Submessages about samples in shared memory, written.

use super::message::MessageWriter;
use super::sets::put_sequence_number;
use super::shared::{MARK, REFERENCE, Reference, SHARED};
use super::{EntityId, WireError};

impl MessageWriter<'_> {
    /// A sample that the reader fetches; `inline_qos` as in [`MessageWriter::data`].
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn reference(&mut self, body: &Reference<'_>, inline_qos: &[u8]) -> Result<(), WireError> {
        let flags = u8::from(!inline_qos.is_empty()) << 1;
        self.submessage(REFERENCE, flags, |w| {
            w.put(&MARK);
            w.put(&body.reader.0);
            w.put(&body.writer.0);
            put_sequence_number(w, body.sn);
            w.u32(body.sample_size);
            w.u32(body.place.slot);
            w.u32((body.place.stamp >> 32) as u32);
            w.u32((body.place.stamp & 0xffff_ffff) as u32);
            w.u16(body.fragment_size);
            w.u16(0);
            w.put(inline_qos);
        })
    }

    /// Says whether a reader takes references to samples of a writer.
    ///
    /// # Errors
    /// [`WireError::NoRoom`].
    pub fn shared(
        &mut self,
        reader: EntityId,
        writer: EntityId,
        taken: bool,
    ) -> Result<(), WireError> {
        self.submessage(SHARED, u8::from(taken) << 1, |w| {
            w.put(&MARK);
            w.put(&reader.0);
            w.put(&writer.0);
        })
    }
}
