//! The flight recorder: what others read while the program runs, and that they find nothing else.

use crate::common::{eventually, executor};
use replenish::msg::std_msgs::Int32;
use replenish::{
    CallbackContext, Context, Dump, Error, HandleOptions, Mark, OnMiss, Qos, TimerHandle,
};
use replenish_recorder::{Event, Kind, NameKind, Source, View};
use replenish_testkit::watchdog::watchdog;
use std::fs::{File, TryLockError};
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

/// A directory in memory, which goes with this value.
pub(crate) struct Directory(pub(crate) PathBuf);

impl Directory {
    pub(crate) fn new(name: &str) -> Self {
        let path = format!("/dev/shm/recorder-{name}-{}", std::process::id());
        std::fs::create_dir(&path).unwrap();
        Self(path.into())
    }

    fn recordings(&self) -> Vec<PathBuf> {
        self.files("live")
    }

    pub(crate) fn files(&self, extension: &str) -> Vec<PathBuf> {
        let entries = std::fs::read_dir(&self.0).unwrap();
        let paths = entries.map(|entry| entry.unwrap().path());
        let mut paths: Vec<PathBuf> = paths
            .filter(|p| p.extension().is_some_and(|e| e == extension))
            .collect();
        paths.sort();
        paths
    }

    /// The causes of the dumps that were written.
    fn dumped(&self) -> Vec<String> {
        let dumps = self.files("dump");
        let stems = dumps
            .iter()
            .map(|p| p.file_stem().unwrap().to_str().unwrap());
        stems
            .map(|stem| stem.rsplit('-').next().unwrap().to_owned())
            .collect()
    }

    fn recording(&self) -> PathBuf {
        let [one] = self.recordings().try_into().unwrap();
        one
    }
}

impl Drop for Directory {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.0).ok();
    }
}

pub(crate) struct ByPlace(File);

impl Source for ByPlace {
    fn bytes(&self) -> u64 {
        self.0.metadata().unwrap().len()
    }

    fn fill(&self, offset: u64, buffer: &mut [u8]) -> bool {
        self.0.read_exact_at(buffer, offset).is_ok()
    }
}

pub(crate) struct Read {
    pub(crate) source: ByPlace,
    pub(crate) view: View,
}

impl Read {
    pub(crate) fn of(path: &PathBuf) -> Self {
        let source = ByPlace(File::open(path).unwrap());
        let view = View::read(&source).unwrap();
        Self { source, view }
    }

    pub(crate) fn events(&self, thread: &str) -> Vec<Event> {
        let thread = self.view.threads.iter().find(|t| t.name == thread);
        let (events, copied) = thread.unwrap().events(&self.source);
        assert_eq!((copied.torn, copied.read), (0, events.len() as u64));
        events
    }

    pub(crate) fn id(&self, kind: NameKind, name: &str) -> u32 {
        let wanted = Some((kind, name.to_owned()));
        let names = self.view.names(&self.source);
        u32::try_from(names.iter().position(|n| *n == wanted).unwrap()).unwrap()
    }
}

fn count(events: &[Event], kind: Kind, name: u32) -> usize {
    events
        .iter()
        .filter(|e| (e.kind, e.name) == (kind, name))
        .count()
}

#[test]
fn the_events_of_every_thread_are_in_the_programs_file() {
    const MESSAGES: i32 = 50;
    let _dog = watchdog("recorder", LIMIT);
    let directory = Directory::new("events");
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node
        .publisher::<Int32>("recorded", Qos::reliable())
        .unwrap();
    let (mut exec, _log) = executor(&ctx);
    exec.ledger(&directory.0);
    let mut sent = 0;
    exec.worker("source")
        .timer(MS, move |_| {
            sent += 1;
            if sent <= MESSAGES {
                out.publish(&Int32 { data: sent }).unwrap();
            }
        })
        .unwrap();
    let mark = Mark::new("half way");
    let heard = move |m: &Int32, cx: &CallbackContext<'_>| {
        if m.data == MESSAGES / 2 {
            cx.mark(mark, 4711);
        }
    };
    exec.worker("sink")
        .subscribe(&node, "recorded", Qos::reliable().keep_last(100), heard)
        .unwrap();
    let running = exec.start().unwrap();
    let id = "/n/sub:/recorded";
    let executed = || running.stats(id).unwrap().executed == MESSAGES as u64;
    assert!(eventually(executed));

    let path = directory.recording();
    assert_eq!(std::fs::metadata(&path).unwrap().mode() & 0o777, 0o640);
    let lock = File::open(&path).unwrap().try_lock_shared();
    assert!(matches!(lock, Err(TryLockError::WouldBlock)), "it lives");
    // The event of the last callback's end comes a moment after its count.
    let ended = || {
        let read = Read::of(&path);
        let handle = read.id(NameKind::Handle, id);
        count(&read.events("sink"), Kind::End, handle) == MESSAGES as usize
    };
    assert!(eventually(ended));
    let read = Read::of(&path);
    assert_eq!(read.view.pid, std::process::id());
    let names: Vec<&str> = read.view.threads.iter().map(|t| &*t.name).collect();
    assert_eq!(names, ["dispatcher", "source", "sink"]);
    assert!(
        read.view
            .threads
            .iter()
            .all(|t| t.tid > 0 && !t.policy.is_empty())
    );

    let handle = read.id(NameKind::Handle, id);
    let (taken, sink) = (read.events("dispatcher"), read.events("sink"));
    assert_eq!(count(&taken, Kind::Take, handle), MESSAGES as usize);
    assert_eq!(count(&sink, Kind::Begin, handle), MESSAGES as usize);
    let topic = read.id(NameKind::Topic, "/recorded");
    assert_eq!(
        count(&read.events("source"), Kind::Publish, topic),
        MESSAGES as usize
    );
    let callbacks = |e: &&Event| e.kind == Kind::Begin || e.kind == Kind::End;
    let callbacks: Vec<&Event> = sink.iter().filter(callbacks).collect();
    for pair in callbacks.chunks(2) {
        let [begin, end] = pair else {
            panic!("{pair:?}")
        };
        assert_eq!((begin.kind, end.kind), (Kind::Begin, Kind::End));
        assert!(begin.a <= begin.time && begin.time <= end.time && begin.a == end.a);
        // The way back to the sample that was taken.
        assert!(
            taken
                .iter()
                .any(|t| (t.kind, t.time) == (Kind::Take, begin.a))
        );
    }
    let half = read.id(NameKind::Mark, "half way");
    let marks: Vec<&Event> = sink.iter().filter(|e| e.kind == Kind::Mark).collect();
    assert!(matches!(&*marks, [m] if m.name == half && m.a == 4711));
    let wakes: Vec<&Event> = sink.iter().filter(|e| e.kind == Kind::Wake).collect();
    assert!(!wakes.is_empty());
    for wake in wakes {
        assert!(0 < wake.b && wake.b <= wake.time && wake.time <= wake.a);
        // It waited since the event before.
        let before = sink.iter().take_while(|e| *e != wake).last();
        assert!(
            before.is_none_or(|e| e.time.max(if e.kind == Kind::Wake { e.a } else { 0 }) <= wake.b)
        );
    }

    running.stop();
    assert_eq!(
        directory.recordings(),
        Vec::<PathBuf>::new(),
        "it ended in order"
    );
}

#[test]
fn what_goes_wrong_is_recorded() {
    let _dog = watchdog("recorder of failures", LIMIT);
    let directory = Directory::new("failures");
    let ctx = Context::in_process();
    let (mut exec, _log) = executor(&ctx);
    exec.ledger(&directory.0);
    exec.worker("late")
        .timer(5 * MS, |_| std::thread::sleep(12 * MS))
        .unwrap();
    exec.worker("panics")
        .timer(MS, |_| -> () { panic!("on purpose") })
        .unwrap();
    let miss = HandleOptions::new().deadline(MS, OnMiss::Count);
    exec.worker("misses")
        .timer(5 * MS, |_| std::thread::sleep(2 * MS))
        .unwrap()
        .options(miss);
    let running = exec.start().unwrap();
    let path = directory.recording();
    let recorded = |thread: &str, kind: Kind, handle: &str| {
        let read = Read::of(&path);
        let handle = read.id(NameKind::Handle, handle);
        count(&read.events(thread), kind, handle) > 0
    };
    assert!(eventually(|| recorded("late", Kind::Skip, "late/timer:0")));
    assert!(eventually(|| recorded(
        "misses",
        Kind::Miss,
        "misses/timer:0"
    )));
    assert!(eventually(|| recorded(
        "panics",
        Kind::End,
        "panics/timer:0"
    )));
    let panicked = Read::of(&path).events("panics");
    let kinds: Vec<Kind> = panicked.iter().map(|e| e.kind).collect();
    let panic = kinds.iter().position(|k| *k == Kind::Panic).unwrap();
    assert_eq!(
        kinds[panic - 1..=panic + 1],
        [Kind::Begin, Kind::Panic, Kind::End]
    );
    running.stop();
}

/// Also: handles that come while the executor runs have their names in the file.
#[test]
fn a_recorder_of_0_bytes_records_nothing_and_other_sizes_have_a_range() {
    let _dog = watchdog("recorder sizes", LIMIT);
    let directory = Directory::new("sizes");
    let ctx = Context::in_process();
    let started = |bytes: usize| {
        let (mut exec, log) = executor(&ctx);
        exec.ledger(&directory.0).recorder(bytes);
        exec.worker("w").capacity(2).timer(MS, |_| ()).unwrap();
        (exec.start(), log)
    };
    let (running, _log) = started(0);
    assert_eq!(directory.recordings(), Vec::<PathBuf>::new());
    running.unwrap().stop();
    for wrong in [4095, (64 << 20) + 1] {
        match started(wrong).0 {
            Err(Error::Parameter { field, allowed, .. }) => {
                assert_eq!(field, "recorder");
                assert!(allowed.contains("4096..=67108864"), "{allowed}");
            }
            other => panic!("{other:?}"),
        }
    }
    let (running, _log) = started(4096);
    let running = running.unwrap();
    let path = directory.recording();
    let handle = running.handle();
    let worker = handle.worker("w").unwrap();
    worker.timer(MS, |_| ()).unwrap();
    assert!(Read::of(&path).id(NameKind::Handle, "w/timer:1") > 0);
    // 124 slots hold the newest, and the others are counted.
    let overwritten = || {
        let read = Read::of(&path);
        let (events, copied) = read.view.threads[1].events(&read.source);
        copied.overwritten > 0 && copied.torn == 0 && events.len() <= 128
    };
    assert!(eventually(overwritten));
    running.stop();
}

/// Only the callback that sleeps for longer is late, however loaded the machine is.
const LATE: Duration = Duration::from_secs(1);

/// A worker whose callback does this once, at its third release, and then ticks on 20 times: its
/// ring holds all of that, however late the idle-class thread that writes dumps gets to it.
fn dumping(
    directory: &Directory,
    dump: Dump,
    third: impl Fn() + Send + 'static,
) -> replenish::RunningExecutor {
    let ctx = Context::in_process();
    let (mut exec, _log) = executor(&ctx);
    exec.ledger(&directory.0).recorder(8192).dump(dump);
    let timer = TimerHandle::new();
    let (mut releases, end) = (0, timer.clone());
    let callback = move |_: &CallbackContext<'_>| {
        releases += 1;
        match releases {
            3 => third(),
            23 => end.cancel(),
            _ => {}
        }
    };
    // Without these options the deadline of a timer is its period.
    let options = || HandleOptions::new().deadline(LATE, OnMiss::Count);
    let trips = exec.worker("trips").timer_with(&timer, MS, callback);
    let _ = trips.unwrap().options(options());
    let ticks = exec.worker("ticks").timer(MS, |_| ());
    let _ = ticks.unwrap().options(options());
    exec.start().unwrap()
}

#[test]
fn a_dump_holds_what_came_before_its_trigger_and_after() {
    let _dog = watchdog("dumps", LIMIT);
    let sleep = || std::thread::sleep(LATE + LATE / 10);
    let panic = || panic!("on purpose");
    let directory = Directory::new("dumps-miss");
    let to = || Dump::to(&directory.0);
    let overrun = to().on_overrun(LATE);
    for (n, (dump, kind, cause)) in [
        (to().on_miss(), Kind::Miss, "miss"),
        (overrun, Kind::Miss, "overrun"),
        (to().on_panic(), Kind::Panic, "panic"),
    ]
    .into_iter()
    .enumerate()
    {
        let third: Box<dyn Fn() + Send> = match kind {
            Kind::Panic => Box::new(panic),
            _ => Box::new(sleep),
        };
        let running = dumping(&directory, dump, third);
        assert!(eventually(|| directory.files("dump").len() == 1), "{n}");
        assert_eq!(directory.dumped(), [cause]);
        let path = directory.files("dump").remove(0);
        assert_eq!(std::fs::metadata(&path).unwrap().mode() & 0o777, 0o640);
        let counts = || Read::of(&directory.recording()).view.dumps;
        assert!(eventually(|| counts() == 1));
        running.stop();
        let read = Read::of(&path);
        let events = read.events("trips");
        let at = events.iter().position(|e| e.kind == kind).unwrap();
        let before = events[..at]
            .iter()
            .filter(|e| e.kind == Kind::Begin)
            .count();
        assert_eq!(before, 3, "{cause}");
        if cause != "panic" {
            // It goes on for half of its ring, or for a second on a machine that is busy.
            assert!(
                events.len() - at > 5,
                "{cause}: {} events after",
                events.len() - at
            );
        }
        assert!(!read.events("ticks").is_empty());
        assert!(read.id(NameKind::Handle, "trips/timer:0") > 0);
        std::fs::remove_file(&path).unwrap();
    }
}

/// Four threads that take every CPU they can get, in the same class as the program's, for as long
/// as this lives.
struct Hogs {
    stop: Arc<AtomicBool>,
    threads: Vec<std::thread::JoinHandle<()>>,
}

impl Hogs {
    fn start() -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let hog = || {
            let stop = Arc::clone(&stop);
            std::thread::spawn(move || while !stop.load(Ordering::Relaxed) {})
        };
        let threads = (0..4).map(|_| hog()).collect();
        Self { stop, threads }
    }
}

impl Drop for Hogs {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.threads.drain(..).for_each(|t| t.join().unwrap());
    }
}

/// A ring of 128 records is full within milliseconds, and the thread that writes dumps comes late:
/// what led to the trigger is there all the same, and as much after it.
#[test]
fn a_dump_of_a_busy_ring_has_its_trigger_beside_hogs() {
    let _dog = watchdog("dumps beside hogs", LIMIT);
    let directory = Directory::new("dumps-hogs");
    let ctx = Context::in_process();
    let (mut exec, _log) = executor(&ctx);
    exec.ledger(&directory.0)
        .recorder(4096)
        .dump(Dump::to(&directory.0).on_miss().per_minute(5));
    let options = HandleOptions::new().deadline(LATE, OnMiss::Count);
    let (mark, mut n) = (Mark::new("n"), 0);
    let busy = move |cx: &CallbackContext<'_>| {
        // Once in 200 releases it is late; in between it fills its ring again and again.
        n += 1;
        (0..100).for_each(|_| cx.mark(mark, n));
        if n % 200 == 100 {
            std::thread::sleep(LATE + LATE / 10);
        }
    };
    let worker = exec.worker("busy").timer(MS, busy);
    let _ = worker.unwrap().options(options);
    let hogs = Hogs::start();
    let running = exec.start().unwrap();
    assert!(eventually(|| directory.files("dump").len() >= 3));
    let live = || Read::of(&directory.recording()).events("busy");
    // It has gone on since, and said so.
    assert!(eventually(|| live().iter().all(|e| e.kind != Kind::Gap)));
    running.stop();
    drop(hogs);
    let dumps = directory.files("dump");
    assert!(dumps.len() >= 3);
    for dump in dumps {
        let events = Read::of(&dump).events("busy");
        let miss = |e: &Event| e.kind == Kind::Miss && e.a > 0;
        let at = events.iter().position(miss).expect("its trigger");
        assert!(at >= 60, "{at} events before");
        assert!(events.len() - at <= 65, "{} after", events.len() - at);
        assert!(events.iter().all(|e| e.kind != Kind::Gap));
    }
}

#[test]
fn dumps_are_limited_and_those_that_are_left_out_are_counted() {
    let _dog = watchdog("limits of dumps", LIMIT);
    let directory = Directory::new("dumps-limits");
    // Every release is missed.
    let missing = |dump: Dump| {
        let ctx = Context::in_process();
        let (mut exec, log) = executor(&ctx);
        exec.ledger(&directory.0).recorder(4096).dump(dump);
        let options = HandleOptions::new().deadline(Duration::from_nanos(1), OnMiss::Count);
        exec.worker("w").timer(MS, |_| ()).unwrap().options(options);
        (exec.start().unwrap(), log)
    };
    let counts = || {
        let view = Read::of(&directory.recording()).view;
        (view.dumps, view.dumps_suppressed)
    };
    let to = || Dump::to(&directory.0).on_miss();
    for (dump, files) in [(to().per_minute(2), 2), (to().bytes(1 << 10), 0)] {
        let (running, _log) = missing(dump);
        assert!(eventually(|| counts().1 >= 3));
        assert_eq!(counts().0, files);
        running.stop();
        assert_eq!(directory.dumped().len() as u64, files);
        directory
            .files("dump")
            .iter()
            .for_each(|p| std::fs::remove_file(p).unwrap());
        assert_eq!(directory.files("part"), Vec::<PathBuf>::new());
    }
    // At the end: a dump of the stop alone, and none without it.
    let (running, _log) = missing(Dump::to(&directory.0).on_stop());
    assert!(eventually(|| !Read::of(&directory.recording())
        .events("w")
        .is_empty()));
    running.stop();
    assert_eq!(directory.dumped(), ["stop"]);
    let (running, log) = missing(Dump::to(directory.0.join("nowhere")).on_miss());
    assert!(log.has("no dumps are written to"), "{:?}", log.lines());
    running.stop();
}
