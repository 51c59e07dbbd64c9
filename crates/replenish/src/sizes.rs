//! Sizes that one may ask for messages of a type.

use replenish_msg::Message;

/// The largest sample that the protocol carries, in bytes.
pub(crate) const LARGEST: usize = 65_528;

/// The largest size that one may ask for samples of `M`.
pub(crate) const fn largest<M: Message>() -> usize {
    match M::BOUNDED {
        true => M::MAX_SIZE,
        false => LARGEST,
    }
}

/// The largest message of `M` to or from a service, if `asked` for another than usual.
pub(crate) fn sized<M: Message>(asked: Option<usize>) -> usize {
    match M::BOUNDED {
        true => M::MAX_SIZE,
        false => asked.unwrap_or(M::MAX_SIZE),
    }
}
