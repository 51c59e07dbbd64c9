//! The two processes of one path. They end with this.

use super::foreign::Foreign;
use super::path::Path;
use crate::load::Nanos;
use replenish_cli::outcome::Failure;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

/// The longest time of a process to start, find the other one, and answer.
const PATIENCE: Duration = Duration::from_secs(60);

/// A process and the lines it says.
pub(super) struct Process {
    name: String,
    child: Child,
    lines: Receiver<String>,
}

impl Process {
    /// One end of a path, which inherits policy and CPU of the calling thread. `Err` with a text: a
    /// foreign program is not there.
    pub(super) fn part(
        path: Path,
        role: &str,
        domain: u16,
    ) -> Result<Result<Self, String>, Failure> {
        let mut command = match path.foreign().map(Foreign::command) {
            Some(Err(missing)) => return Ok(Err(missing)),
            Some(Ok(command)) => command,
            None => {
                let program = std::env::current_exe().map_err(Failure::refused)?;
                let mut command = Command::new(program);
                command.args(["bench", "ros2", "--part", path.name(), "--role"]);
                command
            }
        };
        command
            .arg(role)
            .env("ROS_DOMAIN_ID", domain.to_string())
            .env("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
        if path.foreign().is_some() {
            command.stderr(Stdio::null());
        }
        let name = format!("{role} of {}", path.name());
        Self::start(name, &mut command).map(Ok)
    }

    fn start(name: String, command: &mut Command) -> Result<Self, Failure> {
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let child = command.spawn();
        let mut child = child.map_err(|e| Failure::refused(format!("cannot start {name}: {e}")))?;
        let (send, lines) = channel();
        if let Some(output) = child.stdout.take() {
            std::thread::spawn(move || {
                for line in BufReader::new(output).lines().map_while(Result::ok) {
                    if send.send(line).is_err() {
                        return;
                    }
                }
            });
        }
        Ok(Self { name, child, lines })
    }

    pub(super) fn line(&self) -> Result<String, Failure> {
        let late = |_| Failure::refused(format!("{} does not answer", self.name));
        self.lines.recv_timeout(PATIENCE).map_err(late)
    }

    pub(super) fn tell(&mut self, line: &str) -> Result<(), Failure> {
        let gone = || Failure::refused(format!("{} is gone", self.name));
        let input = self.child.stdin.as_mut().ok_or_else(gone)?;
        writeln!(input, "{line}").map_err(|_| gone())
    }

    /// CPU time of all its threads, by the scheduler's accounts.
    fn cpu(&self) -> Nanos {
        let tasks = std::fs::read_dir(format!("/proc/{}/task", self.child.id()));
        let tasks = tasks.into_iter().flatten().flatten();
        let each = tasks.filter_map(|task| {
            let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
            text.split_whitespace().next()?.parse::<Nanos>().ok()
        });
        each.sum()
    }

    fn threads(&self) -> usize {
        let tasks = std::fs::read_dir(format!("/proc/{}/task", self.child.id()));
        tasks.map_or(0, Iterator::count)
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

/// Ping and echo of a path.
pub(super) struct Pair {
    ping: Process,
    echo: Process,
}

/// One window of a pair.
pub(super) struct Window {
    pub(super) times: Vec<i64>,
    pub(super) lost: u64,
    pub(super) cpu: Nanos,
}

impl Pair {
    /// Starts both, and waits until they know each other. Their threads have the calling thread's
    /// policy and CPU. `Err` with a text: a foreign program is not there.
    pub(super) fn start(path: Path, domain: u16) -> Result<Result<Self, String>, Failure> {
        Self::start_with(path, "echo", domain)
    }

    /// The same, with another role for the one that answers.
    pub(super) fn start_with(
        path: Path,
        echo: &str,
        domain: u16,
    ) -> Result<Result<Self, String>, Failure> {
        let echo = match Process::part(path, echo, domain)? {
            Ok(echo) => echo,
            Err(missing) => return Ok(Err(missing)),
        };
        // The raw echo says where it is reached.
        let ready = echo.line()?;
        let mut ping = match Process::part(path, "ping", domain)? {
            Ok(ping) => ping,
            Err(missing) => return Ok(Err(missing)),
        };
        if let Some(port) = ready.strip_prefix("ready ") {
            ping.tell(port)?;
        }
        ping.line()?;
        Ok(Ok(Self { ping, echo }))
    }

    /// Answer of the echo process to a question.
    pub(super) fn ask_echo(&mut self, question: &str) -> Result<String, Failure> {
        self.echo.tell(question)?;
        self.echo.line()
    }

    /// `count` round trips of `bytes`, one each `period`.
    pub(super) fn window(
        &mut self,
        bytes: usize,
        count: u64,
        period: Nanos,
    ) -> Result<Window, Failure> {
        let before = self.ping.cpu() + self.echo.cpu();
        self.ping
            .tell(&format!("window {bytes} {count} {period}"))?;
        let line = self.ping.line()?;
        let cpu = (self.ping.cpu() + self.echo.cpu()).saturating_sub(before);
        let unread = || Failure::refused(format!("{} says {line:?}", self.ping.name));
        let mut words = line.strip_prefix("times ").ok_or_else(unread)?.split(' ');
        let lost = words.next().and_then(|word| word.parse().ok());
        let times = words.map(str::parse).collect::<Result<_, _>>();
        Ok(Window {
            lost: lost.ok_or_else(unread)?,
            times: times.map_err(|_| unread())?,
            cpu,
        })
    }

    /// Threads of both processes.
    pub(super) fn threads(&self) -> usize {
        self.ping.threads() + self.echo.threads()
    }
}
