//! The session server: bytes in, bytes and drive references out.

mod config;
mod outbox;
mod running;
mod turn;

use core::ffi::{c_char, c_void};

use gantry_tau_core::control::endpoint::Transport;

pub use config::{gt_axis_config, gt_limits, gt_offsets, gt_server_config, gt_start};
pub use outbox::{GT_MAX_FRAME, gt_frame};
pub use turn::{
    GT_FLAG_NOMINAL_STEP, GT_FLAG_POSITION_LIMITED, GT_FLAG_TORQUE_LIMITED, GT_FLAG_TRAVEL,
    GT_FLAG_VELOCITY_LIMITED, gt_actual, gt_axis_state, gt_cause, gt_counters, gt_cycle, gt_phase,
    gt_reference, gt_state, gt_turn,
};

use running::{HALF, NONE, Running, full_refusal};

use crate::black_box::{Line, gt_black_box};
use crate::code::gt_code;
use crate::error::{count, gt_error};
use crate::memory::{
    Object, Reply, buffer, bytes, object_mut, place, read, reply, settle_in_parts, size_of, tag_of,
};

/// Length of arrays per axis.
pub const GT_MAX_AXES: usize = 6;
/// Length of arrays per motor.
pub const GT_MAX_MOTORS: usize = 12;
/// Connections that can be open at once: the owner, and strangers who are told why they cannot be.
pub const GT_MAX_CONNECTIONS: usize = 6;

/// TCP and the like: bytes come in pieces of any length. A broken frame ends the connection, and its session.
pub const GT_TRANSPORT_STREAM: u32 = 0;
/// UDP and the like: each gt_server_feed is one whole datagram. A broken one is dropped.
pub const GT_TRANSPORT_DATAGRAM: u32 = 1;

/// No black box.
pub const GT_BLACK_BOX_NONE: u32 = 0;
/// A black box: at least so many ticks before the end of a session, and so many after it.
pub const GT_BLACK_BOX_TICKS: u32 = 64;

/// Bytes of a server with 3 axes and no black box, on any target.
pub const GT_SERVER_SIZE_3: usize = 8_448;
/// Bytes of a server with 6 axes and no black box.
pub const GT_SERVER_SIZE_6: usize = 11_008;
/// Bytes of a server with 3 axes and a black box.
pub const GT_SERVER_SIZE_3_BLACK_BOX: usize = 368_640;
/// Bytes of a server with 6 axes and a black box; enough for every server.
pub const GT_SERVER_SIZE_6_BLACK_BOX: usize = 548_864;

/// A server; its memory is the caller's.
pub struct gt_server(());

/// What the server of a handle answers, whichever server it is. A match, and no table of functions: what a program does not call is not
/// linked into it.
macro_rules! ask {
    ($handle:expr, $server:ident => $answer:expr) => {
        // SAFETY: the header's rules for pointers; the tag says which server it is.
        unsafe {
            match tag_of($handle)? {
                <Running<3, NONE>>::TAG => {
                    let $server = object_mut::<Running<3, NONE>>($handle)?;
                    $answer
                }
                <Running<3, HALF>>::TAG => {
                    let $server = object_mut::<Running<3, HALF>>($handle)?;
                    $answer
                }
                <Running<6, NONE>>::TAG => {
                    let $server = object_mut::<Running<6, NONE>>($handle)?;
                    $answer
                }
                <Running<6, HALF>>::TAG => {
                    let $server = object_mut::<Running<6, HALF>>($handle)?;
                    $answer
                }
                _ => return Err(gt_code::NoObject.into()),
            }
        }
    };
}

/// Fills a configuration with the profile of the thesis: 1 kHz, one lost Command tolerated, position offsets of at most 2 mm that change
/// by at most 5 um per tick and go back to zero by 0.1 um per tick, no velocity or torque offsets, one motor per axis, no black box.
/// Travel and nominal_step_nm are 0 and must be set: no machine is assumed. `axes`: 3 or 6.
///
/// Errors: GT_CODE_NULL_POINTER, GT_CODE_MISALIGNED, GT_CODE_CONFIG_AXES.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_config_thesis(
    config: *mut gt_server_config,
    axes: u32,
) -> gt_code {
    let fill = || {
        // SAFETY: the header's rules for pointers.
        let place = unsafe { place(config) }?;
        let thesis = gt_server_config::thesis(axes);
        if !matches!(axes, 3 | 6) {
            return Err(thesis.refused_axes());
        }
        place.put(thesis);
        Ok(())
    };
    // SAFETY: null is allowed.
    unsafe { reply(core::ptr::null_mut(), fill()) }
}

/// Checks a configuration, and says how many bytes its server needs here, at most GT_SERVER_SIZE_6_BLACK_BOX.
/// `size` may be null.
///
/// Errors: GT_CODE_BLACK_BOX, GT_CODE_MOTOR_COUNT, those of LIMITS_, CONFIG_ and MOTOR_MAP: the first found.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_config_check(
    config: *const gt_server_config,
    size: *mut usize,
    error: *mut gt_error,
) -> gt_code {
    let check = || {
        // SAFETY: the header's rules for pointers.
        let config = unsafe { read(config) }?;
        config.check()?;
        // SAFETY: as above; null is allowed.
        if let Ok(place) = unsafe { place(size) } {
            place.put(match (config.axes, config.black_box_ticks) {
                (3, GT_BLACK_BOX_NONE) => size_of::<Running<3, NONE>>(),
                (3, _) => size_of::<Running<3, HALF>>(),
                (_, GT_BLACK_BOX_NONE) => size_of::<Running<6, NONE>>(),
                (_, _) => size_of::<Running<6, HALF>>(),
            });
        }
        Ok(())
    };
    // SAFETY: as above.
    unsafe { reply(error, check()) }
}

/// Makes a server in `memory`, without connections. Offsets that the drives still have in force start in GT_PHASE_SAFE_DISCONNECT.
/// Nothing is to be freed: memory of a server that is no longer used can be used again.
///
/// `memory`, `size`: aligned to GT_ALIGN (GT_MEMORY, malloc), at least GT_SERVER_SIZE_... bytes; what it holds does not matter.
/// `server`: receives the handle, which points into `memory`.
///
/// Errors: those of gt_server_config_check; GT_CODE_MEMORY_TOO_SMALL, GT_CODE_MISALIGNED, GT_CODE_START_OFFSET_IN_FORCE.
/// After an error nothing in the memory is to be used, a server that was there before included.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_init(
    memory: *mut c_void,
    size: usize,
    config: *const gt_server_config,
    start: *const gt_start,
    server: *mut *mut gt_server,
    error: *mut gt_error,
) -> gt_code {
    let init = || {
        // SAFETY: the header's rules for pointers.
        unsafe {
            let server = place(server)?;
            let (config, start) = (read(config)?, read(start)?);
            config.check()?;
            server.put(match (config.axes, config.black_box_ticks) {
                (3, GT_BLACK_BOX_NONE) => begin::<3, NONE>(memory, size, &config, &start)?,
                (3, _) => begin::<3, HALF>(memory, size, &config, &start)?,
                (_, GT_BLACK_BOX_NONE) => begin::<6, NONE>(memory, size, &config, &start)?,
                (_, _) => begin::<6, HALF>(memory, size, &config, &start)?,
            });
        }
        Ok(())
    };
    // SAFETY: as above.
    unsafe { reply(error, init()) }
}

/// A server in its memory.
///
/// # Safety
/// As [`settle_in_parts`].
#[inline(never)]
unsafe fn begin<const N: usize, const TICKS: usize>(
    memory: *mut c_void,
    size: usize,
    config: &gt_server_config,
    start: &gt_start,
) -> Reply<*mut gt_server> {
    let parts = || Running::<N, TICKS>::parts(config, start);
    // SAFETY: the caller's promise, and `write` writes a whole server.
    unsafe {
        settle_in_parts(memory, size, parts, |parts, place| {
            Running::<N, TICKS>::write(parts, place);
        })
    }
}

/// Registers a connection that the caller has accepted. `transport`: GT_TRANSPORT_STREAM or GT_TRANSPORT_DATAGRAM.
/// `connection` receives its number, which is never given twice.
///
/// Errors: GT_CODE_TRANSPORT; GT_CODE_FULL: GT_MAX_CONNECTIONS are open, send gt_server_refusal and close.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_open(
    server: *mut gt_server,
    transport: u32,
    connection: *mut u64,
) -> gt_code {
    let open = || {
        // SAFETY: the header's rules for pointers.
        let connection = unsafe { place(connection) }?;
        let transport = match transport {
            GT_TRANSPORT_STREAM => Transport::Stream,
            GT_TRANSPORT_DATAGRAM => Transport::Datagram,
            _ => return Err(gt_code::Transport.into()),
        };
        connection.put(ask!(server, server => server.open(transport)?));
        Ok(())
    };
    // SAFETY: null is allowed.
    unsafe { reply(core::ptr::null_mut(), open()) }
}

/// The frame for a peer for whom there is no room; its `connection` has no meaning.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_refusal(frame: *mut gt_frame) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        let put = place(frame).map(|place| place.put(full_refusal()));
        reply(core::ptr::null_mut(), put)
    }
}

/// Says that a connection is gone: closed by its peer, reset, or because a frame could not be written to it whole.
/// One that is not open is ignored.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_close(server: *mut gt_server, connection: u64) -> gt_code {
    let close = || {
        ask!(server, server => server.close(connection));
        Ok(())
    };
    // SAFETY: null is allowed.
    unsafe { reply(core::ptr::null_mut(), close()) }
}

/// Takes bytes that were read from a connection: for a stream any piece of it, for datagrams exactly one.
/// The work is bounded by `length`; what exceeds a connection's budget of frames per tick is not read (8 of the owner: a ninth ends
/// the session; 1 of others: they are closed). A connection that is not open is ignored.
///
/// `frames` receives how many frames the coming tick has of this connection; it may be null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_feed(
    server: *mut gt_server,
    connection: u64,
    bytes: *const u8,
    length: usize,
    frames: *mut u8,
) -> gt_code {
    let feed = || {
        // SAFETY: the header's rules for pointers.
        let bytes = unsafe { self::bytes(bytes, length) }?;
        let taken = ask!(server, server => server.feed(connection, bytes));
        // SAFETY: as above; null is allowed.
        if let Ok(place) = unsafe { place(frames) } {
            place.put(taken);
        }
        Ok(())
    };
    // SAFETY: null is allowed.
    unsafe { reply(core::ptr::null_mut(), feed()) }
}

/// Lock-step: `answered` receives 1 if the coming tick has what it waits for (a Command that answers the last State, or something of
/// the owner's that ends the session), else 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_owner_has_answered(
    server: *mut gt_server,
    answered: *mut u8,
) -> gt_code {
    let look = || {
        // SAFETY: the header's rules for pointers.
        let answered = unsafe { place(answered) }?;
        answered.put(ask!(server, server => server.owner_has_answered().into()));
        Ok(())
    };
    // SAFETY: null is allowed.
    unsafe { reply(core::ptr::null_mut(), look()) }
}

/// One cycle: everything that was fed since the last tick is heard, then one step is taken. Its work is bounded, whatever arrived, and
/// it takes the same path of memory every time: no allocation, no lock, no clock.
///
/// Call it once per cycle, then write `turn->motors` to the drives, then fetch and write the frames, then close what `turn->close` names.
/// What the drives do when no tick comes is their watchdog's business.
///
/// An error changes nothing: GT_CODE_NULL_POINTER, GT_CODE_MISALIGNED, GT_CODE_NO_OBJECT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_tick(
    server: *mut gt_server,
    cycle: *const gt_cycle,
    turn: *mut gt_turn,
) -> gt_code {
    let tick = || {
        // SAFETY: the header's rules for pointers.
        let (turn, cycle) = unsafe { (place(turn)?, read(cycle)?) };
        turn.put(ask!(server, server => server.tick(cycle)));
        Ok(())
    };
    // SAFETY: null is allowed.
    unsafe { reply(core::ptr::null_mut(), tick()) }
}

/// Frame `index` of the last tick, 0 to frame_count - 1, in the order in which they are to be written: refusals, the Welcome, the State.
/// It is copied; it can be fetched again until the next tick.
///
/// Errors: GT_CODE_INDEX.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_frame(
    server: *mut gt_server,
    index: u32,
    frame: *mut gt_frame,
) -> gt_code {
    let fetch = || {
        // SAFETY: the header's rules for pointers.
        let place = unsafe { place(frame) }?;
        let index = usize::try_from(index).map_err(|_| gt_code::Index)?;
        let frame = ask!(server, server => server.frame(index));
        place.put(frame.ok_or(gt_code::Index)?);
        Ok(())
    };
    // SAFETY: null is allowed.
    unsafe { reply(core::ptr::null_mut(), fetch()) }
}

/// The drives did not take the last references, and have these offsets in force instead (GT_MAX_AXES entries, of which the machine's
/// are looked at). The channels go on from them at rest, without a step; the session is over, and the black box begins anew.
///
/// Errors: GT_CODE_START_OFFSET_IN_FORCE; nothing is changed then.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_resume(
    server: *mut gt_server,
    in_force: *const gt_offsets,
    error: *mut gt_error,
) -> gt_code {
    let resume = || {
        // SAFETY: the header's rules for pointers.
        let offsets = unsafe { read(in_force.cast::<[gt_offsets; GT_MAX_AXES]>()) }?;
        ask!(server, server => server.resume(&offsets))
    };
    // SAFETY: as above.
    unsafe { reply(error, resume()) }
}

/// What the black box holds. Without one: 0 ticks, never frozen.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_black_box(
    server: *mut gt_server,
    black_box: *mut gt_black_box,
) -> gt_code {
    let look = || {
        // SAFETY: the header's rules for pointers.
        let place = unsafe { place(black_box) }?;
        place.put(ask!(server, server => server.black_box()));
        Ok(())
    };
    // SAFETY: null is allowed.
    unsafe { reply(core::ptr::null_mut(), look()) }
}

/// Line `index` of the black box as a file, 0 to `lines` - 1 of gt_black_box: JSON that ends with a newline, without a zero after it.
/// All lines in order are a file that `gantry-tau replay` runs again, bit for bit. A frozen box does not change, so that a
/// program can write a line per cycle; one that still records is to be read between two ticks, whole.
///
/// `buffer`, `size`: initialised memory, GT_BLACK_BOX_LINE bytes at most; null with size 0 to ask for the length.
/// `length`: receives the length of the line, whether it fits or not.
///
/// Errors: GT_CODE_INDEX; GT_CODE_BUFFER_TOO_SMALL: the buffer has the beginning of the line.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_black_box_line(
    server: *mut gt_server,
    index: u32,
    buffer: *mut c_char,
    size: usize,
    length: *mut usize,
) -> gt_code {
    let write = || {
        // SAFETY: the header's rules for pointers.
        let (length, room) = unsafe { (place(length)?, self::buffer(buffer.cast(), size)?) };
        let mut line = Line::new(room);
        let index = usize::try_from(index).map_err(|_| gt_code::Index)?;
        ask!(server, server => server.write_black_box(index, &mut line)?);
        length.put(line.length());
        if line.length() > size {
            let needed = count(line.length());
            return Err(gt_error::new(gt_code::BufferTooSmall).value(needed));
        }
        Ok(())
    };
    // SAFETY: null is allowed.
    unsafe { reply(core::ptr::null_mut(), write()) }
}

/// Forgets what the black box holds, and records again: after its lines are written, and when a new session was granted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_black_box_release(server: *mut gt_server) -> gt_code {
    let release = || {
        ask!(server, server => server.release_black_box());
        Ok(())
    };
    // SAFETY: null is allowed.
    unsafe { reply(core::ptr::null_mut(), release()) }
}
