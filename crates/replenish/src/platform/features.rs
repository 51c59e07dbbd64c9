//! The features as constants: `if FULL { … }` in the body of a function is compiled and checked in
//! every build, and leaves no code where the feature is off.

/// The standard library, Linux's descriptors, and room for the hashes of types.
pub(crate) const STD: bool = cfg!(feature = "std");
/// A board without an operating system: threads are never joined.
pub(crate) const BARE: bool = cfg!(target_os = "none");
/// Services, handles that come and go, histograms, everything a small board leaves out.
pub(crate) const FULL: bool = cfg!(feature = "full");
/// Errors, fallbacks and reports in words.
pub(crate) const TEXTS: bool = cfg!(feature = "texts");
/// Events go to the program's logger.
pub(crate) const LOG: bool = cfg!(feature = "log");
/// Values that are no longer used are dropped and their memory is given back.
#[allow(dead_code, reason = "asked for by the XRCE adapter alone")]
pub(crate) const DROPS: bool = cfg!(any(not(target_os = "none"), feature = "full"));
