//! Counts of tests, and how long each command took.

use std::time::Duration;

/// The sums of a run of stages: times, counts of tests, and names of failed tests.
#[derive(Default)]
pub(super) struct Tally {
    /// How long each command took, and the processor time of its processes.
    times: Vec<(Duration, Duration, String)>,
    /// Passed, failed, ignored.
    tests: Option<[u64; 3]>,
    /// The names of failed tests, of the command that runs.
    failed: Vec<String>,
    /// The last line belongs to the list of failures.
    in_list: bool,
    /// The line that began the tests that have not ended, of the command that runs.
    began: Option<String>,
}

impl Tally {
    /// Adds a command that has ended.
    pub(super) fn took(&mut self, time: Duration, processor: Duration, line: String) {
        self.times.push((time, processor, line));
    }

    /// Forgets the names of failed tests.
    pub(super) fn begin(&mut self) {
        self.failed.clear();
        self.began = None;
    }

    /// Names of the tests that failed since [`begin`](Self::begin).
    pub(super) fn failed(&self) -> &[String] {
        &self.failed
    }

    /// The failures since [`begin`](Self::begin), to stand behind a command's exit status: its
    /// tests, or the program that ended amid them.
    pub(super) fn blamed(&self) -> String {
        match &self.began {
            _ if !self.failed.is_empty() => format!("; failed: {}", self.failed.join(", ")),
            Some(began) => format!("; ended amid its tests: {began}"),
            None => String::new(),
        }
    }

    /// Takes back the failures since [`begin`](Self::begin).
    pub(super) fn take_back(&mut self) {
        if let Some([_, failed, _]) = &mut self.tests {
            *failed = failed.saturating_sub(self.failed.len() as u64);
        }
    }

    /// Adds the counts if `line` closes a run of tests, and the name if it stands in the list of
    /// failures.
    pub(super) fn line(&mut self, line: &str) {
        if line == "failures:" {
            self.in_list = true;
            return;
        }
        if let Some(name) = line.strip_prefix("    ").filter(|_| self.in_list) {
            self.failed.push(name.trim().to_owned());
            return;
        }
        self.in_list = false;
        if let Some(program) = line.trim_start().strip_prefix("Running ") {
            self.began = Some(program.to_owned());
        }
        let Some(counts) = line.strip_prefix("test result: ") else {
            return;
        };
        self.began = None;
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
            .sort_by_key(|(time, ..)| core::cmp::Reverse(*time));
        println!(
            "\n{} s in all; the slowest commands, and their processor time:",
            whole.as_secs()
        );
        for (time, processor, line) in self.times.iter().take(25) {
            let processor = processor.as_secs();
            println!("{:6} s {processor:6} s  {line}", time.as_secs());
        }
        if let Some([passed, failed, ignored]) = self.tests {
            println!("{passed} passed, {failed} failed, {ignored} skipped");
        }
    }
}

/// The processor time of all processes that have ended and were waited for, in steps of 10 ms; zero
/// where the kernel does not tell.
pub(super) fn of_ended_processes() -> Duration {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The program's name is in brackets; the 14th and 15th fields after it are theirs.
    let fields = stat.rsplit_once(')').map_or("", |(_, rest)| rest);
    let times = fields.split_whitespace().skip(13).take(2);
    let ticks: u64 = times.filter_map(|field| field.parse::<u64>().ok()).sum();
    Duration::from_millis(10).saturating_mul(u32::try_from(ticks).unwrap_or(u32::MAX))
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

    #[test]
    fn processor_time_of_a_process_is_counted_when_it_has_ended() {
        let before = of_ended_processes();
        let mut command = std::process::Command::new("sh");
        command.args(["-c", "i=0; while [ $i -lt 300000 ]; do i=$((i+1)); done"]);
        assert!(command.status().unwrap().success());
        assert!(of_ended_processes() > before);
    }

    #[test]
    fn failed_tests_are_named_and_can_be_taken_back() {
        let mut tally = Tally::default();
        tally.begin();
        let output = "test adopted::a ... ok\nfailures:\n\n---- adopted::they_share ----\n    at a.rs\n\n\
                      failures:\n    adopted::they_share\n\n\
                      test result: FAILED. 1 passed; 1 failed; 0 ignored; 0 measured";
        output.lines().for_each(|line| tally.line(line));
        assert_eq!(tally.failed(), ["adopted::they_share"]);
        assert_eq!(tally.blamed(), "; failed: adopted::they_share");
        tally.take_back();
        assert_eq!(tally.tests, Some([1, 0, 0]));
        tally.begin();
        assert!(tally.failed().is_empty());
        assert_eq!(tally.blamed(), "");
    }

    #[test]
    fn a_program_that_ended_amid_its_tests_is_named() {
        let mut tally = Tally::default();
        tally.line("     Running tests/it/main.rs (target/debug/deps/it-1)");
        tally.line("test a_test ... ok");
        let amid = "; ended amid its tests: tests/it/main.rs (target/debug/deps/it-1)";
        assert_eq!(tally.blamed(), amid);
        tally.line("test result: ok. 1 passed; 0 failed; 0 ignored; 0 measured");
        assert_eq!(tally.blamed(), "");
    }
}
