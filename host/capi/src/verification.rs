//! Entries for the proofs: the maps between the structs of C and those of core, and memory of a
//! caller as safe functions. Not for C.

use core::ffi::c_void;
use core::ptr::null_mut;

use gantry_tau_core::control::axis::Reference;
use gantry_tau_core::control::endpoint::{MotorMap, Write};
use gantry_tau_core::control::message::State;
use gantry_tau_core::control::session::config::{AxisConfig, Config};
use gantry_tau_core::control::session::{Output, Session, TickInput};

use crate::code::gt_code;
use crate::error::gt_error;
use crate::memory::{self, Object, Reply, tag};
use crate::server::{
    self, GT_MAX_MOTORS, gt_axis_config, gt_in_force, gt_server_config, gt_start, gt_state,
    gt_tick_input, gt_tick_output,
};

/// Memory of a caller, aligned to [`memory::GT_ALIGN`].
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Room(pub [u8; Room::BYTES]);

/// Handle of the object in a room.
struct Handle(());

/// Object in a room.
struct Held(u32);

impl Object for Held {
    type Handle = Handle;
    const BYTES: usize = Room::OBJECT;
    const TAG: u64 = tag(b"gttests", 0);
}

impl Room {
    /// Bytes of a room.
    ///
    /// cbindgen:ignore
    pub const BYTES: usize = 48;
    /// Bytes that its object needs.
    pub const OBJECT: usize = memory::size_of::<Held>();
    /// Tag of the object, as bytes.
    pub const TAG: [u8; 8] = Held::TAG.to_ne_bytes();

    /// Pointer to the byte at `place`, or behind the last; null for none.
    fn pointer(&mut self, place: Option<usize>) -> *mut c_void {
        let bytes = place.and_then(|place| self.0.get_mut(place..));
        bytes.map_or(null_mut(), |bytes| bytes.as_mut_ptr().cast())
    }

    /// Creates an object at `place`, in the bytes behind it, as a function of the interface does.
    /// Returns the place of its handle.
    ///
    /// # Errors
    /// A null or misaligned pointer, too little memory, or no value.
    pub fn create(&mut self, place: Option<usize>, value: Option<u32>) -> Reply<usize> {
        let size = place.map_or(0, |place| Self::BYTES.saturating_sub(place));
        let memory = self.pointer(place);
        // SAFETY: null, or `size` bytes of the room; the object is written as a whole.
        let handle = unsafe {
            memory::settle(
                memory,
                size,
                || value.ok_or(gt_code::Length.into()),
                |value, to: *mut Held| to.write(Held(value)),
            )
        }?;
        Ok(handle.addr().wrapping_sub(self.0.as_ptr().addr()))
    }

    /// Returns the value of the object at `place`.
    ///
    /// # Errors
    /// A null or misaligned pointer, or other memory.
    pub fn find(&mut self, place: Option<usize>) -> Reply<u32> {
        let place = place.filter(|place| *place <= Self::BYTES.saturating_sub(Self::OBJECT));
        // SAFETY: null, or as many bytes of the room as an object has; any bytes are a `Held`.
        unsafe { memory::object::<Held>(self.pointer(place).cast()) }.map(|held| held.0)
    }

    /// Returns the bytes that a function of the interface borrows at `place`: `length`, or all
    /// behind the place if these are fewer.
    ///
    /// # Errors
    /// A null pointer, or a length that no object has.
    pub fn borrow(&mut self, place: Option<usize>, length: usize) -> Reply<&[u8]> {
        let place = place.filter(|place| *place <= Self::BYTES);
        // A length that is not refused is cut to the room, because the bytes must exist.
        let room = place.map_or(length, |place| Self::BYTES.saturating_sub(place));
        let length = if isize::try_from(length).is_ok() {
            length.min(room)
        } else {
            length
        };
        // SAFETY: null, or `length` bytes of the room, or a length that is refused.
        unsafe { memory::bytes(self.pointer(place).cast(), length) }
    }
}

/// Judges an address as a pointer to eight bytes.
///
/// # Errors
/// Null, or misaligned.
pub fn judge(address: usize) -> Reply {
    memory::checked(core::ptr::without_provenance::<u64>(address)).map(drop)
}

/// Input of a tick for core.
///
/// # Errors
/// A value that a field does not have.
pub fn to_core<const N: usize>(input: &gt_tick_input) -> Reply<TickInput<N>> {
    input.to_core()
}

/// Judges the fate that C tells of references, with what is at its pointer.
///
/// # Errors
/// A fate that is none, or that references without a write cannot have; no values where some are
/// needed.
pub fn say<const N: usize>(
    write: Write<'_, N>,
    fate: u8,
    in_force: Option<[gt_in_force; N]>,
) -> Reply {
    server::say(write, fate, || in_force.ok_or(gt_code::NullPointer.into()))
}

/// Output of a tick for C.
#[must_use]
pub fn to_c<const N: usize>(
    references: Option<&[Reference; GT_MAX_MOTORS]>,
    output: &Output<N>,
    motors: usize,
) -> gt_tick_output {
    gt_tick_output::new(references, output, motors)
}

/// State for C.
#[must_use]
pub fn state_to_c<const N: usize>(state: &State<N>) -> gt_state {
    state.into()
}

/// Limits and travel of an axis for core.
///
/// # Errors
/// As core's.
pub fn configure_axis(axis: &gt_axis_config) -> Reply<AxisConfig> {
    axis.checked(0)
}

/// Configuration and motor map for core.
///
/// # Errors
/// As core's.
pub fn configure<const N: usize>(
    config: &gt_server_config,
) -> Result<(Config<N>, MotorMap<N, GT_MAX_MOTORS>), gt_error> {
    config.checked()
}

/// Session that starts where the machine is.
///
/// # Errors
/// As core's.
pub fn start<const N: usize>(config: Config<N>, start: &gt_start) -> Result<Session<N>, gt_error> {
    start.session(config)
}
