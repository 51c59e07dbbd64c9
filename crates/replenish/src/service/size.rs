//! Sizes that one may ask for messages of a type.

use replenish_msg::Message;

/// The largest sample that the protocol carries, in bytes.
pub(crate) const LARGEST: usize = 65_528;

/// The largest size that one may ask for samples of `M`.
pub(crate) const fn largest<M: Message>() -> usize {
    if M::BOUNDED { M::MAX_SIZE } else { LARGEST }
}

/// The largest message of `M` to or from a service, if `asked` for another than usual.
pub(crate) fn sized<M: Message>(asked: Option<usize>) -> usize {
    if M::BOUNDED {
        M::MAX_SIZE
    } else {
        asked.unwrap_or(M::MAX_SIZE)
    }
}
