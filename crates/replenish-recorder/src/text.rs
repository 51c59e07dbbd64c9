//! Texts of bounded length in words, padded with zeros.

use crate::word::Word;
use alloc::string::String;
use core::sync::atomic::Ordering;

/// The longest prefix of `text` that has at most `bytes` bytes.
fn prefix(text: &str, bytes: usize) -> &str {
    let mut end = text.len().min(bytes);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    text.get(..end).unwrap_or_default()
}

/// Writes as much of `text` as there is room.
pub(crate) fn store<W: Word>(words: &[W], text: &str) {
    let mut bytes = prefix(text, words.len() * 8).bytes();
    for word in words {
        let mut value = [0; 8];
        for (to, from) in value.iter_mut().zip(bytes.by_ref()) {
            *to = from;
        }
        word.store(u64::from_le_bytes(value), Ordering::Relaxed);
    }
}

/// Reads what a stranger wrote: up to the first zero; what is no UTF-8 or would move a terminal's
/// cursor is replaced.
pub(crate) fn load(bytes: &[u8]) -> String {
    let text = bytes.split(|b| *b == 0).next().unwrap_or_default();
    let text = String::from_utf8_lossy(text);
    // Control characters, and those that turn the direction of writing.
    let foul = |c: char| {
        c.is_control()
            || matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
    };
    let clean = |c| {
        if foul(c) {
            char::REPLACEMENT_CHARACTER
        } else {
            c
        }
    };
    text.chars().map(clean).collect()
}
