//! `why` as a user calls it, on programs that are late for a known reason: real threads, each cause
//! alone and with another. Time that a hypervisor steals is in the analyser's own tests, with
//! readings made for them.

use replenish::msg::std_msgs::Int32;
use replenish::{
    CallbackContext, Context, Every, Executor, Group, HandleOptions, Low, Mark, OnMiss, Params,
    Policy, Qos,
};
use replenish_os::{ThreadSpec, affinity, clock, current_tid, spawn};
use replenish_testkit::harness::{Trial, rt_trial, trial};
use replenish_testkit::program::{Scratch, run, stderr};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

const BIN: &str = env!("CARGO_BIN_EXE_replenish");
const MS: u64 = 1_000_000;
const VICTIM: &str = "victim/timer:0";

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial("the_cases_are_27", the_cases_are_27),
        rt_trial("names_one_cause", || all(&alone())),
        rt_trial("names_two_causes", || all(&mixed())),
    ]
}

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

fn cpu() -> usize {
    affinity(current_tid()).unwrap().iter().last().unwrap()
}

fn burn(time: u64) {
    let end = clock::thread_cpu() + time;
    while clock::thread_cpu() < end {}
}

/// FIFO `priority`, and so much per period; with `Low::Suspend` nothing beyond that.
fn budget(priority: u8, low: Low, budget: u64, period: u64) -> Policy {
    Policy::sporadic(Params::new(priority, low, budget * MS, period * MS, 8).unwrap()).unwrap()
}

/// More budget than is used, so that the enforcer keeps switch records.
fn ample(priority: u8) -> Policy {
    budget(priority, Low::Background(1), 35, 40)
}

fn fifo(priority: u8) -> Policy {
    Policy::fifo(priority).unwrap()
}

/// A timer's callback: burns, sleeps, burns.
#[derive(Clone, Copy, Default)]
struct Job {
    burn: u64,
    sleep: u64,
    then: u64,
}

fn burns(burn: u64) -> Job {
    Job {
        burn,
        ..Job::default()
    }
}

fn sleeps(sleep: u64) -> Job {
    Job {
        sleep,
        then: MS / 2,
        ..Job::default()
    }
}

impl Job {
    fn run(self) {
        burn(self.burn);
        if self.sleep > 0 {
            std::thread::sleep(Duration::from_nanos(self.sleep));
        }
        burn(self.then);
    }
}

/// A worker with timers: the first release of each in ms, and its job.
fn worker(
    exec: &mut Executor,
    name: &str,
    policy: Policy,
    every: u64,
    jobs: &[(u64, Job)],
    late: (usize, u64),
) {
    let mut worker = exec.worker(name).policy(policy).cpu(cpu());
    for (n, (first, job)) in jobs.iter().enumerate() {
        let job = *job;
        let every = Every::from(ms(every)).first_after(ms(20 + first));
        let options = if n == late.0 {
            HandleOptions::new().deadline(ms(late.1), OnMiss::Count)
        } else {
            HandleOptions::new()
        };
        worker = worker
            .timer(every, move |_| job.run())
            .unwrap()
            .options(options);
    }
}

/// Adds its workers; the number makes runs differ by less than a millisecond.
type Build = Box<dyn Fn(&Context, &mut Executor, u64)>;

/// A program that is late, and why.
struct Case {
    name: &'static str,
    /// The handle that is late.
    handle: &'static str,
    causes: &'static [&'static str],
    /// A part of the text that names the party.
    by: &'static str,
    build: Build,
    /// An unrecorded thread takes the CPU now and then.
    stranger: bool,
}

fn case(
    name: &'static str,
    causes: &'static [&'static str],
    by: &'static str,
    build: impl Fn(&Context, &mut Executor, u64) + 'static,
) -> Case {
    Case {
        name,
        handle: VICTIM,
        causes,
        by,
        build: Box::new(build),
        stranger: false,
    }
}

const NEVER: (usize, u64) = (usize::MAX, 0);

/// The victim's jobs, and those of a worker above it.
fn against(
    victim: impl Fn(u64) -> Vec<(u64, Job)> + 'static,
    deadline: u64,
    above: u64,
) -> impl Fn(&Context, &mut Executor, u64) {
    move |_, exec, d| {
        let jobs = victim(d);
        // Its last timer has the deadline.
        worker(
            exec,
            "victim",
            ample(40),
            40,
            &jobs,
            (jobs.len() - 1, deadline),
        );
        if above > 0 {
            let job = burns(above * MS + d);
            worker(exec, "above", ample(60), 40, &[(0, job)], NEVER);
        }
    }
}

/// The dispatcher has to share a CPU with the publisher, which burns after it has published.
fn dispatched(
    ctx: &Context,
    exec: &mut Executor,
    d: u64,
    policy: Policy,
    before: u64,
    deadline: u64,
) {
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    exec.dispatcher_cpu(cpu()).dispatcher(Policy::Other);
    exec.worker("source")
        .policy(fifo(50))
        .cpu(cpu())
        .timer(Every::from(ms(40)), move |_| {
            out.publish(&Int32 { data: 1 }).unwrap();
            burn(8 * MS + d);
        })
        .unwrap();
    let other = affinity(current_tid()).unwrap().iter().next().unwrap();
    let mut sink = exec.worker("sink").policy(policy).cpu(other);
    if before > 0 {
        let again = ctx.node("hog").unwrap();
        sink = sink
            .subscribe(&again, "t", Qos::reliable(), move |_: &Int32, _| {
                burn(before * MS);
            })
            .unwrap();
    }
    let _ = sink
        .subscribe(&node, "t", Qos::reliable(), |_: &Int32, _| burn(MS))
        .unwrap()
        .options(HandleOptions::new().deadline(ms(deadline), OnMiss::Count));
}

fn released(case: Case) -> Case {
    Case {
        handle: "/n/sub:/t",
        ..case
    }
}

fn alone() -> Vec<Case> {
    let fifo_job = |job: fn(u64) -> Job, deadline: u64| {
        move |_: &Context, exec: &mut Executor, d: u64| {
            worker(exec, "victim", fifo(40), 40, &[(0, job(d))], (0, deadline));
        }
    };
    let own: &[&str] = &["own_execution"];
    let behind: &[&str] = &["waited_behind"];
    let empty: &[&str] = &["no_budget"];
    let preempted: &[&str] = &["preempted"];
    let blocked: &[&str] = &["blocked"];
    let late: &[&str] = &["released_late"];
    let mut cases = vec![
        case(
            "own",
            own,
            "",
            against(|d| vec![(0, burns(7 * MS + d))], 5, 0),
        ),
        case(
            "own without budget",
            own,
            "",
            fifo_job(|d| burns(8 * MS + d), 5),
        ),
        case("own, the second of two", own, "", |_, exec, d| {
            let jobs = [(0, burns(7 * MS + d)), (20, burns(MS))];
            worker(exec, "victim", ample(40), 40, &jobs, (0, 5));
        }),
        case(
            "no budget, suspended",
            empty,
            "used by victim/timer:0",
            |_, exec, d| {
                let policy = budget(40, Low::Suspend, 3, 30);
                worker(
                    exec,
                    "victim",
                    policy,
                    60,
                    &[(0, burns(5 * MS + d))],
                    (0, 10),
                );
            },
        ),
        case(
            "no budget, in the background",
            empty,
            "used by victim/timer:0",
            |_, exec, d| {
                let policy = budget(40, Low::Background(1), 3, 30);
                worker(exec, "victim", policy, 60, &[(0, burns(5 * MS))], (0, 10));
                worker(
                    exec,
                    "filler",
                    fifo(10),
                    60,
                    &[(0, burns(18 * MS + d))],
                    NEVER,
                );
            },
        ),
        case(
            "no budget, another's use",
            empty,
            "used by victim/timer:1",
            |_, exec, d| {
                let policy = budget(40, Low::Suspend, 3, 30);
                let jobs = [(8, burns(MS)), (0, burns(4 * MS + d))];
                worker(exec, "victim", policy, 60, &jobs, (0, 5));
            },
        ),
        case(
            "preempted",
            preempted,
            "above/timer:0",
            against(|_| vec![(0, burns(2 * MS))], 4, 6),
        ),
        case(
            "preempted without budgets",
            preempted,
            "above/timer:0",
            |_, exec, d| {
                worker(exec, "victim", fifo(40), 40, &[(0, burns(3 * MS))], (0, 5));
                worker(
                    exec,
                    "above",
                    fifo(60),
                    40,
                    &[(1, burns(7 * MS + d))],
                    NEVER,
                );
            },
        ),
        case(
            "blocked",
            blocked,
            "",
            against(|d| vec![(0, sleeps(7 * MS + d))], 4, 0),
        ),
        case(
            "blocked without budget",
            blocked,
            "",
            fifo_job(|d| sleeps(7 * MS + d), 4),
        ),
        case(
            "blocked after a mark",
            blocked,
            "after before the wait",
            |_, exec, d| {
                let mark = Mark::new("before the wait");
                let callback = move |cx: &CallbackContext<'_>| {
                    cx.mark(mark, 1);
                    sleeps(7 * MS + d).run();
                };
                let every = Every::from(ms(40)).first_after(ms(20));
                let worker = exec.worker("victim").policy(ample(40)).cpu(cpu());
                let worker = worker.timer(every, callback).unwrap();
                let _ = worker.options(HandleOptions::new().deadline(ms(4), OnMiss::Count));
            },
        ),
        case("behind a group", behind, "below/timer:0", |_, exec, d| {
            let group = Group::new("arm");
            for (name, policy, first, job) in [
                ("below", ample(20), 0, burns(9 * MS + d)),
                ("victim", ample(40), 2, burns(MS)),
            ] {
                let every = Every::from(ms(40)).first_after(ms(20 + first));
                let worker = exec.worker(name).policy(policy).cpu(cpu());
                let worker = worker.timer(every, move |_| job.run()).unwrap();
                let options = HandleOptions::new().group(&group);
                let _ = worker.options(match name {
                    "victim" => options.deadline(ms(4), OnMiss::Count),
                    _ => options,
                });
            }
        }),
        released(case("released late", late, "", |ctx, exec, d| {
            dispatched(ctx, exec, d, ample(40), 0, 4);
        })),
        released(case(
            "released late without budget",
            late,
            "",
            |ctx, exec, d| {
                dispatched(ctx, exec, d, fifo(40), 0, 4);
            },
        )),
        released(case(
            "released late, suspending",
            late,
            "",
            |ctx, exec, d| {
                dispatched(ctx, exec, d, budget(40, Low::Suspend, 10, 40), 0, 4);
            },
        )),
        Case {
            stranger: true,
            ..case(
                "preempted by a stranger",
                preempted,
                "not recorded",
                against(|_| vec![(0, burns(2 * MS))], 4, 0),
            )
        },
    ];
    for policy in [ample(40), fifo(40)] {
        cases.push(Case {
            handle: "victim/timer:1",
            ..case("behind", behind, "victim/timer:0", move |_, exec, d| {
                let jobs = [(0, burns(8 * MS + d)), (0, burns(MS))];
                worker(exec, "victim", policy, 40, &jobs, (1, 4));
            })
        });
    }
    cases
}

fn mixed() -> Vec<Case> {
    let two = |case: Case| Case {
        handle: "victim/timer:1",
        ..case
    };
    let both = |first: Job| {
        move |d: u64, second: Job| {
            vec![
                (
                    0,
                    Job {
                        burn: first.burn + d,
                        ..first
                    },
                ),
                (0, second),
            ]
        }
    };
    let six = both(burns(6 * MS));
    vec![
        two(case(
            "behind, preempted",
            &["waited_behind", "preempted"],
            "above/timer:0",
            against(move |d| six(d, burns(MS)), 3, 6),
        )),
        case(
            "own, preempted",
            &["own_execution", "preempted"],
            "above/timer:0",
            against(|d| vec![(0, burns(7 * MS + d))], 5, 6),
        ),
        two(case(
            "own, behind",
            &["own_execution", "waited_behind"],
            "victim/timer:0",
            against(move |d| six(d, burns(7 * MS)), 5, 0),
        )),
        case(
            "blocked, preempted",
            &["blocked", "preempted"],
            "above/timer:0",
            against(|d| vec![(0, sleeps(6 * MS + d))], 3, 6),
        ),
        two(case(
            "blocked, behind",
            &["blocked", "waited_behind"],
            "victim/timer:0",
            against(move |d| six(d, sleeps(6 * MS)), 3, 0),
        )),
        two(case(
            "no budget, behind",
            &["no_budget", "waited_behind"],
            "used by victim/timer:0",
            |_, exec, d| {
                let policy = budget(40, Low::Suspend, 9, 22);
                let jobs = [(0, burns(7 * MS + d)), (0, burns(4 * MS))];
                worker(exec, "victim", policy, 70, &jobs, (1, 6));
            },
        )),
        case(
            "no budget, blocked",
            &["no_budget", "blocked"],
            "",
            |_, exec, d| {
                let policy = budget(40, Low::Suspend, 4, 16);
                let job = Job {
                    burn: 0,
                    sleep: 10 * MS + d,
                    then: 6 * MS,
                };
                worker(exec, "victim", policy, 70, &[(0, job)], (0, 8));
            },
        ),
        released(case(
            "released late, behind",
            &["released_late", "waited_behind"],
            "/hog/sub:/t",
            |ctx, exec, d| {
                dispatched(ctx, exec, d, ample(40), 6, 3);
            },
        )),
        case(
            "own, blocked",
            &["own_execution", "blocked"],
            "",
            against(
                |d| {
                    vec![(
                        0,
                        Job {
                            burn: 7 * MS + d,
                            sleep: 6 * MS,
                            then: 0,
                        },
                    )]
                },
                5,
                0,
            ),
        ),
    ]
}

/// Of the 30 cases 27 are made by real threads. The other three are of stolen time, by hand, in
/// `commands/why/tests.rs`: no test can order it from a hypervisor, and this kernel charges the
/// time of interrupts to the thread that they interrupt.
fn the_cases_are_27() {
    let cases: Vec<Case> = alone().into_iter().chain(mixed()).collect();
    assert_eq!(cases.len(), 27);
    let mut causes = BTreeMap::<&str, usize>::new();
    for cause in cases.iter().flat_map(|case| case.causes) {
        *causes.entry(*cause).or_default() += 1;
    }
    let names: Vec<&str> = causes.keys().copied().collect();
    let all = [
        "blocked",
        "no_budget",
        "own_execution",
        "preempted",
        "released_late",
        "waited_behind",
    ];
    assert_eq!(names, all);
    assert!(causes.values().all(|times| *times >= 3), "{causes:?}");
}

/// A generator of small differences: the same in every run.
struct Seeded(u64);

impl Seeded {
    /// Below 1 ms.
    fn next(&mut self) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (self.0 >> 33) % MS
    }
}

fn all(cases: &[Case]) {
    let scratch = Scratch::new("why");
    let mut seeded = Seeded(cases.len() as u64);
    let results = cases
        .iter()
        .map(|case| judge(case, &scratch, seeded.next()));
    let wrong: Vec<String> = results.filter_map(Result::err).collect();
    println!("{} of {} named", cases.len() - wrong.len(), cases.len());
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The line that stands in the change goes into a file, and `plan` takes it.
fn plan_accepts(change: &str, scratch: &Scratch) {
    let line = change.split('`').nth(1).unwrap();
    assert!(line.starts_with("guarantee = {"), "{change}");
    let file = scratch.path("changed.toml");
    let text = format!("[[worker]]\nname = \"victim\"\n{line}\n");
    std::fs::write(&file, text).unwrap();
    let output = run(BIN, &["plan", "--ignore-ledger", file.to_str().unwrap()]);
    assert!(output.status.success(), "{change}: {}", stderr(&output));
}

/// Runs a program and asks why; the answer must be right for most of its late callbacks: now and
/// then something else happens as well.
fn judge(case: &Case, scratch: &Scratch, d: u64) -> Result<(), String> {
    let ctx = Context::in_process();
    let mut exec = Executor::new(&ctx);
    exec.no_ledger().admission(false).on_event(|_| ());
    (case.build)(&ctx, &mut exec, d);
    let stop = Arc::new(AtomicBool::new(false));
    let stranger = case.stranger.then(|| {
        let stop = Arc::clone(&stop);
        let spec = ThreadSpec::new("stranger").cpu(cpu()).policy(fifo(60));
        spawn(spec, move || {
            while !stop.load(Ordering::Relaxed) {
                burn(6 * MS);
                std::thread::sleep(ms(5));
            }
        })
        .unwrap()
    });
    let running = exec.start().unwrap();
    std::thread::sleep(ms(300));
    let out = scratch.path("why.json");
    let (pid, out_path) = (std::process::id().to_string(), out.to_str().unwrap());
    let output = run(BIN, &["why", &pid, "--json", out_path]);
    running.stop();
    stop.store(true, Ordering::Relaxed);
    if let Some(stranger) = stranger {
        stranger.join().unwrap();
    }
    assert!(output.status.success(), "{}", stderr(&output));
    let json = crate::schema::read(&out);
    let mut answers: BTreeMap<String, usize> = BTreeMap::new();
    let late = json["late"].as_array().unwrap();
    let mut of_handle = 0;
    for late in late.iter().filter(|late| late["handle"] == case.handle) {
        let parts = late["parts"].as_object().unwrap();
        let sum: u64 = parts.values().map(|ns| ns.as_u64().unwrap()).sum();
        assert_eq!(late["response_ns"], sum, "{late:#}");
        let causes = late["causes"].as_array().unwrap();
        let mut causes: Vec<&str> = causes.iter().map(|c| c.as_str().unwrap()).collect();
        causes.sort_unstable();
        *answers.entry(causes.join(", ")).or_default() += 1;
        of_handle += 1;
    }
    let mut wanted = case.causes.to_vec();
    wanted.sort_unstable();
    let right = answers.get(&wanted.join(", ")).copied().unwrap_or(0);
    let named = case.by.is_empty()
        || late.iter().any(|late| {
            let by = late["by"].as_array().unwrap();
            by.iter()
                .any(|b| b["by"].as_str().unwrap().contains(case.by))
        });
    let of = |late: &&serde_json::Value| late["handle"] == case.handle;
    let example = late.iter().find(of).unwrap_or(&json);
    if right * 2 > of_handle && named {
        if case.causes == ["no_budget"] {
            plan_accepts(example["change"].as_str().unwrap(), scratch);
        }
        return Ok(());
    }
    Err(format!(
        "{}: {wanted:?} by {:?} was put in, and named were {answers:?}: {example:#}",
        case.name, case.by
    ))
}
