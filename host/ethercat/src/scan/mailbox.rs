//! Mailbox of a device: objects read by CoE, one after the other; ETG1000.6.

use super::ScanError;
use super::station::Station;
use crate::clock;

/// Longest wait for an answer, µs.
const ANSWER_US: u64 = 1_000_000;
/// Requests without an answer after which a device is asked no more.
const PATIENCE: u32 = 4;
/// Messages that are read while waiting for one answer.
const MESSAGES: u32 = 32;
/// Mailbox type of CoE, and its services.
const COE: u8 = 3;
const EMERGENCY: u8 = 1;
const SDO_REQUEST: u8 = 2;
const SDO_RESPONSE: u8 = 3;

/// Answer of an SDO: bytes of the object, or the abort code.
pub(super) type Response = Option<Result<u32, u32>>;

/// A mailbox with the requests that were sent through it.
pub(super) struct Mailbox<'a> {
    station: &'a Station,
    out: (u16, u16),
    back: (u16, u16),
    counter: u8,
    unanswered: u32,
    /// Error codes of emergency messages.
    pub(super) emergencies: Vec<u16>,
}

impl<'a> Mailbox<'a> {
    pub(super) const fn new(station: &'a Station, [out, back]: [(u16, u16); 2]) -> Self {
        Self {
            station,
            out,
            back,
            counter: 0,
            unanswered: 0,
            emergencies: Vec::new(),
        }
    }

    /// Reads an object of at most four bytes. `None` without an answer.
    pub(super) async fn upload(&mut self, index: u16, sub: u8) -> Result<Response, ScanError> {
        self.twice(0x40, index, sub, [0; 4]).await
    }

    /// Writes an object of at most four bytes. `None` without an answer.
    pub(super) async fn download(
        &mut self,
        index: u16,
        sub: u8,
        value: u32,
        length: u8,
    ) -> Result<Response, ScanError> {
        let command = 0x23 | (4 - length.clamp(1, 4)) << 2;
        self.twice(command, index, sub, value.to_le_bytes()).await
    }

    /// Sends a request again that was not answered: an answer whose frame is lost does not come back.
    async fn twice(
        &mut self,
        command: u8,
        index: u16,
        sub: u8,
        data: [u8; 4],
    ) -> Result<Response, ScanError> {
        match self.request(command, index, sub, data).await? {
            None => self.request(command, index, sub, data).await,
            answer => Ok(answer),
        }
    }

    async fn request(
        &mut self,
        command: u8,
        index: u16,
        sub: u8,
        data: [u8; 4],
    ) -> Result<Response, ScanError> {
        if self.unanswered >= PATIENCE {
            return Ok(None);
        }
        // What came after the last answer does not belong to this request.
        for _ in 0..MESSAGES {
            match self.station.read_mailbox(self.back).await? {
                Some(message) => _ = self.note_emergency(&message),
                None => break,
            }
        }
        self.counter = self.counter % 7 + 1;
        let [low, high] = index.to_le_bytes();
        let mut bytes = vec![10, 0, 0, 0, 0, self.counter << 4 | COE];
        bytes.extend([0, SDO_REQUEST << 4, command, low, high, sub]);
        bytes.extend(data);
        bytes.resize(self.out.1.into(), 0);
        let limit_us = clock::now_us().saturating_add(ANSWER_US);
        while !self.station.write_mailbox(self.out, &bytes).await? {
            if clock::now_us() >= limit_us {
                self.unanswered += 1;
                return Ok(None);
            }
            clock::wait_until(clock::now_us() + 500).await;
        }
        let mut messages = 0;
        while clock::now_us() < limit_us && messages < MESSAGES {
            match self.station.read_mailbox(self.back).await? {
                None => clock::wait_until(clock::now_us() + 200).await,
                Some(message) => {
                    messages += 1;
                    if self.note_emergency(&message) {
                        continue;
                    }
                    if let Some(response) = response(&message, index, sub) {
                        self.unanswered = 0;
                        return Ok(Some(response));
                    }
                }
            }
        }
        self.unanswered += 1;
        Ok(None)
    }

    /// Takes note of an emergency message; false for another message.
    fn note_emergency(&mut self, message: &[u8]) -> bool {
        let is_emergency = kind(message) == COE && service(message) == EMERGENCY;
        if let (true, Some(&[low, high])) = (is_emergency, message.get(8..10)) {
            let code = u16::from_le_bytes([low, high]);
            if !self.emergencies.contains(&code) {
                self.emergencies.push(code);
            }
        }
        is_emergency
    }
}

fn kind(message: &[u8]) -> u8 {
    message.get(5).map_or(0, |byte| byte & 0x0F)
}

fn service(message: &[u8]) -> u8 {
    message.get(7).map_or(0, |byte| byte >> 4)
}

/// Returns the value of a message that answers a request for an object, or the abort code; `None`
/// for another message. Values of more than four bytes are cut.
fn response(message: &[u8], index: u16, sub: u8) -> Option<Result<u32, u32>> {
    // An error of the mailbox itself: the device does not take the request.
    if kind(message) == 0 {
        let code = message.get(8..10)?;
        return Some(Err(u16::from_le_bytes(code.try_into().ok()?).into()));
    }
    let [low, high] = index.to_le_bytes();
    if kind(message) != COE || message.get(9..12) != Some(&[low, high, sub]) {
        return None;
    }
    let command = *message.get(8)?;
    let long = |at: usize| {
        let bytes = message.get(at..at + 4)?;
        Some(u32::from_le_bytes(bytes.try_into().ok()?))
    };
    if command == 0x80 {
        return Some(Err(long(12)?));
    }
    if service(message) != SDO_RESPONSE {
        return None;
    }
    match command >> 5 {
        // A download.
        3 => Some(Ok(0)),
        // An expedited upload, with or without its length.
        2 if command & 0x02 != 0 => {
            let unused = if command & 0x01 != 0 {
                u32::from(command >> 2 & 3)
            } else {
                0
            };
            Some(Ok(long(12)? & u32::MAX.checked_shr(8 * unused)?))
        }
        // A normal upload: the length, then as many bytes.
        2 => {
            let length = usize::try_from(long(12)?).ok()?.min(4);
            let bytes = message.get(16..16 + length)?;
            Some(Ok(bytes
                .iter()
                .rev()
                .fold(0, |value, byte| value << 8 | u32::from(*byte))))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::response;

    fn message(kind: u8, service: u8, sdo: &[u8]) -> Vec<u8> {
        let mut bytes = vec![10, 0, 0, 0, 0, 1 << 4 | kind, 0, service << 4];
        bytes.extend(sdo);
        bytes
    }

    #[test]
    fn answers_are_taken_by_their_object() {
        let expedited = message(3, 3, &[0x4B, 0x41, 0x60, 0, 0x37, 0x02, 0xFF, 0xFF]);
        assert_eq!(response(&expedited, 0x6041, 0), Some(Ok(0x0237)));
        assert_eq!(response(&expedited, 0x6041, 1), None, "another sub-index");
        assert_eq!(response(&expedited, 0x6040, 0), None, "another object");
        let normal = message(3, 3, &[0x41, 0x41, 0x60, 0, 2, 0, 0, 0, 0x37, 0x02]);
        assert_eq!(response(&normal, 0x6041, 0), Some(Ok(0x0237)));
        let aborted = message(3, 2, &[0x80, 0x41, 0x60, 0, 0, 0, 2, 6]);
        assert_eq!(response(&aborted, 0x6041, 0), Some(Err(0x0602_0000)));
    }

    #[test]
    fn what_is_cut_of_another_kind_or_wrong_is_no_answer() {
        let whole = message(3, 3, &[0x43, 0x41, 0x60, 0, 1, 2, 3, 4]);
        for length in 0..whole.len() {
            assert_eq!(
                response(&whole[..length], 0x6041, 0),
                None,
                "{length} bytes"
            );
        }
        assert_eq!(
            response(&message(5, 3, &whole[8..]), 0x6041, 0),
            None,
            "SoE"
        );
        assert_eq!(response(&message(3, 1, &whole[8..]), 0x6041, 0), None);
        let beyond = message(3, 3, &[0x41, 0x41, 0x60, 0, 0xFF, 0xFF, 0xFF, 0xFF, 1]);
        assert_eq!(
            response(&beyond, 0x6041, 0),
            None,
            "longer than the mailbox"
        );
        // An error reply of the mailbox: the service is not offered.
        assert_eq!(
            response(&[4, 0, 0, 0, 0, 0x10, 1, 0, 2, 0], 0x6041, 0),
            Some(Err(2))
        );
    }
}
