//! Control groups of version 2, in which threads are stopped without budget (`--background
//! suspend`).
//!
//! ```text
//!   <this process's control group>/replenish-PID      every process that has budgets
//!                                    ├─ b0            threads of the first budget: cgroup.freeze
//!                                    └─ b1            (`threaded`: single threads move)
//! ```
//!
//! A process comes from its own control group and goes back there, which lets its threads go on.

use crate::outcome::Failure;
use replenish_os::Tid;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// Where the processes were before.
#[derive(Debug, Clone, Default)]
pub(super) struct Homes {
    /// The control group of all of them.
    pub(super) base: PathBuf,
    pub(super) homes: BTreeMap<Tid, PathBuf>,
}

/// The control group of this command, until it is dropped.
#[derive(Debug)]
pub(super) struct Cgroup {
    pub(super) homes: Homes,
}

impl Cgroup {
    /// Creates it in this process's own control group.
    pub(super) fn create() -> Result<Self, Failure> {
        let me = std::process::id().cast_signed();
        let home = Tid::new(me).map(group_of).transpose().map_err(refused)?;
        let base = home.unwrap_or_default().join(format!("replenish-{me}"));
        fs::create_dir(&base).map_err(refused)?;
        let homes = Homes {
            base,
            homes: BTreeMap::new(),
        };
        Ok(Self { homes })
    }

    /// The `cgroup.freeze` of budget `place`.
    pub(super) fn budget(&self, place: usize) -> Result<File, Failure> {
        let group = self.homes.base.join(format!("b{place}"));
        fs::create_dir(&group)
            .and_then(|()| fs::write(group.join("cgroup.type"), "threaded"))
            .and_then(|()| {
                File::options()
                    .write(true)
                    .open(group.join("cgroup.freeze"))
            })
            .map_err(refused)
    }

    /// The control group that process `pid` has now.
    pub(super) fn home(pid: Tid) -> Result<PathBuf, Failure> {
        group_of(pid).map_err(refused)
    }

    /// Takes a process in, which stays as it is until [`put`](Self::put).
    pub(super) fn take(&mut self, pid: Tid, home: PathBuf) -> Result<(), Failure> {
        self.homes.homes.insert(pid, home);
        self.enter(pid)
    }

    /// Takes a process in again, if somebody has moved it out.
    pub(super) fn enter(&self, pid: Tid) -> Result<(), Failure> {
        let path = self.homes.base.join("cgroup.procs");
        ended_is_fine(fs::write(path, pid.to_string())).map_err(refused)
    }

    /// Whether a process is where it was taken.
    pub(super) fn has(&self, pid: Tid) -> bool {
        group_of(pid).map_or(true, |group| group.starts_with(&self.homes.base))
    }

    /// Puts a thread under the switch of budget `place`, or under none.
    pub(super) fn put(&self, tid: Tid, place: Option<usize>) -> Result<(), Failure> {
        let base = &self.homes.base;
        let group = place.map_or(base.clone(), |place| base.join(format!("b{place}")));
        let moved = fs::write(group.join("cgroup.threads"), tid.to_string());
        ended_is_fine(moved).map_err(refused)
    }

    /// A process goes back to where it was.
    pub(super) fn leave(&mut self, pid: Tid) {
        if let Some(home) = self.homes.homes.remove(&pid) {
            fs::write(home.join("cgroup.procs"), pid.to_string()).ok(); // it has ended
        }
    }
}

impl Drop for Cgroup {
    fn drop(&mut self) {
        self.homes.send_back();
        self.homes.remove();
    }
}

impl Homes {
    /// Every process goes back to where it was; one that began meanwhile where the first one was.
    /// Threads that were stopped go on.
    pub(super) fn send_back(&self) {
        if self.base.as_os_str().is_empty() {
            return;
        }
        let usual = self.homes.values().next().cloned();
        let usual = usual.or_else(|| self.base.parent().map(Path::to_path_buf));
        // Twice: a process can be born meanwhile.
        for _ in 0..2 {
            let text = fs::read_to_string(self.base.join("cgroup.procs")).unwrap_or_default();
            for number in text.split_whitespace() {
                let pid = number.parse().ok().and_then(Tid::new);
                let home = pid.and_then(|pid| self.homes.get(&pid)).or(usual.as_ref());
                if let Some(home) = home {
                    fs::write(home.join("cgroup.procs"), number).ok(); // it has ended
                }
            }
        }
    }

    /// Removes the control groups, which nobody is in any more.
    pub(super) fn remove(&self) {
        if self.base.as_os_str().is_empty() {
            return;
        }
        for entry in fs::read_dir(&self.base).into_iter().flatten().flatten() {
            if entry.path().is_dir() {
                fs::remove_dir(entry.path()).ok(); // somebody is in it
            }
        }
        fs::remove_dir(&self.base).ok(); // the same
    }
}

/// A thread or process that has ended needs no place.
fn ended_is_fine(moved: io::Result<()>) -> io::Result<()> {
    match moved {
        Err(e) if e.raw_os_error() == Some(ESRCH) => Ok(()),
        moved => moved,
    }
}

/// `ESRCH` of Linux.
const ESRCH: i32 = 3;

fn refused(why: impl std::fmt::Display) -> Failure {
    Failure::refused(format!(
        "--background suspend needs control groups of version 2 in which this process may move \
         threads: {why}; --background idle needs none"
    ))
}

/// The directory of the control group of process `pid`.
fn group_of(pid: Tid) -> io::Result<PathBuf> {
    let table = fs::read_to_string("/proc/self/mountinfo")?;
    let mount = table.lines().find_map(mount_of);
    let none = || io::Error::new(io::ErrorKind::NotFound, "none are mounted");
    let (root, mount) = mount.ok_or_else(none)?;
    let text = fs::read_to_string(format!("/proc/{pid}/cgroup"))?;
    let path = text.lines().find_map(|line| line.strip_prefix("0::"));
    let path = path.ok_or_else(none)?.trim_end_matches(" (deleted)");
    let inner = path.strip_prefix(root).unwrap_or(path);
    Ok(Path::new(mount).join(inner.trim_start_matches('/')))
}

/// The root and the place of a mount of control groups of version 2. Of `mountinfo`: number,
/// parent, device, root, place, options, more, `-`, type.
fn mount_of(line: &str) -> Option<(&str, &str)> {
    let (place, kind) = line.split_once(" - ")?;
    kind.starts_with("cgroup2 ").then_some(())?;
    let mut fields = place.split(' ').skip(3);
    let root = fields.next()?;
    Some((root.trim_end_matches('/'), fields.next()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mount_of_version_2_is_found() {
        let line = "41 32 0:38 / /sys/fs/cgroup/unified rw,relatime - cgroup2 cgroup2 rw";
        assert_eq!(mount_of(line), Some(("", "/sys/fs/cgroup/unified")));
        let inner = "9 8 0:3 /docker/1 /sys/fs/cgroup ro - cgroup2 cgroup rw";
        assert_eq!(mount_of(inner), Some(("/docker/1", "/sys/fs/cgroup")));
        assert_eq!(
            mount_of("37 32 0:34 / /sys/fs/cgroup/freezer rw - cgroup cgroup rw"),
            None
        );
        assert_eq!(mount_of(""), None);
    }
}
