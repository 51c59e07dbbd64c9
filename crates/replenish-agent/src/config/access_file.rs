//! The access list as a TOML file; every error has its line and its field.
//!
//! ```toml
//! [[client]]
//! key = "5b1f77c0"                    # "*": all clients that are not listed
//! from = ["10.0.0.0/8", "serial"]     # hosts, networks, serial lines
//! write = ["/odom", "/arm/*"]         # topics and services, as in --priority
//! read = ["/cmd_vel"]
//! psk = "00112233445566778899aabbccddeeff"   # over DTLS; 16 to 64 bytes in hexadecimal
//! certificate = "sha256:…"            # over TLS; 64 hexadecimal digits
//! memory = 1048576                    # bytes; entities; datagrams per second
//! entities = 20
//! rate = 1000
//! ```

use super::access::{AccessList, Grant, Place};
use replenish_xrce::wire::ClientKey;
use std::fmt;
use std::net::IpAddr;
use std::ops::{Range, RangeInclusive};
use std::sync::Arc;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Longer files are refused, in bytes.
const MAX_FILE: usize = 4 << 20;
/// More clients are refused.
const MAX_CLIENTS: usize = 65_536;
/// More patterns, and places, of a client are refused.
const MAX_PATTERNS: usize = 256;
/// The longest pattern, in bytes.
const MAX_PATTERN: usize = 1024;

/// An error in an access list, with its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AccessError {
    /// The line, from 1.
    pub line: usize,
    /// The field: `client.key`. Empty for a file that is not TOML.
    pub field: &'static str,
    /// The reason, and what is allowed.
    pub message: String,
}

impl fmt::Display for AccessError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: ", self.line)?;
        if !self.field.is_empty() {
            write!(f, "{}: ", self.field)?;
        }
        f.write_str(&self.message)
    }
}

impl std::error::Error for AccessError {}

pub(super) type Value<'t> = Spanned<DeValue<'t>>;

/// The text, for the lines of errors.
pub(super) struct Source<'t>(&'t str);

impl AccessList {
    /// Reads a list from TOML of at most 4 MiB, with at most 65 536 clients.
    ///
    /// # Errors
    /// The first thing that is wrong, with its line, its field and what is allowed.
    pub fn parse(text: &str) -> Result<Self, AccessError> {
        let source = Source(text);
        if text.len() > MAX_FILE {
            let message = format!("{} bytes: allowed up to {MAX_FILE}", text.len());
            return Err(source.wrong(&(0..0), "", message));
        }
        let table = DeTable::parse(text).map_err(|error| {
            let at = error.span().unwrap_or(0..0);
            source.wrong(&at, "", error.message().escape_debug().to_string())
        })?;
        let mut list = Self::default();
        for (name, value) in table.get_ref() {
            if name.get_ref() != "client" {
                return Err(source.unknown(name, "client"));
            }
            let clients = source.array(value, "client", MAX_CLIENTS)?;
            for client in clients {
                source.client(client, &mut list)?;
            }
        }
        Ok(list)
    }
}

impl Source<'_> {
    pub(super) fn wrong(
        &self,
        at: &Range<usize>,
        field: &'static str,
        message: impl Into<String>,
    ) -> AccessError {
        let before = self.0.get(..at.start).unwrap_or(self.0);
        AccessError {
            line: before.matches('\n').count() + 1,
            field,
            message: message.into(),
        }
    }

    fn unknown<T: fmt::Debug>(&self, name: &Spanned<T>, allowed: &str) -> AccessError {
        let shown: String = format!("{:?}", name.get_ref()).chars().take(60).collect();
        self.wrong(
            &name.span(),
            "",
            format!("unknown field {shown}: allowed {allowed}"),
        )
    }

    fn client(&self, client: &Value<'_>, list: &mut AccessList) -> Result<(), AccessError> {
        let table = client.get_ref().as_table();
        let table =
            table.ok_or_else(|| self.wrong(&client.span(), "client", "allowed is [[client]]"))?;
        let mut key = None;
        let mut grant = Grant::default();
        for (name, value) in table {
            match &**name.get_ref() {
                "key" => key = Some((self.key(value)?, value.span())),
                "from" => grant.from = Some(self.places(value)?),
                "psk" => grant.psk = Some(self.psk(value)?),
                "certificate" => grant.certificate = Some(self.certificate(value)?),
                "write" => grant.write = Some(self.patterns(value, "client.write")?),
                "read" => grant.read = Some(self.patterns(value, "client.read")?),
                "memory" => {
                    let bytes = self.number(value, "client.memory", 4096..=1 << 40)?;
                    grant.client_bytes = Some(usize::try_from(bytes).unwrap_or(usize::MAX));
                }
                "entities" => {
                    let count = self.number(value, "client.entities", 1..=4096)?;
                    grant.entities = Some(usize::try_from(count).unwrap_or(usize::MAX));
                }
                "rate" => {
                    let rate = self.number(value, "client.rate", 1..=10_000_000)?;
                    grant.datagrams_per_second = Some(u32::try_from(rate).unwrap_or(u32::MAX));
                }
                _ => {
                    let allowed =
                        "key, from, psk, certificate, write, read, memory, entities, rate";
                    return Err(self.unknown(name, allowed));
                }
            }
        }
        let Some((key, at)) = key else {
            let message = "missing: eight hexadecimal digits, or \"*\" for all others";
            return Err(self.wrong(&client.span(), "client.key", message));
        };
        self.add_secrets(&client.span(), key, &grant, list)?;
        let grant = Arc::new(grant);
        let before = match key {
            Some(key) => list.grants.insert(key, grant),
            None => list.others.replace(grant),
        };
        match before {
            Some(_) => Err(self.wrong(&at, "client.key", "there is an entry with it already")),
            None => Ok(()),
        }
    }

    /// A client's key, or `None` for all others.
    fn key(&self, value: &Value<'_>) -> Result<Option<ClientKey>, AccessError> {
        let text = self.text(value, "client.key", 8)?;
        if text == "*" {
            return Ok(None);
        }
        let hex = text.len() == 8 && text.bytes().all(|digit| digit.is_ascii_hexdigit());
        let number = u32::from_str_radix(text, 16)
            .ok()
            .filter(|n| hex && *n != 0);
        let number = number.ok_or_else(|| {
            let message = "allowed are eight hexadecimal digits, not all 0, or \"*\"";
            self.wrong(&value.span(), "client.key", message)
        })?;
        Ok(Some(ClientKey(number.to_be_bytes())))
    }

    fn places(&self, value: &Value<'_>) -> Result<Vec<Place>, AccessError> {
        let places = self.array(value, "client.from", MAX_PATTERNS)?;
        places.iter().map(|place| self.place(place)).collect()
    }

    fn place(&self, value: &Value<'_>) -> Result<Place, AccessError> {
        let text = self.text(value, "client.from", 64)?;
        if text == "serial" {
            return Ok(Place::Serial);
        }
        let (address, bits) = match text.split_once('/') {
            Some((address, bits)) => (address, Some(bits)),
            None => (text, None),
        };
        let address: Option<IpAddr> = address.parse().ok();
        let place = address.and_then(|address| {
            let most = if address.is_ipv4() { 32 } else { 128 };
            let bits = bits.map_or(Some(most), |bits| bits.parse().ok());
            let bits = bits.filter(|bits| *bits <= most)?;
            Some(Place::Net { address, bits })
        });
        place.ok_or_else(|| {
            let message = "allowed are an address, a network as 10.0.0.0/8, or \"serial\"";
            self.wrong(&value.span(), "client.from", message)
        })
    }

    fn patterns(
        &self,
        value: &Value<'_>,
        field: &'static str,
    ) -> Result<Vec<Box<str>>, AccessError> {
        let patterns = self.array(value, field, MAX_PATTERNS)?;
        let text = |pattern| Ok(self.text(pattern, field, MAX_PATTERN)?.into());
        patterns.iter().map(text).collect()
    }

    fn array<'t>(
        &self,
        value: &'t Value<'t>,
        field: &'static str,
        most: usize,
    ) -> Result<&'t [Value<'t>], AccessError> {
        let array = value.get_ref().as_array();
        let array = array.ok_or_else(|| self.wrong(&value.span(), field, "allowed is a list"))?;
        if array.len() > most {
            let message = format!("{} entries: allowed up to {most}", array.len());
            return Err(self.wrong(&value.span(), field, message));
        }
        Ok(array)
    }

    /// Text of 1 to `most` bytes without control characters.
    pub(super) fn text<'t>(
        &self,
        value: &'t Value<'t>,
        field: &'static str,
        most: usize,
    ) -> Result<&'t str, AccessError> {
        let text = value.get_ref().as_str();
        let text = text.filter(|text| (1..=most).contains(&text.len()));
        let text = text.filter(|text| !text.contains(char::is_control));
        text.ok_or_else(|| {
            let message =
                format!("allowed is text of 1 to {most} bytes, without control characters");
            self.wrong(&value.span(), field, message)
        })
    }

    fn number(
        &self,
        value: &Value<'_>,
        field: &'static str,
        range: RangeInclusive<u64>,
    ) -> Result<u64, AccessError> {
        let number = value.get_ref().as_integer();
        let number = number.and_then(|n| u64::from_str_radix(n.as_str(), n.radix()).ok());
        number.filter(|n| range.contains(n)).ok_or_else(|| {
            let message = format!("allowed is {} to {}", range.start(), range.end());
            self.wrong(&value.span(), field, message)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = r#"
        [[client]]
        key = "5b1f77c0"
        from = ["10.0.0.0/8", "::1", "serial"]
        write = ["/odom"]
        read = []
        memory = 0x10_0000
        rate = 1000

        [[client]]
        key = "*"
        from = ["127.0.0.1"]
    "#;

    #[test]
    fn a_client_is_found_by_its_key_and_its_place() {
        let list = AccessList::parse(FILE).unwrap();
        assert_eq!(list.len(), 2);
        let listed = ClientKey([0x5b, 0x1f, 0x77, 0xc0]);
        let other = ClientKey([1; 4]);
        let at = |text: &str| Some(text.parse::<IpAddr>().unwrap());
        for (key, host, refused) in [
            (listed, at("10.255.0.1"), None),
            (listed, at("::ffff:10.1.2.3"), None),
            (listed, at("::1"), None),
            (listed, None, None),
            (listed, at("11.0.0.1"), Some("address")),
            (listed, at("127.0.0.1"), Some("address")),
            (other, at("127.0.0.1"), None),
            (other, at("127.0.0.2"), Some("address")),
            (other, None, Some("address")),
        ] {
            assert_eq!(list.find(key, host, None).err(), refused, "{key} {host:?}");
        }
        let grant = list.find(listed, None, None).unwrap();
        assert_eq!(grant.client_bytes, Some(1 << 20));
        let nobody = AccessList::parse("").unwrap();
        assert_eq!(nobody.find(other, None, None).err(), Some("key"));
    }

    #[test]
    fn every_error_names_its_line_and_its_field() {
        let long = format!("[[client]]\nkey = \"*\"\nread = [\"{}\"]", "x".repeat(1025));
        for (text, expected) in [
            ("client = 3", "line 1: client: allowed is a list"),
            (
                "clients = []",
                "line 1: unknown field \"clients\": allowed client",
            ),
            ("[[client]]\nkey = 3", "line 2: client.key: allowed is text"),
            ("[[client]]\n", "line 1: client.key: missing"),
            (
                "[[client]]\nkey = \"+b1f77c0\"",
                "line 2: client.key: allowed are eight",
            ),
            (
                "[[client]]\nkey = \"00000000\"",
                "line 2: client.key: allowed are eight",
            ),
            (
                "[[client]]\nkey = \"*\"\n[[client]]\nkey = \"*\"",
                "line 4: client.key: there is an entry",
            ),
            (
                "[[client]]\nkey = \"*\"\nfrom = [\"::1\",\n\"10.0.0.0/33\"]",
                "line 4: client.from: allowed are an address",
            ),
            (
                "[[client]]\nkey = \"*\"\nrate = -1",
                "line 3: client.rate: allowed is 1 to",
            ),
            (
                "[[client]]\nkey = \"*\"\nmemory = 1e9",
                "line 3: client.memory: allowed",
            ),
            (
                "[[client]]\nkey = \"*\"\nwrite = [\"a\\u001b[2J\"]",
                "line 3: client.write: allowed is text",
            ),
            (
                "[[client]]\n\"a\\u001b[2J\" = 3",
                "line 2: unknown field \"a\\u{1b}[2J\": allowed key",
            ),
            (
                &*long,
                "line 3: client.read: allowed is text of 1 to 1024 bytes",
            ),
            ("[[client]\n", "line 1: "),
        ] {
            let error = AccessList::parse(text).unwrap_err().to_string();
            assert!(error.starts_with(expected), "{text}: {error}");
            assert!(!error.contains(char::is_control), "{error:?}");
        }
        let deep = format!("client = {}", "[".repeat(100_000));
        assert!(AccessList::parse(&deep).is_err());
        assert!(AccessList::parse(&" ".repeat(MAX_FILE + 1)).is_err());
        let clients = "[[client]]\n".repeat(MAX_CLIENTS + 1);
        let error = AccessList::parse(&clients).unwrap_err().to_string();
        assert!(
            error.ends_with("65537 entries: allowed up to 65536"),
            "{error}"
        );
    }
}
