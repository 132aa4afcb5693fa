//! The floating-point state of the processor is the host's own. A host may round in its own way, flush small numbers
//! to zero or let invalid operations end it; none of that reaches a unit, and nothing of what a unit does reaches the
//! host, the flags of past exceptions included.

use std::cell::Cell;

use state::State;

thread_local! {
    /// The state that the host called in with, where it isn't the default and no function of the host runs.
    static HOST: Cell<Option<State>> = const { Cell::new(None) };
}

/// The host's state, which is put back where this ends, by an exception of the host's too.
struct Aside {
    host: State,
}

impl Aside {
    #[inline]
    fn set() -> Self {
        let host = State::read();
        if !host.is_default() {
            HOST.set(Some(host));
            host.set_default();
        }
        Aside { host }
    }
}

impl Drop for Aside {
    #[inline]
    fn drop(&mut self) {
        if !self.host.is_default() {
            HOST.set(None);
        }
        self.host.restore();
    }
}

/// Runs an exported function in the default state: rounding to nearest, with small numbers, nothing trapped.
#[inline]
pub fn in_default<T>(body: impl FnOnce() -> T) -> T {
    let _aside = Aside::set();
    apart(body)
}

/// A call of its own, so that the compiler moves no arithmetic out of it.
#[inline(never)]
fn apart<T>(body: impl FnOnce() -> T) -> T {
    body()
}

/// Runs a function of the host in the state that the host called in with. That function may call in again, or never
/// return: until it does, there is no state to go back to.
pub fn as_the_host<T>(callback: impl FnOnce() -> T) -> T {
    let Some(host) = HOST.take() else { return callback() };
    host.restore();
    let answer = callback();
    HOST.set(Some(host));
    host.set_default();
    answer
}

/// SSE does the arithmetic; some mathematical functions of Windows use the x87 unit. Its flags are left as they are,
/// unless its control differs from the default: looking at them takes longer than everything else.
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod state {
    use std::arch::asm;

    /// The six flags of past exceptions, in MXCSR.
    const FLAGS: u32 = 0x3f;
    /// All exceptions masked, rounding to nearest, nothing flushed to zero.
    const MXCSR: u32 = 0x1f80;
    /// All exceptions masked, rounding to nearest, full precision.
    const CONTROL: u16 = 0x37f;

    /// MXCSR, and the control word of the x87 unit.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct State {
        mxcsr: u32,
        control: u16,
    }

    impl State {
        #[inline]
        pub fn read() -> Self {
            let mut control = 0_u16;
            // SAFETY: stores a word to a variable of that size, and changes no state.
            unsafe { asm!("fnstcw [{}]", in(reg) &raw mut control, options(nostack, preserves_flags)) };
            State { mxcsr: mxcsr(), control }
        }

        #[inline]
        pub fn is_default(self) -> bool {
            self.mxcsr & !FLAGS == MXCSR && self.control == CONTROL
        }

        /// The default in its place.
        #[cold]
        pub fn set_default(self) {
            load_mxcsr(MXCSR);
            if self.control != CONTROL {
                load_control(CONTROL);
            }
        }

        /// Puts it back, where it differs from what there is.
        #[inline]
        pub fn restore(self) {
            if mxcsr() != self.mxcsr {
                load_mxcsr(self.mxcsr);
            }
            if self.control != CONTROL {
                load_control(self.control);
            }
        }
    }

    #[inline]
    fn mxcsr() -> u32 {
        let mut mxcsr = 0_u32;
        // SAFETY: stores a word to a variable of that size, and changes no state.
        unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut mxcsr, options(nostack, preserves_flags)) };
        mxcsr
    }

    #[inline]
    fn load_mxcsr(mxcsr: u32) {
        // SAFETY: the value is the default or was read from the register, so it holds no reserved bit.
        unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const mxcsr, options(nostack)) };
    }

    #[cold]
    fn load_control(control: u16) {
        // SAFETY: the first clears the flags, so that the second traps nothing; it loads the control word, which is the
        // default or was read there, from a variable of that size.
        unsafe { asm!("fnclex", "fldcw [{}]", in(reg) &raw const control, options(nostack)) };
    }
}

#[cfg(target_arch = "aarch64")]
#[allow(unsafe_code)]
mod state {
    use std::arch::asm;

    /// Control and flags: FPCR and FPSR. The default of both is zero.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct State {
        control: u64,
        flags: u64,
    }

    impl State {
        #[inline]
        pub fn read() -> Self {
            let (control, flags): (u64, u64);
            // SAFETY: both only read a register that every program may read.
            unsafe {
                asm!("mrs {}, fpcr", out(reg) control, options(nostack, preserves_flags));
                asm!("mrs {}, fpsr", out(reg) flags, options(nostack, preserves_flags));
            }
            State { control, flags }
        }

        #[inline]
        pub fn is_default(self) -> bool {
            self.control == 0
        }

        /// The default in its place.
        #[cold]
        pub fn set_default(self) {
            // SAFETY: zero is the state that compiled code relies on.
            unsafe { asm!("msr fpcr, xzr", options(nostack)) };
        }

        /// Puts it back, where it differs from what there is.
        #[inline]
        pub fn restore(self) {
            let now = State::read();
            if now.flags != self.flags {
                // SAFETY: the value was read from the register.
                unsafe { asm!("msr fpsr, {}", in(reg) self.flags, options(nostack)) };
            }
            if now.control != self.control {
                // SAFETY: likewise.
                unsafe { asm!("msr fpcr, {}", in(reg) self.control, options(nostack)) };
            }
        }
    }
}

/// Leaves the host's state unchanged on other processors.
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
mod state {
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct State;

    impl State {
        pub fn read() -> Self {
            State
        }
        pub fn is_default(self) -> bool {
            true
        }
        pub fn set_default(self) {}
        pub fn restore(self) {}
    }
}
