//! The demo as a whole: with real-time priority, without, and when it is refused.

use crate::common::{Running, Scratch, json, run, start, stderr, stdout};
use replenish_testkit::harness::{Trial, rt_program_trial, skip, trial};
use replenish_testkit::rt;
use std::os::unix::fs::PermissionsExt;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

/// The longest time that any step may take on a busy machine.
const SOON: Duration = Duration::from_secs(60);

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        rt_program_trial("demo_json_and_identities", demo_json_and_identities),
        rt_program_trial("sweep_with_odd_values", sweep_with_odd_values),
        rt_program_trial("budgets_isolate_the_control_loop", isolation),
        rt_program_trial("torture_judges_by_clocks_that_agree", torture),
        trial(
            "without_privilege_isolation_says_what_is_not_guaranteed",
            unprivileged_isolation,
        ),
        trial(
            "an_ordinary_user_gets_the_declared_fallback",
            unprivileged_demo,
        ),
        trial("strict_refuses_an_ordinary_user", strict_refuses),
        trial(
            "an_agent_that_dies_ends_the_demo_with_the_reason",
            agent_dies,
        ),
        trial("a_signal_ends_the_demo_and_its_parts", signal_ends_all),
    ]
}

/// Runs the command until no window of it counts although the machine stood still, at most three
/// times; its output and its JSON at `path`.
fn measured(args: &[&str], path: &std::path::Path) -> (Output, serde_json::Value) {
    fn disturbed(j: &serde_json::Value) -> u64 {
        match j {
            serde_json::Value::Object(map) => map
                .iter()
                .map(|(key, value)| match key.as_str() {
                    "windows_disturbed" => value.as_u64().unwrap(),
                    _ => disturbed(value),
                })
                .sum(),
            serde_json::Value::Array(items) => items.iter().map(disturbed).sum(),
            _ => 0,
        }
    }
    for _ in 0..3 {
        let output = run(args);
        assert!(output.status.success(), "{}", stderr(&output));
        let j = json(path);
        match disturbed(&j) {
            0 => return (output, j),
            n => eprintln!("run again: the machine stood still in {n} windows that count"),
        }
    }
    panic!("the machine does not give what is to be measured: three runs were disturbed");
}

/// Two random executors for two seconds each. The judge's clocks agree with `/proc` and with the
/// executor's account, and the executors start and stop; by how much budgets are overrun is a
/// matter of the machine, and of longer runs.
fn torture() {
    let scratch = Scratch::new("torture");
    let path = scratch.path("torture.json");
    let fixed = [
        "bench",
        "torture",
        "--seconds",
        "2",
        "--seed",
        "7",
        "--seeds",
    ];
    let rest = ["2", "--no-shrink", "--json", path.to_str().unwrap()];
    let output = run(&[&fixed[..], &rest[..]].concat());
    let said = stderr(&output);
    if said.contains("cannot mount tracefs") {
        skip(&format!("not judged: {said}"));
    }
    let j = json(&path);
    assert_eq!(
        (&j["seeds"], &j["seconds"]),
        (&2.into(), &2.into()),
        "{said}"
    );
    assert_eq!(j["ran"], serde_json::json!([7, 8]));
    assert_eq!(output.status.success(), j["violations"] == 0, "{said}");
    let judged = 2 - j["unjudged"].as_array().unwrap().len();
    let worst = j["worst"].as_array().unwrap();
    assert!(worst.len() == 10 || judged == 0, "{j}");
    for distance in worst {
        for field in ["seed", "bound_us", "measured_us"] {
            assert!(distance[field].is_number(), "{distance}");
        }
        assert!(distance["case"].is_string(), "{distance}");
    }
    for failure in j["failures"].as_array().unwrap() {
        let text = failure["text"].as_str().unwrap();
        for wrong in ["account of", "trace of", "did not", "stuck", "ended with"] {
            assert!(!text.contains(wrong), "{text}");
        }
    }
}

fn demo_json_and_identities() {
    let scratch = Scratch::new("demo");
    let (path, page) = (scratch.path("demo.json"), scratch.path("report.html"));
    let args = [
        "demo",
        "--seconds",
        "4",
        "--json",
        path.to_str().unwrap(),
        "--report",
        page.to_str().unwrap(),
    ];
    let (output, j) = measured(&args, &path);
    assert_eq!(j["mode"], "enforced");
    let windows = j["windows"].as_u64().unwrap();
    assert_eq!(windows, 8);
    assert!(j["windows_repeated"].is_u64());
    let number = |path: &str| j.pointer(path).and_then(serde_json::Value::as_f64).unwrap();
    assert_eq!(number("/high/sent"), 40.0 * windows as f64);
    assert_eq!(number("/high/expected"), 12.0 * windows as f64);
    assert_eq!(number("/low/expected"), 28.0 * windows as f64);
    let missing = number("/high/expected") - number("/high/answered");
    assert!(missing.abs() <= windows as f64, "{j:#}");
    let cpu = number("/high/cpu_percent") + number("/low/cpu_percent");
    // The CPU is not idle while work waits. The time that a machine's interrupts take is not ours.
    let (idle, stolen) = (number("/idle_percent"), number("/stolen_percent"));
    assert!(idle < 1.0, "idle {idle} %: {j:#}");
    let all = cpu + number("/support_cpu_percent") + stolen;
    assert!((97.0..=100.5).contains(&all), "in all {all} %: {j:#}");
    let parts = number("/high/high_priority_cpu_percent") + number("/high/background_cpu_percent");
    assert!((number("/high/cpu_percent") - parts).abs() < 0.01);
    assert!(number("/high/budget_error_percent").abs() < 1.0, "{j:#}");
    assert!(number("/overrun_us/median") <= number("/overrun_us/p99"));
    assert!(j["overrun_us"]["stalls"].is_array());

    let threads = j["threads"].as_array().unwrap();
    let granted = |name: &str| {
        let row = threads
            .iter()
            .find(|t| t["name"] == name)
            .unwrap_or_else(|| panic!("{name}: {j:#}"));
        assert!(row["requested"].is_string() && row["cpu"].is_string());
        row["granted"].as_str().unwrap().to_string()
    };
    for (name, priority) in [
        ("pong/high", "60"),
        ("pong/low", "50"),
        ("pong/dispatcher", "98"),
    ] {
        let text = granted(name);
        assert!(
            text.contains("FIFO") && text.contains(priority),
            "{name}: {text}"
        );
    }
    assert!(
        threads
            .iter()
            .any(|t| t["name"].as_str().unwrap().starts_with("pong/enforcer"))
    );

    let html = std::fs::read_to_string(&page).unwrap();
    assert!(html.contains("<svg") && !html.contains("<script"));
    assert!(stdout(&output).contains("report.html"));
}

fn sweep_with_odd_values() {
    let scratch = Scratch::new("sweep");
    let files = ["json", "csv", "svg", "html"].map(|kind| scratch.path(&format!("sweep.{kind}")));
    let [j, csv, svg, html] = files.each_ref().map(|p| p.to_str().unwrap());
    let args = [
        "experiment",
        "budget-sweep",
        "--budgets",
        "37,60",
        "--period",
        "90",
        "--windows",
        "3",
        "--json",
        j,
        "--csv",
        csv,
        "--svg",
        svg,
        "--html",
        html,
    ];
    let (_, result) = measured(&args, &files[0]);
    let points = result["points"].as_array().unwrap();
    assert_eq!(points.len(), 2);
    for (point, budget) in points.iter().zip([37.0, 60.0]) {
        assert_eq!(point["budget_ms"].as_f64().unwrap(), budget);
        let windows = point["windows"].as_f64().unwrap();
        let get = |key: &str| {
            point[key]
                .as_f64()
                .unwrap_or_else(|| panic!("{key}: {point:#}"))
        };
        assert!(
            (get("high_answered") - get("expected_high")).abs() <= windows,
            "{point:#}"
        );
        for topic in ["high", "low"] {
            let measured = get(&format!("{topic}_answered"));
            let simulated = get(&format!("simulated_{topic}_answered"));
            assert!(
                (measured - simulated).abs() <= windows,
                "{topic}: {point:#}"
            );
        }
        assert!(
            (get("high_cpu_percent") - budget / 0.9).abs() < 1.0,
            "{point:#}"
        );
        assert!(get("low_cpu_percent") > 0.0 && get("expected_low") > 0.0);
    }
    let fifo = &result["fifo"];
    assert!(
        fifo["high_cpu_percent"].as_f64().unwrap() > 95.0,
        "{fifo:#}"
    );
    assert_eq!(fifo["low_answered"], 0);
    assert_eq!(
        std::fs::read_to_string(&files[1]).unwrap().lines().count(),
        4
    );
    assert!(
        std::fs::read_to_string(&files[2])
            .unwrap()
            .contains("theory")
    );
    assert!(std::fs::read_to_string(&files[3]).unwrap().contains("<svg"));
}

fn isolation() {
    let scratch = Scratch::new("isolation");
    let files = ["json", "csv", "svg"].map(|kind| scratch.path(&format!("i.{kind}")));
    let [j, csv, svg] = files.each_ref().map(|p| p.to_str().unwrap());
    let args = ["--windows", "1", "--json", j, "--csv", csv, "--svg", svg];
    let output = run(&[&["experiment", "isolation"][..], &args].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let result = json(&files[0]);
    let cases = result["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 8);
    for case in cases {
        let releases = case["releases"].as_u64().unwrap();
        assert!((40..=50).contains(&releases), "{case:#}");
        assert_eq!(case["deadline_ms"], 10.0);
        // The machine may stand still; the command says so, and it is no fault of a budget.
        if case["windows_stalled"] == 0 && case["budgets"] == true {
            assert_eq!(case["misses"], 0, "{case:#}");
            assert!(case["worst_ms"].as_f64().unwrap() <= 10.0, "{case:#}");
        }
        let harmed = ["noisy-neighbour", "runaway-callback"].map(serde_json::Value::from);
        if case["budgets"] == false && harmed.contains(&case["name"]) {
            assert!(case["misses"].as_u64().unwrap() > 10, "{case:#}");
        }
    }
    let lines = std::fs::read_to_string(&files[1]).unwrap().lines().count();
    let releases = cases.iter().map(|c| c["releases"].as_u64().unwrap());
    assert_eq!(lines as u64, 1 + releases.sum::<u64>());
    assert!(
        std::fs::read_to_string(&files[2])
            .unwrap()
            .contains("Runaway")
    );
}

fn unprivileged_isolation() {
    let scratch = Scratch::new("unprivileged-isolation");
    open_to_all(&scratch);
    let path = scratch.path("i.json");
    let (windows, json_path) = ("--windows", path.to_str().unwrap());
    let args = ["experiment", "isolation", windows, "1", "--json", json_path];
    let output = as_ordinary_user(&scratch, &args);
    assert!(output.status.success(), "{}", stderr(&output));
    for case in json(&path)["cases"].as_array().unwrap() {
        assert_eq!(case["mode"], "deferred", "{case:#}");
    }
    let text = stdout(&output);
    assert!(text.contains("held at callback boundaries only"), "{text}");
}

fn unprivileged_demo() {
    let scratch = Scratch::new("unprivileged");
    open_to_all(&scratch);
    let (path, page) = (scratch.path("demo.json"), scratch.path("report.html"));
    let output = as_ordinary_user(
        &scratch,
        &[
            "demo",
            "--seconds",
            "3",
            "--json",
            path.to_str().unwrap(),
            "--report",
            page.to_str().unwrap(),
        ],
    );
    assert!(output.status.success(), "{}", stderr(&output));
    let j = json(&path);
    assert_eq!(j["mode"], "deferred");
    for thread in j["threads"].as_array().unwrap() {
        let granted = thread["granted"].as_str().unwrap();
        assert!(!granted.contains("FIFO"), "{thread}");
    }
    assert!(j["high"]["answered"].as_u64().unwrap() > 0, "{j:#}");
    let text = stdout(&output);
    let lines: Vec<_> = text
        .lines()
        .filter(|l| l.contains("Not guaranteed"))
        .collect();
    assert_eq!(lines.len(), 1, "{text}");
    assert!(
        lines[0].contains("CAP_SYS_NICE") || lines[0].contains("rtprio"),
        "{}",
        lines[0]
    );
}

fn strict_refuses() {
    let scratch = Scratch::new("strict");
    open_to_all(&scratch);
    let page = scratch.path("report.html");
    let args = ["demo", "--strict", "--report", page.to_str().unwrap()];
    let output = as_ordinary_user(&scratch, &args);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let text = stderr(&output);
    assert!(text.contains("--strict"), "{text}");
    assert!(
        text.contains("CAP_SYS_NICE") || text.contains("rtprio"),
        "{text}"
    );
}

fn agent_dies() {
    let scratch = Scratch::new("agent-dies");
    let (mut demo, parts) = demo_in_progress(&scratch);
    let agent = parts
        .iter()
        .find(|(_, args)| args.contains("agent"))
        .expect("an agent runs");
    let killed = Command::new("kill")
        .args(["-s", "KILL", &agent.0.to_string()])
        .status()
        .unwrap();
    assert!(killed.success());
    demo.expect_line("agent process ended unexpectedly", SOON);
    assert_eq!(demo.end(SOON).code(), Some(1));
    assert_eq!(still_running(&parts), [] as [u32; 0]);
}

fn signal_ends_all() {
    let scratch = Scratch::new("signal");
    let (mut demo, parts) = demo_in_progress(&scratch);
    assert_eq!(parts.len(), 3, "{parts:?}");
    demo.signal("TERM");
    demo.expect_line("interrupted", SOON);
    assert_eq!(demo.end(SOON).code(), Some(1));
    assert_eq!(still_running(&parts), [] as [u32; 0]);
}

/// A demo whose load is on, and its children: process id and arguments.
fn demo_in_progress(scratch: &Scratch) -> (Running, Vec<(u32, String)>) {
    let page = scratch.path("report.html");
    let mut demo = start(&[
        "demo",
        "--seconds",
        "30",
        "--report",
        page.to_str().unwrap(),
    ]);
    demo.expect_line("answers:", Duration::from_secs(300)); // it may wait for another run
    let children = children_of(demo.id());
    (demo, children)
}

fn children_of(parent: u32) -> Vec<(u32, String)> {
    let mut children = Vec::new();
    for entry in std::fs::read_dir("/proc").unwrap().flatten() {
        let Some(pid) = entry.file_name().to_str().and_then(|n| n.parse().ok()) else {
            continue;
        };
        // The name, in parentheses, may hold anything; what follows has fixed fields.
        let stat = std::fs::read_to_string(entry.path().join("stat")).unwrap_or_default();
        let ppid = stat
            .rsplit(')')
            .next()
            .and_then(|rest| rest.split_whitespace().nth(1));
        if ppid.and_then(|p| p.parse().ok()) == Some(parent) {
            let args = std::fs::read_to_string(entry.path().join("cmdline")).unwrap_or_default();
            children.push((pid, args.replace('\0', " ")));
        }
    }
    children
}

fn still_running(parts: &[(u32, String)]) -> Vec<u32> {
    let alive = |pid: &u32| std::path::Path::new(&format!("/proc/{pid}")).exists();
    parts.iter().map(|(pid, _)| *pid).filter(alive).collect()
}

fn open_to_all(scratch: &Scratch) {
    std::fs::set_permissions(scratch.dir(), std::fs::Permissions::from_mode(0o777)).unwrap();
}

/// Runs the command without any privilege: as `nobody` if this is root, as it is if this user has
/// no real-time priority anyway. Skips the trial if neither can be had.
fn as_ordinary_user(scratch: &Scratch, args: &[&str]) -> Output {
    let copy = scratch.path("replenish"); // the build directory may be closed to others
    std::fs::copy(crate::common::BIN, &copy).unwrap();
    std::fs::set_permissions(&copy, std::fs::Permissions::from_mode(0o755)).unwrap();
    let setpriv = [
        "--reuid=65534",
        "--regid=65534",
        "--clear-groups",
        "--inh-caps=-all",
    ];
    let is_root = std::fs::metadata("/proc/self")
        .map(|m| std::os::unix::fs::MetadataExt::uid(&m))
        .unwrap()
        == 0;
    let mut command = if is_root {
        let mut c = Command::new("setpriv");
        c.args(setpriv).arg(&copy);
        c
    } else if rt::available().is_err() {
        Command::new(&copy)
    } else {
        skip("this user has real-time priority and cannot give it up");
    };
    command
        .args(args)
        .current_dir(scratch.dir())
        .stdin(Stdio::null());
    command.output().unwrap()
}
