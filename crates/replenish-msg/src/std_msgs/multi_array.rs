//! `std_msgs/msg/UInt8MultiArray`: bytes with an optional description of their dimensions.

use super::text::assign;
use crate::cdr::{aligned, max_string_size};
use crate::structure::known;
use crate::{CdrError, CdrReader, CdrWriter, Message};
use heapless::Vec;
use replenish_wire::piece;

/// Dimensions that a [`MultiArrayLayout`] holds.
pub const MAX_DIMENSIONS: usize = 4;

/// Bytes that the label of a [`MultiArrayDimension`] holds.
pub const MAX_LABEL: usize = 31;

/// `std_msgs/msg/UInt8MultiArray` of at most 4096 data bytes.
pub type UInt8MultiArray = BoundedUInt8MultiArray<4096>;

/// `std_msgs/msg/MultiArrayDimension`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MultiArrayDimension {
    /// The name of the dimension, such as `height`.
    pub label: heapless::String<MAX_LABEL>,
    /// Elements in this dimension.
    pub size: u32,
    /// Elements from one index of this dimension to the next.
    pub stride: u32,
}

impl Message for MultiArrayDimension {
    const TYPE_NAME: &'static str = "std_msgs/msg/MultiArrayDimension";
    const DDS_TYPE_NAME: &'static str = "std_msgs::msg::dds_::MultiArrayDimension_";
    const MAX_SIZE: usize = aligned(max_string_size(MAX_LABEL), 4) + 8;
    known!(
        "5e773a60a4c7fc8a54985f307c7837aa2994252a126c301957a24e31282c9cbe",
        "std_msgs/msg/MultiArrayDimension",
        "label": One, Text(MAX_LABEL),
        "size": One, Number(4),
        "stride": One, Number(4)
    );

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.string(&self.label)?;
        w.u32(self.size)?;
        w.u32(self.stride)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        assign(&mut self.label, r.string(MAX_LABEL)?)?;
        self.size = r.u32()?;
        self.stride = r.u32()?;
        Ok(())
    }
}

/// `std_msgs/msg/MultiArrayLayout` with at most [`MAX_DIMENSIONS`] dimensions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MultiArrayLayout {
    /// The dimensions, outermost first; may be empty.
    pub dim: Vec<MultiArrayDimension, MAX_DIMENSIONS>,
    /// Padding elements at the front of the data.
    pub data_offset: u32,
}

impl Message for MultiArrayLayout {
    const TYPE_NAME: &'static str = "std_msgs/msg/MultiArrayLayout";
    const DDS_TYPE_NAME: &'static str = "std_msgs::msg::dds_::MultiArrayLayout_";
    const MAX_SIZE: usize = 4 + MAX_DIMENSIONS * MultiArrayDimension::MAX_SIZE + 4;
    known!(
        "4c66e6f78e740ac103a94cf63259f968e48c617e7699e829b63c21a5cb50dac6",
        "std_msgs/msg/MultiArrayLayout",
        "dim": Sequence(MAX_DIMENSIONS), Nested(MultiArrayDimension::STRUCTURE),
        "data_offset": One, Number(4)
    );

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.sequence(self.dim.len())?;
        for dim in &self.dim {
            dim.encode(w)?;
        }
        w.u32(self.data_offset)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        let len = r.sequence(MAX_DIMENSIONS)?;
        self.dim.clear();
        for _ in 0..len {
            let mut dim = MultiArrayDimension::default();
            dim.decode(r)?;
            self.dim.push(dim).map_err(|_| CdrError::TooLong {
                len,
                limit: MAX_DIMENSIONS,
            })?;
        }
        self.data_offset = r.u32()?;
        Ok(())
    }
}

/// `std_msgs/msg/UInt8MultiArray` of at most `N` data bytes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BoundedUInt8MultiArray<const N: usize> {
    /// Layout of the data.
    pub layout: MultiArrayLayout,
    /// The bytes.
    pub data: Vec<u8, N>,
}

impl<const N: usize> Message for BoundedUInt8MultiArray<N> {
    const TYPE_NAME: &'static str = "std_msgs/msg/UInt8MultiArray";
    const DDS_TYPE_NAME: &'static str = "std_msgs::msg::dds_::UInt8MultiArray_";
    const MAX_SIZE: usize = MultiArrayLayout::MAX_SIZE + 4 + N;
    known!(
        "5687e861b8d307a5e48b7515467ae7a5fc2daf805bd0ce6d8e9e604bade9f385",
        "std_msgs/msg/UInt8MultiArray",
        "layout": One, Nested(MultiArrayLayout::STRUCTURE),
        "data": Sequence(N), Number(1)
    );

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        self.layout.encode(w)?;
        w.sequence(self.data.len())?;
        w.bytes(&self.data)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.layout.decode(r)?;
        let len = r.sequence(N)?;
        let bytes = r.bytes(len)?;
        self.data.clear();
        for piece in bytes.chunks(piece(&self.data, bytes)) {
            let taken = self.data.extend_from_slice(piece);
            taken.map_err(|_| CdrError::TooLong { len, limit: N })?;
        }
        Ok(())
    }
}
