//! [`Piece`]s go over the line. Each makes sense alone, because any of them may be lost.
//!
//! | bytes | every piece (little-endian) |
//! |---|---|
//! | 0 (4) | `rplb` |
//! | 4, 5 | version 1; kind: 1 events, 2 a thread, 3 a name |
//! | 6 (2) | number of events; number of threads; the name's id, 0 for the board's own name |
//!
//! | events | a thread | a name |
//! |---|---|---|
//! | 8: number of the first | 8, 9, 10, 11: index, task, role, level | 8: kind |
//! | 16: the board's clock now, ns | 12, 13: bytes of name and of policy | 9: bytes of the text |
//! | 24: Unix time less that clock, ns; -2^63: unknown | 16, 24: budget, period, ns | 16: the text |
//! | 32: 16 bytes each | 32 to 64: CPU time high, low; exhaustions, replenishments; budget left | |
//! | | 72: name, policy | |

use super::compact::CompactEvent;
use crate::layout::{NameKind, Role, RunningTotals};
use core::fmt;

/// The topic on which boards send pieces, as `std_msgs/msg/UInt8MultiArray`, best effort.
pub const TOPIC: &str = "/replenish/recorder";
/// Bytes of the longest piece.
pub const MAX_PIECE: usize = 32 + EVENTS_PER_PIECE * CompactEvent::BYTES;
/// Events in a piece, at most.
pub const EVENTS_PER_PIECE: usize = 11;
/// Threads of a board, at most.
pub const MAX_BOARD_THREADS: usize = 16;
/// Names of a board, at most.
pub const MAX_BOARD_NAMES: usize = 32;
/// Bytes of a name or a policy of a board, at most.
pub const MAX_BOARD_TEXT: usize = 40;

const MAGIC: &[u8; 4] = b"rplb";
const VERSION: u8 = 1;
const UNKNOWN: i64 = i64::MIN;
/// Where the texts of a thread, and of a name, begin.
const THREAD_TEXT: usize = 72;
const NAME_TEXT: usize = 16;

/// A thread of a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BoardThread<'a> {
    /// Its place, from 0, and how many threads there are.
    pub index: usize,
    /// As above.
    pub threads: usize,
    /// The number of its task, as in [`CompactEvent`].
    pub task: u8,
    /// Its work.
    pub role: Role,
    /// Budget and period in nanoseconds.
    pub budget: Option<(u64, u64)>,
    /// Its account.
    pub totals: RunningTotals,
    /// Its name; the first [`MAX_BOARD_TEXT`] bytes are sent.
    pub name: &'a str,
    /// The policy that it was granted; as the name.
    pub policy: &'a str,
}

/// A piece of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Piece<'a> {
    /// Some events, as they stand in the ring.
    Events {
        /// The number of the first.
        first: u64,
        /// The board's clock as it was sent, ns.
        now: u64,
        /// Unix time less the board's clock, ns, by the protocol's time exchange; `None` if that is
        /// not known.
        ahead: Option<i64>,
        /// 16 bytes each.
        events: &'a [u8],
    },
    /// A thread.
    Thread(BoardThread<'a>),
    /// A name.
    Name {
        /// Its id; 0: the board's own name.
        id: u16,
        /// Its kind.
        kind: NameKind,
        /// The first [`MAX_BOARD_TEXT`] bytes are sent.
        text: &'a str,
    },
}

/// Why bytes are no piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PieceError {
    /// They do not begin as one.
    NoPiece,
    /// A version that this reader does not know.
    Version(u8),
    /// A field is out of its range.
    Field(&'static str),
}

impl fmt::Display for PieceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoPiece => f.write_str("no piece of a board's recording"),
            Self::Version(version) => {
                write!(
                    f,
                    "version {version} of a piece: this program reads {VERSION}"
                )
            }
            Self::Field(name) => write!(f, "the piece's field {name:?} is out of range"),
        }
    }
}

impl core::error::Error for PieceError {}

/// Writes fields one after another; what does not fit is left out.
struct Fields<'a> {
    room: &'a mut [u8],
    len: usize,
}

impl Fields<'_> {
    fn bytes(&mut self, bytes: &[u8]) {
        for byte in bytes {
            if let Some(place) = self.room.get_mut(self.len) {
                *place = *byte;
                self.len += 1;
            }
        }
    }

    fn words(&mut self, words: &[u64]) {
        words
            .iter()
            .for_each(|word| self.bytes(&word.to_le_bytes()));
    }
}

/// The longest prefix of at most [`MAX_BOARD_TEXT`] bytes, as bytes.
fn cut(text: &str) -> (u8, &[u8]) {
    let mut end = text.len().min(MAX_BOARD_TEXT);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    let text = text.as_bytes().get(..end).unwrap_or_default();
    (u8::try_from(text.len()).unwrap_or(0), text)
}

impl<'a> Piece<'a> {
    /// Writes it; how many bytes it has, at most [`MAX_PIECE`]. Of more events than
    /// [`EVENTS_PER_PIECE`] the first are written.
    #[must_use]
    pub fn write(&self, room: &mut [u8; MAX_PIECE]) -> usize {
        let mut out = Fields { room, len: 0 };
        out.bytes(MAGIC);
        let small = |n: usize| u16::try_from(n).unwrap_or(u16::MAX).to_le_bytes();
        match self {
            Self::Events {
                first,
                now,
                ahead,
                events,
            } => {
                let most = EVENTS_PER_PIECE * CompactEvent::BYTES;
                let events = events.get(..most).unwrap_or(events);
                out.bytes(&[VERSION, 1]);
                out.bytes(&small(events.len() / CompactEvent::BYTES));
                out.words(&[*first, *now, ahead.unwrap_or(UNKNOWN).cast_unsigned()]);
                out.bytes(events);
            }
            Self::Thread(thread) => {
                let ((name_len, name), (policy_len, policy)) =
                    (cut(thread.name), cut(thread.policy));
                let byte = |n: usize| u8::try_from(n).unwrap_or(u8::MAX);
                let role = byte(usize::try_from(thread.role.number()).unwrap_or(0));
                let (budget, period) = thread.budget.unwrap_or_default();
                let totals = &thread.totals;
                out.bytes(&[VERSION, 2]);
                out.bytes(&small(thread.threads));
                out.bytes(&[byte(thread.index), thread.task, role, totals.is_low.into()]);
                out.bytes(&[name_len, policy_len, 0, 0]);
                out.words(&[budget, period, totals.high, totals.low]);
                out.words(&[totals.exhaustions, totals.replenishments, totals.available]);
                out.bytes(name);
                out.bytes(policy);
            }
            Self::Name { id, kind, text } => {
                let (len, text) = cut(text);
                out.bytes(&[VERSION, 3]);
                out.bytes(&id.to_le_bytes());
                out.bytes(&[
                    u8::try_from(kind.number()).unwrap_or(0),
                    len,
                    0,
                    0,
                    0,
                    0,
                    0,
                    0,
                ]);
                out.bytes(text);
            }
        }
        out.len
    }

    /// Reads a sample of [`TOPIC`] as it came: a piece as the data of a `UInt8MultiArray` without
    /// dimensions, with or without the encapsulation of CDR before it.
    ///
    /// # Errors
    /// [`PieceError`].
    pub fn in_sample(sample: &'a [u8]) -> Result<Self, PieceError> {
        let little = |rest: &'a [u8]| {
            let (head, data) = rest.split_first_chunk::<12>()?;
            let len = head.last_chunk::<4>()?;
            let len = usize::try_from(u32::from_le_bytes(*len)).ok()?;
            data.get(..len).filter(|data| data.starts_with(MAGIC))
        };
        let bare = little(sample);
        let data = bare.or_else(|| little(sample.get(4..)?));
        Self::read(data.ok_or(PieceError::NoPiece)?)
    }

    /// Reads what a stranger may have written.
    ///
    /// # Errors
    /// [`PieceError`].
    pub fn read(bytes: &'a [u8]) -> Result<Self, PieceError> {
        let Some((magic, rest)) = bytes.split_first_chunk::<4>() else {
            return Err(PieceError::NoPiece);
        };
        let Some(&[version, kind, low, high]) = rest.first_chunk() else {
            return Err(PieceError::NoPiece);
        };
        if magic != MAGIC {
            return Err(PieceError::NoPiece);
        }
        if version != VERSION {
            return Err(PieceError::Version(version));
        }
        let number = u16::from_le_bytes([low, high]);
        match kind {
            1 => events(bytes, number),
            2 => thread(bytes, number).map(Self::Thread),
            3 => name(bytes, number),
            _ => Err(PieceError::Field("kind")),
        }
    }
}

fn byte(bytes: &[u8], at: usize) -> Result<u8, PieceError> {
    bytes.get(at).copied().ok_or(PieceError::Field("length"))
}

fn word(bytes: &[u8], at: usize) -> Result<u64, PieceError> {
    let word = bytes.get(at..).and_then(<[u8]>::first_chunk);
    word.map(|word| u64::from_le_bytes(*word))
        .ok_or(PieceError::Field("length"))
}

fn text(bytes: &[u8], at: usize, len: u8) -> Result<&str, PieceError> {
    let len = usize::from(len);
    let text = bytes.get(at..at.saturating_add(len));
    let text = text.filter(|_| len <= MAX_BOARD_TEXT);
    text.and_then(|text| core::str::from_utf8(text).ok())
        .ok_or(PieceError::Field("text"))
}

fn events(bytes: &[u8], count: u16) -> Result<Piece<'_>, PieceError> {
    let (count, numbers) = (usize::from(count), u64::from(count));
    let end = 32 + count * CompactEvent::BYTES;
    let events = bytes.get(32..end).filter(|_| count <= EVENTS_PER_PIECE);
    let ahead = word(bytes, 24)?.cast_signed();
    let first = word(bytes, 8)?;
    if first.checked_add(numbers).is_none() {
        return Err(PieceError::Field("first"));
    }
    Ok(Piece::Events {
        first,
        now: word(bytes, 16)?,
        ahead: (ahead != UNKNOWN).then_some(ahead),
        events: events.ok_or(PieceError::Field("events"))?,
    })
}

fn thread(bytes: &[u8], threads: u16) -> Result<BoardThread<'_>, PieceError> {
    let (threads, index) = (usize::from(threads), usize::from(byte(bytes, 8)?));
    if !(1..=MAX_BOARD_THREADS).contains(&threads) || index >= threads {
        return Err(PieceError::Field("threads"));
    }
    let name = byte(bytes, 12)?;
    let policy = byte(bytes, 13)?;
    let budget = (word(bytes, 16)?, word(bytes, 24)?);
    Ok(BoardThread {
        index,
        threads,
        task: byte(bytes, 9)?,
        role: match byte(bytes, 10)? {
            1 => Role::Dispatcher,
            2 => Role::Worker,
            _ => return Err(PieceError::Field("role")),
        },
        budget: (budget.1 > 0).then_some(budget),
        totals: RunningTotals {
            high: word(bytes, 32)?,
            low: word(bytes, 40)?,
            exhaustions: word(bytes, 48)?,
            replenishments: word(bytes, 56)?,
            available: word(bytes, 64)?,
            is_low: byte(bytes, 11)? == 1,
        },
        name: text(bytes, THREAD_TEXT, name)?,
        policy: text(bytes, THREAD_TEXT + usize::from(name), policy)?,
    })
}

fn name(bytes: &[u8], id: u16) -> Result<Piece<'_>, PieceError> {
    let kind = NameKind::from_number(byte(bytes, 8)?.into());
    if usize::from(id) > MAX_BOARD_NAMES {
        return Err(PieceError::Field("id"));
    }
    Ok(Piece::Name {
        id,
        kind: kind.ok_or(PieceError::Field("kind of a name"))?,
        text: text(bytes, NAME_TEXT, byte(bytes, 9)?)?,
    })
}
