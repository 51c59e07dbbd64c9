//! The image: an entry point, a heap and the talker, on a link of two registers in memory.
#![expect(unsafe_code, reason = "the linker must find the entry by its name")]

use crate::chatter::{DATAGRAM, Talker};
use core::net::SocketAddr;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU8, AtomicU32, Ordering};
use replenish_os::freertos::SealedHeap;
use replenish_rtps::wire::GuidPrefix;

/// Counted apart from the rest: what set-up takes of it is measured on the board.
#[global_allocator]
static HEAP: SealedHeap<16> = SealedHeap::new();

/// The stand-ins of link and clock: the compiler may not guess their values.
static LINK: AtomicU8 = AtomicU8::new(0);
static CLOCK: AtomicU32 = AtomicU32::new(0);

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}

#[unsafe(no_mangle)]
extern "C" fn entry() -> ! {
    let link = || LINK.load(Ordering::Relaxed);
    let now = || u64::from(CLOCK.load(Ordering::Relaxed));
    let own: SocketAddr = ([192, 168, 7, link()], 7410).into();
    let group: SocketAddr = ([239, 255, 0, 1], 7400).into();
    let (mut buf, mut datagram) = ([0; DATAGRAM], [0; DATAGRAM]);
    if let Ok(mut talker) = Talker::new(0, GuidPrefix([link(); 12]), own, &[group], now()) {
        HEAP.seal();
        loop {
            let len = usize::from(link());
            for byte in datagram.iter_mut().take(len) {
                *byte = link();
            }
            talker.receive(datagram.get(..len).unwrap_or(&[]), now());
            while let Some((len, _)) = talker.poll(&mut buf, now()) {
                for byte in buf.iter().take(len) {
                    LINK.store(*byte, Ordering::Relaxed);
                }
            }
        }
    }
    loop {
        LINK.store(link(), Ordering::Relaxed);
    }
}
