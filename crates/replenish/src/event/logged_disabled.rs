//! In the place of `logged` without feature `log`.

use crate::platform;

pub(crate) fn tell(event: &super::kinds::Event<'_>) {
    platform::tell(event);
}
