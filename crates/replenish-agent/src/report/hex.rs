//! Ids of objects in texts.

use replenish_xrce::wire::ObjectId;

/// An id as it is on the wire.
pub(crate) fn hex(id: ObjectId) -> String {
    let [high, low] = id.to_bytes();
    format!("{high:02x}{low:02x}")
}
