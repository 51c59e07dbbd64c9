//! A5, A6, A7: another account beside the ledger. The guaranteed program is `pong`, with 60 % of
//! CPU 0 by a deployment file.

use super::{agent, program, row, within};
use crate::common::{Running, Scratch};
use crate::memory::Victim;
use replenish_testkit::harness::{Trial, skip, skip_rt, trial};
use std::fs::{self, Permissions};
use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const OVERLAY: &str = r#"
[executor]
policy = { kind = "time-shared" }

[[worker]]
name = "high"
guarantee = { budget = "60 ms", period = "100 ms" }
cpu = 0

[[worker]]
name = "low"
policy = { kind = "time-shared" }
"#;

/// A ledger that other accounts may look into, and an agent for guaranteed programs.
struct Host {
    ledger: PathBuf,
    overlay: PathBuf,
    victim: Victim,
    _scratch: Scratch,
}

impl Host {
    /// Skips the trial where no other account or no real-time priority can be had.
    fn new(name: &str) -> Self {
        if fs::metadata("/proc/self").unwrap().uid() != 0 {
            skip("another account needs root");
        }
        if !replenish_os::privilege::may_be_real_time() {
            skip_rt("a guarantee needs real-time priority");
        }
        let scratch = Scratch::new(name);
        let victim = agent(&scratch, &[]);
        let (ledger, overlay) = (scratch.path("ledger"), scratch.path("overlay.toml"));
        fs::create_dir(&ledger).unwrap();
        fs::set_permissions(&ledger, Permissions::from_mode(0o755)).unwrap();
        fs::write(&overlay, OVERLAY).unwrap();
        Self {
            ledger,
            overlay,
            victim,
            _scratch: scratch,
        }
    }

    fn variable(&self) -> String {
        format!("REPLENISH_LEDGER={}", self.ledger.display())
    }

    /// Starts a guaranteed program.
    fn guaranteed(&self) -> Running {
        let overlay = format!("REPLENISH_OVERLAY={}", self.overlay.display());
        let at = self.victim.at.udp.to_string();
        let program = program();
        let pong = [&*program, "pong", "--agent", &at, "--burst", "0"];
        let variable = self.variable();
        let args = [&[&*variable, &overlay], &pong[..]].concat();
        Running::start("env", &args)
    }

    /// The same, once it runs; it has reserved.
    fn running(&self) -> Running {
        let mut pong = self.guaranteed();
        pong.expect_line("granted", super::SOON);
        assert_eq!(self.entries().len(), 1, "control");
        pong
    }

    fn entries(&self) -> Vec<PathBuf> {
        let files = fs::read_dir(&self.ledger).unwrap();
        let paths = files.map(|file| file.unwrap().path());
        paths
            .filter(|path| path.extension().is_some_and(|kind| kind == "entry"))
            .collect()
    }
}

/// A shell as an account without rights; ended when dropped.
struct Stranger(Child);

impl Stranger {
    fn new(script: &str) -> Self {
        let account = ["--reuid=65534", "--regid=65534", "--clear-groups"];
        let mut shell = Command::new("setpriv");
        shell.args(account).args(["sh", "-c", script]);
        Self(shell.stdin(Stdio::null()).spawn().unwrap())
    }
}

impl Drop for Stranger {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

/// Whether a program has not ended.
fn lives(program: &Running) -> bool {
    let stat = fs::read_to_string(format!("/proc/{}/stat", program.id())).unwrap();
    !stat.contains(") Z ")
}

fn facts(path: &Path) -> (String, u32) {
    let mode = fs::symlink_metadata(path).unwrap().mode() & 0o7777;
    (fs::read_to_string(path).unwrap(), mode)
}

/// b209253 opened the file beside the overheads, whatever it was.
fn a05_a_link_where_the_overheads_are_written() {
    let host = Host::new("a05");
    let target = host.ledger.parent().unwrap().join("target");
    fs::write(&target, "secret").unwrap();
    fs::set_permissions(&target, Permissions::from_mode(0o600)).unwrap();
    symlink(&target, host.ledger.join("overheads.toml.new")).unwrap();
    let (program, variable) = (program(), host.variable());
    let mut doctor = Running::start("env", &[&variable, &program, "doctor", "--save"]);
    assert!(doctor.end(Duration::from_secs(60)).success(), "control");
    let kept = fs::read_to_string(host.ledger.join("overheads.toml")).unwrap_or_default();
    assert!(kept.contains("latency"), "control: {kept:?}");
    let (text, mode) = facts(&target);
    let size = text.len();
    let figure = format!("root's file of 6 B and mode 0600 has {size} B and mode {mode:04o}");
    let holds = (&*text, mode) == ("secret", 0o600);
    row("A5", "overheads.toml.new is a link", &figure, holds);
}

/// b209253 made the lock's file for all to open.
fn a06_another_account_holds_the_lock() {
    let host = Host::new("a06");
    let mut first = host.running();
    first.signal("TERM");
    first.end(super::SOON);
    assert!(host.entries().is_empty(), "control");
    let lock = host.ledger.join("lock");
    let got = host.ledger.parent().unwrap().join("got");
    fs::write(&got, "").unwrap();
    fs::set_permissions(&got, Permissions::from_mode(0o666)).unwrap();
    let script = format!(
        "exec flock -n {} sh -c 'echo got > {}; exec sleep 60'",
        lock.display(),
        got.display()
    );
    let mut stranger = Stranger::new(&script);
    let tried =
        || fs::metadata(&got).unwrap().len() > 0 || stranger.0.try_wait().unwrap().is_some();
    assert!(within(super::SOON, tried), "control");
    let begin = Instant::now();
    let pong = host.guaranteed();
    let limit = Duration::from_secs(20);
    let admitted = within(limit, || host.entries().len() == 1 || !lives(&pong));
    let admitted = admitted && lives(&pong);
    let seconds = begin.elapsed().as_secs_f64();
    let word = if admitted { "admitted" } else { "not admitted" };
    let figure = format!("the guaranteed program is {word} after {seconds:.0} s");
    row("A6", "nobody holds the ledger's lock", &figure, admitted);
}

/// b209253 asked whether any process has the lock on a program's file; its waiter got it.
fn a07_another_account_waits_for_a_dead_programs_file() {
    let host = Host::new("a07");
    let mut first = host.running();
    let entry = host.entries().remove(0);
    // Both must be able to open it: as b209253 has made it, and as it is made today.
    let script = format!("exec flock {} sleep 60", entry.display());
    let _stranger = Stranger::new(&script);
    std::thread::sleep(Duration::from_millis(500));
    first.signal("KILL");
    first.end(super::SOON);
    let mut second = host.guaranteed();
    let own = || host.entries().iter().any(|path| *path != entry);
    let admitted = within(Duration::from_secs(8), || own() || !lives(&second));
    let admitted = admitted && lives(&second);
    let figure = if admitted {
        "the next program with 60 % is admitted".to_owned()
    } else {
        second.signal("KILL");
        let lines = second.rest();
        let line = lines.iter().find(|line| line.contains("reserved"));
        let why = line.map_or("?", |line| line.as_str());
        format!("60 % stay reserved: {why}")
    };
    row(
        "A7",
        "nobody waits on a dead program's file",
        &figure,
        admitted,
    );
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial(
            "a05_a_link_where_the_overheads_are_written",
            a05_a_link_where_the_overheads_are_written,
        ),
        trial(
            "a06_another_account_holds_the_lock",
            a06_another_account_holds_the_lock,
        ),
        trial(
            "a07_another_account_waits_for_a_dead_programs_file",
            a07_another_account_waits_for_a_dead_programs_file,
        ),
    ]
}
