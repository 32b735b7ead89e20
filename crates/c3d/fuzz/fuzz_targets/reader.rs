//! Any bytes: no panic, no more memory than a small multiple of the input, plates included.

#![no_main]

use aloft_c3d::C3dFile;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    match C3dFile::from_bytes(bytes) {
        Ok(file) => {
            let points: usize = file.points.iter().map(|p| 12 * p.xyz.len() + 4 * p.residual.len() + p.cameras.len()).sum();
            let analogs: usize = file.analogs.iter().map(|a| 8 * a.values.len()).sum();
            assert!(points + analogs <= 8 * bytes.len() + 4096, "{} bytes of samples from {}", points + analogs, bytes.len());
            for index in 0..=file.plates.len() {
                let _ = file.plate_wrench(index);
            }
            for warning in &file.warnings {
                assert!(!warning.message.is_empty());
            }
        }
        Err(problem) => assert!(!problem.to_string().is_empty()),
    }
});
