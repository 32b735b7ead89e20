//! What can be read and written again reads the same, and a second re-write gives the same bytes.

#![no_main]

use aloft_c3d::C3dFile;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(first) = C3dFile::from_bytes(bytes) else { return };
    let Ok(written) = first.to_bytes() else { return };
    let second = C3dFile::from_bytes(&written).expect("own output is readable");
    assert_eq!((first.n_frames, first.points.len()), (second.n_frames, second.points.len()));
    assert_eq!(first.byte_order, second.byte_order);
    assert_eq!(first.analogs.len(), second.analogs.len());
    let same = |a: f32, b: f32| a == b || (a.is_nan() && b.is_nan());
    for (a, b) in first.points.iter().zip(&second.points) {
        assert!(a.xyz.as_flattened().iter().zip(b.xyz.as_flattened()).all(|(a, b)| same(*a, *b)));
        assert!(a.residual.iter().zip(&b.residual).all(|(a, b)| same(*a, *b)));
        assert_eq!((&a.label, a.kind, &a.cameras), (&b.label, b.kind, &b.cameras));
    }
    for (a, b) in first.analogs.iter().zip(&second.analogs) {
        assert!(a.values.iter().zip(&b.values).all(|(a, b)| a == b || (a.is_nan() && b.is_nan())));
        assert_eq!(a.label, b.label);
    }
    assert_eq!(format!("{:?}", first.events), format!("{:?}", second.events));
    assert_eq!(format!("{:?}", first.plates), format!("{:?}", second.plates));
    assert_eq!(second.to_bytes().expect("own output is writable"), written);
});
