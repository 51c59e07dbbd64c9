//! Everything that differs between a computer and a small board, in one place.
//!
//! A part that a build leaves out is a file `*_disabled.rs` beside the part's file, with the same
//! names, behind one conditional `path` at the `mod` line. Bodies of functions ask a constant
//! (`if FULL { … }`) instead of conditional compilation.
//!
//! ```text
//!   features ── STD · BARE · FULL · TEXTS · LOG · DROPS, as constants
//!   std ─────── wall clock, random bits, panics, standard error, io,   │ std_disabled
//!   │           recorder: the last events of each thread               │ recorder_board
//!   │           chain: latencies over several callbacks                │ chain_disabled
//!   │           local: messages as they are in memory                  │ local_disabled
//!   │           sleeping: the alarms of a future                       │ sleeping_disabled
//!   │           source_set: descriptors that a worker waits for        │ source_set_disabled
//!   │           Deadline · Lease: promises over time
//!   │                                                                   io::Error  │ io (without std)
//!   text ────── Text · StaticText · text! · label · displayed · join               │ text_disabled
//!   short_text ─ ShortText: no allocation
//!   static_value ─ Static · make_static: never dropped  │ static_value_disabled: dropped like others
//!   buffer ──── zeroed bytes
//!   wall_time ─ the wall clock as a message's stamp
//! ```

mod buffer;
mod features;
mod short_text;
#[cfg_attr(
    any(not(target_os = "none"), feature = "full"),
    path = "static_value_disabled.rs"
)]
mod static_value;
#[cfg_attr(not(feature = "std"), path = "std_disabled.rs")]
mod std;
#[cfg_attr(not(feature = "texts"), path = "text_disabled.rs")]
mod text;
mod wall_time;

#[allow(unreachable_pub, reason = "public as middleware::xrce::io")]
pub use self::std::io;
pub use self::std::local::LocalReader;
pub(crate) use self::std::local::{Deliver, Late};
pub use self::std::recorder::{Dump, Mark};
pub use self::std::source_set::SourceSet;
pub(crate) use self::std::{
    Deadline, Lease, chain, end_with, guard, prepare_end, random, recorder, sleeping, tell,
    wall_clock,
};
pub(crate) use buffer::zeroed;
#[allow(unused_imports, reason = "builds without feature xrce ask for fewer")]
pub(crate) use features::{BARE, DROPS, FULL, LOG, STD, TEXTS};
pub(crate) use short_text::ShortText;
pub(crate) use static_value::{Static, make_static};
pub use text::{StaticText, Text};
pub(crate) use text::{displayed, join, label, text};
pub(crate) use wall_time::wall_time;
