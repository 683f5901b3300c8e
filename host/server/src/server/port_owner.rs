//! Process that has a port, for the line that refuses it to another.

/// Returns the process that has a port of this computer, as far as this user may see it: its own
/// processes, and root all.
#[cfg(target_os = "linux")]
pub(super) fn port_owner(port: u16) -> Option<u32> {
    let tables = ["tcp", "tcp6", "udp", "udp6"]
        .map(|table| std::fs::read_to_string(format!("/proc/net/{table}")));
    let sockets: Vec<String> = tables
        .iter()
        .flatten()
        .flat_map(|table| sockets(table, port))
        .collect();
    let processes = std::fs::read_dir("/proc").ok()?.flatten();
    processes
        .filter_map(|entry| entry.file_name().to_str()?.parse().ok())
        .find(|process| has_any(*process, &sockets))
}

#[cfg(not(target_os = "linux"))]
pub(super) const fn port_owner(_: u16) -> Option<u32> {
    None
}

/// Returns the sockets of a table of Linux with this local port and no peer, as their files are
/// named.
#[cfg(target_os = "linux")]
fn sockets(table: &str, port: u16) -> Vec<String> {
    let local = format!(":{port:04X}");
    let lines = table.lines().skip(1);
    lines.filter_map(|line| socket(line, &local)).collect()
}

/// Returns the socket of a line, if it has this local address and no peer.
#[cfg(target_os = "linux")]
fn socket(line: &str, local: &str) -> Option<String> {
    let mut fields = line.split_whitespace().skip(1);
    let is_bound = fields.next()?.ends_with(local) && fields.next()?.ends_with(":0000");
    let inode = fields.nth(6)?;
    is_bound.then(|| format!("socket:[{inode}]"))
}

/// True if a process has one of these sockets open.
#[cfg(target_os = "linux")]
fn has_any(process: u32, sockets: &[String]) -> bool {
    let files = std::fs::read_dir(format!("/proc/{process}/fd"))
        .into_iter()
        .flatten()
        .flatten();
    let targets = files.filter_map(|file| std::fs::read_link(file.path()).ok());
    targets.into_iter().any(|target| {
        sockets
            .iter()
            .any(|socket| target.as_os_str() == socket.as_str())
    })
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn the_owner_of_a_port_is_found() {
        let stream = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let datagram = std::net::UdpSocket::bind("[::1]:0")
            .or_else(|_| std::net::UdpSocket::bind("127.0.0.1:0"))
            .unwrap();
        let ports = [
            stream.local_addr().unwrap().port(),
            datagram.local_addr().unwrap().port(),
        ];
        assert_eq!(ports.map(port_owner), [Some(std::process::id()); 2]);
        drop(stream);
        assert_eq!(port_owner(ports[0]), None);
    }
}
