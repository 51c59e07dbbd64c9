//! Cookies: an address that has not echoed one costs no memory.
//!
//! ```text
//!   hello ──► cookie of this address and this hello? ─ no ──► a cookie, and nothing is kept
//!                          └─ yes ──► an association
//! ```
//!
//! `dimpl` has cookies of its own, but keeps an association before it checks them, and does not
//! bind them to an address. So the agent checks its own, and the association takes the one that was
//! checked: it asks for the code of a hello while, and only while, it takes in that hello.

use super::hello::{COOKIE, Hello};
use dimpl::CryptoError;
use dimpl::crypto::{CryptoProvider, HashAlgorithm, HmacProvider, rust_crypto};
use std::cell::Cell;
use std::net::{IpAddr, SocketAddr};

thread_local! {
    /// The cookie of the hello that this thread's association takes in just now.
    static CHECKED: Cell<Option<[u8; COOKIE]>> = const { Cell::new(None) };
}

/// The agent's cookies.
pub(super) struct Cookies {
    secret: [u8; 32],
    provider: CryptoProvider,
}

impl Cookies {
    pub(super) fn new() -> Result<Self, dimpl::Error> {
        let provider = rust_crypto::default_provider();
        let mut secret = [0; 32];
        provider.secure_random.fill(&mut secret)?;
        Ok(Self { secret, provider })
    }

    /// The cookie that a hello from `addr` must have.
    pub(super) fn cookie(&self, addr: SocketAddr, hello: &Hello<'_>) -> Option<[u8; COOKIE]> {
        let mut data = [0; 16 + 2 + 32];
        let ip = match addr.ip() {
            IpAddr::V4(ip) => ip.to_ipv6_mapped().octets(),
            IpAddr::V6(ip) => ip.octets(),
        };
        let port = addr.port().to_be_bytes();
        let parts = ip.iter().chain(&port).chain(hello.random);
        for (to, byte) in data.iter_mut().zip(parts) {
            *to = *byte;
        }
        self.provider
            .hmac_provider
            .hmac_sha256(&self.secret, &data)
            .ok()
    }
}

impl std::fmt::Debug for Cookies {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Cookies")
    }
}

/// Whether a hello has this cookie, in a time that does not depend on where they differ.
pub(super) fn is_same(cookie: &[u8; COOKIE], hello: &Hello<'_>) -> bool {
    let differences = cookie
        .iter()
        .zip(hello.cookie)
        .fold(0, |sum, (a, b)| sum | (a ^ b));
    hello.cookie.len() == COOKIE && differences == 0
}

/// Runs `take`, in which an association finds that a hello's cookie is `cookie`.
pub(super) fn with_checked<T>(cookie: [u8; COOKIE], take: impl FnOnce() -> T) -> T {
    CHECKED.set(Some(cookie));
    let taken = take();
    CHECKED.set(None);
    taken
}

/// The cryptography of associations: that of `dimpl`, but for cookies.
pub(super) fn provider() -> CryptoProvider {
    CryptoProvider {
        hmac_provider: &CheckedCookies,
        ..rust_crypto::default_provider()
    }
}

#[derive(Debug)]
struct CheckedCookies;

impl HmacProvider for CheckedCookies {
    fn hmac(
        &self,
        hash: HashAlgorithm,
        key: &[u8],
        data: &[u8],
        out: &mut [u8],
    ) -> Result<usize, CryptoError> {
        if let Some(cookie) = CHECKED.get()
            && let Some(to) = out.first_chunk_mut::<COOKIE>()
        {
            *to = cookie;
            return Ok(COOKIE);
        }
        rust_crypto::default_provider()
            .hmac_provider
            .hmac(hash, key, data, out)
    }
}
