//! Registers of the STM32F405 that are used here, by address (RM0090).

/// A register.
#[derive(Clone, Copy)]
pub struct Reg(pub usize);

impl Reg {
    /// Reads it.
    #[inline(always)]
    pub fn get(self) -> u32 {
        // SAFETY: the addresses below are device registers of this chip.
        unsafe { (self.0 as *const u32).read_volatile() }
    }

    /// Writes it.
    #[inline(always)]
    pub fn set(self, value: u32) {
        // SAFETY: as in `get`; what a value does is the caller's to know.
        unsafe { (self.0 as *mut u32).write_volatile(value) }
    }
}

const TIM2: usize = 0x4000_0000;
const TIM3: usize = 0x4000_0400;
const TIM5: usize = 0x4000_0C00;

/// Peripheral clock enable, APB1.
pub const RCC_APB1ENR: Reg = Reg(0x4002_3840);
/// Peripheral clock enable, AHB1.
pub const RCC_AHB1ENR: Reg = Reg(0x4002_3830);

/// The counting timer.
pub const CLOCK: Timer = Timer(TIM2);
/// The ringing timer.
pub const ALARM: Timer = Timer(TIM5);

/// The timer of the emulated line; 32 bits wide in QEMU only.
pub const LINE: Timer = Timer(TIM3);

/// A general-purpose 32-bit timer.
#[derive(Clone, Copy)]
pub struct Timer(usize);

impl Timer {
    /// Control: bit 0 counts.
    pub const fn cr1(self) -> Reg {
        Reg(self.0)
    }
    /// Interrupts: bit 0 at update.
    pub const fn dier(self) -> Reg {
        Reg(self.0 + 0x0C)
    }
    /// Status: bit 0 updated.
    pub const fn sr(self) -> Reg {
        Reg(self.0 + 0x10)
    }
    /// Events: bit 0 starts afresh.
    pub const fn egr(self) -> Reg {
        Reg(self.0 + 0x14)
    }
    /// Counter.
    pub const fn cnt(self) -> Reg {
        Reg(self.0 + 0x24)
    }
    /// Prescaler, minus one.
    pub const fn psc(self) -> Reg {
        Reg(self.0 + 0x28)
    }
    /// Reload.
    pub const fn arr(self) -> Reg {
        Reg(self.0 + 0x2C)
    }
}

/// Interrupt number of TIM5.
pub const IRQ_TIM5: usize = 50;
/// Interrupt number of TIM3.
pub const IRQ_TIM3: usize = 29;
/// Interrupt number of USART2.
pub const IRQ_USART2: usize = 38;

/// Enables interrupt `irq` at priority 6 of 15: it may call the kernel.
pub fn enable_interrupt(irq: usize) {
    let priority = (0xE000_E400 + irq) as *mut u8;
    // SAFETY: NVIC_IPR of an existing interrupt.
    unsafe { priority.write_volatile(6 << 4) };
    Reg(0xE000_E100 + irq / 32 * 4).set(1 << (irq % 32));
}

/// Forgets that interrupt `irq` is pending.
pub fn forget_interrupt(irq: usize) {
    Reg(0xE000_E280 + irq / 32 * 4).set(1 << (irq % 32));
}
