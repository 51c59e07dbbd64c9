//! The primitive types as fields: many at once where there are many.

use super::{DecodeInPlace, Encode, Item};
use crate::{CdrError, CdrReader, CdrWriter, Endianness};
use replenish_wire::piece;

macro_rules! primitives {
    ($($ty:ident),*) => {$(
        impl Encode for $ty {
            const PRIMITIVE: usize = size_of::<$ty>();

            fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
                w.$ty(*self)
            }

            fn put_all(items: &[Self], w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
                let room = w.primitives(Self::PRIMITIVE, items.len())?;
                let places = room.as_chunks_mut::<{ size_of::<$ty>() }>().0;
                let piece = piece(places, items) / Self::PRIMITIVE;
                for (places, items) in places.chunks_mut(piece).zip(items.chunks(piece)) {
                    for (place, item) in places.iter_mut().zip(items) {
                        *place = item.to_le_bytes();
                    }
                }
                Ok(())
            }
        }

        impl DecodeInPlace for $ty {
            fn decode_in_place(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
                *self = r.$ty()?;
                Ok(())
            }

            fn decode_all_in_place(items: &mut [Self], r: &mut CdrReader<'_>) -> Result<(), CdrError> {
                let bytes = r.primitives(Self::PRIMITIVE, items.len())?;
                let values = bytes.as_chunks::<{ size_of::<$ty>() }>().0;
                let piece = piece(items, values) / Self::PRIMITIVE;
                match r.order() {
                    Endianness::Little => {
                        for (items, values) in items.chunks_mut(piece).zip(values.chunks(piece)) {
                            for (item, value) in items.iter_mut().zip(values) {
                                *item = $ty::from_le_bytes(*value);
                            }
                        }
                    }
                    Endianness::Big => for (item, value) in items.iter_mut().zip(values) {
                        *item = $ty::from_be_bytes(*value);
                    },
                }
                Ok(())
            }
        }

        impl<'a> Item<'a> for $ty {
            fn take(r: &mut CdrReader<'a>) -> Result<Self, CdrError> {
                r.$ty()
            }

            fn pass(count: usize, r: &mut CdrReader<'a>) -> Result<(), CdrError> {
                r.primitives(Self::PRIMITIVE, count).map(|_| ())
            }
        }
    )*};
}

primitives!(u8, u16, u32, u64, i8, i16, i32, i64, f32, f64);

impl Encode for bool {
    fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.bool(*self)
    }
}

impl DecodeInPlace for bool {
    fn decode_in_place(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        *self = r.bool()?;
        Ok(())
    }
}

impl<'a> Item<'a> for bool {
    fn take(r: &mut CdrReader<'a>) -> Result<Self, CdrError> {
        r.bool()
    }
}
