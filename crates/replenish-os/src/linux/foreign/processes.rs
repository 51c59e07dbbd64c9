//! Threads and children of a process, as `/proc` shows them: bounded, whatever the program does.

use crate::Tid;
use std::fs::File;
use std::io::{self, Read};

/// Threads of one process at most; further ones are not looked at.
const MOST_THREADS: usize = 4096;
/// Processes of one family at most.
const MOST_PROCESSES: usize = 1024;

/// The threads of process `pid`, in the kernel's order: those that were there at this moment.
///
/// # Errors
/// `ENOENT` or `ESRCH` if there is no such process.
pub fn tasks(pid: Tid) -> io::Result<Vec<Tid>> {
    let entries = std::fs::read_dir(format!("/proc/{pid}/task"))?;
    let numbers = entries.map_while(Result::ok).filter_map(|entry| {
        let number = entry.file_name().to_str()?.parse().ok()?;
        Tid::new(number)
    });
    Ok(numbers.take(MOST_THREADS).collect())
}

/// The processes that process `pid` has started and that still are its children. Empty where the
/// kernel does not list them (`CONFIG_PROC_CHILDREN`).
#[must_use]
pub fn children(pid: Tid) -> Vec<Tid> {
    let mut found = Vec::new();
    for tid in tasks(pid).unwrap_or_default() {
        let text = read(&format!("/proc/{pid}/task/{tid}/children")).unwrap_or_default();
        found.extend(
            text.split_whitespace()
                .filter_map(|word| word.parse().ok())
                .filter_map(Tid::new)
                .take(MOST_PROCESSES),
        );
    }
    found.truncate(MOST_PROCESSES);
    found
}

/// Process `pid` with its children, theirs, and so on: each once.
#[must_use]
pub fn family(pid: Tid) -> Vec<Tid> {
    let mut family = vec![pid];
    let mut next = 0;
    while let Some(&process) = family.get(next) {
        next += 1;
        for child in children(process) {
            if family.len() < MOST_PROCESSES && !family.contains(&child) {
                family.push(child);
            }
        }
    }
    family
}

/// The name of thread `tid`, at most 15 bytes; characters that would change a terminal are `?`.
/// `None` if it has ended.
#[must_use]
pub fn name(tid: Tid) -> Option<String> {
    let text = read(&format!("/proc/{tid}/comm")).ok()?;
    let text = text.strip_suffix('\n').unwrap_or(&text);
    let plain = |c: char| if c.is_control() { '?' } else { c };
    Some(text.chars().map(plain).collect())
}

/// Every process that `/proc` shows, at most 32768.
#[must_use]
pub fn processes() -> Vec<Tid> {
    let entries = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let numbers = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    numbers.filter_map(Tid::new).take(1 << 15).collect()
}

/// The arguments of process `pid` with spaces between them; `None` if it has ended or is one of the
/// kernel's.
#[must_use]
pub fn command_line(pid: Tid) -> Option<String> {
    let text = read(&format!("/proc/{pid}/cmdline")).ok()?;
    let line = text.trim_end_matches('\0').replace('\0', " ");
    (!line.is_empty()).then_some(line)
}

/// Time at which thread `tid` began, in clock ticks since the machine's start; `None` if it has
/// ended.
#[must_use]
pub fn start_of(tid: Tid) -> Option<u64> {
    Some(Stat::of(tid).filter(|stat| !stat.is_over())?.start)
}

/// Whether thread `tid` has ended, and only its number is left until its parent asks how.
pub(super) fn is_zombie(tid: Tid) -> bool {
    Stat::of(tid).is_none_or(|stat| stat.is_over())
}

/// The fields of `/proc/PID/task/TID/stat` that are used.
pub(super) struct Stat {
    pub(super) state: char,
    pub(super) flags: u64,
    pub(super) start: u64,
}

impl Stat {
    /// Whether the thread has ended, and only its number is left.
    fn is_over(&self) -> bool {
        matches!(self.state, 'Z' | 'X')
    }

    pub(super) fn of(tid: Tid) -> Option<Self> {
        Self::parse(&read(&format!("/proc/{tid}/task/{tid}/stat")).ok()?)
    }

    /// The name stands in parentheses, and may have some in it.
    fn parse(text: &str) -> Option<Self> {
        let (_, rest) = text.rsplit_once(')')?;
        let mut fields = rest.split_whitespace(); // from the third on
        let state = fields.next()?.chars().next()?;
        let flags = fields.nth(5)?.parse().ok()?; // the ninth
        let start = fields.nth(12)?.parse().ok()?; // the 22nd
        Some(Self {
            state,
            flags,
            start,
        })
    }
}

/// A small file of `/proc`; what is longer than 64 KiB is cut off.
pub(super) fn read(path: &str) -> io::Result<String> {
    let mut bytes = Vec::new();
    File::open(path)?.take(1 << 16).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::current_tid;
    use std::process::{Command, Stdio};

    #[test]
    fn names_with_parentheses_do_not_move_the_fields() {
        let text = "7 (a) b) S 1 7 7 0 -1 4194304 1 2 3 4 5 6 7 8 20 0 1 0 4711 9 9\n";
        let stat = Stat::parse(text).unwrap();
        assert_eq!((stat.state, stat.flags, stat.start), ('S', 4_194_304, 4711));
        assert!(Stat::parse("7 (a").is_none());
        assert!(Stat::parse("7 (a) S 1").is_none());
    }

    #[test]
    fn threads_and_children_are_found() {
        let me = Tid::new(std::process::id().cast_signed()).unwrap();
        assert!(tasks(me).unwrap().contains(&current_tid()));
        let mut child = Command::new("sh")
            .args(["-c", "cat; true"])
            .stdin(Stdio::piped())
            .spawn()
            .unwrap();
        let shell = Tid::new(child.id().cast_signed()).unwrap();
        if std::path::Path::new("/proc/self/task")
            .join(current_tid().to_string())
            .join("children")
            .exists()
        {
            assert!(children(me).contains(&shell));
            assert!(family(me).contains(&shell));
        }
        drop(child.stdin.take());
        child.wait().unwrap();
        assert!(tasks(shell).is_err() || tasks(shell).unwrap().is_empty());
        assert_eq!(name(Tid::new(i32::MAX).unwrap()), None);
        assert!(name(current_tid()).is_some());
    }
}
