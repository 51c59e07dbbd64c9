//! Who has reserved what on this host: a directory, no daemon.
//!
//! ```text
//!   /run/replenish/lock          held while somebody reads all entries, plans, and adds its own
//!   /run/replenish/<n>.entry     one program's reservations, locked by it for as long as it lives
//!   /run/replenish/overheads.toml  what enforcing costs here, if it was measured
//! ```
//!
//! - An entry counts while its file is locked (`flock`). The kernel lets go of the lock when its
//!   owner ends, however it ends; what is left behind counts for nothing and is removed by the
//!   next one. Nothing depends on process ids, so pid namespaces do not matter.
//! - An entry appears whole: written and locked under another name, then renamed; a checksum
//!   covers it.
//! - Reading, planning and adding happen under one exclusive lock: of two programs that race, one
//!   sees the other.
//! - Who may write to the directory may reserve. An entry that makes no sense is left out, with a
//!   warning that names the file: it could only have been written by somebody with that right, and
//!   must not keep the others from starting. [`Ledger::strict`] makes it an error.
//! - Sizes are bounded: 1024 live entries of 256 KiB and 1024 threads each.
//!
//! `flock` does not reach across hosts, nor does the directory have to outlive a reboot.

mod directory;
mod entry;
mod error;
mod file;
mod measured;

pub use directory::{Admitted, DEFAULT, Found, Ledger, LedgerView};
pub use entry::LedgerEntry;
pub use error::{Denied, LedgerError};
pub use file::{Reservation, VARIABLE};
