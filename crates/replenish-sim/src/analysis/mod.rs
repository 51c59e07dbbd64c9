//! Worst-case response times, without running anything.
//!
//! - [`bounds`]: fixed priorities on one CPU, with FIFO threads and reservations, release jitter,
//!   blocking inside jobs, priority-inheriting locks, overheads and late enforcement.
//! - [`within`]: whether such bounds keep to limits, which is quicker to tell.
//! - [`Supply`]: what a reservation delivers at least, and how long work takes inside it.
//! - [`chain`]: from a sensor to an actuator over several workers.
//! - [`describe`]: from a [`System`](crate::System) to what these functions take.
//! - [`utilisation`]: the share of the CPU that is asked for.
//!
//! The property tests of this crate compare these bounds with simulated runs of random systems.
//! Times are in ns; "no bound" is `None`. Each formula names its source:
//! - JP86: Joseph, Pandya: Finding Response Times in a Real-Time System, Computer Journal 1986.
//! - Leh90: Lehoczky: Fixed Priority Scheduling of Periodic Task Sets with Arbitrary Deadlines,
//!   RTSS 1990.
//! - ABRTW93: Audsley, Burns, Richardson, Tindell, Wellings: Applying New Scheduling Theory to
//!   Static Priority Pre-emptive Scheduling, Software Engineering Journal 1993 (jitter, blocking).
//! - SRL90: Sha, Rajkumar, Lehoczky: Priority Inheritance Protocols, IEEE Trans. Computers 1990.
//! - SSL89: Sprunt, Sha, Lehoczky: Aperiodic Task Scheduling for Hard-Real-Time Systems, 1989.
//! - SBWH10: Stanovich, Baker, Wang, González Harbour: Defects of the POSIX Sporadic Server and
//!   How to Correct Them, RTAS 2010.
//! - CNH19: Chen et al.: Many Suspensions, Many Problems, Real-Time Systems 2019.
//! - SL03: Shin, Lee: Periodic Resource Model for Compositional Real-Time Guarantees, RTSS 2003.
//! - LB03: Lipari, Bini: Resource Partitioning among Real-Time Applications, ECRTS 2003.
//! - BTW95: Burns, Tindell, Wellings: Effective Analysis for Engineering Real-Time Fixed Priority
//!   Schedulers, IEEE Trans. Software Engineering 1995 (overheads).
//! - TC94: Tindell, Clark: Holistic Schedulability Analysis for Distributed Hard Real-Time
//!   Systems, Microprocessing and Microprogramming 1994 (chains by events).
//! - DZNP07: Davare, Zhu, Di Natale, Pinello, Kanajan, Sangiovanni-Vincentelli: Period
//!   Optimization for Hard Real-Time Distributed Automotive Systems, DAC 2007 (chains by sampling).

pub mod chain;
mod describe;
mod interference;
mod response;
mod supply;
mod task;
mod within;

pub use describe::describe;
pub use response::{Bounds, bounds, utilisation};
pub use supply::Supply;
pub use task::{Costs, Demand, Scheduling, Section, Task};
pub use within::{Limit, within};
