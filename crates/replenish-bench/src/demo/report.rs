//! The output of `demo`: JSON, tables, and the page that explains itself.

use crate::load::spec::High;
use crate::report::timeline;
use crate::roles::protocol::{Mode, Overrun, ThreadRow};
use crate::testbench::orchestrator::{Plan, Run};
use crate::testbench::summary::{Summary, Topic, as_f64};
use replenish_cli::outcome::Failure;
use replenish_cli::report::html::Page;
use replenish_cli::report::table::{Table, percent, signed_percent};
use replenish_os::privilege::Privilege;

/// `demo --json`. The names are a contract.
#[derive(Debug, serde::Serialize)]
pub(crate) struct DemoJson<'a> {
    mode: Mode,
    continuous: bool,
    budget_ms: f64,
    period_ms: f64,
    #[serde(flatten)]
    summary: &'a Summary,
    overrun_us: &'a Overrun,
    /// The share that the kernel's RT throttle took; with continuous load only.
    throttled_percent: Option<f64>,
    /// The share that the kernel keeps from real-time threads, if it does.
    throttle_limit_percent: Option<f64>,
    threads: &'a [ThreadRow],
    notes: &'a [String],
}

/// The result as JSON.
pub(crate) fn json<'a>(plan: &Plan, run: &'a Run) -> DemoJson<'a> {
    let (budget, period) = budget(plan);
    DemoJson {
        mode: run.mode,
        continuous: plan.continuous,
        budget_ms: budget,
        period_ms: period,
        summary: &run.summary,
        overrun_us: &run.end.overrun_us,
        throttled_percent: throttled_percent(plan, run),
        throttle_limit_percent: throttle_limit(),
        threads: &run.threads,
        notes: &run.notes,
    }
}

/// Share of a CPU that `kernel.sched_rt_runtime_us` keeps from real-time threads, in percent.
fn throttle_limit() -> Option<f64> {
    let period = replenish_cli::machine::facts::number("/proc/sys/kernel/sched_rt_period_us")?;
    let runtime = replenish_cli::machine::privilege()
        .rt_runtime_us
        .filter(|r| *r >= 0)?;
    Some(100.0 - runtime as f64 * 100.0 / period.max(1) as f64)
}

fn budget(plan: &Plan) -> (f64, f64) {
    let period = as_f64(plan.spec.period) / 1e6;
    (
        budget_percent(plan).unwrap_or(100.0) * period / 100.0,
        period,
    )
}

/// The result for the terminal.
pub(crate) fn text(plan: &Plan, run: &Run) -> String {
    let mut text = format!(
        "\n{}\n{}",
        topics(&run.summary).to_text(),
        details(plan, run)
    );
    text.push_str(&format!("\n{}", threads(&run.threads).to_text()));
    for note in &run.notes {
        text.push_str(&format!("  note: {note}\n"));
    }
    text
}

fn topics(summary: &Summary) -> Table {
    let mut table = Table::new(&[
        "topic",
        "sent",
        "answered",
        "expected",
        "CPU",
        "at its priority",
        "in background",
        "theory",
        "budget error",
    ]);
    for (name, t) in [("high", &summary.high), ("low", &summary.low)] {
        table.row(topic_row(name, t));
    }
    table
}

fn topic_row(name: &str, t: &Topic) -> [String; 9] {
    [
        name.to_string(),
        t.sent.to_string(),
        t.answered.to_string(),
        t.expected.to_string(),
        percent(t.cpu_percent),
        percent(t.high_priority_cpu_percent),
        percent(t.background_cpu_percent),
        percent(t.expected_cpu_percent),
        t.budget_error_percent
            .map_or_else(|| "-".to_string(), signed_percent),
    ]
}

fn details(plan: &Plan, run: &Run) -> String {
    let s = &run.summary;
    let overrun = &run.end.overrun_us;
    let mut lines = vec![if plan.continuous {
        format!("  {} s of continuous load", s.windows)
    } else {
        let repeated = match s.windows_repeated {
            0 => String::new(),
            n => format!(
                "; {n} more did not count, because the machine stood still ({})",
                s.windows_repeated_because
            ),
        };
        let disturbed = match s.windows_disturbed {
            0 => String::new(),
            n => format!("; {n} of them count although the machine stood still: no repeats left"),
        };
        let (windows, length) = (s.windows, s.window_ms);
        format!("  {windows} windows of {length:.0} ms{disturbed}{repeated}")
    }];
    lines.push(format!(
        "  CPU: high + low {}, dispatcher and enforcer {}, unused {}",
        percent(s.high.cpu_percent + s.low.cpu_percent),
        percent(s.support_cpu_percent),
        percent(s.unused_cpu_percent),
    ));
    if overrun.count > 0 {
        lines.push(format!(
            "  Budget overrun: median {:.1} us, p99 {:.1} us of {} exhaustions{}",
            overrun.median,
            overrun.p99,
            overrun.count,
            stalls(overrun)
        ));
    }
    if let Some(taken) = throttled_percent(plan, run) {
        let limit = throttle_limit().map_or_else(|| "nothing".to_string(), percent);
        lines.push(format!(
            "  Taken by the kernel's RT throttle and by others: {} (the throttle keeps {limit} \
             from real-time threads)",
            percent(taken)
        ));
    }
    lines.join("\n") + "\n"
}

fn stalls(overrun: &Overrun) -> String {
    match overrun.stalls.first() {
        None => String::new(),
        Some(worst) => format!(
            "; apart from these, the machine stood still {} times (at worst {worst:.0} us)",
            overrun.stall_count
        ),
    }
}

fn threads(rows: &[ThreadRow]) -> Table {
    let mut table = Table::new(&["thread", "CPU", "requested", "granted"]);
    for t in rows {
        table.row([&t.name, &t.cpu, &t.requested, &t.granted].map(String::as_str));
    }
    table
}

/// One line: what does not hold without real-time priority, and how to get it.
pub(crate) fn not_guaranteed(privilege: &Privilege) -> String {
    let how = if privilege.cap_sys_nice {
        "`replenish doctor` says why it is refused".to_string()
    } else {
        let program = std::env::current_exe().unwrap_or_else(|_| "replenish".into());
        format!(
            "grant CAP_SYS_NICE (sudo setcap cap_sys_nice,cap_ipc_lock+ep {}) or a limit `rtprio 99`; \
             `replenish doctor` shows every way",
            program.display()
        )
    };
    format!(
        "a callback that runs is not interrupted when its budget is used up, and other programs \
         may take the CPU. To get both: {how}"
    )
}

/// The page.
pub(crate) fn html(plan: &Plan, run: &Run, privilege: &Privilege) -> Result<String, Failure> {
    let s = &run.summary;
    let (budget, period) = budget(plan);
    let mut page = Page::new(
        "CPU budgets for ROS callbacks: a demonstration",
        "Measured on this machine by `replenish demo`.",
    );
    page.answer(&format!(
        "Topic high was promised {budget:.0} ms of CPU time in every {period:.0} ms and got {} of \
         the CPU at its high priority. Topic low got {}. Answers to high: {} (theory {}), to low: \
         {} (theory {}).",
        percent(s.high.high_priority_cpu_percent),
        percent(s.low.cpu_percent),
        s.high.answered,
        s.high.expected,
        s.low.answered,
        s.low.expected
    ));
    if run.mode == Mode::Deferred {
        page.warning(&format!(
            "Real-time priority was not granted. Not guaranteed: {}",
            not_guaranteed(privilege)
        ));
    }
    page.heading("What happens here");
    page.text(
        "Three processes talk over the loopback network: ping sends a message on the topics high \
         and low every 10 ms, an agent passes it on, and pong answers. Each answer costs pong 10 ms \
         of CPU time, on one CPU. Both topics together ask for twice what that CPU has.",
    );
    page.text(
        "With plain priorities high would take everything and low would starve. With fair sharing \
         both would get half, whatever they need. A budget says it exactly: the worker thread of \
         high runs at high priority until it has used its budget, then at a background priority \
         until the budget is replenished. An enforcer thread lowers and raises the priority in the \
         middle of a callback, judged by the thread's own CPU clock.",
    );
    if let Some(window) = run.windows.get(run.windows.len() / 2) {
        page.heading("One window: who has the CPU when");
        page.figure(
            &timeline::one_window(window, &run.grid, plan.spec.period)?,
            "Measured. Grey lines are periods of the budget: at each, high gets its time back.",
        );
    }
    page.heading("Every window");
    page.figure(
        &timeline::shares(&run.windows, &run.grid, budget_percent(plan))?,
        "Measured CPU time of both workers; what is missing to 100 % went to the dispatcher, the \
         enforcer, the operating system, and the hypervisor of a virtual machine.",
    );
    page.heading("Numbers");
    page.table(&topics(s));
    for line in details(plan, run).lines() {
        page.text(line.trim());
    }
    page.heading("What the kernel granted");
    page.table(&threads(&run.threads));
    page.heading("Words");
    let load = if plan.continuous {
        "Load is offered all the time and shown per second. Linux stops all real-time threads of a \
         CPU for 50 ms in each second in which they used 95 % of it; theory leaves that out."
    } else {
        "Load is offered for 0.4 s, then there is a pause of 0.1 s, because Linux stops all \
         real-time threads of a CPU for 50 ms in each second in which they used 95 % of it. What is \
         unfinished at the end of a window is discarded."
    };
    page.glossary(&[
        ("answer", "Takes 10 ms of CPU time all in all: 1 % of them is left for receiving and sending, the rest is burnt in the callback."),
        ("expected", "Theory: whole answers that fit into a window. One less per window is normal, because an answer that the window cuts off does not count."),
        ("window", load),
        ("budget error", "CPU time at high priority against the budget, in percent of the budget."),
        ("budget overrun", "CPU time between the instant a budget was used up and the instant the thread was lowered. It is paid back from the next replenishment."),
        ("in background", "CPU time after the budget was used up, when nobody else wanted the CPU."),
    ]);
    let footer = format!(
        "replenish {}; all figures on this page are measured unless they say theory.",
        env!("CARGO_PKG_VERSION")
    );
    Ok(page.finish(&footer))
}

/// The budget as a share of its period; `None` without a budget.
fn budget_percent(plan: &Plan) -> Option<f64> {
    match plan.spec.high {
        High::Sporadic { budget, period, .. } => Some(as_f64(budget) * 100.0 / as_f64(period)),
        High::Fifo => None,
    }
}

/// The CPU time that no thread of pong could use: under continuous load, the RT throttle.
fn throttled_percent(plan: &Plan, run: &Run) -> Option<f64> {
    plan.continuous.then_some(run.summary.unused_cpu_percent)
}
