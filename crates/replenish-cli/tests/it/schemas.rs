//! Documents that no other test reads, and the schemas' own test.
#![allow(clippy::unwrap_used, reason = "a test")]

use crate::common::{Scratch, json, run, stderr};
use crate::schema::check;
use replenish::{Context, Executor, HandleOptions, Qos, msg::std_msgs::Int32};
use std::time::Duration;

/// A report with everything in it that a program has to quote.
#[test]
fn a_report_is_as_its_schema_says() {
    let ctx = Context::in_process();
    let node = ctx.node("reported").unwrap();
    let mut exec = Executor::new(&ctx);
    let worker = exec.worker("w");
    worker
        .timer(Duration::from_millis(1), |cx| {
            cx.stop();
            Err("say \"no\" to C:\\\n\u{1}")
        })
        .unwrap()
        .options(HandleOptions::new().on_error(|_| ()))
        .subscribe(&node, "never", Qos::reliable(), |_: &Int32, _| ())
        .unwrap();
    exec.on_event(|_| ());
    let report = exec.spin().unwrap();
    let json: serde_json::Value = serde_json::from_str(&report.to_json()).unwrap();
    check(&json);
    let timer = json["handles"].as_array().unwrap();
    let timer = timer.iter().find(|h| h["id"] == "w/timer:0").unwrap();
    assert_eq!(timer["last_error"], "say \"no\" to C:\\\n\u{1}");
    assert_eq!(timer["executed"], timer["errors"]);
    assert_eq!(timer["latency_ns"]["count"], timer["executed"]);
    assert_eq!(json["threads"][0]["name"], "dispatcher");
    assert_eq!(json["threads"][1]["overruns"]["count"], 0);
    let idle = json["handles"][1].clone();
    assert_eq!(idle["id"], "/reported/sub:/never");
    assert_eq!(idle["last_error"], serde_json::Value::Null);
}

#[test]
fn doctor_is_as_its_schema_says() {
    let scratch = Scratch::new("doctor-schema");
    let path = scratch.path("doctor.json");
    let output = run(&["doctor", "--json", path.to_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_ne!(json(&path)["findings"].as_array().unwrap().len(), 0);
}

/// A name that a schema does not know, and one that is missing, are found.
#[test]
fn a_document_that_is_not_as_its_schema_says_is_found() {
    let of = |programs: &str| {
        let text = format!("{{\"document\":\"programs\",\"version\":1,{programs}}}");
        let document: serde_json::Value = serde_json::from_str(&text).unwrap();
        std::panic::catch_unwind(|| check(&document)).is_ok()
    };
    assert!(of("\"programs\":[]"));
    for wrong in [
        "\"program\":[]",
        "\"programs\":{}",
        "\"programs\":[{}]",
        "\"programs\":[],\"more\":1",
        "\"programs\":[{\"supervisor\":-1,\"pid\":1,\"name\":\"\",\"threads\":1,\"budgets\":\"\"}]",
    ] {
        assert!(!of(wrong), "{wrong}");
    }
}
