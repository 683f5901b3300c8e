//! Contents of the SII EEPROM of a device; ETG1000.6 and ETG2010.

/// Layout of mailboxes and process data, as the EEPROM offers it and the state machine demands it.
pub(super) const MAILBOX_OUT: (u16, u16) = (0x1000, 128);
pub(super) const MAILBOX_IN: (u16, u16) = (0x1080, 128);
pub(super) const OUTPUTS: u16 = 0x1100;
pub(super) const INPUTS: u16 = 0x1400;
/// Control bytes of the four sync managers: mailboxes; outputs with the watchdog's trigger; inputs.
pub(super) const CONTROL: [u8; 4] = [0x26, 0x22, 0x64, 0x20];

/// Vendor, product, revision and serial number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Vendor.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
    /// Revision.
    pub revision: u32,
    /// Serial number.
    pub serial: u32,
}

/// Mailbox protocol CoE, as bits of the EEPROM.
pub const COE: u16 = 0x0004;
/// Mailbox protocol SoE, as bits of the EEPROM.
pub const SOE: u16 = 0x0010;

/// Contents of an EEPROM.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sii {
    /// Vendor, product, revision and serial number.
    pub identity: Identity,
    /// Alias.
    pub alias: u16,
    /// Name.
    pub name: &'static str,
    /// Bits of the mailbox protocols; 0 without a mailbox.
    pub protocols: u16,
    /// The device has outputs and inputs.
    pub has_process_data: bool,
    /// Sync manager 2 triggers the watchdog.
    pub has_watchdog: bool,
}

/// Returns the EEPROM with these contents.
pub(super) fn eeprom(sii: &Sii) -> Vec<u8> {
    let Sii {
        identity,
        alias,
        name,
        ..
    } = *sii;
    let mut words = [0_u16; 0x40];
    put(&mut words, 0x00, &[0x0080, 0x0E00, 0, 0, alias]);
    for (at, value) in [
        (0x08, identity.vendor),
        (0x0A, identity.product),
        (0x0C, identity.revision),
        (0x0E, identity.serial),
    ] {
        put(&mut words, at, &[value as u16, (value >> 16) as u16]);
    }
    // Standard mailboxes.
    let has_mailbox = sii.protocols != 0;
    if has_mailbox {
        let (out, back) = (MAILBOX_OUT, MAILBOX_IN);
        put(
            &mut words,
            0x18,
            &[out.0, out.1, back.0, back.1, sii.protocols],
        );
    }
    // 2 KiB less one kilobit; version.
    put(&mut words, 0x3E, &[0x000F, 1]);
    let mut bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    let checksum = checksum(bytes.get(..14).unwrap_or(&[]));
    if let Some(place) = bytes.get_mut(14) {
        *place = checksum;
    }
    let mut strings = vec![1, name.len() as u8];
    strings.extend(name.bytes());
    category(&mut bytes, 10, &strings);
    let mut general = [0_u8; 32];
    // Strings of group, image, order and name; SDO, PDO assignment and PDO configuration.
    let of_coe = if sii.protocols & COE == 0 { 0 } else { 0x0D };
    general[..6].copy_from_slice(&[1, 0, 1, 1, 0, of_coe]);
    category(&mut bytes, 30, &general);
    if sii.has_process_data {
        // Outputs, inputs, state of the mailbox, and none.
        category(&mut bytes, 40, &[1, 2, 3, 0]);
    }
    if has_mailbox {
        category(&mut bytes, 41, &sync_managers(sii));
    }
    bytes.extend([0xFF; 4]);
    bytes
}

/// Category of the sync managers.
fn sync_managers(sii: &Sii) -> Vec<u8> {
    let outputs_control = if sii.has_watchdog {
        CONTROL[2]
    } else {
        CONTROL[2] & !0x40
    };
    let sync_managers: [(u16, u16, u8, u8); 4] = [
        (MAILBOX_OUT.0, MAILBOX_OUT.1, CONTROL[0], 1),
        (MAILBOX_IN.0, MAILBOX_IN.1, CONTROL[1], 2),
        (OUTPUTS, 0, outputs_control, 3),
        (INPUTS, 0, CONTROL[3], 4),
    ];
    let mut managers = Vec::new();
    let used = if sii.has_process_data { 4 } else { 2 };
    for (start, length, control, usage) in sync_managers.into_iter().take(used) {
        managers.extend(start.to_le_bytes());
        managers.extend(length.to_le_bytes());
        managers.extend([control, 0, 1, usage]);
    }
    managers
}

/// Writes words from a place on.
fn put(words: &mut [u16], at: usize, values: &[u16]) {
    for (place, value) in words.iter_mut().skip(at).zip(values) {
        *place = *value;
    }
}

/// Appends a category, filled up to whole words.
fn category(bytes: &mut Vec<u8>, kind: u16, content: &[u8]) {
    let words = content.len().div_ceil(2);
    bytes.extend(kind.to_le_bytes());
    bytes.extend((words as u16).to_le_bytes());
    bytes.extend(content);
    bytes.resize(bytes.len() + words * 2 - content.len(), 0);
}

/// CRC-8 of the configuration area, polynomial 07h, start FFh.
fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0xFF, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc, _| {
            if crc & 0x80 != 0 {
                crc << 1 ^ 0x07
            } else {
                crc << 1
            }
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_the_specification() {
        // The check value of the algorithm, CRC-8 with start FFh, over the usual nine digits.
        assert_eq!(checksum(b"123456789"), 0xFB);
    }

    #[test]
    fn categories_follow_each_other_to_the_end() {
        let identity = Identity {
            vendor: 1,
            product: 2,
            revision: 3,
            serial: 4,
        };
        let sii = Sii {
            identity,
            alias: 0x1234,
            name: "drive",
            protocols: COE,
            has_process_data: true,
            has_watchdog: true,
        };
        let bytes = eeprom(&sii);
        let words: Vec<u16> = bytes
            .chunks_exact(2)
            .map(|word| u16::from_le_bytes([word[0], word[1]]))
            .collect();
        assert_eq!(
            [words[4], words[8], words[10], words[0x1C]],
            [0x1234, 1, 2, 4]
        );
        let (mut at, mut kinds) = (0x40, Vec::new());
        while words[at] != 0xFFFF {
            kinds.push(words[at]);
            at += 2 + usize::from(words[at + 1]);
        }
        assert_eq!(kinds, [10, 30, 40, 41]);
    }
}
