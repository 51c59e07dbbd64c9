//! What the standard library gives where there is one, and what stands in for it where not.

#[cfg(not(feature = "std"))]
mod bare;
#[cfg(not(feature = "std"))]
pub mod io;
#[cfg(feature = "std")]
mod std;

#[cfg(not(feature = "std"))]
pub(crate) use bare::*;
#[cfg(feature = "std")]
pub(crate) use std::*;
