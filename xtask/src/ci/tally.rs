//! Counts of tests, and how long each command took.

use std::time::Duration;

/// What a run of stages adds up.
#[derive(Default)]
pub(super) struct Tally {
    times: Vec<(Duration, String)>,
    /// Passed, failed, ignored.
    tests: Option<[u64; 3]>,
}

impl Tally {
    /// Adds a command that has ended.
    pub(super) fn took(&mut self, time: Duration, line: String) {
        self.times.push((time, line));
    }

    /// Adds the counts if `line` closes a run of tests.
    pub(super) fn line(&mut self, line: &str) {
        let Some(counts) = line.strip_prefix("test result: ") else {
            return;
        };
        let words: Vec<_> = counts.split([' ', ';']).collect();
        let count = |label| {
            let at = words.iter().position(|word| *word == label)?;
            words.get(at.checked_sub(1)?)?.parse::<u64>().ok()
        };
        let sums = self.tests.get_or_insert_default();
        for (sum, label) in sums.iter_mut().zip(["passed", "failed", "ignored"]) {
            *sum += count(label).unwrap_or(0);
        }
    }

    /// Prints the slowest commands and, alone on the last line, how many tests of all kinds ran.
    pub(super) fn print(mut self, whole: Duration) {
        self.times
            .sort_by_key(|(time, _)| core::cmp::Reverse(*time));
        println!("\n{} s in all; the slowest commands:", whole.as_secs());
        for (time, line) in self.times.iter().take(15) {
            println!("{:6} s  {line}", time.as_secs());
        }
        if let Some([passed, failed, ignored]) = self.tests {
            println!("{passed} passed, {failed} failed, {ignored} skipped");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closing_lines_are_added_up() {
        let mut tally = Tally::default();
        tally.line("test result: ok. 5 passed; 0 failed; 2 ignored; 0 measured; 0 filtered out; finished in 0.1s");
        tally
            .line("test result: FAILED. 3 passed; 1 failed; 0 ignored; 0 measured; 0 filtered out");
        tally.line("test a_result ... ok");
        assert_eq!(tally.tests, Some([8, 1, 2]));
    }
}
