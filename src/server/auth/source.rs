//! Where a request comes from, whatever its headers claim.
//!
//! Takes the connection's address, the proxies that the configuration trusts and the values of
//! `X-Forwarded-For` and `Forwarded`; gives the client's address. Headers count only from a trusted
//! proxy, and of them only what the proxies themselves have added, from the right. Knows no HTTP.
//!
//! Source: RFC 7239 (`Forwarded`).
use std::net::{IpAddr, Ipv6Addr, SocketAddr};

/// Hops that are looked at; a longer way is a forgery or a loop.
const MAX_HOPS: usize = 16;

/// Longest header that is looked at, bytes.
const MAX_BYTES: usize = 4096;

/// One who is counted as one: an IPv4 address, or a network of IPv6 addresses, /64, as everybody
/// has at least so many.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Source(IpAddr);

impl From<IpAddr> for Source {
    fn from(address: IpAddr) -> Self {
        Self(match address.to_canonical() {
            IpAddr::V6(v6) => IpAddr::V6(Ipv6Addr::from_bits(v6.to_bits() & !u128::from(u64::MAX))),
            v4 => v4,
        })
    }
}

/// The client's address. Header values come in the order of the message.
///
/// Where both headers are given they must agree: a proxy adds to one of them and hands the other on
/// as the client wrote it. What is malformed, disagrees or names trusted proxies only, gives the
/// peer itself.
pub(crate) fn client(
    peer: IpAddr,
    trusted: &[IpAddr],
    x_forwarded_for: &[&str],
    forwarded: &[&str],
) -> IpAddr {
    let peer = peer.to_canonical();
    if !is_trusted(peer, trusted) {
        return peer;
    }
    let plain =
        (!x_forwarded_for.is_empty()).then(|| first_untrusted(x_forwarded_for, trusted, false, address));
    let named = (!forwarded.is_empty()).then(|| first_untrusted(forwarded, trusted, true, for_parameter));
    match (plain, named) {
        (Some(Some(a)), Some(Some(b))) if a == b => a,
        (Some(Some(a)), None) | (None, Some(Some(a))) => a,
        _ => peer,
    }
}

fn is_trusted(address: IpAddr, trusted: &[IpAddr]) -> bool {
    trusted.iter().any(|proxy| proxy.to_canonical() == address)
}

/// The right-most address that is no trusted proxy's. What stands left of it, anybody may have
/// written; it is not even read.
fn first_untrusted(
    values: &[&str],
    trusted: &[IpAddr],
    quotes: bool,
    read: impl Fn(&str) -> Option<IpAddr>,
) -> Option<IpAddr> {
    if values.iter().map(|value| value.len()).sum::<usize>() > MAX_BYTES {
        return None;
    }
    let elements: Vec<_> = values.iter().flat_map(|value| split(value, ',', quotes)).collect();
    for element in elements.iter().rev().take(MAX_HOPS) {
        let address = read(element)?;
        if !is_trusted(address, trusted) {
            return Some(address);
        }
    }
    None
}

/// Splits at a character; where quotes are known, not within them.
fn split(text: &str, at: char, quotes: bool) -> Vec<&str> {
    let mut quoted = false;
    let mut escaped = false;
    text.split(move |c| {
        match (c, quoted, escaped) {
            (_, true, true) => escaped = false,
            ('\\', true, false) => escaped = true,
            ('"', ..) if quotes => quoted = !quoted,
            _ => return c == at && !quoted,
        }
        false
    })
    .collect()
}

/// `1.2.3.4`, `1.2.3.4:80`, `2001:db8::1`, `[2001:db8::1]`, `[2001:db8::1]:80`.
fn address(text: &str) -> Option<IpAddr> {
    let text = text.trim();
    let bare = text.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
    let found = match bare {
        Some(inner) => inner.parse::<Ipv6Addr>().ok().map(IpAddr::V6),
        None => text.parse().ok().or_else(|| text.parse::<SocketAddr>().ok().map(|socket| socket.ip())),
    };
    found.map(|ip| ip.to_canonical())
}

/// The `for` of an element such as `for="[2001:db8::1]:4711";proto=https`. Names instead of
/// addresses (`unknown`, `_hidden`) tell nothing.
fn for_parameter(element: &str) -> Option<IpAddr> {
    let mut found = None;
    for pair in split(element, ';', true) {
        let (name, value) = pair.split_once('=')?;
        if !name.trim().eq_ignore_ascii_case("for") {
            continue;
        }
        let value = value.trim();
        let inner = match value.strip_prefix('"') {
            Some(rest) => rest.strip_suffix('"')?,
            None => value,
        };
        // Twice is not once: which one the proxy wrote nobody knows.
        if found.replace(address(inner)?).is_some() {
            return None;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ip(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    /// The proxies 10.0.0.1, 10.0.0.2 and ::1 are trusted.
    fn check(peer: &str, plain: &[&str], named: &[&str], expect: &str) {
        let trusted = ["10.0.0.1", "10.0.0.2", "::1"].map(ip);
        assert_eq!(client(ip(peer), &trusted, plain, named), ip(expect), "{peer} {plain:?} {named:?}");
    }

    #[test]
    fn nobody_but_a_trusted_proxy_is_believed() {
        check("192.0.2.9", &[], &[], "192.0.2.9");
        check("192.0.2.9", &["127.0.0.1"], &["for=127.0.0.1"], "192.0.2.9");
        check("::ffff:192.0.2.9", &["127.0.0.1"], &[], "192.0.2.9");
        check("127.0.0.1", &["192.0.2.1"], &[], "127.0.0.1");
        assert_eq!(client(ip("127.0.0.1"), &[], &["192.0.2.1"], &[]), ip("127.0.0.1"));
    }

    #[test]
    fn the_rightmost_untrusted_address_counts() {
        check("10.0.0.1", &["192.0.2.9"], &[], "192.0.2.9");
        check("::ffff:10.0.0.1", &["192.0.2.9"], &[], "192.0.2.9");
        check("::1", &["192.0.2.9"], &[], "192.0.2.9");
        check("10.0.0.1", &["127.0.0.1, 192.0.2.9"], &[], "192.0.2.9");
        check("10.0.0.1", &["127.0.0.1", "192.0.2.9"], &[], "192.0.2.9");
        check("10.0.0.1", &["127.0.0.1, 192.0.2.9 , 10.0.0.2"], &[], "192.0.2.9");
        check("10.0.0.1", &["<script>\", 192.0.2.9"], &[], "192.0.2.9");
        check("10.0.0.1", &["192.0.2.9:4711"], &[], "192.0.2.9");
        check("10.0.0.1", &["::ffff:192.0.2.9"], &[], "192.0.2.9");
        check("10.0.0.1", &["[2001:db8::1]:80"], &[], "2001:db8::1");
        check("10.0.0.1", &["[2001:db8::1]"], &[], "2001:db8::1");
        check("10.0.0.1", &["2001:db8::1"], &[], "2001:db8::1");
    }

    #[test]
    fn the_standard_header_counts_too() {
        check("10.0.0.1", &[], &["for=192.0.2.9"], "192.0.2.9");
        check("10.0.0.1", &[], &["For=\"[2001:db8::1]:4711\";proto=https"], "2001:db8::1");
        check("10.0.0.1", &[], &["for=127.0.0.1, proto=http;by=10.0.0.2;for=192.0.2.9"], "192.0.2.9");
        check("10.0.0.1", &[], &["for=192.0.2.9;host=\"a,for=1.2.3.4;\\\",\", for=10.0.0.2"], "192.0.2.9");
        check("10.0.0.1", &["192.0.2.9"], &["for=192.0.2.9"], "192.0.2.9");
    }

    #[test]
    fn what_is_not_understood_gives_the_peer() {
        for bad in
            ["", " ", ",", "192.0.2.9,", "unknown", "192.0.2.9.1", "[192.0.2.9]", "10.0.0.2", "1.2.3.4 5"]
        {
            check("10.0.0.1", &[bad], &[], "10.0.0.1");
        }
        for bad in [
            "",
            "192.0.2.9",
            "for=unknown",
            "for=_x",
            "for=",
            "for=\"192.0.2.9",
            "by=192.0.2.9",
            "for=1.2.3.4;for=192.0.2.9",
            "for=192.0.2.9;x",
        ] {
            check("10.0.0.1", &[], &[bad], "10.0.0.1");
        }
        // A client behind a proxy that adds to one header forges the other.
        check("10.0.0.1", &["192.0.2.9"], &["for=127.0.0.1"], "10.0.0.1");
        check("10.0.0.1", &["127.0.0.1"], &["for=192.0.2.9"], "10.0.0.1");
        check("10.0.0.1", &["192.0.2.9"], &["for=unknown"], "10.0.0.1");
        check("10.0.0.1", &[&format!("192.0.2.9{}", ", 10.0.0.2".repeat(15))], &[], "192.0.2.9");
        check("10.0.0.1", &[&format!("192.0.2.9{}", ", 10.0.0.2".repeat(16))], &[], "10.0.0.1");
        check("10.0.0.1", &[&format!("{}, 192.0.2.9", "x".repeat(5000))], &[], "10.0.0.1");
    }

    #[test]
    fn an_ipv6_network_is_one_source() {
        let same = |a: &str, b: &str| Source::from(ip(a)) == Source::from(ip(b));
        assert!(same("2001:db8::1", "2001:db8::ffff:ffff:ffff:ffff"));
        assert!(!same("2001:db8::1", "2001:db8:0:1::1"));
        assert!(same("::ffff:192.0.2.9", "192.0.2.9"));
        assert!(!same("192.0.2.8", "192.0.2.9"));
        assert!(!same("::1", "127.0.0.1"));
    }

    proptest::proptest! {
        #[test]
        fn no_header_moves_an_untrusted_peer(plain in ".{0,40}", named in "(for=|[0-9.,;\" \\\\:a-f])*") {
            check("192.0.2.9", &[&plain], &[&named], "192.0.2.9");
            let _ = client(ip("10.0.0.1"), &[ip("10.0.0.1")], &[&plain], &[&named]);
            let _ = client(ip("10.0.0.1"), &[ip("10.0.0.1")], &[], &[&named]);
        }

        #[test]
        fn what_a_client_writes_is_left_of_what_the_proxy_adds(forged in ".{0,40}|[0-9., ]{0,40}") {
            let value = format!("{forged}, 192.0.2.9");
            check("10.0.0.1", &[&value], &[], "192.0.2.9");
        }
    }
}
