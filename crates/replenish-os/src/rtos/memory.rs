//! Memory that stays: here it always does. The functions of Linux, with nothing to do.

use super::error::OsError;

/// Never made.
pub type LockError = OsError;

/// Everything is in memory.
///
/// # Errors
/// None; as on Linux.
pub const fn lock_all() -> Result<(), LockError> {
    Ok(())
}

/// Everything stays in memory.
///
/// # Errors
/// None; as on Linux.
pub const fn keep_program() -> Result<(), LockError> {
    Ok(())
}

/// Stacks are whole from the start.
///
/// # Errors
/// None; as on Linux.
pub const fn prefault_stack(_bytes: usize) -> Result<(), OsError> {
    Ok(())
}
