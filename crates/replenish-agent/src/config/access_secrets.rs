//! The secrets of clients in the access list: pre-shared keys, and fingerprints of certificates.

use super::access::{AccessList, Grant};
use super::access_file::{AccessError, Source, Value};
use super::psk::Psk;
use replenish_xrce::wire::ClientKey;
use std::ops::{Range, RangeInclusive};

/// Bytes of a pre-shared key.
const PSK: RangeInclusive<usize> = 16..=64;

/// The prefix of a fingerprint, before its digits.
const SHA256: &str = "sha256:";

impl Source<'_> {
    /// A pre-shared key. Errors do not repeat it.
    pub(super) fn psk(&self, value: &Value<'_>) -> Result<Psk, AccessError> {
        let field = "client.psk";
        let text = value.get_ref().as_str();
        let bytes = text
            .filter(|text| text.len() <= 2 * PSK.end())
            .and_then(hex);
        let bytes = bytes.filter(|bytes| PSK.contains(&bytes.len()));
        bytes.map(Psk::new).ok_or_else(|| {
            let (least, most) = (2 * PSK.start(), 2 * PSK.end());
            let message =
                format!("allowed are {least} to {most} hexadecimal digits, an even number");
            self.wrong(&value.span(), field, message)
        })
    }

    /// The fingerprint of a certificate.
    pub(super) fn certificate(&self, value: &Value<'_>) -> Result<[u8; 32], AccessError> {
        let field = "client.certificate";
        let text = self.text(value, field, SHA256.len() + 64)?;
        let bytes = text.strip_prefix(SHA256).and_then(hex);
        let bytes = bytes.and_then(|bytes| <[u8; 32]>::try_from(bytes).ok());
        bytes.ok_or_else(|| {
            let message = "allowed is \"sha256:\" and 64 hexadecimal digits: the SHA-256 of the \
                           certificate in DER form";
            self.wrong(&value.span(), field, message)
        })
    }

    /// Enters the certificate of an entry, and checks that its secrets belong to one client.
    pub(super) fn add_secrets(
        &self,
        at: &Range<usize>,
        key: Option<ClientKey>,
        grant: &Grant,
        list: &mut AccessList,
    ) -> Result<(), AccessError> {
        let field = match (&grant.psk, &grant.certificate) {
            (None, None) => return Ok(()),
            (Some(_), _) => "client.psk",
            (None, Some(_)) => "client.certificate",
        };
        let Some(key) = key else {
            let message = "allowed for one client: its key is eight hexadecimal digits, not \"*\"";
            return Err(self.wrong(at, field, message));
        };
        if let Some(certificate) = grant.certificate
            && list.certificates.insert(certificate, key).is_some()
        {
            let message = "another client has this certificate: allowed is one for each";
            return Err(self.wrong(at, "client.certificate", message));
        }
        Ok(())
    }
}

/// The bytes that pairs of hexadecimal digits stand for.
fn hex(text: &str) -> Option<Vec<u8>> {
    let digits = text.as_bytes().chunks(2).map(|pair| {
        let pair = std::str::from_utf8(pair)
            .ok()
            .filter(|pair| pair.len() == 2)?;
        let digits = pair.bytes().all(|digit| digit.is_ascii_hexdigit());
        u8::from_str_radix(pair, 16).ok().filter(|_| digits)
    });
    digits.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEY: &str = "00112233445566778899aabbccddeeff";

    #[test]
    fn a_client_with_a_secret_must_show_it() {
        let text =
            format!("[[client]]\nkey = \"01010101\"\npsk = \"{KEY}\"\n[[client]]\nkey = \"*\"");
        let list = AccessList::parse(&text).unwrap();
        let (own, other) = (ClientKey([1; 4]), ClientKey([2; 4]));
        assert!(list.find(own, None, Some(own)).is_ok());
        assert!(list.find(other, None, None).is_ok());
        let refused = |key, identity| list.find(key, None, identity).err();
        assert_eq!(refused(own, None), Some("key without encryption"));
        assert_eq!(refused(other, Some(own)), Some("key for this identity"));
        let shown = format!("{list:?}");
        assert!(
            shown.contains("Psk of 16 bytes") && !shown.contains("aabb"),
            "{shown}"
        );
    }

    #[test]
    fn bad_secrets_are_refused_with_their_field_and_what_is_allowed() {
        let print = "ab".repeat(32);
        for (key, line, expected) in [
            (
                "\"01010101\"",
                "psk = 3".into(),
                "line 3: client.psk: allowed are 32 to 128",
            ),
            (
                "\"01010101\"",
                format!("psk = \"{}\"", &KEY[2..]),
                "line 3: client.psk: allowed",
            ),
            (
                "\"01010101\"",
                format!("psk = \"{KEY}0\""),
                "line 3: client.psk: allowed",
            ),
            (
                "\"01010101\"",
                format!("psk = \"{}\"", "00".repeat(65)),
                "line 3: client.psk",
            ),
            (
                "\"01010101\"",
                format!("psk = \"+{}\"", &KEY[1..]),
                "line 3: client.psk",
            ),
            (
                "\"*\"",
                format!("psk = \"{KEY}\""),
                "line 1: client.psk: allowed for one client",
            ),
            (
                "\"01010101\"",
                format!("certificate = \"{print}\""),
                "line 3: client.certificate",
            ),
            (
                "\"01010101\"",
                format!("certificate = \"sha256:{print}0\""),
                "line 3: client.certif",
            ),
            (
                "\"*\"",
                format!("certificate = \"sha256:{print}\""),
                "line 1: client.certificate",
            ),
            (
                "\"01010101\"",
                format!(
                    "certificate = \"sha256:{print}\"\n[[client]]\nkey = \"02020202\"\n\
                     certificate = \"sha256:{print}\""
                ),
                "line 4: client.certificate: another client has this certificate",
            ),
        ] {
            let text = format!("[[client]]\nkey = {key}\n{line}");
            let error = AccessList::parse(&text).unwrap_err().to_string();
            assert!(error.starts_with(expected), "{text}: {error}");
            assert!(!error.contains(&KEY[4..]), "{error}");
        }
    }
}
