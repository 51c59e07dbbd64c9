//! Locked memory and touched stacks cause no page faults later.
#![allow(clippy::unwrap_used, reason = "test code")]

use replenish_os::{memory, privilege};
use replenish_testkit::harness::{run, trial};
use std::hint::black_box;
use std::sync::Mutex;

/// Locking changes what the stack trial looks at, and stacks that come and go change how much is
/// locked.
static ALONE: Mutex<()> = Mutex::new(());

fn main() {
    let refused = privilege::probe().memory_lock.err();
    let refused = refused.map(|why| why.to_string());
    run(vec![
        trial("a_touched_stack_causes_no_faults", touched_stack),
        trial("locked_memory_causes_no_faults", locked_memory).skipped_if(refused.as_deref()),
        trial("touching_stops_before_the_end_of_the_stack", || {
            let _alone = ALONE.lock().unwrap();
            let thread = std::thread::Builder::new().stack_size(256 << 10);
            let thread = thread.spawn(|| memory::prefault_stack(usize::MAX)).unwrap();
            thread.join().unwrap().unwrap();
        }),
    ])
}

/// Page faults of the calling thread so far, from `/proc/thread-self/stat`.
fn faults() -> u64 {
    let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
    let after_name = stat.rsplit_once(") ").unwrap().1;
    after_name.split(' ').nth(7).unwrap().parse().unwrap()
}

#[inline(never)]
fn use_stack(frames: usize) {
    let mut frame = [0_u8; 4096];
    black_box(&mut frame);
    if frames > 0 {
        use_stack(frames - 1);
    }
    black_box(&mut frame);
}

/// Faults while 2 MiB of stack are used, in a thread whose stack no thread has used before (the
/// C library keeps old stacks, hence the growing sizes).
fn faults_of_deep_calls(stack: usize, prefault: usize) -> u64 {
    let thread = std::thread::Builder::new().stack_size(stack);
    let thread = thread.spawn(move || {
        memory::prefault_stack(prefault).unwrap();
        faults(); // whatever reading the file needs, it has now
        let before = faults();
        use_stack(512);
        faults() - before
    });
    thread.unwrap().join().unwrap()
}

fn touched_stack() {
    let _alone = ALONE.lock().unwrap();
    let untouched = faults_of_deep_calls(8 << 20, 0);
    let touched = faults_of_deep_calls(40 << 20, 4 << 20);
    assert!(untouched >= 256, "the control saw {untouched} faults only");
    assert!(
        touched < 32,
        "{touched} faults after touching, {untouched} without"
    );
}

fn locked_memory() {
    let _alone = ALONE.lock().unwrap();
    let locked = || {
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let line = status
            .lines()
            .find_map(|l| l.strip_prefix("VmLck:"))
            .unwrap();
        line.trim().trim_end_matches(" kB").parse::<u64>().unwrap()
    };
    assert_eq!(locked(), 0);
    memory::lock_all().unwrap();
    let before = locked();
    assert!(before > 0);
    let block = vec![0_u8; 64 << 20]; // a mapping of its own
    assert!(
        locked() >= before + (63 << 10),
        "future mappings are not locked"
    );
    let mapped = faults();
    assert!(block.iter().step_by(4096).all(|byte| *black_box(byte) == 0));
    assert!(faults() - mapped < 64, "of {} pages", block.len() / 4096);
    memory::unlock_all().unwrap();
    assert_eq!(locked(), 0);
}
