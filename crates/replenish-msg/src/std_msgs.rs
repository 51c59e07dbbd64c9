//! The `std_msgs` package, as far as it is used here.
//!
//! ROS's unbounded fields are bounded, so that a message has a largest size and needs no heap:
//! [`BoundedString`], [`BoundedHeader`], [`BoundedUInt8MultiArray`]. A received value above the
//! bound is an error ([`CdrError::TooLong`](crate::CdrError::TooLong)), never cut. ROS's own types,
//! of any length, are generated (`replenish-interfaces`).

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
pub use text::{BoundedHeader, BoundedString};
