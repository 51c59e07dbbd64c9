//! The descriptor by which a [`Notify`](crate::Notify) ends a wait for other descriptors, made when
//! somebody asks for it. In a `loom` model it is a flag that can be waited for; small kernels have
//! no descriptors.

#[cfg(all(loom, target_os = "linux"))]
pub(crate) use modelled::WakeDescriptor;
#[cfg(all(not(loom), any(not(target_os = "linux"), nuttx_host)))]
pub(crate) use none::WakeDescriptor;
#[cfg(all(not(loom), target_os = "linux", not(nuttx_host)))]
pub(crate) use real::WakeDescriptor;

#[cfg(all(not(loom), target_os = "linux", not(nuttx_host)))]
mod real {
    use crate::linux::poll::WakeFd;
    use std::io;
    use std::sync::OnceLock;

    #[derive(Debug)]
    pub(crate) struct WakeDescriptor(OnceLock<WakeFd>);

    impl WakeDescriptor {
        pub(crate) const fn new() -> Self {
            Self(OnceLock::new())
        }

        pub(crate) fn wake(&self) {
            if let Some(fd) = self.0.get() {
                fd.wake();
            }
        }

        pub(crate) fn get(&self) -> io::Result<&WakeFd> {
            match self.0.get() {
                Some(fd) => Ok(fd),
                None => {
                    let fd = WakeFd::new()?;
                    Ok(self.0.get_or_init(|| fd))
                }
            }
        }
    }
}

#[cfg(all(not(loom), any(not(target_os = "linux"), nuttx_host)))]
mod none {
    #[derive(Debug)]
    pub(crate) struct WakeDescriptor;

    impl WakeDescriptor {
        pub(crate) const fn new() -> Self {
            Self
        }

        #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
        pub(crate) const fn wake(&self) {}
    }
}

#[cfg(all(loom, target_os = "linux"))]
mod modelled {
    use loom::sync::{Condvar, Mutex};
    use std::sync::PoisonError;

    #[derive(Debug)]
    pub(crate) struct WakeDescriptor(Mutex<bool>, Condvar);

    impl WakeDescriptor {
        pub(crate) fn new() -> Self {
            Self(Mutex::new(false), Condvar::new())
        }

        pub(crate) fn wake(&self) {
            *self.0.lock().unwrap_or_else(PoisonError::into_inner) = true;
            self.1.notify_one();
        }

        /// Waits until it is readable, and clears it.
        pub(crate) fn wait(&self) {
            let mut readable = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            while !*readable {
                readable = self
                    .1
                    .wait(readable)
                    .unwrap_or_else(PoisonError::into_inner);
            }
            *readable = false;
        }
    }
}
