//! Numbers of things. Lists of values, equations and memory words refer to one another by numbers of 32 bits, which
//! halve the memory of pointers; as places in lists they are `usize`. These two conversions stand for all casts
//! between the two.

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
