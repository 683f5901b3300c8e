//! Registers and EEPROM of one device.

use ethercrab::error::Error;
use ethercrab::{Command, MainDevice, RegisterAddress as Register};

use super::{ClockWidth, ScanError};
use crate::clock;

/// Registers of one sync manager, and the place of its status among them; ETG1000.4.
const SYNC_MANAGER_LEN: u16 = 8;
const SYNC_MANAGER_STATUS: u16 = 5;
/// States of AL control, and the bit that acknowledges an error.
pub(super) const INIT: u16 = 0x01;
const PRE_OP: u16 = 0x02;
pub(super) const ACKNOWLEDGE: u16 = 0x10;
/// Control bytes of the sync managers of the mailboxes, to and from the device.
const MAILBOX_CONTROL: [u8; 2] = [0x26, 0x22];
/// Longest mailbox, bytes: what a frame carries.
const MAX_MAILBOX: u16 = 1_024;
/// Longest wait for a state, and for a word of the EEPROM, µs.
const STATE_US: u64 = 3_000_000;
const SII_US: u64 = 100_000;
/// Words of an EEPROM that are read at most.
const SII_WORDS: u16 = 0x2000;
/// Categories: strings, and general.
const STRINGS: u16 = 10;
const GENERAL: u16 = 30;

/// Contents of an EEPROM.
#[derive(Clone, Debug)]
pub(super) struct Sii {
    pub(super) alias: u16,
    pub(super) vendor: u32,
    pub(super) product: u32,
    pub(super) revision: u32,
    pub(super) serial: u32,
    pub(super) protocols: u16,
    /// Start and length of the mailboxes to and from the device; `None` for lengths that cannot be.
    pub(super) mailboxes: Option<[(u16, u16); 2]>,
    pub(super) name: String,
}

/// A device with a station address.
pub(super) struct Station {
    main: &'static MainDevice<'static>,
    address: u16,
}

/// True if there is a device at a position.
pub(super) async fn answers(
    main: &'static MainDevice<'static>,
    position: u16,
) -> Result<bool, ScanError> {
    match Command::aprd(position, 0).receive::<u8>(main).await {
        Ok(_) => Ok(true),
        Err(Error::WorkingCounter { received: 0, .. }) => Ok(false),
        // Nothing at all comes back.
        Err(Error::Timeout(_)) if position == 0 => Err(ScanError::Silent),
        Err(error) => Err(failed("counting SubDevices")(error)),
    }
}

/// Gives a device its station address.
pub(super) async fn address(
    main: &'static MainDevice<'static>,
    position: u16,
    address: u16,
) -> Result<(), ScanError> {
    let write =
        Command::apwr(position, Register::ConfiguredStationAddress.into()).send(main, address);
    write.await.map_err(failed("giving station addresses"))
}

fn failed(step: &'static str) -> impl FnOnce(Error) -> ScanError {
    move |error| ScanError::Bus { step, error }
}

impl Station {
    pub(super) const fn new(main: &'static MainDevice<'static>, address: u16) -> Self {
        Self { main, address }
    }

    pub(super) async fn read<const L: usize>(
        &self,
        register: impl Into<u16>,
    ) -> Result<[u8; L], ScanError> {
        Command::fprd(self.address, register.into())
            .receive::<[u8; L]>(self.main)
            .await
            .map_err(failed("reading a register"))
    }

    async fn word(&self, register: Register) -> Result<u16, ScanError> {
        self.read(register).await.map(u16::from_le_bytes)
    }

    /// Reads a whole mailbox; `None` if it is empty.
    pub(super) async fn read_mailbox(
        &self,
        (start, length): (u16, u16),
    ) -> Result<Option<Vec<u8>>, ScanError> {
        let [status] = self
            .read(u16::from(Register::Sm1) + SYNC_MANAGER_STATUS)
            .await?;
        if status & 0x08 == 0 {
            return Ok(None);
        }
        let answer = Command::fprd(self.address, start)
            .receive_slice(self.main, length)
            .await;
        match answer {
            Ok(message) => Ok(Some(message.to_vec())),
            // It was read, and the frame with it was lost.
            Err(Error::WorkingCounter { .. }) => Ok(None),
            Err(error) => Err(failed("reading a mailbox")(error)),
        }
    }

    /// Writes a whole mailbox. False if the device does not take it: the last request is still in
    /// it.
    pub(super) async fn write_mailbox(
        &self,
        (start, _): (u16, u16),
        bytes: &[u8],
    ) -> Result<bool, ScanError> {
        let write = Command::fpwr(self.address, start).send_receive_slice(self.main, bytes);
        match write.await {
            Ok(_) => Ok(true),
            Err(Error::WorkingCounter { .. }) => Ok(false),
            Err(error) => Err(failed("writing a mailbox")(error)),
        }
    }

    async fn write<const L: usize>(
        &self,
        register: impl Into<u16>,
        bytes: [u8; L],
    ) -> Result<(), ScanError> {
        Command::fpwr(self.address, register.into())
            .send(self.main, bytes)
            .await
            .map_err(failed("writing a register"))
    }

    /// Returns the kind of the distributed clock.
    pub(super) async fn clock(&self) -> Result<ClockWidth, ScanError> {
        let features = self.word(Register::SupportFlags).await?;
        Ok(match (features & 0x04 != 0, features & 0x08 != 0) {
            (false, _) => ClockWidth::None,
            (true, false) => ClockWidth::Bits32,
            (true, true) => ClockWidth::Bits64,
        })
    }

    /// Takes the device to INIT, sets its mailboxes, and asks for PRE-OP. Returns the AL status code
    /// if it refuses.
    pub(super) async fn to_pre_op(
        &self,
        mailboxes: Option<[(u16, u16); 2]>,
    ) -> Result<Option<u16>, ScanError> {
        if let Err(code) = self.reach(ACKNOWLEDGE | INIT).await? {
            return Ok(Some(code));
        }
        for (index, ((start, length), control)) in
            (0_u16..).zip(mailboxes.into_iter().flatten().zip(MAILBOX_CONTROL))
        {
            let ([s0, s1], [l0, l1]) = (start.to_le_bytes(), length.to_le_bytes());
            let bytes = [s0, s1, l0, l1, control, 0, 1, 0];
            self.write(u16::from(Register::Sm0) + SYNC_MANAGER_LEN * index, bytes)
                .await?;
        }
        Ok(self.reach(PRE_OP).await?.err())
    }

    /// Asks for a state and waits for it; else returns the AL status code.
    async fn reach(&self, request: u16) -> Result<Result<(), u16>, ScanError> {
        self.write(Register::AlControl, request.to_le_bytes())
            .await?;
        let limit_us = clock::now_us().saturating_add(STATE_US);
        loop {
            let status = self.word(Register::AlStatus).await?;
            if status & 0x1F == request & 0x0F {
                return Ok(Ok(()));
            }
            let is_refused = status & 0x10 != 0 && request & ACKNOWLEDGE == 0;
            if is_refused || clock::now_us() >= limit_us {
                return Ok(Err(self.word(Register::AlStatusCode).await?));
            }
            clock::wait_until(clock::now_us() + 500).await;
        }
    }

    /// Reads two words of the EEPROM; `None` if the device does not give them.
    async fn words(&self, word: u16) -> Result<Option<[u16; 2]>, ScanError> {
        let [low, high] = word.to_le_bytes();
        self.write(Register::SiiControl, [0, 1, low, high, 0, 0])
            .await?;
        let limit_us = clock::now_us().saturating_add(SII_US);
        loop {
            let control = self.word(Register::SiiControl).await?;
            if control & 0x8000 == 0 {
                // Bits 11 to 14: checksum, not loaded, no acknowledgement, write enable.
                if control & 0x7800 != 0 {
                    self.write(Register::SiiControl, [0, 0]).await?;
                    return Ok(None);
                }
                let [a, b, c, d] = self.read(Register::SiiData).await?;
                return Ok(Some([a, c].map(u16::from))
                    .map(|[low0, low1]| [low0 | u16::from(b) << 8, low1 | u16::from(d) << 8]));
            }
            if clock::now_us() >= limit_us {
                return Ok(None);
            }
        }
    }

    async fn long(&self, word: u16) -> Result<u32, ScanError> {
        let [low, high] = self.words(word).await?.unwrap_or([0, 0]);
        Ok(u32::from(low) | u32::from(high) << 16)
    }

    /// Reads identity, mailboxes and name; zeros where the EEPROM gives nothing.
    pub(super) async fn sii(&self) -> Result<Sii, ScanError> {
        self.write(Register::SiiConfig, [0]).await?;
        self.write(Register::SiiControl, [0, 0]).await?;
        let [alias, _] = self.words(0x04).await?.unwrap_or([0, 0]);
        let [out_start, out_length] = self.words(0x18).await?.unwrap_or([0, 0]);
        let [in_start, in_length] = self.words(0x1A).await?.unwrap_or([0, 0]);
        let [protocols, _] = self.words(0x1C).await?.unwrap_or([0, 0]);
        let lengths = [out_length, in_length];
        let can_be = lengths
            .iter()
            .all(|length| (16..=MAX_MAILBOX).contains(length));
        Ok(Sii {
            alias,
            vendor: self.long(0x08).await?,
            product: self.long(0x0A).await?,
            revision: self.long(0x0C).await?,
            serial: self.long(0x0E).await?,
            protocols,
            mailboxes: can_be.then_some([(out_start, out_length), (in_start, in_length)]),
            name: self.name().await?,
        })
    }

    /// Reads the name: a number in the general category, and that string.
    async fn name(&self) -> Result<String, ScanError> {
        let (mut at, mut strings, mut index) = (0x40_u16, None, 0);
        while at < SII_WORDS {
            let Some([kind, length]) = self.words(at).await? else {
                break;
            };
            match kind {
                STRINGS => strings = Some((at + 2, length)),
                GENERAL => {
                    // Bytes 0 to 3: group, image, order, name.
                    let [_, second] = self.words(at + 2).await?.unwrap_or([0, 0]);
                    index = second >> 8;
                }
                0xFFFF => break,
                _ => {}
            }
            let Some(next) = at.checked_add(2).and_then(|next| next.checked_add(length)) else {
                break;
            };
            at = next;
        }
        match strings {
            Some((start, length)) if index > 0 => self.string(start, length, index).await,
            _ => Ok(String::new()),
        }
    }

    /// Reads a string, counted from 1, of a category.
    async fn string(&self, start: u16, words: u16, index: u16) -> Result<String, ScanError> {
        let mut bytes = Vec::new();
        for offset in (0..words.min(SII_WORDS)).step_by(2) {
            let Some(pair) = self.words(start.saturating_add(offset)).await? else {
                break;
            };
            bytes.extend(pair.into_iter().flat_map(u16::to_le_bytes));
            if let Some(text) = string_of(&bytes, index) {
                return Ok(text);
            }
        }
        Ok(String::new())
    }
}

/// Returns a string of a category, counted from 1, if the bytes reach to its end.
fn string_of(bytes: &[u8], index: u16) -> Option<String> {
    let (_, mut rest) = bytes.split_first()?;
    for number in 1..=index {
        let (length, after) = rest.split_first()?;
        let (text, after) = after.split_at_checked(usize::from(*length))?;
        if number == index {
            return Some(String::from_utf8_lossy(text).into_owned());
        }
        rest = after;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::string_of;

    #[test]
    fn strings_are_found_by_their_numbers_once_they_are_whole() {
        let bytes = *b"\x02\x03one\x03two\0";
        assert_eq!(string_of(&bytes, 1).as_deref(), Some("one"));
        assert_eq!(string_of(&bytes, 2).as_deref(), Some("two"));
        assert_eq!(string_of(&bytes[..8], 2), None, "cut");
        assert_eq!(string_of(&bytes, 4), None, "not there");
        assert_eq!(string_of(&[], 1), None);
    }
}
