//! Tables of endpoints: the place of a deleted one is given to the next.

use super::{MAX_READERS, MiddlewareError};
use crate::platform::label;
use alloc::vec::Vec;

/// The first free place of a table, or the one behind its end.
pub(super) fn free_place<T>(table: &[T], is_free: impl Fn(&T) -> bool) -> usize {
    table.iter().position(is_free).unwrap_or(table.len())
}

/// As [`free_place`], as the number of an endpoint. `what` names the endpoints in the error.
///
/// # Errors
/// [`MiddlewareError::Capacity`] if all [`MAX_READERS`] places are taken.
pub(super) fn free_number<T>(
    table: &[T],
    is_free: impl Fn(&T) -> bool,
    what: &'static str,
) -> Result<u16, MiddlewareError> {
    let (limit, what) = (MAX_READERS, label(what));
    let place = free_place(table, is_free);
    let number = u16::try_from(place).ok().filter(|_| place < limit);
    number.ok_or(MiddlewareError::Capacity { what, limit })
}

/// Puts an entry at a place, which is free or behind the end.
pub(super) fn put<T>(table: &mut Vec<T>, at: usize, entry: T) {
    match table.get_mut(at) {
        Some(place) => *place = entry,
        None => table.push(entry),
    }
}
