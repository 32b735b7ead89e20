//! Bulk conversion of the sample section: stored frame by frame in the file, one vector per point
//! and channel in memory.
//!
//! Each loop is compiled once per byte order and storage. Frames are processed in tiles that fit
//! into the lowest-level caches, so that the strided reads of one tile hit lines already loaded and
//! the writes are sequential.

use crate::{
    Analog, ByteOrder, Point, Storage,
    layout::Layout,
    number::{Dec, Intel, Mips, Order},
};

/// Bytes of samples in one tile.
const TILE_BYTES: usize = 64 * 1024;

/// A stored point: coordinates and fourth word.
pub(crate) trait Quad {
    const BYTES: usize;
    /// Coordinates, residual and camera mask; NaN and 0 where the fourth word is negative as a
    /// 16-bit integer.
    fn read(bytes: &[u8], scale: f32) -> ([f32; 3], f32, u8);
}

/// A stored analog number.
pub(crate) trait Sample {
    const BYTES: usize;
    fn read(bytes: &[u8]) -> f64;
}

pub(crate) struct Floats<O>(std::marker::PhantomData<O>);
pub(crate) struct Integers<O>(std::marker::PhantomData<O>);
pub(crate) struct Unsigned<O>(std::marker::PhantomData<O>);

#[inline(always)]
fn finish(xyz: [f32; 3], word: i16, scale: f32) -> ([f32; 3], f32, u8) {
    let residual = f32::from(word as u8) * scale;
    if word < 0 { ([f32::NAN; 3], f32::NAN, 0) } else { (xyz, residual, (word >> 8) as u8) }
}

/// The fourth word of a float file as the integer that it represents: 16 bits, written as signed
/// (−1) by some programs and unsigned (65,535) by others. Negative values and NaN are invalid; of
/// values outside 16 bits only the sign is used.
#[inline(always)]
pub(crate) fn fourth_word(value: f32) -> i16 {
    let word = value as i32;
    let word = if word > 65_535 { 0 } else { word as i16 };
    if value >= 0.0 { word } else { -1 }
}

impl<O: Order> Quad for Floats<O> {
    const BYTES: usize = 16;
    #[inline(always)]
    fn read(b: &[u8], scale: f32) -> ([f32; 3], f32, u8) {
        let float = |i: usize| O::f32([b[i], b[i + 1], b[i + 2], b[i + 3]]);
        finish([float(0), float(4), float(8)], fourth_word(float(12)), scale)
    }
}

impl<O: Order> Quad for Integers<O> {
    const BYTES: usize = 8;
    #[inline(always)]
    fn read(b: &[u8], scale: f32) -> ([f32; 3], f32, u8) {
        let word = |i: usize| O::i16([b[i], b[i + 1]]);
        let coordinate = |i: usize| f32::from(word(i)) * scale;
        finish([coordinate(0), coordinate(2), coordinate(4)], word(6), scale)
    }
}

impl<O: Order> Sample for Floats<O> {
    const BYTES: usize = 4;
    #[inline(always)]
    fn read(b: &[u8]) -> f64 {
        f64::from(O::f32([b[0], b[1], b[2], b[3]]))
    }
}

impl<O: Order> Sample for Integers<O> {
    const BYTES: usize = 2;
    #[inline(always)]
    fn read(b: &[u8]) -> f64 {
        f64::from(O::i16([b[0], b[1]]))
    }
}

impl<O: Order> Sample for Unsigned<O> {
    const BYTES: usize = 2;
    #[inline(always)]
    fn read(b: &[u8]) -> f64 {
        f64::from(O::i16([b[0], b[1]]) as u16)
    }
}

/// Conversion of raw analog numbers to values: `(raw − offset) × scale`, with the general scale
/// included in `scale`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct AnalogScale {
    pub offset: f64,
    pub scale: f64,
}

/// Frames in a tile.
fn tile_frames(layout: &Layout) -> usize {
    (TILE_BYTES / layout.frame_bytes().max(1)).clamp(1, 512)
}

/// Fills the points' vectors from `data`, which holds exactly the frames of the layout.
pub(crate) fn decode_points(data: &[u8], layout: &Layout, order: ByteOrder, scale: f32, points: &mut [Point]) {
    let scale = scale.abs();
    match (layout.storage, order) {
        (Storage::Float, ByteOrder::Intel) => points_as::<Floats<Intel>>(data, layout, scale, points),
        (Storage::Float, ByteOrder::Dec) => points_as::<Floats<Dec>>(data, layout, scale, points),
        (Storage::Float, ByteOrder::Mips) => points_as::<Floats<Mips>>(data, layout, scale, points),
        (Storage::Integer, ByteOrder::Intel) => points_as::<Integers<Intel>>(data, layout, scale, points),
        (Storage::Integer, ByteOrder::Dec) => points_as::<Integers<Dec>>(data, layout, scale, points),
        (Storage::Integer, ByteOrder::Mips) => points_as::<Integers<Mips>>(data, layout, scale, points),
    }
}

fn points_as<Q: Quad>(data: &[u8], layout: &Layout, scale: f32, points: &mut [Point]) {
    let frame_bytes = layout.frame_bytes();
    if frame_bytes == 0 {
        return;
    }
    let n = layout.n_frames;
    for point in points.iter_mut() {
        point.xyz = vec![[0.0; 3]; n];
        point.residual = vec![0.0; n];
        point.cameras = vec![0; n];
    }
    let step = tile_frames(layout);
    let mut start = 0;
    for tile in data.chunks(step * frame_bytes) {
        let end = start + tile.len() / frame_bytes;
        for (i, point) in points.iter_mut().enumerate() {
            let at = i * Q::BYTES;
            let out = point.xyz[start..end]
                .iter_mut()
                .zip(&mut point.residual[start..end])
                .zip(&mut point.cameras[start..end]);
            for (frame, ((xyz, residual), cameras)) in tile.chunks_exact(frame_bytes).zip(out) {
                (*xyz, *residual, *cameras) = Q::read(&frame[at..at + Q::BYTES], scale);
            }
        }
        start = end;
    }
}

/// Fills the channels' vectors from `data`, which holds exactly the frames of the layout.
pub(crate) fn decode_analogs(
    data: &[u8],
    layout: &Layout,
    order: ByteOrder,
    unsigned: bool,
    scales: &[AnalogScale],
    analogs: &mut [Analog],
) {
    match (layout.storage, order, unsigned) {
        (Storage::Float, ByteOrder::Intel, _) => analogs_as::<Floats<Intel>>(data, layout, scales, analogs),
        (Storage::Float, ByteOrder::Dec, _) => analogs_as::<Floats<Dec>>(data, layout, scales, analogs),
        (Storage::Float, ByteOrder::Mips, _) => analogs_as::<Floats<Mips>>(data, layout, scales, analogs),
        (Storage::Integer, ByteOrder::Mips, false) => analogs_as::<Integers<Mips>>(data, layout, scales, analogs),
        (Storage::Integer, ByteOrder::Mips, true) => analogs_as::<Unsigned<Mips>>(data, layout, scales, analogs),
        (Storage::Integer, _, false) => analogs_as::<Integers<Intel>>(data, layout, scales, analogs),
        (Storage::Integer, _, true) => analogs_as::<Unsigned<Intel>>(data, layout, scales, analogs),
    }
}

fn analogs_as<S: Sample>(data: &[u8], layout: &Layout, scales: &[AnalogScale], analogs: &mut [Analog]) {
    let (frame_bytes, point_bytes, per_frame) = (layout.frame_bytes(), layout.point_bytes(), layout.samples_per_frame);
    let sample_bytes = layout.n_channels * S::BYTES;
    if frame_bytes == 0 || sample_bytes == 0 || per_frame == 0 {
        return;
    }
    for analog in analogs.iter_mut() {
        analog.values = vec![0.0; layout.n_frames * per_frame];
    }
    let step = tile_frames(layout);
    let mut start = 0;
    for tile in data.chunks(step * frame_bytes) {
        let end = start + tile.len() / frame_bytes * per_frame;
        for (i, (analog, by)) in analogs.iter_mut().zip(scales).enumerate() {
            let at = i * S::BYTES;
            let out = analog.values[start..end].chunks_exact_mut(per_frame);
            for (frame, values) in tile.chunks_exact(frame_bytes).zip(out) {
                for (sample, value) in frame[point_bytes..].chunks_exact(sample_bytes).zip(values) {
                    *value = (S::read(&sample[at..at + S::BYTES]) - by.offset) * by.scale;
                }
            }
        }
        start = end;
    }
}
