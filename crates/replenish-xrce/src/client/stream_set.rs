//! The streams of one kind. Most sessions have one of each, and then what is done for each of them
//! is no loop: said here once, because the compiler would count to one in every place.

/// `N` streams, known by their indices.
#[derive(Debug)]
pub(super) struct StreamSet<T, const N: usize>(pub(super) [T; N]);

impl<T, const N: usize> StreamSet<T, N> {
    pub(super) fn get(&self, index: Option<usize>) -> Option<&T> {
        self.0.get(index?)
    }

    pub(super) fn get_mut(&mut self, index: Option<usize>) -> Option<&mut T> {
        self.0.get_mut(index?)
    }

    /// The first result of `ask`, higher indices first.
    pub(super) fn first<'a, U>(
        &'a mut self,
        mut ask: impl FnMut(&'a mut T) -> Option<U>,
    ) -> Option<U> {
        if N == 1 {
            return ask(self.0.first_mut()?);
        }
        self.0.iter_mut().rev().find_map(ask)
    }

    /// Does something with each.
    pub(super) fn for_each(&mut self, mut act: impl FnMut(&mut T)) {
        self.first(|stream| {
            act(stream);
            None::<()>
        });
    }

    /// Folds over all of them.
    pub(super) fn sum<U>(&self, zero: U, mut plus: impl FnMut(U, &T) -> U) -> U {
        if N == 1
            && let Some(only) = self.0.first()
        {
            return plus(zero, only);
        }
        self.0.iter().fold(zero, plus)
    }
}
