//! The functions that C calls.
//!
//! Each checks its pointers, catches panics, and answers with a code. All may be called from any
//! thread at any time, but not from a signal handler.
#![allow(
    clippy::doc_markdown,
    reason = "documentation here is that of the C header"
)]
#![expect(
    unsafe_code,
    reason = "pointers from C are read and written here, and symbols have C names"
)]

use crate::layout::{
    Options, REPLENISH_ANY_CPU, REPLENISH_IDLE, REPLENISH_NAME, REPLENISH_OTHER, REPLENISH_SUSPEND,
    Usage,
};
use crate::status::{self, REPLENISH_VERSION, at_edge};
use replenish_threads::{
    self as budgets, Asked, ENFORCER, Failure, Guarantee, Level, Low, Params, Policy, Report,
    Requirement, SchedClass, Tid, Why, current_tid,
};
use std::ffi::{CStr, c_char};
use std::mem::{MaybeUninit, size_of};
use std::time::Duration;

/// The version of the library, in the form of REPLENISH_VERSION.
#[unsafe(no_mangle)]
pub extern "C" fn replenish_version() -> u32 {
    REPLENISH_VERSION
}

/// Whether the library fits a program that was compiled with a header of this version. Pass
/// REPLENISH_VERSION. REPLENISH_UNSUPPORTED if it does not.
#[unsafe(no_mangle)]
pub extern "C" fn replenish_check_version(header: u32) -> i32 {
    at_edge(|| {
        let (major, minor) = (header >> 16, header >> 8 & 0xff);
        let (own_major, own_minor) = (REPLENISH_VERSION >> 16, REPLENISH_VERSION >> 8 & 0xff);
        // Below 1.0 each minor version is another interface.
        if major == own_major && (minor == own_minor || major > 0 && minor < own_minor) {
            return Ok(());
        }
        let text = format!(
            "the program was compiled with the header of libreplenish {major}.{minor}, and runs with \
             {own_major}.{own_minor}: compile it again, or install the other library"
        );
        Err(Failure::new(Why::Unsupported, text))
    })
}

/// The text of the last error of the calling thread, empty if there was none. It is the library's,
/// and stays until this thread's next call that fails.
#[unsafe(no_mangle)]
pub extern "C" fn replenish_last_error() -> *const c_char {
    status::last_error(CStr::as_ptr).unwrap_or(c"".as_ptr())
}

/// The name of a code that a function answered with. Never null.
#[unsafe(no_mangle)]
pub extern "C" fn replenish_status_name(code: i32) -> *const c_char {
    status::name(code).as_ptr()
}

/// The number of the calling thread, for replenish_budget_attach from another one.
#[unsafe(no_mangle)]
pub extern "C" fn replenish_thread_id() -> i32 {
    current_tid().get()
}

/// Sets every field to its default. `size` is sizeof(replenish_options).
///
/// # Safety
/// `options` is null or points to `size` bytes that may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn replenish_options_init(options: *mut Options, size: usize) -> i32 {
    at_edge(|| {
        let defaults = Options {
            size,
            name: std::ptr::null(),
            amount_ns: 0,
            period_ns: 0,
            deadline_ns: 0,
            cpu: REPLENISH_ANY_CPU,
            priority: 0,
            background: REPLENISH_OTHER,
            reserved: 0,
        };
        // SAFETY: the caller promises `size` writable bytes.
        unsafe { put(options, size, "options", &defaults) }
    })
}

/// Makes a budget, without a thread, if it fits beside everything that was promised on this host.
/// Allocates, and can wait for other programs that are being admitted.
///
/// `budget` gets its number, which is never 0 and never used again.
///
/// # Safety
/// `options` is null or points to as many bytes as its first field says; its name is null or ends
/// with 0. `budget` is null or may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn replenish_budget_new(options: *const Options, budget: *mut u64) -> i32 {
    at_edge(|| {
        not_null(budget, "budget")?;
        // SAFETY: the caller promises as many readable bytes as the first field says.
        let options = unsafe { get(options, "options") }?;
        // SAFETY: the caller promises a text that ends with 0.
        let asked = unsafe { asked(&options) }?;
        let number = budgets::new(asked)?;
        // SAFETY: not null, and the caller promises that it may be written.
        unsafe { budget.write_unaligned(number) };
        Ok(())
    })
}

/// Gives a thread of this process the budget: from now on it runs on the budget's CPU, at the
/// priority while budget lasts. 0 is the calling thread. Threads of one budget share it.
#[unsafe(no_mangle)]
pub extern "C" fn replenish_budget_attach(budget: u64, tid: i32) -> i32 {
    at_edge(|| budgets::attach(budget, thread(tid)?))
}

/// Takes a thread out of the budget and gives it back the policy and CPUs that it had. 0 is the
/// calling thread. A thread that ends need not be detached.
#[unsafe(no_mangle)]
pub extern "C" fn replenish_budget_detach(budget: u64, tid: i32) -> i32 {
    at_edge(|| budgets::detach(budget, thread(tid)?))
}

/// Ends a budget: its threads get back what they had, and other programs may have its CPU time.
#[unsafe(no_mangle)]
pub extern "C" fn replenish_budget_release(budget: u64) -> i32 {
    at_edge(|| budgets::release(budget))
}

/// The figures of a budget so far. Set `usage->size` to sizeof(replenish_usage) before.
///
/// # Safety
/// `usage` is null or points to as many bytes as its first field says, which may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn replenish_budget_usage(budget: u64, usage: *mut Usage) -> i32 {
    at_edge(|| {
        not_null(usage, "usage")?;
        // SAFETY: the first field can be read, the caller promises; it lies at the beginning.
        let size = unsafe { usage.cast::<usize>().read_unaligned() };
        if size < size_of::<usize>() {
            return Err(too_small("usage", size));
        }
        let report = budgets::report(budget)?;
        // SAFETY: the caller promises `size` writable bytes.
        unsafe { put(usage, size, "usage", &figures(size, &report)) }
    })
}

/// The numbers of all budgets of this process, in the order in which they were made. At most
/// `capacity` of them are written to `budgets`, which may be null if that is 0; `count` gets how
/// many there are.
///
/// # Safety
/// `budgets` is null or has room for `capacity` numbers; `count` is null or may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn replenish_budget_list(
    budgets: *mut u64,
    capacity: usize,
    count: *mut usize,
) -> i32 {
    at_edge(|| {
        not_null(count, "count")?;
        if capacity > 0 {
            not_null(budgets, "budgets")?;
        }
        let numbers = budgets::list()?;
        for (place, number) in numbers.iter().take(capacity).enumerate() {
            // SAFETY: below `capacity`, for which the caller promises room.
            let to = unsafe { budgets.add(place) };
            // SAFETY: inside the caller's room.
            unsafe { to.write_unaligned(*number) };
        }
        // SAFETY: not null, and the caller promises that it may be written.
        unsafe { count.write_unaligned(numbers.len()) };
        Ok(())
    })
}

/// Makes a mark, a point of the program in its recording, which `replenish trace` shows.
///
/// The same name gives the same mark. Allocates; the first call makes the recording, a file of 1 MB
/// in memory below /dev/shm, or where REPLENISH_LIVE says; REPLENISH_LIVE=off makes none.
///
/// `mark` gets its number.
///
/// # Safety
/// `name` is null or ends with 0; `mark` is null or may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn replenish_mark_new(name: *const c_char, mark: *mut u32) -> i32 {
    at_edge(|| {
        not_null(name, "name")?;
        not_null(mark, "mark")?;
        // SAFETY: not null, and the caller promises its end.
        let name = unsafe { CStr::from_ptr(name) };
        let name = name.to_str().unwrap_or_default();
        if !(1..=120).contains(&name.len()) || name.contains(char::is_control) {
            return Err(Failure::invalid(
                "name is out of range: 1 to 120 bytes of UTF-8 without control characters",
            ));
        }
        let number = budgets::new_mark(name)?;
        // SAFETY: not null, and the caller promises that it may be written.
        unsafe { mark.write_unaligned(number) };
        Ok(())
    })
}

/// Records that the calling thread has come to a mark, with a value of the program's choice.
///
/// Reads the clock, and neither waits nor allocates, but for the thread's first mark. An error
/// leaves no text: REPLENISH_NOT_FOUND, there is no such mark; REPLENISH_FULL, 32 other threads
/// have marked something; REPLENISH_FORKED.
#[unsafe(no_mangle)]
pub extern "C" fn replenish_mark(mark: u32, value: u64) -> i32 {
    match budgets::mark(mark, value) {
        Ok(()) => status::REPLENISH_OK,
        Err(why) => status::code(why),
    }
}

fn not_null<T>(pointer: *const T, what: &str) -> Result<(), Failure> {
    if pointer.is_null() {
        return Err(Failure::invalid(format!("{what} is null")));
    }
    Ok(())
}

fn too_small(what: &str, size: usize) -> Failure {
    Failure::invalid(format!(
        "{what}.size is {size}: set it to sizeof(replenish_{what}) before the call"
    ))
}

fn thread(tid: i32) -> Result<Option<Tid>, Failure> {
    match tid {
        0 => Ok(None),
        tid => match Tid::new(tid) {
            Some(tid) => Ok(Some(tid)),
            None => Err(Failure::invalid(format!(
                "tid {tid} is out of range: 0 (the calling thread) or a thread's number"
            ))),
        },
    }
}

/// A struct of the caller's, which can be shorter than ours. One that is longer must be 0 beyond.
///
/// # Safety
/// `from` is null, or its first field can be read and says how many bytes can.
unsafe fn get(from: *const Options, what: &str) -> Result<Options, Failure> {
    not_null(from, what)?;
    // SAFETY: the first field can be read, the caller promises; it lies at the beginning.
    let size = unsafe { from.cast::<usize>().read_unaligned() };
    let ours = size_of::<Options>();
    if size < ours {
        // There is no older version yet.
        return Err(too_small(what, size));
    }
    for place in ours..size.min(4096) {
        // SAFETY: below the size that the caller promises.
        let byte = unsafe { from.cast::<u8>().add(place) };
        // SAFETY: inside the caller's struct.
        if unsafe { byte.read() } != 0 {
            return Err(Failure::new(
                Why::Unsupported,
                format!("{what} has fields of a newer header than this library knows"),
            ));
        }
    }
    let mut options = MaybeUninit::<Options>::zeroed();
    let to = options.as_mut_ptr().cast::<u8>();
    // SAFETY: both are `ours` bytes long and apart from each other.
    unsafe { to.copy_from_nonoverlapping(from.cast(), ours) };
    // SAFETY: every pattern of bytes is a valid value of integers and a pointer.
    Ok(unsafe { options.assume_init() })
}

/// Writes as much of `value` as the caller knows.
///
/// # Safety
/// `to` is null or `size` bytes of it can be written.
unsafe fn put<T: Copy>(to: *mut T, size: usize, what: &str, value: &T) -> Result<(), Failure> {
    not_null(to, what)?;
    if size < size_of::<T>() {
        // There is no older version yet.
        return Err(too_small(what, size));
    }
    // SAFETY: at least as long as `T`; it need not be aligned.
    unsafe { to.write_unaligned(*value) };
    Ok(())
}

/// # Safety
/// The name is null or ends with 0.
unsafe fn asked(options: &Options) -> Result<Asked, Failure> {
    not_null(options.name, "options.name")?;
    // SAFETY: not null, and the caller promises its end.
    let name = unsafe { CStr::from_ptr(options.name) };
    let name = name.to_str().unwrap_or_default();
    if name.is_empty() || name.len() >= REPLENISH_NAME || name.contains(char::is_control) {
        return Err(Failure::invalid(format!(
            "options.name is out of range: 1 to {} bytes of UTF-8 without control characters",
            REPLENISH_NAME - 1
        )));
    }
    let cpu = match options.cpu {
        REPLENISH_ANY_CPU => None,
        cpu => Some(usize::try_from(cpu).map_err(|_| {
            Failure::invalid(format!("options.cpu {cpu} is out of range: a CPU, or -1"))
        })?),
    };
    let top = ENFORCER - 1;
    let priority = match u8::try_from(options.priority) {
        Ok(0) => None,
        Ok(priority) if priority <= top => Some(priority),
        _ => {
            return Err(Failure::invalid(format!(
                "options.priority {} is out of range: 0 (the plan chooses) to {top}",
                options.priority
            )));
        }
    };
    if priority.is_some() && options.deadline_ns != 0 {
        return Err(Failure::invalid(
            "options.deadline_ns is for budgets whose priority the plan chooses: set one of both to 0",
        ));
    }
    if options.reserved != 0 {
        return Err(Failure::new(
            Why::Unsupported,
            "options.reserved is not 0: is it a field of a newer header?",
        ));
    }
    let background = background(options.background)?;
    Ok(Asked {
        name: name.to_owned(),
        scheduling: scheduling(options, priority, background)?,
        cpu,
        background,
    })
}

/// `None`, the deployment file's word alone, if neither amount nor period is said.
fn scheduling(
    options: &Options,
    priority: Option<u8>,
    background: SchedClass,
) -> Result<Option<Requirement>, Failure> {
    let (amount, period) = (options.amount_ns, options.period_ns);
    if amount == 0 && period == 0 {
        return Ok(None);
    }
    let Some(priority) = priority else {
        let span = Duration::from_nanos;
        let mut guarantee = Guarantee::of(span(amount)).every(span(period));
        if options.deadline_ns != 0 {
            guarantee = guarantee.deadline(span(options.deadline_ns));
        }
        guarantee.check().map_err(Failure::invalid)?;
        return Ok(Some(Requirement::Guarantee(guarantee)));
    };
    let low = match background {
        SchedClass::Fifo(low) => Low::Background(low),
        _ => Low::Background(0),
    };
    let params = Params::new(priority, low, amount, period, 16).map_err(Failure::invalid)?;
    let policy = Policy::sporadic(params).map_err(Failure::invalid)?;
    Ok(Some(Requirement::Policy(policy)))
}

fn background(value: i32) -> Result<SchedClass, Failure> {
    match (value, u8::try_from(value)) {
        (REPLENISH_OTHER, _) => Ok(SchedClass::Other),
        (REPLENISH_IDLE, _) => Ok(SchedClass::Idle),
        (REPLENISH_SUSPEND, _) => Err(Failure::new(
            Why::Unsupported,
            "options.background: a thread of C code cannot be suspended, it could hold a lock; use \
             REPLENISH_OTHER or REPLENISH_IDLE",
        )),
        (_, Ok(priority)) if priority < ENFORCER => Ok(SchedClass::Fifo(priority)),
        _ => Err(Failure::invalid(format!(
            "options.background {value} is out of range: REPLENISH_OTHER, REPLENISH_IDLE, or a \
             FIFO priority below the budget's"
        ))),
    }
}

fn figures(size: usize, report: &Report) -> Usage {
    let mut name = [0; REPLENISH_NAME];
    for (to, byte) in name.iter_mut().zip(report.name.bytes()) {
        *to = c_char::from_ne_bytes([byte]);
    }
    let usage = &report.usage;
    Usage {
        size,
        name,
        amount_ns: report.amount,
        period_ns: report.period,
        at_priority_ns: usage.high,
        background_ns: usage.background,
        exhaustions: usage.exhaustions,
        replenishments: usage.replenishments,
        worst_response_ns: report.worst_response.unwrap_or(0),
        displaced: report.displaced,
        threads: u32::try_from(usage.threads).unwrap_or(u32::MAX),
        cpu: i32::try_from(report.cpu).unwrap_or(REPLENISH_ANY_CPU),
        priority: report.priority.into(),
        at_priority: (usage.level == Level::High).into(),
        sees_blocking: usage.sees_blocking.into(),
        reserved: 0,
    }
}
