//! DDS domains that no other test on this machine uses.

use std::cell::RefCell;
use std::fs::{File, OpenOptions};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// Domain 0 is every program's default; above 100 the ports are among those that the kernel hands
/// out to others.
const DOMAINS: u32 = 100;

/// Other test programs give their domains back within this time.
const PATIENCE: Duration = Duration::from_secs(120);

thread_local! {
    static CLAIMED: RefCell<Vec<File>> = const { RefCell::new(Vec::new()) };
}

/// A domain for the calling test alone, another one at each call. It is free again when the calling
/// thread has ended, which is the test's own.
///
/// # Panics
/// When other tests hold all domains for two minutes.
#[must_use]
pub fn domain() -> u16 {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    // Far from where other processes begin, and last the one that was free last.
    let first = std::process::id().wrapping_mul(17);
    let end = Instant::now() + PATIENCE;
    loop {
        for _ in 0..DOMAINS {
            let number = first.wrapping_add(NEXT.fetch_add(1, Ordering::Relaxed));
            let domain = 1 + u16::try_from(number % DOMAINS).unwrap_or(0);
            if let Some(file) = claim(domain) {
                CLAIMED.with_borrow_mut(|claimed| claimed.push(file));
                return domain;
            }
        }
        assert!(
            Instant::now() < end,
            "all {DOMAINS} DDS domains are in use: other tests hold replenish-domain-*.lock in {}",
            std::env::temp_dir().display()
        );
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// The lock on a domain's file, unless another process holds it; it goes with the file.
fn claim(domain: u16) -> Option<File> {
    let path = std::env::temp_dir().join(format!("replenish-domain-{domain}.lock"));
    let mut options = OpenOptions::new();
    let file = options
        .create(true)
        .truncate(false)
        .write(true)
        .open(&path)
        // Another user made the file: a read-only descriptor can be locked just as well.
        .or_else(|_| OpenOptions::new().read(true).open(&path))
        .ok()?;
    file.try_lock().is_ok().then_some(file)
}

#[cfg(test)]
mod tests {
    use super::domain;
    use std::collections::BTreeSet;

    #[test]
    fn a_domain_belongs_to_one_thread_until_that_ends() {
        let mine: BTreeSet<u16> = (0..5).map(|_| domain()).collect();
        assert_eq!(mine.len(), 5);
        // As many again and again as there are: all the others', none of mine.
        for _ in 0..50 {
            let theirs: BTreeSet<u16> = std::thread::spawn(|| (0..5).map(|_| domain()).collect())
                .join()
                .unwrap();
            assert!(theirs.len() == 5 && mine.is_disjoint(&theirs));
        }
    }
}
