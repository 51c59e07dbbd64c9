//! `docs/tutorial.md`, command by command: a package of its own, built and run as the page says.
//!
//! Blocks of `sh` are run, the block of `rust` becomes `src/main.rs`, and a block of `text` is what
//! the command before it prints. Figures may differ, and so may columns behind the second: they
//! depend on the machine. `…` stands for anything. The package is built from this checkout and its
//! lock file, offline.

use std::path::{Path, PathBuf};
use std::process::Command;

fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .ancestors()
        .nth(2)
        .unwrap()
}

/// The fenced blocks of a page: language and text.
fn blocks(page: &str) -> Vec<(String, String)> {
    let mut blocks = Vec::new();
    let mut lines = page.lines();
    while let Some(line) = lines.next() {
        if let Some(language) = line.strip_prefix("```") {
            let text: Vec<&str> = lines.by_ref().take_while(|l| *l != "```").collect();
            blocks.push((language.to_owned(), text.join("\n")));
        }
    }
    blocks
}

/// A reader who types what the page says.
struct Reader {
    directory: PathBuf,
    variables: Vec<(String, String)>,
    printed: String,
}

impl Reader {
    fn type_line(&mut self, line: &str) {
        if let Some(directory) = line.strip_prefix("cd ") {
            self.directory.push(directory);
            std::fs::copy(
                repository().join("Cargo.lock"),
                self.directory.join("Cargo.lock"),
            )
            .unwrap();
            return;
        }
        if let Some(variable) = line.strip_prefix("export ") {
            let (name, value) = variable.split_once('=').unwrap();
            self.variables.push((name.to_owned(), value.to_owned()));
            return;
        }
        // Takes this checkout instead of the published one.
        let here = format!("--path {}", repository().join("crates/replenish").display());
        let line = line.replace("--git https://github.com/replenish-rt/replenish", &here);
        let output = Command::new("sh")
            .args(["-c", &line])
            .current_dir(&self.directory)
            .envs(self.variables.iter().map(|(name, value)| (name, value)))
            .output()
            .unwrap();
        let text = [output.stdout, output.stderr].concat();
        self.printed = String::from_utf8(text).unwrap();
        let wanted = output.status.success() || line.starts_with("timeout") || line.contains(":=");
        assert!(wanted, "{line}: {}\n{}", output.status, self.printed);
    }

    /// Each expected line is there, in this order.
    fn compare(&self, expected: &str) {
        let mut printed = self.printed.lines();
        for line in expected.lines() {
            let found = printed.any(|printed| is_like(printed, line));
            assert!(found, "`{line}` is missing in\n{}", self.printed);
        }
    }
}

/// Whether a line is as expected; `…` stands for anything.
fn is_like(printed: &str, expected: &str) -> bool {
    let Some((begin, end)) = expected.split_once('…') else {
        return shape(printed) == shape(expected);
    };
    printed.starts_with(begin) && printed.contains(end)
}

/// A line without its figures; of a table the first two columns, and how many there are.
fn shape(line: &str) -> (Vec<String>, usize) {
    let figure = |c: char| c.is_ascii_digit() || c == '.';
    let blind = |cell: &str| cell.replace(figure, "");
    let cells: Vec<&str> = line.split("  ").filter(|cell| !cell.is_empty()).collect();
    let first = cells
        .iter()
        .take(2)
        .map(|cell| blind(cell.trim()))
        .collect();
    (first, cells.len())
}

#[test]
fn the_tutorial_says_what_happens() {
    let directory = std::env::temp_dir().join(format!("replenish-tutorial-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    // The reader has a target directory and a ledger of its own: the kept builds of this checkout
    // are not touched.
    let ledger = directory.join("ledger").display().to_string();
    let mut reader = Reader {
        directory: directory.clone(),
        variables: vec![
            ("CARGO_NET_OFFLINE".to_owned(), "true".to_owned()),
            ("CARGO_INCREMENTAL".to_owned(), "0".to_owned()),
            ("CARGO_PROFILE_DEV_DEBUG".to_owned(), "none".to_owned()),
            ("CARGO_TARGET_DIR".to_owned(), "target".to_owned()),
            ("REPLENISH_LEDGER".to_owned(), ledger),
        ],
        printed: String::new(),
    };
    let page = std::fs::read_to_string(repository().join("docs/tutorial.md")).unwrap();
    let cpus = std::thread::available_parallelism().map_or(1, usize::from);
    let mut compared = 0;
    for (language, text) in blocks(&page) {
        match language.as_str() {
            "sh" => text.lines().for_each(|line| reader.type_line(line)),
            "rust,no_run" => std::fs::write(reader.directory.join("src/main.rs"), text).unwrap(),
            "text" => {
                // With one CPU the workers share it: less would fit.
                if cpus > 1 || !text.contains("would fit") {
                    reader.compare(&text);
                }
                compared += 1;
            }
            other => panic!("a block of {other}"),
        }
    }
    assert_eq!(compared, 2);
    std::fs::remove_dir_all(&directory).ok();
}
