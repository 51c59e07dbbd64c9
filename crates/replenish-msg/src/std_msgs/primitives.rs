//! The `std_msgs` with one primitive field, and the one with none.

use crate::{CdrError, CdrReader, CdrWriter, Message};

macro_rules! primitive {
    ($($name:ident: $ty:ident),*) => {$(
        #[doc = concat!("`std_msgs/msg/", stringify!($name), "`: one `", stringify!($ty), "`.")]
        #[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
        pub struct $name {
            /// The value.
            pub data: $ty,
        }

        impl Message for $name {
            const TYPE_NAME: &'static str = concat!("std_msgs/msg/", stringify!($name));
            const DDS_TYPE_NAME: &'static str =
                concat!("std_msgs::msg::dds_::", stringify!($name), "_");
            const MAX_SIZE: usize = size_of::<$ty>();

            fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
                w.$ty(self.data)
            }

            fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
                self.data = r.$ty()?;
                Ok(())
            }
        }
    )*};
}

primitive!(
    Bool: bool, Int8: i8, Int16: i16, Int32: i32, Int64: i64, UInt8: u8, UInt16: u16, UInt32: u32,
    UInt64: u64, Float32: f32, Float64: f64
);

/// `std_msgs/msg/Empty`: a signal without contents.
///
/// C has no empty struct, so ROS 2 gives it one hidden byte, which is on the wire too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Empty {}

impl Message for Empty {
    const TYPE_NAME: &'static str = "std_msgs/msg/Empty";
    const DDS_TYPE_NAME: &'static str = "std_msgs::msg::dds_::Empty_";
    const MAX_SIZE: usize = 1;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.u8(0)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        r.u8().map(|_| ())
    }
}
