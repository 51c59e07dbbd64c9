//! The promises of `docs/acknowledged.md` and `SECURITY.md` are proven: every row of a table with a
//! column `tests` names tests, and each of them exists.

use std::path::Path;

/// Whether the test `CRATE/MODULE::NAME` exists, in the integration binary, a file of `tests`, or
/// `src`.
fn exists(crates: &Path, test: &str) -> bool {
    let Some((place, name)) = test.rsplit_once("::") else {
        return false;
    };
    let Some((of, module)) = place.split_once('/') else {
        return false;
    };
    let places = ["tests/it/", "tests/machine/", "tests/", ""];
    let files = places.map(|place| crates.join(of).join(format!("{place}{module}.rs")));
    files.iter().any(|file| {
        let text = std::fs::read_to_string(file).unwrap_or_default();
        let lines: Vec<&str> = text.lines().map(str::trim).collect();
        let head = format!("fn {name}()");
        let tested = |pair: &[&str]| pair[0] == "#[test]" && pair[1].starts_with(&head);
        // Or a trial of the test kit's.
        let packed: String = text.split_whitespace().collect();
        let tried = packed.contains(&format!("trial(\"{name}\",{name}")) && text.contains(&head);
        tried || lines.windows(2).any(tested)
    })
}

/// The rows of all tables whose last column is `tests`, as cells.
fn rows(page: &str) -> Vec<Vec<&str>> {
    let mut rows = Vec::new();
    let mut within = false;
    for line in page.lines() {
        if !line.starts_with('|') {
            within = false;
        } else if line.ends_with("| tests |") {
            within = true;
        } else if within && !line.starts_with("|--") {
            let cells = line.trim_matches('|').split(" | ").map(str::trim);
            rows.push(cells.collect());
        }
    }
    rows
}

/// Problems of a page, which has at least `least` rows. `-` for a test is allowed where nothing is
/// promised.
fn problems(page: &str, columns: usize, least: usize) -> Vec<String> {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let text = std::fs::read_to_string(crates.join("..").join(page)).unwrap();
    let mut problems = Vec::new();
    let rows = rows(&text);
    for row in &rows {
        let what = row.join(" | ");
        if row.len() != columns || row.iter().any(|cell| cell.is_empty()) {
            problems.push(format!(
                "{page}: not {columns} columns, or an empty one: {what}"
            ));
            continue;
        }
        let (tests, cells) = row.split_last().unwrap();
        let nothing = cells
            .iter()
            .any(|cell| *cell == "-" || cell.starts_with("not stopped"));
        if *tests == "-" && nothing {
            continue;
        }
        for test in tests.split(", ").map(|test| test.trim_matches('`')) {
            if !exists(crates, test) {
                problems.push(format!("{page}: there is no test {test}: {what}"));
            }
        }
    }
    if rows.len() < least {
        problems.push(format!("{page}: {} rows", rows.len()));
    }
    problems
}

#[test]
fn every_promise_names_tests_that_exist() {
    let mut all = problems("docs/acknowledged.md", 4, 20);
    all.extend(problems("SECURITY.md", 3, 9));
    all.extend(problems("docs/agent.md", 2, 15));
    assert!(all.is_empty(), "{}", all.join("\n"));
}
