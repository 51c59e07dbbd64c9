//! `plan` and `simulate` as a user runs them: the robot of `examples/`, one that does not fit, and
//! files that make no sense.

use crate::common::{Scratch, json, run, stderr, stdout};
use replenish_plan::ledger::Ledger;
use replenish_plan::{ExecutorRequest, Guarantee, Machine, Overheads, Request, Worker};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

fn example(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples");
    path.join(name).to_str().unwrap().to_string()
}

#[test]
fn the_robot_is_planned_with_every_column_of_the_contract() {
    let scratch = Scratch::new("plan");
    let path = scratch.path("plan.json");
    let begun = Instant::now();
    let output = run(&[
        "plan",
        &example("robot/fits.toml"),
        "--json",
        path.to_str().unwrap(),
    ]);
    assert!(begun.elapsed() < Duration::from_secs(30));
    assert!(output.status.success(), "{}", stderr(&output));
    let j = json(&path);
    assert_eq!(j["admitted"], true);
    assert!(j["refusal"].is_null());
    let workers = j["workers"].as_array().unwrap();
    assert!(workers.len() >= 6);
    for worker in workers.iter().filter(|w| w["priority"] != 0) {
        let number = |key: &str| worker[key].as_f64().unwrap();
        assert!(
            worker["id"].is_string() && worker["cpu"].is_u64(),
            "{worker:#}"
        );
        assert!(worker["background"].is_u64() || worker["background"].is_null());
        assert!(number("budget_ms") <= number("period_ms"));
        assert!(
            number("worst_response_ms") <= number("deadline_ms"),
            "{worker:#}"
        );
    }
    let stop = workers.iter().find(|w| w["id"] == "safety_stop").unwrap();
    let priority = |w: &serde_json::Value| w["priority"].as_u64().unwrap();
    assert!(priority(stop) > 0);
    let text = stdout(&output);
    for part in ["It fits", "safety_stop", "worst response", "Why:", "CPU 0:"] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

/// The file that the rover's own test compares with its program.
#[test]
fn the_rover_is_planned_for_this_host() {
    let scratch = Scratch::new("rover");
    let path = scratch.path("plan.json");
    let file = example("robot_app/robot.toml");
    let output = run(&["plan", &file, "--json", path.to_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));
    let j = json(&path);
    assert_eq!(j["admitted"], true);
    let workers = j["workers"].as_array().unwrap();
    let worker = |id: &str| workers.iter().find(|w| w["id"] == id).unwrap();
    let (control, camera) = (worker("control"), worker("camera"));
    assert!(control["priority"].as_u64() > camera["priority"].as_u64());
    assert_eq!(control["deadline_ms"], 5.0);
    assert!(control["worst_response_ms"].as_f64().unwrap() <= 5.0);
    assert_eq!(
        (&camera["budget_ms"], &camera["period_ms"]),
        (&30.0.into(), &100.0.into())
    );
    let shared = workers.iter().filter(|w| w["priority"] == 0);
    assert_eq!(shared.count(), workers.len() - 2, "{workers:#?}");
}

#[test]
fn what_does_not_fit_is_refused_with_the_bottleneck() {
    let scratch = Scratch::new("refused");
    let path = scratch.path("plan.json");
    let file = example("robot/refused.toml");
    let output = run(&["plan", &file, "--json", path.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    let j = json(&path);
    assert_eq!(j["admitted"], false);
    assert!(
        j["workers"].as_array().is_some_and(|w| w.len() >= 6),
        "{j:#}"
    );
    let sentence = j["refusal"].as_str().unwrap();
    assert!(sentence.contains("CPU 0"), "{sentence}");
    assert!(sentence.contains("would fit"), "{sentence}");
    assert!(stderr(&output).contains(sentence), "{}", stderr(&output));

    // Simulating it is refused as well, unless one wants to see what happens.
    let page = scratch.path("s.html");
    let simulate = ["simulate", &file, "--html", page.to_str().unwrap()];
    let output = run(&simulate);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("--anyway"), "{}", stderr(&output));
    let output = run(&[
        &simulate[..],
        &["--anyway", "--json", path.to_str().unwrap()],
    ]
    .concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let j = json(&path);
    let missed = |w: &serde_json::Value| w["misses"].as_u64().unwrap();
    assert!(
        j["workers"]
            .as_array()
            .unwrap()
            .iter()
            .any(|w| missed(w) > 0)
    );
}

#[test]
fn what_other_programs_have_reserved_counts_and_what_was_measured() {
    let scratch = Scratch::new("beside");
    let path = scratch.path("plan.json");
    let ledger = Ledger::open(scratch.path("ledger")).unwrap();
    let file = example("robot/fits.toml");
    let plan = |more: &[&str]| {
        let args = ["plan", &file, "--json", path.to_str().unwrap()];
        let output = Command::new(env!("CARGO_BIN_EXE_replenish"))
            .args([&args, more].concat())
            .env("REPLENISH_LEDGER", ledger.directory())
            .output()
            .unwrap();
        (output.status.code(), json(&path))
    };
    let (code, alone) = plan(&[]);
    assert_eq!(
        (code, &alone["overheads_measured"]),
        (Some(0), &false.into())
    );

    let overheads = Overheads {
        latency: 60_000,
        ..Overheads::LINUX
    };
    ledger.set_overheads(&overheads, "by a test").unwrap();
    assert_eq!(ledger.overheads().unwrap(), Some(overheads));
    let (code, measured) = plan(&[]);
    assert_eq!(
        (code, &measured["overheads_measured"]),
        (Some(0), &true.into())
    );
    let worst = |json: &serde_json::Value| json["workers"][0]["worst_response_ms"].as_f64();
    assert!(worst(&measured) > worst(&alone), "{measured:#}");

    let ms = Duration::from_millis;
    let mut request = Request::new(Machine::with_cpus(2));
    request.executor = ExecutorRequest::None;
    let greedy = Guarantee::of(ms(80)).every(ms(100));
    request = request.worker(Worker::guaranteed("greedy", greedy));
    request = request.worker(Worker::guaranteed("another", greedy));
    let _place = ledger.admit(&request, "another program").unwrap();
    let (code, beside) = plan(&[]);
    assert_eq!(code, Some(1), "{beside:#}");
    assert_eq!(beside["beside"].as_array().map(Vec::len), Some(2));
    let owner = beside["beside"][0].as_str().unwrap();
    assert!(owner.contains("greedy") && owner.contains("another program"));
    let workers = beside["workers"].as_array().unwrap();
    assert_eq!(workers.len(), alone["workers"].as_array().unwrap().len());
    let (code, _) = plan(&["--ignore-ledger"]);
    assert_eq!(code, Some(0));
}

#[test]
fn a_plan_creates_no_ledger() {
    let scratch = Scratch::new("look");
    let nowhere = scratch.path("nowhere");
    let output = Command::new(env!("CARGO_BIN_EXE_replenish"))
        .args(["plan", &example("robot/fits.toml")])
        .env("REPLENISH_LEDGER", &nowhere)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(!nowhere.exists());
}

#[test]
fn the_robot_is_simulated_drawn_and_within_its_bounds() {
    let scratch = Scratch::new("simulate");
    let paths = ["json", "svg", "html"].map(|kind| scratch.path(&format!("s.{kind}")));
    let [j, svg, html] = paths.each_ref().map(|p| p.to_str().unwrap());
    let begun = Instant::now();
    let file = example("robot/fits.toml");
    let output = run(&["simulate", &file, "--json", j, "--svg", svg, "--html", html]);
    assert!(begun.elapsed() < Duration::from_secs(30));
    assert!(output.status.success(), "{}", stderr(&output));
    let result = json(&paths[0]);
    let workers = result["workers"].as_array().unwrap();
    for worker in workers.iter().filter(|w| w["bound_ms"].is_f64()) {
        let number = |key: &str| worker[key].as_f64().unwrap();
        assert!(
            number("worst_response_ms") <= number("bound_ms"),
            "{worker:#}"
        );
        assert_eq!(worker["misses"], 0, "{worker:#}");
        assert!(number("completed") > 0.0);
    }
    assert_eq!(workers[0]["id"], "safety_stop");
    assert!(workers[0]["released"].as_u64().unwrap() > 10);
    let svg = std::fs::read_to_string(&paths[1]).unwrap();
    for part in ["CPU 1", "safety_stop", "class=\"curve\"", "class=\"run\""] {
        assert!(svg.contains(part), "{part}");
    }
    let html = std::fs::read_to_string(&paths[2]).unwrap();
    assert!(html.contains("<svg") && !html.contains("<script"));
}

#[test]
fn a_file_that_makes_no_sense_is_refused_with_its_place() {
    let scratch = Scratch::new("nonsense");
    let write = |name: &str, text: &str| -> PathBuf {
        let path = scratch.path(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let worker = "[[worker]]\nname = \"a\"\n";
    let cases = [
        (scratch.path("missing.toml"), "missing.toml", "No such file"),
        (write("syntax.toml", "[machine\ncpus = 2\n"), ":1:", ""),
        (write("key.toml", "[machine]\ncpu = 2\n"), ":2:1", "cpu"),
        (
            write("time.toml", &format!("{worker}runs = \"3\"\n")),
            ":3:8",
            "30 ms",
        ),
        (
            write("who.toml", &format!("{worker}sends = [\"b\"]\n")),
            ":3:10",
            "no worker \"b\"",
        ),
        (
            write(
                "range.toml",
                &format!("{worker}guarantee = {{ budget = \"9 ms\", period = \"5 ms\" }}\n"),
            ),
            ":3:",
            "9 ms is longer than the period, 5 ms",
        ),
    ];
    for (path, place, message) in cases {
        for command in ["plan", "simulate"] {
            let page = scratch.path("never.html");
            let file = path.to_str().unwrap();
            let html = ["--html", page.to_str().unwrap()];
            let more: &[&str] = if command == "simulate" { &html } else { &[] };
            let output = run(&[&[command, file], more].concat());
            let text = stderr(&output);
            assert_eq!(output.status.code(), Some(1), "{file}: {text}");
            assert!(
                text.contains(place) && text.contains(message),
                "{file}: {text}"
            );
        }
    }
}

/// It would run for hours, and take the memory of 10^9 response times.
#[test]
fn a_run_of_too_many_releases_is_refused() {
    let scratch = Scratch::new("releases");
    let path = scratch.path("fast.toml");
    let cases = [
        (
            r#"every = "10 ns""#,
            r#"every = "10 ns" gives 1000000000 releases in 10 s"#,
        ),
        (
            r#"every = "10 ms", burst = 4294967295"#,
            "burst = 4294967295 every 10000000 ns gives 4294967295000 releases in 10 s",
        ),
    ];
    for (releases, expected) in cases {
        let worker = r#"guarantee = { budget = "1 ms", period = "10 ms" }"#;
        let worker = format!("[[worker]]\nname = \"fast\"\ncpu = 0\n{worker}\n");
        let text = format!("[machine]\ncpus = [0]\n\n{worker}releases = {{ {releases} }}\n");
        std::fs::write(&path, text).unwrap();
        let output = run(&["simulate", path.to_str().unwrap()]);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{text}");
        let expected = format!("\"fast\": {expected}: allowed are 10000000 in a run");
        assert!(text.contains(&expected), "{text}");
    }
}

#[test]
fn a_file_without_a_machine_is_planned_for_this_host() {
    let scratch = Scratch::new("host");
    let path = scratch.path("host.toml");
    let worker = |cpu: usize| {
        let guarantee = r#"guarantee = { budget = "1 ms", period = "10 ms" }"#;
        format!("[[worker]]\nname = \"a\"\ncpu = {cpu}\n{guarantee}\n")
    };
    let cpus = replenish_cli::machine::cpus::allowed();
    let last = cpus.last().copied().unwrap();
    std::fs::write(&path, worker(last)).unwrap();
    let output = run(&["plan", path.to_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));
    for cpu in &cpus {
        assert!(stdout(&output).contains(&format!("CPU {cpu}: ")), "{cpu}");
    }
    for word in ["plan", "simulate"] {
        std::fs::write(&path, worker(1023)).unwrap();
        let output = run(&[word, path.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(1));
        let expected = format!("its cpu: allowed {cpus:?}, the CPUs of this host");
        assert!(stderr(&output).contains(&expected), "{}", stderr(&output));
    }
}

#[test]
fn a_program_describes_itself() {
    // It has much to say before, more than a pipe holds.
    let script = r#"seq 100000 >&2; echo 'name = "a"' > "$REPLENISH_TEMPLATE"; exit 1"#;
    let output = run(&["template", "--", "sh", "-c", script]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(stdout(&output), "name = \"a\"\n");

    let output = run(&["template", "--", "sh", "-c", "echo no robot >&2; exit 3"]);
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(
        stderr(&output).trim(),
        "replenish: sh ended (exit status: 3) before an executor of replenish would have started; \
         its last words: no robot"
    );
}
