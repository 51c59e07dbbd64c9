//! The `builtin_interfaces` package.

use crate::structure::known;
use crate::{CdrError, CdrReader, CdrWriter, Message, Viewed};

/// `builtin_interfaces/msg/Time`: a point in time of whatever clock the message says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Time {
    /// Whole seconds since the clock's epoch.
    pub sec: i32,
    /// Nanoseconds after `sec`, below 1 000 000 000 by convention (not checked).
    pub nanosec: u32,
}

impl Message for Time {
    const TYPE_NAME: &'static str = "builtin_interfaces/msg/Time";
    const DDS_TYPE_NAME: &'static str = "builtin_interfaces::msg::dds_::Time_";
    const MAX_SIZE: usize = 8;
    known!(
        "b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197",
        "builtin_interfaces/msg/Time",
        "sec": One, Number(4),
        "nanosec": One, Number(4)
    );

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.i32(self.sec)?;
        w.u32(self.nanosec)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.sec = r.i32()?;
        self.nanosec = r.u32()?;
        Ok(())
    }
}

impl Viewed for Time {
    type View<'a> = Self;
}
