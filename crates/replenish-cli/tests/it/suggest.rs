//! `suggest` on a program that records what it does: each callback for itself.

use crate::common::{Scratch, stderr, stdout};
use crate::recorded::Program;
use crate::schema;

#[test]
fn each_callback_has_its_own_period_and_its_histogram() {
    let scratch = Scratch::new("suggest-callbacks");
    let program = Program::start("suggest");
    program.wait(&scratch.path("top.json"));
    let [toml, out] = ["s.toml", "s.json"].map(|name| scratch.path(name));
    let (pid, seconds) = (program.child.id().to_string(), "3");
    let [toml_path, out_path] = [&toml, &out].map(|p| p.to_str().unwrap());
    let args = [
        "suggest",
        "--pid",
        &pid,
        "--seconds",
        seconds,
        "--out",
        toml_path,
        "--json",
    ];
    let output = program.command(&[&args[..], &[out_path]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let json = schema::read(&out);
    let workers = json["workers"].as_array().unwrap();
    let worker = |id: &str| workers.iter().find(|w| w["id"] == id).unwrap();
    let mut every = Vec::new();
    for (name, ids) in [
        ("source", &["source/timer:0", "source/timer:1"][..]),
        ("sink", &["/n/sub:/t"]),
        ("hungry", &["hungry/timer:0"]),
    ] {
        let worker = worker(name);
        assert_eq!(worker["from"], "recording", "{worker:#}");
        let callbacks = worker["callbacks"].as_array().unwrap();
        let number = |of: &serde_json::Value, key: &str| of[key].as_f64().unwrap();
        let (mut executions, mut most, mut shortest) = (0, 0.0_f64, f64::MAX);
        for id in ids {
            let callback = callbacks.iter().find(|c| c["id"] == *id).unwrap();
            let histogram = callback["histogram"].as_array().unwrap();
            let counts = histogram.iter().map(|b| b["count"].as_u64().unwrap());
            let ran = counts.sum::<u64>();
            assert_eq!(callback["executions"], ran, "{callback:#}");
            let last = histogram.last().unwrap();
            assert_eq!(last["up_to_ms"], callback["max_ms"], "{callback:#}");
            assert!(number(callback, "p50_ms") <= number(callback, "p99_ms"));
            assert!(number(callback, "p99_ms") <= number(callback, "max_ms"));
            executions += ran;
            most = most.max(number(callback, "max_ms"));
            shortest = shortest.min(number(callback, "period_ms"));
            every.push(number(callback, "released_every_ms"));
        }
        assert_eq!(callbacks.len(), ids.len());
        assert_eq!(worker["samples"], executions);
        assert_eq!(number(worker, "period_ms"), shortest, "{worker:#}");
        assert!(number(worker, "max_observed_ms") >= most, "{worker:#}");
    }
    // 1 ms, 50 ms, as fast as the source, 10 ms; a busy machine may skip releases.
    assert!(every[1] >= 49.0 && every[1] > every[0], "{every:?}");
    assert!(every[3] >= 9.0, "{every:?}");
    // It takes 6 ms of its CPU, and the worker's budget must have room for that.
    let hungry = worker("hungry");
    assert!(hungry["max_observed_ms"].as_f64() > Some(1.0), "{hungry:#}");
    let (text, file) = (stdout(&output), std::fs::read_to_string(&toml).unwrap());
    for id in ["source/timer:1", "/n/sub:/t"] {
        assert!(text.contains(&format!("{id}: ")) && file.contains(&format!("# {id}: ")));
    }
    assert!(text.contains("up to ") && text.contains('█'), "{text}");
}
