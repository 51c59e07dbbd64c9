//! Files of the ledger that another program wrote: an entry as it is, one with the right checksum,
//! and measured overheads. A program is admitted beside them, or refused with a sentence.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nix::fcntl::{FcntlArg, fcntl};
use replenish_plan::ledger::{Denied, Ledger};
use replenish_plan::{Guarantee, Machine, Request, Worker};
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::PathBuf;
use std::sync::OnceLock;
use std::time::Duration;

fn directory() -> &'static PathBuf {
    static DIRECTORY: OnceLock<PathBuf> = OnceLock::new();
    DIRECTORY.get_or_init(|| {
        let name = format!("replenish-fuzz-ledger-{}", std::process::id());
        std::env::temp_dir().join(name)
    })
}

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, rest)) = bytes.split_first() else {
        return;
    };
    let ledger = Ledger::open(directory()).unwrap();
    let name = ["1.entry", "1.entry", "overheads.toml", "1.new"][usize::from(kind % 4)];
    let path = directory().join(name);
    let text = match kind % 4 {
        1 => [header(rest).as_bytes(), rest].concat(),
        _ => rest.to_vec(),
    };
    let file = owned(&path, &text);
    let view = ledger.view().unwrap();
    assert!(view.entries.len() + view.warnings.len() <= 1);
    if let Err(error) = ledger.overheads() {
        assert!(error.to_string().contains("overheads.toml"));
    }
    let ms = Duration::from_millis;
    let worker = Worker::guaranteed("control", Guarantee::of(ms(3)).every(ms(10)));
    let request = Request::new(Machine::with_cpus(2)).worker(worker);
    match ledger.admit(&request, "fuzz") {
        Ok(admitted) => assert_eq!(
            ledger.view().unwrap().entries.len(),
            view.entries.len() + 1,
            "{:?}",
            admitted.plan
        ),
        Err(Denied::Refused(refusal)) => assert!(!refusal.sentence.is_empty()),
        Err(Denied::Ledger(error)) => panic!("{error}"),
    }
    drop(file);
    fs::remove_file(path).ok();
});

/// The first line of an entry with this body.
fn header(body: &[u8]) -> String {
    let mut sum = 0xcbf2_9ce4_8422_2325_u64;
    for byte in body {
        sum = (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    }
    format!("# replenish reservation 1 {sum:016x}\n")
}

/// A file whose owner lives.
fn owned(path: &PathBuf, text: &[u8]) -> File {
    let mut options = OpenOptions::new();
    let mut file = options
        .read(true)
        .write(true)
        .create(true)
        .truncate(true)
        .open(path)
        .unwrap();
    file.write_all(text).unwrap();
    let lock = libc::flock {
        l_type: libc::F_WRLCK as libc::c_short,
        l_whence: libc::SEEK_SET as libc::c_short,
        l_start: 0,
        l_len: 1,
        l_pid: 0,
    };
    fcntl(&file, FcntlArg::F_OFD_SETLK(&lock)).unwrap();
    file
}
