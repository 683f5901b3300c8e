//! Mailbox of an emulated device: CoE with expedited transfers, and normal uploads of what is
//! longer.

use super::objects::abort;

/// Length of the mailbox's, CoE's and SDO's headers, bytes.
const HEADERS: usize = 12;
/// Mailbox type of CoE, and of an error.
const COE: u8 = 3;
const ERROR: u8 = 0;

/// Objects that are read and written through the mailbox.
pub(super) trait Dictionary {
    /// Returns the name, object 1008h and a string of the EEPROM.
    fn name(&self) -> &'static str;

    /// Uploads an object, in every state.
    ///
    /// # Errors
    /// The abort code.
    fn upload(&self, index: u16, sub: u8) -> Result<([u8; 4], usize), u32>;

    /// Downloads an object; mapping and assignment in PRE-OP only.
    ///
    /// # Errors
    /// The abort code.
    fn download(&mut self, index: u16, sub: u8, bytes: &[u8], is_pre_op: bool) -> Result<(), u32>;
}

/// Returns an emergency message with an error code.
pub(super) fn emergency(code: u16) -> Vec<u8> {
    let [low, high] = code.to_le_bytes();
    mailbox(COE, 0, &[0, 1 << 4, low, high, 0, 0, 0, 0, 0, 0])
}

/// Answers a request. `None` for one that a SubDevice ignores: a repeated one.
pub(super) fn answer(
    device: &mut impl Dictionary,
    request: &[u8],
    last_counter: &mut u8,
    is_pre_op: bool,
) -> Option<Vec<u8>> {
    let counter = byte(request, 5) >> 4 & 7;
    if counter != 0 && counter == *last_counter {
        return None;
    }
    *last_counter = counter;
    let length = usize::from(u16::from_le_bytes([byte(request, 0), byte(request, 1)]));
    let is_sdo_request = byte(request, 7) >> 4 == 2;
    if byte(request, 5) & 0x0F != COE
        || length < 10
        || length + 6 > request.len()
        || !is_sdo_request
    {
        // Unsupported protocol: an error reply of the mailbox.
        return Some(mailbox(ERROR, counter, &[1, 0, 2, 0]));
    }
    let command = byte(request, 8);
    let index = u16::from_le_bytes([byte(request, 9), byte(request, 10)]);
    let sub = byte(request, 11);
    let payload = request.get(HEADERS..HEADERS + 4).unwrap_or(&[]);
    let body = match respond(device, command, index, sub, payload, is_pre_op) {
        Ok(body) => body,
        Err(code) => body(0x80, index, sub, &code.to_le_bytes()),
    };
    Some(mailbox(COE, counter, &body))
}

/// Byte of a request; 0 beyond its end.
fn byte(request: &[u8], index: usize) -> u8 {
    request.get(index).copied().unwrap_or(0)
}

fn respond(
    device: &mut impl Dictionary,
    command: u8,
    index: u16,
    sub: u8,
    payload: &[u8],
    is_pre_op: bool,
) -> Result<Vec<u8>, u32> {
    let is_complete = command & 0x10 != 0;
    match command >> 5 {
        _ if is_complete => Err(abort::NO_COMPLETE_ACCESS),
        // Upload.
        2 if (index, sub) == (0x1008, 0) => {
            let name = device.name().as_bytes();
            let mut data = (name.len() as u32).to_le_bytes().to_vec();
            data.extend(name);
            Ok(body(0x41, index, sub, &data))
        }
        2 => {
            let (bytes, length) = device.upload(index, sub)?;
            Ok(body(0x43 | ((4 - length) as u8) << 2, index, sub, &bytes))
        }
        // Download: expedited, with its size.
        1 if command & 0x03 == 0x03 => {
            let length = 4 - usize::from(command >> 2 & 3);
            device.download(
                index,
                sub,
                payload.get(..length).ok_or(abort::LENGTH)?,
                is_pre_op,
            )?;
            Ok(body(0x60, index, sub, &[0; 4]))
        }
        _ => Err(abort::COMMAND),
    }
}

/// CoE header of an SDO response, or of a request that is aborted, and the SDO.
fn body(command: u8, index: u16, sub: u8, data: &[u8]) -> Vec<u8> {
    let service = if command == 0x80 { 2 } else { 3 };
    let [low, high] = index.to_le_bytes();
    let mut bytes = vec![0, service << 4, command, low, high, sub];
    bytes.extend(data);
    bytes
}

fn mailbox(kind: u8, counter: u8, body: &[u8]) -> Vec<u8> {
    let [low, high] = (body.len() as u16).to_le_bytes();
    let mut bytes = vec![low, high, 0, 0, 0, counter << 4 | kind];
    bytes.extend(body);
    bytes
}
