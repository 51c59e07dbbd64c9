//! The reservations of programs on this host: a directory, no daemon.
//!
//! ```text
//!   /run/replenish/lock          held while a program reads all entries, plans, and adds its own
//!   /run/replenish/<n>.entry     one program's reservations, locked by it for as long as it lives
//!   /run/replenish/overheads.toml  what enforcing costs here, if it was measured
//! ```
//!
//! - An entry counts while its owner has its file locked, with a lock that only the owner's account
//!   can take. The kernel lets go of the lock when its owner ends, however it ends; what is left
//!   behind counts for nothing, even if others wait for it, and is removed by the next one. Nothing
//!   depends on process ids, so pid namespaces do not matter.
//! - An entry appears whole: written and locked under another name, then renamed; a checksum
//!   covers it.
//! - Reading, planning and adding happen under one exclusive lock: of two programs that race, one
//!   sees the other. Only those can open it who may write to the directory.
//! - Every file is new when it is written, and no link is followed: no file outside of the
//!   directory is touched.
//! - An account that may write to the directory may reserve. An entry that makes no sense is left
//!   out, with a warning that names the file: only an account with that right can have written the
//!   entry, and it must not keep the others from starting. [`Ledger::strict`] makes it an error.
//! - Sizes are bounded: 1024 live entries of 256 KiB and 1024 threads each.
//!
//! Locks do not reach across hosts, nor does the directory have to outlive a reboot.

mod directory;
mod entry;
mod error;
mod file;
mod lock;
mod measured;
mod open;

pub use directory::{Admitted, DEFAULT, Found, Ledger, LedgerView};
pub use entry::LedgerEntry;
pub use error::{Denied, LedgerError};
pub use file::{Reservation, VARIABLE};
