//! Puts into words what was found.

use super::assign::Placed;
use super::plan::{CpuLoad, Plan, PlannedExecutor};
use super::problem::{Problem, Whose};
use super::rationale;
use crate::Nanos;
use replenish_sim::analysis::Section;
use sporadic::Policy;

/// Waits of a thread, by lock: the longest section of the others on its CPU.
pub(super) fn waits(
    problem: &Problem<'_>,
    threads: &[usize],
    fixed: &[usize],
    index: usize,
) -> Vec<String> {
    let planned = threads.iter().filter(|i| **i != index);
    let planned = planned.filter_map(|i| problem.threads.get(*i));
    let planned = planned.map(|(whose, seat)| (*whose, &seat.sections));
    let given = fixed.iter().filter_map(|i| problem.fixed.get(*i));
    let given = given.map(|(whose, _, thread)| (*whose, &thread.sections));
    let others: Vec<_> = planned.chain(given).collect();
    let own = problem.threads.get(index).map(|(_, seat)| &seat.sections);
    let wait = |section: &Section| {
        let lock = problem.request.locks.get(section.lock)?;
        let of = |(whose, sections): &(Whose, &Vec<Section>)| {
            let same = sections.iter().filter(|s| s.lock == section.lock);
            same.map(|s| (s.length, *whose))
                .max_by_key(|(length, _)| *length)
        };
        let (length, whose) = others
            .iter()
            .filter_map(of)
            .max_by_key(|(length, _)| *length)?;
        Some(rationale::waits(lock, length, &problem.name(whose)))
    };
    own.into_iter().flatten().filter_map(wait).collect()
}

/// The plan that belongs to these places and amounts.
pub(super) fn describe(problem: &Problem<'_>, placed: &Placed, amounts: &[Nanos]) -> Plan {
    let request = problem.request;
    let machine = &request.machine;
    let mut plan = Plan {
        workers: request.workers.iter().map(rationale::given).collect(),
        executor: None,
        enforcer_priority: machine.enforcer_priority,
        cpus: Vec::with_capacity(machine.cpus.len()),
        chains: Vec::new(),
        warnings: Vec::new(),
    };
    let cpus = machine.cpus.iter().zip(&placed.on).zip(&placed.fixed);
    for (((&cpu, threads), fixed), found) in cpus.zip(&placed.plans) {
        plan.cpus.push(CpuLoad {
            cpu,
            reserved: found.share,
            allowed: machine.real_time_share,
        });
        for (place, &index) in threads.iter().enumerate() {
            let Some((whose, seat)) = problem.threads.get(index) else {
                continue;
            };
            let bounds = found.bounds.get(place).copied().unwrap_or_default();
            let worst = if seat.per_job {
                bounds.response
            } else {
                bounds.service
            };
            let worst = worst.map(|w| w.saturating_sub(seat.late));
            let Some(&params) = found.params.get(place) else {
                continue;
            };
            let policy = Policy::Sporadic(params);
            match whose {
                Whose::Executor => {
                    plan.executor = Some(PlannedExecutor {
                        cpu: Some(cpu),
                        policy,
                        worst_response: worst,
                        reasons: rationale::executor(seat),
                    });
                }
                Whose::Worker(worker) => {
                    let Some(planned) = plan.workers.get_mut(*worker) else {
                        continue;
                    };
                    planned.cpu = Some(cpu);
                    planned.policy = policy;
                    planned.amount = amounts.get(index).copied();
                    planned.deadline = Some(seat.deadline);
                    planned.worst_response = worst;
                    let granted = planned.amount.unwrap_or(0);
                    let asked = request
                        .workers
                        .get(*worker)
                        .and_then(crate::Worker::guarantee);
                    planned.reasons =
                        rationale::worker(seat, asked, granted, &params, machine, found.share);
                    planned
                        .reasons
                        .extend(waits(problem, threads, fixed, index));
                }
                Whose::Promise(_) => {}
            }
        }
        for (place, &index) in fixed.iter().enumerate() {
            let Some((whose, _, thread)) = problem.fixed.get(index) else {
                continue;
            };
            let bounds = found.fixed.get(place).copied().unwrap_or_default();
            if let Whose::Worker(worker) = whose
                && let Some(planned) = plan.workers.get_mut(*worker)
            {
                // A thread on several CPUs has the worst of their bounds.
                planned.worst_response = planned.worst_response.max(bounds.response);
            }
            let lowest = *machine.priorities.start();
            if machine.is_throttled() && thread.is_unlimited_above(1) && !threads.is_empty() {
                let reach = if thread.is_unlimited_above(lowest) {
                    "and delays"
                } else {
                    "but can starve"
                };
                plan.warnings
                    .push(rationale::unlimited(&problem.name(*whose), cpu, reach));
            }
        }
    }
    if let crate::ExecutorRequest::Policy { policy, cpu } = &request.executor {
        plan.executor = Some(PlannedExecutor {
            cpu: *cpu,
            policy: *policy,
            worst_response: None,
            reasons: vec!["policy given".into()],
        });
    }
    plan
}
