//! The facts behind a refusal, from `/proc`, `/sys` and `getrlimit(2)`.

use rustix::param::page_size;
use rustix::process::{Resource, getrlimit};
use std::fmt;
use std::fs;
use std::path::PathBuf;

/// `CAP_IPC_LOCK` (linux/capability.h).
pub(in crate::linux) const CAP_IPC_LOCK: u32 = 14;
/// `CAP_SYS_NICE`.
pub(super) const CAP_SYS_NICE: u32 = 23;

/// A resource limit; `None` is unlimited.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Limit {
    /// The limit in force.
    pub soft: Option<u64>,
    /// The limit up to which the process may raise it itself.
    pub hard: Option<u64>,
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.soft {
            Some(n) => n.fmt(f),
            None => f.write_str("unlimited"),
        }
    }
}

/// `getrlimit(2)`.
pub(in crate::linux) fn limit(resource: Resource) -> Limit {
    let limit = getrlimit(resource);
    Limit {
        soft: limit.current,
        hard: limit.maximum,
    }
}

/// A set of Linux capabilities.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(in crate::linux) struct Capabilities(u64);

impl Capabilities {
    pub(in crate::linux) fn contains(self, capability: u32) -> bool {
        self.0 >> capability & 1 == 1
    }

    fn parse(status: &str) -> Self {
        let line = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
        let bits = line.and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok());
        Self(bits.unwrap_or(0))
    }
}

/// The effective capabilities of the calling thread.
pub(in crate::linux) fn effective_capabilities() -> Capabilities {
    Capabilities::parse(&fs::read_to_string("/proc/thread-self/status").unwrap_or_default())
}

/// Whether what this process has mapped now may be locked.
pub(super) fn memory_lock(capable: bool, limit: Limit) -> Result<(), String> {
    let Some(limit) = limit.soft.filter(|_| !capable) else {
        return Ok(());
    };
    let mapped = mapped_bytes();
    if mapped <= limit {
        return Ok(());
    }
    let (limit, mapped) = (limit >> 10, mapped >> 10);
    Err(format!(
        "RLIMIT_MEMLOCK is {limit} KiB, this process has {mapped} KiB mapped"
    ))
}

/// Bytes of address space that this process has mapped, which `mlockall` would lock.
pub(in crate::linux) fn mapped_bytes() -> u64 {
    let statm = fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages: u64 = statm
        .split(' ')
        .next()
        .and_then(|n| n.parse().ok())
        .unwrap_or(0);
    pages.saturating_mul(page_size() as u64)
}

/// The rule of this process's control group for real-time threads.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum CgroupRt {
    /// The `cpu` controller is bound to version 1 and gives real-time threads this much CPU.
    V1 {
        /// The control file, for the command that changes it.
        file: PathBuf,
        /// `cpu.rt_runtime_us`; 0 forbids real-time threads even to root.
        rt_runtime_us: i64,
    },
    /// Version 1 without real-time group scheduling in the kernel: nothing in the way.
    V1NoRtGroups,
    /// Version 2. It has no real-time bandwidth; a kernel with `CONFIG_RT_GROUP_SCHED` refuses
    /// real-time threads outside its root group.
    V2 {
        /// The group's path; `/` is the root.
        path: String,
    },
    /// This system has no control groups, or they are unreadable.
    None,
}

impl CgroupRt {
    /// 1 or 2, the version that has the `cpu` controller; `None` without control groups.
    #[must_use]
    pub const fn version(&self) -> Option<u8> {
        match self {
            Self::V1 { .. } | Self::V1NoRtGroups => Some(1),
            Self::V2 { .. } => Some(2),
            Self::None => None,
        }
    }
}

/// Place of this process in the control groups.
pub(super) fn cgroup() -> CgroupRt {
    let membership = fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    let mounts = fs::read_to_string("/proc/self/mountinfo").unwrap_or_default();
    if let Some(path) = v1_path(&membership) {
        let file = v1_directory(&mounts, path).map(|dir| dir.join("cpu.rt_runtime_us"));
        let runtime = file.as_ref().and_then(read_number);
        return match (file, runtime) {
            (Some(file), Some(rt_runtime_us)) => CgroupRt::V1 {
                file,
                rt_runtime_us,
            },
            _ => CgroupRt::V1NoRtGroups,
        };
    }
    match membership.lines().find_map(|line| line.strip_prefix("0::")) {
        Some(path) => CgroupRt::V2 { path: path.into() },
        None => CgroupRt::None,
    }
}

/// The path of the version 1 `cpu` group in the lines of `/proc/self/cgroup`.
fn v1_path(membership: &str) -> Option<&str> {
    membership.lines().find_map(|line| {
        let (controllers, path) = line.split_once(':')?.1.split_once(':')?;
        controllers.split(',').any(|c| c == "cpu").then_some(path)
    })
}

/// The directory of group `path` under the mount point of the version 1 `cpu` controller.
fn v1_directory(mounts: &str, path: &str) -> Option<PathBuf> {
    mounts.lines().find_map(|line| {
        let (mount, filesystem) = line.split_once(" - ")?;
        let mut filesystem = filesystem.split(' ');
        let cpu = filesystem.next()? == "cgroup"
            && filesystem
                .next_back()?
                .split(',')
                .any(|option| option == "cpu");
        let mut fields = mount.split(' ').skip(3);
        let (root, point) = (fields.next()?, fields.next()?);
        let below = path
            .strip_prefix(root)
            .unwrap_or(path)
            .trim_start_matches('/');
        cpu.then(|| PathBuf::from(point).join(below))
    })
}

/// The number in a one-line file.
pub(in crate::linux) fn read_number(path: impl AsRef<std::path::Path>) -> Option<i64> {
    fs::read_to_string(path).ok()?.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn capabilities_are_read_from_the_status_file() {
        let caps = Capabilities::parse("Name:\tx\nCapEff:\t0000000000804000\nCapBnd:\tff\n");
        assert!(caps.contains(CAP_SYS_NICE) && caps.contains(CAP_IPC_LOCK));
        assert!(!caps.contains(0));
        assert_eq!(Capabilities::parse(""), Capabilities(0));
    }

    #[test]
    fn the_cpu_group_of_version_1_is_found_below_its_mount() {
        let membership = "9:name=systemd:/\n3:cpuset:/x\n1:cpu,cpuacct:/docker/abc\n0::/\n";
        assert_eq!(v1_path(membership), Some("/docker/abc"));
        assert_eq!(v1_path("0::/user.slice\n"), None);
        let mounts = "34 31 0:31 / /sys/fs/cgroup/cpuset rw - cgroup cgroup rw,cpuset\n\
                      32 31 0:29 / /sys/fs/cgroup/cpu rw,relatime - cgroup cgroup rw,cpu,cpuacct\n";
        let directory = v1_directory(mounts, "/docker/abc");
        assert_eq!(directory, Some("/sys/fs/cgroup/cpu/docker/abc".into()));
        // Inside a container the mount shows the container's own group as its root.
        let inside = "32 31 0:29 /docker/abc /sys/fs/cgroup/cpu ro - cgroup cgroup rw,cpu\n";
        assert_eq!(
            v1_directory(inside, "/docker/abc"),
            Some("/sys/fs/cgroup/cpu/".into())
        );
        assert_eq!(v1_directory("", "/"), None);
    }

    #[test]
    fn memory_may_be_locked_with_the_capability_or_a_large_limit() {
        let small = Limit {
            soft: Some(4096),
            hard: Some(4096),
        };
        assert!(memory_lock(true, small).is_ok());
        assert!(
            memory_lock(
                false,
                Limit {
                    soft: None,
                    hard: None
                }
            )
            .is_ok()
        );
        assert!(
            memory_lock(false, small)
                .unwrap_err()
                .contains("RLIMIT_MEMLOCK is 4 KiB")
        );
    }
}
