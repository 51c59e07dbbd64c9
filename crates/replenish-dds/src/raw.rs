//! Samples as bytes: how RustDDS is kept from looking into them.

use rustdds::RepresentationIdentifier;
use rustdds::bytes::Bytes;
use rustdds::no_key::{Decode, DefaultDecoder, DeserializerAdapter, SerializerAdapter};
use std::convert::Infallible;

/// Little-endian XCDR1 as it is, without its encapsulation header.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Raw;

impl SerializerAdapter<Bytes> for Raw {
    type Error = Infallible;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(value: &Bytes) -> Result<Bytes, Infallible> {
        Ok(value.clone())
    }
}

impl DeserializerAdapter<Vec<u8>> for Raw {
    type Error = Infallible;
    type Decoded = Vec<u8>;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[RepresentationIdentifier::CDR_LE]
    }

    fn transform_decoded(decoded: Vec<u8>) -> Vec<u8> {
        decoded
    }
}

impl DefaultDecoder<Vec<u8>> for Raw {
    type Decoder = Raw;
    const DECODER: Raw = Raw;
}

impl Decode<'_, Vec<u8>> for Raw {
    type Error = Infallible;

    fn decode_bytes(
        self,
        bytes: &[u8],
        _encoding: RepresentationIdentifier,
    ) -> Result<Vec<u8>, Infallible> {
        Ok(bytes.to_vec())
    }
}
