//! The page: one document of our own, without access to anything but the monitor.

use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher, Hasher};

const DOCUMENT: &str = include_str!("page.html");
const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = concat!(
    include_str!("machine.js"),
    include_str!("plot.js"),
    include_str!("page.js")
);

/// Header fields of every answer: nothing is stored, guessed, framed, or read by other sites.
pub(super) const FIELDS: &str = "Connection: close\r\nCache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\n\
    X-Frame-Options: DENY\r\nReferrer-Policy: no-referrer\r\nCross-Origin-Resource-Policy: same-origin\r\n\
    Cross-Origin-Opener-Policy: same-origin\r\n";

/// Returns the policy of the page, a header field, and the page. Only script and style with the
/// answer's nonce are run, and only the monitor is connected to.
pub(super) fn page() -> (String, String) {
    let nonce = nonce();
    let policy = format!(
        "Content-Security-Policy: default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src data:; \
         connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n"
    );
    let document = DOCUMENT
        .replace("NONCE", &nonce)
        .replace("STYLE", STYLE)
        .replace("SCRIPT", SCRIPT);
    (policy, document)
}

/// Word that another site cannot know: the standard library keys this hash by the system's random
/// numbers.
fn nonce() -> String {
    let [first, second] = [(); 2].map(|()| RandomState::new().build_hasher().finish());
    format!("{first:016x}{second:016x}")
}
