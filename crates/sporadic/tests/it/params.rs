//! Parameters: what is refused, and that the message names the field, its value and the range.

use sporadic::{BudgetServer, Corrected, Kind, Low, ParamError, Params, Posix, Server};

/// The message must contain all of `parts`.
fn says(error: &ParamError, parts: &[&str]) {
    let message = error.to_string();
    for part in parts {
        assert!(message.contains(part), "no {part:?} in {message:?}");
    }
}

#[test]
fn limits_are_inclusive() {
    assert!(Params::new(1, Low::Background(0), 1, 1, 1).is_ok());
    assert!(Params::new(255, Low::Background(254), u64::MAX, u64::MAX, u16::MAX).is_ok());
    assert!(Params::new(1, Low::Suspend, 7, 7, 1).is_ok());
}

#[test]
fn getters_return_what_was_given() {
    let params = Params::new(60, Low::Background(6), 30, 100, 12).unwrap();
    assert_eq!(params.priority(), 60);
    assert_eq!(params.low(), Low::Background(6));
    assert_eq!(
        (params.budget(), params.period(), params.max_repl()),
        (30, 100, 12)
    );
}

#[test]
fn priority_zero() {
    for low in [Low::Suspend, Low::Background(0)] {
        let error = Params::new(0, low, 30, 100, 4).unwrap_err();
        assert_eq!(error, ParamError::Priority { value: 0 });
        says(&error, &["priority 0", "1 to 255"]);
    }
}

#[test]
fn low_priority_not_below() {
    for low in [60, 61, 255] {
        let error = Params::new(60, Low::Background(low), 30, 100, 4).unwrap_err();
        assert_eq!(
            error,
            ParamError::LowPriority {
                value: low,
                priority: 60
            }
        );
        says(&error, &[&format!("low priority {low}"), "0 to 59"]);
    }
}

#[test]
fn period_zero() {
    let error = Params::new(60, Low::Background(6), 0, 0, 4).unwrap_err();
    assert_eq!(error, ParamError::Period { value: 0 });
    says(&error, &["period 0 ns", "1 to 18446744073709551615 ns"]);
}

#[test]
fn budget_zero_or_above_the_period() {
    for budget in [0, 101, u64::MAX] {
        let error = Params::new(60, Low::Background(6), budget, 100, 4).unwrap_err();
        assert_eq!(
            error,
            ParamError::Budget {
                value: budget,
                period: 100
            }
        );
        says(&error, &[&format!("budget {budget} ns"), "1 to 100 ns"]);
    }
}

#[test]
fn max_repl_zero() {
    let error = Params::new(60, Low::Background(6), 30, 100, 0).unwrap_err();
    says(&error, &["max_repl 0", "1 to 65535"]);
}

#[test]
fn max_repl_above_the_capacity_of_the_server() {
    let params = |max_repl| Params::new(60, Low::Background(6), 30, 100, max_repl).unwrap();
    let expected = ParamError::MaxRepl {
        value: 129,
        capacity: 128,
    };
    assert_eq!(Corrected::<128>::new(params(129), 0).unwrap_err(), expected);
    assert_eq!(Posix::<128>::new(params(129), 0).unwrap_err(), expected);
    for kind in [Kind::Corrected, Kind::Posix] {
        assert_eq!(
            Server::<128>::new(kind, params(129), 0).unwrap_err(),
            expected
        );
        assert_eq!(
            Server::<128>::new(kind, params(128), 0).unwrap().kind(),
            kind
        );
    }
    says(&expected, &["max_repl 129", "1 to 128"]);
    // A caller that has checked before gets the server itself.
    assert_eq!(params(129).check_capacity(128).unwrap_err(), expected);
    assert_eq!(params(128).check_capacity(128), Ok(()));
    for kind in [Kind::Corrected, Kind::Posix] {
        let mut clamped = Server::<2>::clamped(kind, params(5), 0);
        let mut two = Server::<2>::new(kind, params(2), 0).unwrap();
        for now in (0..40).step_by(4) {
            for server in [&mut clamped, &mut two] {
                server.activate(now);
                server.charge(1, now + 1);
                server.block(now + 1);
            }
            assert_eq!(clamped.pending(), two.pending());
            assert_eq!(clamped.available(now + 1), two.available(now + 1));
        }
    }
    // A capacity beyond the range of max_repl takes everything.
    assert!(Corrected::<70_000>::new(params(u16::MAX), 0).is_ok());
}

#[test]
fn servers_can_be_made_at_compile_time() {
    const PARAMS: Params = match Params::new(60, Low::Suspend, 30, 100, 4) {
        Ok(params) => params,
        Err(_) => unreachable!(),
    };
    static SERVER: Server<4> = match Server::new(Kind::Corrected, PARAMS, 7) {
        Ok(server) => server,
        Err(_) => unreachable!(),
    };
    assert_eq!(SERVER.params(), &PARAMS);
    assert_eq!((SERVER.available(6), SERVER.available(7)), (30, 30));
}

#[test]
fn errors_are_errors() {
    let error: Box<dyn std::error::Error + Send + Sync> =
        Box::new(Params::new(0, Low::Suspend, 1, 1, 1).unwrap_err());
    assert!(error.downcast_ref::<ParamError>().is_some());
}
