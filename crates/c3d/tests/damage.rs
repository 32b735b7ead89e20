//! Damaged input: no panic, memory bounded by a small multiple of the input, errors that state the
//! place.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "test code outside a test function")]

mod support;

use aloft_c3d::{C3dError, C3dFile, WarningKind};
use support::fixtures;

/// Small random number generator, so that a failure prints the seed that reproduces it.
struct Lcg(u64);

impl Lcg {
    fn next(&mut self, below: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % below.max(1)
    }
}

fn damaged(seed: u64, originals: &[Vec<u8>]) -> Vec<u8> {
    let mut random = Lcg(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5bd1_e995);
    let mut bytes = originals[random.next(originals.len())].clone();
    let whole = bytes.len();
    // Damage has most effect in header and parameters.
    let reach = if random.next(4) == 0 { whole } else { whole.min(4096) };
    for _ in 0..=random.next(8) {
        let at = random.next(reach.min(bytes.len()));
        match random.next(7) {
            0 => bytes[at] = random.next(256) as u8,
            1 => bytes[at] ^= 1 << random.next(8),
            2 => bytes[at] = [0, 1, 127, 128, 255][random.next(5)],
            3 => bytes.truncate(at.max(1)),
            4 => {
                let end = (at + random.next(64)).min(bytes.len());
                bytes.drain(at..end);
            }
            5 => {
                let piece: Vec<u8> = (0..random.next(64)).map(|_| random.next(256) as u8).collect();
                bytes.splice(at..at, piece);
            }
            _ => {
                // Set a 16-bit word of the header to an extreme value.
                let word = 2 * random.next(12);
                if word + 1 < bytes.len() {
                    let value = [0_u16, 1, 0x7fff, 0x8000, 0xffff][random.next(5)].to_le_bytes();
                    bytes[word..word + 2].copy_from_slice(&value);
                }
            }
        }
        if bytes.is_empty() {
            break;
        }
    }
    bytes
}

/// Memory used by a file's vectors, bytes.
fn held(file: &C3dFile) -> usize {
    let points: usize =
        file.points.iter().map(|p| 12 * p.xyz.capacity() + 4 * p.residual.capacity() + p.cameras.capacity()).sum();
    let analogs: usize = file.analogs.iter().map(|a| 8 * a.values.capacity()).sum();
    points + analogs + 256 * (file.points.len() + file.analogs.len())
}

#[test]
fn damage_never_panics_and_stays_small() {
    let originals: Vec<Vec<u8>> = fixtures().iter().map(|(_, f)| f.to_bytes().unwrap()).collect();
    let (mut read, mut refused, mut rewritten) = (0, 0, 0);
    for seed in 0..6000 {
        let bytes = damaged(seed, &originals);
        match C3dFile::from_bytes(&bytes) {
            Ok(file) => {
                read += 1;
                assert!(
                    held(&file) <= 8 * bytes.len() + 300 * 65_536,
                    "seed {seed}: {} bytes from {}",
                    held(&file),
                    bytes.len()
                );
                for index in 0..=file.plates.len() {
                    let _ = file.plate_wrench(index);
                }
                if let Ok(written) = file.to_bytes() {
                    rewritten += 1;
                    let again =
                        C3dFile::from_bytes(&written).unwrap_or_else(|e| panic!("seed {seed}: own output: {e}"));
                    assert_eq!(again.n_frames, file.n_frames, "seed {seed}");
                    assert_eq!(again.points.len(), file.points.len(), "seed {seed}");
                }
            }
            Err(problem) => {
                refused += 1;
                assert!(!problem.to_string().is_empty());
            }
        }
    }
    println!("{read} read, {rewritten} of them written again, {refused} refused");
    assert!(read > 1000 && refused > 300);
}

#[test]
fn regress_a_truncated_file_gives_the_frames_that_it_has() {
    let whole = support::laboratory(Default::default(), Default::default());
    let bytes = whole.to_bytes().unwrap();
    let frame = (4 * 6 + 13 * 3) * 4;
    let start = 512 * (usize::from(bytes[16]) - 1);
    let cut = C3dFile::from_bytes(&bytes[..start + 10 * frame + 7]).unwrap();
    assert_eq!(cut.n_frames, 10);
    assert!(cut.warnings.iter().any(|w| w.kind == WarningKind::Truncated { held: 10, stated: 24 }));
    assert_eq!(cut.points[0].xyz[..10], whole.points[0].xyz[..10]);
    // Header and parameters only.
    let none = C3dFile::from_bytes(&bytes[..start]).unwrap();
    assert_eq!(none.n_frames, 0);
    assert!(!none.warnings.is_empty());
}

#[test]
fn regress_errors_say_where() {
    let bytes = support::laboratory(Default::default(), Default::default()).to_bytes().unwrap();
    let message = |b: &[u8]| C3dFile::from_bytes(b).unwrap_err().to_string();
    assert_eq!(message(b"marker,x,y,z\n1,2,3,4\n"), "not a C3D file: byte 1 is 0x61, expected 0x50");
    assert_eq!(message(b""), "not a C3D file: 0 bytes long, the header would need 512");
    assert!(message(&bytes[..300]).contains("300 bytes long"));
    let mut other = bytes.clone();
    other[512 + 3] = 7;
    other[16..18].copy_from_slice(&[0, 0]);
    assert!(message(&other).contains("byte 515"));
    let mut other = bytes.clone();
    other[16..18].copy_from_slice(&[255, 255]);
    // The parameter gives the position of the samples.
    assert!(C3dFile::from_bytes(&other).is_ok());
    // A parameter that extends beyond the file.
    let name = b"\x04\x01USED";
    let at = bytes.windows(name.len()).position(|w| w == name).unwrap();
    let mut other = bytes[..at + 40].to_vec();
    other[at + 6..at + 8].copy_from_slice(&[0, 0]);
    other[at + 8..at + 12].copy_from_slice(&[4, 2, 200, 200]);
    match C3dFile::from_bytes(&other) {
        Err(C3dError::Parameter { offset, group, parameter, problem }) => {
            assert_eq!((offset, group.as_str(), parameter.as_str()), (at, "POINT", "USED"));
            assert!(problem.contains("160000 bytes"), "{problem}");
        }
        other => panic!("{other:?}"),
    }
}
