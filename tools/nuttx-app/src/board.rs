//! QEMU's STM32F405: TIM2 as a clock of 250 ns, and the end of the emulation.

use core::arch::asm;
use core::sync::atomic::{AtomicU32, Ordering};

const RCC_APB1ENR: usize = 0x4002_3840;
const TIM2: usize = 0x4000_0000;
const CR1: usize = TIM2;
const EGR: usize = TIM2 + 0x14;
const CNT: usize = TIM2 + 0x24;
const PSC: usize = TIM2 + 0x28;
const ARR: usize = TIM2 + 0x2C;
/// QEMU clocks its timers with 1 GHz.
const PRESCALER: u32 = 250;

static HIGH: AtomicU32 = AtomicU32::new(0);
static LAST: AtomicU32 = AtomicU32::new(0);

fn set(register: usize, value: u32) {
    // SAFETY: a device register of this chip (RM0090).
    unsafe { (register as *mut u32).write_volatile(value) };
}

fn get(register: usize) -> u32 {
    // SAFETY: a device register of this chip (RM0090).
    unsafe { (register as *const u32).read_volatile() }
}

/// Starts the clock.
pub(crate) fn start_clock() {
    set(RCC_APB1ENR, get(RCC_APB1ENR) | 1);
    set(PSC, PRESCALER - 1);
    set(ARR, u32::MAX);
    set(EGR, 1);
    set(CR1, 1);
}

/// The clock of the shim (`-DRP_CLOCK=app_clock`), in nanoseconds. Read at least every 17 minutes.
#[unsafe(no_mangle)]
extern "C" fn app_clock() -> u64 {
    let before: u32;
    // SAFETY: reads PRIMASK and masks all interrupts.
    unsafe { asm!("mrs {b}, PRIMASK", "cpsid i", b = out(reg) before, options(nostack)) };
    let count = get(CNT);
    if count < LAST.load(Ordering::Relaxed) {
        HIGH.store(HIGH.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
    }
    LAST.store(count, Ordering::Relaxed);
    let high = HIGH.load(Ordering::Relaxed);
    // SAFETY: `before` is what was read above.
    unsafe { asm!("msr PRIMASK, {}", in(reg) before, options(nostack)) };
    (u64::from(high) << 32 | u64::from(count)) * u64::from(PRESCALER)
}

/// Ends the emulation (Arm semihosting, `SYS_EXIT`).
pub(crate) fn exit(good: bool) -> ! {
    let reason = if good { 0x2_0026 } else { 0x2_0023 };
    // SAFETY: a semihosting call that does not return.
    unsafe { asm!("bkpt 0xAB", in("r0") 0x18, in("r1") reason, options(nostack)) };
    loop {
        core::hint::spin_loop();
    }
}
