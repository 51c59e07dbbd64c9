//! `suggest` on real processes: the numbers, the file it writes, and what it refuses.

use crate::common::{Scratch, json, run, start, stderr, stdout};
use std::time::Duration;

/// The longest time that any step may take on a busy machine.
const SOON: Duration = Duration::from_secs(60);

#[test]
fn a_running_pong_gets_budgets_that_can_be_planned() {
    let scratch = Scratch::new("suggest");
    let mut agent = start(&["agent", "--listen", "127.0.0.1:0"]);
    let line = agent.expect_line("127.0.0.1:", SOON);
    let from = line.find("127.0.0.1:").unwrap();
    let address: String = line[from..]
        .chars()
        .take_while(|c| c.is_ascii_digit() || ".:".contains(*c))
        .collect();
    let mut pong = start(&["pong", "--agent", &address, "--burst", "1"]);
    pong.expect_line("granted", SOON);
    let mut ping = start(&["ping", "--agent", &address, "--interval", "20"]);
    ping.expect_line("answered", SOON);

    let (out, path) = (scratch.path("suggested.toml"), scratch.path("s.json"));
    let (out, pid) = (out.to_str().unwrap(), pong.id().to_string());
    let json_path = path.to_str().unwrap();
    let output = run(&[
        "suggest",
        "--pid",
        &pid,
        "--seconds",
        "1",
        "--out",
        out,
        "--json",
        json_path,
    ]);
    assert!(output.status.success(), "{}", stderr(&output));
    let result = json(&path);
    let workers = result["workers"].as_array().unwrap();
    for name in ["high", "low"] {
        let worker = workers.iter().find(|w| w["id"] == name).unwrap();
        let number = |key: &str| worker[key].as_f64().unwrap();
        assert!(number("max_observed_ms") > 0.0, "{worker:#}");
        assert!(number("samples") > 10.0);
        // Its messages come every 20 ms or so; a busy machine may hold up some of them.
        let period = number("period_ms");
        assert!((5.0..=50.0).contains(&period), "{worker:#}");
        assert!(number("wakes_every_ms") >= period * 0.95, "{worker:#}");
        let with_margin = number("max_observed_ms") * 1.2;
        let suggested = number("suggested_budget_ms");
        assert!(suggested >= with_margin.min(period) - 1e-6, "{worker:#}");
        assert!(suggested <= with_margin + 0.11, "{worker:#}");
    }
    assert!(workers.iter().all(|w| w["id"] != "dispatcher"));
    assert!(stdout(&output).contains("not bounds"));
    let text = std::fs::read_to_string(out).unwrap();
    assert!(
        text.contains("most seen") && text.contains("not bounds"),
        "{text}"
    );
    let planned = run(&["plan", out]);
    assert!(planned.status.success(), "{}", stderr(&planned));
}

#[test]
fn what_cannot_be_watched_is_refused_and_leaves_no_file() {
    let scratch = Scratch::new("suggest-refused");
    let out = scratch.path("suggested.toml");
    let file = out.to_str().unwrap();
    let cases: [(&[&str], i32, &str); 5] = [
        (&["--pid", "4194304"], 1, "no process 4194304"),
        (&["--", "/nonexistent/program"], 1, "/nonexistent/program"),
        (
            &["--seconds", "1", "--", "sleep", "9"],
            1,
            "no thread besides",
        ),
        (&[], 2, "PROGRAM"),
        (&["--period", "1", "--pid", "1"], 2, "2..=900"),
    ];
    for (args, code, message) in cases {
        let output = run(&[&["suggest", "--out", file], args].concat());
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{args:?}: {text}");
        assert!(text.contains(message), "{args:?}: {text}");
        assert!(!out.exists(), "{args:?}");
    }
}
