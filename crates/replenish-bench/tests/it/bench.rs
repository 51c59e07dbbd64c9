//! The benchmarks of agent, protocol and dispatching: what they count, not how fast they are.

use crate::common::{BIN, Scratch, json, run, stderr, stdout};
use replenish_testkit::domain::domain;
use serde_json::Value;

/// Runs a benchmark to its good end; its JSON.
fn bench(name: &str, args: &[&str]) -> Value {
    let scratch = Scratch::new(&format!("bench-{name}"));
    let path = scratch.path("result.json");
    let fixed = ["bench", name, "--json", path.to_str().unwrap()];
    let output = run(&[&fixed, args].concat());
    assert!(
        output.status.success(),
        "{}{}",
        stdout(&output),
        stderr(&output)
    );
    json(&path)
}

#[test]
fn on_bad_links_everything_arrives_once_and_repair_is_selective() {
    let result = bench("xrce", &["--loss", "0,1,10", "--samples", "3000"]);
    let points = result["points"].as_array().unwrap();
    let losses: Vec<u64> = points
        .iter()
        .map(|point| point["loss_percent"].as_u64().unwrap())
        .collect();
    assert_eq!(losses, [0, 1, 10]);
    for point in points {
        assert_eq!(point["sent"], 3000, "{point}");
        assert_eq!(point["delivered"], 3000, "{point}");
        assert_eq!(
            (&point["duplicated"], &point["lost"]),
            (&0.into(), &0.into())
        );
        assert!(point["messages_per_second"].as_f64().unwrap() > 0.0);
    }
    let bytes = |key: &str| points[2][key].as_u64().unwrap();
    assert!(2 * bytes("retransmitted_bytes") <= bytes("go_back_n_bytes"));
    assert_eq!(
        result,
        bench("xrce", &["--loss", "0,1,10", "--samples", "3000"]),
        "the same seed, the same figures"
    );
}

/// Callbacks find lent messages where they were filled, and encoded ones elsewhere.
#[test]
fn a_lent_message_is_copied_for_no_worker_and_an_encoded_one_for_each() {
    let few = ["--samples", "50", "--bytes", "64,1000000"];
    let lent = bench("in-process", &few);
    let encoded = bench("in-process", &[&few[..], &["--encoded"]].concat());
    let row = |of: &Value, at: usize, what: &str| of["in_process"][at][what].as_u64().unwrap();
    for (at, bytes) in [64, 1_000_000].into_iter().enumerate() {
        for of in [&lent, &encoded] {
            assert_eq!((row(of, at, "bytes"), row(of, at, "readers")), (bytes, 3));
        }
        assert_eq!(row(&lent, at, "copied_bytes"), 0, "{lent}");
        assert_eq!(
            row(&encoded, at, "copied_bytes"),
            3 * 50 * bytes,
            "{encoded}"
        );
    }
}

/// Processes are killed and stopped behind a link that loses a tenth of the datagrams.
#[test]
fn a_soak_of_processes_misses_nothing_that_was_acknowledged() {
    let faults = "agent,stall,publisher,reader";
    let fixed = ["--samples", "2000", "--stall", "700", "--faults", faults];
    let result = bench("soak", &fixed);
    for what in ["missing", "more", "damaged"] {
        assert_eq!(result[what], 0, "{what}: {result}");
    }
    let acknowledged = result["acknowledged"].as_u64().unwrap();
    assert!(acknowledged > 1200, "{result}");
    assert!(result["datagrams"]["lost"].as_u64() > Some(100), "{result}");
    assert_eq!(result["agents_killed"], 1, "{result}");
}

#[test]
fn round_trips_come_back_on_every_path() {
    let result = bench("round-trip", &["--samples", "400"]);
    let points = result["points"].as_array().unwrap();
    let paths: Vec<&str> = points.iter().map(|p| p["path"].as_str().unwrap()).collect();
    assert_eq!(paths, ["raw-udp", "best-effort", "reliable"]);
    for point in points {
        assert_eq!(point["lost"], 0, "{point}");
        assert!(point["samples"].as_u64().unwrap() >= 400);
        let us = |key: &str| point[key].as_f64().unwrap();
        assert!(
            us("p50_us") > 0.0 && us("p50_us") <= us("p99_us"),
            "{point}"
        );
        assert!(us("cpu_us_per_message") > 0.0, "{point}");
    }
}

/// Each path in processes of its own; nothing is lost, and the flood runs beside.
#[test]
fn round_trips_without_an_agent_come_back_on_every_path() {
    let domains: Vec<String> = (0..3).map(|_| domain().to_string()).collect();
    let domains = domains.join(",");
    let paths = ["raw-udp", "wire", "executor"];
    let result = bench(
        "ros2",
        &[
            "--paths",
            &paths.join(","),
            "--bytes",
            "64,1048576",
            "--windows",
            "1",
            "--domains",
            &domains,
        ],
    );
    let points = result["points"].as_array().unwrap();
    let of = |point: &Value| {
        let path = point["path"].as_str().unwrap().to_owned();
        (point["bytes"].as_u64().unwrap(), path)
    };
    let expected = [64, 1 << 20].map(|bytes| paths.map(|path| (bytes, path.to_owned())));
    assert_eq!(points.iter().map(of).collect::<Vec<_>>(), expected.concat());
    for point in points {
        assert_eq!(point["lost"], 0, "{point}");
        // A window of 0.4 s, at 1 kHz or 100 Hz.
        let sent = if point["bytes"] == 64 { 400 } else { 40 };
        assert_eq!(point["samples"], sent, "{point}");
        assert!(point["p50_us"].as_f64() <= point["p99_us"].as_f64());
        assert!(point["cpu_us_per_message"].as_f64() > Some(0.0), "{point}");
    }
    assert!(result["flood"]["sent"].as_u64() > Some(0), "{result}");
}

/// A foreign program that is missing leaves its path out, unless it is required.
#[test]
fn a_missing_peer_is_said_and_an_error_where_it_is_required() {
    let domain = domain().to_string();
    let fixed = [
        "bench",
        "ros2",
        "--paths",
        "cyclone",
        "--windows",
        "1",
        "--domains",
        &domain,
    ];
    let nowhere = [
        ("CARGO_TARGET_DIR", "no-such-target"),
        ("REPLENISH_REQUIRE_PEERS", "0"),
    ];
    let said = "cyclone is left out";
    let run_with = |args: &[&str], env: [(&str, &str); 2]| {
        let mut command = std::process::Command::new(BIN);
        command.args(args).envs(env).output().unwrap()
    };
    let output = run_with(&fixed, nowhere);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(stderr(&output).contains(said), "{}", stderr(&output));
    let required = [&fixed[..], &["--require"]].concat();
    for (args, env) in [
        (&required[..], nowhere[1]),
        (&fixed, ("REPLENISH_REQUIRE_PEERS", "1")),
    ] {
        let output = run_with(args, [nowhere[0], env]);
        assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
        assert!(stderr(&output).contains(said), "{}", stderr(&output));
    }
}

#[test]
fn encrypted_round_trips_come_back_beside_those_in_the_clear() {
    let result = bench("secure", &["--samples", "200"]);
    let points = result["points"].as_array().unwrap();
    let of = |point: &Value| {
        let text = |key: &str| point[key].as_str().unwrap().to_owned();
        (
            text("path"),
            text("plain"),
            point["bytes"].as_u64().unwrap(),
        )
    };
    let pairs = [
        ("udp", "udp"),
        ("dtls", "udp"),
        ("tcp", "tcp"),
        ("tls", "tcp"),
    ];
    let expected = [64, 1024].map(|bytes| pairs.map(|(a, b)| (a.into(), b.into(), bytes)));
    assert_eq!(points.iter().map(of).collect::<Vec<_>>(), expected.concat());
    for point in points {
        assert_eq!(point["lost"], 0, "{point}");
        assert!(point["samples"].as_u64().unwrap() >= 200, "{point}");
        let figure = |key: &str| point[key].as_f64().unwrap();
        assert!(figure("p50_us") > 0.0 && figure("p50_us") <= figure("p99_us"));
        assert!(figure("agent_cpu_us_per_message") > 0.0, "{point}");
        let ratios = ["ratio_p50", "ratio_p99", "ratio_agent_cpu"];
        let plain = point["path"] == point["plain"];
        for ratio in ratios.map(figure) {
            assert!(ratio > 0.0 && (!plain || ratio == 1.0), "{point}");
        }
    }
}

#[test]
fn sixteen_clients_lose_nothing() {
    let result = bench("load", &["--clients", "16", "--seconds", "3"]);
    let count = |key: &str| result[key].as_u64().unwrap();
    assert_eq!(count("sent"), 16 * 8 * 100 * 3);
    assert_eq!(count("delivered"), count("sent"));
    for key in [
        "lost",
        "duplicated",
        "gaps",
        "agent_dropped",
        "disconnected",
    ] {
        assert_eq!(count(key), 0, "{key}: {result:#}");
    }
    for key in [
        "messages_per_second",
        "agent_cpus",
        "agent_rss_bytes_end",
        "p99_us",
    ] {
        assert!(result[key].as_f64().unwrap() > 0.0, "{key}: {result:#}");
    }
}

#[test]
fn dispatching_is_compared_thread_for_thread_with_raw_loops() {
    let result = bench("dispatch", &["--handles", "1,3", "--windows", "1"]);
    assert_eq!(result["awake"], true);
    let points = result["points"].as_array().unwrap();
    let handles: Vec<_> = points.iter().map(|p| p["handles"].as_u64()).collect();
    assert_eq!(handles, [Some(1), Some(3)]);
    for point in points {
        assert_eq!(point["rate_hz"], 1000);
        let receivers = [
            point,
            &point["threads"],
            &point["waiting"],
            &point["baseline"],
        ];
        for receiver in receivers {
            let figure = |key: &str| receiver[key].as_f64().unwrap();
            assert_eq!(receiver["sent"], point["sent"], "{point:#}");
            assert!(figure("received") > 0.0, "{point:#}");
            assert!(figure("cpu_us_per_message") > 0.0, "{point:#}");
            assert!(figure("voluntary_switches_per_message") > 0.0, "{point:#}");
            assert!(figure("p50_us") <= figure("p99_us"), "{point:#}");
        }
        for ratio in ["cpu_ratio", "threads_cpu_ratio", "waiting_cpu_ratio"] {
            assert!(point[ratio].as_f64().unwrap() > 0.0, "{point:#}");
        }
    }
    let args = [
        "--asleep",
        "--handles",
        "1",
        "--rate",
        "100",
        "--windows",
        "1",
    ];
    let result = bench("dispatch", &args);
    assert_eq!(result["awake"], false);
    assert_eq!(result["points"][0]["rate_hz"], 100);
}

#[test]
fn wrong_options_name_the_range() {
    for (args, option, range) in [
        (["xrce", "--loss", "91"], "--loss", "0..=90"),
        (["xrce", "--samples", "0"], "--samples", "1..=10000000"),
        (["round-trip", "--bytes", "7"], "--bytes", "8..=900"),
        (["secure", "--samples", "199"], "--samples", "200..=1000000"),
        (["load", "--clients", "1"], "--clients", "2..=256"),
        (["load", "--rate", "1001"], "--rate", "1..=1000"),
        (["dispatch", "--handles", "1,1001"], "--handles", "1..=1000"),
        (["dispatch", "--rate", "9"], "--rate", "10..=10000"),
        (["dispatch", "--windows", "0"], "--windows", "1..=1000"),
    ] {
        let output = run(&[&["bench"], &args[..]].concat());
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{args:?}: {text}");
        assert!(text.contains(option) && text.contains(range), "{text}");
    }
}
