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
        trial("a_kept_program_is_in_memory_whole", kept_program).skipped_if(refused.as_deref()),
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
    assert_eq!(locked_in_all(), 0);
    memory::lock_all().unwrap();
    let before = locked_in_all();
    assert!(before > 0);
    let block = vec![0_u8; 256 << 20]; // a mapping of its own
    // Threads of other trials end meanwhile, and their stacks are locked no more.
    assert!(
        locked_in_all() >= before + (128 << 10),
        "future mappings are not locked"
    );
    let mapped = faults();
    assert!(block.iter().step_by(4096).all(|byte| *black_box(byte) == 0));
    assert!(faults() - mapped < 64, "of {} pages", block.len() / 4096);
    memory::unlock_all().unwrap();
    assert_eq!(locked_in_all(), 0);
}

/// Locked memory of the process in kB.
fn locked_in_all() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|l| l.strip_prefix("VmLck:"));
    let kilobytes = line.unwrap().trim().trim_end_matches(" kB");
    kilobytes.parse().unwrap()
}

/// `(size, resident, locked)` in kB of all private mappings of the program's file.
fn program() -> (u64, u64, u64) {
    let own = std::fs::read_link("/proc/self/exe").unwrap();
    let own = own.to_str().unwrap();
    let maps = std::fs::read_to_string("/proc/self/smaps").unwrap();
    let (mut of_program, mut sum) = (false, (0, 0, 0));
    for line in maps.lines() {
        let Some((name, value)) = line.split_once(':') else {
            continue;
        };
        let value = value.trim().trim_end_matches(" kB").parse::<u64>();
        match (name, value) {
            ("Size", Ok(kb)) if of_program => sum.0 += kb,
            ("Rss", Ok(kb)) if of_program => sum.1 += kb,
            ("Locked", Ok(kb)) if of_program => sum.2 += kb,
            (name, _) if name.contains('-') => of_program = line.ends_with(own),
            _ => {}
        }
    }
    sum
}

/// Without, a budget was 900 us late (a torture beside a compiler that filled the memory): the
/// kernel had taken the enforcer's instructions back, and the disk was slow.
fn kept_program() {
    let _alone = ALONE.lock().unwrap();
    let (size, _, locked) = program();
    assert!(size > 0 && locked == 0);
    memory::keep_program().unwrap();
    let (_, resident, locked) = program();
    assert!(resident == size, "{resident} of {size} kB are in memory");
    // The kernel counts a page that others have mapped as a part.
    assert!(locked * 10 >= size * 9, "{locked} of {size} kB are locked");
    assert!(
        locked_in_all() < 64 << 10,
        "only the program and its libraries"
    );
    memory::keep_program().unwrap(); // again: nothing changes
    assert_eq!(program().0, size);
    memory::unlock_all().unwrap();
    assert_eq!(program().2, 0);
}
