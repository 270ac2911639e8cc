//! Arrays in pages of two megabytes, where the system has them.
//!
//! Rays go through the tree in no order. With pages of four kilobytes many of their steps wait for the table of pages.
//! The memory is mapped for itself, since an allocator's would share its pages with others, and the system is told what
//! it is for.

use bytemuck::Pod;
use memmap2::MmapMut;
use std::fmt::{Debug, Formatter};
use std::ops::{Deref, DerefMut};

/// The size of a page; what is smaller is allocated as usual.
const PAGE: usize = 1 << 21;

/// A fixed number of elements, zero at first.
pub(crate) struct Pages<T> {
    memory: Memory<T>,
    len: usize,
}

enum Memory<T> {
    Allocated(Vec<T>),
    Mapped(MmapMut),
}

impl<T: Pod> Pages<T> {
    pub(crate) fn zeroed(len: usize) -> Self {
        let bytes = len * size_of::<T>();
        let mapped = if bytes < PAGE { None } else { MmapMut::map_anon(bytes.next_multiple_of(PAGE)).ok() };
        #[cfg(target_os = "linux")]
        if let Some(memory) = &mapped {
            // Where it is refused, small pages do.
            let _ = memory.advise(memmap2::Advice::HugePage);
        }
        let memory = mapped.map_or_else(|| Memory::Allocated(vec![T::zeroed(); len]), Memory::Mapped);
        Self { memory, len }
    }
}

/// Asks for the memory of an element that will be read soon.
#[inline(always)]
pub(crate) fn prefetch<T>(all: &[T], index: usize) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: all processors of this kind have the instruction, and it reads nothing as far as the program can tell, wherever
    // it points.
    unsafe {
        std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(all.as_ptr().wrapping_add(index).cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (all, index);
}

impl<T: Pod> Deref for Pages<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match &self.memory {
            Memory::Allocated(all) => all,
            Memory::Mapped(bytes) => bytemuck::cast_slice(&bytes[..self.len * size_of::<T>()]),
        }
    }
}

impl<T: Pod> DerefMut for Pages<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        match &mut self.memory {
            Memory::Allocated(all) => all,
            Memory::Mapped(bytes) => bytemuck::cast_slice_mut(&mut bytes[..self.len * size_of::<T>()]),
        }
    }
}

impl<T: Pod> Clone for Pages<T> {
    fn clone(&self) -> Self {
        let mut copy = Self::zeroed(self.len);
        copy.copy_from_slice(self);
        copy
    }
}

impl<T: Pod + Debug> Debug for Pages<T> {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        self.deref().fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_begin_with_zeros_and_are_copied_whole() {
        for len in [0, 5, PAGE / 8 - 1, PAGE / 8 + 1] {
            let mut all = Pages::<u64>::zeroed(len);
            assert!(all.len() == len && all.iter().all(|&x| x == 0));
            all.iter_mut().zip(1..).for_each(|(x, k)| *x = k);
            let copy = all.clone();
            all.fill(0);
            assert!(copy.iter().zip(1..).all(|(&x, k)| x == k) && copy.len() == len);
        }
    }
}
