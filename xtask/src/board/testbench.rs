//! The paper's test bench: a board that runs pong, an agent on its serial line, ping on the host.
//!
//! ```text
//!   QEMU: pong ◄── USART2 = a pseudo terminal ──► replenish agent ◄── UDP ──► replenish ping --ticked
//!     └─ semihosting: command line, JSON at the end
//! ```
//!
//! Everything that is started here is ended here, by its own handle; agent and ping also end when
//! this process does, since their standard input closes.

use super::{host, qemu};
use crate::output::Outcome;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

/// The programs on the test bench.
pub(crate) struct Bench {
    image: PathBuf,
    replenish: PathBuf,
    /// Looks at the recordings of the host when the board asks for it.
    look: Option<Look>,
}

/// A function that looks at the recordings and returns its findings.
pub(crate) type Look = fn(&Bench) -> Outcome<Value>;

/// The result of a run.
pub(crate) struct Run {
    /// The board's JSON.
    pub(crate) board: Value,
    /// Ping's totals: `sent`, `answered`, each of high and low.
    pub(crate) ping: Value,
    /// Findings of [`Look`]; `null` without it.
    pub(crate) looked: Value,
}

/// The host's additional tasks.
#[derive(Clone, Copy, Default)]
pub(crate) struct Host {
    /// Messages of the low topic on top of each pair.
    pub(crate) flood: u32,
    /// Ping echoes the samples of the topics `sure` and `loose`.
    pub(crate) echo: bool,
}

/// The board's requests to end its agent and to look at its recording, and its notice that the link
/// is down.
const END_AGENT: &str = "# end the agent";
const LOOK: &str = "# look";
const LINK_DOWN: &str = "# link is down";

/// The end of the message about a run that was ended.
const NO_END: &str = "did not end";

/// The most runs of a case.
const RUNS: usize = 3;

/// JSON path of the number of ticks that the host did not answer.
pub(crate) const UNANSWERED: &str = "/uart/unanswered";

/// A run that takes longer on the host than this is ended.
const PATIENCE: Duration = Duration::from_secs(300);

impl Bench {
    /// Builds image `name` and the host's program.
    pub(crate) fn build(name: &str) -> Outcome<Self> {
        Ok(Self {
            image: qemu::build_for(name, "speed")?,
            replenish: host::replenish()?,
            look: None,
        })
    }

    /// As [`build`](Self::build), for an image that records, and a host that looks at it. The
    /// board's clock runs about as the host's.
    pub(crate) fn recorded(name: &str, look: Look) -> Outcome<Self> {
        Ok(Self {
            image: qemu::build_with(name, "speed", &["--features", "recorder"])?,
            replenish: host::replenish()?,
            look: Some(look),
        })
    }

    /// The host's program. Its recordings stand in a directory of this run, if anything looks at
    /// them.
    pub(crate) fn replenish(&self) -> Command {
        let mut command = Command::new(&self.replenish);
        if self.look.is_some() {
            command.env("REPLENISH_LIVE", live());
        }
        command
    }

    /// Runs the board to its end, at most three times if it does not end: the board's clock stands
    /// still while it waits for the host, so a sample that a loaded host loses, or a host that is
    /// too slow, costs no time of the board's but all of ours. Each repetition is printed.
    pub(crate) fn run(&self, words: &[String], host: Host) -> Outcome<Run> {
        self.run_until(words, host, |_| true)
    }

    /// As [`run`](Self::run), for a run in which the host owes an answer to every tick.
    pub(crate) fn run_answered(&self, words: &[String], host: Host) -> Outcome<Run> {
        self.run_until(words, host, |run| {
            run.board.pointer(UNANSWERED) == Some(&Value::from(0))
        })
    }

    /// As [`run`](Self::run), and a run in which the host did not do its part says nothing about
    /// the board: it is repeated too. The third run counts as it is.
    pub(crate) fn run_until(
        &self,
        words: &[String],
        host: Host,
        host_did_its_part: fn(&Run) -> bool,
    ) -> Outcome<Run> {
        for _ in 1..RUNS {
            match self.once(words, host) {
                Err(what) if what.contains(NO_END) => eprintln!("{what}\nrun again"),
                Ok(run) if !host_did_its_part(&run) => {
                    eprintln!("{words:?}: the host was too slow, or lost a tick\nrun again");
                }
                end => return end,
            }
        }
        self.once(words, host)
    }

    /// Boots the board with `words` as its command line and runs it to its end.
    fn once(&self, words: &[String], host: Host) -> Outcome<Run> {
        if self.look.is_some() {
            std::fs::remove_dir_all(live()).ok(); // recordings of a run before
        }
        let (mut board, output, line) = self.boot(words)?;
        let mut said = String::new();
        // Held open, so that the line does not hang up while no agent has it.
        let _held = std::fs::File::options()
            .read(true)
            .open(&line)
            .map_err(|e| format!("{line}: {e}"))?;
        let totals = scratch("ping");
        let (mut agent, address) = self.agent(&line, "127.0.0.1:0")?;
        let mut ping = self.replenish();
        ping.args(["ping", "--supervised", "--ticked", "--agent", &address])
            .arg("--json")
            .arg(&totals);
        if host.flood > 0 {
            ping.arg("--flood").arg(host.flood.to_string());
        }
        if host.echo {
            ping.arg("--echo");
        }
        let mut ping = Part::start("ping", ping.stdout(Stdio::null()))?;
        let until = Instant::now() + PATIENCE;
        let mut ended = false;
        let mut looked = Value::Null;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            match output.recv_timeout(left) {
                Ok(text) => {
                    if text.starts_with(END_AGENT) {
                        agent.kill();
                        ended = true;
                    } else if ended && text.starts_with(LINK_DOWN) {
                        ended = false;
                        (agent, _) = self.agent(&line, &address)?;
                    } else if let (true, Some(look)) = (text.starts_with(LOOK), self.look) {
                        looked = look(self)?;
                    }
                    said.push_str(&text);
                }
                Err(mpsc::RecvTimeoutError::Disconnected) => break,
                Err(mpsc::RecvTimeoutError::Timeout) => {
                    drop(board); // then it has said all
                    said.extend(output.iter());
                    let limit = PATIENCE.as_secs();
                    ping.end().ok();
                    let counted = std::fs::read_to_string(&totals).unwrap_or_default();
                    return Err(format!(
                        "{words:?} {NO_END} within {limit} s; the board said:\n{said}\nping \
                         counted:\n{counted}"
                    ));
                }
            }
        }
        let text = said;
        let status = board.child.wait().map_err(|e| e.to_string())?;
        ping.end()?;
        drop(agent);
        if !status.success() {
            return Err(format!("the image failed on {words:?}:\n{text}"));
        }
        let json = |text: &str| {
            let lines = text.lines().filter(|l| !l.starts_with('#'));
            let all = lines.collect::<Vec<_>>().join("\n");
            serde_json::from_str(&all).map_err(|e| format!("{e} in:\n{text}"))
        };
        let counted = std::fs::read_to_string(&totals).map_err(|e| format!("ping: {e}"))?;
        std::fs::remove_file(&totals).ok();
        Ok(Run {
            board: json(&text)?,
            ping: json(&counted)?,
            looked,
        })
    }

    /// The board, the lines that it will print, and the device of its serial line.
    fn boot(&self, words: &[String]) -> Outcome<(Part, mpsc::Receiver<String>, String)> {
        let mut command = qemu::command(&self.image, words, self.look.is_some());
        let mut board = Part::start(
            "qemu-system-arm",
            command.args(["-serial", "pty"]).stderr(Stdio::piped()), // where semihosting prints
        )?;
        let stderr = board.child.stderr.take().ok_or("QEMU has no errors")?;
        let stdout = board.child.stdout.take().ok_or("QEMU has no output")?;
        let mut stdout = BufReader::new(stdout);
        let mut first = String::new();
        stdout.read_line(&mut first).map_err(|e| e.to_string())?;
        let line = first
            .split_whitespace()
            .find(|word| word.starts_with("/dev/"))
            .ok_or_else(|| format!("QEMU did not say where its serial line is: {first}"))?
            .to_string();
        let (tell, output) = mpsc::channel();
        std::thread::spawn(move || {
            for text in BufReader::new(stderr).lines().map_while(Result::ok) {
                tell.send(text + "\n").ok();
            }
            let mut text = String::new();
            stdout.read_to_string(&mut text).ok();
            tell.send(text).ok();
        });
        Ok((board, output, line))
    }

    /// An agent on the serial line and on `udp`, and the address that it got there.
    fn agent(&self, line: &str, udp: &str) -> Outcome<(Part, String)> {
        let mut agent = self.replenish();
        // The baud rate of a pseudo terminal means nothing; the agent paces itself by it.
        agent.args(["agent", "--supervised", "--udp", udp, "--serial", line]);
        let mut agent = Part::start("agent", agent.args(["--baud", "921600"]))?;
        let stdout = agent.child.stdout.take().ok_or("the agent has no output")?;
        let mut stdout = BufReader::new(stdout);
        let mut ready = String::new();
        stdout.read_line(&mut ready).map_err(|e| e.to_string())?;
        let address = serde_json::from_str::<Value>(&ready)
            .ok()
            .and_then(|event| Some(event.get("address")?.as_str()?.to_string()))
            .ok_or_else(|| format!("the agent did not start on {line}: {ready}"))?;
        std::thread::spawn(move || std::io::copy(&mut stdout, &mut std::io::sink()));
        Ok((agent, address))
    }
}

/// The directory of the recordings of this run; the caller that asked for them removes it.
pub(crate) fn live() -> PathBuf {
    format!("/dev/shm/replenish-board-{}", std::process::id()).into()
}

/// A file for what a part of this run has to say.
pub(crate) fn scratch(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("replenish-{name}-{}", std::process::id()))
}

/// A child process: it should end when its input closes, and is killed otherwise.
struct Part {
    name: &'static str,
    child: Child,
    input: Option<ChildStdin>,
}

impl Part {
    fn start(name: &'static str, command: &mut Command) -> Outcome<Self> {
        let command = command.stdin(Stdio::piped());
        if name != "ping" {
            command.stdout(Stdio::piped());
        }
        let mut child = command.spawn().map_err(|e| format!("{name}: {e}"))?;
        let input = child.stdin.take();
        Ok(Self { name, child, input })
    }

    /// Ends it without a word.
    fn kill(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }

    /// Tells it to end and waits until it has.
    fn end(&mut self) -> Outcome {
        self.input = None;
        let until = Instant::now() + Duration::from_secs(5);
        while Instant::now() < until {
            match self.child.try_wait() {
                Ok(Some(status)) if status.success() => return Ok(()),
                Ok(Some(status)) => return Err(format!("{}: {status}", self.name)),
                Ok(None) => std::thread::sleep(Duration::from_millis(5)),
                Err(e) => return Err(format!("{}: {e}", self.name)),
            }
        }
        Err(format!("{} did not end", self.name))
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        let board = self.name.starts_with("qemu"); // it does not listen to its input
        if board || self.end().is_err() {
            self.kill();
        }
    }
}
