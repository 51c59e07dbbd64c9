//! Runs the commands of stages here, and other stages beside them in a process of their own.

use super::paths::target;
use super::stage::Stage;
use super::stages::{Step, steps};
use super::tally::{Tally, of_ended_processes};
use crate::output::Outcome;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::os::unix::process::CommandExt as _;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

/// Runs the stages one after another; prints each line as it comes and counts tests.
pub(super) fn foreground(stages: &[Stage], tally: &mut Tally) -> Outcome {
    each(stages.iter().flat_map(|stage| steps(*stage)), tally)
}

/// Runs commands one after another.
pub(super) fn each(steps: impl IntoIterator<Item = Step>, tally: &mut Tally) -> Outcome {
    steps.into_iter().try_for_each(|step| run(&step, tally))
}

/// With more failed tests than this, a command is not run again.
const FEW: usize = 3;

/// The most runs of a command.
const RUNS: usize = 3;

/// A command in which a few tests failed runs again, if it may: machines of CI stand still for
/// seconds now and then. A test that fails twice has failed. The log keeps every run and names the
/// tests.
fn run(step: &Step, tally: &mut Tally) -> Outcome {
    let mut unsteady: Vec<String> = Vec::new();
    for _ in 1..RUNS {
        tally.begin();
        let outcome = once(step, tally);
        let failed = tally.failed();
        let twice = failed.iter().any(|name| unsteady.contains(name));
        if outcome.is_ok() || !step.may_repeat() || twice || failed.is_empty() || failed.len() > FEW
        {
            return outcome;
        }
        println!(
            "\nunsteady: {}: failed; the whole command runs again",
            failed.join(", ")
        );
        unsteady.extend_from_slice(failed);
        tally.take_back();
    }
    tally.begin();
    once(step, tally)
}

fn once(step: &Step, tally: &mut Tally) -> Outcome {
    let (line, began) = (step.line(), Instant::now());
    let before = of_ended_processes();
    println!("\n== {line}");
    let fail = |e: &dyn std::fmt::Display| format!("{line}: {e}");
    let (reader, writer) = std::io::pipe().map_err(|e| fail(&e))?;
    let copy = writer.try_clone().map_err(|e| fail(&e))?;
    let mut command = step.command();
    command.stdin(Stdio::null()).stdout(copy).stderr(writer);
    let mut child = command.spawn().map_err(|e| fail(&e))?;
    drop(command); // and with it our ends of the pipe for writing
    follow(reader, &mut child, tally);
    let status = child.wait().map_err(|e| fail(&e))?;
    let processor = of_ended_processes().saturating_sub(before);
    tally.took(began.elapsed(), processor, line.clone());
    if status.success() {
        Ok(())
    } else {
        Err(format!("{line}: {status}{}", tally.blamed()))
    }
}

/// Time that the output may be quiet after its command has ended.
const QUIET: Duration = Duration::from_secs(2);

/// Prints a command's output to its end. A process that the command left behind holds the pipe open
/// and is not waited for.
fn follow(text: impl std::io::Read + Send + 'static, child: &mut Child, tally: &mut Tally) {
    let (tell, lines) = mpsc::channel();
    std::thread::spawn(move || {
        let lines = BufReader::new(text).split(b'\n').map_while(Result::ok);
        lines.into_iter().try_for_each(|line| tell.send(line)).ok();
    });
    loop {
        match lines.recv_timeout(QUIET) {
            Ok(line) => say(&line, tally),
            Err(RecvTimeoutError::Timeout) if matches!(child.try_wait(), Ok(None)) => {}
            Err(_) => break,
        }
    }
}

/// Prints a command's output, and counts the tests in it.
fn show(text: impl std::io::Read, tally: &mut Tally) {
    let lines = BufReader::new(text).split(b'\n').map_while(Result::ok);
    for line in lines {
        say(&line, tally);
    }
}

fn say(line: &[u8], tally: &mut Tally) {
    let line = String::from_utf8_lossy(line);
    println!("{line}");
    tally.line(&line);
}

/// Stages in a process of their own, with the processor time that others leave.
pub(super) struct Beside {
    child: Option<Child>,
    said: PathBuf,
    began: Instant,
    words: String,
}

impl Beside {
    /// Starts the stages.
    ///
    /// # Errors
    /// The process cannot be started.
    pub(super) fn start(stages: &[Stage]) -> Outcome<Self> {
        let said = target().join(format!("ci-{}", std::process::id()));
        let fail = |e: std::io::Error| format!("{}: {e}", said.display());
        std::fs::create_dir_all(target()).map_err(fail)?;
        let file = File::create(&said).map_err(fail)?;
        let copy = file.try_clone().map_err(fail)?;
        let words: Vec<_> = stages.iter().map(|stage| stage.word()).collect();
        let itself = std::env::current_exe().map_err(fail)?;
        let mut command = Command::new("nice");
        command
            .args(["-n", "10"])
            .arg(itself)
            .arg("ci")
            .args(&words);
        command
            .stdin(Stdio::null())
            .stdout(file)
            .stderr(copy)
            .process_group(0);
        let child = Some(command.spawn().map_err(fail)?);
        let words = format!("{} (beside others)", words.join(" "));
        Ok(Self {
            child,
            said,
            began: Instant::now(),
            words,
        })
    }

    /// Waits for the end and prints what the stages have said.
    ///
    /// # Errors
    /// They failed.
    pub(super) fn join(mut self, tally: &mut Tally) -> Outcome {
        let before = of_ended_processes();
        let status = self.child.as_mut().map(Child::wait).transpose();
        let processor = of_ended_processes().saturating_sub(before);
        self.child = None;
        if let Ok(file) = File::open(&self.said) {
            show(file, tally);
        }
        tally.took(self.began.elapsed(), processor, self.words.clone());
        match status {
            Ok(Some(status)) if status.success() => Ok(()),
            _ => Err(format!("{}: failed, see above", self.words)),
        }
    }
}

impl Drop for Beside {
    /// Ends processes that are not waited for any more, and removes the file.
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let group = format!("-{}", child.id());
            Command::new("kill")
                .args(["-TERM", "--", &group])
                .status()
                .ok();
            child.wait().ok();
        }
        std::fs::remove_file(&self.said).ok();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_that_a_command_left_behind_is_not_waited_for() {
        let (reader, writer) = std::io::pipe().unwrap();
        let mut command = Command::new("sh");
        command.args(["-c", "sleep 60 & echo 'failures:'; echo '    a_test'"]);
        let mut child = command.stdout(writer).spawn().unwrap();
        drop(command);
        let (began, mut tally) = (Instant::now(), Tally::default());
        follow(reader, &mut child, &mut tally);
        assert!(child.wait().unwrap().success());
        assert_eq!(tally.failed(), ["a_test"]);
        assert!(began.elapsed() < Duration::from_secs(30));
    }
}
