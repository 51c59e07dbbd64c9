//! The image: an entry point, a heap and pong, on a port of two registers in memory.
#![expect(unsafe_code, reason = "the linker must find the entry by its name")]

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU8, Ordering};
use replenish_os::freertos::SealedHeap;

/// Counted apart from the rest: what set-up takes of it is measured on the board.
#[global_allocator]
static HEAP: SealedHeap<16> = SealedHeap::new();

/// The port's stand-in: the compiler may not guess its value.
static PORT: AtomicU8 = AtomicU8::new(0);

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}

#[unsafe(no_mangle)]
extern "C" fn entry() -> ! {
    #[cfg(not(feature = "empty"))]
    drop(replenish_os::freertos::start(50, 4096, || {
        PORT.store(u8::from(pong::run().is_ok()), Ordering::Relaxed);
    }));
    loop {
        PORT.store(PORT.load(Ordering::Relaxed), Ordering::Relaxed);
    }
}

#[cfg(not(feature = "empty"))]
mod pong {
    use super::{HEAP, Ordering, PORT};
    use core::time::Duration;
    use replenish::middleware::xrce::{Port, PortTransport, Xrce, XrceConfig};
    use replenish::msg::std_msgs::Int32;
    use replenish::{Budget, Context, Error, Executor, Policy, Qos};
    use replenish_os::{Arc, Notify};

    struct Registers;

    impl Port for Registers {
        fn read(&self, into: &mut [u8]) -> usize {
            let len = usize::from(PORT.load(Ordering::Relaxed));
            for byte in into.iter_mut().take(len) {
                *byte = PORT.load(Ordering::Relaxed);
            }
            len.min(into.len())
        }

        fn write(&self, bytes: &[u8]) -> usize {
            for byte in bytes {
                PORT.store(*byte, Ordering::Relaxed);
            }
            bytes.len()
        }

        fn attach(&self, bell: &Arc<Notify>) {
            bell.set();
        }

        fn baud(&self) -> u32 {
            115_200
        }
    }

    static WORKERS: &[(&str, &str, &str, u8)] = &[
        ("high", "high_ping", "high_pong", 60),
        ("low", "low_ping", "low_pong", 50),
    ];

    pub(super) fn run() -> Result<(), Error> {
        let config = XrceConfig {
            key: Some(*b"pong"),
            mtu: 128,
            window: 2,
            max_sample: 64,
            journal: 640,
            ..XrceConfig::small()
        };
        let port = PortTransport::new(Registers, config.mtu);
        let context = Context::new(Xrce::over("agent", port, config)?);
        let node = context.node("pong")?;
        let mut exec = Executor::new(&context);
        for &(name, ping, pong, priority) in WORKERS {
            let answer = node.publisher::<Int32>(pong, Qos::best_effort())?;
            let budget = Budget::of(Duration::from_millis(30)).every(Duration::from_millis(100));
            exec.worker(name)
                .policy(Policy::fifo(priority)?)
                .budget(budget)
                .stack_size(2048)
                .subscribe(&node, ping, Qos::best_effort(), move |ping: &Int32, _| {
                    answer.publish(ping)
                })?;
        }
        let running = exec.start()?;
        HEAP.seal();
        loop {
            replenish_os::clock::sleep_until(u64::from(running.usage("high").is_some()));
        }
    }
}
