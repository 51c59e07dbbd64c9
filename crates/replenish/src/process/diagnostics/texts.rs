//! Levels of a status, and texts of bounded length in strings that are kept: rewriting one does
//! not allocate.

use core::fmt::{self, Write};
use replenish_interfaces::diagnostic_msgs::msg::{DiagnosticStatus, KeyValue};
use std::string::String;

pub(super) const OK: u8 = 0;
pub(super) const WARN: u8 = 1;
pub(super) const ERROR: u8 = 2;

/// Bytes of a name, of a message, and of a value, at most.
pub(super) const NAME: usize = 192;
pub(super) const MESSAGE: usize = 256;
pub(super) const VALUE: usize = 64;

/// Rewrites `text`, at most `limit` bytes of it.
pub(super) fn put(text: &mut String, limit: usize, new: fmt::Arguments<'_>) {
    text.clear();
    Bounded { text, limit }.write_fmt(new).ok(); // cut where it is full
}

/// An empty text with room for `limit` bytes.
pub(super) fn with_room(limit: usize) -> String {
    String::with_capacity(limit)
}

/// A status with room for every later value.
pub(super) fn roomy(
    name: fmt::Arguments<'_>,
    hardware: &str,
    keys: &[&'static str],
) -> DiagnosticStatus {
    let mut text = with_room(NAME);
    put(&mut text, NAME, name);
    let values = keys.iter().map(|&key| KeyValue {
        key: key.into(),
        value: with_room(VALUE),
    });
    DiagnosticStatus {
        level: OK,
        name: text,
        message: with_room(MESSAGE),
        hardware_id: hardware.into(),
        values: values.collect(),
    }
}

/// Adds `new` to `text`, after a comma if it is not the first.
pub(super) fn join(text: &mut String, limit: usize, new: fmt::Arguments<'_>) {
    let comma = if text.is_empty() { "" } else { ", " };
    let mut bounded = Bounded { text, limit };
    bounded.write_fmt(format_args!("{comma}{new}")).ok(); // cut where it is full
}

struct Bounded<'a> {
    text: &'a mut String,
    limit: usize,
}

impl Write for Bounded<'_> {
    fn write_str(&mut self, part: &str) -> fmt::Result {
        let room = self.limit.saturating_sub(self.text.len());
        let mut cut = room.min(part.len());
        while !part.is_char_boundary(cut) {
            cut -= 1;
        }
        self.text.push_str(part.get(..cut).unwrap_or_default());
        if cut < part.len() {
            return Err(fmt::Error);
        }
        Ok(())
    }
}

pub(super) fn value(pair: &mut KeyValue, new: core::fmt::Arguments<'_>) {
    put(&mut pair.value, VALUE, new);
}

/// Nanoseconds, printed as milliseconds.
pub(super) struct Ms(pub(super) u64);

impl core::fmt::Display for Ms {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{:.3}", self.0 as f64 / 1e6)
    }
}
