//! The `std_msgs` with one primitive field, and the one with none.

use crate::structure::known;
use crate::{CdrError, CdrReader, CdrWriter, Message, Viewed};

macro_rules! primitive {
    ($($name:ident: $ty:ident as $kind:ident $(($size:literal))?, $hash:literal, $($derived:ident)*;)*) => {$(
        #[doc = concat!("`std_msgs/msg/", stringify!($name), "`: one `", stringify!($ty), "`.")]
        #[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd $(, $derived)*)]
        pub struct $name {
            /// The value.
            pub data: $ty,
        }

        impl Message for $name {
            const TYPE_NAME: &'static str = concat!("std_msgs/msg/", stringify!($name));
            const DDS_TYPE_NAME: &'static str =
                concat!("std_msgs::msg::dds_::", stringify!($name), "_");
            const MAX_SIZE: usize = size_of::<$ty>();
            known!(
                $hash,
                concat!("std_msgs/msg/", stringify!($name)),
                "data": One, $kind $(($size))?
            );

            fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
                w.$ty(self.data)
            }

            fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
                self.data = r.$ty()?;
                Ok(())
            }
        }

        impl Viewed for $name {
            type View<'a> = Self;
        }
    )*};
}

primitive! {
    Bool: bool as Bool, "feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9", Eq Ord Hash;
    Int8: i8 as Number(1), "26525065a403d972cb672f0777e333f0c799ad444ae5fcd79e43d1e73bd0f440", Eq Ord Hash;
    Int16: i16 as Number(2), "1dcc3464e47c288a55f943a389d337cdb06804de3f5cd7a266b0de718eee17e5", Eq Ord Hash;
    Int32: i32 as Number(4), "b6578ded3c58c626cfe8d1a6fb6e04f706f97e9f03d2727c9ff4e74b1cef0deb", Eq Ord Hash;
    Int64: i64 as Number(8), "8cd1048c2f186b6bd9a92472dc1ce51723c0833a221e2b7aecfff111774f4b49", Eq Ord Hash;
    UInt8: u8 as Number(1), "6138bd83d8c3569cb80a667db03cfc1629f529fee79d944c39c34e352e72f010", Eq Ord Hash;
    UInt16: u16 as Number(2), "08a406e4b022bc22e907f985d6a9e9dd1d4fbecae573549cf49350113e7757b1", Eq Ord Hash;
    UInt32: u32 as Number(4), "a5c874829b752bc5fa190024b0ad76f578cc278271e855c7d02a818b3516fb4a", Eq Ord Hash;
    UInt64: u64 as Number(8), "fbdc52018fc13755dce18024d1a671c856aa8b4aaf63adfb095b608f98e8c943", Eq Ord Hash;
    Float32: f32 as Number(4), "7170d3d8f841f7be3172ce5f4f59f3a4d7f63b0447e8b33327601ad64d83d6e2",;
    Float64: f64 as Number(8), "705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a",;
}

/// `std_msgs/msg/Empty`: a signal without contents.
///
/// C has no empty struct, so ROS 2 gives it one hidden byte, which is on the wire too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Empty {}

impl Message for Empty {
    const TYPE_NAME: &'static str = "std_msgs/msg/Empty";
    const DDS_TYPE_NAME: &'static str = "std_msgs::msg::dds_::Empty_";
    const MAX_SIZE: usize = 1;
    known!(
        "20b625256f32d5dbc0d04fee44f43c41e51c70d3502f84b4a08e7a9c26a96312",
        "std_msgs/msg/Empty"
    );

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.u8(0)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        r.u8().map(|_| ())
    }
}

impl Viewed for Empty {
    type View<'a> = Self;
}
