//! Peers that a server answers.

use std::net::IpAddr;
use std::str::FromStr;

use ipnet::IpNet;

/// A text that is neither an address nor a network.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is neither an address (192.168.1.5) nor a network (192.168.1.0/24)")]
pub struct ParseNetworkError(pub String);

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
    /// The first text that is neither an address nor a network.
    pub fn only(networks: &[String]) -> Result<Self, ParseNetworkError> {
        networks
            .iter()
            .map(|text| network(text))
            .collect::<Result<_, _>>()
            .map(Self)
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

/// Reads an address or a network.
fn network(text: &str) -> Result<IpNet, ParseNetworkError> {
    IpNet::from_str(text)
        .or_else(|_| IpAddr::from_str(text).map(IpNet::from))
        .map_err(|_| ParseNetworkError(text.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn allowed(networks: &[&str]) -> Result<Allowed, ParseNetworkError> {
        let networks: Vec<String> = networks.iter().map(ToString::to_string).collect();
        Allowed::only(&networks)
    }

    #[test]
    fn admits_its_networks_only() {
        let some = allowed(&["192.168.1.0/24", "10.0.0.7", "fd00::/8"]).unwrap();
        for peer in ["192.168.1.200", "10.0.0.7", "fd12::1", "::ffff:10.0.0.7"] {
            assert!(some.admits(peer.parse().unwrap()), "{peer}");
        }
        for peer in ["192.168.2.1", "10.0.0.8", "fe80::1", "127.0.0.1", "::1"] {
            assert!(!some.admits(peer.parse().unwrap()), "{peer}");
        }
        assert!(allowed(&[]).unwrap().admits("8.8.8.8".parse().unwrap()));
    }

    #[test]
    fn a_bad_network_is_named() {
        for bad in ["", "here", "192.168.1.0/33", "192.168.1", "1.2.3.4:7000"] {
            let error = allowed(&["10.0.0.1", bad]).unwrap_err().to_string();
            assert!(error.contains(bad), "{error}");
        }
    }
}
