//! Stretches of the file.

/// A stretch of the file in words.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Span {
    /// The first word.
    pub start: usize,
    /// The number of words.
    pub words: usize,
}

impl Span {
    /// The stretch itself; empty where the memory is shorter.
    #[inline]
    #[must_use]
    pub fn of<W>(self, memory: &[W]) -> &[W] {
        let end = self.start.saturating_add(self.words);
        memory.get(self.start..end).unwrap_or_default()
    }
}
