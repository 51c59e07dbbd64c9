//! `replenish bench in-process`: a message to several workers of one process, lent or encoded.
//!
//! ```text
//!   publisher ── loan, touch, publish ──► worker 1, worker 2, …: note the time and the place
//! ```
//!
//! The time of a message is from before its publication to the start of the last callback. Copies
//! are counted by what callbacks see: the bytes of a message that is not at the place in memory
//! where its publisher filled it. Every thread is on one CPU; the workers are above the publisher.
//!
//! After each message as many bare threads are woken by futexes (`wake_floor`): no way to so many
//! workers is shorter.

use super::wake_floor::WakeFloor;
use crate::load::spec::{DISPATCHER_PRIORITY, HIGH_PRIORITY, SUPPORT_PRIORITY};
use replenish::interfaces::sensor_msgs::msg::Image;
use replenish::{Context, Executor, Qos, Topic};
use replenish_cli::lock;
use replenish_cli::machine::cpus::{self, Cpus};
use replenish_cli::machine::fifo_or_other;
use replenish_cli::machine::stats::{Sorted, us};
use replenish_cli::options::JsonOption;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::files;
use replenish_cli::report::table::Table;
use replenish_os::{ThreadSpec, clock, current_tid, granted, spawn};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// From one message to the next, in ns.
const PERIOD: u64 = 1_000_000;
/// Messages before those that count.
const WARM_UP: usize = 50;
/// A worker that has not begun its callback by then, in ns, never will.
const LIMIT: u64 = 10_000_000_000;
/// Bytes of an encoded image besides its pixels, and some.
const HEAD: usize = 200;

/// Options of `bench in-process`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Bytes of a message; a row for each.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_values_t = [64, 1_000, 64_000, 1_000_000],
          value_parser = clap::value_parser!(u64).range(1..=16_000_000))]
    bytes: Vec<u64>,

    /// Workers that get each message.
    #[arg(long, value_name = "N", default_value_t = 3,
          value_parser = clap::value_parser!(u64).range(1..=16))]
    readers: u64,

    /// Messages of each size, one a millisecond.
    #[arg(long, value_name = "N", default_value_t = 1_000,
          value_parser = clap::value_parser!(u64).range(10..=1_000_000))]
    samples: u64,

    /// Publish the messages encoded, as without a pool, to compare.
    #[arg(long)]
    encoded: bool,

    /// The CPU of all threads.
    #[arg(long, value_name = "CPU")]
    cpu: Option<usize>,

    #[command(flatten)]
    json: JsonOption,
}

/// One size. The names are a contract.
#[derive(Debug, Clone, serde::Serialize)]
pub(crate) struct InProcessPoint {
    /// Bytes of a message.
    pub(crate) bytes: usize,
    /// Workers that got each.
    pub(crate) readers: usize,
    /// From before the publication to the start of the last callback.
    pub(crate) p50_us: f64,
    /// From before the first wake-up to the start of the last one of as many bare threads.
    pub(crate) floor_us: f64,
    /// CPU time of the publisher for a publication, wake-ups included.
    pub(crate) publisher_us: f64,
    /// CPU time of the same thread for waking the bare threads.
    pub(crate) floor_publisher_us: f64,
    /// Bytes that callbacks found elsewhere than where they were written, of all messages.
    pub(crate) copied_bytes: u64,
}

/// `bench in-process --json`.
#[derive(Debug, serde::Serialize)]
struct Json {
    in_process: Vec<InProcessPoint>,
    lent: bool,
    samples: usize,
    granted: String,
}

/// The conditions of a row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Setting {
    /// Workers that get each message.
    pub(crate) readers: usize,
    /// Messages that count.
    pub(crate) samples: usize,
    /// From a pool, or encoded.
    pub(crate) lent: bool,
    /// The CPU of all threads.
    pub(crate) cpu: usize,
}

/// Runs the benchmark.
pub(crate) fn run(args: &Args) -> Outcome {
    cpus::check("--cpu", args.cpu)?;
    files::check_writable(args.json.json.as_deref())?;
    let size = |n: u64| usize::try_from(n).unwrap_or(usize::MAX);
    let setting = Setting {
        readers: size(args.readers),
        samples: size(args.samples),
        lent: !args.encoded,
        cpu: args.cpu.unwrap_or_else(|| Cpus::choose().measured),
    };
    let bytes: Vec<usize> = args.bytes.iter().map(|n| size(*n)).collect();
    let _alone = lock::acquire()?;
    let (in_process, granted) = in_process(&bytes, setting)?;
    let mut table = Table::new(&[
        "bytes",
        "workers",
        "p50 us",
        "floor us",
        "publisher CPU us",
        "floor CPU us",
        "copied bytes",
    ]);
    for point in &in_process {
        table.row([
            point.bytes.to_string(),
            point.readers.to_string(),
            format!("{:.1}", point.p50_us),
            format!("{:.1}", point.floor_us),
            format!("{:.1}", point.publisher_us),
            format!("{:.1}", point.floor_publisher_us),
            point.copied_bytes.to_string(),
        ]);
    }
    let how = if setting.lent { "lent" } else { "encoded" };
    println!(
        "{}  {} messages each, {how}; from the publication to the start of the last callback, all \
         threads on CPU {}, the publisher {granted}; floor: as many bare threads, woken by futexes",
        table.to_text(),
        setting.samples,
        setting.cpu,
    );
    let json = Json {
        in_process,
        lent: setting.lent,
        samples: setting.samples,
        granted,
    };
    files::write_json(args.json.json.as_deref(), "bench-in-process", &json)
}

/// Measures each size on a thread of its own; the policy that the publisher was granted.
pub(crate) fn in_process(
    bytes: &[usize],
    setting: Setting,
) -> Result<(Vec<InProcessPoint>, String), Failure> {
    let bytes = bytes.to_vec();
    let spec = ThreadSpec::new("in-process")
        .policy(fifo_or_other(SUPPORT_PRIORITY))
        .cpu(setting.cpu);
    let measured = spawn(spec, move || {
        let granted = granted(current_tid()).map_err(Failure::refused)?;
        let points = bytes.iter().map(|bytes| point(*bytes, setting));
        Ok((points.collect::<Result<_, _>>()?, granted.to_string()))
    });
    let measured = measured.map_err(Failure::refused)?.join();
    measured.map_err(|_| Failure::refused("the benchmark's thread panicked"))?
}

/// Figures that the callbacks noted.
#[derive(Default)]
struct Seen {
    /// Address of the memory in which the message was filled.
    place: AtomicUsize,
    begun: AtomicUsize,
    last_start: AtomicU64,
    copied: AtomicU64,
}

fn point(bytes: usize, setting: Setting) -> Result<InProcessPoint, Failure> {
    let context = Context::in_process();
    let node = context.node("bench").map_err(Failure::refused)?;
    let topic = Topic::named("image").max_size(bytes + HEAD);
    let qos = Qos::reliable().keep_last(1);
    let image = Image {
        data: vec![0; bytes],
        ..Image::default()
    };
    let out = node
        .publisher::<Image>(topic, qos)
        .map_err(Failure::refused)?;
    let pool = out
        .pool(2 * setting.readers + 1, || image.clone())
        .map_err(Failure::refused)?;
    let mut executor = Executor::new(&context);
    executor.no_ledger();
    executor.dispatcher(fifo_or_other(DISPATCHER_PRIORITY));
    executor.dispatcher_cpu(setting.cpu);
    let seen = Arc::new(Seen::default());
    for reader in 0..setting.readers {
        let seen = Arc::clone(&seen);
        executor
            .worker(&format!("reader{reader}"))
            .policy(fifo_or_other(HIGH_PRIORITY))
            .cpu(setting.cpu)
            .subscribe(&node, topic, qos, move |image: &Image, cx| {
                seen.last_start.fetch_max(cx.started(), Ordering::Relaxed);
                if image.data.as_ptr() as usize != seen.place.load(Ordering::Relaxed) {
                    let copied = image.data.len() as u64;
                    seen.copied.fetch_add(copied, Ordering::Relaxed);
                }
                seen.begun.fetch_add(1, Ordering::Release);
            })
            .map_err(Failure::refused)?;
    }
    let running = executor.start().map_err(Failure::refused)?;
    let floor = WakeFloor::start(setting.readers, setting.cpu)?;
    let mut times = Times::default();
    let mut own = image.clone();
    let mut due = clock::monotonic();
    for number in 0..setting.samples + WARM_UP {
        due += PERIOD;
        clock::sleep_until(due);
        seen.begun.store(0, Ordering::Relaxed);
        seen.last_start.store(0, Ordering::Relaxed);
        let (began, cpu) = if setting.lent {
            let mut lent = pool.loan().map_err(Failure::refused)?;
            let place = touch(&mut lent, number);
            seen.place.store(place, Ordering::Relaxed);
            let (cpu, began) = (clock::thread_cpu(), clock::monotonic());
            lent.publish().map_err(Failure::refused)?;
            (began, clock::thread_cpu().saturating_sub(cpu))
        } else {
            let place = touch(&mut own, number);
            seen.place.store(place, Ordering::Relaxed);
            let (cpu, began) = (clock::thread_cpu(), clock::monotonic());
            out.publish(&own).map_err(Failure::refused)?;
            (began, clock::thread_cpu().saturating_sub(cpu))
        };
        while seen.begun.load(Ordering::Acquire) < setting.readers {
            let now = clock::monotonic();
            if now > began + LIMIT {
                return Err(Failure::refused("a worker did not get a message"));
            }
            clock::sleep_until(now + PERIOD / 20);
        }
        let bare = floor.wake()?;
        if number >= WARM_UP {
            let last = seen.last_start.load(Ordering::Relaxed);
            times.note((last.saturating_sub(began), cpu), bare);
        } else {
            seen.copied.store(0, Ordering::Relaxed);
        }
    }
    running.stop();
    floor.stop()?;
    let [p50_us, publisher_us, floor_us, floor_publisher_us] =
        times.0.map(|times| us(Sorted::new(times).median()));
    Ok(InProcessPoint {
        bytes,
        readers: setting.readers,
        p50_us,
        floor_us,
        publisher_us,
        floor_publisher_us,
        copied_bytes: seen.copied.load(Ordering::Relaxed),
    })
}

/// Times of the messages that count: to the last callback, CPU of the publisher, and both of the
/// floor.
#[derive(Default)]
struct Times([Vec<i64>; 4]);

impl Times {
    fn note(&mut self, ours: (u64, u64), floor: (u64, u64)) {
        let new = [ours.0, ours.1, floor.0, floor.1];
        for (times, new) in self.0.iter_mut().zip(new) {
            times.push(i64::try_from(new).unwrap_or(i64::MAX));
        }
    }
}

/// Writes into the message, as a camera would; the place of its pixels.
fn touch(image: &mut Image, number: usize) -> usize {
    image.height = u32::try_from(number).unwrap_or(u32::MAX);
    if let Some(first) = image.data.first_mut() {
        *first = first.wrapping_add(1);
    }
    image.data.as_ptr() as usize
}
