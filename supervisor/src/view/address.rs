//! Address of the live view: on this machine alone, unless the user permits others.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

/// Default address: this machine alone, at any free port, so that concurrent runs do not conflict.
pub const DEFAULT_ADDRESS: &str = "127.0.0.1:0";

/// Parses an address of the command line, such as `8080`, `127.0.0.1`, `localhost:8080` or `[::1]:8080`.
/// Port 0, or none, means any free port.
pub fn parse_address(text: &str) -> Result<SocketAddr, String> {
    let loopback = IpAddr::V4(Ipv4Addr::LOCALHOST);
    if let Ok(port) = text.parse::<u16>() {
        return Ok(SocketAddr::new(loopback, port));
    }
    if let Ok(ip) = text.parse::<IpAddr>() {
        return Ok(SocketAddr::new(ip, 0));
    }
    let port_of_localhost = match text.strip_prefix("localhost") {
        Some("") => Some(0),
        Some(rest) => rest.strip_prefix(':').and_then(|port| port.parse().ok()),
        None => None,
    };
    match port_of_localhost {
        Some(port) => Ok(SocketAddr::new(loopback, port)),
        None => text.parse().map_err(|_| {
            "must be a port or ADDRESS:PORT, such as 8080, 127.0.0.1:8080 or [::1]:8080".into()
        }),
    }
}

/// Returns the address for a browser to connect to a server that listens at `listen_address`.
pub(crate) fn reachable_address(listen_address: SocketAddr) -> SocketAddr {
    let ip = match listen_address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(ip) if ip.is_unspecified() => Ipv6Addr::LOCALHOST.into(),
        ip => ip,
    };
    SocketAddr::new(ip, listen_address.port())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn view_address_is_a_port_an_address_or_both() {
        for (text, expected) in [
            ("0", "127.0.0.1:0"),
            ("8080", "127.0.0.1:8080"),
            ("127.0.0.1:80", "127.0.0.1:80"),
            ("localhost", "127.0.0.1:0"),
            ("localhost:81", "127.0.0.1:81"),
            ("192.168.1.2", "192.168.1.2:0"),
            ("::1", "[::1]:0"),
            ("[::1]:82", "[::1]:82"),
            (DEFAULT_ADDRESS, "127.0.0.1:0"),
        ] {
            assert_eq!(parse_address(text), Ok(expected.parse().unwrap()), "{text}");
        }
        for text in ["", "localhosts", "localhost:", "70000", "example.org:80", "127.0.0.1:x"] {
            assert!(parse_address(text).unwrap_err().contains("such as 8080"), "{text}");
        }
    }

    #[test]
    fn wildcard_address_is_reachable_on_this_machine() {
        for (listen_address, url) in [
            ("0.0.0.0:80", "127.0.0.1:80"),
            ("[::]:80", "[::1]:80"),
            ("10.0.0.1:80", "10.0.0.1:80"),
        ] {
            assert_eq!(reachable_address(listen_address.parse().unwrap()).to_string(), url);
        }
    }
}
