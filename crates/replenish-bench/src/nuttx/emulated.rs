//! The measurements on NuttX under QEMU, replayed.
//!
//! The machine is an emulated Olimex E407 with counted instructions. The data are three files of
//! rows: bursts of 10 ms done in 10 s.
//!
//! The measuring programs are known by their output alone. Free here are, per row, how long before
//! the measurement the sporadic threads had been created ([`Row::skew_ticks`]), one calibration per
//! tick length, what a 10 ms burst really takes, from the rows with FIFO only, and one for all
//! rows: what a tick costs a sporadic thread more than a FIFO thread, from the CPU times of
//! experiment 1. NuttX 10.0 has the reversed subtraction, "master" (2026-08) neither historic bug.

use super::{Kernel, NuttxPolicy, NuttxThread, Program};
use sporadic::Nanos;

const EXPERIMENT_1: &str = include_str!("../../data/nuttx-qemu-experiment1.csv");
const EXPERIMENT_2: &str = include_str!("../../data/nuttx-qemu-experiment2.csv");
const TWO_THREADS: &str = include_str!("../../data/nuttx-qemu-two-threads.csv");

/// The length of the measurement, less the first round of messages.
const WINDOW: Nanos = 9_990_000_000;

/// One row of one file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Row {
    /// The row's parameters, as in the file.
    pub setup: String,
    /// Bursts done, one number per thread, measured under QEMU.
    pub measured: Vec<u64>,
    /// Bursts done, simulated, with the skews that fit best.
    pub simulated: Vec<u64>,
    /// Ticks from the creation of each sporadic thread to the start of the measurement.
    pub skew_ticks: Vec<u32>,
}

impl Row {
    /// The largest difference of a thread, in bursts.
    pub fn worst_difference(&self) -> u64 {
        let pairs = self.measured.iter().zip(&self.simulated);
        pairs.map(|(m, s)| m.abs_diff(*s)).max().unwrap_or(0)
    }
}

/// Experiment 1 of the paper: H sporadic with B of 100 ms (or FIFO) above a busy FIFO thread L.
/// Skews of up to 40 ticks are tried: 40 ms, and at least a period at the tick of 10 ms.
pub fn experiment_1() -> Vec<Row> {
    let rows = EXPERIMENT_1.lines().skip(1).filter_map(|line| {
        let field: Vec<&str> = line.split(',').collect();
        let tick_us = number(&field, 1)?;
        let budget_ms = number(&field, 4)?;
        let machine = Machine {
            tick_us,
            reversed: field.first()?.starts_with("nuttx10"),
            window: WINDOW,
        };
        let policy = match *field.get(3)? {
            "FIFO" => NuttxPolicy::Fifo(60),
            _ => machine.sporadic(60, 6, budget_ms),
        };
        let skews = (0..=(40_000 / tick_us).clamp(11, 40)).map(|skew| vec![skew]);
        Some(Row::best(
            field.get(..5)?.join(","),
            vec![number(&field, 5)?.into(), number(&field, 6)?.into()],
            skews,
            |skews| machine.bursts(&[(policy, skews[0])], Some(Program::Busy)),
        ))
    });
    rows.collect()
}

/// Experiment 2 of the paper: H sporadic with 30 of 100 ms, L runs and sleeps. H also runs at its
/// low priority. The second number counts L's cycles. Skews of up to 5 ms are tried.
pub fn experiment_2() -> Vec<Row> {
    let rows = EXPERIMENT_2.lines().skip(1).filter_map(|line| {
        let field: Vec<&str> = line.split(',').collect();
        let (tick_us, cycle_us, sleep) =
            (number(&field, 1)?, number(&field, 2)?, number(&field, 3)?);
        let machine = Machine {
            tick_us,
            reversed: field.first()?.starts_with("nuttx10"),
            window: WINDOW,
        };
        let run = Nanos::from(cycle_us * (100 - sleep) / 100) * machine.burst() / 10_000;
        let low = Program::Cycle {
            run,
            sleep: (cycle_us * sleep / 100).div_ceil(tick_us),
        };
        let policy = machine.sporadic(60, 6, 30);
        let skews = (0..=5_000 / tick_us).map(|skew| vec![skew]);
        Some(Row::best(
            field.get(..4)?.join(","),
            vec![number(&field, 4)?.into(), number(&field, 5)?.into()],
            skews,
            |skews| machine.bursts(&[(policy, skews[0])], Some(low)),
        ))
    });
    rows.collect()
}

/// Two sporadic threads, S1 above S2, S2 created `phase_us` after S1, and in most rows a busy FIFO
/// thread between their high and low priorities.
///
/// Tried are creations of S2 within `tolerance` ticks of what the row says, and up to 23 ms from
/// there to the start of the measurement, which the file does not record.
pub fn two_threads(tolerance: u32) -> Vec<Row> {
    let rows = TWO_THREADS.lines().skip(1).filter_map(|line| {
        let field: Vec<&str> = line.split(',').collect();
        let machine = Machine {
            tick_us: number(&field, 0)?,
            reversed: false,
            window: WINDOW,
        };
        let first = machine.sporadic(60, 6, number(&field, 1)?);
        let second = machine.sporadic(59, 5, number(&field, 2)?);
        let phase = number(&field, 3).unwrap_or(0) / 1000;
        let with_low = *field.get(4)? == "1";
        let measured = (5..8).filter_map(|at| number(&field, at).map(u64::from));
        let phases = phase.saturating_sub(tolerance)..=phase + tolerance;
        let skews = phases.flat_map(|apart| (0..=23).map(move |skew| vec![skew + apart, skew]));
        Some(Row::best(
            field.get(..5)?.join(","),
            measured.collect(),
            skews,
            |skews| {
                let threads = [(first, skews[0]), (second, skews[1])];
                machine.bursts(&threads, with_low.then_some(Program::Busy))
            },
        ))
    });
    rows.collect()
}

fn number(fields: &[&str], at: usize) -> Option<u32> {
    fields.get(at)?.parse().ok()
}

impl Row {
    fn best(
        setup: String,
        measured: Vec<u64>,
        skews: impl Iterator<Item = Vec<u32>>,
        simulate: impl Fn(&[u32]) -> Vec<u64>,
    ) -> Self {
        let mut best = Self {
            setup,
            measured,
            simulated: Vec::new(),
            skew_ticks: Vec::new(),
        };
        let mut least = u64::MAX;
        for skew_ticks in skews {
            let simulated = simulate(&skew_ticks);
            let pairs = best.measured.iter().zip(&simulated);
            let difference = pairs.map(|(m, s)| m.abs_diff(*s).pow(2)).sum();
            if difference < least {
                least = difference;
                best.simulated = simulated;
                best.skew_ticks = skew_ticks;
            }
            if least == 0 {
                break;
            }
        }
        best
    }
}

struct Machine {
    tick_us: u32,
    reversed: bool,
    window: Nanos,
}

impl Machine {
    /// CPU time of a burst of "10 ms".
    ///
    /// The rows with FIFO only give it: 998 bursts in 10 s (994 at the 10 ms tick).
    fn burst(&self) -> Nanos {
        if self.tick_us == 10_000 {
            10_060_000
        } else {
            10_017_000
        }
    }

    /// CPU time of a burst of a sporadic thread beyond that of a FIFO thread.
    ///
    /// In each tick the kernel counts the slot of the sporadic thread as well, for 280 ns: with a
    /// budget of half the period and a tick of 0.1 ms, 14 ms of 10 s are missing in the file, which
    /// are 50 000 ticks of that thread.
    fn sporadic_cost(&self) -> Nanos {
        Nanos::from(10_000 / self.tick_us) * 280
    }

    fn sporadic(&self, high: u8, low: u8, budget_ms: u32) -> NuttxPolicy {
        NuttxPolicy::Sporadic {
            high,
            low,
            budget: (budget_ms * 1000).div_ceil(self.tick_us),
            period: 100_000 / self.tick_us,
            max_repl: 100,
        }
    }

    /// Bursts done by busy threads with these policies and skews, and then by a FIFO thread with
    /// this program (whole cycles, if it has such).
    fn bursts(&self, threads: &[(NuttxPolicy, u32)], low: Option<Program>) -> Vec<u64> {
        let start = 1 + threads.iter().map(|&(_, skew)| skew).max().unwrap_or(0);
        let busy = threads.iter().map(|&(policy, skew)| NuttxThread {
            policy,
            program: Program::Busy,
            created: start - skew,
        });
        let low = low.map(|program| NuttxThread {
            policy: NuttxPolicy::Fifo(50),
            program,
            created: start,
        });
        let harness = NuttxThread {
            policy: NuttxPolicy::Fifo(255),
            program: Program::Until(start),
            created: 0,
        };
        let mut all: Vec<_> = busy.chain(low).collect();
        let counted = all.len();
        all.push(harness);
        let tick = Nanos::from(self.tick_us) * 1000;
        let mut kernel = Kernel::new(tick, &all).with_reversed_subtraction(self.reversed);
        // The window is far shorter than 2^32 ticks.
        kernel.run_until(start.saturating_add((self.window / tick) as u32));
        let bursts = (0..counted).map(|id| match all[id].program {
            Program::Cycle { .. } => kernel.cycles(id),
            _ => {
                let sporadic = matches!(all[id].policy, NuttxPolicy::Sporadic { .. });
                let more = if sporadic { self.sporadic_cost() } else { 0 };
                kernel.cpu(id).0 / (self.burst() + more)
            }
        });
        bursts.collect()
    }
}
