//! Ranges and messages of policies.

#![allow(clippy::unwrap_used, reason = "test helpers")]

extern crate std;
use super::*;
use std::string::ToString;

const MS: Nanos = 1_000_000;

#[test]
fn priorities_go_from_1_to_99() {
    for good in [1, 60, 99] {
        assert_eq!(Policy::fifo(good).unwrap().priority(), Some(good));
        assert_eq!(Policy::round_robin(good).unwrap().priority(), Some(good));
    }
    for bad in [0, 100, 255] {
        assert_eq!(Policy::fifo(bad), Err(PolicyError::Priority { value: bad }));
        assert_eq!(
            Policy::round_robin(bad),
            Err(PolicyError::Priority { value: bad })
        );
    }
    let params = Params::new(100, Low::Background(6), MS, 10 * MS, 4).unwrap();
    let refused = Policy::sporadic(params).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "priority 100 is out of range: allowed 1 to 99"
    );
}

#[test]
fn a_deadline_reservation_is_ordered() {
    assert!(Policy::deadline(1024, 1024, 1024).is_ok());
    assert!(Policy::deadline(3 * MS, 5 * MS, 10 * MS).is_ok());
    let refused = Policy::deadline(1023, MS, MS).unwrap_err().to_string();
    assert!(
        refused.contains("runtime 1023 ns") && refused.contains("1024 to 1000000"),
        "{refused}"
    );
    let refused = Policy::deadline(2 * MS, MS, 3 * MS).unwrap_err();
    assert_eq!(
        refused,
        PolicyError::Runtime {
            value: 2 * MS,
            deadline: MS
        }
    );
    let refused = Policy::deadline(MS, 3 * MS, 2 * MS).unwrap_err();
    assert_eq!(
        refused,
        PolicyError::Deadline {
            value: 3 * MS,
            period: 2 * MS
        }
    );
    let refused = Policy::deadline(MS, 3 * MS, u64::MAX).unwrap_err();
    assert_eq!(refused, PolicyError::Period { value: u64::MAX });
}

#[test]
fn errors_of_the_server_pass_through() {
    let refused = Params::new(60, Low::Background(60), MS, 10 * MS, 4).unwrap_err();
    assert_eq!(PolicyError::from(refused).to_string(), refused.to_string());
}

#[test]
fn policies_print_as_people_write_them() {
    let params = Params::new(60, Low::Background(6), 30 * MS, 100 * MS, 100).unwrap();
    for (policy, text) in [
        (Policy::Other, "OTHER"),
        (Policy::Fifo { priority: 50 }, "FIFO 50"),
        (Policy::RoundRobin { priority: 7 }, "RR 7"),
        (
            Policy::Sporadic(params),
            "SPORADIC 60/6 (30 ms every 100 ms)",
        ),
        (
            Policy::KernelSporadic(params),
            "SCHED_SPORADIC 60/6 (30 ms every 100 ms)",
        ),
        (
            Policy::deadline(1_500_000, 10 * MS, 1_000 * MS).unwrap(),
            "DEADLINE 1500 us/10 ms/1 s",
        ),
    ] {
        assert_eq!(policy.to_string(), text);
    }
    assert_eq!(WholeUnits(0).to_string(), "0 ns");
    assert_eq!(WholeUnits(1_001).to_string(), "1001 ns");
}
