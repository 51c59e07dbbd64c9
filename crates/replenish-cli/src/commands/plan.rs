//! `replenish plan FILE`: does what a deployment file asks for fit, and how late is anything at
//! worst?
//!
//! Exit code 0: it fits. 1: it does not (or the file makes no sense), with one sentence that says
//! why and what would fit.

use super::host::Host;
use crate::machine::cpus;
use crate::options::JsonOption;
use crate::outcome::{Failure, Outcome};
use crate::report::files;
use crate::report::table::Table;
use replenish_plan::span::Rounded;
use replenish_plan::{CpuLoad, Deployment, Plan, PlannedChain, PlannedExecutor, PlannedWorker};
use replenish_sim::Policy;
use sporadic::Low;
use std::path::PathBuf;

/// Options of `plan`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The deployment file, for example examples/robot/fits.toml.
    #[arg(value_name = "FILE")]
    file: PathBuf,

    /// Print the table only, without the reasons.
    #[arg(long)]
    brief: bool,

    /// Plan as if nothing else ran on this host, and with default overheads.
    #[arg(long)]
    ignore_ledger: bool,

    #[command(flatten)]
    json: JsonOption,
}

/// One worker. The first seven names are a contract; absent values are `null`.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
struct Row {
    id: String,
    cpu: Option<usize>,
    priority: u8,
    background: Option<u8>,
    budget_ms: Option<f64>,
    period_ms: Option<f64>,
    worst_response_ms: Option<f64>,
    deadline_ms: Option<f64>,
    slack_ms: Option<f64>,
    /// The granted part of the guarantee, in ms.
    granted_ms: Option<f64>,
    max_replenishments: Option<u16>,
    policy: &'static str,
    handles: Vec<String>,
    reasons: Vec<String>,
}

/// Reads, plans, tells.
pub(crate) fn run(args: &Args) -> Outcome {
    files::check_writable(args.json.json.as_deref())?;
    let mut deployment = Deployment::read(&args.file).map_err(Failure::refused)?;
    deployment
        .on_host(cpus::allowed())
        .map_err(Failure::refused)?;
    let host = Host::look(&mut deployment, args.ignore_ledger)?;
    let name = args.file.display();
    match deployment.plan_beside(&host.promised) {
        Ok(plan) => {
            print(&deployment, &plan, args.brief);
            println!("\n{}", host.overheads());
            for note in &host.notes {
                println!("{note}");
            }
            let json = admitted(&deployment, &plan, &host);
            files::write_json(args.json.json.as_deref(), "plan", &json)
        }
        Err(refusal) => {
            let json = serde_json::json!({
                "admitted": false,
                "refusal": refusal.sentence,
                "worker": refusal.worker,
                "cpu": refusal.cpu,
                "would_fit": refusal.alternatives.iter().map(|fit| serde_json::json!({
                    "worker": fit.worker,
                    "amount_ms": ms(fit.amount),
                    "period_ms": ms(fit.period),
                    "without": fit.without,
                })).collect::<Vec<_>>(),
                "workers": refusal.attempt.as_deref().map_or_else(Vec::new, |a| rows(&deployment, a)),
                "beside": owners(&host),
                "overheads_measured": host.measured,
            });
            files::write_json(args.json.json.as_deref(), "plan", &json)?;
            if let Some(attempt) = refusal.attempt.as_deref().filter(|_| !args.brief) {
                println!("What was tried, for orientation; it does not hold:\n");
                println!("{}", table(attempt).to_text());
                println!("{}", loads(&attempt.cpus));
            }
            for note in &host.notes {
                remark!("{note}");
            }
            Err(Failure::refused(format!("{name} is refused: {refusal}")))
        }
    }
}

/// Names of the owners whose reservations count.
fn owners(host: &Host) -> Vec<&str> {
    host.promised.iter().map(|p| p.owner.as_str()).collect()
}

/// The tried settings of a refused plan, worker by worker.
fn rows(deployment: &Deployment, plan: &Plan) -> Vec<Row> {
    let handles = |n: usize| deployment.workers.get(n).map(|w| w.handles.clone());
    let workers = plan.workers.iter().enumerate();
    workers
        .map(|(n, worker)| Row::new(worker, handles(n).unwrap_or_default()))
        .collect()
}

fn admitted(deployment: &Deployment, plan: &Plan, host: &Host) -> serde_json::Value {
    serde_json::json!({
        "beside": owners(host),
        "overheads_measured": host.measured,
        "admitted": true,
        "refusal": null,
        "workers": rows(deployment, plan),
        "executor": plan.executor.as_ref().map(executor),
        "enforcer_priority": plan.enforcer_priority,
        "cpus": plan.cpus.iter().map(|c| serde_json::json!({
            "cpu": c.cpu,
            "reserved_percent": round(c.reserved * 100.0),
            "allowed_percent": round(c.allowed * 100.0),
        })).collect::<Vec<_>>(),
        "chains": plan.chains.iter().map(|c| serde_json::json!({
            "id": c.name,
            "worst_ms": c.worst.map(ms),
            "deadline_ms": c.deadline.map(ms),
        })).collect::<Vec<_>>(),
        "warnings": plan.warnings,
    })
}

fn executor(executor: &PlannedExecutor) -> Row {
    let worker = PlannedWorker {
        name: "executor".into(),
        cpu: executor.cpu,
        policy: executor.policy,
        amount: None,
        deadline: None,
        worst_response: executor.worst_response,
        reasons: executor.reasons.clone(),
    };
    Row::new(&worker, Vec::new())
}

impl Row {
    fn new(worker: &PlannedWorker, handles: Vec<String>) -> Self {
        let params = worker.policy.params();
        let runtime = match worker.policy {
            Policy::Deadline { runtime, .. } => Some(runtime),
            _ => params.map(sporadic::Params::budget),
        };
        let period = worker.policy.period();
        Self {
            id: worker.name.clone(),
            cpu: worker.cpu,
            priority: worker.priority(),
            background: params.and_then(|p| match p.low() {
                Low::Background(low) => Some(low),
                Low::Suspend => None,
            }),
            budget_ms: runtime.map(ms),
            period_ms: period.map(ms),
            worst_response_ms: worker.worst_response.map(ms),
            deadline_ms: worker.deadline.map(ms),
            slack_ms: worker.slack().map(ms),
            granted_ms: worker.amount.map(ms),
            max_replenishments: params.map(sporadic::Params::max_repl),
            policy: policy_name(&worker.policy),
            handles,
            reasons: worker.reasons.clone(),
        }
    }

    fn cells(&self) -> [String; 9] {
        // As the reasons and refusals print it.
        let time = |ms: Option<f64>| ms.map_or_else(|| "-".into(), |ms| short(nanos(ms)));
        [
            self.id.clone(),
            self.cpu.map_or_else(|| "any".into(), |cpu| cpu.to_string()),
            match self.priority {
                0 => self.policy.to_string(),
                priority => priority.to_string(),
            },
            match (self.background, self.budget_ms) {
                (Some(0), _) => "time-shared".into(),
                (Some(low), _) => low.to_string(),
                (None, Some(_)) => "waits".into(),
                (None, None) => "-".into(),
            },
            time(self.budget_ms),
            time(self.period_ms),
            time(self.worst_response_ms),
            time(self.deadline_ms),
            time(self.slack_ms),
        ]
    }
}

fn print(deployment: &Deployment, plan: &Plan, brief: bool) {
    println!("It fits: every deadline holds, whatever the other workers do.\n");
    println!("{}", table(plan).to_text());
    println!("{}", loads(&plan.cpus));
    for chain in &plan.chains {
        println!("{}", chain_line(chain));
    }
    for warning in &plan.warnings {
        println!("Warning: {warning}.");
    }
    if brief {
        return;
    }
    println!(
        "\nHow to read it: a worker runs at its priority (larger goes first) while it has budget, and \
         in the\nbackground when it has used it up. Worst response: the longest time from a release to \
         the end of its\ncallback if callbacks take what the file says at most; without such a \
         statement, until budget that is\ndue has been delivered. Slack: what is left of the deadline \
         then.\n\nWhy:"
    );
    let common = common(&plan.workers);
    let list = |name: &str, reasons: &[String]| {
        println!("  {name}");
        for reason in reasons.iter().filter(|r| !common.contains(r)) {
            println!("    - {reason}");
        }
    };
    for worker in guaranteed(&plan.workers) {
        list(&worker.name, &worker.reasons);
    }
    if let Some(executor) = &plan.executor {
        list(
            "executor (takes messages and hands them to workers)",
            &executor.reasons,
        );
    }
    if !common.is_empty() {
        println!("  all workers with a guarantee");
        for reason in &common {
            println!("    - {reason}");
        }
    }
    let unstated = deployment.workers.iter().filter(|w| w.scheduling.is_none());
    let names: Vec<&str> = unstated.map(|w| w.name.as_str()).collect();
    if !names.is_empty() {
        println!(
            "\nWithout guarantee, time-shared with everything else: {}.",
            names.join(", ")
        );
    }
}

/// Workers for which something was chosen.
fn guaranteed(workers: &[PlannedWorker]) -> impl Iterator<Item = &PlannedWorker> {
    workers.iter().filter(|w| w.policy != Policy::Other)
}

/// Reasons that every one of several guaranteed workers has: to be said once.
fn common(workers: &[PlannedWorker]) -> Vec<&String> {
    let mut workers = guaranteed(workers);
    let (Some(first), Some(second)) = (workers.next(), workers.next()) else {
        return Vec::new();
    };
    let rest: Vec<_> = workers.chain([second]).collect();
    let everywhere = |reason: &&String| rest.iter().all(|w| w.reasons.contains(reason));
    first.reasons.iter().filter(everywhere).collect()
}

fn table(plan: &Plan) -> Table {
    let mut table = Table::new(&[
        "worker",
        "CPU",
        "priority",
        "background",
        "budget",
        "period",
        "worst response",
        "deadline",
        "slack",
    ]);
    let workers = plan.workers.iter().map(|w| Row::new(w, Vec::new()));
    for row in workers.chain(plan.executor.as_ref().map(executor)) {
        table.row(row.cells());
    }
    table
}

/// One line per CPU.
fn loads(cpus: &[CpuLoad]) -> String {
    let lines: Vec<String> = cpus.iter().map(ToString::to_string).collect();
    lines.join("\n")
}

fn chain_line(chain: &PlannedChain) -> String {
    let allowed = chain
        .deadline
        .map_or_else(String::new, |d| format!(", {} allowed", short(d)));
    match chain.worst {
        Some(worst) => format!(
            "Chain {}: {} from the first release to the end of the last callback at worst{allowed}.",
            chain.name,
            short(worst)
        ),
        None => format!("Chain {}: no bound{allowed}.", chain.name),
    }
}

/// The kind of a policy, in a word.
fn policy_name(policy: &Policy) -> &'static str {
    match policy {
        Policy::Other => "time-shared",
        Policy::Fifo { .. } | Policy::RoundRobin { .. } => "FIFO",
        Policy::Sporadic(_) | Policy::KernelSporadic(_) => "sporadic",
        Policy::Deadline { .. } => "SCHED_DEADLINE",
    }
}

/// Nanoseconds in milliseconds.
pub(super) fn ms(span: replenish_plan::Nanos) -> f64 {
    span as f64 / 1e6
}

/// Milliseconds in nanoseconds.
fn nanos(ms: f64) -> replenish_plan::Nanos {
    #[expect(clippy::cast_sign_loss, reason = "no time of a plan is below 0")]
    {
        (ms * 1e6).round() as replenish_plan::Nanos
    }
}

fn round(x: f64) -> f64 {
    (x * 1e3).round() / 1e3
}

/// A span for people.
pub(super) fn short(span: replenish_plan::Nanos) -> String {
    Rounded(span).to_string()
}
