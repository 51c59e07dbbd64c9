//! Guarantees: what is planned, what is refused before anything runs, scheduling from a file, and
//! programs that come and go beside each other. Programs are this very test program, whose role
//! [`CHILD`] names.
//!
//! `REPLENISH_CHURN_SECONDS=60` makes the last trial as long as the nightly run wants it (3 s).

use crate::common::{burn, cpu, eventually, executor};
use replenish::msg::std_msgs::Int32;
use replenish::planning::Deployment;
use replenish::planning::ledger::Ledger;
use replenish::{Budget, Context, Error, Every, Executor, Guarantee, Policy, Qos, RunningExecutor};
use replenish_os::clock;
use replenish_testkit::harness::{Trial, rt_trial, trial};
use replenish_testkit::watchdog::watchdog;
use replenish_testkit::witness::Witness;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

const CHILD: &str = "REPLENISH_ADMISSION_CHILD";
const MS: Duration = Duration::from_millis(1);

/// Is a neighbour, if this process was started to be one.
pub(crate) fn child() -> bool {
    let args = std::env::var_os(CHILD);
    if let Some(args) = &args {
        neighbour(args.to_str().unwrap());
    }
    args.is_some()
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial(
            "the_seventeenth_is_refused_before_anything_runs",
            seventeenth,
        ),
        trial("a_plan_is_made_carried_out_and_reported", planned),
        trial("a_policy_and_a_guarantee_contradict_each_other", both),
        trial(
            "a_file_overrides_by_id_and_its_mistakes_have_a_place",
            overlay,
        ),
        trial("the_template_of_a_program_describes_it", template),
        rt_trial(
            "a_second_program_is_refused_until_the_first_is_killed",
            two_programs,
        ),
        rt_trial("an_expert_may_not_break_a_promise", expert),
        rt_trial(
            "programs_that_come_and_go_do_not_make_an_admitted_one_late",
            churn,
        ),
    ]
}

fn start(exec: Executor) -> Result<RunningExecutor, String> {
    exec.start().map_err(|e| match e {
        Error::NotAdmitted { .. } | Error::Overlay { .. } => e.to_string(),
        other => panic!("{other}"),
    })
}

/// Issue 5: sixteen that fit, and one more.
fn seventeenth() {
    let ctx = Context::in_process();
    let ran = Arc::new(AtomicBool::new(false));
    let describe = |count: usize| {
        let (mut exec, _) = executor(&ctx);
        for i in 1..=count {
            let ran = Arc::clone(&ran);
            exec.worker(&format!("w{i}"))
                .budget(Budget::of(5 * MS).every(100 * MS))
                .cpu(cpu())
                .timer(MS, move |_| ran.store(true, Ordering::Relaxed))
                .unwrap();
        }
        exec
    };
    let mut exec = describe(16);
    exec.worker("w17")
        .guarantee(Guarantee::of(15 * MS).every(100 * MS))
        .cpu(cpu())
        .timer(MS, |_| ())
        .unwrap();
    let refusal = start(exec).unwrap_err();
    let expected = format!("worker \"w17\" does not fit: on CPU {}", cpu());
    assert!(refusal.starts_with(&expected), "{refusal}");
    assert!(refusal.contains("ms every 100 ms would fit"), "{refusal}");
    assert!(!ran.load(Ordering::Relaxed), "a callback has run");
    let report = start(describe(16)).unwrap().stop();
    let plan = report.admission.plan.unwrap();
    assert!(
        plan.workers.iter().all(|w| w.slack().is_some()),
        "{plan:#?}"
    );
}

fn planned() {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let quick = Guarantee::at(100.0).taking(MS).deadline(5 * MS);
    exec.worker("quick")
        .guarantee(quick)
        .timer(10 * MS, |_| ())
        .unwrap();
    exec.worker("slow")
        .guarantee(Guarantee::of(5 * MS).every(100 * MS).up_to(10 * MS))
        .subscribe(&node, "t", Qos::reliable(), |_: &Int32, _| ())
        .unwrap();
    exec.worker("rest").timer(10 * MS, |_| ()).unwrap();
    let report = start(exec).unwrap().stop();
    let plan = report.admission.plan.as_ref().unwrap();
    assert_eq!(plan.workers.len(), 2);
    assert!(plan.workers[0].priority() > plan.workers[1].priority());
    assert_eq!(plan.workers[1].amount, Some(10_000_000));
    // The threads were requested as the plan says; messages need a dispatcher.
    for worker in &plan.workers {
        let thread = report.thread(&worker.name).unwrap();
        assert_eq!(thread.cpu, worker.cpu);
        let priority = format!("SPORADIC {}/", worker.priority());
        assert!(thread.requested.starts_with(&priority), "{report}");
    }
    assert!(
        report
            .thread("dispatcher")
            .unwrap()
            .requested
            .starts_with("SPORADIC 98/")
    );
    assert_eq!(report.thread("rest").unwrap().requested, "OTHER");
}

fn both() {
    let (mut exec, _) = executor(&Context::in_process());
    exec.worker("w")
        .policy(Policy::fifo(50).unwrap())
        .guarantee(Guarantee::of(MS).every(10 * MS))
        .timer(MS, |_| ())
        .unwrap();
    let error = exec.start().unwrap_err().to_string();
    assert!(
        error.starts_with("worker \"w\": guarantee = 1 ms every 10 ms is not allowed"),
        "{error}"
    );
}

/// A file of this test's own, with this text.
struct TempFile(PathBuf);

impl TempFile {
    fn new(name: &str, text: &str) -> Self {
        let name = format!("replenish-{name}-{}.toml", std::process::id());
        let path = std::env::temp_dir().join(name);
        std::fs::write(&path, text).unwrap();
        Self(path)
    }
}

impl Drop for TempFile {
    fn drop(&mut self) {
        std::fs::remove_file(&self.0).ok();
        std::fs::remove_dir_all(&self.0).ok();
    }
}

fn with_two_handles(ctx: &Context) -> Executor {
    let node = ctx.node("robot").unwrap();
    let (mut exec, _) = executor(ctx);
    exec.worker("main")
        .timer(10 * MS, |_| ())
        .unwrap()
        .subscribe(&node, "scan", Qos::reliable(), |_: &Int32, _| ())
        .unwrap();
    exec
}

fn overlay() {
    let ctx = Context::in_process();
    let run = |text: &str| {
        let file = TempFile::new("overlay", text);
        let mut exec = with_two_handles(&ctx);
        exec.overlay(&file.0);
        start(exec).map(RunningExecutor::stop)
    };
    let report = run("[[worker]]\nname = \"main\"\nguarantee = { budget = \"5 ms\", period = \"50 ms\" }\n\
         [[worker]]\nname = \"lidar\"\nhandles = [\"/robot/sub:/scan\"]\nguarantee = { rate = \"20 Hz\", takes = \"1 ms\" }\n")
    .unwrap();
    let of = |id: &str| report.handle(id).unwrap().worker.clone();
    assert_eq!(
        (of("main/timer:0").as_str(), of("/robot/sub:/scan").as_str()),
        ("main", "lidar")
    );
    assert_eq!(report.admission.plan.as_ref().unwrap().workers.len(), 2);

    let refused = |text: &str, place: &str, part: &str| {
        let error = run(text).map(|_| ()).unwrap_err();
        assert!(error.contains(place) && error.contains(part), "{error}");
    };
    refused(
        "\n[[worker]]\nname = \"main\"\nhandles = [\"main/timer:0\", \"/robot/sub:/scn\"]\n",
        ".toml:4:28: worker.handles: ",
        "no handle \"/robot/sub:/scn\"; it has /robot/sub:/scan, main/timer:0",
    );
    refused(
        "[[worker]]\nname = \"mian\"\n",
        ".toml:2:8: worker.name: ",
        "no worker \"mian\", and no handles are listed for a new one; it has main",
    );
    refused(
        "[[worker]]\nname = \"main\"\ncolor = 1\n",
        ".toml:3:1: worker.color: ",
        "unknown field",
    );
    // All handles gone: so is the worker.
    let all = "[[worker]]\nname = \"other\"\nhandles = [\"main/timer:0\", \"/robot/sub:/scan\"]\n";
    let report = run(all).unwrap();
    assert!(report.thread("main").is_none() && report.thread("other").is_some());
}

fn template() {
    let ctx = Context::in_process();
    let mut exec = with_two_handles(&ctx);
    exec.worker("drive")
        .guarantee(Guarantee::of(2 * MS).every(20 * MS).deadline(10 * MS))
        .timer(20 * MS, |_| ())
        .unwrap();
    let running = start(exec).unwrap();
    let text = running.template().to_owned();
    running.stop();
    let file = Deployment::parse(&text, "template").unwrap_or_else(|e| panic!("{e}\n{text}"));
    let names: Vec<_> = file.workers.iter().map(|w| w.name.as_str()).collect();
    assert_eq!(names, ["main", "drive"]);
    assert_eq!(
        file.workers[0].handles,
        ["main/timer:0", "/robot/sub:/scan"]
    );
    // It applies to the program it came from, and changes nothing.
    let file = TempFile::new("template", &text);
    let mut again = with_two_handles(&ctx);
    again.overlay(&file.0);
    again.worker("drive").timer(20 * MS, |_| ()).unwrap();
    let running = start(again).unwrap();
    assert_eq!(running.template(), text);
    assert_eq!(running.stop().admission.plan.unwrap().workers.len(), 1);
}

/// A program with one greedy worker of this share; says whether it was let in, and stays.
fn neighbour(args: &str) {
    let args: Vec<&str> = args.splitn(3, ' ').collect();
    let [directory, share, cpu] = args[..] else {
        panic!("{args:?}")
    };
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.ledger(directory);
    exec.worker("neighbour")
        .guarantee(Guarantee::of(share.parse::<u32>().unwrap() * MS).every(100 * MS))
        .cpu(cpu.parse().unwrap())
        .timer(MS, |_| burn(1))
        .unwrap();
    match start(exec) {
        Ok(running) => {
            println!("admitted");
            running.wait();
        }
        Err(refusal) => println!("refused {refusal}"),
    }
}

fn program(directory: &Path, share: u32) -> (Child, String) {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .env(CHILD, format!("{} {share} {}", directory.display(), cpu()))
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    let out = child.stdout.as_mut().unwrap();
    BufReader::new(out).read_line(&mut line).unwrap();
    (child, line)
}

fn kill(mut child: Child) {
    child.kill().unwrap(); // SIGKILL
    child.wait().unwrap();
}

fn two_programs() {
    let _dog = watchdog("two programs", Duration::from_secs(60));
    let directory =
        TempFile(std::env::temp_dir().join(format!("replenish-two-{}", std::process::id())));
    let (first, line) = program(&directory.0, 60);
    assert_eq!(line, "admitted\n");
    let (mut second, line) = program(&directory.0, 50);
    assert!(
        line.starts_with("refused worker \"neighbour\" does not fit: on CPU")
            && line.contains("by other programs: \"neighbour\" of "),
        "{line}"
    );
    assert!(second.wait().unwrap().success());
    kill(first);
    let (third, line) = program(&directory.0, 50);
    assert_eq!(line, "admitted\n");
    kill(third);
    assert!(
        Ledger::open(&directory.0)
            .unwrap()
            .view()
            .unwrap()
            .entries
            .is_empty()
    );
}

/// A loop at a priority above the guaranteed one's is not let in; below it is.
fn expert() {
    let _dog = watchdog("expert", Duration::from_secs(60));
    let directory =
        TempFile(std::env::temp_dir().join(format!("replenish-expert-{}", std::process::id())));
    let (first, line) = program(&directory.0, 40);
    assert_eq!(line, "admitted\n");
    let ctx = Context::in_process();
    let with = |priority| {
        let (mut exec, _) = executor(&ctx);
        exec.ledger(&directory.0);
        exec.worker("loop")
            .policy(Policy::fifo(priority).unwrap())
            .cpu(cpu())
            .timer(MS, |_| ())
            .unwrap();
        start(exec).map(RunningExecutor::stop)
    };
    let refusal = with(90).unwrap_err();
    assert!(
        refusal.contains("\"neighbour\" of ")
            && refusal
                .contains("worker \"loop\" runs there at a real-time priority without a budget"),
        "{refusal}"
    );
    assert!(with(10).is_ok());
    kill(first);
    assert!(with(90).is_ok());
}

/// A control loop under a guarantee; meanwhile greedy programs start, are let in or not, and are
/// killed. No callback of the loop may end after its deadline, unless the machine stood still.
fn churn() {
    const DEADLINE: u64 = 20_000_000;
    let seconds = std::env::var("REPLENISH_CHURN_SECONDS").ok();
    let seconds = seconds.and_then(|s| s.parse().ok()).unwrap_or(3);
    let _dog = watchdog("churn", Duration::from_secs(seconds * 2 + 180));
    let directory =
        TempFile(std::env::temp_dir().join(format!("replenish-churn-{}", std::process::id())));
    let witness = Arc::new(Witness::napping(2 * MS));
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.ledger(&directory.0);
    let late: Arc<AtomicU64> = Arc::default();
    let excused: Arc<AtomicU64> = Arc::default();
    let worst: Arc<AtomicU64> = Arc::default();
    let previous = AtomicU64::new(u64::MAX / 2);
    let (l, e, w, still) = (
        Arc::clone(&late),
        Arc::clone(&excused),
        Arc::clone(&worst),
        Arc::clone(&witness),
    );
    exec.worker("control")
        .guarantee(Guarantee::at(50.0).taking(3 * MS).deadline(20 * MS))
        .cpu(cpu())
        .timer(Every::period(20 * MS), move |cx| {
            burn(1);
            // A release that was left out is late as well.
            let expected = previous.swap(cx.due(), Ordering::Relaxed) + DEADLINE;
            let took = clock::monotonic() - cx.due().min(expected);
            let stood_still = still.saw_one_within(Duration::from_nanos(took) + MS);
            if took > DEADLINE && stood_still {
                e.fetch_add(1, Ordering::Relaxed);
            } else {
                l.fetch_add(u64::from(took > DEADLINE), Ordering::Relaxed);
                w.fetch_max(took, Ordering::Relaxed);
            }
        })
        .unwrap();
    let running = start(exec).unwrap();
    let ledger = Ledger::open(&directory.0).unwrap();
    let (mut admitted, mut refused, mut last_refusal) = (0, 0, String::new());
    let mut alive: Vec<Child> = Vec::new();
    let end = Instant::now() + Duration::from_secs(seconds);
    let mut turn = 0u32;
    while Instant::now() < end || admitted <= 2 || refused == 0 {
        turn += 1;
        let (child, line) = program(&directory.0, 25 + 10 * (turn % 3));
        if line.starts_with("admitted") {
            admitted += 1;
            alive.push(child);
        } else {
            refused += 1;
            last_refusal.clone_from(&line);
            let mut child = child;
            assert!(child.wait().unwrap().success(), "{line}");
        }
        // The ledger knows exactly those that live, and the control loop.
        assert_eq!(ledger.view().unwrap().entries.len(), alive.len() + 1);
        std::thread::sleep(MS * (20 + 17 * (turn % 5)));
        if alive.len() > 2 || (line.starts_with("refused") && !alive.is_empty()) {
            kill(alive.remove(0));
        }
    }
    alive.drain(..).for_each(kill);
    assert!(eventually(|| ledger.view().unwrap().entries.len() == 1));
    let releases = running.report().elapsed / 20_000_000;
    let report = running.stop();
    let control = report.handle("control/timer:0").unwrap().stats;
    let (late, excused) = (
        late.load(Ordering::Relaxed),
        excused.load(Ordering::Relaxed),
    );
    println!(
        "{seconds} s: {admitted} programs admitted, {refused} refused; control: {} callbacks, {late} late, \
         {excused} late while the machine stood still ({} us), worst {} us of {} us",
        control.executed,
        witness.so_far() / 1000,
        worst.load(Ordering::Relaxed) / 1000,
        DEADLINE / 1000
    );
    print!("{last_refusal}");
    // The last releases may be under way.
    assert!(
        control.executed + control.skipped + 3 >= releases,
        "{report}"
    );
    assert_eq!(late, 0, "{report}");
}
