//! `top --once`: the table and the JSON, with counts since the start of each program.

use crate::live::{Boards, ChainJson, Found, Program, all, boards};
use crate::report::table::Table;
use crate::time::Nanos;
use replenish_recorder::{Role, ThreadView};

/// One worker. The names are a contract.
#[derive(Debug, serde::Serialize)]
struct WorkerJson {
    name: String,
    tid: u64,
    /// The CPU that it is pinned to.
    cpu: Option<u64>,
    /// As the kernel granted it.
    policy: String,
    budget_ns: Option<Nanos>,
    period_ns: Option<Nanos>,
    /// CPU time so far, at both levels. Of a worker without a budget, as of its last reading.
    used_ns: Nanos,
    /// The part of it at the low level.
    background_ns: Nanos,
    available_ns: Option<Nanos>,
    /// `high` or `background`.
    level: Option<&'static str>,
    exhaustions: u64,
    replenishments: u64,
}

/// One program. The names are a contract.
#[derive(Debug, serde::Serialize)]
struct ProgramJson {
    program: String,
    /// In its own pid namespace.
    pid: u32,
    alive: bool,
    file: String,
    /// Dumps that it has written, and triggers that got none.
    dumps: u64,
    dumps_suppressed: u64,
    workers: Vec<WorkerJson>,
    /// Since its start.
    chains: Vec<ChainJson>,
}

/// `top --json`. The names are a contract.
#[derive(Debug, serde::Serialize)]
pub(super) struct Json {
    programs: Vec<ProgramJson>,
    /// The agents that run here, with their clients.
    agents: Vec<Boards>,
    /// Files that were left out, and why.
    warnings: Vec<String>,
}

impl WorkerJson {
    fn of(thread: &ThreadView) -> Self {
        let totals = thread.totals;
        let budget = thread.budget;
        let level = if totals.is_low { "background" } else { "high" };
        Self {
            name: thread.name.clone(),
            tid: thread.tid,
            cpu: thread.cpu,
            policy: thread.policy.clone(),
            budget_ns: budget.map(|(budget, _)| budget),
            period_ns: budget.map(|(_, period)| period),
            used_ns: totals.high.saturating_add(totals.low),
            background_ns: totals.low,
            available_ns: budget.map(|_| totals.available),
            level: budget.map(|_| level),
            exhaustions: totals.exhaustions,
            replenishments: totals.replenishments,
        }
    }
}

impl ProgramJson {
    fn of(program: &Program) -> Self {
        let view = &program.view;
        let workers = view.threads.iter().filter(|t| t.role == Role::Worker);
        Self {
            program: view.program.clone(),
            pid: view.pid,
            alive: program.alive,
            file: program.path.display().to_string(),
            dumps: view.dumps,
            dumps_suppressed: view.dumps_suppressed,
            workers: workers.map(WorkerJson::of).collect(),
            chains: view.chains.iter().map(ChainJson::of).collect(),
        }
    }
}

impl Json {
    /// Every program that runs; with `ended`, the others, too.
    pub(super) fn look(ended: bool) -> Self {
        let Found {
            programs,
            mut warnings,
        } = all();
        let (agents, left_out) = boards();
        warnings.extend(left_out);
        let shown = programs.iter().filter(|p| p.alive || ended);
        Self {
            programs: shown.map(ProgramJson::of).collect(),
            agents,
            warnings,
        }
    }
}

pub(super) fn print(json: &Json) {
    let mut table = Table::new(&[
        "program",
        "pid",
        "worker",
        "cpu",
        "policy",
        "budget ms",
        "period ms",
        "left ms",
        "level",
        "used ms",
        "exhausted",
    ]);
    let ms = |ns: Nanos| format!("{:.3}", ns as f64 / 1e6);
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".into());
    for program in &json.programs {
        let state = if program.alive { "" } else { " (ended)" };
        let name = format!("{}{state}", program.program);
        for worker in &program.workers {
            table.row([
                name.clone(),
                program.pid.to_string(),
                worker.name.clone(),
                or_dash(worker.cpu.map(|cpu| cpu.to_string())),
                worker.policy.clone(),
                or_dash(worker.budget_ns.map(ms)),
                or_dash(worker.period_ns.map(ms)),
                or_dash(worker.available_ns.map(ms)),
                or_dash(worker.level.map(Into::into)),
                ms(worker.used_ns),
                worker.exhaustions.to_string(),
            ]);
        }
    }
    if json.programs.is_empty() {
        println!("No program of replenish runs here, or this account may not read its recording.");
    } else {
        print!("{}", table.to_text());
    }
    if json
        .programs
        .iter()
        .any(|program| !program.chains.is_empty())
    {
        print!("\n{}", of_chains(&json.programs).to_text());
    }
    if json.agents.iter().any(|agent| !agent.boards.is_empty()) {
        print!("\n{}", of_boards(&json.agents).to_text());
    }
    json.warnings.iter().for_each(|w| println!("  {w}"));
}

/// A row for each chain of a program.
fn of_chains(programs: &[ProgramJson]) -> Table {
    let mut table = Table::new(&[
        "chain", "program", "pid", "limit ms", "bound ms", "ended", "exceeded", "p99 ms",
        "worst ms",
    ]);
    let ms = |ns: Nanos| format!("{:.3}", ns as f64 / 1e6);
    let or_dash = |time: Option<Nanos>| time.map_or("-".into(), ms);
    for program in programs {
        for chain in &program.chains {
            table.row([
                chain.name.clone(),
                program.program.clone(),
                program.pid.to_string(),
                or_dash(chain.limit_ns),
                or_dash(chain.bound_ns),
                format!("{} of {}", chain.ended, chain.begun),
                chain.exceeded.to_string(),
                ms(chain.latency_ns.p99),
                or_dash(chain.worst.as_ref().map(|worst| worst.latency_ns)),
            ]);
        }
    }
    table
}

/// A row for each client of an agent.
fn of_boards(agents: &[Boards]) -> Table {
    let mut table = Table::new(&[
        "board",
        "key",
        "peer",
        "agent",
        "heard s ago",
        "in/s",
        "out/s",
        "drops",
        "recording",
    ]);
    for agent in agents {
        for board in &agent.boards {
            let recording = board.recording.as_ref();
            table.row([
                board.name.clone(),
                board.key.clone(),
                board.peer.clone(),
                format!("{} at {}", agent.agent_pid, agent.agent),
                format!("{:.1}", board.silent_ns as f64 / 1e9),
                format!("{:.1}", board.in_per_s),
                format!("{:.1}", board.out_per_s),
                board.drops.to_string(),
                recording.map_or("-".into(), |r| format!("{} events", r.events)),
            ]);
        }
    }
    table
}
