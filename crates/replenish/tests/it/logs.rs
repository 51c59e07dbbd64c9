//! Loggers of nodes: order, levels, once and throttle, the console, lines that are lost.

use crate::common::{eventually, executor};
use replenish::args::{Environment, LogLevel, RosArgs};
use replenish::{Context, Qos, Topic, log_debug, log_error, log_info, log_warn};
use replenish_interfaces::rcl_interfaces::msg::{Log, LogView, LoggerLevel};
use replenish_interfaces::rcl_interfaces::srv::{
    GetLoggerLevels, GetLoggerLevelsRequest, SetLoggerLevels, SetLoggerLevelsRequest,
};
use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read};
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

/// A context of these arguments, without a console.
fn with(line: &str) -> Context {
    let line = format!("program --ros-args --disable-stdout-logs {line}");
    let args = line.split_whitespace().map(String::from);
    Context::in_process().with_args(RosArgs::parse(args, &Environment::default()).unwrap())
}

type Lines = Arc<Mutex<Vec<Log>>>;

/// The messages that come on `/rosout`, from now on.
fn heard(exec: &mut replenish::Executor, ctx: &Context) -> Lines {
    let lines = Lines::default();
    let sink = Arc::clone(&lines);
    let node = ctx.node("listener").unwrap();
    let topic = Topic::named("/rosout").max_size(1400);
    let qos = Qos::reliable().keep_last(1000).transient_local();
    exec.worker("listener")
        .subscribe_view::<Log, _, _>(&node, topic, qos, move |line: &LogView<'_>, _| {
            sink.lock().unwrap().push(Log {
                stamp: line.stamp,
                level: line.level,
                name: line.name.into(),
                msg: line.msg.into(),
                file: line.file.into(),
                function: line.function.into(),
                line: line.line,
            });
        })
        .unwrap();
    lines
}

fn texts(lines: &Lines) -> Vec<String> {
    let lines = lines.lock().unwrap();
    lines.iter().map(|line| line.msg.clone()).collect()
}

#[test]
fn lines_of_each_thread_come_in_order_and_say_where_they_are_from() {
    let ctx = with("");
    let (mut exec, _) = executor(&ctx);
    let lines = heard(&mut exec, &ctx);
    for id in 0..3 {
        let node = ctx.node(&format!("robot/arm{id}")).unwrap();
        let logger = node.logger();
        let mut n = 0;
        exec.worker(&format!("w{id}"))
            .timer(MS, move |_| {
                if n < 100 {
                    n += 1;
                    log_info!(logger, "{id} {n}");
                }
            })
            .unwrap();
    }
    let running = exec.start().unwrap();
    assert!(eventually(|| lines.lock().unwrap().len() == 300));
    drop(running.stop());
    let mut last = HashMap::new();
    for line in lines.lock().unwrap().iter() {
        let (id, n) = line.msg.split_once(' ').unwrap();
        let n: u32 = n.parse().unwrap();
        assert_eq!(last.insert(id.to_owned(), n).unwrap_or(0) + 1, n);
        assert_eq!(line.name, format!("robot.arm{id}"));
        assert_eq!(line.level, 20);
        assert!(line.stamp.sec > 0 && line.line > 0);
        assert!(line.file.ends_with("logs.rs"), "{}", line.file);
        assert_eq!(line.function, "it::logs");
    }
}

#[test]
fn once_and_throttle_hold_for_a_place_in_the_source() {
    let ctx = with("");
    let (mut exec, _) = executor(&ctx);
    let lines = heard(&mut exec, &ctx);
    let logger = ctx.node("n").unwrap().logger();
    let running = exec.start().unwrap();
    for n in 0..5 {
        log_info!(logger.once(), "once {n}");
        log_info!(logger.once(), "and once {n}");
        log_info!(logger.throttle(LIMIT * 60), "slow {n}");
        log_info!(&logger.throttle(Duration::ZERO), "fast {n}");
    }
    log_warn!(&logger, "end");
    assert!(eventually(|| texts(&lines).iter().any(|t| t == "end")));
    drop(running.stop());
    let mut expected = vec!["once 0".to_owned(), "and once 0".into(), "slow 0".into()];
    expected.extend((0..5).map(|n| format!("fast {n}")));
    expected.push("end".into());
    assert_eq!(texts(&lines), expected);
}

#[test]
fn a_level_comes_from_an_argument_a_call_or_a_service() {
    let ctx = with("--log-level warn --log-level n.deep:=debug");
    let (mut exec, _) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    let (logger, deep) = (node.logger(), node.logger().child("deep"));
    assert_eq!((logger.name(), deep.name()), ("n", "n.deep"));
    assert_eq!(deep.child("er").level(), LogLevel::Debug);
    assert_eq!(logger.level(), LogLevel::Warn);
    assert_eq!(ctx.node("other").unwrap().logger().level(), LogLevel::Warn);
    let mut evaluated = 0;
    let mut count = || {
        evaluated += 1;
        evaluated
    };
    log_debug!(logger, "{}", count());
    log_info!(logger, "{}", count());
    log_debug!(deep, "{}", count());
    log_error!(logger, "{}", count());
    assert_eq!(evaluated, 2);

    let qos = Qos::services();
    let sized = |name: &'static str| Topic::named(name).max_size(4096);
    let get = node
        .client::<GetLoggerLevels>(sized("~/get_logger_levels"), qos, LIMIT)
        .unwrap();
    let set = node
        .client::<SetLoggerLevels>(sized("~/set_logger_levels"), qos, LIMIT)
        .unwrap();
    let (got, done) = (Arc::new(Mutex::new(None)), Arc::new(Mutex::new(None)));
    let (got_sink, done_sink) = (Arc::clone(&got), Arc::clone(&done));
    exec.worker("levels").logger_levels(&node).unwrap();
    exec.worker("clients")
        .replies(&get, move |reply, _| {
            let levels = reply.unwrap().levels.iter().map(|l| l.level);
            *got_sink.lock().unwrap() = Some(levels.collect::<Vec<_>>());
        })
        .unwrap()
        .replies(&set, move |reply, _| {
            let results = reply.unwrap().results.iter();
            let results = results.map(|r| (r.successful, r.reason.clone()));
            *done_sink.lock().unwrap() = Some(results.collect::<Vec<_>>());
        })
        .unwrap();
    let running = exec.start().unwrap();
    let ask = || {
        *got.lock().unwrap() = None;
        let names = ["n", "n.deep", ""].map(String::from).to_vec();
        get.call(&GetLoggerLevelsRequest { names }).unwrap();
        assert!(eventually(|| got.lock().unwrap().is_some()));
        got.lock().unwrap().take().unwrap()
    };
    assert_eq!(ask(), [0, 10, 30]);
    let level = |name: &str, level| LoggerLevel {
        name: name.into(),
        level,
    };
    let levels = vec![level("n", 40), level("n.deep", 0), level("n", 7)];
    set.call(&SetLoggerLevelsRequest { levels }).unwrap();
    assert!(eventually(|| done.lock().unwrap().is_some()));
    let fine = (true, String::new());
    let wrong = "level: allowed are 0, 10, 20, 30, 40, 50".to_owned();
    assert_eq!(
        done.lock().unwrap().take().unwrap(),
        [fine.clone(), fine, (false, wrong)]
    );
    assert_eq!(ask(), [40, 0, 30]);
    assert_eq!(
        (logger.level(), deep.level()),
        (LogLevel::Error, LogLevel::Error)
    );
    assert!(logger.set_level(LogLevel::Debug));
    assert_eq!(deep.level(), LogLevel::Debug);
    drop(running.stop());
}

#[test]
fn without_rosout_nothing_is_published() {
    let ctx = with("--disable-rosout-logs");
    let (mut exec, _) = executor(&ctx);
    let lines = heard(&mut exec, &ctx);
    let logger = ctx.node("n").unwrap().logger();
    let running = exec.start().unwrap();
    log_info!(logger, "not heard");
    drop((running.stop(), logger, ctx)); // all lines are written then
    assert!(texts(&lines).is_empty());
}

/// The process of the tests below.
#[test]
#[ignore = "the process that other tests start"]
fn a_program_that_logs() {
    let line = std::env::var("TEST_ARGUMENTS").unwrap();
    let args = line.split_whitespace().map(String::from);
    let args = RosArgs::parse(args, &Environment::default()).unwrap();
    let ctx = Context::in_process().with_args(args);
    let logger = ctx.node("ns/n").unwrap().logger();
    for n in 0..std::env::var("TEST_LINES").unwrap().parse().unwrap() {
        log_warn!(logger, "{n} {:400}|", "");
    }
    log_debug!(logger, "for developers");
    println!("logged");
}

/// Starts it; nothing reads its standard error yet.
fn child(arguments: &str, lines: u32, variables: &[(&str, &str)]) -> std::process::Child {
    Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "logs::a_program_that_logs", "--ignored"])
        .arg("--nocapture")
        .env("TEST_ARGUMENTS", arguments)
        .env("TEST_LINES", lines.to_string())
        .envs(variables.iter().copied())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

#[test]
fn the_console_shows_lines_as_ros_does() {
    let stderr = |arguments: &str, variables: &[(&str, &str)]| {
        let output = child(arguments, 1, variables).wait_with_output().unwrap();
        assert!(output.status.success());
        String::from_utf8(output.stderr).unwrap()
    };
    let usual = stderr("p", &[]);
    let (level, rest) = usual.split_once("] [").unwrap();
    let (time, rest) = rest.split_once("] [").unwrap();
    let (seconds, nanos) = time.split_once('.').unwrap();
    assert_eq!((level, nanos.len()), ("[WARN", 9));
    assert!(seconds.parse::<u64>().unwrap() > 1_500_000_000);
    assert_eq!(rest, format!("ns.n]: 0 {:400}|\n", ""));

    let format = ("RCUTILS_CONSOLE_OUTPUT_FORMAT", "{severity} {name}");
    let colour = ("RCUTILS_COLORIZED_OUTPUT", "1");
    let debug = "p --ros-args --log-level debug";
    let both = "\x1b[33mWARN ns.n\x1b[0m\n\x1b[32mDEBUG ns.n\x1b[0m\n";
    assert_eq!(stderr(debug, &[format, colour]), both);
    assert_eq!(stderr(debug, &[format]), "WARN ns.n\nDEBUG ns.n\n");
    assert_eq!(stderr("p --ros-args --disable-stdout-logs", &[]), "");
}

#[test]
fn lines_too_many_are_counted_and_the_program_goes_on() {
    const LINES: u32 = 3000; // more than the queue and the pipe hold
    let mut child = child("p --ros-args --disable-rosout-logs", LINES, &[]);
    let mut stdout = BufReader::new(child.stdout.take().unwrap()).lines();
    while !stdout.next().unwrap().unwrap().ends_with("logged") {}
    let mut stderr = String::new();
    let mut pipe = child.stderr.take().unwrap();
    pipe.read_to_string(&mut stderr).unwrap();
    assert!(child.wait().unwrap().success());
    let (mut seen, mut lost, mut next) = (0, 0, 0);
    for line in stderr.lines() {
        let text = line.split_once("]: ").unwrap().1;
        let (number, rest) = text.split_once(' ').unwrap();
        let number: u32 = number.parse().unwrap();
        if rest == "lines are lost: 512 others waited to be written" {
            assert!(line.contains("[replenish.log]"));
            lost += number;
        } else {
            assert!(number >= next, "out of order");
            (seen, next) = (seen + 1, number + 1);
        }
    }
    assert!(lost > 0);
    assert_eq!(seen + lost, LINES);
}

/// Its lines fill the pipe that is not read: it ends all the same.
#[test]
fn a_console_that_nobody_reads_does_not_keep_a_program() {
    let mut child = child("p --ros-args --disable-rosout-logs", 3000, &[]);
    let mut stdout = BufReader::new(child.stdout.take().unwrap()).lines();
    while !stdout.next().unwrap().unwrap().ends_with("logged") {}
    let end = Instant::now() + LIMIT;
    let status = loop {
        match child.try_wait().unwrap() {
            None if Instant::now() < end => std::thread::sleep(10 * MS),
            status => break status,
        }
    };
    child.kill().ok();
    assert!(status.is_some_and(|status| status.success()), "{status:?}");
}

/// Lines of the `log` facade, which one context of a process has: no other test installs it.
#[test]
fn lines_of_a_library_have_the_name_and_the_level_of_their_target() {
    let levels = "--log-level n.noisy:=error --log-level n.deep.x:=debug";
    let ctx = with(levels);
    let (mut exec, _) = executor(&ctx);
    let lines = heard(&mut exec, &ctx);
    let logger = ctx.node("n").unwrap().logger();
    logger.install().unwrap();
    logger.install().unwrap(); // again: nothing changes
    let other = with("").node("other").unwrap().logger().install();
    assert_eq!(
        other.unwrap_err().to_string(),
        "logger other: install = set is not allowed: the first logger of the `log` facade: the \
         process has another one"
    );
    let running = exec.start().unwrap();
    replenish::log::info!(target: "serial::posix", "opened {}", 7);
    log::debug!(target: "serial::posix", "below");
    log::warn!(target: "noisy", "below its own");
    log::error!(target: "noisy::part", "broken");
    log::debug!(target: "deep::x", "own level");
    log::debug!(target: "deep", "below");
    log::info!("of this crate");
    // The thread that writes judges the levels: it is to have written what they are changed for.
    let heard = |text: &str| eventually(|| texts(&lines).iter().any(|t| t == text));
    assert!(heard("of this crate"));
    logger.set_level(LogLevel::Debug);
    log::trace!(target: "serial", "as debug");
    assert!(heard("as debug"));
    logger.set_level(LogLevel::Error);
    log::warn!(target: "serial", "below again");
    log::debug!(target: "deep::x", "end");
    assert!(heard("end"));
    drop(running.stop());
    let lines = lines.lock().unwrap();
    let told = lines.iter().map(|l| (l.level, &*l.name, &*l.msg));
    // Other tests of this process may use libraries that log.
    let told = told.filter(|(_, name, _)| !name.starts_with("n.rustdds"));
    let told: Vec<_> = told.collect();
    assert_eq!(
        told,
        [
            (20, "n.serial.posix", "opened 7"),
            (40, "n.noisy.part", "broken"),
            (10, "n.deep.x", "own level"),
            (20, "n.it.logs", "of this crate"),
            (10, "n.serial", "as debug"),
            (10, "n.deep.x", "end"),
        ]
    );
    assert!(lines.iter().all(|line| line.stamp.sec > 0));
}
