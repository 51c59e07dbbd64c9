//! Budgets for threads of other processes: shells that spin, and this very program with threads.

use crate::common::{MS, cpu};
use replenish_os::foreign::{self, BudgetId, BudgetUsage, Enforcer, ForeignThread, Original};
use replenish_os::{
    CpuSet, EnforcerConfig, GrantedPolicy, SchedClass, Tid, clock, current_tid, granted,
    set_affinity, set_priority,
};
use replenish_testkit::harness::{Trial, rt_trial, skip};
use replenish_testkit::progress::{eventually, reaches};
use sporadic::Budget;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

const CHILD: &str = "REPLENISH_FOREIGN_CHILD";

/// A shell's long work: until its parent has ended, so that nothing of a trial stays. A shell whose
/// parent had ended before it began sees its new one, which may live for ever: hence the count.
const SPIN: &str = "n=0; while [ $n -lt 20000 ] && [ $PPID -gt 1 ] && kill -0 $PPID 2>/dev/null; do \
                    n=$((n+1)); i=0; while [ $i -lt 9999 ]; do i=$((i+1)); done; done";

/// The work of a thread of `jobs`.
const JOB: u64 = 5 * MS;

/// Whether this process is a foreign program of a trial.
pub(crate) fn is_child() -> bool {
    std::env::var_os(CHILD).is_some()
}

/// The foreign program: `spin N` has N threads that spin, `wait N` N that wait, `come-and-go`
/// starts one every 10 ms, `sleepy` works for 2 ms of every 20, `often` waits often until it has
/// had 100 ms of the CPU, and then spins. `jobs N` starts N threads, four at a time, each of which
/// works for 5 ms once it has a budget, and ends. `spread` has two threads that pin themselves to a
/// CPU each, again and again.
pub(crate) fn child() -> ! {
    let what = std::env::var(CHILD).unwrap();
    // Nothing of the trial stays, however it ends.
    let parent = std::os::unix::process::parent_id();
    std::thread::spawn(move || {
        while std::os::unix::process::parent_id() == parent {
            std::thread::sleep(Duration::from_millis(200));
        }
        std::process::exit(1)
    });
    let spin = || {
        loop {
            std::hint::spin_loop();
        }
    };
    if let Some(count) = what.strip_prefix("spin ") {
        for _ in 1..count.parse().unwrap() {
            std::thread::spawn(spin);
        }
        spin();
    }
    if let Some(count) = what.strip_prefix("jobs ") {
        let mut jobs = std::collections::VecDeque::new();
        for _ in 0..count.parse().unwrap() {
            if jobs.len() == 4 {
                let first: std::thread::JoinHandle<()> = jobs.pop_front().unwrap();
                first.join().unwrap();
            }
            jobs.push_back(std::thread::spawn(|| {
                let policy = || granted(current_tid()).unwrap().policy;
                while matches!(policy(), GrantedPolicy::Other { .. }) {
                    std::thread::sleep(Duration::from_millis(1));
                }
                crate::common::burn(JOB);
            }));
        }
        jobs.into_iter().for_each(|job| job.join().unwrap());
        std::process::exit(0);
    }
    if what == "spread" {
        let on = |cpu: usize| {
            loop {
                set_affinity(current_tid(), &CpuSet::one(cpu)).unwrap();
                crate::common::burn(MS / 5);
            }
        };
        std::thread::spawn(move || on(0));
        on(1);
    }
    if let Some(count) = what.strip_prefix("wait ") {
        for _ in 1..count.parse().unwrap() {
            std::thread::spawn(std::thread::park);
        }
    }
    loop {
        if what.starts_with("wait") {
            std::thread::park();
        } else if what == "often" {
            crate::common::burn(MS / 20);
            if clock::thread_cpu() > 100 * MS {
                spin();
            }
            std::thread::sleep(Duration::from_micros(20));
        } else if what == "come-and-go" {
            std::thread::spawn(|| crate::common::burn(5 * MS));
            std::thread::sleep(Duration::from_millis(10));
        } else {
            crate::common::burn(2 * MS);
            std::thread::sleep(Duration::from_millis(18));
        }
    }
}

/// A foreign program; ended when dropped.
struct Program(Child);

impl Program {
    fn start(mut command: Command) -> Self {
        Self(command.stdin(Stdio::null()).spawn().unwrap())
    }

    fn shell() -> Self {
        let mut shell = Command::new("sh");
        shell.args(["-c", SPIN]);
        Self::start(shell)
    }

    /// This program; its thread that waits for its parent, and `threads` more at least.
    fn this(what: &str, threads: usize) -> Self {
        let mut this = Command::new(std::env::current_exe().unwrap());
        this.env(CHILD, what);
        let program = Self::start(this);
        assert!(eventually(|| program.tasks() > threads));
        program
    }

    fn tasks(&self) -> usize {
        foreign::tasks(self.pid()).unwrap().len()
    }

    fn pid(&self) -> Tid {
        Tid::new(self.0.id().cast_signed()).unwrap()
    }

    fn cpu_time(&self) -> u64 {
        let tasks = foreign::tasks(self.pid()).unwrap().into_iter();
        tasks
            .filter_map(|tid| ForeignThread::open(tid).ok()?.cpu())
            .sum()
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

fn enforcer() -> Enforcer {
    Enforcer::start(EnforcerConfig::on_cpu(cpu())).unwrap()
}

fn budget(enforcer: &Enforcer, amount: u64, period: u64) -> BudgetId {
    let of = Budget::of(Duration::from_millis(amount)).every(Duration::from_millis(period));
    enforcer.budget(60, of, SchedClass::Idle).unwrap()
}

fn enroll_all(enforcer: &Enforcer, budget: BudgetId, program: &Program) {
    for tid in foreign::tasks(program.pid()).unwrap() {
        let thread = ForeignThread::open(tid).unwrap();
        enforcer.enroll(budget, thread).unwrap();
    }
}

fn sleep(ms: u64) {
    std::thread::sleep(Duration::from_millis(ms));
}

/// The program's CPU time at the budget's priority is what the budget allows: 97 % of it over some
/// five periods in a row, and in all no more than the periods that begin within the time, and one.
fn holds_its_budget(program: &Program, amount: u64, period: u64) -> BudgetUsage {
    let enforcer = enforcer();
    let id = budget(&enforcer, amount, period);
    // A budget may wait for its first thread: it had another 30 ms at once when it counted as used
    // from its own beginning.
    sleep(period * 3 / 2);
    let from = clock::monotonic();
    enroll_all(&enforcer, id, program);
    let used = || enforcer.usage(id).unwrap().high;
    let (rate, five) = (amount as f64 / period as f64, 5 * period);
    assert!(reaches(0.97 * rate, Duration::from_millis(five), used));
    assert!(eventually(|| enforcer.usage(id).unwrap().exhaustions >= 10));
    let usage = enforcer.usage(id).unwrap();
    let elapsed = clock::monotonic() - from;
    let share = usage.high as f64 / elapsed as f64;
    let most = (elapsed / (period * MS) + 1) * amount * MS + MS / 2;
    eprintln!(
        "{:.3} % of {} ms, {} exhaustions, background {} ms, {:?}",
        share * 100.0,
        elapsed / MS,
        usage.exhaustions,
        usage.background / MS,
        enforcer.stats()
    );
    assert!(usage.high <= most, "{usage:?} in {elapsed} ns");
    assert_eq!(usage.refused, 0);
    usage
}

fn two_programs_share_a_cpu_as_the_budget_says() {
    let (first, other) = (Program::shell(), Program::shell());
    set_affinity(other.pid(), &CpuSet::one(cpu())).unwrap();
    let before = other.cpu_time();
    let usage = holds_its_budget(&first, 30, 100);
    let rest = other.cpu_time() - before;
    // Beyond its budget the first one is in the idle class, which hardly runs beside another
    // thread.
    assert!(rest > 2 * usage.background, "{rest} ns, {usage:?}");
}

fn eight_threads_share_one_budget() {
    let program = Program::this("spin 8", 8);
    assert_eq!(program.tasks(), 9, "and one that waits");
    holds_its_budget(&program, 30, 100);
}

/// At one FIFO priority the first thread would have the whole budget of every period.
fn threads_of_one_budget_take_turns() {
    let program = Program::this("spin 4", 4);
    let enforcer = enforcer();
    let id = budget(&enforcer, 5, 20);
    enroll_all(&enforcer, id, &program);
    let used = || -> Vec<u64> { enforcer.threads().iter().map(|t| t.high).collect() };
    // Forty periods' budget.
    assert!(eventually(|| used().iter().sum::<u64>() >= 200 * MS));
    let used = used();
    let sum: u64 = used.iter().sum();
    let shares = used.iter().filter(|used| **used > sum / 10).count();
    assert_eq!(shares, 4, "{used:?}");
}

fn what_a_thread_had_comes_back() {
    let (a, b, c) = (Program::shell(), Program::shell(), Program::shell());
    set_priority(b.pid(), SchedClass::RoundRobin(7)).unwrap();
    Command::new("renice")
        .args(["-n", "5", "-p", &c.pid().to_string()])
        .stdout(Stdio::null())
        .status()
        .unwrap();
    let programs = [&a, &b, &c];
    let had = programs.map(|p| Original::of(p.pid()).unwrap());
    let enforcer = enforcer();
    let id = budget(&enforcer, 2, 20);
    for program in programs {
        enroll_all(&enforcer, id, program);
    }
    sleep(50);
    let has = granted(a.pid()).unwrap();
    assert_eq!(has.cpus, CpuSet::one(cpu()));
    assert!(has.reset_on_fork);
    assert_eq!(enforcer.release(a.pid()).unwrap().pid, a.pid());
    assert_eq!(Original::of(a.pid()).unwrap(), had[0]);
    assert_eq!(enforcer.release(a.pid()), None);
    drop(enforcer);
    assert_eq!(programs.map(|p| Original::of(p.pid()).unwrap()), had);
}

/// A thread that gives itself another policy or CPU has what it was given again after the next
/// look.
fn a_changed_policy_is_changed_back() {
    let program = Program::shell();
    let enforcer = enforcer();
    let id = budget(&enforcer, 20, 40);
    enroll_all(&enforcer, id, &program);
    assert_eq!(enforcer.inspect().displaced, 0);
    let all = (0..=cpu()).fold(String::new(), |list, cpu| format!("{list}{cpu},"));
    let all = CpuSet::parse(&all).unwrap();
    for _ in 0..20 {
        set_priority(program.pid(), SchedClass::Fifo(61)).unwrap();
        if cpu() > 0 {
            set_affinity(program.pid(), &all).unwrap();
        }
        assert_eq!(enforcer.inspect().displaced, 1);
        let has = granted(program.pid()).unwrap();
        assert_ne!((has.policy, has.priority), (GrantedPolicy::Fifo, 61));
        assert_eq!(has.cpus, CpuSet::one(cpu()));
        sleep(7);
    }
}

/// A process that an enrolled one starts has neither its priority nor its flag, and can be found.
fn what_it_starts_begins_without_its_priority() {
    let mut shell = Command::new("sh");
    let again = format!("while kill -0 $PPID 2>/dev/null; do sh -c '{SPIN}'; done");
    shell.args(["-c", &again]);
    let program = Program::start(shell);
    // This kernel may not list children.
    let own = std::process::id().cast_signed();
    let lists = !foreign::children(Tid::new(own).unwrap()).is_empty();
    assert!(eventually(
        || !lists || foreign::family(program.pid()).len() == 2
    ));
    // The first one it had started: from now on under a budget.
    let first = foreign::family(program.pid());
    let enforcer = enforcer();
    let id = budget(&enforcer, 20, 40);
    enroll_all(&enforcer, id, &program);
    if let [_, child] = first[..] {
        Command::new("kill")
            .args(["-9", &child.to_string()])
            .status()
            .unwrap();
        let again = || foreign::family(program.pid());
        assert!(eventually(|| again()
            .get(1)
            .is_some_and(|new| *new != child)));
        let family = again();
        assert_eq!(family.len(), 2, "{family:?}");
        let has = granted(family[1]).unwrap();
        assert_eq!(has.priority, 0, "{has}");
        assert!(!has.reset_on_fork);
        let first = Original::of(first[0]).unwrap();
        let own = Original::of(family[1])
            .unwrap()
            .without_inheritance(cpu(), &first);
        assert_eq!(own, first);
        // It ends with its parent; killed first, it would get a successor without one.
    } else {
        skip("this kernel does not list children");
    }
}

/// A program that becomes another one by `exec`, again and again, keeps its number and its budget.
fn a_program_may_exec() {
    let mut shell = Command::new("sh");
    let again = "i=0; while [ $i -lt 9999 ]; do i=$((i+1)); done; \
                 kill -0 $PPID 2>/dev/null && exec sh -c \"$0\" \"$0\"";
    shell.args(["-c", again, again]);
    let program = Program::start(shell);
    holds_its_budget(&program, 30, 100);
}

/// Threads that live for a few milliseconds, a hundred each second: each is enrolled or gone.
fn threads_may_come_and_go() {
    let program = Program::this("come-and-go", 1);
    let enforcer = enforcer();
    let id = budget(&enforcer, 2, 10);
    let (mut enrolled, mut ended) = (0, 0);
    let begun = clock::monotonic();
    while clock::monotonic() < begun + 1500 * MS || enrolled <= 20 {
        assert!(clock::monotonic() < begun + 60_000 * MS, "{enrolled}");
        for tid in foreign::tasks(program.pid()).unwrap() {
            match ForeignThread::open(tid).and_then(|thread| enforcer.enroll(id, thread)) {
                Ok(()) => enrolled += 1,
                Err(foreign::ForeignError::Enrolled { .. }) => {}
                Err(e) => assert!(e.is_gone(), "{e}"),
            }
        }
        let found = enforcer.inspect();
        assert_eq!(found.displaced, 0);
        ended += found.ended.len();
        sleep(5);
    }
    eprintln!("{enrolled} enrolled, {ended} ended");
    let left = enforcer.threads().len();
    assert_eq!(ended + left, enrolled);
    assert!(enforcer.usage(id).unwrap().high > 0);
    drop(program);
    enforcer.inspect();
    assert_eq!(enforcer.threads(), [], "its process has ended");
}

/// A thread is charged for what it has used up to its end. What it had used since the last reading
/// cost nothing: a program that starts a thread for each job had several budgets at a time.
fn threads_that_end_are_charged_to_their_end() {
    const JOBS: u64 = 40;
    let mut program = Program::this(&format!("jobs {JOBS}"), 0);
    let enforcer = enforcer();
    let id = budget(&enforcer, 10, 100);
    let first = program.pid();
    let mut charged = 0;
    while program.0.try_wait().unwrap().is_none() {
        charged += ended(&enforcer);
        for tid in foreign::tasks(first).unwrap_or_default() {
            let is_job = |_: &ForeignThread| tid != first;
            if let Some(thread) = ForeignThread::open(tid).ok().filter(is_job) {
                enforcer.enroll(id, thread).ok(); // it has a budget already
            }
        }
        sleep(2);
    }
    charged += ended(&enforcer);
    let usage = enforcer.usage(id).unwrap();
    println!("{charged} ns of {JOBS} jobs, {usage:?}");
    assert!(charged >= JOBS * JOB * 98 / 100, "{charged}");
    assert!(usage.high + usage.background >= charged);
}

/// CPU time of the threads that have ended since the last look.
fn ended(enforcer: &Enforcer) -> u64 {
    let found = enforcer.inspect();
    let each = |thread: &foreign::ThreadUsage| thread.high + thread.background;
    found.ended.iter().map(each).sum()
}

/// Threads that leave the budget's CPU work side by side, and each is charged. Together they were
/// charged no more than the time that passed.
fn threads_on_several_cpus_are_charged_each() {
    let program = Program::this("spread", 2);
    let enforcer = enforcer();
    let id = budget(&enforcer, 20, 100);
    let before = program.cpu_time();
    enroll_all(&enforcer, id, &program);
    sleep(1000);
    let (used, usage) = (program.cpu_time() - before, enforcer.usage(id).unwrap());
    let charged = usage.high + usage.background;
    println!("{charged} of {used} ns, {usage:?}");
    assert!(charged * 100 >= used * 95, "{charged} of {used}");
}

/// With the kernel's records, a thread that waits gets its budget back a period after each use: 2
/// ms of every 20 never run out of a budget of 5 in 20, but for pauses of the machine that its CPU
/// clock counts. Without the records it runs out in every other period.
fn a_program_that_waits_is_not_exhausted() {
    let program = Program::this("sleepy", 1);
    let enforcer = enforcer();
    let id = budget(&enforcer, 5, 20);
    enroll_all(&enforcer, id, &program);
    // Fifty rounds.
    assert!(eventually(|| enforcer.usage(id).unwrap().high > 100 * MS));
    let usage = enforcer.usage(id).unwrap();
    eprintln!("{usage:?} {:?}", enforcer.stats());
    if usage.sees_blocking {
        assert!(usage.exhaustions <= 5, "{usage:?}");
    }
}

/// One wake-up of the enforcer serves all budgets whose threads wait.
fn budgets_whose_threads_wait_share_a_look() {
    let wakes = |threads: usize| {
        let program = Program::this(&format!("wait {threads}"), threads);
        let enforcer = enforcer();
        let first = budget(&enforcer, 2, 20);
        for (n, tid) in foreign::tasks(program.pid())
            .unwrap()
            .into_iter()
            .enumerate()
        {
            let id = if n == 0 {
                first
            } else {
                budget(&enforcer, 2, 20)
            };
            let thread = ForeignThread::open(tid).unwrap();
            enforcer.enroll(id, thread).unwrap();
            std::thread::sleep(Duration::from_micros(100)); // each has a time of its own at first
        }
        if !enforcer.usage(first).unwrap().sees_blocking {
            skip("no records of context switches");
        }
        let (begun, before) = (clock::monotonic(), enforcer.stats().wakes);
        sleep(400);
        let elapsed = clock::monotonic() - begun;
        (enforcer.stats().wakes - before) as f64 / (elapsed / MS) as f64
    };
    // Once in a budget of 2 ms, and two threads of this program's own, which come back at times.
    let (few, many) = (wakes(1), wakes(16));
    eprintln!("{few:.2} and {many:.2} wake-ups in a millisecond");
    assert!(many < 1.5 * few + 0.2, "{few} {many}");
}

/// A budget that was used in many pieces comes back in as many. Used up from then on, it is not
/// given and taken for each of them in every period: there is a millisecond between two raises.
fn a_budget_in_pieces_grows_together() {
    let program = Program::this("often", 1);
    let enforcer = enforcer();
    let id = budget(&enforcer, 1, 4);
    enroll_all(&enforcer, id, &program);
    let usage = || enforcer.usage(id).unwrap();
    assert!(
        eventually(|| program.cpu_time() > 120 * MS),
        "it never spins"
    );
    let (begun, before) = (clock::monotonic(), usage());
    sleep(400);
    let (after, elapsed) = (usage(), clock::monotonic() - begun);
    let raises = after.replenishments - before.replenishments;
    eprintln!("{raises} raises in {} ms, {after:?}", elapsed / MS);
    assert!(raises >= 1);
    assert!(raises <= elapsed / MS + 1, "{raises} in {elapsed} ns");
}

fn bad_values_are_refused_by_name() {
    let enforcer = enforcer();
    let of = |a, p| Budget::of(Duration::from_millis(a)).every(Duration::from_millis(p));
    let refused = |priority, budget, background| {
        let refused = enforcer.budget(priority, budget, background);
        refused.unwrap_err().to_string()
    };
    let (idle, good) = (SchedClass::Idle, of(1, 10));
    assert!(refused(99, good, idle).contains("1 to 98"));
    assert!(refused(0, good, idle).contains("1 to 98"));
    assert!(refused(5, good, SchedClass::Fifo(5)).contains("from 1 to 4"));
    assert!(refused(5, good, SchedClass::RoundRobin(1)).contains("background"));
    assert!(refused(5, of(11, 10), idle).contains("budget"));
    for _ in 0..64 {
        enforcer.budget(5, good, idle).unwrap();
    }
    assert!(refused(5, good, idle).contains("64 budgets"));
    let kernel = ForeignThread::open(Tid::new(2).unwrap());
    assert!(
        kernel.is_err(),
        "thread 2 is kthreadd, or hidden by a container"
    );
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        rt_trial(
            "two_programs_share_a_cpu_as_the_budget_says",
            two_programs_share_a_cpu_as_the_budget_says,
        ),
        rt_trial(
            "eight_threads_share_one_budget",
            eight_threads_share_one_budget,
        ),
        rt_trial(
            "threads_of_one_budget_take_turns",
            threads_of_one_budget_take_turns,
        ),
        rt_trial("what_a_thread_had_comes_back", what_a_thread_had_comes_back),
        rt_trial(
            "a_changed_policy_is_changed_back",
            a_changed_policy_is_changed_back,
        ),
        rt_trial(
            "what_it_starts_begins_without_its_priority",
            what_it_starts_begins_without_its_priority,
        ),
        rt_trial(
            "budgets_whose_threads_wait_share_a_look",
            budgets_whose_threads_wait_share_a_look,
        ),
        rt_trial(
            "a_budget_in_pieces_grows_together",
            a_budget_in_pieces_grows_together,
        ),
        rt_trial("a_program_may_exec", a_program_may_exec),
        rt_trial("threads_may_come_and_go", threads_may_come_and_go),
        rt_trial(
            "threads_that_end_are_charged_to_their_end",
            threads_that_end_are_charged_to_their_end,
        ),
        rt_trial(
            "threads_on_several_cpus_are_charged_each",
            threads_on_several_cpus_are_charged_each,
        )
        .skipped_if((cpu() == 0).then_some("this needs two CPUs")),
        rt_trial(
            "a_program_that_waits_is_not_exhausted",
            a_program_that_waits_is_not_exhausted,
        ),
        rt_trial(
            "bad_values_are_refused_by_name",
            bad_values_are_refused_by_name,
        ),
    ]
}
