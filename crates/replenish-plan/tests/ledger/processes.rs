//! The ledger with real processes: races, kill -9, and files that make no sense.
//!
//! A child is this very test program, which runs [`child`] if [`CHILD`] is set.
use nix::fcntl::{FcntlArg, fcntl};
use replenish_plan::ledger::{Denied, Ledger};
use replenish_plan::{ExecutorRequest, Guarantee, Machine, Request, Worker};
use replenish_testkit::harness::{Trial, trial};
use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

pub(crate) const CHILD: &str = "REPLENISH_TEST_LEDGER_CHILD";

/// A directory of this test's own.
pub(super) struct Dir(pub(super) PathBuf);

impl Dir {
    pub(super) fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("ledger-{name}-{}", std::process::id()));
        fs::remove_dir_all(&path).ok();
        Self(path)
    }
}

impl Drop for Dir {
    fn drop(&mut self) {
        fs::remove_dir_all(&self.0).ok();
    }
}

pub(super) fn request(percent: u64) -> Request {
    let ms = Duration::from_millis;
    let guarantee = Guarantee::of(ms(percent)).every(ms(100));
    let mut request = Request::new(Machine::with_cpus(1));
    request.executor = ExecutorRequest::None;
    request.worker(Worker::guaranteed("arm", guarantee))
}

/// Reserves, says so, and stays until it is killed. `args`: a percentage, or `look`; a directory.
pub(crate) fn child(args: &str) {
    let (percent, directory) = args.split_once(' ').unwrap();
    let ledger = Ledger::open(directory).unwrap();
    if percent == "look" {
        println!("\nsees {}", ledger.view().unwrap().entries.len());
        return;
    }
    let admitted = ledger.admit(&request(percent.parse().unwrap()), "child");
    match &admitted {
        Ok(_) => println!("\nadmitted"),
        Err(denied) => println!("\nrefused {denied}"),
    }
    if admitted.is_ok() {
        std::thread::sleep(Duration::from_secs(60));
    }
}

pub(super) fn spawn(directory: &Path, percent: u64) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .env(CHILD, format!("{percent} {}", directory.display()))
        .stdout(Stdio::piped())
        .spawn()
        .unwrap()
}

pub(super) fn answer(child: &mut Child) -> String {
    let lines = BufReader::new(child.stdout.as_mut().unwrap()).lines();
    let says = |line: &String| line.starts_with("admitted") || line.starts_with("refused");
    lines.map(Result::unwrap).find(says).unwrap()
}

pub(super) fn end(mut child: Child) {
    child.kill().ok(); // SIGKILL
    child.wait().unwrap();
}

fn the_second_process_is_refused_until_the_first_is_killed() {
    let dir = Dir::new("two");
    let mut first = spawn(&dir.0, 60);
    assert_eq!(answer(&mut first), "admitted");
    let ledger = Ledger::open(&dir.0).unwrap();
    let view = ledger.view().unwrap();
    assert_eq!((view.entries.len(), view.entries[0].pid), (1, first.id()));

    let mut second = spawn(&dir.0, 50);
    let says = answer(&mut second);
    assert!(
        says.starts_with("refused worker \"arm\" does not fit: on CPU 0 110.1 % would be reserved (60.0 % by other programs: \"arm\" of child"),
        "{says}"
    );
    assert!(says.contains("would fit"), "{says}");
    end(second);
    // Less is admitted beside it, and gone again when it is dropped.
    let beside = ledger.admit(&request(20), "beside").unwrap();
    assert_eq!(ledger.view().unwrap().entries.len(), 2);
    drop(beside);
    assert_eq!(ledger.view().unwrap().entries.len(), 1);

    end(first);
    let mut third = spawn(&dir.0, 50);
    assert_eq!(answer(&mut third), "admitted");
    end(third);
    assert!(ledger.view().unwrap().entries.is_empty());
    let left: Vec<_> = fs::read_dir(&dir.0)
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    assert_eq!(left, ["lock"], "what the dead left behind is removed");
}

fn of_processes_that_race_only_as_many_are_admitted_as_fit() {
    let dir = Dir::new("race");
    for _ in 0..3 {
        let mut racers: Vec<Child> = (0..8).map(|_| spawn(&dir.0, 30)).collect();
        let admitted = racers
            .iter_mut()
            .filter_map(|r| answer(r).starts_with("admitted").then_some(()));
        assert_eq!(admitted.count(), 3);
        racers.into_iter().for_each(end);
    }
}

/// The part of an entry's owner.
pub(super) fn own(file: &File) {
    let lock = libc::flock {
        l_type: libc::F_WRLCK as libc::c_short,
        l_whence: libc::SEEK_SET as libc::c_short,
        l_start: 0,
        l_len: 1,
        l_pid: 0,
    };
    fcntl(file, FcntlArg::F_OFD_SETLK(&lock)).unwrap();
}

fn files_that_make_no_sense_are_named_and_left_out() {
    let dir = Dir::new("garbage");
    let ledger = Ledger::open(&dir.0).unwrap();
    let path = |name: &str| dir.0.join(name);
    // The entry of a dead owner: removed, whatever it holds.
    fs::write(path("dead.entry"), "garbage").unwrap();
    // Files that a program keeps locked as its own.
    let locked = |name: &str, text: &[u8]| {
        fs::write(path(name), text).unwrap();
        let file = File::options().write(true).open(path(name)).unwrap();
        own(&file);
        file
    };
    let held = [
        locked("1.entry", b"garbage"),
        locked("2.entry", &[0xFF; 1000]),
        locked("3.entry", b"# replenish reservation 1 0000000000000000\n"),
        locked("4.entry", &vec![b' '; 300 << 10]),
        locked("5.new", b""),
    ];
    symlink("/etc/passwd", path("6.entry")).unwrap();
    fs::create_dir(path("7.entry")).unwrap();
    let pipe = path("8.entry");
    assert!(
        Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );

    let admitted = ledger.admit(&request(60), "tidy").unwrap();
    assert_eq!(admitted.warnings.len(), 8, "{:?}", admitted.warnings);
    for (number, warning) in admitted.warnings.iter().enumerate() {
        assert!(warning.contains(&format!("/{}.", number + 1)), "{warning}");
    }
    assert!(!path("dead.entry").exists());
    let strict = ledger.clone().strict(true);
    let error = strict.admit(&request(1), "strict").unwrap_err();
    assert!(
        matches!(&error, Denied::Ledger(_)) && error.to_string().contains("1.entry"),
        "{error}"
    );
    drop(held);
    // A process that another test is just starting may have the locks a moment longer.
    let mut left = ledger.view().unwrap().warnings;
    for _ in 0..500 {
        if left.len() == 3 {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
        left = ledger.view().unwrap().warnings;
    }
    assert_eq!(left.len(), 3, "links, directories and pipes stay: {left:?}");
}

fn what_cannot_be_a_ledger_is_an_error_that_names_it() {
    let dir = Dir::new("file");
    fs::write(&dir.0, "").unwrap();
    let error = Ledger::open(&dir.0).unwrap_err().to_string();
    assert!(
        error.contains("is not a directory") && error.contains("ledger-file"),
        "{error}"
    );
    fs::remove_file(&dir.0).unwrap();
    let below = Ledger::open(dir.0.join("none/here")).unwrap_err();
    assert!(below.to_string().contains("none/here"), "{below}");
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial(
            "the_second_process_is_refused_until_the_first_is_killed",
            the_second_process_is_refused_until_the_first_is_killed,
        ),
        trial(
            "of_processes_that_race_only_as_many_are_admitted_as_fit",
            of_processes_that_race_only_as_many_are_admitted_as_fit,
        ),
        trial(
            "files_that_make_no_sense_are_named_and_left_out",
            files_that_make_no_sense_are_named_and_left_out,
        ),
        trial(
            "what_cannot_be_a_ledger_is_an_error_that_names_it",
            what_cannot_be_a_ledger_is_an_error_that_names_it,
        ),
    ]
}
