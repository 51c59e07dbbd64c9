//! Events: what a thread records.

/// The kind of an event, with the meaning of its name and of its values `a` and `b`.
///
/// Times are those of readings of the clock that the executor makes anyway. Where none is made
/// (block, skip), it is the thread's last one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
#[repr(u16)]
pub enum Kind {
    /// The dispatcher took a sample for a handle, at its arrival. `a`: bytes.
    Take = 1,
    /// A worker became runnable: its bell rang, or a release came. `a`: when its wait returned, an
    /// instant; `b`: when it began, 0 where a [`Block`](Self::Block) says that.
    Wake = 2,
    /// A worker's budget is charged from here on. `a`: budget left, ns; `b`: CPU time so far, ns.
    Activate = 3,
    /// A callback of a handle starts. `a`: its release (arrival or timer), an instant.
    Begin = 4,
    /// It ended. `a`: its release.
    End = 5,
    /// A message was handed to the middleware; the name is the topic. `a`: bytes; `b`: 1 if it was
    /// refused.
    Publish = 6,
    /// A worker is about to wait; recorded of budgets and of a board's tasks. Of a budget: `a`,
    /// budget left, ns; `b`, CPU time so far, ns.
    Block = 7,
    /// A worker was found to have blocked inside a callback. `a`: budget left, ns; `b`: CPU time so
    /// far, ns.
    Unblock = 8,
    /// The budget is used up. `a`: how late the enforcer was, ns.
    Exhausted = 9,
    /// Budget came back. `a`: budget left, ns.
    Replenished = 10,
    /// The worker's level. `a`: 0 high, 1 low; `b`: budget left, ns.
    Level = 11,
    /// A callback ended after its deadline. `a`: by how much, ns; `b`: the deadline, ns.
    Miss = 12,
    /// A handle's inbox was full: a sample was dropped. `a`: bytes of the one that came.
    Drop = 13,
    /// Releases or samples were left out. `a`: how many.
    Skip = 14,
    /// A callback panicked.
    Panic = 15,
    /// The program's own mark. `a`: its value.
    Mark = 16,
    /// A thread's CPU clock was read. `a`: budget left, ns, 0 without one; `b`: CPU time so far,
    /// ns.
    Used = 17,
    /// A thread with a budget left the CPU. `a`: 0 preempted, 1 blocked.
    Off = 18,
    /// A thread with a budget got the CPU.
    On = 19,
    /// A callback waits for its group. `a`: the id of the handle that runs; 0 if it has just ended.
    Queue = 20,
    /// The callback that has begun is a stage of a chain; the name is the chain's. `a`: when the
    /// instance began, an instant; `b`: the stage, from 0.
    ChainStage = 21,
    /// The last stage of a chain has ended. `a`: when the instance began, an instant; `b`: its
    /// latency, ns.
    ChainEnd = 22,
    /// Events are missing here: the ring was full, and a dump was still to be copied. `a`: how
    /// many.
    Gap = 23,
}

impl Kind {
    /// Every kind, in the order of their numbers.
    pub const ALL: [Self; 23] = [
        Self::Take,
        Self::Wake,
        Self::Activate,
        Self::Begin,
        Self::End,
        Self::Publish,
        Self::Block,
        Self::Unblock,
        Self::Exhausted,
        Self::Replenished,
        Self::Level,
        Self::Miss,
        Self::Drop,
        Self::Skip,
        Self::Panic,
        Self::Mark,
        Self::Used,
        Self::Off,
        Self::On,
        Self::Queue,
        Self::ChainStage,
        Self::ChainEnd,
        Self::Gap,
    ];

    /// The kind with this number.
    #[must_use]
    pub fn from_number(number: u16) -> Option<Self> {
        let at = usize::from(number).checked_sub(1)?;
        Self::ALL.get(at).copied()
    }

    /// Its name, in lower case.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Take => "take",
            Self::Wake => "wake",
            Self::Activate => "activate",
            Self::Begin => "begin",
            Self::End => "end",
            Self::Publish => "publish",
            Self::Block => "block",
            Self::Unblock => "unblock",
            Self::Exhausted => "exhausted",
            Self::Replenished => "replenished",
            Self::Level => "level",
            Self::Miss => "miss",
            Self::Drop => "drop",
            Self::Skip => "skip",
            Self::Panic => "panic",
            Self::Mark => "mark",
            Self::Used => "used",
            Self::Off => "off",
            Self::On => "on",
            Self::Queue => "queue",
            Self::ChainStage => "chain_stage",
            Self::ChainEnd => "chain_end",
            Self::Gap => "gap",
        }
    }
}

/// An event as it is recorded: 32 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Event {
    /// Nanoseconds of `CLOCK_MONOTONIC`.
    pub time: u64,
    /// Its kind.
    pub kind: Kind,
    /// The id of a name: handle, topic or mark; 0 without one.
    pub name: u32,
    /// See [`Kind`].
    pub a: u64,
    /// See [`Kind`].
    pub b: u64,
}

impl Event {
    /// The words of the record that stands in a ring in this lap.
    #[inline]
    pub(crate) const fn words(&self, lap: u64) -> [u64; 4] {
        let kind = self.kind as u64 | (lap & 0xffff) << 16 | (self.name as u64) << 32;
        [self.time, kind, self.a, self.b]
    }

    /// Reads a record that must be of this lap.
    pub(crate) fn from_words([time, kind, a, b]: [u64; 4], lap: u64) -> Option<Self> {
        if (kind >> 16) & 0xffff != lap & 0xffff {
            return None;
        }
        let number = u16::try_from(kind & 0xffff).ok()?;
        Some(Self {
            time,
            kind: Kind::from_number(number)?,
            name: u32::try_from(kind >> 32).ok()?,
            a,
            b,
        })
    }
}
