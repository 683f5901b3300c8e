//! The session server: bytes in, drive references and bytes out.

mod config;
mod frame;
mod keys;
mod running;
mod tick;

use core::ffi::c_void;
use core::ptr::null_mut;

use gantry_tau_core::control::endpoint::{Endpoint, Transport};
use gantry_tau_core::control::session::Connection;
use gantry_tau_core::units::{Epoch, EpochRange};

pub use config::{gt_axis_config, gt_in_force, gt_limits, gt_offsets, gt_server_config, gt_start};
pub use frame::{GT_MAX_FRAME, gt_frame};
pub use keys::{
    GT_GREETED_ANSWER, GT_GREETED_NOTHING, GT_GREETED_PEER, GT_KEY_ID, GT_MAX_KEYS, GT_PEER,
    GT_ROLE_CONTROL, GT_ROLE_READ, GT_SECRET, gt_greeting, gt_key, gt_key_id, gt_key_parse,
    gt_keys,
};
pub use tick::{
    GT_FLAG_NOMINAL_ACCEL, GT_FLAG_NOMINAL_STEP, GT_FLAG_POSITION_LIMITED, GT_FLAG_TORQUE_LIMITED,
    GT_FLAG_TRAVEL, GT_FLAG_VELOCITY_LIMITED, GT_PRESSED, GT_READING_DONE, GT_READING_FAILED,
    GT_RELEASED, GT_SAMPLE_CUT, GT_SAMPLE_DONE, GT_SAMPLE_NONE, GT_WRITE_ACCEPTED,
    GT_WRITE_REFUSED, GT_WRITE_UNKNOWN, gt_actual, gt_axis_state, gt_cause, gt_counters, gt_held,
    gt_phase, gt_reference, gt_state, gt_tick_input, gt_tick_output, gt_wrench_sample,
    gt_wrench_sample_of,
};

use keys::granted_key;
use running::{HALF, NONE, Running};

#[cfg(feature = "verification")]
pub(crate) use tick::say;

use crate::black_box::{gt_black_box, look, write_part};
use crate::code::gt_code;
use crate::error::{count, gt_error};
use crate::memory::{
    Object, Reply, answer, buffer, bytes, checked, duplicate, object_mut, put_some, read, reply,
    tag_of,
};

/// Length of arrays per axis.
pub const GT_MAX_AXES: usize = 6;
/// Length of arrays per motor.
pub const GT_MAX_MOTORS: usize = 12;
/// Connections that can be open at once: the owner, and others that are told why they cannot be.
pub const GT_MAX_CONNECTIONS: usize = 6;

/// TCP and the like: bytes come in pieces of any length. A broken frame ends the connection, and
/// its session.
pub const GT_TRANSPORT_STREAM: u32 = 0;
/// UDP and the like: each gt_server_feed is one whole datagram. A broken one is dropped.
pub const GT_TRANSPORT_DATAGRAM: u32 = 1;

/// No black box.
pub const GT_BLACK_BOX_NONE: u32 = 0;
/// A black box of at least this many ticks before the end of a session, and as many after it.
pub const GT_BLACK_BOX_TICKS: u32 = 64;

/// Bytes of a server with 3 axes and no black box, on any target.
pub const GT_SERVER_SIZE_3: usize = 9_984;
/// Bytes of a server with 6 axes and no black box.
pub const GT_SERVER_SIZE_6: usize = 13_312;
/// Bytes of a server with 3 axes and a black box.
pub const GT_SERVER_SIZE_3_BLACK_BOX: usize = 400_128;
/// Bytes of a server with 6 axes and a black box, the largest server.
pub const GT_SERVER_SIZE_6_BLACK_BOX: usize = 595_456;

/// Largest distance of a drive from what gt_start says is in force, nm.
pub const GT_START_WINDOW_NM: u64 = 1_000_000;

/// A server; its memory is the caller's.
pub struct gt_server(());

/// Calls the server of a handle, of any type. A match instead of a table of functions, so that a
/// program links only the called ones.
macro_rules! ask {
    ($handle:expr, $server:ident => $answer:expr) => {
        ask!($handle, $server => $answer, 3 NONE, 3 HALF, 6 NONE, 6 HALF)
    };
    ($handle:expr, $server:ident => $answer:expr, $($axes:literal $ticks:ident),+) => {
        match tag_of($handle)? {
            $(<Running<$axes, $ticks>>::TAG => {
                let $server = object_mut::<Running<$axes, $ticks>>($handle)?;
                $answer
            })+
            _ => return Err(gt_code::NoObject.into()),
        }
    };
}

/// Calls a function of the type of server that a configuration wants.
macro_rules! of_type {
    ($config:expr, $function:ident($($argument:expr),+)) => {
        match ($config.axes, $config.black_box_ticks) {
            (3, GT_BLACK_BOX_NONE) => Running::<3, NONE>::$function($($argument),+)?,
            (3, GT_BLACK_BOX_TICKS) => Running::<3, HALF>::$function($($argument),+)?,
            (6, GT_BLACK_BOX_NONE) => Running::<6, NONE>::$function($($argument),+)?,
            (6, GT_BLACK_BOX_TICKS) => Running::<6, HALF>::$function($($argument),+)?,
            (_, GT_BLACK_BOX_NONE | GT_BLACK_BOX_TICKS) => return Err($config.refused_axes()),
            (_, other) => return Err(gt_error::new(gt_code::BlackBox).value(other.into())),
        }
    };
}

/// Copies a server of any type.
///
/// # Safety
/// As [`duplicate`].
pub(crate) unsafe fn duplicate_server(
    server: *const gt_server,
    memory: *mut c_void,
    size: usize,
) -> Reply<*mut gt_server> {
    // SAFETY: the caller's promise.
    unsafe {
        match tag_of(server)? {
            <Running<3, NONE>>::TAG => duplicate::<Running<3, NONE>>(server, memory, size),
            <Running<3, HALF>>::TAG => duplicate::<Running<3, HALF>>(server, memory, size),
            <Running<6, NONE>>::TAG => duplicate::<Running<6, NONE>>(server, memory, size),
            <Running<6, HALF>>::TAG => duplicate::<Running<6, HALF>>(server, memory, size),
            _ => Err(gt_code::NoObject.into()),
        }
    }
}

/// Fills a configuration with the profile of the thesis: 1 kHz, one lost Command tolerated,
/// position offsets of at most 2 mm that change by at most 5 um per tick and go back to zero by 0.1
/// um per tick, no velocity or torque offsets, one motor per axis, no black box. Travel and
/// nominal_step_nm are 0 and must be set: no machine is assumed. `axes`: 3 or 6.
///
/// Errors: GT_CODE_NULL_POINTER, GT_CODE_MISALIGNED, GT_CODE_CONFIG_AXES.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_config_thesis(
    config: *mut gt_server_config,
    axes: u32,
) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(config, null_mut(), || {
            let thesis = gt_server_config::thesis(axes);
            if matches!(axes, 3 | 6) {
                Ok(thesis)
            } else {
                Err(thesis.refused_axes())
            }
        })
    }
}

/// Checks a configuration, and returns the bytes that its server needs on this target, at most
/// GT_SERVER_SIZE_6_BLACK_BOX. `size` may be null.
///
/// Errors: GT_CODE_BLACK_BOX, GT_CODE_MOTOR_COUNT, those of LIMITS_, CONFIG_ and MOTOR_MAP: the
/// first found.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_config_check(
    config: *const gt_server_config,
    size: *mut usize,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        reply(error, || {
            let config = read(config)?;
            put_some(size, of_type!(config, check(&config)));
            Ok(())
        })
    }
}

/// Creates a server in `memory`, without connections. Offsets in force start in
/// GT_PHASE_SAFE_DISCONNECT, a latched stop in GT_PHASE_FAULT. Nothing is to be freed: memory of a
/// server that is no longer used can be used again.
///
/// `memory`, `size`: aligned to GT_ALIGN (GT_MEMORY, malloc), at least GT_SERVER_SIZE_... bytes;
/// its contents are overwritten. `server`: receives the handle, which points into `memory`.
///
/// Errors: those of gt_server_config_check; GT_CODE_MEMORY_TOO_SMALL, GT_CODE_MISALIGNED,
/// GT_CODE_START_OFFSET_IN_FORCE. After an error do not use a server that was in the memory before.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_init(
    memory: *mut c_void,
    size: usize,
    config: *const gt_server_config,
    start: *const gt_start,
    server: *mut *mut gt_server,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(server, error, || {
            let (config, start) = (read(config)?, read(start)?);
            of_type!(config, check(&config));
            Ok(of_type!(config, begin(memory, size, &config, &start, None)))
        })
    }
}

/// As gt_server_init, for a server that holders of these keys only are heard by: every frame has a
/// tag. Over datagrams a peer without a connection is heard by gt_server_greet.
///
/// Errors: as gt_server_init; GT_CODE_KEY_COUNT, GT_CODE_KEY_ROLE, GT_CODE_KEY_TWICE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_init_keyed(
    memory: *mut c_void,
    size: usize,
    config: *const gt_server_config,
    start: *const gt_start,
    keys: *const gt_keys,
    server: *mut *mut gt_server,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(server, error, || {
            let (config, start, keys) = (read(config)?, read(start)?, read(keys)?);
            of_type!(config, check(&config));
            let keys = Some(keys.checked()?);
            Ok(of_type!(config, begin(memory, size, &config, &start, keys)))
        })
    }
}

/// Takes a datagram of a peer without a connection. Only a Hello gets it one; of a server with keys
/// only a Hello with a right tag, from a peer that has shown that it hears. Datagrams of a peer with
/// a connection go to gt_server_feed.
///
/// `peer`: GT_PEER bytes of its address and port; `greeting` receives what to do.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_greet(
    server: *mut gt_server,
    peer: *const u8,
    datagram: *const u8,
    length: usize,
    greeting: *mut gt_greeting,
) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(greeting, null_mut(), || {
            let peer = read(peer.cast::<[u8; GT_PEER]>())?;
            let datagram = bytes(datagram, length)?;
            Ok(ask!(server, server => gt_greeting::new(server.endpoint.greet(&peer, datagram))))
        })
    }
}

/// `id` receives the GT_KEY_ID bytes of the name of the session's key, for the log. GT_CODE_DONE:
/// there is no session, or there are no keys.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_granted_key(server: *mut gt_server, id: *mut u8) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(
            id.cast::<[u8; GT_KEY_ID]>(),
            null_mut(),
            || ask!(server, server => granted_key(&server.endpoint)),
        )
    }
}

/// Registers a connection that the caller has accepted. `transport`: GT_TRANSPORT_STREAM or
/// GT_TRANSPORT_DATAGRAM. `connection` receives its number, which is never given twice.
///
/// Errors: GT_CODE_TRANSPORT; GT_CODE_FULL: GT_MAX_CONNECTIONS are open, send gt_server_refusal and
/// close.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_open(
    server: *mut gt_server,
    transport: u32,
    connection: *mut u64,
) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(connection, null_mut(), || {
            let transport = transport_of(transport)?;
            Ok(ask!(server, server => server.endpoint.open(transport)?.0))
        })
    }
}

fn transport_of(code: u32) -> Result<Transport, gt_code> {
    match code {
        GT_TRANSPORT_STREAM => Ok(Transport::Stream),
        GT_TRANSPORT_DATAGRAM => Ok(Transport::Datagram),
        _ => Err(gt_code::Transport),
    }
}

/// `connection` receives the one that is to make room for a new stream after GT_CODE_FULL: send it
/// the frame of gt_server_refusal, close it, and open the new one. GT_CODE_DONE: there is none, and
/// the new one is refused.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_longest_idle(
    server: *mut gt_server,
    connection: *mut u64,
) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(connection, null_mut(), || {
            let idle = ask!(server, server => server.endpoint.longest_idle());
            Ok(idle.ok_or(gt_code::Done)?.0)
        })
    }
}

/// Returns the frame for a peer without room for its connection; the frame's `connection` has no
/// meaning. `transport`: as for gt_server_open.
///
/// Errors: GT_CODE_TRANSPORT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_refusal(transport: u32, frame: *mut gt_frame) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(frame, null_mut(), || {
            let transport = transport_of(transport)?;
            // The same for any number of axes.
            Ok(gt_frame::new(
                Connection(u64::MAX),
                &Endpoint::<3>::full_refusal(transport),
            ))
        })
    }
}

/// Takes note that a connection is gone: closed by its peer, reset, or because a frame could not be
/// written to it whole. A connection that is not open is ignored.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_close(server: *mut gt_server, connection: u64) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        reply(null_mut(), || {
            ask!(server, server => server.endpoint.close(Connection(connection)));
            Ok(())
        })
    }
}

/// Takes bytes that were read from a connection: for a stream any piece of it, for datagrams
/// exactly one. The work is bounded by `length`. Frames beyond a connection's budget per tick are
/// not read (8 of the owner: a ninth ends the session; 1 of others: they are closed). A connection
/// that is not open is ignored.
///
/// `frames` receives the number of frames of this connection in the coming tick; it may be null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_feed(
    server: *mut gt_server,
    connection: u64,
    bytes: *const u8,
    length: usize,
    frames: *mut u8,
) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        reply(null_mut(), || {
            let bytes = self::bytes(bytes, length)?;
            put_some(
                frames,
                ask!(server, server => server.endpoint.feed(Connection(connection), bytes)),
            );
            Ok(())
        })
    }
}

/// Lock-step: `answered` receives 1 if the coming tick has what it waits for (a Command that
/// answers the last State, or an event of the owner that ends the session), else 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_owner_has_answered(
    server: *mut gt_server,
    answered: *mut u8,
) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(answered, null_mut(), || {
            Ok(ask!(server, server => server.endpoint.owner_has_answered().into()))
        })
    }
}

/// Replaces the epochs that may be granted: a further range, reserved in storage. An epoch is never
/// granted twice.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_set_epochs(
    server: *mut gt_server,
    first: u64,
    last: u64,
) -> gt_code {
    let epochs = EpochRange {
        first: Epoch(first),
        last: Epoch(last),
    };
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        reply(null_mut(), || {
            ask!(server, server => server.endpoint.set_epochs(epochs));
            Ok(())
        })
    }
}

/// Runs one cycle on everything that was fed since the last tick. Its work is bounded for
/// any input: no allocation, no lock, no clock.
///
/// Call it once per cycle; then write `output->motors` to the drives if `output->write` is not 0, and
/// tell gt_server_written what became of them; then send what gt_server_poll_transmit returns; then
/// close what gt_server_poll_close returns.
/// Drives need a watchdog for the case that no tick comes.
///
/// The first tick needs a reading, and compares it: GT_CODE_START_DISAGREES if a drive does not
/// stand at what gt_start says is in force.
///
/// Errors: GT_CODE_TICK_INPUT: reading, stop or rearm, in this order, is not one of its values, and
/// `error` says which; GT_CODE_NULL_POINTER, GT_CODE_MISALIGNED, GT_CODE_NO_OBJECT.
/// After an error nothing has changed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_tick(
    server: *mut gt_server,
    input: *const gt_tick_input,
    output: *mut gt_tick_output,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(output, error, || {
            let input = read(input)?;
            ask!(server, server => server.tick(input))
        })
    }
}

/// Returns the references of a cycle in which no tick is run, for a thread that calls in a burst
/// after a delay: the offsets of the last tick on the nominal references of this cycle, within the
/// machine's travel. If one of them is further from that of the last tick than its limit in
/// `elapsed_cycles` cycles, all of them stay. Nothing changes: the next tick counts the cycle in
/// its own `elapsed_cycles`.
///
/// Of `input`, `elapsed_cycles` and `nominal_nm` are read.
///
/// Errors: GT_CODE_NULL_POINTER, GT_CODE_MISALIGNED, GT_CODE_NO_OBJECT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_hold(
    server: *mut gt_server,
    input: *const gt_tick_input,
    output: *mut gt_held,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(output, error, || {
            let input = read(input)?;
            Ok(ask!(server, server => server.hold(&input)))
        })
    }
}

/// Takes note of what became of the references of the last tick: GT_WRITE_ACCEPTED,
/// GT_WRITE_REFUSED, which stops, with the values in force at the drives, or GT_WRITE_UNKNOWN, which
/// stops. Call it once after every tick, before gt_server_poll_transmit: its State reports the values
/// in force, and the next tick goes on from them. Not called: unknown.
///
/// After a tick with `write` 0: GT_WRITE_REFUSED with the values that were read back, or
/// GT_WRITE_UNKNOWN. `in_force`: as many values as there are axes; read for GT_WRITE_REFUSED only, else
/// null is allowed.
///
/// Errors: GT_CODE_NOT_PENDING, GT_CODE_WITHHELD, GT_CODE_WRITE; GT_CODE_NULL_POINTER,
/// GT_CODE_MISALIGNED, GT_CODE_NO_OBJECT. But for GT_CODE_WITHHELD nothing has changed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_written(
    server: *mut gt_server,
    fate: u8,
    in_force: *const gt_in_force,
) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        reply(null_mut(), || {
            ask!(server, server => server.written(fate, in_force)?);
            Ok(())
        })
    }
}

/// Takes note of the time from the departure of the last State to the arrival of the last Command, us.
/// It is recorded, and reported by the State of the coming tick; without a call it is 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_note_arrival(server: *mut gt_server, us: u16) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        reply(null_mut(), || {
            ask!(server, server => server.endpoint.note_arrival(us));
            Ok(())
        })
    }
}

/// `at_zero` receives 1 if the drives took references without offsets in the last tick, so that the
/// program may end; else 0. After a refused write it is 0 for any values in force before: the drives
/// may have taken a part of it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_is_at_zero(server: *mut gt_server, at_zero: *mut u8) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(at_zero, null_mut(), || {
            Ok(ask!(server, server => server.endpoint.is_at_zero().into()))
        })
    }
}

/// Returns the next frame of the last tick, in the order in which they are to be sent: Refusals,
/// the Welcome, the State. Frames that are not polled before the next tick are discarded.
///
/// Errors: GT_CODE_DONE after the last one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_poll_transmit(
    server: *mut gt_server,
    frame: *mut gt_frame,
) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(frame, null_mut(), || {
            let (to, frame) =
                ask!(server, server => server.endpoint.poll_transmit().ok_or(gt_code::Done)?);
            Ok(gt_frame::new(to, frame))
        })
    }
}

/// Returns the next connection to close, after its frames are sent. Poll the frames first. A
/// connection that is not polled keeps its place among GT_MAX_CONNECTIONS.
///
/// Errors: GT_CODE_DONE after the last one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_poll_close(
    server: *mut gt_server,
    connection: *mut u64,
) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(connection, null_mut(), || {
            Ok(ask!(server, server => server.endpoint.poll_close().ok_or(gt_code::Done)?.0))
        })
    }
}

/// Returns the contents of the black box. Without one: 0 ticks, never frozen.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_black_box(
    server: *mut gt_server,
    black_box: *mut gt_black_box,
) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(black_box, null_mut(), || {
            Ok(ask!(server, server => look(&server.black_box)))
        })
    }
}

/// Writes part `index` of the black box as a file, 0 to `parts` - 1 of gt_black_box. All parts in
/// order are a file that `gantry-tau replay` runs again, bit for bit. A frozen box does not change,
/// so a program can write a part per cycle; a box that still records is to be read as a whole
/// between two ticks.
///
/// `buffer`, `size`: initialised memory, GT_BLACK_BOX_PART bytes at most; null with size 0 to ask
/// for the length. `length`: receives the length of the part, whether it fits or not.
///
/// Errors: GT_CODE_INDEX; GT_CODE_BUFFER_TOO_SMALL: the buffer has the beginning of the part.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_black_box_part(
    server: *mut gt_server,
    index: u32,
    buffer: *mut u8,
    size: usize,
    length: *mut usize,
) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        reply(null_mut(), || {
            let (place, room) = (checked(length)?, self::buffer(buffer, size)?);
            let index = usize::try_from(index).map_err(|_| gt_code::Index)?;
            let length = ask!(server, server => write_part(&server.black_box, index, room)?);
            place.write(length);
            if length > size {
                return Err(gt_error::new(gt_code::BufferTooSmall).value(count(length)));
            }
            Ok(())
        })
    }
}

/// Clears the black box and records again: after its parts are written, and when a new session was
/// granted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_server_black_box_release(server: *mut gt_server) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        reply(null_mut(), || {
            ask!(server, server => server.black_box.release());
            Ok(())
        })
    }
}
