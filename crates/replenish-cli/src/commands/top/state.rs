//! The user's view: what is sorted by which column, what is selected, what a key does.

use super::reading::{Key, Reading, Row};
use std::cmp::Reverse;

/// The order of the rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Sort {
    /// By program and worker.
    #[default]
    Name,
    /// CPU time in the window, most first.
    Used,
    /// Budgets used up in the window, and then since the start, most first.
    Exhausted,
    /// Late callbacks, and then the worst response, most first.
    Late,
    /// Samples without room, most first.
    Drops,
    /// By CPU.
    Cpu,
}

impl Sort {
    pub(super) const ALL: [(char, Self, &'static str); 6] = [
        ('n', Self::Name, "name"),
        ('u', Self::Used, "used"),
        ('e', Self::Exhausted, "exhausted"),
        ('l', Self::Late, "late"),
        ('d', Self::Drops, "drops"),
        ('c', Self::Cpu, "cpu"),
    ];

    /// Sorts; equal rows stay in the order of their names.
    pub(super) fn sort(self, rows: &mut [Row]) {
        rows.sort_by(|a, b| (&a.program, a.pid, &a.key).cmp(&(&b.program, b.pid, &b.key)));
        match self {
            Self::Name => {}
            Self::Used => rows.sort_by_key(|r| Reverse(r.since.used)),
            Self::Exhausted => rows.sort_by_key(|r| Reverse((r.since.exhaustions, r.exhaustions))),
            Self::Late => rows.sort_by_key(|r| Reverse((r.since.late, r.since.worst_response))),
            Self::Drops => rows.sort_by_key(|r| Reverse(r.since.drops)),
            Self::Cpu => rows.sort_by_key(|r| r.cpu.map_or(u64::MAX, |cpu| cpu)),
        }
    }
}

/// A key that was pressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Press {
    Letter(char),
    Up,
    Down,
    PageUp,
    PageDown,
    Home,
    End,
    Enter,
    Back,
}

/// The keys in the bytes that a terminal sends at a time.
pub(super) fn presses(mut bytes: &[u8]) -> Vec<Press> {
    const SEQUENCES: [(&[u8], Press); 12] = [
        (b"\x1b[A", Press::Up),
        (b"\x1bOA", Press::Up),
        (b"\x1b[B", Press::Down),
        (b"\x1bOB", Press::Down),
        (b"\x1b[5~", Press::PageUp),
        (b"\x1b[6~", Press::PageDown),
        (b"\x1b[H", Press::Home),
        (b"\x1b[1~", Press::Home),
        (b"\x1b[F", Press::End),
        (b"\x1b[4~", Press::End),
        (b"\r", Press::Enter),
        (b"\n", Press::Enter),
    ];
    let mut all = Vec::new();
    'next: while let Some((first, rest)) = bytes.split_first() {
        for (sequence, press) in SEQUENCES {
            if let Some(after) = bytes.strip_prefix(sequence) {
                all.push(press);
                bytes = after;
                continue 'next;
            }
        }
        bytes = rest;
        match first {
            0x1b if rest.first() == Some(&b'[') => {
                // A key that nothing listens to: its sequence ends with a letter or a tilde.
                let end = rest.iter().skip(1).position(|b| (0x40..=0x7e).contains(b));
                bytes = end.and_then(|end| rest.get(end + 2..)).unwrap_or_default();
            }
            0x1b | 0x7f | 0x08 => all.push(Press::Back),
            b' '..=b'~' => all.push(Press::Letter(char::from(*first))),
            _ => {}
        }
    }
    all
}

/// View on the screen.
#[derive(Debug, Default)]
pub(super) struct State {
    pub(super) sort: Sort,
    /// The row that is selected, and its place if it is gone.
    pub(super) selected: Option<Key>,
    pub(super) at: usize,
    /// The first row on the screen.
    pub(super) top: usize,
    /// One worker alone.
    pub(super) detail: bool,
    pub(super) paused: bool,
    pub(super) quit: bool,
    /// Its recording is to be written to a file.
    pub(super) save: bool,
    /// A line about the last thing that was done.
    pub(super) notice: String,
}

impl State {
    /// The place of the selected row, which is then on one of `height` lines.
    pub(super) fn settle(&mut self, rows: &[Row], height: usize) -> usize {
        let found = rows
            .iter()
            .position(|row| Some(&row.key) == self.selected.as_ref());
        self.at = found.unwrap_or(self.at).min(rows.len().saturating_sub(1));
        self.selected = rows.get(self.at).map(|row| row.key.clone());
        let (first, last) = (
            (self.at + 1).saturating_sub(height),
            rows.len().saturating_sub(height),
        );
        self.top = self.top.min(last).clamp(first, self.at);
        self.at
    }

    /// Carries out a key; a page has `height` rows.
    pub(super) fn press(&mut self, press: Press, reading: &Reading, height: usize) {
        let rows = &reading.rows;
        let last = rows.len().saturating_sub(1);
        let page = height.max(1);
        self.notice.clear();
        let to = match press {
            Press::Letter('q') => {
                self.quit = true;
                return;
            }
            Press::Back if self.detail => {
                self.detail = false;
                return;
            }
            Press::Enter => {
                self.detail = !self.detail && !rows.is_empty();
                return;
            }
            Press::Letter(' ' | 'p') => {
                self.paused = !self.paused;
                return;
            }
            Press::Letter('t') => {
                self.save = !rows.is_empty();
                return;
            }
            Press::Letter('k') | Press::Up => self.at.saturating_sub(1),
            Press::Letter('j') | Press::Down => self.at + 1,
            Press::PageUp => self.at.saturating_sub(page),
            Press::PageDown => self.at + page,
            Press::Home => 0,
            Press::End => last,
            Press::Letter(letter) => {
                let mut all = Sort::ALL.iter();
                if let Some((_, sort, name)) = all.find(|(key, ..)| *key == letter) {
                    self.sort = *sort;
                    self.notice = format!("sorted by {name}");
                }
                return;
            }
            Press::Back => return,
        };
        self.at = to.min(last);
        self.selected = rows.get(self.at).map(|row| row.key.clone());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::top::reading::Since;

    fn row(n: usize, used: u64) -> Row {
        let since = Since {
            used,
            ..Since::default()
        };
        Row {
            key: ("f".into(), n),
            since,
            ..Row::default()
        }
    }

    #[test]
    fn keys_are_read_from_what_terminals_send() {
        let all = presses(b"u\x1b[A\x1bOB\x1b[5~\r\x1b[1;5Cq\x1b");
        let keys = [
            Press::Letter('u'),
            Press::Up,
            Press::Down,
            Press::PageUp,
            Press::Enter,
            Press::Letter('q'),
            Press::Back,
        ];
        assert_eq!(all, keys);
        assert_eq!(presses(b"\x1b[1;5"), []);
        assert_eq!(presses(&[0, 1, 200, 255]), []);
    }

    #[test]
    fn the_selected_row_stays_selected_where_the_order_changes() {
        let mut reading = Reading {
            rows: (0..40).map(|n| row(n, n as u64)).collect(),
            ..Reading::default()
        };
        let mut state = State::default();
        state.settle(&reading.rows, 10);
        for _ in 0..3 {
            state.press(Press::Down, &reading, 10);
        }
        assert_eq!(state.settle(&reading.rows, 10), 3);
        state.press(Press::Letter('u'), &reading, 10);
        state.sort.sort(&mut reading.rows);
        assert_eq!(state.settle(&reading.rows, 10), 36);
        assert_eq!(state.top, 27, "it is on the last of ten lines");
        state.press(Press::Home, &reading, 10);
        assert_eq!(state.settle(&reading.rows, 10), 0);
        assert_eq!(state.top, 0);
        reading.rows.truncate(1); // it is gone with its program
        assert_eq!(state.settle(&reading.rows, 10), 0);
        reading.rows.clear();
        assert_eq!(state.settle(&reading.rows, 10), 0);
        state.press(Press::Down, &reading, 10);
        state.press(Press::Enter, &reading, 10);
        assert!(!state.detail);
    }
}
