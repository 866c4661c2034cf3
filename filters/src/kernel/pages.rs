//! Memory for planes in large pages.
//!
//! A plane of 1200 x 1200 floats is 1400 small pages, and the first touch of each costs half a microsecond or more: 90 MB that
//! a small frame touches are 22 000 faults, 45 ms of processor time where all else is 300. In pages of 2 MB they are a few dozen,
//! and what is left is clearing them, at the speed of memory.
//!
//! Linux gives large pages where they are asked for (`madvise`, or always), to whole aligned 2 MB only. The system's
//! allocator aligns nothing of that size, so blocks from 1.25 MB on are mapped here; five eighths of a large page become a whole one.

use std::alloc::{GlobalAlloc, Layout, System};

/// The allocator of the system; from five eighths of a large page on a block is mapped by itself, aligned, and in large pages as
/// far as it fills them, the last one by as much. Where the system has none, or knows no such wish, it is memory like any other.
#[derive(Clone, Copy, Debug, Default)]
pub struct LargePages;

/// Bytes of a large page.
const LARGE: usize = 2 << 20;
/// So much of one is worth a whole one.
const WORTH: usize = LARGE / 8 * 5;

/// Whether the allocation is mapped by itself; a page's alignment is all that can be had then.
const fn is_large(layout: Layout) -> bool {
    cfg!(target_os = "linux") && layout.size() >= WORTH && layout.align() <= 4096
}

// SAFETY: what is large is mapped and unmapped with the same length, which follows from the layout; a mapping is zero,
// not shared, and aligned to a page at least. All else is the system's allocator.
unsafe impl GlobalAlloc for LargePages {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if is_large(layout) {
            map::large(layout.size())
        } else {
            // SAFETY: as asked of the caller.
            unsafe { System.alloc(layout) }
        }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if is_large(layout) {
            map::large(layout.size())
        } else {
            // SAFETY: as asked of the caller.
            unsafe { System.alloc_zeroed(layout) }
        }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        if is_large(layout) {
            // SAFETY: it was mapped with this size, and the caller has done with it.
            unsafe { map::free(place, layout.size()) }
        } else {
            // SAFETY: as asked of the caller.
            unsafe { System.dealloc(place, layout) }
        }
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: the caller promises that the size does not overflow with this alignment, which is valid.
        let new = unsafe { Layout::from_size_align_unchecked(size, layout.align()) };
        if !is_large(layout) && !is_large(new) {
            // SAFETY: as asked of the caller.
            return unsafe { System.realloc(place, layout, size) };
        }
        // SAFETY: both blocks hold that many bytes, are apart, and the old one is not used again.
        unsafe {
            let moved = self.alloc(new);
            if !moved.is_null() {
                std::ptr::copy_nonoverlapping(place, moved, layout.size().min(size));
                self.dealloc(place, layout);
            }
            moved
        }
    }
}

#[cfg(target_os = "linux")]
mod map {
    use rustix::mm::{Advice, MapFlags, ProtFlags, madvise, mmap_anonymous, munmap};

    use super::{LARGE, WORTH};

    /// Maps that many bytes, zero, from a multiple of a large page on; null if there is no memory.
    pub(super) fn large(bytes: usize) -> *mut u8 {
        let whole = pages(bytes);
        let flags = (ProtFlags::READ | ProtFlags::WRITE, MapFlags::PRIVATE);
        // SAFETY: a new mapping, wherever there is room; what is cut off its ends and what is advised lies within it.
        unsafe {
            let Ok(found) = mmap_anonymous(std::ptr::null_mut(), whole + LARGE, flags.0, flags.1) else {
                return std::ptr::null_mut();
            };
            let before = found.addr().next_multiple_of(LARGE) - found.addr();
            let place = found.byte_add(before);
            // Failing, they leave addresses mapped that nobody uses, or small pages.
            if before > 0 {
                let _ = munmap(found, before);
            }
            let _ = munmap(place.byte_add(whole), LARGE - before);
            let _ = madvise(place, whole / LARGE * LARGE, Advice::LinuxHugepage);
            place.cast()
        }
    }

    /// Unmaps what was mapped for that many bytes.
    ///
    /// # Safety
    /// `place` comes from [`large`] with the same number, and is not used again.
    pub(super) unsafe fn free(place: *mut u8, bytes: usize) {
        // SAFETY: as asked of the caller.
        let _ = unsafe { munmap(place.cast(), pages(bytes)) };
    }

    /// The bytes of whole pages, large ones unless too little of the last would be used.
    fn pages(bytes: usize) -> usize {
        if bytes % LARGE >= WORTH { bytes.next_multiple_of(LARGE) } else { bytes.next_multiple_of(4096) }
    }
}

#[cfg(not(target_os = "linux"))]
mod map {
    pub(super) fn large(_: usize) -> *mut u8 {
        std::ptr::null_mut()
    }

    pub(super) unsafe fn free(_: *mut u8, _: usize) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_of_all_sizes_are_zero_keep_what_is_written_and_grow() {
        for size in [1, WORTH - 1, WORTH, LARGE - 1, LARGE, LARGE + 1, 3 * LARGE + 4097] {
            for new in [1, WORTH, LARGE, 2 * LARGE + 5] {
                let layout = Layout::from_size_align(size, 16).unwrap();
                // SAFETY: within the blocks, each of which is freed once with its own layout.
                unsafe {
                    let block = LargePages.alloc_zeroed(layout);
                    assert!(!block.is_null() && block.addr().is_multiple_of(16));
                    assert!(!is_large(layout) || block.addr().is_multiple_of(LARGE));
                    let bytes = std::slice::from_raw_parts_mut(block, size);
                    assert!(bytes.iter().all(|&byte| byte == 0));
                    bytes.iter_mut().enumerate().for_each(|(at, byte)| *byte = at as u8);
                    let block = LargePages.realloc(block, layout, new);
                    let bytes = std::slice::from_raw_parts(block, size.min(new));
                    assert!(bytes.iter().enumerate().all(|(at, &byte)| byte == at as u8));
                    LargePages.dealloc(block, Layout::from_size_align(new, 16).unwrap());
                }
            }
        }
    }

    #[test]
    fn an_alignment_past_a_page_is_left_to_the_system() {
        let layout = Layout::from_size_align(2 * LARGE, 4 * LARGE).unwrap();
        // SAFETY: freed once, with its own layout.
        unsafe {
            let block = LargePages.alloc(layout);
            assert!(block.addr().is_multiple_of(4 * LARGE));
            LargePages.dealloc(block, layout);
        }
    }
}
