//! What `docs/rclc-parity.md` says is proven is: every row names tests, and each of them exists.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

use std::collections::BTreeMap;
use std::path::Path;

/// The source of a test target.
fn source(crates: &Path, krate: &str, target: &str) -> String {
    let file = crates.join(format!("{krate}/tests/{target}.rs"));
    std::fs::read_to_string(&file).unwrap_or_default()
}

#[test]
fn every_row_names_tests_that_exist() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let table = crates.join("../docs/rclc-parity.md");
    let table = std::fs::read_to_string(table).unwrap();
    let mut sources = BTreeMap::new();
    let mut problems = Vec::new();
    let mut rows = 0;
    for row in table.lines().filter(|l| l.starts_with("| ")) {
        let cells: Vec<&str> = row.trim_matches('|').split(" | ").collect();
        let [what, here, proof] = cells[..] else {
            problems.push(format!("not three columns: {row}"));
            continue;
        };
        if proof.trim() == "tests" {
            continue; // the head of a table
        }
        rows += 1;
        if here.contains("partly") || proof.trim().is_empty() {
            problems.push(format!("{what}: partly, or without test"));
        }
        for test in proof.split(',').map(|t| t.trim().trim_matches('`')) {
            let (place, name) = test.split_once("::").unwrap_or((test, ""));
            let (krate, target) = place.split_once('/').unwrap_or(("replenish", place));
            let text = sources
                .entry((krate, target))
                .or_insert_with(|| source(crates, krate, target));
            let exists = [format!("fn {name}("), format!("\"{name}\"")];
            if name.is_empty() || !exists.iter().any(|form| text.contains(form)) {
                problems.push(format!("{what}: there is no test {test}"));
            }
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
    assert!(rows >= 70, "{rows} rows");
}
