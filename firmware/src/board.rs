//! Reset, vectors and interrupts.

use crate::console;
use crate::say;
use crate::time;
use core::panic::PanicInfo;

// `image_main` is the first function of the image, with memory and clock set up.
unsafe extern "C" {
    fn image_main() -> !;
    fn SVCall();
    fn PendSV();
    fn SysTick();
    static mut __data_start: u32;
    static mut __data_end: u32;
    static __data_load: u32;
    static mut __bss_start: u32;
    static mut __bss_end: u32;
    static __stack_top: u32;
}

/// A vector: a function or the initial stack.
#[derive(Clone, Copy)]
pub union Vector {
    function: unsafe extern "C" fn(),
    reset: unsafe extern "C" fn() -> !,
    stack: *const u32,
    reserved: usize,
}

// SAFETY: read by hardware only.
unsafe impl Sync for Vector {}

const NONE: Vector = Vector { reserved: 0 };
const UNEXPECTED: Vector = Vector {
    function: unexpected,
};

#[unsafe(no_mangle)]
#[unsafe(link_section = ".vectors")]
#[used]
static VECTORS: [Vector; 16 + 82] = {
    let mut v = [UNEXPECTED; 16 + 82];
    v[0] = Vector {
        stack: &raw const __stack_top,
    };
    v[1] = Vector { reset: Reset };
    v[3] = Vector { function: fault };
    v[7] = NONE;
    v[11] = Vector { function: SVCall };
    v[14] = Vector { function: PendSV };
    v[15] = Vector { function: SysTick };
    v[16 + crate::regs::IRQ_TIM5] = Vector { function: tim5 };
    v[16 + crate::regs::IRQ_TIM3] = Vector { function: tim3 };
    v[16 + crate::regs::IRQ_USART2] = Vector { function: usart2 };
    v
};

/// The chip comes out of reset here.
///
/// # Safety
/// Called by hardware only.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn Reset() -> ! {
    // SAFETY: the linker script's symbols delimit data, its load image and bss; nothing runs yet.
    unsafe {
        let data = &raw mut __data_start;
        let words = (&raw mut __data_end).offset_from_unsigned(data);
        data.copy_from_nonoverlapping(&raw const __data_load, words);
        let bss = &raw mut __bss_start;
        let words = (&raw mut __bss_end).offset_from_unsigned(bss);
        bss.write_bytes(0, words);
        // CP10 and CP11: the floating-point unit.
        (0xE000_ED88 as *mut u32).write_volatile(0xF << 20);
        core::arch::asm!("dsb", "isb");
    }
    time::start();
    replenish_os::freertos::on_stop(|| console::exit(false));
    // SAFETY: the image defines it.
    unsafe { image_main() }
}

unsafe extern "C" fn tim5() {
    time::alarm();
}

unsafe extern "C" fn tim3() {
    crate::line::tick();
}

unsafe extern "C" fn usart2() {
    if let Some(handler) = UART.get() {
        handler();
    }
}

static UART: Hook = Hook(core::sync::atomic::AtomicPtr::new(core::ptr::null_mut()));

/// A function that an interrupt calls.
struct Hook(core::sync::atomic::AtomicPtr<()>);

impl Hook {
    fn get(&self) -> Option<fn()> {
        let raw = self.0.load(core::sync::atomic::Ordering::Acquire);
        // SAFETY: null or what `on_usart2` stored, a function.
        unsafe { core::mem::transmute::<*mut (), Option<fn()>>(raw) }
    }
}

/// Names the function that handles USART2's interrupt.
pub fn on_usart2(handler: fn()) {
    UART.0
        .store(handler as *mut (), core::sync::atomic::Ordering::Release);
}

unsafe extern "C" fn unexpected() {
    let active: u32;
    // SAFETY: reads IPSR.
    unsafe { core::arch::asm!("mrs {}, IPSR", out(reg) active) };
    say!("unexpected interrupt {active}");
    console::exit(false);
}

unsafe extern "C" fn fault() {
    // SAFETY: reads CFSR and BFAR.
    let (cfsr, address) = unsafe {
        (
            (0xE000_ED28 as *const u32).read_volatile(),
            (0xE000_ED38 as *const u32).read_volatile(),
        )
    };
    replenish_os::freertos::fault(format_args!(
        "hard fault, CFSR {cfsr:#x}, BFAR {address:#x}"
    ));
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    replenish_os::freertos::halt(info)
}
