use gantry_tau_labcomm::{
    ErrorKind, Kind, Limit, MAX_DEPTH, MAX_TYPE, Malformed, Primitive, Type, Version,
};

/// Type of packed numbers.
fn packed(bytes: &[u8]) -> Result<Type<'_>, ErrorKind> {
    Type::whole(Version::V2014, bytes)
}

#[test]
fn parts_are_found() {
    // struct { int n; string s[_, 3]; }
    let ty = packed(&[0x11, 2, 1, b'n', 0x23, 1, b's', 0x10, 2, 0, 3, 0x27]).unwrap();
    let Kind::Structure(fields) = ty.kind() else {
        panic!("a structure")
    };
    let fields: Vec<_> = fields.fields().collect();
    let [(n, int), (s, array)] = &fields[..] else {
        panic!("two fields")
    };
    assert_eq!((*n, *s), (&b"n"[..], &b"s"[..]));
    assert!(matches!(int.kind(), Kind::Primitive(Primitive::Int)));
    let Kind::Array(array) = array.kind() else {
        panic!("an array")
    };
    assert_eq!(array.indices().collect::<Vec<_>>(), [0, 3]);
    assert!(matches!(
        array.element().kind(),
        Kind::Primitive(Primitive::String)
    ));
    assert_eq!((ty.fixed_size(), ty.smallest_size()), (None, 5));
}

/// Size of a value of this type of 2014, bytes; `None` if it varies.
fn fixed_size(ty: &[u8]) -> Option<usize> {
    packed(ty).unwrap().fixed_size()
}

#[test]
fn sizes_are_counted() {
    assert_eq!(fixed_size(&[0x10, 2, 2, 3, 0x24]), Some(48));
    assert_eq!(fixed_size(&[0x10, 0, 0x22]), Some(2));
    assert_eq!(fixed_size(&[0x11, 0]), Some(0));
    assert_eq!(fixed_size(&[0x11, 2, 0, 0x21, 1, b'b', 0x28]), Some(5));
    assert_eq!(fixed_size(&[0x10, 1, 0, 0x20]), None);
    assert_eq!(
        packed(&[0x10, 1, 2, 0x10, 1, 0, 0x24])
            .unwrap()
            .smallest_size(),
        2
    );
}

/// Error of a type of 2014.
fn refused(ty: &[u8]) -> ErrorKind {
    packed(ty).map(|ty| ty.bytes().to_vec()).unwrap_err()
}

#[test]
fn bad_types_are_refused() {
    assert_eq!(
        refused(&[0x10, 1, 3, 0x11, 0]),
        ErrorKind::Malformed(Malformed::EmptyElement)
    );
    assert_eq!(
        refused(&[0x10, 1, 0, 0x11, 1, 0, 0x11, 0]),
        ErrorKind::Malformed(Malformed::EmptyElement)
    );
    assert_eq!(
        refused(&[0x29]),
        ErrorKind::Malformed(Malformed::TypeCode(0x29))
    );
    assert_eq!(
        refused(&[0x23, 0x23]),
        ErrorKind::Malformed(Malformed::PacketLength)
    );
    assert_eq!(refused(&[0x11, 2, 1, b'n', 0x23]), ErrorKind::Incomplete);
    // 257 fields; 16 MiB and a byte.
    assert_eq!(
        refused(&[0x11, 0x82, 0x01]),
        ErrorKind::Limit(Limit::Fields)
    );
    assert_eq!(
        refused(&[0x10, 2, 0x84, 0x80, 0x00, 0x82, 0x80, 0x01, 0x20]),
        ErrorKind::Limit(Limit::Value)
    );
    // Sample references came in 2014.
    let reference = Type::whole(Version::V2006, &[0, 0, 0, 0x28]);
    assert_eq!(
        reference.unwrap_err(),
        ErrorKind::Malformed(Malformed::TypeCode(0x28))
    );
}

/// Type of 2014: `depth` nested arrays of two elements.
fn nested_arrays(depth: usize) -> Vec<u8> {
    [[0x10, 1, 2].repeat(depth), vec![0x20]].concat()
}

/// Type of 2014: a structure of 16 fields, whose names have 127 letters, the last one `letters`.
fn structure(letters: usize) -> Vec<u8> {
    let full = [&[127][..], &[b'x'; 127], &[0x20]].concat();
    let last = [
        &[u8::try_from(letters).unwrap()][..],
        &vec![b'x'; letters],
        &[0x20],
    ]
    .concat();
    [&[0x11, 16][..], &full.repeat(15), &last].concat()
}

#[test]
fn the_largest_depth_and_length_pass_and_no_more() {
    assert_eq!(
        packed(&nested_arrays(MAX_DEPTH)).unwrap().fixed_size(),
        Some(1 << MAX_DEPTH)
    );
    assert_eq!(
        packed(&nested_arrays(MAX_DEPTH + 1)).unwrap_err(),
        ErrorKind::Limit(Limit::Depth)
    );
    let letters = MAX_TYPE - structure(0).len();
    assert!(packed(&structure(letters)).is_ok());
    assert_eq!(
        packed(&structure(letters + 1)).unwrap_err(),
        ErrorKind::Limit(Limit::TypeBytes)
    );
}
