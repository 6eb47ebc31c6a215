//! Numbers of things, a type for each kind. Lists of values, equations and memory words refer to one another by numbers
//! of 32 bits, which halve the memory of pointers; as places in lists they are `usize`. All conversions between the two
//! are here.
//!
//! A number of one kind is not taken where another kind is wanted, and a [`List`] takes only numbers of its own kind.
//! None of them is `u32::MAX`, so that an `Option` of one needs no more memory, and says itself that there is none.

use std::fmt;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut, Index, IndexMut};

/// The place in a list that a number stands for.
#[inline]
pub fn at(number: u32) -> usize {
    const { assert!(size_of::<usize>() >= size_of::<u32>(), "a place in a list has at least 32 bits") };
    number as usize
}

/// The number of a place in a list.
///
/// # Panics
///
/// If the list has more than 2^32 members, which the limits on the size of a model exclude.
#[inline]
pub fn number(place: usize) -> u32 {
    u32::try_from(place).expect("the limits of a model keep lists below 2^32 members")
}

/// A number of one kind of thing.
pub trait Id: Copy + Ord {
    /// The thing at a place of its list.
    ///
    /// # Panics
    ///
    /// If the place is 2^32 - 1 or more, which the limits on the size of a model exclude.
    fn at(place: usize) -> Self;

    /// The place in its list.
    fn place(self) -> usize;
}

/// Types for numbers of kinds of things.
#[macro_export]
macro_rules! ids {
    ($($(#[$doc:meta])* $seen:vis $name:ident)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        $seen struct $name(std::num::NonZeroU32);

        impl $name {
            /// The thing with a number below 2^32 - 1.
            #[inline]
            pub const fn new(number: u32) -> $name {
                match std::num::NonZeroU32::new(number.wrapping_add(1)) {
                    Some(next) => $name(next),
                    None => panic!("the limits of a model keep numbers below 2^32 - 1"),
                }
            }

            /// The thing at a place of its list.
            #[inline]
            pub fn at(place: usize) -> $name {
                $name::new($crate::index::number(place))
            }

            /// The number, from 0.
            #[inline]
            pub const fn number(self) -> u32 {
                self.0.get() - 1
            }

            /// The place in its list.
            #[inline]
            pub fn index(self) -> usize {
                $crate::index::at(self.number())
            }

            /// The one so many places behind.
            #[inline]
            pub const fn behind(self, places: u32) -> $name {
                $name::new(self.number() + places)
            }

            /// The first so many, in order.
            #[inline]
            pub fn all(count: u32) -> impl DoubleEndedIterator<Item = $name> + ExactSizeIterator + Clone {
                (0..$crate::index::at(count)).map($name::at)
            }
        }

        impl $crate::index::Id for $name {
            #[inline]
            fn at(place: usize) -> $name {
                $name::at(place)
            }

            #[inline]
            fn place(self) -> usize {
                self.index()
            }
        }

        impl std::str::FromStr for $name {
            type Err = std::num::ParseIntError;

            fn from_str(text: &str) -> Result<$name, std::num::ParseIntError> {
                let number: u32 = text.parse()?;
                // A parse error of the number that the type holds, which is one more.
                let next: std::num::NonZeroU32 = (u64::from(number) + 1).to_string().parse()?;
                Ok($name(next))
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                std::fmt::Display::fmt(&self.number(), f)
            }
        }

        impl std::fmt::Debug for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                std::fmt::Debug::fmt(&self.number(), f)
            }
        }
    )*};
}

ids! {
    /// A chain of a step: its place in [`StepGraph::chains`](crate::graph::StepGraph::chains).
    pub ChainId
    /// An equation of a step, the unit of mapping: its place in
    /// [`StepGraph::equations`](crate::graph::StepGraph::equations).
    pub EquationId
    /// A state of a model or a step: its place in [`Model::states`](crate::model::Model::states), and behind those in
    /// [`StepGraph::states`](crate::graph::StepGraph::states).
    pub StateId
    /// A PE: its place in [`Program::pes`](crate::program::Program::pes).
    pub PeId
    /// A value of a step: its place in [`StepGraph::values`](crate::graph::StepGraph::values).
    pub ValueId
}

/// An input port of a PE: its place in [`PeProgram::ports`](crate::program::PeProgram::ports). A control word has 8 bits
/// for it, so all of their numbers are used.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PortId(u8);

impl PortId {
    /// The port at a place of its list.
    pub fn at(place: usize) -> PortId {
        PortId(u8::try_from(place).expect("the limits of a PE keep ports below 256"))
    }

    /// The port with a number.
    pub const fn new(number: u8) -> PortId {
        PortId(number)
    }

    /// The number, from 0.
    pub const fn number(self) -> u8 {
        self.0
    }
}

impl Id for PortId {
    fn at(place: usize) -> PortId {
        PortId::at(place)
    }

    #[inline]
    fn place(self) -> usize {
        usize::from(self.0)
    }
}

impl fmt::Debug for PortId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&self.0, f)
    }
}

impl fmt::Display for PortId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.0, f)
    }
}

/// A list that is indexed by numbers of one kind; all else is as with a slice.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct List<I, T> {
    members: Vec<T>,
    kind: PhantomData<fn(I) -> I>,
}

impl<I: Id, T> List<I, T> {
    /// No members.
    pub const fn new() -> List<I, T> {
        List { members: Vec::new(), kind: PhantomData }
    }

    /// No members, and room for so many.
    pub fn with_capacity(count: usize) -> List<I, T> {
        Vec::with_capacity(count).into()
    }

    /// A number of equal members.
    pub fn filled(member: T, count: usize) -> List<I, T>
    where
        T: Clone,
    {
        vec![member; count].into()
    }

    /// Adds a member, and gives its number.
    pub fn push(&mut self, member: T) -> I {
        let id = I::at(self.members.len());
        self.members.push(member);
        id
    }

    /// Its numbers, in order.
    pub fn ids(&self) -> impl DoubleEndedIterator<Item = I> + ExactSizeIterator + Clone + use<I, T> {
        (0..self.members.len()).map(I::at)
    }

    /// The members with their numbers.
    pub fn numbered(&self) -> impl DoubleEndedIterator<Item = (I, &T)> + ExactSizeIterator + Clone {
        self.members.iter().enumerate().map(|(place, member)| (I::at(place), member))
    }

    /// The members with their numbers, to be changed.
    pub fn numbered_mut(&mut self) -> impl DoubleEndedIterator<Item = (I, &mut T)> + ExactSizeIterator {
        self.members.iter_mut().enumerate().map(|(place, member)| (I::at(place), member))
    }

    /// The member with a number, if there is one.
    pub fn find(&self, id: I) -> Option<&T> {
        self.members.get(id.place())
    }

    /// The members as a vector.
    pub fn into_vec(self) -> Vec<T> {
        self.members
    }

    /// The vector of its members, for what changes its length.
    pub fn vec_mut(&mut self) -> &mut Vec<T> {
        &mut self.members
    }
}

impl<I, T> Deref for List<I, T> {
    type Target = [T];

    #[inline]
    fn deref(&self) -> &[T] {
        &self.members
    }
}

impl<I, T> DerefMut for List<I, T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.members
    }
}

impl<I: Id, T> Index<I> for List<I, T> {
    type Output = T;

    #[inline]
    fn index(&self, id: I) -> &T {
        &self.members[id.place()]
    }
}

impl<I: Id, T> IndexMut<I> for List<I, T> {
    #[inline]
    fn index_mut(&mut self, id: I) -> &mut T {
        &mut self.members[id.place()]
    }
}

impl<I, T> AsRef<[T]> for List<I, T> {
    fn as_ref(&self) -> &[T] {
        &self.members
    }
}

impl<I, T> Default for List<I, T> {
    fn default() -> List<I, T> {
        Vec::new().into()
    }
}

impl<I, T> From<Vec<T>> for List<I, T> {
    fn from(members: Vec<T>) -> List<I, T> {
        List { members, kind: PhantomData }
    }
}

impl<I, T> FromIterator<T> for List<I, T> {
    fn from_iter<M: IntoIterator<Item = T>>(members: M) -> List<I, T> {
        Vec::from_iter(members).into()
    }
}

impl<I, T> Extend<T> for List<I, T> {
    fn extend<M: IntoIterator<Item = T>>(&mut self, members: M) {
        self.members.extend(members);
    }
}

impl<I, T> IntoIterator for List<I, T> {
    type Item = T;
    type IntoIter = std::vec::IntoIter<T>;

    fn into_iter(self) -> Self::IntoIter {
        self.members.into_iter()
    }
}

impl<'a, I, T> IntoIterator for &'a List<I, T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.members.iter()
    }
}

impl<'a, I, T> IntoIterator for &'a mut List<I, T> {
    type Item = &'a mut T;
    type IntoIter = std::slice::IterMut<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.members.iter_mut()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_option_of_a_number_takes_no_more_memory_and_none_of_them_is_lost() {
        assert_eq!(size_of::<Option<PeId>>(), size_of::<u32>());
        for number in [0, 1, u32::MAX - 1] {
            assert_eq!((PeId::new(number).number(), PeId::at(at(number)).index()), (number, at(number)));
            assert_eq!(number.to_string().parse(), Ok(PeId::new(number)));
        }
        assert!(PeId::new(7) < PeId::new(8) && None < Some(PeId::new(0)));
        assert_eq!(format!("{0} {0:?} {0:>3}", PeId::new(7)), "7 7   7");
    }

    #[test]
    fn a_number_that_no_list_has_is_no_number() {
        for text in ["", "-1", "x", "4294967295", "4294967296"] {
            assert!(text.parse::<PeId>().is_err(), "{text}");
        }
    }
}
