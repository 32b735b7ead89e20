//! Number formats of three processor families.
//!
//! Lowest level of the crate: bulk loops are generic over [`Order`], so that each (order, storage)
//! pair compiles to its own loop without a branch per sample.

/// Processor family whose number formats a file uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ByteOrder {
    /// Little-endian integers, little-endian IEEE floats. Processor byte 84.
    #[default]
    Intel,
    /// Little-endian integers, VAX F floats. Processor byte 85.
    Dec,
    /// Big-endian integers, big-endian IEEE floats. Processor byte 86.
    Mips,
}

impl ByteOrder {
    /// From the processor byte of the parameter section.
    pub(crate) fn from_processor(byte: u8) -> Option<Self> {
        match byte {
            84 => Some(Self::Intel),
            85 => Some(Self::Dec),
            86 => Some(Self::Mips),
            _ => None,
        }
    }
    /// The processor byte of the parameter section.
    pub fn processor(self) -> u8 {
        match self {
            Self::Intel => 84,
            Self::Dec => 85,
            Self::Mips => 86,
        }
    }
    /// Decodes an unsigned word.
    pub fn u16(self, bytes: [u8; 2]) -> u16 {
        match self {
            Self::Intel | Self::Dec => u16::from_le_bytes(bytes),
            Self::Mips => u16::from_be_bytes(bytes),
        }
    }
    /// Decodes a float.
    pub fn f32(self, bytes: [u8; 4]) -> f32 {
        match self {
            Self::Intel => Intel::f32(bytes),
            Self::Dec => Dec::f32(bytes),
            Self::Mips => Mips::f32(bytes),
        }
    }
    /// Encodes an unsigned word.
    pub(crate) fn u16_bytes(self, value: u16) -> [u8; 2] {
        match self {
            Self::Intel | Self::Dec => value.to_le_bytes(),
            Self::Mips => value.to_be_bytes(),
        }
    }
    /// Encodes a float. DEC has neither infinities nor NaN: infinities become the largest number of
    /// the same sign, and NaN becomes zero.
    pub(crate) fn f32_bytes(self, value: f32) -> [u8; 4] {
        match self {
            Self::Intel => value.to_le_bytes(),
            Self::Mips => value.to_be_bytes(),
            Self::Dec => dec_bits(value).to_le_bytes(),
        }
    }
}

/// Storage of samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Storage {
    /// 16-bit integers times a scale.
    Integer,
    /// 32-bit floats.
    #[default]
    Float,
}

impl Storage {
    /// Bytes of one stored number.
    pub fn word_bytes(self) -> usize {
        match self {
            Self::Integer => 2,
            Self::Float => 4,
        }
    }
}

/// A byte order known at compile time.
pub(crate) trait Order {
    fn i16(bytes: [u8; 2]) -> i16;
    fn f32(bytes: [u8; 4]) -> f32;
}

pub(crate) struct Intel;
pub(crate) struct Dec;
pub(crate) struct Mips;

impl Order for Intel {
    #[inline(always)]
    fn i16(bytes: [u8; 2]) -> i16 {
        i16::from_le_bytes(bytes)
    }
    #[inline(always)]
    fn f32(bytes: [u8; 4]) -> f32 {
        f32::from_le_bytes(bytes)
    }
}

impl Order for Mips {
    #[inline(always)]
    fn i16(bytes: [u8; 2]) -> i16 {
        i16::from_be_bytes(bytes)
    }
    #[inline(always)]
    fn f32(bytes: [u8; 4]) -> f32 {
        f32::from_be_bytes(bytes)
    }
}

impl Order for Dec {
    #[inline(always)]
    fn i16(bytes: [u8; 2]) -> i16 {
        i16::from_le_bytes(bytes)
    }
    /// VAX F: words swapped, exponent biased by 128 and a hidden bit worth one half, so that
    /// reading the bits as IEEE gives four times the value. Exponent zero means zero (VAX has no
    /// subnormals; negative zero caused a trap and is read as zero).
    #[inline(always)]
    fn f32(bytes: [u8; 4]) -> f32 {
        let bits = u32::from_le_bytes(bytes).rotate_left(16);
        let exponent = (bits >> 23) & 0xff;
        if exponent >= 3 {
            f32::from_bits(bits - (2 << 23))
        } else if exponent == 0 {
            0.0
        } else {
            f32::from_bits(bits) * 0.25
        }
    }
}

/// The VAX F bits of a number, as the little-endian word written to the file.
fn dec_bits(value: f32) -> u32 {
    let bits = value.to_bits();
    let sign = bits & 0x8000_0000;
    let exponent = (bits >> 23) & 0xff;
    let vax = if value.is_nan() {
        0
    } else if exponent >= 254 {
        sign | 0x7fff_ffff
    } else if exponent >= 1 {
        bits + (2 << 23)
    } else {
        // IEEE subnormals: the largest ones fit into VAX's two lowest exponents, the others become
        // zero.
        let scaled = value * 4.0;
        if (scaled.to_bits() >> 23) & 0xff == 0 { 0 } else { scaled.to_bits() }
    };
    vax.rotate_left(16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn validate_dec_floats_from_the_vax_manual() {
        // 1.0 is 0x00004080 and -1.0 is 0x0000c080 on a VAX; 100.0 is 0x000043c8.
        assert_eq!(ByteOrder::Dec.f32(0x0000_4080_u32.to_le_bytes()), 1.0);
        assert_eq!(ByteOrder::Dec.f32(0x0000_c080_u32.to_le_bytes()), -1.0);
        assert_eq!(ByteOrder::Dec.f32(0x0000_43c8_u32.to_le_bytes()), 100.0);
        assert_eq!(ByteOrder::Dec.f32([0; 4]), 0.0);
    }

    #[test]
    fn floats_survive_every_order() {
        let mut bits = 0x1234_5678_u32;
        for _ in 0..200_000 {
            bits = bits.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let value = f32::from_bits(bits);
            for order in [ByteOrder::Intel, ByteOrder::Mips] {
                assert_eq!(order.f32(order.f32_bytes(value)).to_bits(), bits);
            }
            let dec = ByteOrder::Dec.f32(ByteOrder::Dec.f32_bytes(value));
            if value.is_normal() && value.abs() < 1.7e38 {
                assert_eq!(dec, value);
            } else if value.is_finite() && value.abs() < 1.0 {
                assert!((dec - value).abs() < f32::MIN_POSITIVE);
            }
        }
    }
}
