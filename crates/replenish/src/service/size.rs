//! Sizes that one may ask for messages of a type.

use crate::error::Error;
use crate::middleware::remedy::LARGEST;
use crate::platform::{STD, text};
use crate::qos::Qos;
use replenish_msg::Message;

/// Bytes that the samples of one endpoint may take, its history alone: 1 GiB.
pub(crate) const MEMORY: usize = 1 << 30;

/// The usual size for samples of `M`, and the largest that one may ask for.
pub(crate) const fn sizes<M: Message>() -> (usize, usize) {
    (M::MAX_SIZE, largest::<M>())
}

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

/// The requested or usual size, if that and the number of such samples are allowed.
pub(crate) fn checked(
    (kind, name): (&str, &str),
    asked: Option<usize>,
    (usual, most): (usize, usize),
    qos: Qos,
) -> Result<usize, Error> {
    let size = asked.unwrap_or(usual);
    if asked.is_some() && !(1..=most).contains(&size) {
        let allowed = text!("1..={most} bytes");
        let owner = text!("{kind} {name}");
        return Err(Error::parameter(owner, "max_size", &size, allowed));
    }
    let samples = MEMORY.checked_div(size).unwrap_or(MEMORY);
    // A small board has no gigabyte: its allocator says so.
    if STD && usize::from(qos.depth) > samples {
        let allowed = text!("1..={samples} samples of {size} bytes, 1 GiB");
        let owner = text!("{kind} {name}");
        return Err(Error::parameter(owner, "qos.depth", &qos.depth, allowed));
    }
    Ok(size)
}
