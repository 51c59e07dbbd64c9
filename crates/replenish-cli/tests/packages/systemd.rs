//! `deploy/replenish-agent.service`: systemd understands the unit.

use crate::common::BIN;
use crate::{empty, missing, repository};
use replenish_testkit::harness::{Trial, trial};
use std::process::Command;

pub(crate) fn trials() -> Vec<Trial> {
    let missing = missing("systemd-analyze", "systemd");
    vec![trial("it_understands_the_unit", understood).skipped_if(missing.as_deref())]
}

fn understood() {
    let unit = repository().join("deploy/replenish-agent.service");
    let unit = std::fs::read_to_string(unit).unwrap();
    let dir = empty("unit");
    let path = dir.join("replenish-agent.service");
    std::fs::write(&path, unit.replace("/usr/local/bin/replenish", BIN)).unwrap();
    let verified = Command::new("systemd-analyze")
        .arg("verify")
        .arg(&path)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&verified.stderr);
    let about_it: Vec<&str> = said
        .lines()
        .filter(|l| l.contains("replenish-agent"))
        .collect();
    assert!(verified.status.success() && about_it.is_empty(), "{said}");
    std::fs::remove_dir_all(dir).ok();
}
