//! A program that records what it does, for the commands that look at it: this very test binary,
//! started again.

use crate::common::{json, stderr};
use replenish::msg::std_msgs::Int32;
use replenish::{Budget, Context, Executor, Mark, Qos};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const CHILD: &str = "REPLENISH_RECORDED_CHILD";
const MS: Duration = Duration::from_millis(1);

/// Whether this process was started to be that program.
pub(crate) fn is_this() -> bool {
    std::env::var_os(CHILD).is_some()
}

/// The program: three workers, one of which exhausts its budget, until it is killed.
pub(crate) fn program() {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let mut exec = Executor::new(&ctx);
    exec.no_ledger().admission(false).on_event(|_| ());
    exec.worker("source")
        .timer(MS, move |_| out.publish(&Int32 { data: 1 }))
        .unwrap()
        .timer(50 * MS, |_| ())
        .unwrap();
    exec.chain("pipe", ["source/timer:0", "sink"], 5 * MS);
    let mark = Mark::new("in the sink");
    exec.worker("sink")
        .subscribe(&node, "t", Qos::reliable(), move |_: &Int32, cx| {
            cx.mark(mark, 7);
        })
        .unwrap();
    exec.worker("hungry")
        .budget(Budget::of(2 * MS).every(20 * MS))
        .timer(10 * MS, |_| {
            let begin = Instant::now();
            while begin.elapsed() < 6 * MS {}
        })
        .unwrap();
    exec.spin().unwrap();
}

/// A directory in memory with that program.
pub(crate) struct Program {
    directory: PathBuf,
    pub(crate) child: Child,
}

impl Program {
    pub(crate) fn start(name: &str) -> Self {
        let directory = format!("/dev/shm/replenish-cli-{name}-{}", std::process::id());
        let directory = PathBuf::from(directory);
        std::fs::create_dir(&directory).unwrap();
        let child = Command::new(std::env::current_exe().unwrap())
            .args([
                "--exact",
                "live::the_program_that_is_looked_at",
                "--ignored",
            ])
            .env(CHILD, "1")
            .env("REPLENISH_LIVE", &directory)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        Self { directory, child }
    }

    pub(crate) fn command(&self, args: &[&str]) -> Output {
        let mut command = Command::new(crate::common::BIN);
        let command = command.args(args).env("REPLENISH_LIVE", &self.directory);
        command.output().unwrap()
    }

    pub(crate) fn top(&self, out: &Path) -> serde_json::Value {
        let out = out.to_str().unwrap();
        let output = self.command(&["top", "--once", "--ended", "--json", out]);
        assert!(output.status.success(), "{}", stderr(&output));
        json(Path::new(out))
    }

    /// Waits until the budget has been exhausted a few times.
    pub(crate) fn wait(&self, out: &Path) -> serde_json::Value {
        let end = Instant::now() + Duration::from_secs(60);
        loop {
            let top = self.top(out);
            let workers = &top["programs"][0]["workers"];
            if workers[2]["exhaustions"].as_u64().unwrap_or(0) >= 3 {
                return top;
            }
            assert!(Instant::now() < end, "{top:#}");
            std::thread::sleep(20 * MS);
        }
    }

    pub(crate) fn directory(&self) -> &Path {
        &self.directory
    }

    pub(crate) fn file(&self) -> PathBuf {
        let mut entries = std::fs::read_dir(&self.directory).unwrap();
        entries.next().unwrap().unwrap().path()
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
        std::fs::remove_dir_all(&self.directory).ok();
    }
}
