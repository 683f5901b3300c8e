//! Contents of the SII EEPROM of a drive; ETG1000.6 and ETG2010.

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

/// Returns the EEPROM of a drive.
pub(super) fn eeprom(identity: &Identity, alias: u16, name: &str, has_watchdog: bool) -> Vec<u8> {
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
    // Standard mailboxes, and CoE as the only protocol.
    put(
        &mut words,
        0x18,
        &[
            MAILBOX_OUT.0,
            MAILBOX_OUT.1,
            MAILBOX_IN.0,
            MAILBOX_IN.1,
            0x0004,
        ],
    );
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
    general[..6].copy_from_slice(&[1, 0, 1, 1, 0, 0x0D]);
    category(&mut bytes, 30, &general);
    // Outputs, inputs, state of the mailbox, and none.
    category(&mut bytes, 40, &[1, 2, 3, 0]);
    let outputs_control = if has_watchdog {
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
    for (start, length, control, usage) in sync_managers {
        managers.extend(start.to_le_bytes());
        managers.extend(length.to_le_bytes());
        managers.extend([control, 0, 1, usage]);
    }
    category(&mut bytes, 41, &managers);
    bytes.extend([0xFF; 4]);
    bytes
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
        let bytes = eeprom(&identity, 0x1234, "drive", true);
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
