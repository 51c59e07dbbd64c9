//! A program behaves as a ROS 2 program does: arguments rename and set, Ctrl-C ends it in order,
//! errors are sentences. As real processes where it is about processes.

use crate::common::{Echo, eventually, executor};
use crate::examples::program;
use replenish::args::{Environment, RosArgs};
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::msg::std_msgs::{BoundedString, Int32};
use replenish::{
    Context, Descriptor, Error, ParameterErrorKind, ParameterOptions, ParameterValue, Qos,
};
use replenish_testkit::domain::domain;
use replenish_testkit::program::{Running, Scratch, stderr};
use std::os::unix::process::ExitStatusExt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

type Text = BoundedString;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

/// Starts a program with variables, `NAME=value` in front of it, and arguments.
fn started(program: &str, variables: &[&str], args: &[&str]) -> Running {
    let usual = ["REPLENISH_AGENT=in-process", "REPLENISH_LEDGER=off"];
    let all = [&usual[..], variables, &[program], args].concat();
    Running::start("/usr/bin/env", &all)
}

fn talker(args: &[&str]) -> Running {
    started(program("talker").to_str().unwrap(), &[], args)
}

/// The standard error of a talker whose `main` returns an error.
fn refused(variables: &[(&str, &str)], args: &[&str]) -> String {
    let output = std::process::Command::new(program("talker"))
        .args(args)
        .env("REPLENISH_AGENT", "in-process")
        .envs(variables.iter().copied())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    stderr(&output)
}

#[test]
fn arguments_rename_and_set_and_a_signal_ends_in_order() {
    let scratch = Scratch::new("ros-program");
    let file = scratch.path("robot.yaml");
    let yaml = "/robot/*:\n  ros__parameters: {period_ms: 5}\n/**/other:\n  ros__parameters: {period_ms: 9000}\n";
    std::fs::write(&file, yaml).unwrap();
    for signal in ["INT", "TERM"] {
        let mut talker = talker(&[
            "mine",
            "--ros-args",
            "-r",
            "__node:=speaker",
            "-r",
            "__ns:=/robot",
            "-r",
            "speaker:chatter:=/news",
            "--params-file",
            file.to_str().unwrap(),
        ]);
        talker.expect_line("/robot/speaker talks on /news", LIMIT);
        talker.expect_line("heard Hello World: 3", LIMIT);
        talker.signal(signal);
        talker.signal(signal); // of a launcher: the same Ctrl-C
        // The report that the program prints of its own accord, and the code of a main that ends.
        talker.expect_line("/robot/speaker/sub:/news", LIMIT);
        assert_eq!(talker.end(LIMIT).code(), Some(0), "{signal}");
    }
}

#[test]
fn errors_of_a_main_are_sentences() {
    assert_eq!(
        refused(&[], &["--ros-args", "-r", "chatter"]),
        "Error: argument 3, chatter: a rule is from:=to\n"
    );
    assert_eq!(
        refused(&[], &["--ros-args", "-p", "period_ms:=fast"]),
        "Error: period_ms: argument 3 says string, its type is integer\n"
    );
    assert_eq!(
        refused(&[], &["--ros-args", "-p", "period_ms:=0"]),
        "Error: period_ms = 0: allowed are 1..=10000 in steps of 1\n"
    );
    assert_eq!(
        refused(&[("ROS_DOMAIN_ID", "300")], &[]),
        "Error: ROS_DOMAIN_ID, 300: allowed is 0 to 232\n"
    );
    assert_eq!(
        refused(&[("REPLENISH_AGENT", "localhost")], &[]),
        "Error: REPLENISH_AGENT, localhost: allowed is udp://HOST:PORT, tcp://HOST:PORT, \
         serial://PATH@BAUD, ros2 or in-process\n"
    );
}

/// Another participant of the domain hears the program: it is in ROS 2 itself.
#[test]
fn a_program_joins_ros_2_without_an_agent() {
    let domain = domain();
    let variables = [
        "REPLENISH_AGENT=ros2",
        "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST",
        &format!("ROS_DOMAIN_ID={domain}"),
    ];
    let args = ["--ros-args", "-r", "chatter:=/news", "-p", "period_ms:=5"];
    let mut talker = started(program("talker").to_str().unwrap(), &variables, &args);
    let config = RtpsConfig {
        domain,
        range: DiscoveryRange::Localhost,
        interfaces: vec![std::net::Ipv4Addr::LOCALHOST],
        ..RtpsConfig::default()
    };
    let ctx = Context::new(Rtps::open(&config).unwrap());
    let node = ctx.node("listener").unwrap();
    let heard = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&heard);
    let (mut exec, _) = executor(&ctx);
    exec.worker("w")
        .subscribe(&node, "/news", Qos::reliable(), move |text: &Text, _| {
            assert!(text.data.starts_with("Hello World: "));
            count.fetch_add(1, Ordering::SeqCst);
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| heard.load(Ordering::SeqCst) > 20));
    talker.signal("INT");
    talker.expect_line("/talker/sub:/news", LIMIT);
    assert_eq!(talker.end(LIMIT).code(), Some(0));
    drop(running.stop());
}

/// The process of the next test: a callback that goes on after the first signal.
#[test]
#[ignore = "the process that the test below starts"]
fn a_callback_that_does_not_end() {
    let ctx = Context::in_process();
    ctx.stop_on_signals().unwrap();
    let (mut exec, _) = executor(&ctx);
    exec.stop_grace(LIMIT * 10);
    exec.worker("w")
        .timer(MS, move |_| {
            println!("runs");
            while ctx.ok() {
                std::thread::sleep(MS);
            }
            println!("was asked");
            std::thread::sleep(LIMIT * 10);
        })
        .unwrap();
    exec.spin().unwrap();
}

#[test]
fn a_second_signal_ends_at_once() {
    let this = std::env::current_exe().unwrap();
    let test = "ros_program::a_callback_that_does_not_end";
    for (signal, number) in [("INT", 2), ("TERM", 15)] {
        let args = ["--exact", test, "--ignored", "--nocapture"];
        let mut child = started(this.to_str().unwrap(), &[], &args);
        child.expect_line("runs", LIMIT);
        child.signal(signal);
        child.expect_line("was asked", LIMIT);
        std::thread::sleep(MS * 1000); // by then it is another Ctrl-C
        child.signal(signal);
        assert_eq!(child.end(LIMIT).signal(), Some(number));
    }
}

/// A context of these arguments.
fn with(line: &str) -> Context {
    let args = ["program"].into_iter().chain(line.split_whitespace());
    let args = RosArgs::parse(args.map(String::from), &Environment::default()).unwrap();
    Context::in_process().with_args(args)
}

#[test]
fn topics_services_and_actions_are_renamed() {
    let ctx = with(
        "--ros-args -r in:=/a/in -r rosservice://echo:=/a/echo -r rostopic://echo:=/a/topic \
         -r fib:=/a/fib -r n:out:={node}/out",
    );
    let node = ctx.node("n").unwrap();
    assert_eq!(
        node.publisher::<Int32>("out", Qos::reliable())
            .unwrap()
            .topic(),
        "/n/out"
    );
    let echo = node.publisher::<Int32>("echo", Qos::reliable()).unwrap();
    assert_eq!(echo.topic(), "/a/topic");
    let sum = Arc::new(AtomicU64::new(0));
    let (mut exec, _) = executor(&ctx);
    let seen = Arc::clone(&sum);
    exec.worker("w")
        .subscribe(&node, "in", Qos::reliable(), |_: &Int32, _| ())
        .unwrap()
        .serve::<Echo, _>(&node, "echo", Qos::services(), move |request, reply, _| {
            *reply = *request;
            seen.fetch_add(1, Ordering::SeqCst);
        })
        .unwrap();
    // By the new name, which the rules leave alone.
    let client = node
        .client::<Echo>("/a/echo", Qos::services(), LIMIT)
        .unwrap();
    exec.worker("c").replies(&client, |_, _| ()).unwrap();
    let running = exec.start().unwrap();
    assert!(running.stats("/n/sub:/a/in").is_some());
    assert!(running.stats("/n/srv:/a/echo").is_some());
    client.call(&Int32::default()).unwrap();
    assert!(eventually(|| sum.load(Ordering::SeqCst) == 1));
}

#[test]
fn values_from_outside_come_first_if_their_type_fits() {
    let ctx = with(
        "--ros-args -p a:=1.5 -p b:=[1,2] -p c:=[left,right] -p d:=[] -p e:=3 -p other:f:=1 -p g:=true -p h:=s",
    );
    let node = ctx.node("n").unwrap();
    let parameters = node.parameters(ParameterOptions::new()).unwrap();
    let plain = Descriptor::new;
    let declare = |name, value: ParameterValue<'_>| parameters.declare(name, value, plain());
    declare("a", 0.0.into()).unwrap();
    declare("b", (&[0_i64][..]).into()).unwrap();
    declare("c", (&["z"][..]).into()).unwrap();
    declare("d", (&[1.0][..]).into()).unwrap();
    declare("f", 0_i64.into()).unwrap();
    declare("g", ParameterValue::NotSet).unwrap();
    assert_eq!(parameters.get::<f64>("a").unwrap(), 1.5);
    assert_eq!(parameters.get::<Vec<i64>>("b").unwrap(), [1, 2]);
    assert_eq!(
        parameters.get::<Vec<String>>("c").unwrap(),
        ["left", "right"]
    );
    assert_eq!(parameters.get::<Vec<f64>>("d").unwrap(), [0.0; 0]);
    assert_eq!(parameters.get::<i64>("f").unwrap(), 0, "of another node");
    assert!(parameters.get::<bool>("g").unwrap());
    let wrong = declare("e", 0.5.into()).unwrap_err();
    assert_eq!(wrong.kind(), ParameterErrorKind::Type);
    assert!(parameters.get::<f64>("e").is_err(), "it is not declared");
    parameters
        .declare("h", 1_i64, plain().dynamic_typing())
        .unwrap();
    assert_eq!(parameters.get::<String>("h").unwrap(), "s");
    // Set later, it is the program's again.
    parameters.set("a", 2.5).unwrap();
    assert_eq!(parameters.get::<f64>("a").unwrap(), 2.5);
}

#[test]
fn names_from_outside_are_names() {
    let node = with("--ros-args -r __ns:=/x").node("/a/n").unwrap();
    assert_eq!(node.name(), "/x/n");
    let long = format!("--ros-args -r t:=/{}", "a".repeat(300));
    let node = with(&long).node("n").unwrap();
    let error = node.publisher::<Int32>("t", Qos::reliable()).unwrap_err();
    assert!(matches!(error, Error::Name(_)), "{error}");
    let error = node.publisher::<Int32>("{robot}/t", Qos::reliable());
    assert_eq!(
        error.unwrap_err().to_string(),
        "name, {robot}/t: {robot} is not known: {node}, {ns} and {namespace} are"
    );
}
