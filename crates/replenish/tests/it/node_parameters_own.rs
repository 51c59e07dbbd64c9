//! A node's own rights over its parameters, and what it lets others do: read-only ones, descriptors
//! that change while it runs, ranges of the wrong type, parameters that go.

use crate::common::executor;
use crate::node_parameters::{ask, double, kind, node, parameters};
use replenish::middleware::InProcessBus;
use replenish::{Descriptor, ParameterErrorKind as Kind, ParameterOptions, ParameterValue};
use replenish_interfaces::rcl_interfaces::msg::{Parameter, ParameterValue as Sent};
use replenish_interfaces::rcl_interfaces::srv;
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);

#[test]
fn the_node_itself_sets_read_only_ones_by_all_other_rules() {
    let p = parameters(ParameterOptions::new());
    let bounded = Descriptor::new().integer_range(0, 9, 0).read_only();
    p.declare("cycles", 0, bounded).unwrap();
    let heard = Arc::new(Mutex::new(Vec::new()));
    let note = Arc::clone(&heard);
    p.veto(|change| match change.new {
        ParameterValue::Integer(7) => Err("seven is taken"),
        _ => Ok(()),
    });
    p.after_set(move |change| note.lock().unwrap().push(change.new.to_string()));
    assert_eq!(kind(p.set("cycles", 1)), Kind::ReadOnly);
    p.set_own("cycles", 1).unwrap();
    assert_eq!(p.get::<i64>("cycles").unwrap(), 1);
    assert_eq!(kind(p.set_own("cycles", 10)), Kind::Range);
    assert_eq!(kind(p.set_own("cycles", "many")), Kind::Type);
    assert_eq!(kind(p.set_own("cycles", 7)), Kind::Refused);
    assert_eq!(kind(p.set_own("none", 1)), Kind::Unknown);
    assert_eq!(kind(p.undeclare("cycles")), Kind::ReadOnly);
    assert_eq!(*heard.lock().unwrap(), ["1"]);
}

#[test]
fn a_descriptor_changes_while_the_node_runs() {
    let p = parameters(ParameterOptions::new());
    p.declare("gain", 0.5, Descriptor::new()).unwrap();
    let unit = Descriptor::new()
        .description("loop gain")
        .double_range(0.0, 1.0, 0.0);
    p.set_descriptor("gain", unit.clone()).unwrap();
    assert_eq!(p.descriptor("gain").unwrap(), unit);
    assert_eq!(kind(p.set("gain", 1.5)), Kind::Range);
    p.set_descriptor("gain", unit.clone().read_only()).unwrap();
    assert_eq!(kind(p.set("gain", 0.25)), Kind::ReadOnly);
    p.set_descriptor("gain", Descriptor::new()).unwrap();
    p.set("gain", 1.5).unwrap();
    // The value must be allowed by the new one; the old one holds until then.
    let error = p.set_descriptor("gain", unit.clone()).unwrap_err();
    assert_eq!(
        error.reason(),
        "gain = 1.5: allowed are 0..=1 in steps of 0"
    );
    p.set("gain", 3.0).unwrap();
    assert_eq!(kind(p.set_descriptor("none", unit)), Kind::Unknown);
    // A parameter with dynamic typing keeps the type that it has when the typing ends.
    p.declare("any", 1, Descriptor::new().dynamic_typing())
        .unwrap();
    p.set("any", true).unwrap();
    p.set_descriptor("any", Descriptor::new()).unwrap();
    assert_eq!(kind(p.set("any", 1)), Kind::Type);
    p.set("any", false).unwrap();
    // A callback of setting must not wait for itself.
    let (inside, nested) = (p.clone(), Arc::new(AtomicBool::new(false)));
    let seen = Arc::clone(&nested);
    p.after_set(move |_| {
        let refused = kind(inside.set_descriptor("gain", Descriptor::new()));
        seen.store(refused == Kind::Nested, Ordering::Relaxed);
    });
    p.set("gain", 4.0).unwrap();
    assert!(nested.load(Ordering::Relaxed));
}

#[test]
fn a_range_of_another_type_is_refused_by_name() {
    let p = parameters(ParameterOptions::new());
    let (integers, doubles) = (
        Descriptor::new().integer_range(0, 9, 1),
        Descriptor::new().double_range(0.0, 9.0, 1.0),
    );
    let error = p.declare("gain", 0.5, integers.clone()).unwrap_err();
    assert_eq!(error.kind(), Kind::Type);
    assert_eq!(
        error.reason(),
        "gain: it is of type double, integer_range is for types integer and integer array"
    );
    assert_eq!(kind(p.declare("name", "arm", doubles.clone())), Kind::Type);
    p.declare("count", 1, integers.clone()).unwrap();
    p.declare("gains", &[0.0, 1.0][..], doubles.clone())
        .unwrap();
    assert_eq!(kind(p.set_descriptor("count", doubles)), Kind::Type);
    assert_eq!(kind(p.set_descriptor("gains", integers)), Kind::Type);
    // With dynamic typing each range holds for values of its own type.
    let both = Descriptor::new()
        .dynamic_typing()
        .integer_range(0, 9, 0)
        .double_range(0.0, 1.0, 0.0);
    p.declare("any", "text", both).unwrap();
    assert_eq!(kind(p.set("any", 10)), Kind::Range);
    assert_eq!(kind(p.set("any", 5.0)), Kind::Range);
    p.set("any", 5).unwrap();
}

#[test]
fn a_callback_refuses_that_a_parameter_goes() {
    let p = parameters(ParameterOptions::new());
    p.declare("kept", 1, Descriptor::new()).unwrap();
    p.declare("free", 1, Descriptor::new()).unwrap();
    p.veto(|change| match (change.name, &change.new) {
        ("kept", ParameterValue::NotSet) => Err("it is in use"),
        _ => Ok(()),
    });
    let error = p.undeclare("kept").unwrap_err();
    assert_eq!(
        (error.kind(), error.reason()),
        (Kind::Refused, "kept: it is in use")
    );
    assert_eq!(p.get::<i64>("kept").unwrap(), 1);
    p.undeclare("free").unwrap();
    assert_eq!(kind(p.get::<i64>("free")), Kind::Unknown);
}

#[test]
fn others_see_new_descriptors_and_undeclare_where_they_may() {
    let _dog = watchdog("parameters of others", LIMIT);
    for may in [false, true] {
        let options = ParameterOptions::new();
        let options = if may {
            options.others_may_undeclare()
        } else {
            options
        };
        let bus = InProcessBus::new();
        let node = node(&bus);
        let p = node.parameters(options).unwrap();
        for name in ["free", "fixed", "kept"] {
            p.declare(name, 0.5, Descriptor::new()).unwrap();
        }
        p.veto(|change| match (change.name, &change.new) {
            ("kept", ParameterValue::NotSet) => Err("it is in use"),
            _ => Ok(()),
        });
        let (mut exec, _) = executor(node.context());
        exec.worker("parameters").parameters(&p).unwrap();
        let running = exec.start().unwrap();
        p.set_descriptor("fixed", Descriptor::new().read_only())
            .unwrap();
        let names = vec!["fixed".to_owned()];
        let request = srv::DescribeParametersRequest { names };
        let got = ask::<srv::DescribeParameters>(&bus, "describe_parameters", &request);
        assert!(got.descriptors[0].read_only);
        let nothing = |name: &str| Parameter {
            name: name.into(),
            value: Sent::default(),
        };
        let parameters = vec![
            nothing("free"),
            nothing("fixed"),
            nothing("kept"),
            double("fixed", 1.0),
        ];
        let request = srv::SetParametersRequest { parameters };
        let got = ask::<srv::SetParameters>(&bus, "set_parameters", &request);
        let done: Vec<bool> = got.results.iter().map(|r| r.successful).collect();
        assert_eq!(done, [may, false, false, false], "{:?}", got.results);
        assert_eq!(&*got.results[1].reason, "fixed: it is read-only");
        assert_eq!(p.get::<f64>("free").is_err(), may);
        assert_eq!(p.get::<f64>("kept").unwrap(), 0.5);
        // The node itself sets it to nothing as little as before.
        assert_eq!(kind(p.set("kept", ParameterValue::NotSet)), Kind::Type);
        drop(running);
    }
}
