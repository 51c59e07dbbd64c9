//! The measurements of the paper's authors, replayed.
//!
//! The data: apache/nuttx issue 2935 (2021) and the comment in the demo's source, 44 rows in four
//! experiments, CPU time in ms of busy threads in 10 s, tick 1 ms, period 100 ms, `max_repl` 100.
//! Two facts about the runs are unknown, and therefore free here: how many ticks before the
//! measurement began each sporadic thread had been created ([`SKEWS`]), and how long a
//! "millisecond" of the calibrated busy loop really took ([`CALIBRATION`], one factor for all
//! rows).

use super::{Kernel, NuttxPolicy, NuttxThread, Program};

/// Ticks from the creation of a sporadic thread to the start of the measurement that are tried.
pub const SKEWS: core::ops::RangeInclusive<u32> = 0..=6;

/// Busy-loop milliseconds per simulated millisecond, in thousandths.
pub const CALIBRATION: u64 = 991;

/// The file as it came, comments included.
const DATA: &str = include_str!("../../data/nuttx-issue-2935.csv");

const TICK: u64 = 1_000_000;
const WINDOW: u32 = 10_000;

/// The two historic bugs, each switched on or off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bugs {
    /// The ready list is not kept sorted (until NuttX 9.0).
    pub stale_ready_list: bool,
    /// The credit is computed with the wrong sign (until NuttX 10.1).
    pub reversed_subtraction: bool,
}

impl Bugs {
    /// The kernel of the paper.
    pub const BOTH: Self = Self {
        stale_ready_list: true,
        reversed_subtraction: true,
    };
    /// NuttX 10.1 and later.
    pub const NONE: Self = Self {
        stale_ready_list: false,
        reversed_subtraction: false,
    };
}

/// One row: what was measured and what the model says. Threads in the order S1, S2 (not in
/// experiment 1), FIFO.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Row {
    /// 1 to 4, see the head of the data file.
    pub experiment: u32,
    /// The budget that was varied, in ms of 100 ms.
    pub swept_budget_ms: u32,
    /// Measured by the paper's authors.
    pub measured_ms: Vec<u64>,
    /// Simulated, with the skews that fit best.
    pub simulated_ms: Vec<u64>,
    /// The skews, in ticks, of S1 and S2.
    pub skew_ticks: Vec<u32>,
}

impl Row {
    /// The largest difference in a column, in ms.
    pub fn worst_difference(&self) -> u64 {
        let pairs = self.measured_ms.iter().zip(&self.simulated_ms);
        pairs.map(|(m, s)| m.abs_diff(*s)).max().unwrap_or(0)
    }

    /// The sum of the differences of all columns, in ms.
    pub fn total_difference(&self) -> u64 {
        let pairs = self.measured_ms.iter().zip(&self.simulated_ms);
        pairs.map(|(m, s)| m.abs_diff(*s)).sum()
    }
}

/// All 44 rows, simulated with these bugs. Takes some seconds: every skew is tried.
pub fn replay(bugs: Bugs) -> Vec<Row> {
    let lines = DATA.lines().filter(|line| !line.starts_with(['#', 'e']));
    lines.filter_map(|line| replay_line(line, bugs)).collect()
}

fn replay_line(line: &str, bugs: Bugs) -> Option<Row> {
    let mut fields = line.split(',');
    let experiment = fields.next()?.parse().ok()?;
    let swept_budget_ms = fields.next()?.parse().ok()?;
    let measured_ms: Vec<u64> = fields.filter_map(|field| field.parse().ok()).collect();
    let sporadic = sporadic_threads(experiment, swept_budget_ms);
    let all = || SKEWS;
    let seconds = || if sporadic.len() > 1 { all() } else { 0..=0 };
    let tries = all().flat_map(|first| seconds().map(move |second| [first, second]));
    let fits = tries.map(|skews| {
        let skews = &skews[..sporadic.len()];
        Row {
            experiment,
            swept_budget_ms,
            measured_ms: measured_ms.clone(),
            simulated_ms: simulate_row(&sporadic, skews, bugs),
            skew_ticks: skews.to_vec(),
        }
    });
    fits.min_by_key(Row::total_difference)
}

/// (high, low, budget in ticks).
fn sporadic_threads(experiment: u32, swept: u32) -> Vec<(u8, u8, u32)> {
    match experiment {
        1 => vec![(180, 20, swept)],
        2 => vec![(180, 20, swept), (179, 19, 30)],
        3 => vec![(180, 20, 30), (179, 19, swept)],
        _ => vec![(180, 20, swept), (180, 20, 30)],
    }
}

/// CPU times in ms of the busy loop, S1, S2, FIFO.
fn simulate_row(sporadic: &[(u8, u8, u32)], skews: &[u32], bugs: Bugs) -> Vec<u64> {
    let start = *SKEWS.end();
    let mut threads: Vec<_> = sporadic
        .iter()
        .zip(skews)
        .map(|(&(high, low, budget), skew)| NuttxThread {
            policy: NuttxPolicy::Sporadic {
                high,
                low,
                budget,
                period: 100,
                max_repl: 100,
            },
            program: Program::Busy,
            created: start - skew,
        })
        .collect();
    threads.push(NuttxThread {
        policy: NuttxPolicy::Fifo(120),
        program: Program::Busy,
        created: start,
    });
    threads.push(NuttxThread {
        policy: NuttxPolicy::Fifo(255),
        program: Program::Until(start),
        created: 0,
    });
    let mut kernel = Kernel::new(TICK, &threads)
        .with_stale_ready_list(bugs.stale_ready_list)
        .with_reversed_subtraction(bugs.reversed_subtraction);
    kernel.run_until(start);
    let used = |kernel: &Kernel, id| kernel.cpu(id).0;
    let before: Vec<_> = (0..=sporadic.len()).map(|id| used(&kernel, id)).collect();
    kernel.run_until(start + WINDOW);
    let spent = before.iter().enumerate();
    spent
        .map(|(id, before)| (used(&kernel, id) - before) * CALIBRATION / 1000 / 1_000_000)
        .collect()
}

/// CPU time at high priority of a thread with 30 of 100 ms beside one with `budget_ms`, in 100 s,
/// tick 10 ms, on a kernel without the bugs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fixed {
    /// The budget of the other thread.
    pub budget_ms: u32,
    /// Measured by NuttX's author after the fixes (issue 2935).
    pub measured_ms: u64,
    /// Simulated, both threads created in the same tick; nothing is fitted.
    pub simulated_ms: u64,
}

/// Six replayed measurements of a kernel without the bugs: the thread still misses its budget.
pub fn after_the_fixes() -> Vec<Fixed> {
    let measured = [
        (0, 41_749),
        (10, 41_745),
        (20, 8_351),
        (30, 0),
        (40, 41_733),
        (50, 41_725),
    ];
    let rows = measured.into_iter().map(|(budget_ms, measured_ms)| Fixed {
        budget_ms,
        measured_ms,
        simulated_ms: simulate_fixed(budget_ms),
    });
    rows.collect()
}

fn simulate_fixed(budget_ms: u32) -> u64 {
    const CREATED: u32 = 1;
    let sporadic = |high, low, budget_ms| NuttxThread {
        policy: NuttxPolicy::Sporadic {
            high,
            low,
            budget: budget_ms / 10,
            period: 10,
            max_repl: 100,
        },
        program: Program::Busy,
        created: CREATED,
    };
    let fifo = |priority, program| NuttxThread {
        policy: NuttxPolicy::Fifo(priority),
        program,
        created: 0,
    };
    let mut kernel = Kernel::new(
        10 * TICK,
        &[
            sporadic(180, 20, budget_ms),
            sporadic(179, 19, 30),
            fifo(120, Program::Busy),
            fifo(255, Program::Until(CREATED)),
        ],
    );
    kernel.run_until(CREATED + 10_000);
    kernel.cpu(1).1 / 1_000_000
}
