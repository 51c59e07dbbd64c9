//! Arrays and sequences as fields.

use super::{Item, Refill, Wire};
use crate::{CdrError, CdrReader, CdrWriter};

impl<T: Wire, const N: usize> Wire for [T; N] {
    fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        T::put_all(self, w)
    }
}

impl<T: Refill, const N: usize> Refill for [T; N] {
    fn refill(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        T::refill_all(self, r)
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

impl<T: Wire, const N: usize> Wire for heapless::Vec<T, N> {
    fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.sequence(self.len())?;
        T::put_all(self, w)
    }
}

impl<T: Refill + Default, const N: usize> Refill for heapless::Vec<T, N> {
    fn refill(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        let len = r.sequence(N)?;
        self.truncate(len);
        while self.len() < len && self.push(T::default()).is_ok() {}
        T::refill_all(self, r)
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
    use super::{CdrError, CdrReader, CdrWriter, Refill, Wire};
    use alloc::vec::Vec;

    impl<T: Wire> Wire for Vec<T> {
        fn put(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
            w.sequence(self.len())?;
            T::put_all(self, w)
        }
    }

    /// Memory is taken for elements that are there, never for a number that is only announced.
    impl<T: Refill + Default> Refill for Vec<T> {
        fn refill(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
            let len = r.sequence(usize::MAX)?;
            if T::PRIMITIVE > 0 {
                r.clone().primitives(T::PRIMITIVE, len)?;
                self.resize_with(len, T::default);
                return T::refill_all(self, r);
            }
            self.truncate(len);
            for item in self.iter_mut() {
                item.refill(r)?;
            }
            while self.len() < len {
                let mut item = T::default();
                item.refill(r)?;
                self.push(item);
            }
            Ok(())
        }
    }
}
