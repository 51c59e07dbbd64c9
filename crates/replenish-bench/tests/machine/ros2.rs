//! `bench ros2` with the foreign programs that `peers/setup.sh` builds.

use crate::common::{Scratch, json, run, stderr};
use replenish_testkit::domain::domain;
use replenish_testkit::harness::{Trial, peer_trial};
use replenish_testkit::peer;
use std::path::Path;

pub(crate) fn trials() -> Vec<Trial> {
    // Built last, beside the others.
    let kilted = peer::python(env!("CARGO_TARGET_TMPDIR"), "kilted");
    let peers = kilted.ancestors().nth(3).map(Path::to_path_buf);
    let library = peers.unwrap_or_default().join("bench/rcl.so");
    let setup = "crates/replenish-bench/peers/setup.sh";
    let missing = (!library.exists()).then(|| format!("no {}: run {setup}", library.display()));
    vec![peer_trial(
        "foreign_round_trips_come_back",
        missing,
        foreign,
    )]
}

/// Cyclone DDS, and rcl with Fast DDS, at both ends: nothing is left out and nothing is lost.
fn foreign() {
    let scratch = Scratch::new("bench-ros2-foreign");
    let path = scratch.path("result.json");
    let domains = format!("{},{}", domain(), domain());
    let output = run(&[
        "bench",
        "ros2",
        "--paths",
        "cyclone,rcl-fastdds",
        "--bytes",
        "64",
        "--windows",
        "1",
        "--require",
        "--domains",
        &domains,
        "--json",
        path.to_str().unwrap(),
    ]);
    assert!(output.status.success(), "{}", stderr(&output));
    let result = json(&path);
    let points = result["points"].as_array().unwrap();
    let paths: Vec<_> = points.iter().map(|point| &point["path"]).collect();
    assert_eq!(paths, ["cyclone", "rcl-fastdds"]);
    for point in points {
        assert_eq!(
            (&point["samples"], &point["lost"]),
            (&400.into(), &0.into())
        );
    }
    assert!(result["flood"].is_null() && result["left_out"].as_array().unwrap().is_empty());
}
