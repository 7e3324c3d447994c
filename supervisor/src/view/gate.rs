//! Access control: a request must address this machine by its own name or number, and contain the token.
//!
//! A page of another site may make a browser send requests: by a domain name that resolves to this machine
//! (DNS rebinding; the Host header reveals it), or across sites (it does not know the token, and its
//! requests have another origin).

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};

use axum::http::header::{CONTENT_TYPE, HOST, ORIGIN};
use axum::http::{HeaderMap, StatusCode, Uri};

use crate::view::token::Token;

/// Reason for rejecting a request.
pub(crate) type HttpRefusal = (StatusCode, &'static str);

const INVALID_HOST_MESSAGE: &str =
    "the Host header must be an address of this machine or localhost";
const MISSING_TOKEN_MESSAGE: &str = "the request must contain the token of this run: open the address that phalanx printed after \"view:\"";

/// Rules by which requests to the live view are permitted or rejected.
#[derive(Clone, Copy)]
pub(crate) struct AccessPolicy {
    pub(crate) token: Token,
    /// Whether other machines may connect.
    pub(crate) allows_other_machines: bool,
}

impl AccessPolicy {
    /// Checks whether a request is permitted at all.
    pub(crate) fn check_request(&self, uri: &Uri, headers: &HeaderMap) -> Result<(), HttpRefusal> {
        let host = single_header_text(headers, HOST.as_str()).unwrap_or_default();
        if !self.is_trusted_host(host) {
            return Err((StatusCode::FORBIDDEN, INVALID_HOST_MESSAGE));
        }
        let parameters = uri.query().unwrap_or_default().split('&');
        let mut tokens = parameters.filter_map(|parameter| parameter.strip_prefix("token="));
        match tokens.next() {
            Some(text) if self.token.matches(text) => Ok(()),
            _ => Err((StatusCode::FORBIDDEN, MISSING_TOKEN_MESSAGE)),
        }
    }

    /// Returns whether the Host header is a name that no other party can direct at this machine: an IP
    /// address or `localhost`. The port may differ, as with a tunnel.
    fn is_trusted_host(&self, host: &str) -> bool {
        let name = match host.strip_prefix('[') {
            Some(rest) => match rest.split_once(']') {
                Some((name, port)) if port.is_empty() || port.starts_with(':') => name,
                _ => return false,
            },
            None => host.rsplit_once(':').map_or(host, |(name, _)| name),
        };
        let ip = match host.starts_with('[') {
            true => name.parse::<Ipv6Addr>().map(IpAddr::V6),
            false => name.parse::<Ipv4Addr>().map(IpAddr::V4),
        };
        match ip {
            Ok(ip) => ip.is_loopback() || self.allows_other_machines,
            Err(_) => name.eq_ignore_ascii_case("localhost"),
        }
    }
}

/// Checks whether a permitted request may contain orders: a page of another site cannot make a browser send
/// such a request.
pub(crate) fn check_order_headers(headers: &HeaderMap) -> Result<(), HttpRefusal> {
    let content_type = single_header_text(headers, CONTENT_TYPE.as_str()).unwrap_or_default();
    let content_type = content_type.split(';').next().unwrap_or_default().trim();
    if !content_type.eq_ignore_ascii_case("application/json") {
        let reason = "the header Content-Type must be application/json";
        return Err((StatusCode::UNSUPPORTED_MEDIA_TYPE, reason));
    }
    // Browsers always send the origin of an order; other programs need not.
    let host = single_header_text(headers, HOST.as_str()).unwrap_or_default();
    let is_same_origin = |origin: &str| origin.strip_prefix("http://") == Some(host);
    let same_origin = !headers.contains_key(ORIGIN)
        || single_header_text(headers, ORIGIN.as_str()).is_some_and(is_same_origin);
    let same_site = !headers.contains_key("sec-fetch-site")
        || single_header_text(headers, "sec-fetch-site") == Some("same-origin");
    if !(same_origin && same_site) {
        return Err((StatusCode::FORBIDDEN, "requests must come from the page of this run"));
    }
    Ok(())
}

/// Returns the value of a header that occurs once, as text.
fn single_header_text<'h>(headers: &'h HeaderMap, name: &str) -> Option<&'h str> {
    let mut values = headers.get_all(name).iter();
    let value = values.next()?;
    if values.next().is_some() { None } else { value.to_str().ok() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    fn access_policy(open_to_others: bool) -> AccessPolicy {
        AccessPolicy { token: Token::draw().unwrap(), allows_other_machines: open_to_others }
    }

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        let pair = |&(name, value): &(&'static str, &str)| {
            (name.parse().unwrap(), HeaderValue::from_str(value).unwrap())
        };
        let mut map = HeaderMap::new();
        pairs.iter().map(pair).for_each(|(name, value): (axum::http::HeaderName, _)| {
            map.append(name, value);
        });
        map
    }

    #[test]
    fn host_header_accepts_numbers_and_localhost() {
        for (host, local_only, open_to_others) in [
            ("127.0.0.1:8080", true, true),
            ("127.0.0.1", true, true),
            ("127.1.2.3:1", true, true),
            ("localhost:9", true, true),
            ("LocalHost", true, true),
            ("[::1]:8080", true, true),
            ("[::1]", true, true),
            ("192.168.0.7:8080", false, true),
            ("[fe80::1]:8080", false, true),
            ("", false, false),
            ("evil.example:8080", false, false),
            ("127.0.0.1.evil.example", false, false),
            ("localhost.evil.example:1", false, false),
            ("[::1]evil.example", false, false),
            ("[127.0.0.1]:1", false, false),
            ("::1", false, false),
            ("127.0.0.1:8080:evil", false, false),
        ] {
            assert_eq!(access_policy(false).is_trusted_host(host), local_only, "{host}");
            assert_eq!(access_policy(true).is_trusted_host(host), open_to_others, "{host}");
        }
    }

    #[test]
    fn request_with_two_hosts_or_two_tokens_is_rejected() {
        let policy = access_policy(false);
        let uri = |query: &str| format!("/?{query}").parse::<Uri>().unwrap();
        let query = uri(&format!("a=1&token={}", policy.token));
        let host = headers(&[("host", "localhost:1")]);
        assert_eq!(policy.check_request(&query, &host), Ok(()));
        let two = headers(&[("host", "localhost:1"), ("host", "evil.example")]);
        for hosts in [two, HeaderMap::new()] {
            assert_eq!(
                policy.check_request(&query, &hosts),
                Err((StatusCode::FORBIDDEN, INVALID_HOST_MESSAGE))
            );
        }
        let first = uri(&format!("token=0&token={}", policy.token));
        assert_eq!(
            policy.check_request(&first, &host),
            Err((StatusCode::FORBIDDEN, MISSING_TOKEN_MESSAGE))
        );
    }

    #[test]
    fn orders_must_be_json_and_from_the_page_of_the_run() {
        let check_with = |extra: &[(&'static str, &str)]| {
            let pairs = [&[("host", "localhost:1"), ("content-type", "application/json")], extra];
            check_order_headers(&headers(&pairs.concat()))
        };
        assert_eq!(check_with(&[]), Ok(()));
        assert_eq!(check_with(&[("origin", "http://localhost:1")]), Ok(()));
        assert_eq!(check_with(&[("sec-fetch-site", "same-origin")]), Ok(()));
        for extra in [
            ("origin", "http://localhost:2"),
            ("origin", "https://localhost:1"),
            ("origin", "null"),
            ("sec-fetch-site", "cross-site"),
            ("sec-fetch-site", "same-site"),
        ] {
            assert_eq!(check_with(&[extra]).unwrap_err().0, StatusCode::FORBIDDEN, "{extra:?}");
        }
        for content_type in ["text/plain", "application/x-www-form-urlencoded", ""] {
            let found = check_order_headers(&headers(&[
                ("host", "localhost"),
                ("content-type", content_type),
            ]));
            assert_eq!(found.unwrap_err().0, StatusCode::UNSUPPORTED_MEDIA_TYPE, "{content_type}");
        }
    }
}
