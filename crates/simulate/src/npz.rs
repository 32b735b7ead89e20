//! Arrays in numpy's format: `.npz` archives of `.npy` members, stored without compression.

/// Values of one member.
pub enum Array {
    /// 32-bit floats.
    F4(Vec<f32>),
    /// 64-bit floats.
    F8(Vec<f64>),
    /// 64-bit integers.
    I8(Vec<i64>),
}

/// An archive to which members are added one by one.
#[derive(Debug, Default)]
pub struct Npz {
    bytes: Vec<u8>,
    directory: Vec<u8>,
    members: u16,
}

impl Npz {
    /// Adds a member of the given shape (row-major).
    pub fn add(&mut self, name: &str, shape: &[usize], array: &Array) {
        let (kind, data): (&str, Vec<u8>) = match array {
            Array::F4(v) => ("<f4", v.iter().flat_map(|x| x.to_le_bytes()).collect()),
            Array::F8(v) => ("<f8", v.iter().flat_map(|x| x.to_le_bytes()).collect()),
            Array::I8(v) => ("<i8", v.iter().flat_map(|x| x.to_le_bytes()).collect()),
        };
        let mut dims: String = shape.iter().map(|n| format!("{n}, ")).collect();
        if shape.len() > 1 {
            dims.truncate(dims.len() - 2);
        }
        let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({}), }}", dims.trim_end());
        // magic, version, length and header together are padded to a multiple of 64 bytes
        while (10 + header.len() + 1) % 64 != 0 {
            header.push(' ');
        }
        header.push('\n');
        let mut member = b"\x93NUMPY\x01\x00".to_vec();
        member.extend_from_slice(&(header.len() as u16).to_le_bytes());
        member.extend_from_slice(header.as_bytes());
        member.extend_from_slice(&data);
        self.store(&format!("{name}.npy"), &member);
    }

    fn store(&mut self, name: &str, data: &[u8]) {
        let offset = self.bytes.len() as u32;
        let mut record = Vec::new();
        // version 2.0, no flags, stored, 1980-01-01
        for half in [20u16, 0, 0, 0, 0x21] {
            record.extend_from_slice(&half.to_le_bytes());
        }
        let size = data.len() as u32;
        for word in [crc32(data), size, size] {
            record.extend_from_slice(&word.to_le_bytes());
        }
        record.extend_from_slice(&(name.len() as u16).to_le_bytes());
        record.extend_from_slice(&0u16.to_le_bytes());
        self.bytes.extend_from_slice(b"PK\x03\x04");
        self.bytes.extend_from_slice(&record);
        self.bytes.extend_from_slice(name.as_bytes());
        self.bytes.extend_from_slice(data);
        self.directory.extend_from_slice(b"PK\x01\x02\x14\x00");
        self.directory.extend_from_slice(&record);
        // comment length, disk, internal and external attributes
        self.directory.extend_from_slice(&[0; 10]);
        self.directory.extend_from_slice(&offset.to_le_bytes());
        self.directory.extend_from_slice(name.as_bytes());
        self.members += 1;
    }

    /// The archive.
    pub fn finish(mut self) -> Vec<u8> {
        let start = self.bytes.len() as u32;
        self.bytes.extend_from_slice(&self.directory);
        self.bytes.extend_from_slice(b"PK\x05\x06\0\0\0\0");
        self.bytes.extend_from_slice(&self.members.to_le_bytes());
        self.bytes.extend_from_slice(&self.members.to_le_bytes());
        self.bytes.extend_from_slice(&(self.directory.len() as u32).to_le_bytes());
        self.bytes.extend_from_slice(&start.to_le_bytes());
        self.bytes.extend_from_slice(&[0, 0]);
        self.bytes
    }
}

/// CRC-32 of zip (reflected polynomial 0xEDB88320).
fn crc32(data: &[u8]) -> u32 {
    let table: [u32; 256] =
        std::array::from_fn(|i| (0..8).fold(i as u32, |c, _| if c & 1 == 1 { 0xEDB8_8320 ^ (c >> 1) } else { c >> 1 }));
    !data.iter().fold(!0u32, |c, b| table[((c ^ u32::from(*b)) & 0xFF) as usize] ^ (c >> 8))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn validate_crc32_of_the_standard_check_string() {
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
    }

    #[test]
    fn regress_members_start_on_whole_lines() {
        let mut npz = Npz::default();
        npz.add("a", &[3], &Array::F8(vec![1.0, 2.0, 3.0]));
        npz.add("b", &[2, 2], &Array::I8(vec![1, 2, 3, 4]));
        let bytes = npz.finish();
        let text: String = bytes.iter().map(|b| char::from(*b)).collect();
        assert!(text.contains("'shape': (3,)") && text.contains("'shape': (2, 2)"));
        assert!(bytes.starts_with(b"PK\x03\x04"));
    }
}
