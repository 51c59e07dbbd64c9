//! The `std_msgs` package, as far as it is used here.
//!
//! ROS's unbounded fields are bounded, so that a message has a largest size. The plain names are
//! aliases with the default bounds ([`String`], [`Header`], [`UInt8MultiArray`]); the `Bounded*`
//! types take others. A received value above the bound is an error
//! ([`CdrError::TooLong`](crate::CdrError::TooLong)), never cut.

mod multi_array;
mod primitives;
mod text;

pub use multi_array::{
    BoundedUInt8MultiArray, MAX_DIMENSIONS, MAX_LABEL, MultiArrayDimension, MultiArrayLayout,
    UInt8MultiArray,
};
pub use primitives::{
    Bool, Empty, Float32, Float64, Int8, Int16, Int32, Int64, UInt8, UInt16, UInt32, UInt64,
};
pub use text::{BoundedHeader, BoundedString, Header, String};
