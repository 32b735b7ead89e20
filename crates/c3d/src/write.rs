//! Converts [`C3dFile`] to bytes.
//!
//! Parameters and header start from those read and are changed only where they no longer agree with
//! the typed fields. Each stored sample is kept bit by bit as long as it decodes to the value in
//! memory, so that rewriting preserves coordinates of invalid points, unusual fourth words and raw
//! counts of channels whose scale is zero.

use crate::{
    ByteOrder, C3dError, C3dFile, Point, Storage,
    file::Source,
    header::{BLOCK, Header},
    layout::Layout,
    number::{Dec, Intel, Mips},
    parameter_sync, poses,
    samples::{Floats, Integers, Quad, fourth_word},
};

impl C3dFile {
    /// Writes the file in its [`C3dFile::byte_order`] and [`C3dFile::storage`].
    ///
    /// # Errors
    /// [`C3dError::Write`] if vectors differ in length, or something does not fit into the format:
    /// integers outside 16 bits, more than 65,535 points, parameters of more than 255 blocks.
    pub fn to_bytes(&self) -> Result<Vec<u8>, C3dError> {
        let layout = self.layout()?;
        let mut groups = parameter_sync::synchronized(self, &layout)?;
        // The position of the samples does not change the size of the section.
        let section = groups.to_bytes(self.byte_order)?.len();
        let data_start = BLOCK + section;
        parameter_sync::set_data_start(&mut groups, data_start / BLOCK + 1);
        let size = data_start + layout.frame_bytes() * layout.n_frames;
        if !self.poses.segments.is_empty() {
            parameter_sync::set_poses_start(&mut groups, size.div_ceil(BLOCK) + 1);
        }
        let section = groups.to_bytes(self.byte_order)?;

        let mut out = Vec::with_capacity(size.div_ceil(BLOCK) * BLOCK);
        out.extend_from_slice(&self.header_block(&layout, data_start));
        out.extend_from_slice(&section);
        self.push_samples(&layout, &mut out)?;
        if !self.poses.segments.is_empty() {
            out.resize(out.len().div_ceil(BLOCK) * BLOCK, 0);
            poses::push(self, &mut out);
        }
        // If the header cannot represent the number of frames, some readers (ezc3d) treat all
        // following bytes as frames.
        if layout.n_frames <= 65_535 {
            out.resize(out.len().div_ceil(BLOCK) * BLOCK, 0);
        }
        Ok(out)
    }

    /// Sizes, after checking that all vectors agree with them.
    pub(crate) fn layout(&self) -> Result<Layout, C3dError> {
        let fail = |item: String, problem: String| C3dError::Write { item, problem };
        let n = self.n_frames;
        for point in &self.points {
            let lengths = [point.xyz.len(), point.residual.len(), point.cameras.len()];
            if lengths.iter().any(|l| *l != n) {
                let problem = format!("{lengths:?} coordinates, residuals, camera masks, expected {n} of each");
                return Err(fail(format!("point {}", point.label), problem));
            }
        }
        let samples = self.analogs.first().map_or(0, |a| a.values.len());
        for analog in &self.analogs {
            if analog.values.len() != samples || samples.checked_rem(n).unwrap_or(samples) != 0 {
                let problem = format!("{} values, expected {samples}, a multiple of {n} frames", analog.values.len());
                return Err(fail(format!("channel {}", analog.label), problem));
            }
        }
        let samples_per_frame = if self.analogs.is_empty() { 0 } else { samples.checked_div(n).unwrap_or(0).max(1) };
        let stride = self.analogs.len() * samples_per_frame;
        if self.points.len() > 65_535 || stride > 65_535 {
            let problem =
                format!("{} points and {stride} analog numbers a frame, the format holds 65,535", self.points.len());
            return Err(fail("samples".into(), problem));
        }
        Ok(Layout {
            storage: self.storage,
            n_points: self.points.len(),
            n_channels: self.analogs.len(),
            samples_per_frame,
            n_frames: n,
        })
    }

    fn header_block(&self, layout: &Layout, data_start: usize) -> [u8; BLOCK] {
        let mut block = [0; BLOCK];
        let mut max_gap = 10;
        if let Some(source) = &self.source {
            block = *source.header;
            max_gap = source.order.u16([block[10], block[11]]);
            if source.order != self.byte_order {
                // Only the fields written below are preserved when the byte order changes.
                block = [0; BLOCK];
            }
        }
        let mut first_frame = self.first_frame as usize;
        let mut samples_per_frame = layout.samples_per_frame;
        if layout.n_channels == 0 {
            // Readers compare it with the ratio of the rates even without analog channels.
            samples_per_frame =
                self.source.as_ref().map_or(1, |s| usize::from(s.order.u16([s.header[18], s.header[19]])));
        }
        if self.source.as_ref().is_some_and(|s| s.frames_from_zero && self.first_frame == 1) {
            first_frame = 0;
        }
        let sign = if self.storage == Storage::Float { -1.0 } else { 1.0 };
        let header = Header {
            n_points: layout.n_points,
            analog_stride: layout.n_channels * layout.samples_per_frame,
            first_frame,
            last_frame: (first_frame + layout.n_frames).saturating_sub(1),
            max_gap,
            scale: sign * self.point_scale.abs(),
            data_start,
            samples_per_frame,
            rate_hz: self.point_rate_hz as f32,
            events: self.header_events.clone(),
        };
        header.write(&mut block, self.byte_order);
        block
    }

    fn push_samples(&self, layout: &Layout, out: &mut Vec<u8>) -> Result<(), C3dError> {
        // Offsets as they decode after storage; scales as stored in the parameters.
        let scales: Vec<(f64, f64)> = self
            .analogs
            .iter()
            .map(|a| (f64::from(a.scale as f32) * f64::from(self.analog_general_scale as f32), a.offset))
            .collect();
        let kept_points = self.source.as_ref().filter(|s| {
            let old = &s.layout;
            (old.storage, old.n_points, old.n_frames) == (layout.storage, layout.n_points, layout.n_frames)
                && s.point_scale == self.point_scale
        });
        let kept_analogs = self.source.as_ref().filter(|s| {
            let old = &s.layout;
            (old.storage, old.n_channels, old.n_frames) == (layout.storage, layout.n_channels, layout.n_frames)
                && old.samples_per_frame == layout.samples_per_frame
                && s.analog_unsigned == self.analog_unsigned
        });
        for frame in 0..layout.n_frames {
            for (i, point) in self.points.iter().enumerate() {
                let old = kept_points.and_then(|s| old_quad(s, frame, i));
                match old
                    .filter(|(bytes, order)| same_point(bytes, *order, layout.storage, self.point_scale, point, frame))
                {
                    Some((bytes, order)) => push_words(out, bytes, order, self.byte_order, layout.storage),
                    None => self.push_point(point, frame, out)?,
                }
            }
            for sample in 0..layout.samples_per_frame {
                let index = frame * layout.samples_per_frame + sample;
                for (i, analog) in self.analogs.iter().enumerate() {
                    let value = analog.values[index];
                    let (scale, offset) = scales[i];
                    let old = kept_analogs.and_then(|s| old_sample(s, frame, sample, i));
                    let same = |(bytes, order): &(&[u8], ByteOrder)| {
                        let raw = raw_number(bytes, *order, layout.storage, self.analog_unsigned);
                        let decoded = (raw - offset) * (analog.scale * self.analog_general_scale);
                        decoded.to_bits() == value.to_bits() || (decoded.is_nan() && value.is_nan()) || decoded == value
                    };
                    match old.filter(same) {
                        Some((bytes, order)) => push_words(out, bytes, order, self.byte_order, layout.storage),
                        None => self.push_analog(&analog.label, index, value, scale, offset, out)?,
                    }
                }
            }
        }
        Ok(())
    }

    fn push_point(&self, point: &Point, frame: usize, out: &mut Vec<u8>) -> Result<(), C3dError> {
        let (xyz, residual) = (point.xyz[frame], point.residual[frame]);
        let valid = !residual.is_nan() && xyz.iter().all(|x| !x.is_nan());
        let (xyz, word) = if valid {
            let low = if self.point_scale == 0.0 {
                0.0
            } else {
                (residual / self.point_scale.abs()).round().clamp(0.0, 255.0)
            };
            (xyz, i16::from(point.cameras[frame] & 0x7f) << 8 | i16::from(low as u8))
        } else {
            ([0.0; 3], -1)
        };
        match self.storage {
            Storage::Float => {
                for value in xyz.into_iter().chain([f32::from(word)]) {
                    out.extend_from_slice(&self.byte_order.f32_bytes(value));
                }
            }
            Storage::Integer => {
                for value in xyz {
                    let count = (value / self.point_scale.abs()).round();
                    if !(-32_768.0..=32_767.0).contains(&count) {
                        return Err(C3dError::Write {
                            item: format!("point {}, frame {}", point.label, frame + 1),
                            problem: format!("{value} at scale {} is not a 16-bit integer", self.point_scale),
                        });
                    }
                    out.extend_from_slice(&self.byte_order.u16_bytes(count as i16 as u16));
                }
                out.extend_from_slice(&self.byte_order.u16_bytes(word as u16));
            }
        }
        Ok(())
    }

    fn push_analog(
        &self,
        label: &str,
        index: usize,
        value: f64,
        scale: f64,
        offset: f64,
        out: &mut Vec<u8>,
    ) -> Result<(), C3dError> {
        let raw = if scale == 0.0 { offset } else { value / scale + offset };
        match self.storage {
            Storage::Float => out.extend_from_slice(&self.byte_order.f32_bytes(raw as f32)),
            Storage::Integer => {
                let range = if self.analog_unsigned { 0.0..=65_535.0 } else { -32_768.0..=32_767.0 };
                let count = raw.round();
                if !range.contains(&count) {
                    return Err(C3dError::Write {
                        item: format!("channel {label}, sample {}", index + 1),
                        problem: format!("{value} at scale {scale} and offset {offset} is not a 16-bit integer"),
                    });
                }
                out.extend_from_slice(&self.byte_order.u16_bytes(count as i32 as u16));
            }
        }
        Ok(())
    }
}

fn old_quad(source: &Source, frame: usize, point: usize) -> Option<(&[u8], ByteOrder)> {
    let size = 4 * source.layout.storage.word_bytes();
    let at = frame * source.layout.frame_bytes() + point * size;
    source.data.get(at..at + size).map(|b| (b, source.order))
}

fn old_sample(source: &Source, frame: usize, sample: usize, channel: usize) -> Option<(&[u8], ByteOrder)> {
    let layout = &source.layout;
    let size = layout.storage.word_bytes();
    let at = frame * layout.frame_bytes() + layout.point_bytes() + (sample * layout.n_channels + channel) * size;
    source.data.get(at..at + size).map(|b| (b, source.order))
}

fn same_point(bytes: &[u8], order: ByteOrder, storage: Storage, scale: f32, point: &Point, frame: usize) -> bool {
    let scale = scale.abs();
    let (xyz, residual, cameras) = match (storage, order) {
        (Storage::Float, ByteOrder::Intel) => Floats::<Intel>::read(bytes, scale),
        (Storage::Float, ByteOrder::Dec) => Floats::<Dec>::read(bytes, scale),
        (Storage::Float, ByteOrder::Mips) => Floats::<Mips>::read(bytes, scale),
        (Storage::Integer, ByteOrder::Intel | ByteOrder::Dec) => Integers::<Intel>::read(bytes, scale),
        (Storage::Integer, ByteOrder::Mips) => Integers::<Mips>::read(bytes, scale),
    };
    let same = |a: f32, b: f32| a == b || (a.is_nan() && b.is_nan());
    let now = point.xyz[frame];
    (0..3).all(|k| same(xyz[k], now[k])) && same(residual, point.residual[frame]) && cameras == point.cameras[frame]
}

fn raw_number(bytes: &[u8], order: ByteOrder, storage: Storage, unsigned: bool) -> f64 {
    match storage {
        Storage::Float => f64::from(order.f32([bytes[0], bytes[1], bytes[2], bytes[3]])),
        Storage::Integer => {
            let word = order.u16([bytes[0], bytes[1]]);
            if unsigned { f64::from(word) } else { f64::from(word as i16) }
        }
    }
}

/// Copies stored words, converting the byte order if it changes.
fn push_words(out: &mut Vec<u8>, bytes: &[u8], from: ByteOrder, to: ByteOrder, storage: Storage) {
    if from == to {
        out.extend_from_slice(bytes);
        return;
    }
    match storage {
        Storage::Integer => {
            for c in bytes.chunks_exact(2) {
                out.extend_from_slice(&to.u16_bytes(from.u16([c[0], c[1]])));
            }
        }
        Storage::Float => {
            for (k, c) in bytes.chunks_exact(4).enumerate() {
                let value = from.f32([c[0], c[1], c[2], c[3]]);
                // A point marked invalid by a fourth word of NaN stays invalid if NaN cannot be
                // written.
                let invalid = to == ByteOrder::Dec && k == 3 && bytes.len() == 16 && fourth_word(value) < 0;
                out.extend_from_slice(&to.f32_bytes(if invalid { -1.0 } else { value }));
            }
        }
    }
}
