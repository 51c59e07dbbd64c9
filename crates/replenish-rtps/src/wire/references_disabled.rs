//! No memory is shared: nobody says whether references are taken.

use super::message::MessageWriter;
use super::{EntityId, WireError};

#[expect(clippy::unused_self, reason = "as with the feature `shared`")]
impl MessageWriter<'_> {
    pub(crate) const fn shared(
        &mut self,
        _: EntityId,
        _: EntityId,
        _: bool,
    ) -> Result<(), WireError> {
        Ok(())
    }
}
