//! The zero-phase filter on many channels at once.
//!
//! The recursion of a filter is serial in time but independent between channels, so groups of
//! channels are processed in parallel in SIMD lanes. Data is processed in blocks of frames that
//! stay in the lowest-level cache. Channel-major data is transposed into lanes block by block and
//! stays in that layout between the two passes; frame-major data is already in lanes and is
//! filtered in place. The results equal those of [`Butterworth::filtfilt`] bit for bit, on every
//! processor.

use crate::butterworth::{Butterworth, MAX_ORDER, Section};
use std::ops::Range;

/// Number of channels in a group.
const LANES: usize = 8;
/// Number of frames of a group that are processed together, a multiple of [`LANES`].
const BLOCK: usize = 32;
/// Maximum number of reflected samples on each side.
const MAX_PADDING: usize = 3 * (MAX_ORDER + 1);

type Frame = [f64; LANES];

impl Butterworth {
    /// [`Butterworth::filtfilt`] of every channel of frame-major data, `data[frame * channels +
    /// channel]`, in place. Trailing values that do not fill a frame are unchanged. Returns the
    /// number of samples lost in runs that are too short.
    pub fn filtfilt_interleaved(&self, data: &mut [f64], channels: usize) -> usize {
        if channels == 0 {
            return 0;
        }
        let n = data.len() / channels;
        let data = &mut data[..n * channels];
        if all_finite(data) {
            return self.interleaved_run(data, channels);
        }
        // Runs common to all channels, if they are the same in all.
        let (mut lost, mut begin) = (0, 0);
        let missing = |frame: &[f64]| frame.iter().filter(|x| !x.is_finite()).count();
        if data.chunks_exact(channels).all(|frame| [0, channels].contains(&missing(frame))) {
            while begin < n {
                let seen = |f: &usize| data[f * channels].is_finite();
                let first = (begin..n).find(seen).unwrap_or(n);
                let end = (first..n).find(|f| !seen(f)).unwrap_or(n);
                lost += self.interleaved_run(&mut data[first * channels..end * channels], channels);
                begin = end;
            }
            return lost;
        }
        let mut channel = vec![0.0; n];
        for c in 0..channels {
            for (x, frame) in channel.iter_mut().zip(data.chunks_exact(channels)) {
                *x = frame[c];
            }
            lost += self.filtfilt(&mut channel);
            for (x, frame) in channel.iter().zip(data.chunks_exact_mut(channels)) {
                frame[c] = *x;
            }
        }
        lost
    }

    /// [`Butterworth::filtfilt`] of every channel of channel-major data, `data[channel * samples +
    /// sample]`, in place. Trailing values that do not fill a channel are unchanged. Returns the
    /// number of samples lost in runs that are too short.
    pub fn filtfilt_channels(&self, data: &mut [f64], samples: usize) -> usize {
        if samples == 0 {
            return 0;
        }
        let channels = data.len() / samples;
        let mut lost = 0;
        let mut lanes: Vec<Frame> = Vec::new();
        for group in data[..channels * samples].chunks_mut(LANES * samples) {
            let whole = samples > self.padding() && self.channel_group(group, samples, &mut lanes);
            if !whole {
                lost += group.chunks_exact_mut(samples).map(|channel| self.filtfilt(channel)).sum::<usize>();
            }
        }
        lost
    }

    /// A frame-major run without missing samples.
    fn interleaved_run(&self, data: &mut [f64], channels: usize) -> usize {
        let n = data.len() / channels;
        if n <= self.padding() {
            data.fill(f64::NAN);
            return data.len();
        }
        dispatch(self, Interleaved { data, channels, pad: self.padding() });
        0
    }

    /// Up to [`LANES`] channels, one after the other; `false`, with nothing changed, when a sample
    /// is missing.
    fn channel_group(&self, data: &mut [f64], samples: usize, lanes: &mut Vec<Frame>) -> bool {
        lanes.resize(samples.next_multiple_of(BLOCK), [0.0; LANES]);
        dispatch(self, ChannelMajor { data, samples, lanes, pad: self.padding() })
    }
}

/// Filtering of one data layout, compiled for a number of sections.
trait Arrangement {
    fn run<const PAIRS: usize, const ODD: bool>(self, filter: &Cascade<PAIRS, ODD>) -> bool;
}

/// Runs a layout with the widest vectors of this processor. Code that is not inlined into the
/// closure would be compiled for the oldest one.
fn dispatch<A: Arrangement>(filter: &Butterworth, arrangement: A) -> bool {
    pulp::Arch::new().dispatch(
        #[inline(always)]
        || {
            let s = filter.sections();
            match filter.order() {
                // Common orders have their own compiled code; the others share one loop over their
                // sections.
                1 => arrangement.run(&Cascade::<0, true>::new(s)),
                2 => arrangement.run(&Cascade::<1, false>::new(s)),
                3 => arrangement.run(&Cascade::<1, true>::new(s)),
                4 => arrangement.run(&Cascade::<2, false>::new(s)),
                order if order % 2 == 1 => arrangement.run(&Cascade::<{ MAX_ORDER / 2 }, true>::new(s)),
                _ => arrangement.run(&Cascade::<{ MAX_ORDER / 2 }, false>::new(s)),
            }
        },
    )
}

/// The sections with the numerators of a low-pass: b(1 + z⁻¹) and b(1 + z⁻¹)². Doubling is exact,
/// so the rounding is the same as in [`Section`].
struct Cascade<const PAIRS: usize, const ODD: bool> {
    first: Section,
    pairs: [Section; PAIRS],
    /// Number of sections of `pairs` in use: all of them except in the shared cascade of high
    /// orders.
    used: usize,
}

/// States of all lanes.
#[derive(Clone, Copy)]
struct States<const PAIRS: usize> {
    first: Frame,
    pairs: [[Frame; 2]; PAIRS],
}

impl<const PAIRS: usize, const ODD: bool> Cascade<PAIRS, ODD> {
    #[inline(always)]
    fn new(sections: &[Section]) -> Self {
        // An odd order begins with its single pole; otherwise the field is not used.
        let used = if PAIRS == MAX_ORDER / 2 { sections.len() - usize::from(ODD) } else { PAIRS };
        let pair = |i: usize| sections[i.min(used.saturating_sub(1)) + usize::from(ODD)];
        Self { first: sections[0], pairs: std::array::from_fn(pair), used }
    }

    #[inline(always)]
    fn steady(&self, x: &Frame) -> States<PAIRS> {
        let [first, _] = self.first.steady_state();
        States {
            first: x.map(|x| first * x),
            pairs: std::array::from_fn(|i| self.pairs[i].steady_state().map(|unit| x.map(|x| unit * x))),
        }
    }

    #[inline(always)]
    fn step(&self, x: &Frame, z: &mut States<PAIRS>) -> Frame {
        let mut x = *x;
        if ODD {
            let s = &self.first;
            for lane in 0..LANES {
                let g = s.b[0] * x[lane];
                let y = g + z.first[lane];
                z.first[lane] = g - s.a[0] * y;
                x[lane] = y;
            }
        }
        for (s, z) in self.pairs[..self.used].iter().zip(&mut z.pairs) {
            for lane in 0..LANES {
                let g = s.b[0] * x[lane];
                let y = g + z[0][lane];
                z[0][lane] = (2.0 * g + z[1][lane]) - s.a[0] * y;
                z[1][lane] = g - s.a[1] * y;
                x[lane] = y;
            }
        }
        x
    }

    #[inline(always)]
    fn pass<'a>(&self, z: &mut States<PAIRS>, frames: impl Iterator<Item = &'a mut Frame>) {
        let mut states = *z;
        for frame in frames {
            *frame = self.step(frame, &mut states);
        }
        *z = states;
    }
}

struct Interleaved<'a> {
    data: &'a mut [f64],
    channels: usize,
    pad: usize,
}

impl Arrangement for Interleaved<'_> {
    #[inline(always)]
    fn run<const PAIRS: usize, const ODD: bool>(self, filter: &Cascade<PAIRS, ODD>) -> bool {
        let Self { data, channels, pad } = self;
        let n = data.len() / channels;
        let groups: Vec<Range<usize>> = (0..channels).step_by(LANES).map(|c| c..(c + LANES).min(channels)).collect();
        let mut head = [[0.0; LANES]; MAX_PADDING];
        let mut tails = vec![[[0.0; LANES]; MAX_PADDING]; groups.len()];
        let mut states: Vec<States<PAIRS>> = Vec::with_capacity(groups.len());
        for (group, tail) in groups.iter().zip(&mut tails) {
            let at = |f: usize| load(&data[f * channels..], group);
            for i in 0..pad {
                head[i] = reflect(&at(0), &at(pad - i));
                tail[i] = reflect(&at(n - 1), &at(n - 2 - i));
            }
            let mut z = filter.steady(&head[0]);
            filter.pass(&mut z, head[..pad].iter_mut());
            states.push(z);
        }
        for block in data.chunks_mut(BLOCK * channels) {
            fetch(block);
            for (group, states) in groups.iter().zip(&mut states) {
                let mut z = *states;
                for frame in block.chunks_exact_mut(channels) {
                    in_place(frame, group, |x| filter.step(x, &mut z));
                }
                *states = z;
            }
        }
        for (tail, z) in tails.iter_mut().zip(&mut states) {
            filter.pass(z, tail[..pad].iter_mut());
            *z = filter.steady(&tail[pad - 1]);
            filter.pass(z, tail[..pad].iter_mut().rev());
        }
        for block in data.chunks_mut(BLOCK * channels).rev() {
            fetch(block);
            for (group, states) in groups.iter().zip(&mut states) {
                let mut z = *states;
                for frame in block.chunks_exact_mut(channels).rev() {
                    in_place(frame, group, |x| filter.step(x, &mut z));
                }
                *states = z;
            }
        }
        true
    }
}

/// Reads a block once from end to end. Groups access it one cache line at a time in a pattern that
/// the processor's prefetcher does not recognise; on data larger than the caches this doubles the
/// speed.
#[inline(always)]
fn fetch(block: &[f64]) {
    std::hint::black_box(all_finite(block));
}

#[inline(always)]
fn load(frame: &[f64], group: &Range<usize>) -> Frame {
    let mut x = [0.0; LANES];
    x[..group.len()].copy_from_slice(&frame[group.clone()]);
    x
}

#[inline(always)]
fn in_place(frame: &mut [f64], group: &Range<usize>, f: impl FnOnce(&Frame) -> Frame) {
    let part = &mut frame[group.clone()];
    if let Some(whole) = part.first_chunk_mut::<LANES>() {
        *whole = f(whole);
    } else {
        let mut x = [0.0; LANES];
        x[..part.len()].copy_from_slice(part);
        let y = f(&x);
        part.copy_from_slice(&y[..part.len()]);
    }
}

struct ChannelMajor<'a> {
    data: &'a mut [f64],
    samples: usize,
    lanes: &'a mut [Frame],
    pad: usize,
}

impl ChannelMajor<'_> {
    #[inline(always)]
    fn load(&self, start: usize, out: &mut [Frame]) {
        if self.data.len() == LANES * self.samples
            && out.len().is_multiple_of(LANES)
            && start + out.len() <= self.samples
        {
            for (i, square) in out.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
                let rows: [Frame; LANES] = std::array::from_fn(|lane| {
                    let at = lane * self.samples + start + i * LANES;
                    self.data[at..at + LANES].try_into().unwrap_or([0.0; LANES])
                });
                *square = transposed(&rows);
            }
        } else {
            for (lane, channel) in self.data.chunks_exact(self.samples).enumerate() {
                for (out, x) in out.iter_mut().zip(&channel[start..]) {
                    out[lane] = *x;
                }
            }
        }
    }

    #[inline(always)]
    fn store(&mut self, start: usize, from: &[Frame]) {
        if self.data.len() == LANES * self.samples
            && from.len().is_multiple_of(LANES)
            && start + from.len() <= self.samples
        {
            for (i, square) in from.as_chunks::<LANES>().0.iter().enumerate() {
                for (lane, row) in transposed(square).iter().enumerate() {
                    let at = lane * self.samples + start + i * LANES;
                    self.data[at..at + LANES].copy_from_slice(row);
                }
            }
        } else {
            for (lane, channel) in self.data.chunks_exact_mut(self.samples).enumerate() {
                for (from, x) in from.iter().zip(&mut channel[start..]) {
                    *x = from[lane];
                }
            }
        }
    }
}

impl Arrangement for ChannelMajor<'_> {
    #[inline(always)]
    fn run<const PAIRS: usize, const ODD: bool>(mut self, filter: &Cascade<PAIRS, ODD>) -> bool {
        let (n, pad) = (self.samples, self.pad);
        let lanes = std::mem::take(&mut self.lanes);
        let mut edge = [[0.0; LANES]; MAX_PADDING + 1];
        let mut head = [[0.0; LANES]; MAX_PADDING];
        let mut tail = [[0.0; LANES]; MAX_PADDING];
        self.load(0, &mut edge[..=pad]);
        for i in 0..pad {
            head[i] = reflect(&edge[0], &edge[pad - i]);
        }
        self.load(n - 1 - pad, &mut edge[..=pad]);
        for i in 0..pad {
            tail[i] = reflect(&edge[pad], &edge[pad - 1 - i]);
        }
        let mut z = filter.steady(&head[0]);
        filter.pass(&mut z, head[..pad].iter_mut());
        for (b, frames) in lanes[..n].chunks_mut(BLOCK).enumerate() {
            self.load(b * BLOCK, frames);
            filter.pass(&mut z, frames.iter_mut());
        }
        filter.pass(&mut z, tail[..pad].iter_mut());
        // A missing sample stays in the states once it has entered: detected here, before anything
        // is written.
        if !all_finite(&tail[pad - 1]) {
            return false;
        }
        z = filter.steady(&tail[pad - 1]);
        filter.pass(&mut z, tail[..pad].iter_mut().rev());
        for (b, frames) in lanes[..n].chunks_mut(BLOCK).enumerate().rev() {
            filter.pass(&mut z, frames.iter_mut().rev());
            self.store(b * BLOCK, frames);
        }
        true
    }
}

#[inline(always)]
fn transposed(square: &[Frame; LANES]) -> [Frame; LANES] {
    std::array::from_fn(|i| std::array::from_fn(|j| square[j][i]))
}

#[inline(always)]
fn reflect(about: &Frame, x: &Frame) -> Frame {
    std::array::from_fn(|lane| 2.0 * about[lane] - x[lane])
}

/// A product with zero is zero unless the sample is NaN or infinite.
fn all_finite(values: &[f64]) -> bool {
    let mut sums = [0.0; LANES];
    let (chunks, rest) = values.as_chunks::<LANES>();
    for chunk in chunks {
        for (s, x) in sums.iter_mut().zip(chunk) {
            *s += x * 0.0;
        }
    }
    sums.iter().sum::<f64>() + rest.iter().map(|x| x * 0.0).sum::<f64>() == 0.0
}
