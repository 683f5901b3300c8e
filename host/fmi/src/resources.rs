//! Folder of a unit's files, which a master names by a URI.

use std::path::PathBuf;

/// Name of the robot file in the folder.
pub const ROBOT_FILE: &str = "robot.toml";

/// Returns the folder of a URI: `file:///tmp/l2/resources`.
///
/// # Errors
/// A sentence: it is not one of a file, or not one of this computer.
pub fn folder(uri: &str) -> Result<PathBuf, String> {
    let wrong = |reason: &str| format!("resource location {uri:?}: {reason}");
    let rest = uri
        .strip_prefix("file:")
        .ok_or_else(|| wrong("expected a URI that begins with file:"))?;
    let path = match rest.strip_prefix("//") {
        None => rest,
        Some(with_host) => {
            let slash = with_host.find('/').unwrap_or(with_host.len());
            let (host, path) = with_host.split_at(slash);
            if !(host.is_empty() || host.eq_ignore_ascii_case("localhost")) {
                return Err(wrong("expected a folder of this computer"));
            }
            path
        }
    };
    let path = decoded(path).ok_or_else(|| wrong("expected %XX of UTF-8 only"))?;
    // file:///C:/folder
    let drive = path
        .strip_prefix('/')
        .filter(|rest| cfg!(windows) && rest.chars().nth(1).is_some_and(|second| second == ':'));
    let path = drive.unwrap_or(&path);
    if path.is_empty() {
        return Err(wrong("expected a folder"));
    }
    Ok(PathBuf::from(path))
}

/// Replaces each `%XX` by its byte.
fn decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut parts = text.split('%');
    bytes.extend(parts.next()?.as_bytes());
    for part in parts {
        let (code, rest) = part.split_at_checked(2)?;
        if !code.bytes().all(|digit| digit.is_ascii_hexdigit()) {
            return None;
        }
        bytes.push(u8::from_str_radix(code, 16).ok()?);
        bytes.extend(rest.as_bytes());
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_of_this_computer_are_found() {
        for (uri, path) in [
            ("file:///tmp/a/resources", "/tmp/a/resources"),
            ("file:/tmp/a", "/tmp/a"),
            ("file://localhost/tmp/a", "/tmp/a"),
            ("file:///tmp/gro%C3%9F%20und%20klein", "/tmp/groß und klein"),
        ] {
            assert_eq!(folder(uri), Ok(PathBuf::from(path)), "{uri}");
        }
    }

    #[test]
    fn other_uris_are_refused() {
        for uri in [
            "",
            "/tmp/a",
            "http://example.org/a",
            "file:",
            "file://other/tmp",
            "file:///%",
            "file:///%4",
            "file:///%+1",
            "file:///%ff",
        ] {
            let refused = folder(uri).unwrap_err();
            assert!(refused.contains(&format!("{uri:?}")), "{refused}");
        }
    }
}
