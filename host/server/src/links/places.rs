//! Places of a port that are all taken: the one that is given to a newcomer.

use std::net::IpAddr;

/// Connection that holds a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Holder {
    /// Address of the peer.
    pub peer: IpAddr,
    /// Number of the connection: later ones have higher numbers.
    pub number: u64,
}

/// Returns the connection that gives its place to a newcomer: the youngest of the address with the
/// most places, if that address still has at least as many as the newcomer's then. So the places
/// are shared among addresses, an address with one place keeps it, and who comes again and again
/// displaces neither those of other addresses beyond that nor those that came before.
pub fn gives_way(
    holders: impl Iterator<Item = Holder> + Clone,
    newcomer: IpAddr,
) -> Option<Holder> {
    let lavish = holders
        .clone()
        .max_by_key(|holder| (places(holders.clone(), holder.peer), holder.number))?;
    let own = places(holders.clone(), newcomer);
    (places(holders, lavish.peer) > own.saturating_add(1)).then_some(lavish)
}

/// Number of places of an address.
fn places(holders: impl Iterator<Item = Holder>, peer: IpAddr) -> usize {
    holders.filter(|holder| holder.peer == peer).count()
}

/// Returns the connection of the newcomer's own address that gives its place to it, the youngest,
/// if no address has more places.
pub fn gives_way_at_home(
    holders: impl Iterator<Item = Holder> + Clone,
    newcomer: IpAddr,
) -> Option<Holder> {
    holders
        .filter(|holder| holder.peer == newcomer)
        .max_by_key(|holder| holder.number)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(host: u8) -> IpAddr {
        [10, 0, 0, host].into()
    }

    /// Hosts in the order of their coming.
    fn holders(hosts: &[u8]) -> Vec<Holder> {
        (0..)
            .zip(hosts)
            .map(|(number, host)| Holder {
                peer: at(*host),
                number,
            })
            .collect()
    }

    /// Number of the connection that gives way.
    fn given(hosts: &[u8], newcomer: u8) -> Option<u64> {
        gives_way(holders(hosts).iter().copied(), at(newcomer)).map(|holder| holder.number)
    }

    #[test]
    fn an_address_with_many_places_gives_its_youngest_to_one_with_fewer() {
        assert_eq!(given(&[1, 1, 1, 1], 2), Some(3));
        assert_eq!(given(&[1, 2, 1, 1], 2), Some(3));
        assert_eq!(given(&[1, 1, 2, 2], 2), None, "as many as the others");
        assert_eq!(given(&[1, 1, 2, 2], 1), None);
        assert_eq!(given(&[1, 2, 3, 4], 5), None, "one place each");
        assert_eq!(given(&[1, 1, 1, 1], 1), None, "its own");
        assert_eq!(given(&[1, 1, 2, 3], 4), Some(1));
    }

    /// However often an address comes, the others keep their share, and what they held first.
    #[test]
    fn who_comes_again_and_again_displaces_no_other_beyond_its_share() {
        let mut held = holders(&[1, 1, 1, 2]);
        for number in 4..1_000 {
            let Some(given) = gives_way(held.iter().copied(), at(3)) else {
                continue;
            };
            held.retain(|holder| *holder != given);
            held.push(Holder {
                peer: at(3),
                number,
            });
        }
        let hosts: Vec<u64> = held
            .iter()
            .filter(|holder| holder.peer != at(3))
            .map(|holder| holder.number)
            .collect();
        assert_eq!(hosts, [0, 1, 3]);
    }

    #[test]
    fn at_home_the_youngest_gives_way() {
        let given = gives_way_at_home(holders(&[1, 2, 1, 2]).into_iter(), at(1));
        assert_eq!(given.map(|holder| holder.number), Some(2));
        assert_eq!(gives_way_at_home(holders(&[1, 2]).into_iter(), at(3)), None);
    }
}
