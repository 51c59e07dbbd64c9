//! A copy of a recording while its program goes on writing: what a dump holds.
//!
//! Of each ring the count `done` is read first and `begun` last, as every reader does: the copy
//! says
//! by itself which of its records were overwritten meanwhile.

use crate::layout::HEADER;
use crate::ring;
use crate::view::{Invalid, Source, View, counters};
use alloc::vec;

/// Bytes that are copied at a time.
const CHUNK: usize = 64 << 10;

/// Hands the recording over piece by piece, each with its offset in the file; `false` from `sink`
/// ends it.
///
/// # Errors
/// The reason why it is no recording; nothing was handed over then. [`Invalid::Length`] where it
/// became shorter meanwhile.
pub fn copy<S: Source + ?Sized>(
    source: &S,
    mut sink: impl FnMut(u64, &[u8]) -> bool,
) -> Result<(), Invalid> {
    let view = View::read(source)?;
    let mut buffer = vec![0; CHUNK];
    let mut piece = |from: u64, to: u64, sink: &mut dyn FnMut(u64, &[u8]) -> bool| {
        let mut at = from;
        while at < to {
            let length = usize::try_from(to - at).unwrap_or(CHUNK).min(CHUNK);
            let part = buffer.get_mut(..length).unwrap_or_default();
            if !source.fill(at, part) {
                return Err(Invalid::Length);
            }
            if !sink(at, part) {
                return Ok(false);
            }
            at += length as u64;
        }
        Ok(true)
    };
    let rings = || {
        let rings = view.threads.iter().map(|t| [Some(t.ring), t.budget_ring]);
        rings.flatten().flatten()
    };
    let first = rings().map(|(offset, _)| offset).min();
    let tables = first.unwrap_or(HEADER as u64);
    if !piece(0, tables, &mut sink)? {
        return Ok(());
    }
    let head = (ring::HEAD * 8) as u64;
    for (offset, bytes) in rings() {
        if bytes < head {
            continue;
        }
        let (_, done) = counters(source, offset).ok_or(Invalid::Length)?;
        if !piece(offset + head, offset + bytes, &mut sink)? {
            return Ok(());
        }
        let (begun, _) = counters(source, offset).ok_or(Invalid::Length)?;
        let mut counts = [0; 16];
        let (first, second) = counts.split_at_mut(8);
        first.copy_from_slice(&begun.to_le_bytes());
        second.copy_from_slice(&done.to_le_bytes());
        if !sink(offset, &counts) {
            return Ok(());
        }
    }
    Ok(())
}
