//! `top` as a user sees it: on a terminal, with keys, until it is ended one way or the other.

use crate::common::{BIN, Scratch, stderr};
use crate::recorded::Program;
use replenish_os::tty::Pty;
use std::fs::OpenOptions;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const LEAVE: &str = "\x1b[?7h\x1b[?25h\x1b[?1049l";
const MS: Duration = Duration::from_millis(1);

/// A terminal with `top` in it.
struct Screen {
    pty: Pty,
    child: Child,
    /// The output that the command has written so far.
    seen: String,
    /// Keeps the line open when the child has ended.
    _line: std::fs::File,
    settings: String,
}

fn settings(path: &Path) -> String {
    let output = Command::new("stty").arg("-g").arg("-F").arg(path).output();
    let output = output.unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    String::from_utf8(output.stdout).unwrap()
}

impl Screen {
    fn start(program: &Program, scratch: &Scratch, no_color: bool) -> Self {
        let pty = Pty::open().unwrap();
        let open = || {
            let mut options = OpenOptions::new();
            options.read(true).write(true).open(pty.path()).unwrap()
        };
        let line = open();
        let sane = Command::new("stty")
            .arg("-F")
            .arg(pty.path())
            .arg("sane")
            .status();
        assert!(sane.unwrap().success());
        let settings = settings(pty.path());
        let mut command = Command::new(BIN);
        let command = command.args(["top", "--every", "200ms"]);
        if no_color {
            command.env("NO_COLOR", "1");
        } else {
            command.env_remove("NO_COLOR");
        }
        let child = command
            .env("REPLENISH_LIVE", program.directory())
            .current_dir(scratch.path(""))
            .stdin(open())
            .stdout(open())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        Self {
            pty,
            child,
            seen: String::new(),
            _line: line,
            settings,
        }
    }

    fn read(&mut self) {
        let mut buffer = [0; 4096];
        while let Ok(n @ 1..) = self.pty.tty.read(&mut buffer) {
            self.seen.push_str(&String::from_utf8_lossy(&buffer[..n]));
        }
    }

    /// Until `part` stands in what it writes from now on.
    fn wait(&mut self, part: &str) {
        let end = Instant::now() + Duration::from_secs(60);
        while !self.seen.contains(part) {
            assert!(Instant::now() < end, "{part:?} in {:?}", self.seen);
            std::thread::sleep(10 * MS);
            self.read();
        }
    }

    fn press(&mut self, keys: &str) {
        self.read();
        self.seen.clear();
        assert_eq!(self.pty.tty.write(keys.as_bytes()).unwrap(), keys.len());
    }

    /// It has ended, and the terminal is as it was.
    fn ended(mut self) {
        let end = Instant::now() + Duration::from_secs(60);
        while self.child.try_wait().unwrap().is_none() {
            assert!(Instant::now() < end, "it goes on");
            self.read();
            std::thread::sleep(10 * MS);
        }
        self.read();
        assert!(self.seen.ends_with(LEAVE), "{:?}", self.seen);
        assert_eq!(settings(self.pty.path()), self.settings);
        let output = self.child.wait_with_output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
    }
}

#[test]
fn keys_sort_open_a_worker_write_a_trace_and_end_it() {
    let scratch = Scratch::new("top-keys");
    let program = Program::start("top-keys");
    program.wait(&scratch.path("top.json"));
    let mut screen = Screen::start(&program, &scratch, false);
    for part in [
        "replenish top",
        "CPU 0",
        "hungry",
        "reserved",
        "programs without replenish",
        "\x1b[32m",
    ] {
        screen.wait(part);
    }
    screen.press("u");
    screen.wait("sorted by used");
    screen.press("n");
    screen.wait("sorted by name");
    screen.press("\x1b[H\r"); // the first worker
    screen.wait("RESPONSE, from release to end");
    screen.wait("source/timer:0");
    screen.wait("THE LAST SECOND");
    screen.press("\x1b");
    screen.wait("replenish top");
    screen.press("t");
    screen.wait("ui.perfetto.dev");
    let names = std::fs::read_dir(scratch.path("")).unwrap().flatten();
    let mut names = names.map(|entry| entry.file_name().into_string().unwrap());
    assert!(names.any(|name| name.ends_with("-1.pftrace")));
    screen.press("q");
    screen.ended();
}

#[test]
fn signals_give_the_terminal_back_and_no_color_is_heeded() {
    let scratch = Scratch::new("top-signals");
    let program = Program::start("top-signals");
    program.wait(&scratch.path("top.json"));
    for signal in ["TERM", "INT"] {
        let mut screen = Screen::start(&program, &scratch, true);
        screen.wait("hungry");
        screen.wait("reserved");
        for code in 30..38 {
            assert!(!screen.seen.contains(&format!("\x1b[{code}m")));
        }
        let pid = screen.child.id().to_string();
        let kill = Command::new("kill").args(["-s", signal, &pid]).status();
        assert!(kill.unwrap().success());
        screen.ended();
    }
}

#[test]
fn without_a_terminal_it_says_what_is_needed() {
    let output = Command::new(BIN)
        .arg("top")
        .stdin(Stdio::null())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("--once"), "{}", stderr(&output));
}

#[test]
fn a_picture_shows_the_workers() {
    let scratch = Scratch::new("top-picture");
    let program = Program::start("top-picture");
    program.wait(&scratch.path("top.json"));
    for more in [&[][..], &["--worker", "hungry"]] {
        let out = scratch.path("top.svg");
        let mut command = Command::new(BIN);
        let command = command
            .args(["top", "--every", "300ms", "--svg"])
            .arg(&out)
            .args(more);
        let output = command
            .env("REPLENISH_LIVE", program.directory())
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        let svg = std::fs::read_to_string(&out).unwrap();
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n") && svg.contains("hungry"));
    }
}
