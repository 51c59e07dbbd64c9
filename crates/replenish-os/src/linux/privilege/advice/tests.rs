//! The message names what is missing, and the command for it, in each situation.

use super::super::Limit;
use super::*;
use std::io;

fn refused() -> io::Error {
    io::Error::from_raw_os_error(libc::EPERM)
}

fn ordinary_user() -> Privilege {
    let zero = Limit {
        soft: Some(0),
        hard: Some(0),
    };
    Privilege {
        fifo: Err(refused()),
        deadline: Err(refused()),
        memory_lock: Err("RLIMIT_MEMLOCK is 8192 KiB, this process has 90000 KiB mapped".into()),
        switch_records: Ok(()),
        cap_sys_nice: false,
        cap_ipc_lock: false,
        rtprio: zero,
        memlock: zero,
        cgroup: CgroupRt::V2 {
            path: "/user.slice".into(),
        },
        rt_runtime_us: Some(950_000),
    }
}

#[test]
fn an_ordinary_user_is_told_every_way_to_the_privilege() {
    let text = ordinary_user().to_string();
    for needle in [
        "not granted",
        "CAP_SYS_NICE",
        "RLIMIT_RTPRIO above 0",
        "setcap cap_sys_nice,cap_ipc_lock+ep /",
        "rtprio 99",
        "--cap-add sys_nice --ulimit rtprio=99",
        "LimitRTPRIO=99",
        "RLIMIT_MEMLOCK is 8192 KiB",
    ] {
        assert!(text.contains(needle), "{needle:?} is missing in:\n{text}");
    }
    assert!(!text.contains("control group"), "{text}");
}

#[test]
fn a_group_without_runtime_is_named_with_its_file() {
    let mut root = ordinary_user();
    root.cap_sys_nice = true;
    root.memory_lock = Ok(());
    root.cgroup = CgroupRt::V1 {
        file: "/sys/fs/cgroup/cpu/x/cpu.rt_runtime_us".into(),
        rt_runtime_us: 0,
    };
    let text = root.to_string();
    assert!(
        text.contains("tee /sys/fs/cgroup/cpu/x/cpu.rt_runtime_us"),
        "{text}"
    );
    assert!(
        !text.contains("setcap"),
        "root needs no capability:\n{text}"
    );
    root.cap_sys_nice = false;
    let text = root.to_string();
    assert!(
        text.contains("setcap") && text.contains("even to root"),
        "{text}"
    );
}

#[test]
fn a_low_limit_says_up_to_which_priority() {
    let mut limited = ordinary_user();
    limited.fifo = Ok(20);
    assert!(
        limited
            .to_string()
            .starts_with("real-time priority is granted up to 20 only")
    );
    assert!(!limited.real_time());
}

#[test]
fn nothing_missing_is_one_line() {
    let mut privileged = ordinary_user();
    privileged.fifo = Ok(MAX_PRIORITY);
    privileged.memory_lock = Ok(());
    assert_eq!(
        privileged.to_string(),
        "real-time priority 1 to 99 is granted"
    );
    assert!(privileged.real_time());
}
