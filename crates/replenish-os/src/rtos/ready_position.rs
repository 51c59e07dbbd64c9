//! The place of a thread among the ready threads of its priority.

/// Position at which a thread enters the list of its new priority.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum ReadyPosition {
    /// Before its equals. A thread that loses an inherited priority ran already (POSIX: unlocking
    /// does not move a thread to the tail).
    Head,
    /// Behind its equals.
    Tail,
}
