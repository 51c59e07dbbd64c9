//! STUB, replaced by the os helper's.
#![allow(missing_docs, unsafe_code, dead_code)]
use super::tid::Tid;
use crate::Nanos;
use std::io;
#[derive(Clone, Copy, Debug)]
pub enum SwitchKind { Out { preempted: bool }, In }
#[derive(Clone, Copy, Debug)]
pub struct Switch { pub time: Nanos, pub kind: SwitchKind }
#[derive(Debug)]
pub struct SwitchLog;
pub struct Drained { pub lost: bool }
impl SwitchLog {
    pub fn open(_: Tid) -> io::Result<Self> { Err(io::Error::other("stub")) }
    pub fn drain(&mut self, _: &mut dyn FnMut(Switch)) -> Drained { Drained { lost: false } }
}
#[derive(Debug)]
pub struct Signal(std::sync::Mutex<bool>, std::sync::Condvar);
impl Signal {
    pub fn new() -> Self { Signal(std::sync::Mutex::new(false), std::sync::Condvar::new()) }
    pub fn set(&self) { *self.0.lock().unwrap() = true; self.1.notify_one(); }
    pub fn wait_until(&self, t: Nanos) -> bool { super::clock::sleep_until(t); false }
}
pub fn voluntary_switches() -> u64 { 0 }
#[derive(Clone, Debug)]
pub struct ThreadSpec { name: String, prio: u8, cpu: Option<usize> }
impl ThreadSpec {
    pub fn new(n: &str) -> Self { Self { name: n.into(), prio: 0, cpu: None } }
    pub fn policy(mut self, p: Policy) -> Self { self.prio = p.0; self }
    pub fn cpu(mut self, c: usize) -> Self { self.cpu = Some(c); self }
    pub fn stack_size(self, _: usize) -> Self { self }
}
#[derive(Clone, Copy, Debug)]
pub struct Policy(u8);
impl Policy { pub fn fifo(p: u8) -> Result<Self, io::Error> { Ok(Policy(p)) } }
#[derive(Debug)]
pub enum SpawnError { Os(io::Error), Policy(io::Error) }
#[derive(Debug)]
pub struct Thread<T>(Tid, std::thread::JoinHandle<T>);
impl<T> Thread<T> {
    pub fn tid(&self) -> Tid { self.0 }
    pub fn join(self) -> std::thread::Result<T> { self.1.join() }
}
pub fn spawn<T: Send + 'static>(s: ThreadSpec, f: impl FnOnce() -> T + Send + 'static) -> Result<Thread<T>, SpawnError> {
    let (tx, rx) = std::sync::mpsc::channel();
    let h = std::thread::Builder::new().name(s.name.clone()).spawn(move || {
        let t = super::tid::current_tid();
        if let Some(c) = s.cpu { super::affinity::set_affinity(t, &super::affinity::CpuSet::one(c)).unwrap(); }
        super::sched::set_priority(t, super::sched::SchedClass::Fifo(s.prio)).unwrap();
        tx.send(t).unwrap();
        f()
    }).map_err(SpawnError::Os)?;
    Ok(Thread(rx.recv().unwrap(), h))
}
