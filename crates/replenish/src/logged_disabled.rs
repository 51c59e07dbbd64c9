//! In the place of `logged` without feature `log`.

pub(crate) use crate::platform::tell;
