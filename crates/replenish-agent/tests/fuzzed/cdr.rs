//! Messages of ROS from any bytes.

use replenish_msg::{CdrWriter, Message, builtin_interfaces, decode, encode, std_msgs};

/// As every type there is.
pub(crate) fn every_type(bytes: &[u8]) {
    as_type::<builtin_interfaces::Time>(bytes);
    as_type::<std_msgs::Bool>(bytes);
    as_type::<std_msgs::Empty>(bytes);
    as_type::<std_msgs::Int8>(bytes);
    as_type::<std_msgs::Int16>(bytes);
    as_type::<std_msgs::Int32>(bytes);
    as_type::<std_msgs::Int64>(bytes);
    as_type::<std_msgs::UInt64>(bytes);
    as_type::<std_msgs::Float32>(bytes);
    as_type::<std_msgs::Float64>(bytes);
    as_type::<std_msgs::BoundedString>(bytes);
    as_type::<std_msgs::BoundedHeader>(bytes);
    as_type::<std_msgs::UInt8MultiArray>(bytes);
}

/// A decoded value fits into the type's largest size, and means the same when encoded again.
fn as_type<M: Message>(bytes: &[u8]) {
    let mut message = M::default();
    if decode(&mut message, bytes).is_err() {
        return;
    }
    let mut buf = vec![0; M::MAX_SIZE];
    let len = encode(&message, &mut buf).unwrap();
    let mut again = M::default();
    decode(&mut again, &buf[..len]).unwrap();
    let mut second = vec![0; len];
    let mut w = CdrWriter::new(&mut second);
    again.encode(&mut w).unwrap();
    assert_eq!(second, buf[..len]);
}
