//! The first 512 bytes: sizes, rates, positions of the sections, and up to 18 events.

use crate::{ByteOrder, Storage, text};

/// Size of the header and of every block, bytes.
pub(crate) const BLOCK: usize = 512;
/// Indicates event labels of four characters, and the presence of a label section.
const KEY: u16 = 0x3039;

/// An event of the header.
#[derive(Debug, Clone, PartialEq)]
pub struct HeaderEvent {
    /// Label, at most four characters.
    pub label: String,
    /// Seconds on the clock of the original trial.
    pub time_s: f32,
    /// Whether programs should show it.
    pub shown: bool,
}

/// Compares bit by bit, so that a time of NaN equals itself.
fn same_events(a: &[HeaderEvent], b: &[HeaderEvent]) -> bool {
    let same = |a: &HeaderEvent, b: &HeaderEvent| {
        a.label == b.label && a.time_s.to_bits() == b.time_s.to_bits() && a.shown == b.shown
    };
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b))
}

/// A label truncated to four bytes, one byte per character if that decodes to the same label.
fn four_bytes(label: &str) -> [u8; 4] {
    let mut out = [b' '; 4];
    let single: Vec<u8> = label.chars().take(4).filter_map(|c| u8::try_from(u32::from(c)).ok()).collect();
    let whole: String = label.chars().take(4).collect();
    if text::decode(&single) == whole.trim() {
        out[..single.len()].copy_from_slice(&single);
    } else {
        let end = (0..=4.min(label.len())).rev().find(|n| label.is_char_boundary(*n)).unwrap_or(0);
        out[..end].copy_from_slice(&label.as_bytes()[..end]);
    }
    out
}

/// The header as stored.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Header {
    pub n_points: usize,
    /// Analog numbers in one frame: channels times samples.
    pub analog_stride: usize,
    pub first_frame: usize,
    pub last_frame: usize,
    pub max_gap: u16,
    pub scale: f32,
    /// Offset of the samples, bytes.
    pub data_start: usize,
    pub samples_per_frame: usize,
    pub rate_hz: f32,
    pub events: Vec<HeaderEvent>,
}

impl Header {
    /// Parses a block of 512 bytes.
    pub fn read(block: &[u8; BLOCK], order: ByteOrder) -> Self {
        let word = |at: usize| order.u16([block[at], block[at + 1]]);
        let float = |at: usize| order.f32([block[at], block[at + 1], block[at + 2], block[at + 3]]);
        let mut events = Vec::new();
        // Some writers store the key in their own byte order, whatever the order of the file.
        if word(298) == KEY || word(298).swap_bytes() == KEY {
            for i in 0..usize::from(word(300)).min(18) {
                events.push(HeaderEvent {
                    label: text::decode(&block[396 + 4 * i..400 + 4 * i]),
                    time_s: float(304 + 4 * i),
                    shown: block[376 + i] == 1,
                });
            }
        }
        Self {
            n_points: usize::from(word(2)),
            analog_stride: usize::from(word(4)),
            first_frame: usize::from(word(6)),
            last_frame: usize::from(word(8)),
            max_gap: word(10),
            scale: float(12),
            data_start: usize::from(word(16)).saturating_sub(1) * BLOCK,
            samples_per_frame: usize::from(word(18)),
            rate_hz: float(20),
            events,
        }
    }

    /// Writes the known fields into `block`, which may contain the bytes of an older header.
    pub fn write(&self, block: &mut [u8; BLOCK], order: ByteOrder) {
        let word = |block: &mut [u8; BLOCK], at: usize, value: usize| {
            let value = u16::try_from(value).unwrap_or(u16::MAX);
            block[at..at + 2].copy_from_slice(&order.u16_bytes(value));
        };
        block[0] = 2;
        block[1] = 0x50;
        word(block, 2, self.n_points);
        word(block, 4, self.analog_stride);
        word(block, 6, self.first_frame);
        word(block, 8, self.last_frame);
        word(block, 10, usize::from(self.max_gap));
        block[12..16].copy_from_slice(&order.f32_bytes(self.scale));
        word(block, 16, self.data_start / BLOCK + 1);
        word(block, 18, self.samples_per_frame);
        block[20..24].copy_from_slice(&order.f32_bytes(self.rate_hz));
        if !same_events(&Self::read(block, order).events, &self.events) {
            word(block, 298, usize::from(KEY));
            word(block, 300, self.events.len().min(18));
            block[304..468].fill(0);
            for (i, event) in self.events.iter().take(18).enumerate() {
                block[304 + 4 * i..308 + 4 * i].copy_from_slice(&order.f32_bytes(event.time_s));
                block[376 + i] = u8::from(event.shown);
                block[396 + 4 * i..400 + 4 * i].copy_from_slice(&four_bytes(&event.label));
            }
        }
    }

    /// Storage of the samples according to the header: a negative scale means floats.
    pub fn storage(&self) -> Storage {
        if self.scale < 0.0 { Storage::Float } else { Storage::Integer }
    }
}
