//! The examples as programs: the paper's Figure 3, a deployment file, and no privilege.

use replenish_testkit::harness::{Trial, rt_trial, trial};
use std::path::PathBuf;
use std::process::{Command, Stdio};

fn example(name: &str) -> PathBuf {
    let test = std::env::current_exe().unwrap();
    test.parent().unwrap().join("../examples").join(name)
}

/// The answers of a `pong` on the last CPU in 100 ms: of `high` and of `low`.
fn answers(pong: &str, seconds: f64, overlay: Option<&str>) -> (f64, f64) {
    let all = replenish_os::affinity(replenish_os::current_tid()).unwrap();
    let (first, last) = (all.iter().next().unwrap(), all.iter().last().unwrap());
    // Every thread has a real-time priority, so that other programs take nothing of the CPU: the
    // ping above all, the middleware's threads like `low`, below every budget.
    let domain = replenish_testkit::domain::domain().to_string();
    let on = |cpu: usize, priority: u8, program: &str, seconds: f64| {
        let mut command = Command::new("chrt");
        command.args([
            "--fifo",
            &priority.to_string(),
            "taskset",
            "-c",
            &cpu.to_string(),
        ]);
        command.arg(example(program)).arg(seconds.to_string());
        command.env("ROS_DOMAIN_ID", &domain);
        command
    };
    let mut command = on(last, 20, pong, seconds + 3.0);
    command.env("REPLENISH_LEDGER", "off");
    if let Some(overlay) = overlay {
        command.env("REPLENISH_OVERLAY", overlay);
    }
    let mut running = command.stdout(Stdio::null()).spawn().unwrap();
    std::thread::sleep(std::time::Duration::from_secs(1)); // they find each other
    let output = on(first, 60, "ping", seconds).output().unwrap();
    assert!(running.wait().unwrap().success());
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{text}");
    eprint!("{pong}: {text}");
    let words: Vec<&str> = text.split_whitespace().collect();
    let of = |name: &str| -> f64 {
        let place = words.iter().position(|word| *word == name).unwrap();
        words[place + 1].parse().unwrap()
    };
    let tenths = of("elapsed_ns") / 100e6;
    (of("high") / tenths, of("low") / tenths)
}

/// Stock rclrs shares the CPU. With 30 ms in every 100 ms `high` answers three messages in each
/// period, and `low` gets the rest; with the deployment file's 10 ms it is one message.
fn figure_3() {
    let overlay = std::env::temp_dir().join(format!("figure-{}.toml", std::process::id()));
    let worker =
        "[[worker]]\nname = \"high\"\nguarantee = { budget = \"10 ms\", period = \"100 ms\" }\n";
    std::fs::write(&overlay, worker).unwrap();
    let overlay = overlay.to_str().unwrap().to_owned();
    let as_planned = (0..3).any(|_| {
        let (stock_high, stock_low) = answers("stock", 4.0, None);
        let (high, low) = answers("budgets", 4.0, None);
        let (less, more) = answers("budgets", 4.0, Some(&overlay));
        // A budget is an upper bound in every run; one message more is begun in the background.
        assert!(high <= 3.4 && less <= 1.4, "{high} {less}");
        // The rest depends on what else runs on the machine.
        stock_high > 0.5 * stock_low
            && stock_low > 0.5 * stock_high
            && high >= 2.5
            && less >= 0.8
            && low > stock_low
            && more > low
    });
    std::fs::remove_file(overlay).unwrap();
    assert!(as_planned, "no run in three came out as planned");
}

/// The page says so.
fn three_lines() {
    let code = |text: &'static str| text.lines().filter(|line| !line.starts_with("//"));
    let stock: Vec<&str> = code(include_str!("../../examples/stock.rs")).collect();
    let budgets = code(include_str!("../../examples/budgets.rs"));
    let other: Vec<&str> = budgets.filter(|line| !stock.contains(line)).collect();
    assert_eq!(other.len(), 3, "{other:#?}");
}

/// Without the privilege, and with a file that cannot be meant, the program ends and says why.
fn refusals() {
    let words = ["--bounding-set=-all", "--inh-caps=-all", "--reuid=65534"];
    let mut command = Command::new("setpriv");
    command.args(words).arg("--clear-groups").arg("--");
    // rclrs makes a folder for its log before anything else.
    let log = std::env::temp_dir().join(format!("ros-log-{}", std::process::id()));
    command.env("ROS_LOG_DIR", &log);
    let output = command.arg(example("budgets")).output().unwrap();
    std::fs::remove_dir_all(&log).ok();
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success());
    assert!(
        text.contains("NotPermitted") && text.contains("setcap"),
        "{text}"
    );
}

fn missing_file() {
    let mut command = Command::new(example("budgets"));
    command.env("REPLENISH_OVERLAY", "/nowhere/budgets.toml");
    let output = command.output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success());
    assert!(text.contains("/nowhere/budgets.toml"), "{text}");
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        rt_trial("3_beside_stock_rclrs", figure_3),
        trial("differs_in_three_lines", three_lines),
        trial("without_privilege", refusals),
        rt_trial("with_a_file_that_is_not_there", missing_file),
    ]
}
