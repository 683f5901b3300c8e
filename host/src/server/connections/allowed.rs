//! Peers that a server answers.

use std::net::IpAddr;
use std::str::FromStr;

use ipnet::IpNet;

/// Networks whose peers are answered. Other peers are closed, or their datagrams dropped, silently.
///
/// This is not authentication: addresses can be forged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Allowed(Vec<IpNet>);

impl Allowed {
    /// Allows every peer.
    #[must_use]
    pub const fn all() -> Self {
        Self(Vec::new())
    }

    /// Allows peers of these networks only; an empty list allows every peer.
    ///
    /// # Errors
    /// A sentence that names the first text that is neither an address nor a network.
    pub fn only(networks: &[String]) -> Result<Self, String> {
        let network = |text: &String| {
            IpNet::from_str(text)
                .or_else(|_| IpAddr::from_str(text).map(IpNet::from))
                .map_err(|_| format!("{text:?} is neither an address (192.168.1.5) nor a network (192.168.1.0/24)"))
        };
        networks.iter().map(network).collect::<Result<_, _>>().map(Self)
    }

    /// True if a peer is answered. IPv4 inside IPv6 counts as IPv4.
    #[must_use]
    pub fn admits(&self, peer: IpAddr) -> bool {
        let peer = peer.to_canonical();
        self.0.is_empty() || self.0.iter().any(|network| network.contains(&peer))
    }

    /// True if not every peer is answered.
    #[must_use]
    pub fn restricts(&self) -> bool {
        !self.0.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn allowed(networks: &[&str]) -> Result<Allowed, String> {
        let networks: Vec<String> = networks.iter().map(ToString::to_string).collect();
        Allowed::only(&networks)
    }

    #[test]
    fn admits_its_networks_only() {
        let some = allowed(&["192.168.1.0/24", "10.0.0.7", "fd00::/8"]).unwrap();
        let admits = |peer: &str| some.admits(peer.parse().unwrap());
        for peer in ["192.168.1.200", "10.0.0.7", "fd12::1", "::ffff:10.0.0.7"] {
            assert!(admits(peer), "{peer}");
        }
        for peer in ["192.168.2.1", "10.0.0.8", "fe80::1", "127.0.0.1", "::1"] {
            assert!(!admits(peer), "{peer}");
        }
        assert!(allowed(&[]).unwrap().admits("8.8.8.8".parse().unwrap()));
    }

    #[test]
    fn a_bad_network_is_named() {
        for bad in ["", "here", "192.168.1.0/33", "192.168.1", "1.2.3.4:7000"] {
            let error = allowed(&["10.0.0.1", bad]).unwrap_err();
            assert!(error.contains(bad), "{error}");
        }
    }
}
