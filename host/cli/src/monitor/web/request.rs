//! Heads of requests: what is asked for, and what is refused.

use std::net::SocketAddr;

/// Longest head, bytes.
pub(super) const MAX_HEAD: usize = 8_192;
/// Largest number of header fields.
const MAX_FIELDS: usize = 64;

/// Requested resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Resource {
    /// The page.
    Page,
    /// Pictures, as server-sent events.
    Live,
    /// The object of `monitor --status`.
    Status,
}

/// Refusal of a request: status line, and the reason for people.
pub(super) type Refusal = (&'static str, &'static str);

/// Checks the head of a request that came in on `local`; `None` if it is not complete.
///
/// Its `Host` must be that address or `localhost`: a page of another site whose name was made to
/// point here (DNS rebinding) has its own name in it. An `Origin`, which browsers send with
/// requests of scripts, must be the page itself.
///
/// # Errors
/// The refusal to answer with.
pub(super) fn resource(head: &[u8], local: SocketAddr) -> Result<Option<Resource>, Refusal> {
    let mut fields = [httparse::EMPTY_HEADER; MAX_FIELDS];
    let mut request = httparse::Request::new(&mut fields);
    match request.parse(head) {
        Ok(httparse::Status::Complete(_)) => {}
        Ok(httparse::Status::Partial) if head.len() < MAX_HEAD => return Ok(None),
        Ok(httparse::Status::Partial) | Err(httparse::Error::TooManyHeaders) => {
            return Err((
                "431 Request Header Fields Too Large",
                "the head of the request is too long",
            ));
        }
        Err(_) => return Err(("400 Bad Request", "this is not a request of HTTP/1")),
    }
    let mut hosts = values(&request, "Host");
    if !matches!((hosts.next(), hosts.next()), (Some(host), None) if is_own(host, local)) {
        return Err((
            "421 Misdirected Request",
            "the Host of the request is not the address of this monitor",
        ));
    }
    if !values(&request, "Origin").all(|origin| {
        origin
            .strip_prefix(b"http://")
            .is_some_and(|host| is_own(host, local))
    }) {
        return Err((
            "403 Forbidden",
            "only the monitor's own page may read from it",
        ));
    }
    if request.method != Some("GET") {
        return Err((
            "405 Method Not Allowed",
            "a monitor is read: only GET is possible",
        ));
    }
    if values(&request, "Transfer-Encoding").next().is_some()
        || values(&request, "Content-Length").any(|length| length != b"0")
    {
        return Err((
            "400 Bad Request",
            "a monitor is read: a request has no body",
        ));
    }
    match request.path {
        Some("/") => Ok(Some(Resource::Page)),
        Some("/live") => Ok(Some(Resource::Live)),
        Some("/status") => Ok(Some(Resource::Status)),
        _ => Err(("404 Not Found", "a monitor has /, /live and /status")),
    }
}

/// Values of all header fields of a name.
fn values<'r>(
    request: &'r httparse::Request<'_, '_>,
    name: &'static str,
) -> impl Iterator<Item = &'r [u8]> {
    let fields = request.headers.iter();
    fields
        .filter(move |field| field.name.eq_ignore_ascii_case(name))
        .map(|field| field.value)
}

/// True for the address on which a request came in, and for `localhost`, with the port.
fn is_own(host: &[u8], local: SocketAddr) -> bool {
    let Ok(host) = std::str::from_utf8(host) else {
        return false;
    };
    let port = local.port();
    let (name, given) = match host.rsplit_once(':') {
        // `[::1]` without a port ends in a bracket.
        Some((name, digits)) if !digits.ends_with(']') => (name, digits),
        _ => (host, "80"),
    };
    let address = SocketAddr::new(local.ip().to_canonical(), port).to_string();
    let own = address.rsplit_once(':').map_or("", |(own, _)| own);
    // As text, in the one form that a browser sends: a number may have a sign and zeros.
    given == port.to_string()
        && (name.eq_ignore_ascii_case("localhost") || name.eq_ignore_ascii_case(own))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(head: &str, local: &str) -> Result<Option<Resource>, Refusal> {
        resource(head.as_bytes(), local.parse().unwrap())
    }

    #[test]
    fn the_own_address_and_localhost_are_answered_and_no_other_host() {
        let own = [
            ("127.0.0.1:8080", "127.0.0.1:8080"),
            ("localhost:8080", "127.0.0.1:8080"),
            ("LOCALHOST:8080", "127.0.0.1:8080"),
            ("[::1]:8080", "[::1]:8080"),
            ("192.168.1.5:8080", "[::ffff:192.168.1.5]:8080"),
            ("127.0.0.1", "127.0.0.1:80"),
            ("[::1]", "[::1]:80"),
        ];
        for (host, local) in own {
            let head = format!("GET / HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n\r\n");
            assert_eq!(asked(&head, local), Ok(Some(Resource::Page)), "{host}");
        }
        let others = [
            "evil.example:8080",
            "127.0.0.1:8081",
            "127.0.0.1",
            "localhost",
            "127.0.0.1.evil.example:8080",
            "[::1]:8080",
            "127.0.0.1:8080:8080",
            "localhost:",
            "",
            "[",
            ":",
            "127.0.0.2:8080",
            "evil@localhost:8080",
            "0.0.0.0:8080",
            "localhost:+8080",
            "localhost:08080",
        ];
        for host in others {
            let head = format!("GET / HTTP/1.1\r\nHost: {host}\r\n\r\n");
            assert_eq!(
                asked(&head, "127.0.0.1:8080").unwrap_err().0,
                "421 Misdirected Request",
                "{host}"
            );
            let head = format!(
                "GET /live HTTP/1.1\r\nHost: 127.0.0.1:8080\r\nOrigin: http://{host}\r\n\r\n"
            );
            assert_eq!(
                asked(&head, "127.0.0.1:8080").unwrap_err().0,
                "403 Forbidden",
                "{host}"
            );
        }
        for origin in [
            "null",
            "https://127.0.0.1:8080",
            "file://",
            "http://127.0.0.1:8080/",
        ] {
            let head =
                format!("GET /live HTTP/1.1\r\nHost: 127.0.0.1:8080\r\nOrigin: {origin}\r\n\r\n");
            assert_eq!(
                asked(&head, "127.0.0.1:8080").unwrap_err().0,
                "403 Forbidden",
                "{origin}"
            );
        }
    }

    /// Every cut of a request is incomplete, and every changed byte is an answer or a refusal.
    #[test]
    fn cut_and_changed_heads_are_never_taken_for_another() {
        let head = "GET /status HTTP/1.1\r\nHost: localhost:8080\r\nAccept: */*\r\n\r\n";
        for cut in 0..head.len() {
            assert_eq!(asked(&head[..cut], "127.0.0.1:8080"), Ok(None), "{cut}");
        }
        for place in 0..head.len() {
            for byte in 0..=255 {
                let mut bytes = head.as_bytes().to_vec();
                bytes[place] = byte;
                let asked = resource(&bytes, "127.0.0.1:8080".parse().unwrap());
                assert!(
                    !matches!(asked, Ok(Some(Resource::Page | Resource::Live))),
                    "{place} {byte}"
                );
            }
        }
    }
}
