//! The one message that says what is missing and how to grant it.

use super::probes::CgroupRt;
use super::process::Privilege;
use crate::MAX_PRIORITY;
use std::fmt;

/// The command that gives this program its capabilities.
pub(in crate::linux) fn setcap_line() -> String {
    let program = std::env::current_exe().unwrap_or_else(|_| "PROGRAM".into());
    let program = program.display();
    format!("this program:   sudo setcap cap_sys_nice,cap_ipc_lock+ep {program}")
}

const USER: &str = r#"your user:      printf "$USER - rtprio 99\n$USER - memlock unlimited\n" | sudo tee /etc/security/limits.d/99-replenish.conf   (then log in again)"#;
const CONTAINER: &str =
    "a container:    docker run --cap-add sys_nice --ulimit rtprio=99 --ulimit memlock=-1 ...";
const SERVICE: &str =
    "a service:      LimitRTPRIO=99 and LimitMEMLOCK=infinity in its [Service] section";

/// The missing right, its cause and the commands; `real-time priority 1 to 99 is granted` if none
/// is missing.
impl fmt::Display for Privilege {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.fifo {
            Ok(MAX_PRIORITY) => {
                f.write_str("real-time priority 1 to 99 is granted")?;
            }
            Ok(max) => {
                write!(
                    f,
                    "real-time priority is granted up to {max} only (RLIMIT_RTPRIO)"
                )?;
                self.grant(f)?;
            }
            Err(e) => {
                write!(f, "real-time priority is not granted here ({e})")?;
                if !self.cgroup_forbids() || !self.cap_sys_nice {
                    write!(f, "\nmissing: ")?;
                    self.reasons(f)?;
                }
                self.grant(f)?;
            }
        }
        if let Err(why) = &self.memory_lock {
            write!(
                f,
                "\nmemory locking is not granted: {why}; page faults can delay callbacks"
            )?;
        }
        Ok(())
    }
}

impl Privilege {
    fn cgroup_forbids(&self) -> bool {
        matches!(
            self.cgroup,
            CgroupRt::V1 {
                rt_runtime_us: 0,
                ..
            }
        )
    }

    fn reasons(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.cap_sys_nice {
            return f
                .write_str("nothing this process can see (a user namespace? a seccomp filter?)");
        }
        let limit = self.rtprio;
        write!(
            f,
            "the capability CAP_SYS_NICE, or a limit RLIMIT_RTPRIO above {limit}"
        )
    }

    fn grant(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.cap_sys_nice {
            f.write_str("\nany one of these grants it:")?;
            for line in [&setcap_line(), USER, CONTAINER, SERVICE] {
                write!(f, "\n  {line}")?;
            }
        }
        match &self.cgroup {
            CgroupRt::V1 {
                file,
                rt_runtime_us: 0,
            } => {
                let file = file.display();
                let too = if self.cap_sys_nice { "" } else { ", too" };
                write!(
                    f,
                    "\nthe control group of this process forbids it{too}, even to root ({file} is 0):\n  \
                     allow it:       echo 100000 | sudo tee {file}   (its parents first)\n  \
                     or leave it:    echo $$ | sudo tee /sys/fs/cgroup/cpu/cgroup.procs"
                )
            }
            CgroupRt::V2 { path } if self.cap_sys_nice && path != "/" => write!(
                f,
                "\nthe control group {path} may be the reason: a kernel with \
                 CONFIG_RT_GROUP_SCHED refuses real-time threads outside the root group\n  \
                 leave it:       echo $$ | sudo tee /sys/fs/cgroup/cgroup.procs"
            ),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests;
