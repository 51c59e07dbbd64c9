//! The instants at which the chains that led to a sample began: inline quality of service of ours,
//! which other implementations step over.

use super::parameters::{ParameterWriter, Parameters, pid};
use super::{WireError, Writer};

/// Chains that one sample takes along.
pub const MOST_ORIGINS: usize = 2;
/// Another vendor may use the same id for something else.
const SIGN: [u8; 4] = *b"rpln";

/// The instance of a chain that has led to a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChainOrigin {
    /// Stands for the chain's name; 0 is none.
    pub chain: u64,
    /// When the instance began, in nanoseconds since the Unix epoch.
    pub time: u64,
}

/// Origins of a sample; unused places are none.
pub type ChainOrigins = [ChainOrigin; MOST_ORIGINS];

/// The chains that inline quality of service names.
#[must_use]
pub fn chain_origins(inline_qos: Option<Parameters<'_>>) -> ChainOrigins {
    let mut origins = ChainOrigins::default();
    let named = inline_qos.and_then(|list| list.find(pid::CHAIN_ORIGINS));
    let Some(mut value) = named else {
        return origins;
    };
    if value.array() != Ok(SIGN) {
        return origins;
    }
    for origin in &mut origins {
        let (Ok(chain), Ok(time)) = (value.array(), value.array()) else {
            break;
        };
        let [chain, time] = [chain, time].map(u64::from_le_bytes);
        *origin = ChainOrigin { chain, time };
    }
    origins
}

/// Writes inline quality of service that names these chains; nothing if there are none.
///
/// # Errors
/// [`WireError::NoRoom`]; 44 bytes are enough.
pub fn put_chain_origins<'b>(
    origins: &ChainOrigins,
    buf: &'b mut [u8],
) -> Result<&'b [u8], WireError> {
    let named = origins.iter().filter(|origin| origin.chain != 0);
    if named.clone().next().is_none() {
        return Ok(&[]);
    }
    let mut w = Writer::new(buf);
    let mut list = ParameterWriter::new(&mut w);
    list.add(pid::CHAIN_ORIGINS, |w| {
        w.put(&SIGN);
        for origin in named {
            w.put(&origin.chain.to_le_bytes());
            w.put(&origin.time.to_le_bytes());
        }
    });
    list.end();
    w.finish()
}

#[cfg(test)]
mod tests {
    use super::super::Reader;
    use super::*;

    #[test]
    fn chains_come_back_and_what_is_not_ours_is_none() {
        let [first, second] =
            [(7, 70), (u64::MAX, 1)].map(|(chain, time)| ChainOrigin { chain, time });
        let none = ChainOrigin::default();
        for origins in [[first, second], [first, none], [none; 2]] {
            let mut buf = [0; 44];
            let bytes = put_chain_origins(&origins, &mut buf).unwrap_or(&[1]);
            assert_eq!(bytes.is_empty(), origins == [none; 2]);
            for little in [true, false] {
                let list = (!bytes.is_empty()).then(|| Parameters::new(Reader::new(bytes, little)));
                let expected = if little { origins } else { [none; 2] };
                assert_eq!(
                    chain_origins(list),
                    expected,
                    "the list's own order of bytes"
                );
            }
        }
        let mut buf = [0; 44];
        let len = put_chain_origins(&[first; 2], &mut buf).map_or(0, <[u8]>::len);
        assert_eq!(len, 44);
        buf[4] ^= 1;
        let list = Parameters::new(Reader::new(&buf, true));
        assert_eq!(chain_origins(Some(list)), [none; 2], "another vendor's");
        assert_eq!(chain_origins(None), [none; 2]);
    }
}
