//! The ledger beside other accounts: links, locks and waiting. Each test says what b209253 did.
//!
//! Accounts are real where the tests run as root: a shell as `nobody`, by `setpriv`.
use super::processes::{Dir, answer, end, own, request, spawn};
use replenish_plan::Overheads;
use replenish_plan::ledger::Ledger;
use replenish_testkit::harness::{Trial, skip, trial};
use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown, symlink};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const NOBODY: u32 = 65534;

fn mode(path: &Path) -> u32 {
    fs::symlink_metadata(path).unwrap().mode() & 0o7777
}

/// A shell as an account without rights; `None` where this test cannot have one.
fn stranger(script: &str) -> Option<Child> {
    let shell = Command::new("setpriv")
        .args([
            "--reuid=65534",
            "--regid=65534",
            "--clear-groups",
            "sh",
            "-c",
            script,
        ])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn();
    shell
        .ok()
        .filter(|_| fs::metadata("/proc/self").unwrap().uid() == 0)
}

/// The same, for a trial that is skipped without.
fn needed_stranger(script: &str) -> Child {
    stranger(script).unwrap_or_else(|| skip("a shell of another account needs root and setpriv"))
}

/// Waits until the shell says a line; returns it.
fn says(child: &mut Child) -> String {
    let mut line = String::new();
    BufReader::new(child.stdout.as_mut().unwrap())
        .read_line(&mut line)
        .unwrap();
    line.trim().to_owned()
}

/// b209253 wrote the overheads through the link: the victim's content and mode were gone.
fn nobodys_file_is_written_through_a_link() {
    let dir = Dir::new("links");
    let ledger = Ledger::open(&dir.0).unwrap();
    let victim = dir.0.join("victim");
    fs::write(&victim, "secret").unwrap();
    fs::set_permissions(&victim, fs::Permissions::from_mode(0o600)).unwrap();
    symlink(&victim, dir.0.join("overheads.toml.new")).unwrap();
    symlink(&victim, dir.0.join("overheads.toml")).unwrap();
    ledger
        .set_overheads(&Overheads::LINUX, "by a test")
        .unwrap();
    assert_eq!(ledger.overheads().unwrap(), Some(Overheads::LINUX));
    assert!(
        dir.0
            .join("overheads.toml")
            .symlink_metadata()
            .unwrap()
            .is_file()
    );
    // A link in the lock's place is refused, and one to nowhere creates nothing.
    fs::remove_file(dir.0.join("lock")).unwrap();
    for target in [victim.clone(), dir.0.join("nowhere")] {
        symlink(&target, dir.0.join("lock")).unwrap();
        ledger.admit(&request(1), "linked").unwrap_err();
        fs::remove_file(dir.0.join("lock")).unwrap();
    }
    // Another name of a file that is not the ledger's: its mode stays.
    fs::set_permissions(&victim, fs::Permissions::from_mode(0o644)).unwrap();
    fs::hard_link(&victim, dir.0.join("lock")).unwrap();
    drop(ledger.admit(&request(1), "linked").unwrap());
    assert_eq!(fs::read_to_string(&victim).unwrap(), "secret");
    assert_eq!(mode(&victim), 0o644);
    assert!(!dir.0.join("nowhere").exists());
}

/// The lock's file was 0644 whatever the directory was: every account could open and hold it.
fn the_lock_is_for_those_who_may_write_to_the_directory() {
    let root = fs::metadata("/proc/self").unwrap().uid() == 0;
    for (of_directory, of_lock) in [
        (0o755, 0o600),
        (0o700, 0o600),
        (0o1775, 0o660),
        (0o2775, 0o660),
        (0o1777, 0o666),
    ] {
        let dir = Dir::new(&format!("modes{of_directory:o}"));
        fs::create_dir(&dir.0).unwrap();
        fs::set_permissions(&dir.0, fs::Permissions::from_mode(of_directory)).unwrap();
        if root {
            chown(&dir.0, Some(NOBODY), Some(NOBODY)).unwrap();
        }
        let ledger = Ledger::open(&dir.0).unwrap();
        let place = ledger.admit(&request(1), "first").unwrap();
        let lock = dir.0.join("lock");
        assert_eq!(mode(&lock), of_lock, "in a directory {of_directory:o}");
        let (file, above) = (fs::metadata(&lock).unwrap(), fs::metadata(&dir.0).unwrap());
        assert_eq!((file.uid(), file.gid()), (above.uid(), above.gid()));
        assert_eq!(mode(place.reservation.path()), 0o644);
        // One that an older version has made is closed to strangers.
        let open = fs::Permissions::from_mode(0o666);
        fs::set_permissions(&lock, open).unwrap();
        drop(ledger.admit(&request(1), "second").unwrap());
        assert_eq!(mode(&lock), of_lock, "in a directory {of_directory:o}");
    }
}

/// With b209253 the stranger had the lock, and the guaranteed program gave up after 10 s.
fn a_stranger_cannot_hold_the_lock_and_can_look() {
    let dir = Dir::new("stranger");
    let ledger = Ledger::open(&dir.0).unwrap();
    let kept = ledger.admit(&request(20), "kept").unwrap();
    let lock = dir.0.join("lock");
    let script = format!(
        "flock -n {} sh -c 'echo got; sleep 30' || echo refused",
        lock.display()
    );
    let mut stranger = needed_stranger(&script);
    assert_eq!(says(&mut stranger), "refused");
    let start = Instant::now();
    drop(ledger.admit(&request(20), "beside").unwrap());
    assert!(start.elapsed() < Duration::from_secs(5));
    end(stranger);
    drop(kept);
}

/// Looking needed the lock: an account that may not reserve saw nothing but an error.
fn an_account_that_may_not_reserve_sees_what_is_reserved() {
    let dir = Dir::new("looker");
    let ledger = Ledger::open(&dir.0).unwrap();
    let _kept = ledger.admit(&request(20), "kept").unwrap();
    let program = std::env::current_exe().unwrap();
    needed_stranger("true").wait().unwrap();
    // The test program must be where the account can run it.
    let copy = std::env::temp_dir().join(format!("ledger-looker-program-{}", std::process::id()));
    fs::copy(program, &copy).unwrap();
    let script = format!(
        "REPLENISH_TEST_LEDGER_CHILD='30 {}' {} | grep ^refused;
         REPLENISH_TEST_LEDGER_CHILD='look {}' {} | grep ^sees",
        dir.0.display(),
        copy.display(),
        dir.0.display(),
        copy.display(),
    );
    let out = needed_stranger(&script).wait_with_output().unwrap();
    fs::remove_file(copy).ok();
    let text = String::from_utf8(out.stdout).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 2, "{text}");
    assert!(lines[0].contains("may not reserve here"), "{text}");
    assert_eq!(lines[1], "sees 1");
    assert_eq!(ledger.view().unwrap().entries.len(), 1);
}

/// Locks that this or another account holds or waits for keep no reservation of the dead.
///
/// With b209253 a program that waited for the owner's lock got the lock when the owner died, and
/// 60 % stayed reserved.
fn the_reservations_of_the_dead_are_gone_whoever_waits() {
    let dir = Dir::new("waiters");
    let ledger = Ledger::open(&dir.0).unwrap();
    let mut first = spawn(&dir.0, 60);
    assert_eq!(answer(&mut first), "admitted");
    let entry = fs::read_dir(&dir.0)
        .unwrap()
        .map(|e| e.unwrap().path())
        .find(|p| p.extension().is_some_and(|e| e == "entry"))
        .unwrap();
    // One that reads the file, with the lock that a reader can have; the others wait behind it.
    let reader = File::open(&entry).unwrap();
    reader.lock_shared().unwrap();
    let mut waiters: Vec<Child> = ["-x", "-s"]
        .iter()
        .map(|kind| {
            let mut flock = Command::new("flock");
            flock.arg(kind).arg(&entry).args(["sleep", "60"]);
            flock.spawn().unwrap()
        })
        .collect();
    let script = format!("echo waits; exec flock -x {} sleep 60", entry.display());
    waiters.extend(stranger(&script).map(|mut shell| {
        assert_eq!(says(&mut shell), "waits");
        shell
    }));
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(ledger.view().unwrap().entries.len(), 1, "its owner lives");
    ledger.admit(&request(50), "early").unwrap_err();
    end(first);
    drop(ledger.admit(&request(50), "late").unwrap());
    assert!(ledger.view().unwrap().entries.is_empty());
    waiters.into_iter().for_each(end);
}

/// A program that dies over writing leaves a file without its lock, which the next one removes.
fn a_file_that_was_never_completed_is_removed() {
    let dir = Dir::new("halves");
    let ledger = Ledger::open(&dir.0).unwrap();
    for name in ["1-1-1.new", "lock-1.new", "overheads.toml-1-1.new"] {
        fs::write(dir.0.join(name), "half").unwrap();
        fs::set_permissions(dir.0.join(name), fs::Permissions::from_mode(0o600)).unwrap();
    }
    assert_eq!(ledger.view().unwrap().warnings, Vec::<String>::new());
    let left = fs::read_dir(&dir.0)
        .unwrap()
        .map(|e| e.unwrap().file_name());
    assert_eq!(left.collect::<Vec<_>>(), ["lock"]);
    // A lock in the file's place is no reservation either.
    fs::write(dir.0.join("x.new"), "").unwrap();
    let file = File::options()
        .write(true)
        .open(dir.0.join("x.new"))
        .unwrap();
    own(&file);
    assert_eq!(ledger.view().unwrap().warnings.len(), 1);
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial(
            "nobodys_file_is_written_through_a_link",
            nobodys_file_is_written_through_a_link,
        ),
        trial(
            "the_lock_is_for_those_who_may_write_to_the_directory",
            the_lock_is_for_those_who_may_write_to_the_directory,
        ),
        trial(
            "a_stranger_cannot_hold_the_lock_and_can_look",
            a_stranger_cannot_hold_the_lock_and_can_look,
        ),
        trial(
            "an_account_that_may_not_reserve_sees_what_is_reserved",
            an_account_that_may_not_reserve_sees_what_is_reserved,
        ),
        trial(
            "the_reservations_of_the_dead_are_gone_whoever_waits",
            the_reservations_of_the_dead_are_gone_whoever_waits,
        ),
        trial(
            "a_file_that_was_never_completed_is_removed",
            a_file_that_was_never_completed_is_removed,
        ),
    ]
}
