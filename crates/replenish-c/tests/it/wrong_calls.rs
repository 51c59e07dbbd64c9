//! Wrong calls get a code and a text that names the argument and its range; nobody needs a
//! privilege for that.

#![allow(unsafe_code, reason = "the interface is called as C calls it")]

use replenish_c::*;
use std::ffi::{CStr, CString};
use std::mem::size_of;

fn text() -> String {
    // SAFETY: the text of this thread, which stays until its next call that fails.
    let text = unsafe { CStr::from_ptr(replenish_last_error()) };
    text.to_str().unwrap().to_owned()
}

fn options() -> Options {
    let mut options = std::mem::MaybeUninit::uninit();
    // SAFETY: as many bytes as it says.
    let code = unsafe { replenish_options_init(options.as_mut_ptr(), size_of::<Options>()) };
    assert_eq!(code, REPLENISH_OK);
    // SAFETY: every field was set.
    unsafe { options.assume_init() }
}

/// The code and text of an attempt with these options.
fn attempt(name: &str, change: impl FnOnce(&mut Options)) -> (i32, String) {
    let name = CString::new(name).unwrap();
    let mut options = options();
    options.name = name.as_ptr();
    options.amount_ns = 1_000_000;
    options.period_ns = 100_000_000;
    change(&mut options);
    let mut budget = 0;
    // SAFETY: both live.
    let code = unsafe { replenish_budget_new(&raw const options, &raw mut budget) };
    assert_eq!(budget, 0);
    (code, text())
}

#[test]
fn null_is_no_pointer() {
    let mut budget = 0;
    // SAFETY: null is allowed everywhere.
    let new = unsafe { replenish_budget_new(std::ptr::null(), &raw mut budget) };
    assert_eq!(
        (new, text().as_str()),
        (REPLENISH_INVALID, "options is null")
    );
    let whole = options();
    // SAFETY: as above.
    let new = unsafe { replenish_budget_new(&raw const whole, std::ptr::null_mut()) };
    assert_eq!(
        (new, text().as_str()),
        (REPLENISH_INVALID, "budget is null")
    );
    // SAFETY: as above.
    let init = unsafe { replenish_options_init(std::ptr::null_mut(), 64) };
    assert_eq!(
        (init, text().as_str()),
        (REPLENISH_INVALID, "options is null")
    );
    // SAFETY: as above.
    let usage = unsafe { replenish_budget_usage(1, std::ptr::null_mut()) };
    assert_eq!(
        (usage, text().as_str()),
        (REPLENISH_INVALID, "usage is null")
    );
    let mut count = 0;
    // SAFETY: as above.
    let list = unsafe { replenish_budget_list(std::ptr::null_mut(), 0, &raw mut count) };
    assert_eq!((list, count), (REPLENISH_OK, 0));
    // SAFETY: as above.
    let list = unsafe { replenish_budget_list(std::ptr::null_mut(), 1, &raw mut count) };
    assert_eq!(
        (list, text().as_str()),
        (REPLENISH_INVALID, "budgets is null")
    );
    // SAFETY: as above.
    let list = unsafe { replenish_budget_list(std::ptr::null_mut(), 0, std::ptr::null_mut()) };
    assert_eq!(
        (list, text().as_str()),
        (REPLENISH_INVALID, "count is null")
    );
}

#[test]
fn sizes_are_checked() {
    let (code, text_of) = attempt("a", |options| options.size = 8);
    assert_eq!(code, REPLENISH_INVALID);
    assert!(text_of.contains("sizeof(replenish_options)"), "{text_of}");
    /// As a newer header has it.
    #[repr(C)]
    struct Longer {
        options: Options,
        more: u64,
    }
    let mut longer = Longer {
        options: options(),
        more: 7,
    };
    longer.options.size = size_of::<Longer>();
    let mut budget = 0;
    // SAFETY: as many bytes as it says.
    let new = unsafe { replenish_budget_new((&raw const longer).cast(), &raw mut budget) };
    assert_eq!(new, REPLENISH_UNSUPPORTED);
    assert!(text().contains("newer header"), "{}", text());
    longer.more = 0;
    // SAFETY: as many bytes as it says.
    let new = unsafe { replenish_budget_new((&raw const longer).cast(), &raw mut budget) };
    assert_eq!(
        (new, text().as_str()),
        (REPLENISH_INVALID, "options.name is null")
    );
    let mut small = [4_usize];
    // SAFETY: as many bytes as it says.
    let usage = unsafe { replenish_budget_usage(1, small.as_mut_ptr().cast()) };
    assert_eq!(usage, REPLENISH_INVALID);
    assert!(text().contains("sizeof(replenish_usage)"), "{}", text());
}

#[test]
fn values_out_of_range_are_named() {
    let invalid = |name: &str, change: fn(&mut Options), said: &str| {
        let (code, text) = attempt(name, change);
        assert_eq!(code, REPLENISH_INVALID, "{text}");
        assert!(text.contains(said), "{said:?} in {text:?}");
    };
    invalid("", |_| {}, "options.name");
    invalid("a\n", |_| {}, "options.name");
    invalid(&"a".repeat(32), |_| {}, "1 to 31 bytes");
    invalid("a", |o| o.cpu = -7, "options.cpu -7");
    invalid("a", |o| o.priority = 99, "options.priority 99");
    invalid("a", |o| o.background = -3, "options.background -3");
    invalid("a", |o| o.background = 99, "options.background 99");
    invalid(
        "a",
        |o| (o.priority, o.deadline_ns) = (5, 5),
        "options.deadline_ns",
    );
    let (code, text) = attempt("a", |o| o.background = REPLENISH_SUSPEND);
    assert_eq!(code, REPLENISH_UNSUPPORTED, "{text}");
    let (code, text) = attempt("a", |o| o.reserved = 1);
    assert_eq!(code, REPLENISH_UNSUPPORTED, "{text}");
}

#[test]
fn an_unknown_budget_or_thread_is_said() {
    let mut usage = [0_u64; 64];
    usage[0] = 512;
    // SAFETY: as many bytes as it says.
    let code = unsafe { replenish_budget_usage(77, usage.as_mut_ptr().cast()) };
    assert_eq!(code, REPLENISH_NOT_FOUND);
    for code in [
        replenish_budget_attach(77, 0),
        replenish_budget_detach(77, 0),
        replenish_budget_release(0),
    ] {
        assert_eq!(code, REPLENISH_NOT_FOUND);
    }
    assert!(text().contains("no budget 0"), "{}", text());
    assert_eq!(replenish_budget_attach(77, -1), REPLENISH_INVALID);
    assert!(text().contains("tid -1"), "{}", text());
}

#[test]
fn versions_are_compared() {
    assert_eq!(replenish_version(), REPLENISH_VERSION);
    assert_eq!(replenish_check_version(REPLENISH_VERSION), REPLENISH_OK);
    assert_eq!(replenish_check_version(REPLENISH_VERSION + 1), REPLENISH_OK);
    for other in [REPLENISH_VERSION + 0x100, REPLENISH_VERSION + 0x1_0000, 0] {
        assert_eq!(replenish_check_version(other), REPLENISH_UNSUPPORTED);
        assert!(text().contains("compile it again"), "{}", text());
    }
    let mut seen = std::collections::BTreeSet::new();
    for code in -1..=REPLENISH_FORKED + 1 {
        // SAFETY: never null, and lives for ever.
        seen.insert(unsafe { CStr::from_ptr(replenish_status_name(code)) });
    }
    assert_eq!(seen.len(), 12, "one for each, and one for unknown ones");
}
