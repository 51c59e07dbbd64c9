//! One trial runs this very program again as a user without any privilege.

use replenish_os::{Policy, ThreadSpec, memory, privilege, spawn};
use replenish_testkit::harness::{self, Trial};
use std::os::unix::fs::PermissionsExt;
use std::process::Command;

const CHILD: &str = "REPLENISH_UNPRIVILEGED_CHILD";

/// Whether this process is the second run.
pub(crate) fn is_child() -> bool {
    std::env::var_os(CHILD).is_some()
}

/// The second run: FIFO is refused with the whole message, and nothing else is.
pub(crate) fn child() -> ! {
    let policy = Policy::fifo(60).unwrap();
    let spec = ThreadSpec::new("high").policy(policy);
    let error = spawn(spec, || panic!("ran without its policy"))
        .map(drop)
        .unwrap_err();
    assert!(error.is_permission(), "{error}");
    println!("{error}");
    let privilege = privilege::probe();
    assert!(!privilege.real_time());
    assert!(privilege.fifo.is_err() && privilege.deadline.is_err());
    assert!(!privilege.cap_sys_nice);
    if privilege.memlock.soft.is_some_and(|limit| limit < 64 << 20) {
        let error = memory::lock_all().unwrap_err().to_string();
        assert!(error.contains("RLIMIT_MEMLOCK is"), "{error}");
    }
    let answer = spawn(ThreadSpec::new("plain").cpu(crate::common::cpu()), || 42)
        .unwrap()
        .join()
        .unwrap();
    assert_eq!(answer, 42);
    std::process::exit(0)
}

/// As root: through `setpriv`, from a copy that every account may run. As a user without privilege:
/// as is.
pub(crate) fn trial() -> Trial {
    let name = "without_privilege_fifo_is_refused_with_the_way_to_get_it";
    let root = std::fs::metadata("/proc/self").is_ok_and(|m| {
        use std::os::unix::fs::MetadataExt;
        m.uid() == 0
    });
    let setpriv = Command::new("setpriv").arg("--version").output().is_ok();
    let needed = privilege::probe().fifo.is_ok();
    let skip = needed && !(root && setpriv);
    let why = "this user has real-time priority and no way to drop it";
    harness::trial(name, move || check(needed)).skipped_if(skip.then_some(why))
}

fn check(drop_privilege: bool) {
    let this = std::env::current_exe().unwrap();
    let copy = std::env::temp_dir().join(format!("replenish-unprivileged-{}", std::process::id()));
    std::fs::copy(&this, &copy).unwrap();
    std::fs::set_permissions(&copy, std::fs::Permissions::from_mode(0o755)).unwrap();
    let mut command = if drop_privilege {
        let mut setpriv = Command::new("setpriv");
        setpriv.args([
            "--reuid=65534",
            "--regid=65534",
            "--clear-groups",
            "--inh-caps=-all",
        ]);
        setpriv.arg(&copy);
        setpriv
    } else {
        Command::new(&copy)
    };
    let output = command.env(CHILD, "1").current_dir("/").output();
    std::fs::remove_file(&copy).unwrap();
    let output = output.unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.success(),
        "{text}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    for needle in [
        "policy FIFO 60 was refused: Operation not permitted",
        "CAP_SYS_NICE",
        "RLIMIT_RTPRIO",
        "setcap cap_sys_nice,cap_ipc_lock+ep",
        "rtprio 99",
        "--cap-add sys_nice",
    ] {
        assert!(text.contains(needle), "{needle:?} is missing in:\n{text}");
    }
}
