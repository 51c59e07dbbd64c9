//! A flight recorder for real-time threads: the last events of every thread, always on.
//!
//! ```text
//!   one thread ── write ──► ring: overwriting, wait-free     the file of a program
//!                             │                              ┌────────┬─────────┬───────┬───────┐
//!   another thread, or a  ◄───┘ read: copies, then drops     │ header │ threads │ names │ rings │
//!   process with the file       records that were being      └────────┴─────────┴───────┴───────┘
//!                               overwritten meanwhile
//! ```
//!
//! ```text
//!   event ── Kind, Event: 32 bytes      layout ── what stands where in the file; writing it
//!   ring ─── Writer, read               view ──── reading a file that somebody else wrote
//!   word ─── the atomics below          text ──── names of bounded length │ checksum │ span
//!   chain ── figures of chains, which stand in the file beside the events
//!   copy ─── a recording as a file of its own, while its program goes on
//!   board ── the same events at 16 bytes on a microcontroller, and their way to a host
//!   models ─ every interleaving of the ring (`--cfg loom`)
//! ```
//!
//! The writer never looks at a reader, so no reader can slow it down; it never reads anything back
//! from memory that others may write, so no other process can lead it astray. Records are words of
//! 64 bits, little-endian in the file.
//!
//! # The file, version 1
//! Offsets in bytes; every field is a little-endian word of 8 bytes unless a size is given.
//!
//! | header, at 0 (4096 bytes) | |
//! |---|---|
//! | 0 | magic, the bytes `rplnlive` |
//! | 8 | version: 1 |
//! | 16 | length of the file |
//! | 24 | process id, in the program's own pid namespace |
//! | 32, 40 | number of threads, offset of their table |
//! | 48, 56 | number of names that fit, offset of their table |
//! | 64, 72, 80 | `CLOCK_MONOTONIC`, `CLOCK_BOOTTIME`, `CLOCK_REALTIME` of one moment at the start, ns |
//! | 88 | offset of the table of chains plus their number, 0 to 64; 0 without chains |
//! | 96 (128) | the program's name, UTF-8, padded with zeros |
//! | 224 | FNV-1a (64 bits) of the 224 bytes before it |
//! | 232, 240 | dumps that were written, and triggers that were suppressed |
//!
//! | a thread (256 bytes) | |
//! |---|---|
//! | 0 | thread id; 0 before it has begun |
//! | 8 | role: 1 dispatcher, 2 worker |
//! | 16 | CPU + 1; 0: not pinned |
//! | 24, 32 | budget and period, ns; 0 without a budget |
//! | 40, 48 | offset and bytes of its ring |
//! | 56, 64 | offset and bytes of the ring of its budget; 0 without a budget |
//! | 72 | reserved: 0 |
//! | 80, 88 | CPU time used at high and at low priority, ns |
//! | 96, 104 | exhaustions, replenishments |
//! | 112, 120 | budget left, ns, and level (0 high, 1 low) |
//! | 128 (64) | name |
//! | 192 (64) | policy as the kernel granted it |
//!
//! | a name (128 bytes) | |
//! |---|---|
//! | 0 | its kind: 0 not written yet, 1 handle, 2 topic, 3 mark, 4 chain |
//! | 8 (120) | text |
//!
//! | a chain (1024 bytes) | |
//! |---|---|
//! | 0 | id of its name in events |
//! | 8, 16 | limit and analysed bound, ns; 0 without one |
//! | 24, 32, 40 | instances that have begun, that have ended, that took longer than the limit |
//! | 48 | latencies of all that have ended, added up, ns |
//! | 56, 64 | the longest latency, and when that instance began, ns; 0 before one has ended |
//! | 72 (56) | reserved: 0 |
//! | 128 (64) | name |
//! | 192 (816) | ended instances by latency, in 102 buckets of a quarter of an octave, see [`bucket_end`] |
//!
//! | a ring | |
//! |---|---|
//! | 0 | records begun |
//! | 8 | records done |
//! | 16 (48) | reserved: 0 |
//! | 64 | slots of 32 bytes, a power of two: record `n` stands in slot `n mod slots` |
//!
//! | a record (32 bytes) | |
//! |---|---|
//! | 0 | time, ns of `CLOCK_MONOTONIC` |
//! | 8 | kind (16 bits), lap `n / slots` (16 bits), id of a name (32 bits) |
//! | 16, 24 | two values, see [`Kind`] |
#![forbid(unsafe_code)]
#![cfg_attr(not(loom), no_std)]

extern crate alloc;

pub mod board;
mod chain;
mod checksum;
mod copy;
mod event;
mod layout;
#[cfg(all(test, loom))]
mod models;
mod ring;
mod span;
mod text;
mod view;
mod word;

pub use chain::{
    CHAIN_BUCKETS, ChainCount, ChainView, MAX_CHAINS, PlannedChain, add_to_chain, bucket_end,
    write_chain_worst,
};
pub use copy::copy;
pub use event::{Event, Kind};
pub use layout::{
    Clocks, LayoutError, MAX_BYTES, MAX_NAMES, MAX_RING, MAX_THREADS, MIN_RING, NameKind, Plan,
    Planned, Role, RunningTotals, ThreadSpan, write_dumps, write_name, write_policy,
    write_thread_name, write_tid, write_totals,
};
pub use ring::{Copied, Writer, read};
pub use span::Span;
pub use view::{Invalid, Source, ThreadView, View};
pub use word::Word;
