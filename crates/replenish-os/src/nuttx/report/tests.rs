//! A value that does not match is refused by its name.

use super::*;

fn good() -> ShimReport {
    ShimReport {
        bytes: u32::try_from(size_of::<ShimReport>()).unwrap(),
        version: VERSION,
        thread_bytes: 40,
        thread_align: 8,
        attr_bytes: 56,
        param_bytes: 48,
        mutex_bytes: 28,
        time_bytes: 8,
        misfits: 0,
        features: MASKS | SWITCHES | SPORADIC,
        max_repl: 100,
        lowest: 1,
        started: 0,
        unused: 0,
        resolution: 250,
        step: 100_000,
    }
}

fn refused(change: impl FnOnce(&mut ShimReport)) -> String {
    let mut report = good();
    change(&mut report);
    report.judge(false).unwrap_err().to_string()
}

#[test]
fn a_fitting_image_is_described() {
    let info = good().judge(false).unwrap();
    assert_eq!((info.native_repl, info.lowest), (100, 1));
    assert!(info.switch_hooks && !info.round_robin);
    let text = info.to_string();
    assert!(
        text.contains("clock 250 ns, tick 100000 ns, switch hooks"),
        "{text}"
    );
}

#[test]
fn each_misfit_is_named() {
    let text = refused(|r| r.version = 7);
    assert!(text.contains("version 7"), "{text}");
    let text = refused(|r| r.bytes -= 4);
    assert!(text.contains("68 bytes"), "{text}");
    let text = refused(|r| r.thread_bytes = 65);
    assert!(
        text.contains("65 bytes") && text.contains("up to 64"),
        "{text}"
    );
    let text = refused(|r| r.thread_align = 16);
    assert!(text.contains("aligned to 16"), "{text}");
    let text = refused(|r| (r.misfits, r.attr_bytes) = (1, 20));
    assert!(text.contains("pthread_attr_t has 20 bytes"), "{text}");
    let text = refused(|r| r.misfits = 8);
    assert!(text.contains("struct timespec"), "{text}");
    let text = refused(|r| r.features &= !SWITCHES);
    assert!(
        text.contains("CONFIG_SCHED_INSTRUMENTATION_SWITCH"),
        "{text}"
    );
    let text = refused(|r| r.features &= !MASKS);
    assert!(text.contains("CONFIG_BUILD_FLAT"), "{text}");
    let text = refused(|r| r.started = 12);
    assert!(
        text.contains("error 12") && text.contains("CONFIG_TLS_NELEM"),
        "{text}"
    );
    let text = refused(|r| r.resolution = 0);
    assert!(text.contains("allowed 1 to"), "{text}");
    let text = refused(|r| r.step = 10_000_000);
    assert!(text.contains("10000000 ns"), "{text}");
}

#[test]
fn this_host_fits() {
    let info = check().unwrap();
    assert!(!info.switch_hooks && info.round_robin, "{info}");
    assert_eq!(info.lowest, 0);
    assert!(is_good());
}
