//! A replenish executor as ROS 2 sees it: a program of another library, `ros2-client` on RustDDS,
//! calls a service and an action of it and sets its parameters, through our agent and its bridge to
//! DDS, and without an agent.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]

#[allow(unreachable_pub, reason = "shared with other tests")]
#[path = "../../crates/replenish/tests/common/fibonacci.rs"]
mod fibonacci;

use fibonacci::{Fibonacci, Numbers, Order};
use replenish::middleware::rtps::{Rtps, RtpsConfig};
use replenish::msg::std_msgs::Int32;
use replenish::msg::{CdrError, CdrReader, CdrWriter, Message, Service};
use replenish::{
    ActionOptions, CallbackContext, Context, Descriptor, Executor, GoalError, GoalHandle, NewGoal,
    ParameterOptions, Parameters, Qos, RunningExecutor,
};
use replenish_agent::{Agent, AgentConfig, DdsBridge, RunningAgent};
use replenish_testkit::domain::domain;
use replenish_testkit::watchdog::watchdog;
use ros2_client::action::{ActionClient, ActionClientQosPolicies, GoalStatusEnum};
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::rcl_interfaces::{
    GetParametersRequest, GetParametersResponse, SetParametersRequest, SetParametersResponse,
};
use ros2_client::{
    ActionTypeName, Client, MessageTypeName, Name, NodeName, NodeOptions, Parameter,
    ParameterValue, Publisher, QosProfile, Server, ServiceMapping, ServiceTypeName, Subscription,
};
use rustdds::DomainParticipantBuilder;
use std::net::Ipv4Addr;
use std::time::{Duration, Instant};

const PATIENCE: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

/// `example_interfaces/srv/AddTwoInts`.
struct AddTwoInts;

impl Service for AddTwoInts {
    type Request = Ints;
    type Response = Sum;
    const TYPE_NAME: &'static str = "example_interfaces/srv/AddTwoInts";
}

#[derive(Default)]
struct Ints {
    a: i64,
    b: i64,
}

impl Message for Ints {
    const TYPE_NAME: &'static str = "example_interfaces/srv/AddTwoInts_Request";
    const DDS_TYPE_NAME: &'static str = "example_interfaces::srv::dds_::AddTwoInts_Request_";
    const MAX_SIZE: usize = 16;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.i64(self.a)?;
        w.i64(self.b)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        (self.a, self.b) = (r.i64()?, r.i64()?);
        Ok(())
    }
}

#[derive(Default)]
struct Sum {
    sum: i64,
}

impl Message for Sum {
    const TYPE_NAME: &'static str = "example_interfaces/srv/AddTwoInts_Response";
    const DDS_TYPE_NAME: &'static str = "example_interfaces::srv::dds_::AddTwoInts_Response_";
    const MAX_SIZE: usize = 8;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.i64(self.sum)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.sum = r.i64()?;
        Ok(())
    }
}

fn agent(domain: u16) -> RunningAgent {
    let config = AgentConfig {
        addr: (Ipv4Addr::LOCALHOST, 0).into(),
        dds: Some(DdsBridge {
            domain,
            ..DdsBridge::default()
        }),
        ..AgentConfig::default()
    };
    Agent::bind(&config).unwrap().spawn().unwrap()
}

/// An executor and what the program has to do with.
struct Ours {
    running: RunningExecutor,
    parameters: Parameters,
    client: replenish::Client<AddTwoInts>,
    answers: std::sync::Arc<std::sync::Mutex<Vec<i64>>>,
}

/// An executor with a service, an action whose goals a timer pursues, parameters, and a client.
fn executor(ctx: &Context) -> Ours {
    let node = ctx.node("ours").unwrap();
    let mut exec = Executor::new(ctx);
    exec.no_ledger();
    exec.worker("service")
        .serve::<AddTwoInts, _>(&node, "add", Qos::reliable(), |ints, answer, _| {
            answer.sum = ints.a + ints.b;
        })
        .unwrap();
    let goals: std::sync::Arc<std::sync::Mutex<Vec<Pursued>>> = std::sync::Arc::default();
    let begun = std::sync::Arc::clone(&goals);
    let goal = move |goal: &Order, new: NewGoal<Fibonacci>, _: &CallbackContext<'_>| {
        let Ok(order @ 2..=64) = usize::try_from(goal.order) else {
            return new.reject();
        };
        let pursued = (new.accept()?, order, Numbers::begin());
        begun.lock().unwrap().push(pursued);
        Ok::<(), GoalError>(())
    };
    exec.worker("action")
        .serve_action(&node, "fibonacci", ActionOptions::goals(8), goal, |_, _| {
            true
        })
        .unwrap()
        .timer(20 * MS, move |_| goals.lock().unwrap().retain_mut(step))
        .unwrap();
    let parameters = node.parameters(ParameterOptions::new()).unwrap();
    let gain = Descriptor::new().double_range(0.0, 10.0, 0.0);
    parameters.declare("gain", 1.0, gain).unwrap();
    let fixed = Descriptor::new().read_only();
    parameters.declare("axis", "x", fixed).unwrap();
    exec.worker("parameters").parameters(&parameters).unwrap();
    let client = node.client::<AddTwoInts>("theirs", Qos::services(), PATIENCE);
    let client = client.unwrap();
    let answers: std::sync::Arc<std::sync::Mutex<Vec<i64>>> = std::sync::Arc::default();
    let sink = std::sync::Arc::clone(&answers);
    exec.worker("client")
        .replies(&client, move |answer: Result<&Sum, _>, _| {
            // The first requests may be without an answer.
            sink.lock().unwrap().extend(answer.map(|answer| answer.sum));
        })
        .unwrap();
    for (kind, qos) in TOPICS {
        let qos = qos.keep_last(100);
        let back = node
            .publisher::<Int32>(&format!("{kind}_back"), qos)
            .unwrap();
        exec.worker(kind)
            .subscribe(&node, &format!("{kind}_there"), qos, move |n: &Int32, _| {
                back.publish(n)
            })
            .unwrap();
    }
    Ours {
        running: exec.start().unwrap(),
        parameters,
        client,
        answers,
    }
}

type Pursued = (GoalHandle<Fibonacci>, usize, Numbers);

/// One step of a goal; whether there are more.
fn step((goal, order, numbers): &mut Pursued) -> bool {
    if goal.is_canceling() {
        goal.canceled(numbers).unwrap();
        return false;
    }
    if numbers.sequence.len() < *order {
        numbers.grow();
        goal.feedback(numbers).unwrap();
        return true;
    }
    goal.succeed(numbers).unwrap();
    false
}

/// Asks again and again, for so long.
fn within<T>(time: Duration, mut ask: impl FnMut() -> Option<T>) -> Option<T> {
    let end = Instant::now() + time;
    loop {
        let answer = ask();
        if answer.is_some() || Instant::now() > end {
            return answer;
        }
        std::thread::sleep(2 * MS);
    }
}

fn eventually<T>(ask: impl FnMut() -> Option<T>) -> T {
    within(PATIENCE, ask).expect("in vain")
}

fn qos() -> QosProfile {
    QosProfile::subscription_default()
        .reliability_reliable(WhenFull::DEFAULT)
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth: 100 })
}

/// A node of the other library.
fn peer(domain: u16) -> (ros2_client::Context, ros2_client::Node) {
    let builder = DomainParticipantBuilder::new(domain).with_only_networks([Ipv4Addr::LOCALHOST]);
    let context = ros2_client::Context::from_domain_participant(builder.build().unwrap()).unwrap();
    let name = NodeName::new("/", "peer").unwrap();
    let node = context.new_node(name, NodeOptions::new()).unwrap();
    (context, node)
}

/// The request as the other library has it.
#[derive(Clone, serde::Serialize, serde::Deserialize)]
struct TheirInts {
    a: i64,
    b: i64,
}

impl ros2_client::Message for TheirInts {}

type TheirClient = ActionClient<i32, Vec<i32>, Vec<i32>>;

/// The names of two topics begin so, and they have this QoS.
const TOPICS: [(&str, Qos); 2] = [
    ("reliable", Qos::reliable()),
    ("best_effort", Qos::best_effort()),
];

/// `std_msgs/msg/Int32` as the other library has it.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
struct TheirInt32 {
    data: i32,
}

impl ros2_client::Message for TheirInt32 {}

/// A hundred numbers there, and each of them back, one after another.
fn topics(node: &mut ros2_client::Node) {
    for (kind, ours) in TOPICS {
        let theirs = if ours == Qos::reliable() {
            qos()
        } else {
            qos().reliability_best_effort()
        };
        let topic = |name: &str| {
            let name = Name::new("/", &format!("{kind}_{name}")).unwrap();
            let int32 = MessageTypeName::new("std_msgs", "Int32");
            node.create_topic(&name, int32, &theirs).unwrap()
        };
        let (there, back) = (topic("there"), topic("back"));
        let said: Publisher<TheirInt32> = node.create_publisher(&there, None).unwrap();
        let heard: Subscription<TheirInt32> = node.create_subscription(&back, None).unwrap();
        let echo = |data, time| {
            said.publish(TheirInt32 { data }).unwrap();
            within(time, || {
                let taken = heard.take().unwrap()?.0.data;
                (taken >= 0 || data < 0).then_some(taken)
            })
        };
        eventually(|| echo(-1, 200 * MS));
        for data in 0..100 {
            assert_eq!(echo(data, PATIENCE), Some(data), "{kind}");
        }
    }
}

/// Calls the service until the two have found each other, and then counts.
fn service(node: &mut ros2_client::Node) {
    let kind = ServiceTypeName::new("example_interfaces", "AddTwoInts");
    let name = Name::new("/", "add").unwrap();
    let client: Client<TheirInts, i64> = node
        .create_client(ServiceMapping::Enhanced, &name, &kind, qos(), qos())
        .unwrap();
    let call = |a, b, time| {
        let id = client.send_request(TheirInts { a, b }).unwrap();
        let answer = || client.receive_response().unwrap().filter(|(i, _)| *i == id);
        within(time, answer).map(|(_, sum)| sum)
    };
    eventually(|| call(1, 1, 200 * MS));
    for n in 0..20 {
        assert_eq!(call(n, 100, PATIENCE), Some(n + 100));
    }
}

/// Answers our client's requests: one after another, once they have found each other.
fn asked(node: &mut ros2_client::Node, ours: &Ours) {
    let kind = ServiceTypeName::new("example_interfaces", "AddTwoInts");
    let name = Name::new("/", "theirs").unwrap();
    let server: Server<TheirInts, i64> = node
        .create_server(ServiceMapping::Enhanced, &name, &kind, qos(), qos())
        .unwrap();
    let call = |a, time| {
        ours.client.call(&Ints { a, b: 100 }).unwrap();
        within(time, || {
            while let Some((id, ask)) = server.receive_request().unwrap() {
                server.send_response(id, ask.a + ask.b).unwrap();
            }
            let answers = ours.answers.lock().unwrap();
            answers.contains(&(a + 100)).then_some(())
        })
    };
    eventually(|| call(-1, 200 * MS));
    for number in 0..20 {
        call(number, PATIENCE).expect("an answer");
    }
    let mut answers = ours.answers.lock().unwrap().clone();
    answers.retain(|answer| *answer >= 100);
    assert_eq!(answers, (100..120).collect::<Vec<_>>());
}

/// The messages about a goal from its beginning to its end: feedback, status and result.
type Story = (Vec<Vec<i32>>, GoalStatusEnum, Vec<i32>);

/// Sends a goal, cancels it after `cancel_after` messages of feedback, and listens to its end.
fn pursue(client: &TheirClient, order: i32, cancel_after: usize, time: Duration) -> Option<Story> {
    let (asked, goal) = client.send_goal(order).unwrap();
    let answer = within(time, || client.receive_goal_response(asked).unwrap())?;
    assert!(answer.accepted);
    let asked = client.request_result(goal).unwrap();
    let mut heard = Vec::new();
    let (status, result) = within(time, || {
        while let Some(feedback) = client.receive_feedback(goal).unwrap() {
            heard.push(feedback);
            if heard.len() == cancel_after {
                client.cancel_goal(goal).unwrap();
            }
        }
        client.receive_result(asked).unwrap()
    })?;
    // Feedback has a way of its own, and may be behind. A goal that is canceled may have no more.
    let behind = if cancel_after == 0 { time } else { 200 * MS };
    within(behind, || {
        heard.extend(client.receive_feedback(goal).unwrap());
        (heard.last() == Some(&result)).then_some(())
    });
    Some((heard, status, result))
}

fn action(node: &mut ros2_client::Node) {
    let policies = ActionClientQosPolicies {
        goal_service: qos(),
        result_service: qos(),
        cancel_service: qos(),
        feedback_subscription: qos(),
        status_subscription: qos().durability(Durability::TransientLocal),
    };
    let name = Name::new("/", "fibonacci").unwrap();
    let kind = ActionTypeName::new("example_interfaces", "Fibonacci");
    let client: TheirClient = node
        .create_action_client(ServiceMapping::Enhanced, &name, &kind, policies)
        .unwrap();
    // Until all five parts have found each other: a goal with feedback that could be canceled.
    eventually(|| {
        let (heard, status, _) = pursue(&client, 30, 1, Duration::from_secs(1))?;
        (!heard.is_empty() && status == GoalStatusEnum::Canceled).then_some(())
    });
    eventually(|| client.receive_status().unwrap());

    let numbers = |n: usize| Numbers::of(n).sequence.to_vec();
    let (heard, status, result) = pursue(&client, 10, 0, PATIENCE).unwrap();
    assert_eq!((status, result), (GoalStatusEnum::Succeeded, numbers(10)));
    let all: Vec<_> = (3..=10).map(numbers).collect();
    assert_eq!(heard, all);

    let (heard, status, result) = pursue(&client, 60, 3, PATIENCE).unwrap();
    assert_eq!(status, GoalStatusEnum::Canceled);
    assert_eq!(result, numbers(result.len()), "as far as it had come");
    assert!((5..60).contains(&result.len()) && heard.len() >= 3);

    let (asked, _) = client.send_goal(-1).unwrap();
    let answer = eventually(|| client.receive_goal_response(asked).unwrap());
    assert!(!answer.accepted);
    let mut states = Vec::new();
    while let Some(all) = client.receive_status().unwrap() {
        states.extend(all.status_list.into_iter().map(|s| s.status));
    }
    let has = |state| states.contains(&state);
    assert!(has(GoalStatusEnum::Executing) && has(GoalStatusEnum::Succeeded));
}

/// Sets and reads parameters as `ros2 param` does.
fn parameters(node: &mut ros2_client::Node, ours: &Parameters) {
    let name = |service| Name::new("/ours", service).unwrap();
    let kind = |service| ServiceTypeName::new("rcl_interfaces", service);
    let mapping = ServiceMapping::Enhanced;
    let set: Client<SetParametersRequest, SetParametersResponse> = node
        .create_client(
            mapping,
            &name("set_parameters"),
            &kind("SetParameters"),
            qos(),
            qos(),
        )
        .unwrap();
    let get: Client<GetParametersRequest, GetParametersResponse> = node
        .create_client(
            mapping,
            &name("get_parameters"),
            &kind("GetParameters"),
            qos(),
            qos(),
        )
        .unwrap();
    let read = |time| {
        let names = vec!["gain".into(), "axis".into()];
        let id = get.send_request(GetParametersRequest { names }).unwrap();
        let answer = || get.receive_response().unwrap().filter(|(i, _)| *i == id);
        let (_, answer) = within(time, answer)?;
        Some(
            answer
                .values
                .into_iter()
                .map(ParameterValue::from)
                .collect::<Vec<_>>(),
        )
    };
    let write = |name: &str, value, time| {
        let name = name.into();
        let parameter = vec![Parameter { name, value }.into()];
        let id = set
            .send_request(SetParametersRequest { parameter })
            .unwrap();
        let answer = || set.receive_response().unwrap().filter(|(i, _)| *i == id);
        let (_, answer) = within(time, answer)?;
        let result = answer.results.into_iter().next().unwrap();
        Some((result.successful, result.reason))
    };
    let before = eventually(|| read(200 * MS));
    let text = |text: &str| ParameterValue::String(text.into());
    assert_eq!(before, [ParameterValue::Double(1.0), text("x")]);
    eventually(|| write("gain", ParameterValue::Double(1.0), 200 * MS));
    let set = |name, value| write(name, value, PATIENCE).unwrap();
    assert_eq!(
        set("gain", ParameterValue::Double(2.5)),
        (true, String::new())
    );
    assert_eq!(ours.get::<f64>("gain").unwrap(), 2.5);
    let (done, why) = set("gain", ParameterValue::Double(11.0));
    assert!(!done && why.contains("0..=10"), "{why}");
    let (done, why) = set("axis", text("y"));
    assert!(!done && why.contains("read-only"), "{why}");
    assert!(!set("gain", text("much")).0);
    assert_eq!(
        read(PATIENCE).unwrap(),
        [ParameterValue::Double(2.5), text("x")]
    );
}

/// The program asks for everything that an executor in this context has.
fn everything(ctx: &Context, domain: u16) {
    let ours = executor(ctx);
    let (_context, mut node) = peer(domain);
    topics(&mut node);
    service(&mut node);
    asked(&mut node, &ours);
    action(&mut node);
    parameters(&mut node, &ours.parameters);
    let report = ours.running.stop();
    assert!(
        report.handles.iter().all(|h| h.stats.errors == 0),
        "{report}"
    );
}

#[test]
fn a_program_in_ros_2_calls_a_service_and_an_action_and_sets_a_parameter_of_an_executor() {
    let _dog = watchdog("ros2-client", 4 * PATIENCE);
    let domain = domain();
    let agent = agent(domain);
    let ctx = Context::xrce_udp(&agent.local_addr().to_string()).unwrap();
    everything(&ctx, domain);
}

#[test]
fn the_same_without_an_agent() {
    let _dog = watchdog("ros2-client", 4 * PATIENCE);
    let domain = domain();
    let config = RtpsConfig {
        domain,
        // RustDDS finds others by multicast alone.
        interfaces: vec![Ipv4Addr::LOCALHOST],
        ..RtpsConfig::default()
    };
    everything(&Context::new(Rtps::open(&config).unwrap()), domain);
}
