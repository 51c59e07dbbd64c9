//! Arrays and sequences as fields.

use super::{DecodeInPlace, Encode, Item};
use crate::{CdrError, CdrReader, CdrWriter};

impl<T: Encode, const N: usize> Encode for [T; N] {
    fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        T::put_all(self, w)
    }
}

impl<T: DecodeInPlace, const N: usize> DecodeInPlace for [T; N] {
    fn decode_in_place(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        T::decode_all_in_place(self, r)
    }
}

impl<'a, T: Item<'a>, const N: usize> Item<'a> for [T; N] {
    fn take(r: &mut CdrReader<'a>) -> Result<Self, CdrError> {
        // The first pass finds the error, if there is one; the second cannot fail.
        T::pass(N, &mut r.clone())?;
        let mut items = heapless::Vec::<T, N>::new();
        for _ in 0..N {
            let full = CdrError::TooLong {
                len: N + 1,
                limit: N,
            };
            items.push(T::take(r)?).map_err(|_| full)?;
        }
        let short = CdrError::EndOfBuffer {
            at: r.position(),
            needed: 1,
            available: 0,
        };
        items.into_array().map_err(|_| short)
    }
}

impl<T: Encode, const N: usize> Encode for heapless::Vec<T, N> {
    fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.sequence(self.len())?;
        T::put_all(self, w)
    }
}

impl<T: DecodeInPlace + Default, const N: usize> DecodeInPlace for heapless::Vec<T, N> {
    fn decode_in_place(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        let len = r.sequence(N)?;
        self.truncate(len);
        while self.len() < len && self.push(T::default()).is_ok() {}
        T::decode_all_in_place(self, r)
    }
}

impl<'a, T: Item<'a>, const N: usize> Item<'a> for heapless::Vec<T, N> {
    fn take(r: &mut CdrReader<'a>) -> Result<Self, CdrError> {
        let len = r.sequence(N)?;
        let mut items = Self::new();
        for _ in 0..len {
            let full = CdrError::TooLong { len, limit: N };
            items.push(T::take(r)?).map_err(|_| full)?;
        }
        Ok(items)
    }
}

#[cfg(feature = "alloc")]
mod owned {
    use super::{CdrError, CdrReader, CdrWriter, DecodeInPlace, Encode};
    use alloc::vec::Vec;

    impl<T: Encode> Encode for Vec<T> {
        fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
            w.sequence(self.len())?;
            T::put_all(self, w)
        }
    }

    /// Memory is taken for elements that are there, never for a number that is only announced.
    impl<T: DecodeInPlace + Default> DecodeInPlace for Vec<T> {
        fn decode_in_place(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
            let len = r.sequence(usize::MAX)?;
            if T::PRIMITIVE > 0 {
                r.clone().primitives(T::PRIMITIVE, len)?;
                self.resize_with(len, T::default);
                return T::decode_all_in_place(self, r);
            }
            self.truncate(len);
            for item in self.iter_mut() {
                item.decode_in_place(r)?;
            }
            while self.len() < len {
                let mut item = T::default();
                item.decode_in_place(r)?;
                self.push(item);
            }
            Ok(())
        }
    }
}
