//! Parameters of nodes: types, ranges, callbacks, bounds; and the services and events of ROS 2, as
//! a client in another context sees them.

use crate::common::executor;
use replenish::middleware::InProcessBus;
use replenish::msg::Service;
use replenish::{
    Client, Context, Descriptor, Error, Executor, Node, ParameterError, ParameterErrorKind as Kind,
    ParameterOptions, ParameterValue, Parameters, Qos, SpinEnd, Topic,
};
use replenish_interfaces::lifecycle_msgs::srv::{ChangeState, ChangeStateRequest};
use replenish_interfaces::rcl_interfaces::msg::{
    Parameter, ParameterEvent, ParameterValue as Sent,
};
use replenish_interfaces::rcl_interfaces::srv;
use replenish_testkit::watchdog::watchdog;
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(30);

pub(crate) fn node(bus: &InProcessBus) -> Node {
    Context::new(bus.participant()).node("robot/arm").unwrap()
}

pub(crate) fn parameters(options: ParameterOptions) -> Parameters {
    node(&InProcessBus::new()).parameters(options).unwrap()
}

pub(crate) fn kind<T>(result: Result<T, ParameterError>) -> Kind {
    result.err().expect("an error").kind()
}

#[test]
fn every_type_comes_back_as_it_was_set_and_keeps_its_type() {
    let p = parameters(ParameterOptions::new());
    let texts = ["a", "", "größer"];
    let values: [(&str, ParameterValue<'_>, ParameterValue<'_>); 9] = [
        ("bool", false.into(), true.into()),
        ("integer", 0.into(), i64::MIN.into()),
        ("double", 0.0.into(), (-1.5).into()),
        ("string", "".into(), "text".into()),
        (
            "bytes",
            (&[][..] as &[u8]).into(),
            (&[0_u8, 255][..]).into(),
        ),
        (
            "bools",
            (&[][..] as &[bool]).into(),
            (&[true, false][..]).into(),
        ),
        (
            "integers",
            (&[][..] as &[i64]).into(),
            (&[1_i64, -2][..]).into(),
        ),
        (
            "doubles",
            (&[][..] as &[f64]).into(),
            (&[0.25, 4e9][..]).into(),
        ),
        ("strings", (&[][..] as &[&str]).into(), (&texts[..]).into()),
    ];
    for (name, first, second) in &values {
        p.declare(name, first.clone(), Descriptor::new()).unwrap();
        p.set(name, second.clone()).unwrap();
    }
    assert!(p.get::<bool>("bool").unwrap());
    assert_eq!(p.get::<i64>("integer").unwrap(), i64::MIN);
    assert_eq!(p.get::<f64>("double").unwrap(), -1.5);
    assert_eq!(p.get::<String>("string").unwrap(), "text");
    assert_eq!(p.get::<Vec<u8>>("bytes").unwrap(), [0, 255]);
    assert_eq!(p.get::<Vec<bool>>("bools").unwrap(), [true, false]);
    assert_eq!(p.get::<Vec<i64>>("integers").unwrap(), [1, -2]);
    assert_eq!(p.get::<Vec<f64>>("doubles").unwrap(), [0.25, 4e9]);
    assert_eq!(p.get::<Vec<String>>("strings").unwrap(), texts);
    for (name, value, _) in &values {
        for (_, other, _) in &values {
            let outcome = p.set(name, other.clone());
            assert_eq!(outcome.is_ok(), other.type_number() == value.type_number());
        }
        assert_eq!(kind(p.set(name, ParameterValue::NotSet)), Kind::Type);
    }
    let error = p.get::<bool>("double").unwrap_err();
    let reason = "double: it is of type double, asked for was bool";
    assert_eq!((error.kind(), error.reason()), (Kind::Type, reason));
    assert_eq!(kind(p.get::<bool>("none")), Kind::Unknown);
    assert_eq!(kind(p.set("none", true)), Kind::Unknown);
}

#[test]
fn ranges_steps_read_only_and_dynamic_types() {
    let p = parameters(ParameterOptions::new());
    let thirds = Descriptor::new().integer_range(-3, 7, 3);
    p.declare("i", 0, thirds.clone()).unwrap();
    let allowed: Vec<i64> = (-10..10).filter(|v| p.set("i", *v).is_ok()).collect();
    assert_eq!(allowed, [-3, 0, 3, 6, 7]);
    let error = p.set("i", 8).unwrap_err();
    assert_eq!(error.reason(), "i = 8: allowed are -3..=7 in steps of 3");
    assert_eq!(kind(p.declare("j", 1, thirds.clone())), Kind::Range);
    p.declare("list", &[0_i64][..], thirds).unwrap();
    assert_eq!(kind(p.set("list", &[3_i64, 4][..])), Kind::Range);

    p.declare("d", 0.0, Descriptor::new().double_range(0.0, 1.0, 0.1))
        .unwrap();
    for tenths in 0..=10_i32 {
        p.set("d", f64::from(tenths) * 0.1).unwrap();
    }
    for wrong in [-0.1, 1.1, 0.05, f64::NAN, f64::INFINITY] {
        assert_eq!(kind(p.set("d", wrong)), Kind::Range, "{wrong}");
    }
    // However many steps there are.
    let fine = Descriptor::new().double_range(0.0, 1000.0, 1e-6);
    p.declare("fine", 700.000_001, fine).unwrap();
    assert_eq!(kind(p.set("fine", 700.000_000_5)), Kind::Range);
    let around = Descriptor::new().double_range(-0.3, 1.0, 0.1);
    p.declare("around", 0.0, around).unwrap();
    p.set("around", 0.1 + 0.2).unwrap();
    assert_eq!(kind(p.set("around", 1e-9)), Kind::Range);
    let upside_down = Descriptor::new().integer_range(2, 1, 0);
    assert_eq!(kind(p.declare("k", 1, upside_down)), Kind::Range);

    p.declare("fixed", "a", Descriptor::new().read_only())
        .unwrap();
    assert_eq!(kind(p.set("fixed", "b")), Kind::ReadOnly);
    assert_eq!(kind(p.undeclare("fixed")), Kind::ReadOnly);
    p.declare("any", 1, Descriptor::new().dynamic_typing())
        .unwrap();
    p.set("any", "text").unwrap();
    assert_eq!(p.get::<String>("any").unwrap(), "text");
    p.set("any", ParameterValue::NotSet).unwrap();
    assert_eq!(kind(p.get::<String>("any")), Kind::Type);
    p.undeclare("any").unwrap();
    assert_eq!(kind(p.set("any", 1)), Kind::Unknown);
    assert_eq!(kind(p.declare("d", 0.0, Descriptor::new())), Kind::Exists);
}

#[test]
fn limits_are_errors_that_name_them_and_change_nothing() {
    let options = ParameterOptions::new()
        .parameters(2)
        .value_bytes(8)
        .name_bytes(4);
    let p = parameters(options);
    p.declare("text", "12345678", Descriptor::new()).unwrap();
    p.declare("b", true, Descriptor::new()).unwrap();
    let error = p.declare("c", true, Descriptor::new()).unwrap_err();
    assert_eq!(error.kind(), Kind::TooMany);
    assert!(error.reason().contains(" 2 parameters"), "{error}");
    let long = "x".repeat(100);
    let error = p.set("text", &*long).unwrap_err();
    assert_eq!(error.kind(), Kind::TooLarge);
    assert!(error.reason().contains("8 bytes"), "{error}");
    assert_eq!(p.get::<String>("text").unwrap(), "12345678");
    p.undeclare("b").unwrap();
    for wrong in ["", "12345"] {
        assert_eq!(kind(p.declare(wrong, true, Descriptor::new())), Kind::Name);
    }
    p.declare("1234", true, Descriptor::new()).unwrap();
    let node = node(&InProcessBus::new());
    for (options, field) in [
        (ParameterOptions::new().parameters(0), "parameters"),
        (ParameterOptions::new().name_bytes(256), "name_bytes"),
        (ParameterOptions::new().value_bytes(7), "value_bytes"),
        (ParameterOptions::new().max_size(511), "max_size"),
        (ParameterOptions::new().max_size(268_435_457), "max_size"),
    ] {
        let error = node.parameters(options).unwrap_err();
        assert!(matches!(error, Error::Parameter { field: f, .. } if f == field));
    }
}

#[test]
fn callbacks_refuse_all_or_hear_of_what_was_set() {
    let p = parameters(ParameterOptions::new());
    for name in ["a", "b"] {
        p.declare(name, 1, Descriptor::new()).unwrap();
    }
    let log = Arc::new(Mutex::new(Vec::new()));
    let (heard, inside, nested) = (Arc::clone(&log), p.clone(), p.clone());
    p.veto(move |change| {
        assert_eq!(kind(nested.set("a", 5)), Kind::Nested);
        assert_eq!(inside.get::<i64>("a").unwrap(), 1, "not in force yet");
        match change.new {
            ParameterValue::Integer(13) => Err("13 brings bad luck"),
            _ => Ok(()),
        }
    });
    let inside = p.clone();
    p.after_set(move |change| {
        let now: i64 = inside.get(change.name).unwrap();
        let line = format!("{}: {} to {} = {now}", change.name, change.old, change.new);
        heard.lock().unwrap().push(line);
    });
    let both = [("a", 2.into()), ("b", 13.into())];
    let error = p.set_atomically(&both).unwrap_err();
    assert_eq!(
        (error.kind(), error.reason()),
        (Kind::Refused, "b: 13 brings bad luck")
    );
    let mut values = [0_i64; 2];
    p.get_all(&["a", "b"], &mut values).unwrap();
    assert_eq!(values, [1, 1], "none of them");
    assert!(log.lock().unwrap().is_empty());
    p.set_atomically(&[("a", 2.into()), ("b", 3.into())])
        .unwrap();
    assert_eq!(*log.lock().unwrap(), ["a: 1 to 2 = 2", "b: 1 to 3 = 3"]);
}

/// The answer to a client in another context.
pub(crate) fn ask<S: Service>(
    bus: &InProcessBus,
    service: &str,
    request: &S::Request,
) -> S::Response
where
    S::Response: Clone,
{
    ask_of::<S>(bus, service, request, 16_000)
}

/// A question with messages of up to `size` bytes.
fn ask_of<S: Service>(
    bus: &InProcessBus,
    service: &str,
    request: &S::Request,
    size: usize,
) -> S::Response
where
    S::Response: Clone,
{
    let ctx = Context::new(bus.participant());
    let node = ctx.node("asker").unwrap();
    let name = format!("/robot/arm/{service}");
    let topic = Topic::named(&name).max_size(size);
    let client = node.client::<S>(topic, Qos::services(), LIMIT).unwrap();
    assert!(client.wait_for_server(LIMIT).unwrap());
    let answer = Arc::new(Mutex::new(None));
    let to = Arc::clone(&answer);
    let mut exec = Executor::new(&ctx);
    exec.worker("c")
        .replies(&client, move |reply, cx| {
            *to.lock().unwrap() = reply.ok().cloned();
            cx.stop();
        })
        .unwrap();
    let mut local = exec.local().unwrap();
    client.call(request).unwrap();
    assert_eq!(local.spin_for(LIMIT).end, SpinEnd::Stopped);
    let answer = answer.lock().unwrap().take();
    answer.expect("a reply in time")
}

/// 200 names do not fit into 4100 bytes: a client that asks for all of them gets no answer, and the
/// server's handle says why. With more room they are all there, also in a request as long.
#[test]
fn messages_beyond_the_limit_are_told_with_it_and_the_limit_can_be_raised() {
    let _dog = watchdog("long lists", LIMIT * 2);
    let many = ParameterOptions::new().parameters(200);
    for (options, fits) in [(many, false), (many.max_size(30_000), true)] {
        let bus = InProcessBus::new();
        let node = node(&bus);
        let p = node.parameters(options).unwrap();
        let names: Vec<String> = (0..200)
            .map(|n| format!("a.long.prefix.of.number.{n:03}"))
            .collect();
        for name in &names {
            p.declare(name, 0.5, Descriptor::new()).unwrap();
        }
        let (mut exec, _) = executor(node.context());
        exec.worker("parameters").parameters(&p).unwrap();
        let running = exec.start().unwrap();
        let failed = || {
            let report = running.report();
            let handle = report.handle("/robot/arm/srv:/robot/arm/list_parameters");
            handle.unwrap().last_error.clone()
        };
        if !fits {
            let ctx = Context::new(bus.participant());
            let asker = ctx.node("asker").unwrap();
            let name = "/robot/arm/list_parameters";
            let client = asker
                .client::<srv::ListParameters>(name, Qos::services(), LIMIT)
                .unwrap();
            let (mut exec, _) = executor(&ctx);
            exec.worker("c").replies(&client, |_, _| ()).unwrap();
            let _spins = exec.start().unwrap();
            client.call(&srv::ListParametersRequest::default()).unwrap();
            assert!(crate::common::eventually(|| failed().is_some()));
            let text = "the response takes more than max_size: 4100";
            assert_eq!(failed().as_deref(), Some(text));
            continue;
        }
        let all = srv::ListParametersRequest::default();
        let got = ask::<srv::ListParameters>(&bus, "list_parameters", &all);
        assert_eq!(got.result.names, names);
        let request = srv::GetParametersRequest { names };
        let got = ask_of::<srv::GetParameters>(&bus, "get_parameters", &request, 30_000);
        assert_eq!(got.values.len(), 200);
        assert_eq!(failed(), None);
    }
}

fn named(names: &[&str]) -> Vec<String> {
    names.iter().map(|n| (*n).to_owned()).collect()
}

pub(crate) fn double(name: &str, value: f64) -> Parameter {
    Parameter {
        name: name.into(),
        value: Sent {
            r#type: 3,
            double_value: value,
            ..Sent::default()
        },
    }
}

#[test]
fn others_get_set_describe_and_list_them() {
    let _dog = watchdog("parameter services", LIMIT * 2);
    let bus = InProcessBus::new();
    let node = node(&bus);
    let p = node.parameters(ParameterOptions::new()).unwrap();
    let gain = Descriptor::new()
        .description("loop gain")
        .double_range(0.0, 1.0, 0.0);
    p.declare("pid.inner.gain", 0.5, gain).unwrap();
    p.declare("pid.gain", 0.5, Descriptor::new()).unwrap();
    p.declare("name", "arm", Descriptor::new().read_only())
        .unwrap();
    let (mut exec, _) = executor(node.context());
    exec.worker("parameters").parameters(&p).unwrap();
    let running = exec.start().unwrap();

    let names = named(&["name", "none", "pid.gain"]);
    let got = ask::<srv::GetParameters>(
        &bus,
        "get_parameters",
        &srv::GetParametersRequest {
            names: names.clone(),
        },
    );
    let types: Vec<u8> = got.values.iter().map(|v| v.r#type).collect();
    assert_eq!(types, [4, 0, 3]);
    assert_eq!(
        (&*got.values[0].string_value, got.values[2].double_value),
        ("arm", 0.5)
    );
    let request = srv::GetParameterTypesRequest {
        names: names.clone(),
    };
    let got = ask::<srv::GetParameterTypes>(&bus, "get_parameter_types", &request);
    assert_eq!(got.types, [4, 0, 3]);

    // Each by itself: the good ones are set.
    let wishes = vec![
        double("pid.gain", 9.0),
        double("pid.inner.gain", 9.0),
        double("name", 1.0),
    ];
    let request = srv::SetParametersRequest {
        parameters: wishes.clone(),
    };
    let got = ask::<srv::SetParameters>(&bus, "set_parameters", &request);
    let outcome: Vec<_> = got
        .results
        .iter()
        .map(|r| (r.successful, &*r.reason))
        .collect();
    let range = "pid.inner.gain = 9: allowed are 0..=1 in steps of 0";
    assert_eq!(
        outcome,
        [(true, ""), (false, range), (false, "name: it is read-only")]
    );
    assert_eq!(p.get::<f64>("pid.gain").unwrap(), 9.0);
    // All or none: none.
    let wishes = vec![double("pid.gain", 1.0), double("pid.inner.gain", 9.0)];
    let request = srv::SetParametersAtomicallyRequest { parameters: wishes };
    let got = ask::<srv::SetParametersAtomically>(&bus, "set_parameters_atomically", &request);
    assert_eq!((got.result.successful, &*got.result.reason), (false, range));
    assert_eq!(p.get::<f64>("pid.gain").unwrap(), 9.0);
    let wishes = vec![double("pid.gain", 0.25), double("pid.inner.gain", 0.25)];
    let request = srv::SetParametersAtomicallyRequest { parameters: wishes };
    let got = ask::<srv::SetParametersAtomically>(&bus, "set_parameters_atomically", &request);
    assert!(got.result.successful);
    assert_eq!(p.get::<f64>("pid.inner.gain").unwrap(), 0.25);
    let odd = Parameter {
        value: Sent {
            r#type: 10,
            ..Sent::default()
        },
        ..double("name", 0.0)
    };
    let request = srv::SetParametersRequest {
        parameters: vec![odd],
    };
    let got = ask::<srv::SetParameters>(&bus, "set_parameters", &request);
    assert_eq!(
        got.results[0].reason,
        "name: the value is of type 10, allowed are 0..=9"
    );

    let request = srv::DescribeParametersRequest {
        names: named(&["pid.inner.gain", "name", "none"]),
    };
    let got = ask::<srv::DescribeParameters>(&bus, "describe_parameters", &request);
    let [gain, name, none] = &got.descriptors[..] else {
        panic!("{got:?}")
    };
    assert_eq!((gain.r#type, &*gain.description), (3, "loop gain"));
    assert_eq!(gain.floating_point_range[0].to_value, 1.0);
    assert!(name.read_only && !gain.read_only && name.integer_range.is_empty());
    assert_eq!((none.r#type, &*none.name), (0, "none"));

    let list = |prefixes: &[&str], depth| {
        let request = srv::ListParametersRequest {
            prefixes: named(prefixes),
            depth,
        };
        let got = ask::<srv::ListParameters>(&bus, "list_parameters", &request);
        (got.result.names.join(" "), got.result.prefixes.join(" "))
    };
    let text = |names: &str, prefixes: &str| (names.to_owned(), prefixes.to_owned());
    let all = text("pid.inner.gain pid.gain name", "pid.inner pid");
    assert_eq!(list(&[], 0), all);
    assert_eq!(list(&[], 1), text("name", ""));
    assert_eq!(list(&[], 2), text("pid.gain name", "pid"));
    assert_eq!(list(&["pid"], 1), text("pid.gain", "pid"));
    assert_eq!(
        list(&["pid"], 0),
        text("pid.inner.gain pid.gain", "pid.inner pid")
    );
    assert_eq!(
        list(&["pid.inner", "name"], 1),
        text("pid.inner.gain name", "pid.inner")
    );
    assert_eq!(list(&["pi"], 0), text("", ""));
    let report = running.stop();
    assert!(
        report.handles.iter().all(|h| h.stats.errors == 0),
        "{report}"
    );
    assert_eq!(report.handles.len(), 6);
}

#[test]
fn a_running_executor_takes_on_parameters_whole_or_not_at_all() {
    let _dog = watchdog("live parameters", LIMIT * 2);
    let bus = InProcessBus::new();
    let node = node(&bus);
    let p = node.parameters(ParameterOptions::new()).unwrap();
    p.declare("gain", 0.5, Descriptor::new()).unwrap();
    let mut exec = Executor::new(node.context());
    exec.no_ledger();
    exec.worker("few").capacity(5);
    exec.worker("enough").capacity(6);
    let running = exec.start().unwrap();
    let change = running.handle();
    let few = change.worker("few").unwrap().parameters(&p);
    assert!(matches!(
        few,
        Err(replenish::Error::Capacity { limit: 5, .. })
    ));
    let gone = || running.report().handles.is_empty();
    assert!(crate::common::eventually(gone), "{}", running.report());
    let ids = change.worker("enough").unwrap().parameters(&p).unwrap();
    assert_eq!(ids.len(), 6);
    let asker = Context::new(bus.participant()).node("asker").unwrap();
    let name = "/robot/arm/get_parameters";
    let client = asker
        .client::<replenish_interfaces::rcl_interfaces::srv::GetParameters>(
            name,
            Qos::services(),
            LIMIT,
        )
        .unwrap();
    assert!(client.wait_for_server(LIMIT).unwrap());
}

#[test]
fn changes_are_told_once_with_what_was_new_changed_and_deleted() {
    let _dog = watchdog("parameter events", LIMIT * 2);
    let bus = InProcessBus::new();
    let listener = Context::new(bus.participant());
    let seen = Arc::new(Mutex::new(Vec::new()));
    let to = Arc::clone(&seen);
    let mut exec = Executor::new(&listener);
    exec.worker("w")
        .subscribe(
            &listener.node("listener").unwrap(),
            "/parameter_events",
            Qos::parameter_events().keep_last(10),
            move |event: &ParameterEvent, _| {
                let lists = [
                    &event.new_parameters,
                    &event.changed_parameters,
                    &event.deleted_parameters,
                ];
                let names = lists.map(|l| {
                    l.iter()
                        .map(|p| p.name.clone())
                        .collect::<Vec<_>>()
                        .join(" ")
                });
                assert!(event.node == "/robot/arm" && event.stamp.sec > 0);
                to.lock().unwrap().push(names.join("|"));
            },
        )
        .unwrap();
    let mut local = exec.local().unwrap();
    let p = node(&bus)
        .parameters(ParameterOptions::new().allow_undeclared())
        .unwrap();
    p.declare("a", 1, Descriptor::new()).unwrap();
    p.set_atomically(&[("a", 2.into()), ("made", true.into())])
        .unwrap();
    p.set("a", "wrong").unwrap_err(); // nothing has changed, nothing is told
    p.set("made", ParameterValue::NotSet).unwrap();
    p.undeclare("a").unwrap();
    let heard = Arc::clone(&seen);
    local.spin_while(LIMIT, || heard.lock().unwrap().len() < 4);
    local.spin_some(Duration::from_millis(1));
    assert_eq!(*seen.lock().unwrap(), ["a||", "made|a|", "||made", "||a"]);
    let silent = node(&bus)
        .parameters(ParameterOptions::new().no_events())
        .unwrap();
    silent.declare("a", 1, Descriptor::new()).unwrap();
    assert_eq!(
        local.spin_some(Duration::from_millis(1)).end,
        SpinEnd::TimedOut
    );
}

/// It is asked from the next time on.
#[test]
fn a_callback_of_setting_gives_another_one() {
    let p = parameters(ParameterOptions::new());
    p.declare("a", 1, Descriptor::new()).unwrap();
    let inside = p.clone();
    let told = Arc::new(Mutex::new(Vec::new()));
    let tell = Arc::clone(&told);
    let mut given = false;
    p.veto(move |_| {
        if !std::mem::replace(&mut given, true) {
            let tell = Arc::clone(&tell);
            inside.after_set(move |change| tell.lock().unwrap().push(format!("{}", change.new)));
            inside.veto(|change| match change.new {
                ParameterValue::Integer(13) => Err("13 brings bad luck"),
                _ => Ok(()),
            });
        }
        Ok::<(), String>(())
    });
    p.set("a", 13).unwrap();
    assert_eq!(kind(p.set("a", 13)), Kind::Refused);
    p.set("a", 14).unwrap();
    assert_eq!(*told.lock().unwrap(), ["14"]);
}

/// A request that is longer than the service takes has no answer, but the handle's hook and an
/// event report it, and it is counted. The service goes on.
fn requests_too_long_are_told(server: &Context, asker: &Context) {
    let _dog = watchdog("long requests", LIMIT * 2);
    let node = server.node("robot/arm").unwrap();
    let few = ParameterOptions::new().max_size(512);
    let p = node.parameters(few).unwrap();
    let lifecycle = node.lifecycle().unwrap();
    let (mut exec, log) = executor(server);
    let (told, hook) = (Arc::new(Mutex::new(0)), Arc::default());
    let (note, last): (_, Arc<Mutex<String>>) = (Arc::clone(&told), Arc::clone(&hook));
    let handling = replenish::HandleOptions::new().on_error(move |event| {
        *note.lock().unwrap() += 1;
        *last.lock().unwrap() = event.to_string();
    });
    let worker = exec.worker("w").parameters(&p).unwrap();
    worker.options(handling).lifecycle(&lifecycle).unwrap();
    let serving = exec.start().unwrap();
    let asks = asker.node("asker").unwrap();
    let gets: Client<srv::GetParameters> = asks
        .client(
            Topic::named("/robot/arm/get_parameters").max_size(8000),
            Qos::services(),
            LIMIT,
        )
        .unwrap();
    let changes: Client<ChangeState> = asks
        .client(
            Topic::named("/robot/arm/change_state").max_size(12_000),
            Qos::services(),
            LIMIT,
        )
        .unwrap();
    let (mut exec, _) = executor(asker);
    let heard = Arc::new(Mutex::new(0));
    let count = Arc::clone(&heard);
    let worker = exec.worker("w").replies(&gets, move |reply, _| {
        assert!(reply.is_ok());
        *count.lock().unwrap() += 1;
    });
    worker.unwrap().replies(&changes, |_, _| ()).unwrap();
    let _asking = exec.start().unwrap();

    let get = |bytes: usize| srv::GetParametersRequest {
        names: vec!["x".repeat(bytes)],
    };
    gets.call(&get(600)).unwrap();
    let stats = |id| serving.stats(id).unwrap();
    let get_id = "/robot/arm/srv:/robot/arm/get_parameters";
    assert!(crate::common::eventually(|| stats(get_id).oversize == 1));
    // Length of the list, length of the text, text, NUL.
    let line = "get_parameters: sample of 609 bytes does not fit (1 times): see max_size";
    assert!(
        crate::common::eventually(|| log.has(line)),
        "{:?}",
        log.lines()
    );
    assert!(hook.lock().unwrap().contains(line));
    gets.call(&get(601)).unwrap();
    gets.call(&get(10)).unwrap();
    assert!(crate::common::eventually(|| *heard.lock().unwrap() == 1));
    assert_eq!(*told.lock().unwrap(), 2, "the hook hears of each");
    let seen = stats(get_id);
    assert_eq!(
        (seen.received, seen.executed, seen.oversize, seen.lost),
        (3, 1, 2, 0)
    );

    let mut change = ChangeStateRequest::default();
    change.transition.label = "x".repeat(9000);
    changes.call(&change).unwrap();
    assert!(crate::common::eventually(
        || log.has("change_state: sample of 90")
    ));
    assert_eq!(stats("/robot/arm/srv:/robot/arm/change_state").oversize, 1);
}

#[test]
fn requests_too_long_are_told_in_one_process() {
    let bus = InProcessBus::new();
    let contexts = [(); 2].map(|()| Context::new(bus.participant()));
    requests_too_long_are_told(&contexts[0], &contexts[1]);
}

#[cfg(feature = "xrce")]
#[test]
fn requests_too_long_are_told_through_the_agent() {
    let agent = crate::common::agent::TestAgent::start("127.0.0.1:0");
    requests_too_long_are_told(&agent.context(), &agent.context());
}
