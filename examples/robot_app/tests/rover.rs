//! The rover answers, reports, and does not start with a camera that asks for too much.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::float_cmp,
    reason = "test code"
)]

use replenish::{Context, Every, Executor, GoalState, GoalUpdate, Qos};
use robot_app::rover_msgs::action::{Drive, DriveGoal};
use robot_app::rover_msgs::{msg::Health, srv::SelfTest, srv::SelfTestRequest};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

/// A file of this package.
fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

/// A ledger that no other program of the host uses.
fn ledger(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("replenish-rover-{name}-{}", std::process::id()))
}

fn start(name: &str, overlay: Option<&Path>) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_robot-app"));
    command
        .args(["--ros-args", "-p", "gain:=0.8"])
        .env("REPLENISH_AGENT", "in-process")
        .env("REPLENISH_LEDGER", ledger(name))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    if let Some(path) = overlay {
        command.env("REPLENISH_OVERLAY", path);
    }
    command.spawn().unwrap()
}

fn end(child: Child, name: &str) -> (Output, String) {
    let output = child.wait_with_output().unwrap();
    std::fs::remove_dir_all(ledger(name)).ok();
    let text = [&*output.stdout, &*output.stderr].concat();
    (output, String::from_utf8(text).unwrap())
}

#[test]
fn others_test_it_and_drive_it() {
    let ctx = Context::in_process();
    let mut exec = Executor::new(&ctx);
    exec.no_ledger();
    robot_app::rover(&ctx, &mut exec).unwrap();

    let other = ctx.node("operator").unwrap();
    let test = other
        .client::<SelfTest>("self_test", Qos::services(), 5000 * MS)
        .unwrap();
    let drives = other
        .action_client::<Drive>("drive", replenish::ActionOptions::goals(1))
        .unwrap();
    let heard = Arc::new(Mutex::new(Vec::new()));
    let (feedback, result) = (heard.clone(), heard.clone());
    let (tested, healthy) = (heard.clone(), heard.clone());
    let (asks, goal) = (test.clone(), drives.clone());
    exec.worker("operator")
        .replies(&test, move |reply, _| {
            let reply = reply.unwrap();
            tested
                .lock()
                .unwrap()
                .push(format!("self-test: {}", reply.ok));
        })
        .unwrap()
        .subscribe(
            &other,
            "health",
            Qos::latched(),
            move |health: &Health, cx| {
                if health.frames > 0 && health.yaw_rate == -0.1 {
                    healthy.lock().unwrap().push("healthy".to_owned());
                    asks.call(&SelfTestRequest::default()).unwrap();
                }
                let heard = healthy.lock().unwrap();
                if heard.iter().any(|line| line == "self-test: true")
                    && heard.iter().any(|line| line.starts_with("driven"))
                {
                    cx.stop();
                }
            },
        )
        .unwrap()
        .follow(&drives, move |_, update, _| match update {
            GoalUpdate::Feedback(f) => feedback.lock().unwrap().push(format!("at {:.1}", f.so_far)),
            GoalUpdate::Result(GoalState::Succeeded, r) => {
                result
                    .lock()
                    .unwrap()
                    .push(format!("driven {:.1}", r.driven));
            }
            _ => (),
        })
        .unwrap()
        .timer(Every::once(10 * MS), move |_| {
            goal.send(&DriveGoal { distance: 0.3 }).map(drop)
        })
        .unwrap();
    let running = exec.start().unwrap();
    running.wait();

    let heard = heard.lock().unwrap();
    let drive: Vec<_> = heard
        .iter()
        .filter(|line| line.starts_with("at") || line.starts_with("driven"))
        .collect();
    assert_eq!(drive, ["at 0.1", "at 0.2", "at 0.3", "driven 0.3"]);
}

#[test]
fn ctrl_c_ends_it_with_a_report_of_every_worker() {
    let child = start("report", None);
    std::thread::sleep(1500 * MS);
    let pid = child.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &pid])
            .status()
            .unwrap()
            .success()
    );
    let (output, text) = end(child, "report");
    assert_eq!(output.status.code(), Some(0), "{text}");
    for worker in ["control", "camera", "diagnostics", "drive"] {
        let has = |line: &str| line.split_whitespace().next() == Some(worker);
        assert!(text.lines().any(has), "{worker} is missing:\n{text}");
    }
}

#[test]
fn a_camera_that_asks_for_too_much_is_refused() {
    let child = start("overload", Some(&file("overload.toml")));
    let (output, text) = end(child, "overload");
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(
        text.starts_with("Error: worker \"camera\" does not fit: on CPU 0 ")
            && text.contains(" every 100 ms would fit"),
        "{text}"
    );
}

/// The rover's description of itself, with an overlay or without.
fn described(name: &str, overlay: &str) -> String {
    let path = ledger(name).with_extension("toml");
    let output = Command::new(env!("CARGO_BIN_EXE_robot-app"))
        .env("REPLENISH_AGENT", "in-process")
        .env("REPLENISH_OVERLAY", overlay)
        .env("REPLENISH_TEMPLATE", &path)
        .output()
        .unwrap();
    let template = std::fs::read_to_string(&path).unwrap();
    std::fs::remove_file(&path).ok();
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("written; nothing was started"), "{said}");
    template
}

#[test]
fn a_description_has_what_an_overlay_says_even_if_it_does_not_fit() {
    let overlay = file("overload.toml");
    let template = described("overlaid", overlay.to_str().unwrap());
    let wish = r#"guarantee = { budget = "90 ms", period = "100 ms" }"#;
    assert!(template.contains(wish), "{template}");
    assert_eq!(template.matches("\ncpu = 0\n").count(), 2, "{template}");
}

#[test]
fn it_describes_itself_and_does_not_start() {
    let template = described("template", "");
    let kept = std::fs::read_to_string(file("robot.toml")).unwrap();
    let (_, kept) = kept.split_once("\n\n").unwrap();
    assert_eq!(
        kept.trim(),
        template.trim(),
        "write it into robot.toml, below its comment"
    );
}

/// Lines that are neither blank nor a comment alone.
fn code(path: &Path) -> usize {
    let text = std::fs::read_to_string(path).unwrap();
    let lines = text.lines().map(str::trim);
    lines
        .filter(|line| !line.is_empty() && !line.starts_with("//"))
        .count()
}

/// The lines of the three rovers are those that the page beside them and docs/api.md say.
#[test]
fn the_lines_beside_rclcpp_and_rclrs_are_those_of_the_page() {
    let sources = std::fs::read_dir(file("src")).unwrap();
    let ours: usize = sources.map(|entry| code(&entry.unwrap().path())).sum();
    let [cpp, rs] = ["beside/rover.cpp", "beside/rover.rs"].map(|name| code(&file(name)));
    let page = std::fs::read_to_string(file("beside/README.md")).unwrap();
    let row = format!("| lines of code | {ours} | {cpp} | {rs} |");
    assert!(page.contains(&row), "{row}");
    let api = std::fs::read_to_string(file("../../docs/api.md")).unwrap();
    let row = format!("| the rover of three nodes, lines | {ours} | {rs} | {cpp} |");
    assert!(api.contains(&row), "{row}");
}
