//! The executor: a dispatcher, and a worker with a budget that receives; the ping's main thread
//! sends.

use super::flood::pour;
use super::ping::{LONGEST, Ping};
use crate::load::burn::burn;
use crate::load::spec::SUPPORT_PRIORITY;
use crate::load::{MS, Nanos};
use replenish::interfaces::std_msgs::msg::{UInt8MultiArray, UInt8MultiArrayView};
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::msg::std_msgs::UInt64;
use replenish::{Budget, Context, Executor, Node, Publisher, Qos, RunningExecutor, Topic};
use replenish_cli::machine::fifo_or_other;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_os::clock;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::Receiver;
use std::time::Duration;

/// CDR of a sample without data.
const HEAD: usize = 12;

/// The number of the sample that came last, and when.
#[derive(Default)]
struct Last {
    number: AtomicU64,
    at: AtomicU64,
}

pub(super) struct Ours {
    publisher: Publisher<UInt8MultiArray>,
    last: Arc<Last>,
    data: Vec<u8>,
    _running: RunningExecutor,
}

fn node(domain: u16, name: &str, shared_memory: bool) -> Result<(Node, Executor), Failure> {
    let config = RtpsConfig {
        domain,
        range: DiscoveryRange::Localhost,
        interfaces: vec![std::net::Ipv4Addr::LOCALHOST],
        shared_memory,
        ..RtpsConfig::default()
    };
    let context = Context::new(Rtps::open(&config).map_err(Failure::refused)?);
    let mut executor = Executor::new(&context);
    executor.no_ledger().admission(false);
    executor.dispatcher(fifo_or_other(SUPPORT_PRIORITY));
    let node = context.node(name).map_err(Failure::refused)?;
    Ok((node, executor))
}

fn topic(name: &str) -> Topic<'_> {
    Topic::named(name).max_size(LONGEST)
}

fn budget() -> Budget {
    Budget::of(Duration::from_millis(80)).every(Duration::from_millis(100))
}

fn number(sample: &UInt8MultiArrayView<'_>) -> u64 {
    let bytes = sample.data.first_chunk::<8>();
    bytes.map_or(0, |bytes| u64::from_le_bytes(*bytes))
}

impl Ours {
    pub(super) fn start(domain: u16, shared: bool) -> Result<Self, Failure> {
        let (node, mut executor) = node(domain, "ping", shared)?;
        let publisher = node.publisher(topic("there"), Qos::reliable());
        let last = Arc::new(Last::default());
        let heard = Arc::clone(&last);
        executor
            .worker("worker")
            .budget(budget())
            .subscribe_view::<UInt8MultiArray, _, _>(
                &node,
                topic("back"),
                Qos::reliable(),
                move |sample, _| {
                    heard.at.store(clock::monotonic(), Ordering::Relaxed);
                    heard.number.store(number(sample), Ordering::Release);
                },
            )
            .map_err(Failure::refused)?;
        Ok(Self {
            publisher: publisher.map_err(Failure::refused)?,
            last,
            data: vec![0; LONGEST],
            _running: executor.start().map_err(Failure::refused)?,
        })
    }
}

impl Ping for Ours {
    /// The main thread does not run meanwhile, so that it costs no more than a `recv` that waits.
    fn round_trip(
        &mut self,
        number: u64,
        bytes: usize,
        until: Nanos,
    ) -> Result<Option<Nanos>, Failure> {
        let data = self.data.get_mut(..bytes - HEAD).unwrap_or_default();
        if let Some(stamp) = data.first_chunk_mut::<8>() {
            *stamp = number.to_le_bytes();
        }
        let sample = UInt8MultiArrayView {
            data,
            ..UInt8MultiArrayView::default()
        };
        let sent = clock::monotonic();
        self.publisher
            .publish_view(&sample)
            .map_err(Failure::refused)?;
        let mut look = sent + if bytes < 100_000 { 400_000 } else { 8 * MS };
        loop {
            clock::sleep_until(look.min(until));
            if self.last.number.load(Ordering::Acquire) == number {
                return Ok(Some(self.last.at.load(Ordering::Relaxed)));
            }
            if look >= until {
                return Ok(None);
            }
            look += MS;
        }
    }
}

/// The node of an echo, its executor with the worker that answers.
fn answers(domain: u16, shared: bool) -> Result<(Node, Executor), Failure> {
    let (node, mut executor) = node(domain, "echo", shared)?;
    let publisher = node.publisher::<UInt8MultiArray>(topic("back"), Qos::reliable());
    let publisher = publisher.map_err(Failure::refused)?;
    executor
        .worker("worker")
        .budget(budget())
        .subscribe_view::<UInt8MultiArray, _, _>(
            &node,
            topic("there"),
            Qos::reliable(),
            move |sample, _| publisher.publish_view(sample),
        )
        .map_err(Failure::refused)?;
    Ok((node, executor))
}

pub(super) fn echo(domain: u16, shared: bool) -> Outcome {
    let (_node, executor) = answers(domain, shared)?;
    println!("ready");
    executor.spin().map(drop).map_err(Failure::refused)
}

/// The flood's quality of service: its reader keeps a few, and the kernel drops the rest.
fn poured() -> Qos {
    Qos::best_effort().keep_last(10)
}

/// As [`echo`], beside a worker that is flooded.
///
/// It has a tenth of the CPU, with twice the period of the loop's worker, which has the higher
/// priority by that.
pub(super) fn control(domain: u16, commands: &Receiver<String>) -> Outcome {
    let (node, mut executor) = answers(domain, true)?;
    executor
        .worker("flood")
        .budget(Budget::of(Duration::from_millis(20)).every(Duration::from_millis(200)))
        .subscribe(&node, "flood", poured(), |_: &UInt64, _| {
            burn(20_000, Nanos::MAX, |_| ());
        })
        .map_err(Failure::refused)?;
    let running = executor.start().map_err(Failure::refused)?;
    println!("ready");
    while commands.recv().is_ok() {
        let report = running.report();
        let mut handles = report.handles.iter();
        let flood = handles.find(|handle| handle.worker == "flood");
        let cpu = |name| {
            let mut threads = report.threads.iter();
            let usage = threads.find(|thread| thread.name == name);
            usage.map_or(0, |thread| thread.usage.cpu_high + thread.usage.cpu_low)
        };
        println!(
            "counts {} {} {}",
            flood.map_or(0, |handle| handle.stats.lost + handle.stats.dropped),
            cpu("dispatcher"),
            cpu("flood")
        );
    }
    Ok(())
}

/// Sends the flood when it is told to.
pub(super) fn flood(domain: u16, commands: &Receiver<String>) -> Outcome {
    let (node, executor) = node(domain, "flood", true)?;
    let publisher = node.publisher::<UInt64>("flood", poured());
    let publisher = publisher.map_err(Failure::refused)?;
    let _running = executor.start().map_err(Failure::refused)?;
    let found = publisher.wait_for_subscription(Duration::from_secs(30));
    if !found.map_err(Failure::refused)? {
        return Err(Failure::refused("the flooded subscription is not found"));
    }
    println!("ready");
    while let Ok(line) = commands.recv() {
        let time = line.split(' ').nth(1).and_then(|word| word.parse().ok());
        let mut data = 0;
        let sent = pour(time.unwrap_or(0), &mut || {
            data += 1;
            publisher.publish(&UInt64 { data }).ok();
        });
        println!("sent {sent}");
    }
    Ok(())
}
