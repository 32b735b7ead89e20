//! The zero-phase filter on many channels at once.
//!
//! The recursion of a filter is serial in time but independent between channels, so groups of channels run side by side in the lanes of
//! the processor's vectors. Each group goes through in blocks of frames that stay in the nearest cache: the first pass loads a block and
//! filters it, the second filters a block and stores it. The arithmetic of a lane is that of [`Butterworth::filtfilt`], operation for
//! operation, so the numbers are the same to the last bit on every processor.

use crate::butterworth::{Butterworth, MAX_SECTIONS, Section};
use crate::runs::runs_where;
use std::ops::Range;

/// Channels in a group.
const LANES: usize = 16;
/// Frames of a group that are handled together.
const BLOCK: usize = 64;

type Frame = [f64; LANES];

impl Butterworth {
    /// [`Butterworth::filtfilt`] of every channel of frame-major data, `data[frame * channels + channel]`, in place.
    /// Trailing values that do not fill a frame are left alone. Returns how many samples were lost in runs that are too short.
    pub fn filtfilt_interleaved(&self, data: &mut [f64], channels: usize) -> usize {
        if channels == 0 {
            return 0;
        }
        let n = data.len() / channels;
        self.filter_groups(data, Layout { channels, samples: n, channel_stride: 1, frame_stride: channels })
    }

    /// [`Butterworth::filtfilt`] of every channel of channel-major data, `data[channel * samples + sample]`, in place.
    /// Trailing values that do not fill a channel are left alone. Returns how many samples were lost in runs that are too short.
    pub fn filtfilt_channels(&self, data: &mut [f64], samples: usize) -> usize {
        if samples == 0 {
            return 0;
        }
        let channels = data.len() / samples;
        self.filter_groups(data, Layout { channels, samples, channel_stride: samples, frame_stride: 1 })
    }

    fn filter_groups(&self, data: &mut [f64], layout: Layout) -> usize {
        let mut lost = 0;
        let mut extended: Vec<Frame> = Vec::new();
        for first in (0..layout.channels).step_by(LANES) {
            let group = Group { layout, first, lanes: LANES.min(layout.channels - first) };
            let Some(runs) = group.common_runs(data) else {
                lost += group.filter_one_by_one(self, data);
                continue;
            };
            for run in runs {
                if run.len() <= self.padding() {
                    lost += run.len() * group.lanes;
                    group.fill_missing(data, run);
                } else {
                    self.filter_run(data, group, run, &mut extended);
                }
            }
        }
        lost
    }

    fn filter_run(&self, data: &mut [f64], group: Group, run: Range<usize>, extended: &mut Vec<Frame>) {
        let pad = self.padding();
        extended.resize(run.len() + 2 * pad, [0.0; LANES]);
        let arch = pulp::Arch::new();
        // called inside, not through a pointer: only what is inlined here is compiled for the wide vectors;
        // and one kernel a number of sections, so that all states stay in registers
        arch.dispatch(
            #[inline(always)]
            || match self.sections() {
                s @ [_] => kernel::<1>(s, pad, data, group, run, extended),
                s @ [_, _] => kernel::<2>(s, pad, data, group, run, extended),
                s @ [_, _, _] => kernel::<3>(s, pad, data, group, run, extended),
                s @ [_, _, _, _] => kernel::<4>(s, pad, data, group, run, extended),
                s @ [_, _, _, _, _] => kernel::<5>(s, pad, data, group, run, extended),
                s => kernel::<MAX_SECTIONS>(s, pad, data, group, run, extended),
            },
        );
    }
}

/// Where the sample of a channel and frame is: `channel * channel_stride + frame * frame_stride`.
#[derive(Clone, Copy)]
struct Layout {
    channels: usize,
    samples: usize,
    channel_stride: usize,
    frame_stride: usize,
}

/// Up to [`LANES`] neighbouring channels.
#[derive(Clone, Copy)]
struct Group {
    layout: Layout,
    first: usize,
    lanes: usize,
}

impl Group {
    #[inline(always)]
    fn index(&self, lane: usize, frame: usize) -> usize {
        (self.first + lane) * self.layout.channel_stride + frame * self.layout.frame_stride
    }

    /// The runs without missing samples, if they are the same in every channel of the group.
    fn common_runs(&self, data: &[f64]) -> Option<Vec<Range<usize>>> {
        // a product with zero is zero unless the sample is NaN or infinite
        let n = self.layout.samples;
        let all_finite = if self.layout.frame_stride == 1 {
            let start = self.index(0, 0);
            finite_sum(&data[start..start + self.lanes * n])
        } else {
            (0..n).all(|f| finite_sum(&data[self.index(0, f)..][..self.lanes]))
        };
        if all_finite {
            return Some(std::iter::once(0..n).filter(|r| !r.is_empty()).collect());
        }
        let finite = |lane: usize, frame: usize| data[self.index(lane, frame)].is_finite();
        let same = (0..n).all(|f| (1..self.lanes).all(|lane| finite(lane, f) == finite(0, f)));
        same.then(|| runs_where(n, |f| finite(0, f)))
    }

    /// Fallback where channels miss different samples: the plain filter on each.
    fn filter_one_by_one(&self, filter: &Butterworth, data: &mut [f64]) -> usize {
        let n = self.layout.samples;
        let mut channel = vec![0.0; n];
        let mut lost = 0;
        for lane in 0..self.lanes {
            for (f, x) in channel.iter_mut().enumerate() {
                *x = data[self.index(lane, f)];
            }
            lost += filter.filtfilt(&mut channel);
            for (f, x) in channel.iter().enumerate() {
                data[self.index(lane, f)] = *x;
            }
        }
        lost
    }

    fn fill_missing(&self, data: &mut [f64], run: Range<usize>) {
        for frame in run {
            for lane in 0..self.lanes {
                data[self.index(lane, frame)] = f64::NAN;
            }
        }
    }

    #[inline(always)]
    fn load(&self, data: &[f64], start: usize, out: &mut [Frame]) {
        if self.lanes == LANES && self.layout.channel_stride == 1 {
            for (f, out) in out.iter_mut().enumerate() {
                out.copy_from_slice(&data[self.index(0, start + f)..][..LANES]);
            }
        } else {
            for lane in 0..self.lanes {
                let (at, step) = (self.index(lane, start), self.layout.frame_stride);
                for (f, out) in out.iter_mut().enumerate() {
                    out[lane] = data[at + f * step];
                }
            }
        }
    }

    #[inline(always)]
    fn store(&self, data: &mut [f64], start: usize, from: &[Frame]) {
        if self.lanes == LANES && self.layout.channel_stride == 1 {
            for (f, from) in from.iter().enumerate() {
                data[self.index(0, start + f)..][..LANES].copy_from_slice(from);
            }
        } else {
            for lane in 0..self.lanes {
                let (at, step) = (self.index(lane, start), self.layout.frame_stride);
                for (f, from) in from.iter().enumerate() {
                    data[at + f * step] = from[lane];
                }
            }
        }
    }
}

fn finite_sum(values: &[f64]) -> bool {
    let mut sums = [0.0; 8];
    let (chunks, rest) = values.as_chunks::<8>();
    for chunk in chunks {
        for (s, x) in sums.iter_mut().zip(chunk) {
            *s += x * 0.0;
        }
    }
    sums.iter().sum::<f64>() + rest.iter().map(|x| x * 0.0).sum::<f64>() == 0.0
}

#[inline(always)]
fn kernel<const S: usize>(
    sections: &[Section],
    pad: usize,
    data: &mut [f64],
    group: Group,
    run: Range<usize>,
    extended: &mut [Frame],
) {
    let mut s = [Section { b: [1.0, 0.0, 0.0], a: [0.0, 0.0] }; S];
    for (to, from) in s.iter_mut().zip(sections) {
        *to = *from;
    }
    let n = run.len();

    // forward: reflect the beginning, then load block after block, then reflect the end
    let (head, tail) = extended.split_at_mut(pad);
    let (body, tail) = tail.split_at_mut(n);
    group.load(data, run.start, &mut body[..=pad]);
    for (i, out) in head.iter_mut().enumerate() {
        *out = reflect(&body[0], &body[pad - i]);
    }
    let mut z = steady(&s, &head[0]);
    pass(&s, &mut z, head.iter_mut());
    // the end is needed before the forward pass overwrites it
    let mut end = [[0.0; LANES]; 3 * (crate::butterworth::MAX_ORDER + 1) + 1];
    let end = &mut end[..=pad];
    group.load(data, run.end - 1 - pad, end);
    for (i, out) in tail.iter_mut().enumerate() {
        *out = reflect(&end[pad], &end[pad - 1 - i]);
    }
    for (block, frames) in body.chunks_mut(BLOCK).enumerate() {
        group.load(data, run.start + block * BLOCK, frames);
        pass(&s, &mut z, frames.iter_mut());
    }
    pass(&s, &mut z, tail.iter_mut());

    // backward
    z = steady(&s, &tail[pad - 1]);
    pass(&s, &mut z, tail.iter_mut().rev());
    for (block, frames) in body.chunks_mut(BLOCK).enumerate().rev() {
        pass(&s, &mut z, frames.iter_mut().rev());
        group.store(data, run.start + block * BLOCK, frames);
    }
}

#[inline(always)]
fn reflect(about: &Frame, x: &Frame) -> Frame {
    std::array::from_fn(|lane| 2.0 * about[lane] - x[lane])
}

#[inline(always)]
fn steady<const S: usize>(sections: &[Section; S], x: &Frame) -> [[Frame; 2]; S] {
    std::array::from_fn(|i| sections[i].steady_state().map(|unit| x.map(|x| unit * x)))
}

#[inline(always)]
fn pass<'a, const S: usize>(
    sections: &[Section; S],
    states: &mut [[Frame; 2]; S],
    frames: impl Iterator<Item = &'a mut Frame>,
) {
    let mut z = *states;
    for frame in frames {
        let mut x = *frame;
        for (s, z) in sections.iter().zip(&mut z) {
            for lane in 0..LANES {
                let y = s.b[0] * x[lane] + z[0][lane];
                z[0][lane] = s.b[1] * x[lane] - s.a[0] * y + z[1][lane];
                z[1][lane] = s.b[2] * x[lane] - s.a[1] * y;
                x[lane] = y;
            }
        }
        *frame = x;
    }
    *states = z;
}
