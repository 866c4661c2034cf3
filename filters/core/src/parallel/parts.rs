//! The kinds of parts: items and chunks of slices, numbers, and what is made of other parts.

use std::ops::Range;

use super::Parallel;

/// What parts are made of.
pub trait IntoParallel {
    /// The parts.
    type Parts: Parallel;
    /// Makes them.
    fn into_par_iter(self) -> Self::Parts;
}

impl<P: Parallel> IntoParallel for P {
    type Parts = P;
    fn into_par_iter(self) -> P {
        self
    }
}

macro_rules! into {
    ([$($generics:tt)*] $from:ty => $to:ty, $self:ident, $make:expr) => {
        impl<$($generics)*> IntoParallel for $from {
            type Parts = $to;
            fn into_par_iter($self) -> $to {
                $make
            }
        }
    };
}
into!(['a, T: Sync] &'a [T] => Items<'a, T>, self, Items(self));
into!(['a, T: Sync] &'a Vec<T> => Items<'a, T>, self, Items(self));
into!(['a, T: Send] &'a mut [T] => ItemsMut<'a, T>, self, ItemsMut(self));
into!(['a, T: Send] &'a mut Vec<T> => ItemsMut<'a, T>, self, ItemsMut(self));
into!([T: Send] Vec<T> => Owned<T>, self, Owned(self));
into!([] Range<usize> => Indices, self, Indices(self));

/// Slices as parts.
pub trait ParallelSlice<T> {
    /// Every item.
    fn par_iter(&self) -> Items<'_, T>;
    /// Every item, to be changed.
    fn par_iter_mut(&mut self) -> ItemsMut<'_, T>;
    /// Chunks of `size` items; the last may have fewer.
    fn par_chunks(&self, size: usize) -> Chunks<'_, T>;
    /// Chunks of `size` items, to be changed; the last may have fewer.
    fn par_chunks_mut(&mut self, size: usize) -> ChunksMut<'_, T>;
}

impl<T> ParallelSlice<T> for [T] {
    fn par_iter(&self) -> Items<'_, T> {
        Items(self)
    }
    fn par_iter_mut(&mut self) -> ItemsMut<'_, T> {
        ItemsMut(self)
    }
    fn par_chunks(&self, size: usize) -> Chunks<'_, T> {
        Chunks { slice: self, size: size.max(1) }
    }
    fn par_chunks_mut(&mut self, size: usize) -> ChunksMut<'_, T> {
        ChunksMut { slice: self, size: size.max(1) }
    }
}

/// Numbers of a range.
#[derive(Debug)]
pub struct Indices(Range<usize>);

impl Parallel for Indices {
    type Item = usize;
    fn len(&self) -> usize {
        self.0.len()
    }
    fn split_at(self, at: usize) -> (Self, Self) {
        let middle = self.0.start + at;
        (Self(self.0.start..middle), Self(middle..self.0.end))
    }
    fn items(self) -> impl Iterator<Item = usize> {
        self.0
    }
}

/// Items of a slice.
#[derive(Debug)]
pub struct Items<'a, T>(&'a [T]);

impl<'a, T: Sync> Parallel for Items<'a, T> {
    type Item = &'a T;
    fn len(&self) -> usize {
        self.0.len()
    }
    fn split_at(self, at: usize) -> (Self, Self) {
        let (left, right) = self.0.split_at(at);
        (Self(left), Self(right))
    }
    fn items(self) -> impl Iterator<Item = &'a T> {
        self.0.iter()
    }
}

/// Items of a slice, to be changed.
#[derive(Debug)]
pub struct ItemsMut<'a, T>(&'a mut [T]);

impl<'a, T: Send> Parallel for ItemsMut<'a, T> {
    type Item = &'a mut T;
    fn len(&self) -> usize {
        self.0.len()
    }
    fn split_at(self, at: usize) -> (Self, Self) {
        let (left, right) = self.0.split_at_mut(at);
        (Self(left), Self(right))
    }
    fn items(self) -> impl Iterator<Item = &'a mut T> {
        self.0.iter_mut()
    }
}

/// Items of a vector, by value.
#[derive(Debug)]
pub struct Owned<T>(Vec<T>);

impl<T: Send> Parallel for Owned<T> {
    type Item = T;
    fn len(&self) -> usize {
        self.0.len()
    }
    fn split_at(mut self, at: usize) -> (Self, Self) {
        let right = self.0.split_off(at);
        (self, Self(right))
    }
    fn items(self) -> impl Iterator<Item = T> {
        self.0.into_iter()
    }
}

/// Chunks of a slice.
#[derive(Debug)]
pub struct Chunks<'a, T> {
    slice: &'a [T],
    size: usize,
}

impl<'a, T: Sync> Parallel for Chunks<'a, T> {
    type Item = &'a [T];
    fn len(&self) -> usize {
        self.slice.len().div_ceil(self.size)
    }
    fn split_at(self, at: usize) -> (Self, Self) {
        let (left, right) = self.slice.split_at((at * self.size).min(self.slice.len()));
        (Self { slice: left, ..self }, Self { slice: right, ..self })
    }
    fn items(self) -> impl Iterator<Item = &'a [T]> {
        self.slice.chunks(self.size)
    }
}

/// Chunks of a slice, to be changed.
#[derive(Debug)]
pub struct ChunksMut<'a, T> {
    slice: &'a mut [T],
    size: usize,
}

impl<'a, T: Send> Parallel for ChunksMut<'a, T> {
    type Item = &'a mut [T];
    fn len(&self) -> usize {
        self.slice.len().div_ceil(self.size)
    }
    fn split_at(self, at: usize) -> (Self, Self) {
        let Self { slice, size } = self;
        let middle = (at * size).min(slice.len());
        let (left, right) = slice.split_at_mut(middle);
        (Self { slice: left, size }, Self { slice: right, size })
    }
    fn items(self) -> impl Iterator<Item = &'a mut [T]> {
        self.slice.chunks_mut(self.size)
    }
}

/// Items with their numbers.
#[derive(Debug)]
pub struct Enumerate<P> {
    parts: P,
    first: usize,
}

impl<P> Enumerate<P> {
    pub(super) fn new(parts: P) -> Self {
        Self { parts, first: 0 }
    }

    /// The number of the first item.
    pub(super) fn first(&self) -> usize {
        self.first
    }

    /// The items without their numbers.
    pub(super) fn into_inner(self) -> P {
        self.parts
    }
}

impl<P: Parallel> Parallel for Enumerate<P> {
    type Item = (usize, P::Item);
    fn len(&self) -> usize {
        self.parts.len()
    }
    fn split_at(self, at: usize) -> (Self, Self) {
        let (left, right) = self.parts.split_at(at);
        (Self { parts: left, ..self }, Self { parts: right, first: self.first + at })
    }
    fn items(self) -> impl Iterator<Item = Self::Item> {
        let first = self.first;
        self.parts.items().enumerate().map(move |(i, item)| (first + i, item))
    }
    fn limits(&self) -> (usize, usize) {
        self.parts.limits()
    }
}

/// Items of two, side by side.
#[derive(Debug)]
pub struct Zip<A, B>(A, B);

impl<A, B> Zip<A, B> {
    pub(super) fn new(a: A, b: B) -> Self {
        Self(a, b)
    }
}

impl<A: Parallel, B: Parallel> Parallel for Zip<A, B> {
    type Item = (A::Item, B::Item);
    fn len(&self) -> usize {
        self.0.len().min(self.1.len())
    }
    fn split_at(self, at: usize) -> (Self, Self) {
        let ((a, c), (b, d)) = (self.0.split_at(at), self.1.split_at(at));
        (Self(a, b), Self(c, d))
    }
    fn items(self) -> impl Iterator<Item = Self::Item> {
        self.0.items().zip(self.1.items())
    }
    fn limits(&self) -> (usize, usize) {
        let ((least, most), (other_least, other_most)) = (self.0.limits(), self.1.limits());
        (least.max(other_least), most.min(other_most))
    }
}

/// Parts whose tasks have a least and a largest number of items.
#[derive(Debug)]
pub struct Limited<P> {
    parts: P,
    limits: (usize, usize),
}

impl<P> Limited<P> {
    pub(super) fn new(parts: P, limits: (usize, usize)) -> Self {
        Self { parts, limits }
    }
}

impl<P: Parallel> Parallel for Limited<P> {
    type Item = P::Item;
    fn len(&self) -> usize {
        self.parts.len()
    }
    fn split_at(self, at: usize) -> (Self, Self) {
        let (left, right) = self.parts.split_at(at);
        (Self { parts: left, ..self }, Self { parts: right, ..self })
    }
    fn items(self) -> impl Iterator<Item = P::Item> {
        self.parts.items()
    }
    fn limits(&self) -> (usize, usize) {
        let (least, most) = self.parts.limits();
        (least.max(self.limits.0), most.min(self.limits.1))
    }
}
