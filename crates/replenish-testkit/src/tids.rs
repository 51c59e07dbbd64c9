//! A thread with the kernel id of one that has ended.
//!
//! The kernel numbers threads in turn, and root may say where the count goes on.

use std::fs;
use std::sync::mpsc;
use std::thread::JoinHandle;

/// Its next number is the one after this.
const LAST: &str = "/proc/sys/kernel/ns_last_pid";

/// The reason why a thread cannot be given an id here.
#[must_use]
pub fn missing() -> Option<&'static str> {
    let same = fs::read_to_string(LAST).and_then(|last| fs::write(LAST, last.trim()));
    same.is_err()
        .then_some("this user may not choose the ids of threads")
}

/// Whether this process has a thread of this id.
#[must_use]
pub fn exists(tid: i32) -> bool {
    fs::exists(format!("/proc/self/task/{tid}")).unwrap_or(false)
}

/// Runs `body` in a thread of this id, which no other thread has any more. `None` if others took
/// the id each time.
pub fn reuse<T: Send + 'static>(
    tid: i32,
    body: impl FnOnce() -> T + Send + 'static,
) -> Option<JoinHandle<T>> {
    for _ in 0..1000 {
        let (tell, told) = mpsc::channel();
        let (go, body_of) = mpsc::channel();
        fs::write(LAST, (tid - 1).to_string()).ok()?;
        let thread = std::thread::spawn(move || {
            let me = fs::read_link("/proc/thread-self").ok();
            let me = me.and_then(|path| path.file_name()?.to_str()?.parse::<i32>().ok());
            tell.send(me).ok();
            body_of
                .recv()
                .ok()
                .map(|body: Box<dyn FnOnce() -> T + Send>| body())
        });
        if told.recv().ok().flatten() == Some(tid) {
            go.send(Box::new(body)).ok()?;
            return Some(std::thread::spawn(move || {
                let done = thread
                    .join()
                    .unwrap_or_else(|e| std::panic::resume_unwind(e));
                done.unwrap_or_else(|| unreachable!("it was sent"))
            }));
        }
        drop(go);
        thread.join().ok();
    }
    None
}
