//! The request that a sample belongs to: inline quality of service of ROS 2's services.

use super::parameters::{ParameterWriter, Parameters, pid};
use super::sets::{put_sequence_number, sequence_number};
use super::{Guid, Reader, SequenceNumber, WireError, Writer};

/// Identity that a request and its reply carry: the client, and the number of the request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleIdentity {
    /// The writer, or Fast DDS's reply reader.
    pub guid: Guid,
    /// The number; [`SampleIdentity::OWN`] stands for that of the sample itself.
    pub sn: SequenceNumber,
}

impl SampleIdentity {
    /// In a request, its own number: `SEQUENCENUMBER_UNKNOWN`.
    pub const OWN: SequenceNumber = -1 << 32;

    /// The 24 bytes of `PID_RELATED_SAMPLE_IDENTITY`.
    ///
    /// # Errors
    /// [`WireError::Truncated`].
    pub fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        Ok(SampleIdentity {
            guid: Guid::decode(r)?,
            sn: sequence_number(r)?,
        })
    }

    fn encode(&self, w: &mut Writer<'_>) {
        self.guid.encode(w);
        put_sequence_number(w, self.sn);
    }
}

/// The request that inline quality of service names, under the standard's id or Fast DDS's.
#[must_use]
pub fn related_request(inline_qos: Option<Parameters<'_>>) -> Option<SampleIdentity> {
    let list = inline_qos?;
    let named = list.find(pid::RELATED_SAMPLE_IDENTITY);
    let mut named = named.or_else(|| list.find(pid::FAST_RELATED_SAMPLE_IDENTITY))?;
    SampleIdentity::decode(&mut named).ok()
}

/// Writes inline quality of service that names `request` under both ids, as `rmw_fastrtps` does.
///
/// # Errors
/// [`WireError::NoRoom`]; 60 bytes are enough.
pub fn put_related_request<'b>(
    request: &SampleIdentity,
    buf: &'b mut [u8],
) -> Result<&'b [u8], WireError> {
    let mut w = Writer::new(buf);
    let mut list = ParameterWriter::new(&mut w);
    list.add(pid::RELATED_SAMPLE_IDENTITY, |w| request.encode(w));
    list.add(pid::FAST_RELATED_SAMPLE_IDENTITY, |w| request.encode(w));
    list.end();
    w.finish()
}

#[cfg(test)]
mod tests {
    use super::super::{EntityId, GuidPrefix};
    use super::*;

    /// The bytes are those that rclpy of Kilted sends with a request.
    #[test]
    fn a_request_names_itself_as_fast_dds_does() {
        let guid = Guid::new(GuidPrefix([9; 12]), EntityId::reader(5));
        let request = SampleIdentity {
            guid,
            sn: SampleIdentity::OWN,
        };
        let mut buf = [0; 60];
        let bytes = put_related_request(&request, &mut buf).unwrap_or(&[]);
        assert_eq!(bytes.len(), 60);
        assert_eq!(bytes.get(..4), Some([0x83, 0, 24, 0].as_slice()));
        let number = [255, 255, 255, 255, 0, 0, 0, 0];
        assert_eq!(bytes.get(20..28), Some(number.as_slice()));
        let list = Parameters::new(Reader::new(bytes, true));
        assert_eq!(related_request(Some(list)), Some(request));
        assert_eq!(related_request(None), None);
    }
}
