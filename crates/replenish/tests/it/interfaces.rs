//! Generated messages with unbounded fields through an executor: large ones, views of raw bytes,
//! publishing from a view, and errors that name the field.

use crate::common::{eventually, executor};
use replenish::msg::{CdrError, CdrReader, CdrWriter, Message, View};
use replenish::{
    ActionOptions, CallbackContext, Context, Error, GoalState, GoalUpdate, NewGoal, Qos, RawType,
    Topic,
};
use replenish_interfaces::example_interfaces::action::{
    Fibonacci, FibonacciFeedback, FibonacciGoal, FibonacciResult,
};
use replenish_interfaces::sensor_msgs::msg::{Image, ImageView, Imu};
use replenish_interfaces::std_msgs::msg::HeaderView;
use replenish_testkit::watchdog::watchdog;
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);

#[test]
fn an_image_goes_through_owned_and_as_a_view() {
    let _dog = watchdog("images", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _log) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    let qos = Qos::reliable();
    let size = 20_000;
    let out = node
        .publisher::<Image>(Topic::named("image").max_size(size), qos)
        .unwrap();
    let (owned, seen) = (Arc::new(Mutex::new(Vec::new())), Arc::new(Mutex::new(0)));
    let (to_owned, to_seen) = (Arc::clone(&owned), Arc::clone(&seen));
    let raw = RawType {
        max_size: size,
        ..RawType::of::<Image>()
    };
    exec.worker("w")
        .subscribe(
            &node,
            Topic::named("image").max_size(size),
            qos,
            move |image: &Image, _| to_owned.lock().unwrap().push(image.clone()),
        )
        .unwrap()
        .subscribe_raw(&node, "image", raw, qos, move |bytes, _| {
            let image = ImageView::from_payload(bytes).unwrap();
            assert_eq!((image.header.frame_id, image.encoding), ("camera", "mono8"));
            *to_seen.lock().unwrap() += image.data.len();
        })
        .unwrap();
    let running = exec.start().unwrap();
    let pixels = [7; 16_384];
    let view = ImageView {
        header: HeaderView {
            frame_id: "camera",
            ..Default::default()
        },
        encoding: "mono8",
        data: &pixels,
        ..Default::default()
    };
    out.publish_view(&view).unwrap();
    out.publish(&Image::from(view)).unwrap();
    assert!(eventually(|| *seen.lock().unwrap() == 2 * pixels.len()));
    assert!(eventually(|| owned.lock().unwrap().len() == 2));
    drop(running.stop());
    let owned = owned.lock().unwrap();
    assert_eq!(owned[0], owned[1]);
    assert_eq!(owned[0].data, pixels);
}

#[test]
fn sizes_out_of_range_are_refused_with_the_range() {
    let ctx = Context::in_process();
    let (mut exec, _log) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    let qos = Qos::reliable();
    for size in [0, 268_435_457] {
        let error = node
            .publisher::<Image>(Topic::named("image").max_size(size), qos)
            .unwrap_err();
        assert!(matches!(error, Error::Parameter { .. }), "{error}");
        assert!(error.to_string().contains("1..=268435456 bytes"), "{error}");
        let topic = Topic::named("image").max_size(size);
        let worker = exec.worker("w");
        let error = worker.subscribe(&node, topic, qos, |_: &Image, _| ());
        assert!(
            error
                .map(drop)
                .unwrap_err()
                .to_string()
                .contains("1..=268435456 bytes")
        );
    }
}

/// A message that claims to be an image and ends in its first string.
#[derive(Default)]
struct Cut;

impl Message for Cut {
    const TYPE_NAME: &'static str = Image::TYPE_NAME;
    const DDS_TYPE_NAME: &'static str = Image::DDS_TYPE_NAME;
    const MAX_SIZE: usize = 16;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.u64(0)?;
        w.u32(9)
    }

    fn decode(&mut self, _: &mut CdrReader<'_>) -> Result<(), CdrError> {
        Ok(())
    }
}

#[test]
fn a_sample_that_is_none_is_told_with_the_field() {
    let _dog = watchdog("cut image", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, log) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Cut>("image", Qos::reliable()).unwrap();
    exec.worker("w")
        .subscribe(&node, "image", Qos::reliable(), |_: &Image, _| ())
        .unwrap();
    let running = exec.start().unwrap();
    out.publish(&Cut).unwrap();
    let expected = "header.frame_id: needs 9 bytes, 0 left";
    assert!(eventually(|| log.has(expected)), "{:?}", log.lines());
    drop(running.stop());
}

/// A view of each message, in the bytes that came. Half a message is reported by field and counted.
#[test]
fn views_are_subscribed_to_and_what_is_none_is_counted() {
    let _dog = watchdog("views", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, log) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    let size = 60_000;
    let qos = Qos::reliable();
    let out = node
        .publisher::<Image>(Topic::named("image").max_size(size), qos)
        .unwrap();
    let seen = Arc::new(Mutex::new(Vec::new()));
    let (to, late) = (Arc::clone(&seen), Arc::clone(&seen));
    let topic = Topic::named("image").max_size(size);
    exec.worker("w")
        .capacity(2)
        .subscribe_view::<Image, _, _>(&node, topic, qos, move |image, cx| {
            assert!(cx.source_timestamp().is_some());
            let sum = image.data.iter().map(|b| u64::from(*b)).sum::<u64>();
            to.lock().unwrap().push((image.encoding.to_owned(), sum));
        })
        .unwrap();
    let running = exec.start().unwrap();
    let pixels = vec![3; 50_000];
    let image = ImageView {
        encoding: "mono8",
        data: &pixels,
        ..ImageView::default()
    };
    out.publish_view(&image).unwrap();
    assert!(eventually(|| seen.lock().unwrap().len() == 1));
    assert_eq!(seen.lock().unwrap()[0], ("mono8".into(), 150_000));

    let bytes = node.publisher::<Bytes>(Topic::named("image").max_size(64), qos);
    bytes.unwrap().publish(&Bytes).unwrap();
    let stats = || running.stats("/n/sub:/image").unwrap();
    assert!(eventually(|| stats().undecodable == 1));
    assert!(log.has("header.frame_id"), "{:?}", log.lines());
    let worker = running.handle();
    worker
        .worker("w")
        .unwrap()
        .subscribe_view::<Image, _, _>(&node, topic, qos, move |image, _| {
            late.lock().unwrap().push((image.encoding.to_owned(), 0));
        })
        .unwrap();
    assert!(eventually(|| {
        out.publish_view(&image).unwrap();
        seen.lock().unwrap().iter().any(|(_, sum)| *sum == 0)
    }));
    assert!(eventually(
        || stats().waiting == 0 && stats().received == stats().executed + 1
    ));
}

/// Not an image: its header's text ends too early.
#[derive(Default)]
struct Bytes;

impl Message for Bytes {
    const TYPE_NAME: &'static str = Image::TYPE_NAME;
    const DDS_TYPE_NAME: &'static str = Image::DDS_TYPE_NAME;
    const MAX_SIZE: usize = 64;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.bytes(&[0; 8])?;
        w.bytes(&[200, 0, 0, 0, b'x', 0])
    }

    fn decode(&mut self, _: &mut CdrReader<'_>) -> Result<(), CdrError> {
        Ok(())
    }
}

/// Requests and responses of any size, up to what both ends say.
struct Repeat;

impl replenish::msg::Service for Repeat {
    type Request = replenish_interfaces::std_msgs::msg::String;
    type Response = replenish_interfaces::std_msgs::msg::String;
    const TYPE_NAME: &'static str = "test_msgs/srv/Repeat";
}

#[test]
fn services_with_unbounded_fields_take_messages_of_the_size_asked_for() {
    let _dog = watchdog("large services", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let service = Topic::named("repeat").max_size(60_000);
    exec.worker("serve")
        .serve::<Repeat, _>(&node, service, Qos::services(), |request, response, _| {
            response.data.clone_from(&request.data);
        })
        .unwrap();
    let client = node
        .client::<Repeat>(service, Qos::services(), LIMIT)
        .unwrap();
    let got = Arc::new(Mutex::new(0));
    let to = Arc::clone(&got);
    exec.worker("hear")
        .replies(&client, move |reply, _| {
            *to.lock().unwrap() = reply.unwrap().data.len();
        })
        .unwrap();
    let _running = exec.start().unwrap();
    let request = |bytes| replenish_interfaces::std_msgs::msg::String {
        data: "x".repeat(bytes),
    };
    client.call(&request(50_000)).unwrap();
    assert!(eventually(|| *got.lock().unwrap() == 50_000));
    assert!(client.call(&request(60_001)).is_err());
    let none = node.client::<Repeat>(Topic::named("r").max_size(0), Qos::services(), LIMIT);
    let error = none.unwrap_err().to_string();
    assert_eq!(
        error,
        "service /r: max_size = 0 is not allowed: 1..=268435456 bytes"
    );
}

/// The type's names do not say whether it has unbounded fields.
#[test]
fn raw_samples_may_be_as_large_as_asked() {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let got = Arc::new(Mutex::new(0));
    let note = Arc::clone(&got);
    let topic = Topic::named("image").max_size(40_000);
    let ty = RawType::of::<Image>();
    let worker = exec.worker("w");
    let worker = worker.subscribe_raw(&node, topic, ty, Qos::reliable(), move |bytes, cx| {
        *note.lock().unwrap() = bytes.len();
        cx.stop();
    });
    worker.unwrap();
    let out = node.publisher::<Image>(Topic::named("image").max_size(40_000), Qos::reliable());
    let data = vec![0; 30_000];
    let image = ImageView {
        data: &data,
        ..Default::default()
    };
    out.unwrap().publish_view(&image).unwrap();
    exec.local().unwrap().spin_for(LIMIT);
    assert!(*got.lock().unwrap() > 30_000);
}

/// Goals, feedback and results of 50 kB, from both sides; without the option they are refused.
#[test]
fn actions_with_unbounded_fields_take_messages_of_the_size_asked_for() {
    let _dog = watchdog("large actions", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let options = ActionOptions::goals(2);
    let large = Topic::named("f").max_size(60_000);
    let sequence = vec![7; 12_500];
    let (feedback, result) = (sequence.clone(), sequence.clone());
    let serve = move |_: &FibonacciGoal, new: NewGoal<Fibonacci>, _: &CallbackContext<'_>| {
        let goal = new.accept()?;
        let sequence = feedback.clone();
        goal.feedback(&FibonacciFeedback { sequence })?;
        let sequence = result.clone();
        goal.succeed(&FibonacciResult { sequence })
    };
    exec.worker("s")
        .serve_action(&node, large, options, serve, |_, _| true)
        .unwrap();
    let client = node.action_client::<Fibonacci>(large, options).unwrap();
    let heard = Arc::new(Mutex::new((0, 0)));
    let note = Arc::clone(&heard);
    exec.worker("c")
        .follow(&client, move |_, update, _| match update {
            GoalUpdate::Feedback(f) => note.lock().unwrap().0 = f.sequence.len(),
            GoalUpdate::Result(GoalState::Succeeded, r) => {
                note.lock().unwrap().1 = r.sequence.len();
            }
            _ => (),
        })
        .unwrap();
    let _running = exec.start().unwrap();
    client.send(&FibonacciGoal { order: 1 }).unwrap();
    assert!(eventually(|| *heard.lock().unwrap() == (12_500, 12_500)));
    for size in [0, 268_435_457] {
        let none = node.action_client::<Fibonacci>(Topic::named("g").max_size(size), options);
        assert_eq!(
            none.unwrap_err().to_string(),
            format!("action /g: max_size = {size} is not allowed: 1..=268435456 bytes")
        );
    }
}

/// The error names the field, the message's length, the buffer's room, and the remedy, whichever
/// call encodes.
#[test]
fn a_message_longer_than_its_buffer_names_field_length_limit_and_remedy() {
    let _dog = watchdog("too long", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let qos = Qos::reliable();
    let text = |data: String| replenish_interfaces::std_msgs::msg::String { data };
    let says = |error: &dyn std::error::Error, field, (size, limit): (usize, usize), remedy| {
        let expected = format!(
            "field {field}: the message takes {size} bytes or more, its buffer has {limit}; {remedy} \
             makes room, for up to 268435456"
        );
        assert_eq!(error.to_string(), expected);
    };

    let data = [0; 4096];
    let view = |frame_id, data| ImageView {
        header: HeaderView {
            frame_id,
            ..HeaderView::default()
        },
        data,
        ..ImageView::default()
    };
    let out = node
        .publisher::<Image>(Topic::named("image").max_size(1000), qos)
        .unwrap();
    // Stamp, two empty texts, width, height, …: 48 bytes before the 4096.
    let image = view("", &data[..]);
    let mut whole = vec![0; 8192];
    let long = image.encode_to(&mut whole).unwrap();
    let error = out.publish_view(&image).unwrap_err();
    says(&error, "data", (long, 1000), "Topic::max_size");
    let name = "x".repeat(2000);
    let error = out.publish_view(&view(&name, &[])).unwrap_err();
    says(&error, "header", (12 + 2000, 1000), "Topic::max_size");

    let service = Topic::named("repeat").max_size(100);
    let client = node
        .client::<Repeat>(service, Qos::services(), LIMIT)
        .unwrap();
    let (mut exec, log) = executor(&ctx);
    exec.worker("w")
        .output_barrier(1, 10)
        .replies(&client, |_, _| ())
        .unwrap()
        .serve::<Repeat, _>(&node, service, Qos::services(), move |_, response, _| {
            response.data = "y".repeat(150);
        })
        .unwrap()
        .timer(Duration::from_millis(1), move |cx| {
            let error = cx.publish(&out, &Image::default()).unwrap_err();
            let barrier = "its buffer has 10; WorkerBuilder::output_barrier makes";
            assert!(error.to_string().contains(barrier), "{error}");
        })
        .unwrap();
    let running = exec.start().unwrap();
    let error = client.call(&text("x".repeat(200))).unwrap_err();
    says(&error, "data", (204, 100), "Topic::max_size");
    client.call(&text(String::new())).unwrap();
    assert!(eventually(|| log.has(
        "takes 154 bytes or more, its buffer has 100; Topic::max_size"
    )));
    assert!(eventually(
        || running.stats("w/timer:0").unwrap().executed > 0
    ));

    let options = ActionOptions::goals(1);
    let short = Topic::named("fib").max_size(100);
    let actions = node.action_client::<Fibonacci>(short, options).unwrap();
    let sequence = vec![1; 1000];
    let (mut exec, log) = executor(&ctx);
    drop(running);
    let serve = move |_: &FibonacciGoal, new: NewGoal<Fibonacci>, _: &CallbackContext<'_>| {
        let goal = new.accept()?;
        let sequence = sequence.clone();
        let error = goal
            .feedback(&FibonacciFeedback {
                sequence: sequence.clone(),
            })
            .unwrap_err();
        let text = "field feedback: the message takes 4020 bytes or more, its buffer has 100; Topic::max_size";
        assert!(error.to_string().contains(text), "{error}");
        goal.succeed(&FibonacciResult { sequence })
    };
    exec.worker("w")
        .serve_action(&node, short, options, serve, |_, _| true)
        .unwrap();
    exec.worker("follow")
        .follow(&actions, |_, _, _| ())
        .unwrap();
    let _running = exec.start().unwrap();
    actions.send(&FibonacciGoal::default()).unwrap();
    let failed =
        "field result: the message takes 4008 bytes or more, its buffer has 100; Topic::max_size";
    assert!(eventually(|| log.has(failed)), "{:?}", log.lines());
}

/// Types with unbounded fields ask for more than a datagram of micro-ROS holds.
#[cfg(feature = "xrce")]
#[test]
fn what_a_session_has_no_room_for_names_the_setting_and_its_range() {
    use replenish::middleware::xrce::{Xrce, XrceConfig};
    let agent = crate::common::agent::TestAgent::start("127.0.0.1:0");
    let node = agent.context().node("n").unwrap();
    let asked = Topic::named("image").max_size(501);
    let error = node
        .publisher::<Image>(asked, Qos::best_effort())
        .unwrap_err();
    let expected = "publisher /image: samples of up to 501 bytes do not fit, the limit is 500: of \
         best-effort ones it is XrceConfig::mtu - 12, with an mtu of 64..=65507; Topic::max_size \
         asks for shorter samples";
    assert_eq!(error.to_string(), expected);
    let (mut exec, _) = executor(node.context());
    let subscribed =
        exec.worker("w")
            .subscribe(&node, asked, Qos::best_effort(), |_: &Image, _| ());
    let error = subscribed.err().unwrap().to_string();
    assert_eq!(error, expected.replace("publisher /", "subscription /"));
    let reliable = node.publisher::<Image>(Topic::named("large").max_size(65_528), Qos::reliable());
    let error = reliable.unwrap_err().to_string();
    assert!(
        error.contains("of reliable ones it is XrceConfig::max_sample, 1..=16777216"),
        "{error}"
    );
    node.publisher::<Image>(Topic::named("image").max_size(500), Qos::best_effort())
        .unwrap();

    let config = XrceConfig {
        mtu: u16::try_from(Image::MAX_SIZE + 12).unwrap(),
        ..XrceConfig::default()
    };
    let wide = Context::new(Xrce::udp_with(&agent.address.to_string(), config).unwrap());
    let node = wide.node("n").unwrap();
    let whole = Topic::named("image").max_size(Image::MAX_SIZE);
    node.publisher::<Image>(whole, Qos::best_effort()).unwrap();
}

/// An `Imu` could be longer than a datagram; those that are sent are not.
#[test]
fn a_session_limits_what_is_sent_and_not_what_could_be() {
    let _dog = watchdog("Imu over the default session", LIMIT);
    let agent = crate::common::agent::TestAgent::start("127.0.0.1:0");
    let ctx = agent.context();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Imu>("imu", Qos::sensor_data()).unwrap();
    let heard = Arc::new(Mutex::new(Vec::new()));
    let sink = Arc::clone(&heard);
    let (mut exec, _) = executor(&ctx);
    exec.worker("w")
        .subscribe(&node, "imu", Qos::sensor_data(), move |m: &Imu, _| {
            sink.lock().unwrap().push(m.header.frame_id.clone());
        })
        .unwrap();
    let running = exec.start().unwrap();
    let mut imu = Imu::default();
    imu.header.frame_id = "imu_link".into();
    assert!(eventually(|| {
        out.publish(&imu).unwrap();
        heard.lock().unwrap().iter().any(|name| name == "imu_link")
    }));
    assert_eq!(out.too_long(), 0);
    imu.header.frame_id = "x".repeat(600);
    let error = out.publish(&imu).unwrap_err().to_string();
    let expected = "field header: the message takes 612 bytes or more, its buffer has 500; \
                    Topic::max_size makes room, for up to 268435456";
    assert_eq!(error, expected);
    assert_eq!(out.too_long(), 1);
    drop(running.stop());
}

/// The types of a service and an action have the names that rclrs gives them, too.
#[test]
fn parts_have_both_spellings() {
    use replenish::interfaces::example_interfaces::action::{Fibonacci_Goal, FibonacciGoal};
    use replenish::interfaces::std_srvs::srv::{SetBool_Request, SetBoolRequest};
    let request: SetBool_Request = SetBoolRequest { data: true };
    assert_eq!(request, SetBool_Request { data: true });
    let goal: FibonacciGoal = Fibonacci_Goal { order: 3 };
    assert_eq!(goal.order, 3);
}
