//! Messages that are lent: every subscription of the process reads the memory that the publisher
//! filled; bytes are written only for those that need them, and once.

use crate::common::{Gate, eventually, executor, settles};
use replenish::middleware::InProcessBus;
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::msg::{CdrError, CdrReader, CdrWriter, Message};
use replenish::{Context, Error, Pool, PublishError, Qos, RawType, SpinEnd, Topic};
use replenish_interfaces::sensor_msgs::msg::{Image, ImageView};
use replenish_testkit::domain::domain;
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const PIXELS: usize = 1_000_000;

/// The ROS type of [`Image`]'s number alone, in another Rust type.
#[derive(Default, Clone)]
struct Other(Vec<u8>);

impl Message for Other {
    const TYPE_NAME: &'static str = Image::TYPE_NAME;
    const DDS_TYPE_NAME: &'static str = Image::DDS_TYPE_NAME;
    const MAX_SIZE: usize = 64;
    const BOUNDED: bool = false;

    fn encode(&self, _: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        unreachable!("it is only read")
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        let mut image = Image::default();
        image.decode(r)?;
        self.0 = image.data;
        Ok(())
    }
}

/// A number that counts how often it is encoded and decoded.
#[derive(Default, Clone)]
pub(crate) struct Numbered(pub(crate) u32);

static ENCODED: AtomicU32 = AtomicU32::new(0);

impl Message for Numbered {
    const TYPE_NAME: &'static str = "test_msgs/msg/Numbered";
    const DDS_TYPE_NAME: &'static str = "test_msgs::msg::dds_::Numbered_";
    const MAX_SIZE: usize = 4;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        if self.0 >= COUNTED {
            ENCODED.fetch_add(1, Ordering::SeqCst);
        }
        w.u32(self.0)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.0 = r.u32()?;
        Ok(())
    }
}

/// Numbers from here on are of one test alone.
const COUNTED: u32 = 1_000_000;

fn newest() -> Qos {
    Qos::reliable().keep_last(1)
}

fn camera(ctx: &Context, messages: usize) -> Pool<Image> {
    let node = ctx.node("camera").unwrap();
    let topic = Topic::named("/image").max_size(PIXELS + 100);
    let pixels = || Image {
        data: vec![0; PIXELS],
        ..Image::default()
    };
    let out = node.publisher::<Image>(topic, newest()).unwrap();
    out.pool(messages, pixels).unwrap()
}

/// Numbers of images, and where they were.
type Places = Arc<Mutex<Vec<(u32, usize)>>>;

#[test]
fn three_workers_read_the_very_memory_that_the_publisher_filled() {
    let _dog = watchdog("three workers, one memory", LIMIT);
    let bus = InProcessBus::new();
    // The camera's context is another one of the same process.
    let (here, there) = (
        Context::new(bus.participant()),
        Context::new(bus.participant()),
    );
    let images = camera(&there, 7);
    let node = here.node("viewer").unwrap();
    let (mut exec, _) = executor(&here);
    let seen: [Places; 3] = Default::default();
    for (worker, seen) in ["a", "b", "c"].into_iter().zip(&seen) {
        let seen = Arc::clone(seen);
        exec.worker(worker)
            .subscribe(&node, "/image", newest(), move |image: &Image, cx| {
                let filled = image.data.iter().all(|b| u32::from(*b) == image.height);
                assert!(filled && image.data.len() == PIXELS);
                assert_eq!(cx.sequence(), Some(image.height.into()));
                let place = image.data.as_ptr() as usize;
                seen.lock().unwrap().push((image.height, place));
            })
            .unwrap();
    }
    let running = exec.start().unwrap();
    let mut published = Vec::new();
    for number in 1..=20_u32 {
        let mut image = images.loan().unwrap();
        image.height = number;
        image.data.fill(u8::try_from(number).unwrap());
        published.push((number, image.data.as_ptr() as usize));
        image.publish().unwrap();
        let all = |seen: &Arc<Mutex<Vec<_>>>| seen.lock().unwrap().last() == published.last();
        assert!(eventually(|| seen.iter().all(all)));
    }
    for seen in &seen {
        assert_eq!(*seen.lock().unwrap(), published);
    }
    assert!(eventually(|| images.free() == 7), "{images:?}");
    let report = running.stop();
    for handle in &report.handles {
        let stats = &handle.stats;
        assert_eq!((stats.received, stats.executed), (20, 20), "{stats:?}");
    }
}

/// A subscription of the same type, one of views, one of bytes, one of another Rust type, and one
/// that keeps all: each has all in order, and the message is encoded once.
#[test]
fn readers_that_need_bytes_get_them_and_the_others_do_not() {
    const IMAGES: u32 = 10;
    let _dog = watchdog("bytes and memory", LIMIT);
    let ctx = Context::in_process();
    let images = camera(&ctx, 4);
    let node = ctx.node("n").unwrap();
    let qos = Qos::reliable().keep_last(20);
    let topic = Topic::named("/image").max_size(PIXELS + 100);
    let (mut exec, _) = executor(&ctx);
    let heard: [Arc<Mutex<Vec<u8>>>; 5] = Default::default();
    let [same, view, bytes, other, all] = heard.clone();
    let shared = Arc::new(AtomicUsize::new(0));
    let lent = Arc::clone(&shared);
    let at = Arc::new(AtomicUsize::new(0));
    let filled_at = Arc::clone(&at);
    exec.worker("same")
        .subscribe(&node, "/image", qos, move |m: &Image, _| {
            let place = m.data.as_ptr() as usize;
            let it_is = place == filled_at.load(Ordering::SeqCst);
            lent.fetch_add(usize::from(it_is), Ordering::SeqCst);
            same.lock().unwrap().push(m.data[0]);
        })
        .unwrap();
    exec.worker("view")
        .subscribe_view::<Image, _, _>(&node, topic, qos, move |m: &ImageView<'_>, _| {
            view.lock().unwrap().push(m.data[PIXELS - 1]);
        })
        .unwrap();
    exec.worker("bytes")
        .subscribe_raw(&node, topic, RawType::of::<Image>(), qos, move |m, _| {
            bytes.lock().unwrap().push(*m.last().unwrap());
        })
        .unwrap();
    exec.worker("other")
        .subscribe(&node, topic, qos, move |m: &Other, _| {
            other.lock().unwrap().push(m.0[0]);
        })
        .unwrap();
    exec.worker("all")
        .subscribe(&node, topic, qos.keep_all(20), move |m: &Image, _| {
            all.lock().unwrap().push(m.data[0]);
        })
        .unwrap();
    let running = exec.start().unwrap();
    for number in 1..=IMAGES {
        let mut image = images.loan().unwrap();
        image.data.fill(u8::try_from(number).unwrap());
        at.store(image.data.as_ptr() as usize, Ordering::SeqCst);
        image.publish().unwrap();
        let each = |heard: &Arc<Mutex<Vec<u8>>>| heard.lock().unwrap().len() == number as usize;
        assert!(eventually(|| heard.iter().all(each)), "{heard:?}");
    }
    let expected: Vec<u8> = (1..=10).collect();
    for heard in &heard {
        assert_eq!(*heard.lock().unwrap(), expected);
    }
    assert_eq!(shared.load(Ordering::SeqCst), IMAGES as usize);
    running.stop();
}

#[test]
fn a_message_is_encoded_once_for_all_who_need_bytes_and_not_at_all_without_them() {
    let _dog = watchdog("encoded once", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Numbered>("t", newest()).unwrap();
    let pool = out.pool(4, Numbered::default).unwrap();
    let heard = Arc::new(AtomicU32::new(0));
    let (mut exec, _) = executor(&ctx);
    for worker in ["a", "b"] {
        let heard = Arc::clone(&heard);
        exec.worker(worker)
            .capacity(3)
            .subscribe(&node, "t", newest(), move |m: &Numbered, _| {
                heard.fetch_add(m.0 - COUNTED, Ordering::SeqCst);
            })
            .unwrap();
    }
    let running = exec.start().unwrap();
    let send = |number: u32| {
        let mut message = pool.loan().unwrap();
        message.0 = COUNTED + number;
        message.publish().unwrap();
    };
    send(1);
    assert!(eventually(|| heard.load(Ordering::SeqCst) == 2));
    assert_eq!(ENCODED.load(Ordering::SeqCst), 0, "nobody needs bytes");
    // Two that need them come while it runs, and go again.
    let change = running.handle();
    let ids: Vec<_> = ["a", "b"]
        .into_iter()
        .map(|worker| {
            let heard = Arc::clone(&heard);
            let raw = move |bytes: &[u8], _: &replenish::CallbackContext<'_>| {
                let number = u32::from_le_bytes(bytes.try_into().unwrap());
                heard.fetch_add(number - COUNTED, Ordering::SeqCst);
            };
            let worker = change.worker(worker).unwrap();
            let ty = RawType::of::<Numbered>();
            worker.subscribe_raw(&node, "t", ty, newest(), raw).unwrap()
        })
        .collect();
    send(10);
    assert!(eventually(|| heard.load(Ordering::SeqCst) == 42));
    assert_eq!(ENCODED.load(Ordering::SeqCst), 1, "once for both");
    for id in ids {
        change.remove(&id, replenish::Removal::Wait(LIMIT)).unwrap();
    }
    send(100);
    assert!(eventually(|| heard.load(Ordering::SeqCst) == 242));
    assert_eq!(ENCODED.load(Ordering::SeqCst), 1);
    running.stop();
}

/// Two readers that are slow hold all of a pool's messages; the publisher is told how many there
/// are, waits for nothing, and goes on when one has come back.
#[test]
fn a_slow_reader_exhausts_the_pool_and_the_publisher_is_told() {
    let _dog = watchdog("a slow reader", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let qos = Qos::reliable().keep_last(2);
    let out = node.publisher::<Numbered>("t", qos).unwrap();
    let pool = out.pool(3, Numbered::default).unwrap();
    let (gate, heard) = (Gate::closed(), Arc::new(Mutex::new(Vec::new())));
    let (mut exec, _) = executor(&ctx);
    let (held, note) = (gate.clone(), Arc::clone(&heard));
    exec.worker("slow")
        .subscribe(&node, "t", qos, move |m: &Numbered, _| {
            held.pass();
            note.lock().unwrap().push(m.0); // still the same
        })
        .unwrap();
    let running = exec.start().unwrap();
    let send = |number: u32| {
        let mut message = pool.loan()?;
        message.0 = number;
        message.publish()
    };
    send(1).unwrap();
    gate.arrived();
    send(2).unwrap();
    send(3).unwrap();
    // One is read and two wait.
    for _ in 0..3 {
        let refused = send(4).unwrap_err();
        assert_eq!(refused, PublishError::AllLent { size: 3 });
        assert_eq!(
            refused.to_string(),
            "all 3 messages of the pool are lent, wait for a subscription or are read: \
             Publisher::pool makes a larger one"
        );
    }
    assert_eq!(pool.free(), 0);
    gate.open();
    assert!(eventually(|| pool.free() == 3));
    send(5).unwrap();
    assert!(eventually(|| heard.lock().unwrap().len() == 4));
    assert_eq!(*heard.lock().unwrap(), [1, 2, 3, 5]);
    let report = running.stop();
    assert_eq!(report.handles[0].stats.dropped, 0);
}

/// With messages enough, keep-last drops the oldest, counts it, and its memory is free at once.
#[test]
fn keep_last_drops_the_oldest_message_and_counts_it() {
    let _dog = watchdog("keep last", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let qos = Qos::reliable().keep_last(2);
    let out = node.publisher::<Numbered>("t", qos).unwrap();
    let pool = out.pool(4, Numbered::default).unwrap();
    let (gate, heard) = (Gate::closed(), Arc::new(Mutex::new(Vec::new())));
    let (mut exec, _) = executor(&ctx);
    let (held, note) = (gate.clone(), Arc::clone(&heard));
    exec.worker("slow")
        .subscribe(&node, "t", qos, move |m: &Numbered, _| {
            held.pass();
            note.lock().unwrap().push(m.0);
        })
        .unwrap();
    let running = exec.start().unwrap();
    for number in 1..=50 {
        let mut message = pool.loan().unwrap();
        message.0 = number;
        message.publish().unwrap();
        if number == 1 {
            gate.arrived();
        }
    }
    assert_eq!(pool.free(), 1, "one is read, two wait");
    gate.open();
    assert!(eventually(|| heard.lock().unwrap().len() == 3));
    assert_eq!(*heard.lock().unwrap(), [1, 49, 50]);
    let report = running.stop();
    let stats = report.handles[0].stats;
    assert_eq!((stats.received, stats.dropped, stats.executed), (50, 47, 3));
    assert_eq!(pool.free(), 4);
}

/// One writer's messages in memory and as bytes come in the order in which it wrote them.
#[test]
fn lent_and_ordinary_messages_of_one_publisher_keep_their_order() {
    const MESSAGES: u32 = 3000;
    let _dog = watchdog("order", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let qos = Qos::reliable().keep_last(4096);
    let out = node.publisher::<Numbered>("t", qos).unwrap();
    let pool = out.pool(4000, Numbered::default).unwrap();
    let heard = Arc::new(Mutex::new(Vec::new()));
    let note = Arc::clone(&heard);
    let (mut exec, _) = executor(&ctx);
    exec.worker("w")
        .subscribe(&node, "t", qos, move |m: &Numbered, _| {
            note.lock().unwrap().push(m.0);
        })
        .unwrap();
    let send = |number: u32| {
        if number % 7 < 3 {
            return out.publish(&Numbered(number)).unwrap();
        }
        let mut message = pool.loan().unwrap();
        message.0 = number;
        message.publish().unwrap();
    };
    (0..MESSAGES / 3).for_each(send); // before the executor starts
    let running = exec.start().unwrap();
    (MESSAGES / 3..MESSAGES).for_each(send);
    assert!(eventually(
        || heard.lock().unwrap().len() == MESSAGES as usize
    ));
    assert_eq!(*heard.lock().unwrap(), (0..MESSAGES).collect::<Vec<_>>());
    running.stop();
}

#[test]
fn a_loan_that_is_dropped_goes_back_and_sizes_out_of_range_are_refused() {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Numbered>("t", newest()).unwrap();
    for size in [0, 4097] {
        let Err(Error::Parameter { field, allowed, .. }) = out.pool(size, Numbered::default) else {
            panic!("{size} messages");
        };
        assert_eq!((field, &*allowed), ("pool", "1..=4096"));
    }
    let pool = out.pool(2, || Numbered(7)).unwrap();
    let (mut one, two) = (pool.loan().unwrap(), pool.loan().unwrap());
    assert_eq!((one.0, two.0, pool.free()), (7, 7, 0));
    assert!(pool.loan().is_err());
    one.0 = 8;
    drop(one);
    assert_eq!((pool.free(), pool.loan().unwrap().0), (1, 8), "as it was");
    two.publish().unwrap(); // to nobody
    assert_eq!(pool.free(), 2);
}

#[test]
fn an_executor_without_threads_gets_messages_in_memory() {
    let _dog = watchdog("local", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Numbered>("t", newest()).unwrap();
    let pool = out.pool(2, Numbered::default).unwrap();
    let (mut exec, _) = executor(&ctx);
    let heard = Arc::new(AtomicU32::new(0));
    let note = Arc::clone(&heard);
    exec.worker("w")
        .subscribe(&node, "t", newest(), move |m: &Numbered, _| {
            note.store(m.0, Ordering::SeqCst);
        })
        .unwrap();
    let mut local = exec.local().unwrap();
    for number in 1..=3 {
        let sender = {
            let pool = pool.clone();
            std::thread::spawn(move || {
                std::thread::sleep(Duration::from_millis(20));
                let mut message = pool.loan().unwrap();
                message.0 = number;
                message.publish().unwrap();
            })
        };
        // The wait on the middleware ends when the message comes.
        let spun = local.spin_some(LIMIT);
        assert_eq!((spun.end, spun.callbacks), (SpinEnd::Worked, 1));
        assert_eq!(heard.load(Ordering::SeqCst), number);
        sender.join().unwrap();
    }
    drop(local);
    // Its executor has gone: nobody takes it, and nothing of it is kept.
    let mut message = pool.loan().unwrap();
    message.0 = 9;
    message.publish().unwrap();
    assert_eq!((heard.load(Ordering::SeqCst), pool.free()), (3, 2));
}

/// The publisher and its pool go while a callback reads: it reads on, and nothing is freed there.
#[test]
fn a_pool_may_go_while_its_messages_are_read() {
    let _dog = watchdog("a pool goes", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let images = camera(&ctx, 2);
    let (gate, heard) = (Gate::closed(), Arc::new(AtomicU32::new(0)));
    let (held, note) = (gate.clone(), Arc::clone(&heard));
    let (mut exec, _) = executor(&ctx);
    exec.worker("w")
        .subscribe(&node, "/image", newest(), move |m: &Image, _| {
            held.pass();
            assert!(m.data.iter().all(|b| *b == 5) && m.data.len() == PIXELS);
            note.fetch_add(m.height, Ordering::SeqCst);
        })
        .unwrap();
    let running = exec.start().unwrap();
    for height in [1, 10] {
        let mut image = images.loan().unwrap();
        image.height = height;
        image.data.fill(5);
        image.publish().unwrap();
        gate.arrived();
    }
    drop(images);
    gate.open();
    assert!(eventually(|| heard.load(Ordering::SeqCst) == 11));
    running.stop();
}

/// Late readers of a transient-local publisher get what it keeps; over RTPS the other participant
/// and the own one get bytes.
#[test]
fn late_and_foreign_readers_get_bytes() {
    let _dog = watchdog("late and foreign", LIMIT);
    let latched = Qos::reliable().keep_last(3).transient_local();
    let config = RtpsConfig {
        domain: domain(),
        range: DiscoveryRange::Localhost,
        interfaces: vec![std::net::Ipv4Addr::LOCALHOST],
        ..RtpsConfig::default()
    };
    let rtps = || Context::new(Rtps::open(&config).unwrap());
    let one = Context::in_process();
    for (here, there) in [(one.clone(), one), (rtps(), rtps())] {
        let out = here.node("a").unwrap();
        let out = out.publisher::<Numbered>("/t", latched).unwrap();
        let pool = out.pool(2, Numbered::default).unwrap();
        for number in 1..=5 {
            let mut message = pool.loan().unwrap();
            message.0 = number;
            message.publish().unwrap();
        }
        let (mut exec, _) = executor(&there);
        let heard = Arc::new(Mutex::new(Vec::new()));
        let note = Arc::clone(&heard);
        let node = there.node("b").unwrap();
        exec.worker("w")
            .subscribe(&node, "/t", latched, move |m: &Numbered, _| {
                note.lock().unwrap().push(m.0);
            })
            .unwrap();
        let running = exec.start().unwrap();
        let other = executor(&here).0.start().ok();
        assert!(
            eventually(|| *heard.lock().unwrap() == [3, 4, 5]),
            "{heard:?}"
        );
        let mut message = pool.loan().unwrap();
        message.0 = 6;
        message.publish().unwrap();
        assert!(eventually(|| heard.lock().unwrap().last() == Some(&6)));
        assert!(settles(|| pool.free()) && pool.free() == 2);
        running.stop();
        drop(other);
    }
}
