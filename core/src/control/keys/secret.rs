//! The text of a key file.
//!
//! ```text
//! gantry-tau-key 1
//! role control
//! secret 000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f
//! ```

use core::fmt;

use super::{Key, Role};

/// A shared secret, and what its holder may do. `Debug` shows the name of the key.
#[derive(Clone, PartialEq, Eq)]
pub struct Secret {
    /// Rights of its holder.
    pub role: Role,
    /// 32 random bytes.
    pub bytes: [u8; 32],
}

/// Error of [`Secret::parse`]: the number of a line, from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum KeyTextError {
    /// The first line names another format.
    Format,
    /// The second line names no role.
    Role,
    /// The third line has no secret of 64 digits.
    Secret,
    /// Something follows.
    End,
}

impl fmt::Display for KeyTextError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Format => "line 1: expected gantry-tau-key 1",
            Self::Role => "line 2: expected role control, or role read",
            Self::Secret => {
                "line 3: expected secret, a space and 64 hexadecimal digits in lower case"
            }
            Self::End => "line 4: expected the end of the file",
        })
    }
}

impl core::error::Error for KeyTextError {}

impl Secret {
    /// Parses the text of a key file. Lines end with LF or CRLF, the last one also with the text.
    ///
    /// # Errors
    /// [`KeyTextError`]: the first line that is wrong.
    pub fn parse(text: &[u8]) -> Result<Self, KeyTextError> {
        let mut rest = Some(text);
        if line(&mut rest) != Some(b"gantry-tau-key 1") {
            return Err(KeyTextError::Format);
        }
        let role = match line(&mut rest) {
            Some(b"role control") => Role::Control,
            Some(b"role read") => Role::Read,
            _ => return Err(KeyTextError::Role),
        };
        let bytes = line(&mut rest)
            .and_then(|line| line.strip_prefix(b"secret "))
            .and_then(digits)
            .ok_or(KeyTextError::Secret)?;
        match rest {
            None | Some([]) => Ok(Self { role, bytes }),
            Some(_) => Err(KeyTextError::End),
        }
    }

    /// Returns the key.
    #[must_use]
    pub fn key(&self) -> Key {
        Key::new(&self.bytes, self.role)
    }
}

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Secret({:?})", self.key())
    }
}

/// Takes a line off the front, without its end.
fn line<'a>(rest: &mut Option<&'a [u8]>) -> Option<&'a [u8]> {
    let text = rest.take()?;
    let mut parts = text.splitn(2, |byte| *byte == b'\n');
    let line = parts.next()?;
    *rest = parts.next();
    Some(line.strip_suffix(b"\r").unwrap_or(line))
}

/// Reads 64 hexadecimal digits in lower case.
fn digits(text: &[u8]) -> Option<[u8; 32]> {
    let mut bytes = [0; 32];
    let mut digits = text.iter();
    for byte in &mut bytes {
        let [high, low] = [digit(*digits.next()?)?, digit(*digits.next()?)?];
        *byte = high << 4 | low;
    }
    digits.next().is_none().then_some(bytes)
}

/// Reads a hexadecimal digit in lower case.
const fn digit(byte: u8) -> Option<u8> {
    match byte {
        b'0'..=b'9' => byte.checked_sub(b'0'),
        b'a'..=b'f' => byte.wrapping_sub(b'a').checked_add(10),
        _ => None,
    }
}
