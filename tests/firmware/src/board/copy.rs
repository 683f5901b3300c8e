//! Copying and clearing of memory, as the ABI of Arm names it. The compiler's own spends five
//! instructions on a word; a tick copies seven thousand bytes (a session, what it is given, what it
//! gives back), and a board's C library would do it like this.
//!
//! Sound because only r0 to r3 and r12 are left changed, as the ABI allows, and because single
//! loads and stores may be unaligned: the memory is normal, and CCR.UNALIGN_TRP is never set. At
//! the start the firmware copies and compares all small lengths ([`is_exact`]).

use core::arch::global_asm;
use core::hint::black_box;

// r0 to, r1 from, r2 bytes. Both addresses are multiples of 4 (or of 8, which is as good): sixteen
// bytes, words, bytes.
global_asm!(
    ".global __aeabi_memcpy4, __aeabi_memcpy8",
    ".type __aeabi_memcpy4, %function",
    ".type __aeabi_memcpy8, %function",
    "__aeabi_memcpy4:",
    "__aeabi_memcpy8:",
    "push {{r4, r5, r6, lr}}",
    "subs r2, #16",
    "blo 2f",
    "1:",
    "ldmia r1!, {{r3, r4, r5, r6}}",
    "stmia r0!, {{r3, r4, r5, r6}}",
    "subs r2, #16",
    "bhs 1b",
    "2:",
    "adds r2, #16",
    "3:",
    "subs r2, #4",
    "blo 4f",
    "ldr r3, [r1], #4",
    "str r3, [r0], #4",
    "b 3b",
    "4:",
    "adds r2, #4",
    "beq 6f",
    "5:",
    "ldrb r3, [r1], #1",
    "strb r3, [r0], #1",
    "subs r2, #1",
    "bne 5b",
    "6:",
    "pop {{r4, r5, r6, pc}}",
    ".size __aeabi_memcpy4, . - __aeabi_memcpy4",
    ".size __aeabi_memcpy8, . - __aeabi_memcpy8",
);

// r0 to, r1 from, r2 bytes, wherever they are: a single load or store may be unaligned here,
// several at once may not.
global_asm!(
    ".global __aeabi_memcpy",
    ".type __aeabi_memcpy, %function",
    "__aeabi_memcpy:",
    "subs r2, #8",
    "blo 2f",
    "1:",
    "ldr r3, [r1], #4",
    "ldr r12, [r1], #4",
    "str r3, [r0], #4",
    "str r12, [r0], #4",
    "subs r2, #8",
    "bhs 1b",
    "2:",
    "adds r2, #8",
    "beq 4f",
    "3:",
    "ldrb r3, [r1], #1",
    "strb r3, [r0], #1",
    "subs r2, #1",
    "bne 3b",
    "4:",
    "bx lr",
    ".size __aeabi_memcpy, . - __aeabi_memcpy",
);

// r0 where, r1 bytes; the address is a multiple of 4 or of 8.
global_asm!(
    ".global __aeabi_memclr4, __aeabi_memclr8",
    ".type __aeabi_memclr4, %function",
    ".type __aeabi_memclr8, %function",
    "__aeabi_memclr4:",
    "__aeabi_memclr8:",
    "push {{r4, lr}}",
    "movs r2, #0",
    "movs r3, #0",
    "movs r4, #0",
    "mov r12, r2",
    "subs r1, #16",
    "blo 2f",
    "1:",
    "stmia r0!, {{r2, r3, r4, r12}}",
    "subs r1, #16",
    "bhs 1b",
    "2:",
    "adds r1, #16",
    "3:",
    "subs r1, #4",
    "blo 4f",
    "str r2, [r0], #4",
    "b 3b",
    "4:",
    "adds r1, #4",
    "beq 6f",
    "5:",
    "strb r2, [r0], #1",
    "subs r1, #1",
    "bne 5b",
    "6:",
    "pop {{r4, pc}}",
    ".size __aeabi_memclr4, . - __aeabi_memclr4",
    ".size __aeabi_memclr8, . - __aeabi_memclr8",
);

/// True if every length below 40 is copied and cleared, at every alignment, and nothing beside it.
pub(crate) fn is_exact() -> bool {
    // Behind a black box: the compiler shall call what is tried here.
    let mut lengths = (0..40).map(black_box);
    lengths.all(|length| {
        (0..4).all(|shift| bytes_are_copied(length, shift)) && words_are_copied_and_cleared(length)
    })
}

fn bytes_are_copied(length: usize, shift: usize) -> bool {
    let from: [u8; 48] = core::array::from_fn(|at| u8::try_from(at).unwrap_or(0) | 0x80);
    let mut to = [1; 48];
    let place = to.get_mut(shift..).and_then(|to| to.get_mut(..length));
    let (Some(place), Some(bytes)) = (place, from.get(..length)) else {
        return false;
    };
    place.copy_from_slice(bytes);
    black_box(&to).iter().enumerate().all(|(at, byte)| {
        let source = at.checked_sub(shift).filter(|at| *at < length);
        let expected = source.and_then(|at| from.get(at)).copied().unwrap_or(1);
        *byte == expected
    })
}

fn words_are_copied_and_cleared(length: usize) -> bool {
    let from: [u32; 48] = core::array::from_fn(|at| u32::try_from(at).unwrap_or(0) | 0x8000_0000);
    let mut to = [1; 48];
    let (Some(place), Some(words)) = (to.get_mut(..length), from.get(..length)) else {
        return false;
    };
    place.copy_from_slice(words);
    let copied = black_box(&*place) == words;
    place.fill(0);
    let mut left = black_box(&to).iter().enumerate();
    copied && left.all(|(at, word)| *word == u32::from(at >= length))
}
