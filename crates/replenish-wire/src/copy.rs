//! [`copy`]: long runs of bytes, in [pieces](piece) where the processor copies them badly in one.

use core::hint::black_box;

const X86: bool = cfg!(target_arch = "x86_64");
/// Glibc takes `rep movsb` from 2112 bytes on, up to some megabytes.
const SHORT: usize = 1024;
/// That instruction copies 64 kB in 30 us instead of 2 on AMD's Zen, measured, if the target lies
/// 1 to 31 bytes behind the source modulo this: as after a sample's encapsulation, between two
/// blocks of `malloc`.
const PAGE: usize = 4096;
const NEAR: usize = 64;

/// The most bytes to copy at once from the beginning of one to that of the other.
#[must_use]
pub fn piece<A, B>(to: &[A], from: &[B]) -> usize {
    let behind = to.as_ptr().addr().wrapping_sub(from.as_ptr().addr()) % PAGE;
    if X86 && (1..NEAR).contains(&behind) {
        // Unknown to the compiler, which would make one copy of all pieces.
        black_box(SHORT)
    } else {
        usize::MAX
    }
}

/// Copies `from` to the beginning of `to`, as far as there is room.
#[inline(never)] // in many places
pub fn copy(to: &mut [u8], from: &[u8]) {
    if !X86 || from.len() <= SHORT {
        return copy_piece(to, from);
    }
    let piece = piece(to, from);
    for (to, from) in to.chunks_mut(piece).zip(from.chunks(piece)) {
        copy_piece(to, from);
    }
}

#[inline]
fn copy_piece(to: &mut [u8], from: &[u8]) {
    let len = to.len().min(from.len());
    if let (Some(to), Some(from)) = (to.get_mut(..len), from.get(..len)) {
        to.copy_from_slice(from);
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec;
    use std::vec::Vec;

    #[test]
    fn only_a_target_a_little_behind_its_source_takes_pieces() {
        let bytes = [0_u8; 2 * PAGE];
        let of = |to: usize, from: usize| piece(&bytes[to..], &bytes[from..]);
        let short = if X86 { SHORT } else { usize::MAX };
        assert_eq!(
            (of(0, 0), of(NEAR, 0), of(0, 1)),
            (usize::MAX, usize::MAX, usize::MAX)
        );
        assert_eq!((of(1, 0), of(PAGE + NEAR - 1, 0)), (short, short));
    }

    #[test]
    fn every_byte_arrives_and_no_other_changes() {
        let sizes = [0, 1, 3, 1023, 1024, 1025, 2048, 5000, 70_001];
        for (len, room) in sizes.iter().flat_map(|len| sizes.map(|room| (*len, room))) {
            let from: Vec<u8> = (0..len).map(|at| (at % 251) as u8).collect();
            let mut to = vec![255; room + PAGE];
            // In pieces and in one.
            let distances = to.iter().map(|byte| core::ptr::from_ref(byte).addr());
            let distances = distances.map(|at| at.wrapping_sub(from.as_ptr().addr()) % PAGE);
            let near = distances.take(PAGE).position(|distance| distance == 4);
            for start in [near.unwrap_or_default(), 0, 1, 700] {
                to.fill(255);
                let end = start + room;
                copy(&mut to[start..end], &from);
                let filled = start + len.min(room);
                assert_eq!(to[start..filled], from[..filled - start]);
                let mut others = to[..start].iter().chain(&to[filled..]);
                assert!(others.all(|byte| *byte == 255), "{len} into {room}");
            }
        }
    }
}
