//! Position of each sample. Header and parameters state sizes two or three times and contradict
//! each other in real files; the statement that agrees with the file's length is used.

use crate::{Storage, header::BLOCK};

/// Sizes of the sample section.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Layout {
    pub storage: Storage,
    pub n_points: usize,
    pub n_channels: usize,
    pub samples_per_frame: usize,
    pub n_frames: usize,
}

impl Layout {
    /// Bytes of one frame.
    pub fn frame_bytes(&self) -> usize {
        (4 * self.n_points + self.n_channels * self.samples_per_frame) * self.storage.word_bytes()
    }
    /// Bytes of the points of one frame.
    pub fn point_bytes(&self) -> usize {
        4 * self.n_points * self.storage.word_bytes()
    }
}

/// Statements of header and parameters, each list in order of reliability, duplicates allowed.
#[derive(Debug, Default)]
pub(crate) struct Statements {
    pub storages: Vec<Storage>,
    pub points: Vec<usize>,
    /// (channels, samples per frame).
    pub analogs: Vec<(usize, usize)>,
    pub frames: Vec<usize>,
}

/// Agreement of the choice with the file's length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fit {
    /// The samples end where the file ends, up to the padding of the last block or one more block.
    Exact,
    /// Additional bytes follow the samples.
    Surplus {
        /// Number of bytes after the last frame.
        bytes: usize,
    },
    /// The file ends before the last stated frame.
    Truncated {
        /// Frames stated.
        stated: usize,
    },
}

/// Chooses among the statements according to the number of bytes `available` for samples.
pub(crate) fn choose(statements: &Statements, available: usize) -> (Layout, Fit) {
    let mut surplus: Option<(Layout, usize)> = None;
    let mut truncated: Option<(Layout, usize)> = None;
    for &storage in &statements.storages {
        for &n_points in &statements.points {
            for &(n_channels, samples_per_frame) in &statements.analogs {
                for &n_frames in &statements.frames {
                    let layout = Layout { storage, n_points, n_channels, samples_per_frame, n_frames };
                    let frame = layout.frame_bytes();
                    match frame.checked_mul(n_frames).map(|size| (size, available.checked_sub(size))) {
                        Some((_, Some(rest))) if rest <= BLOCK => return (layout, Fit::Exact),
                        Some((_, Some(rest))) => {
                            surplus.get_or_insert((layout, rest));
                        }
                        _ => {
                            let held = Layout { n_frames: available / frame.max(1), ..layout };
                            truncated.get_or_insert((held, n_frames));
                        }
                    }
                }
            }
        }
    }
    match (surplus, truncated) {
        // Frames are stated, but an empty layout matches any length: prefer a layout with frames.
        (Some((layout, bytes)), None) => (layout, Fit::Surplus { bytes }),
        (Some((layout, bytes)), Some(_)) if layout.n_frames > 0 => (layout, Fit::Surplus { bytes }),
        (_, Some((layout, stated))) => (layout, Fit::Truncated { stated }),
        (None, None) => {
            let none =
                Layout { storage: Storage::Float, n_points: 0, n_channels: 0, samples_per_frame: 0, n_frames: 0 };
            (none, Fit::Exact)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn statements() -> Statements {
        Statements {
            storages: vec![Storage::Float],
            points: vec![10],
            analogs: vec![(6, 5), (0, 0)],
            frames: vec![100, 65_636],
        }
    }

    #[test]
    fn regress_the_length_decides() {
        let frame = (40 + 30) * 4;
        let (layout, fit) = choose(&statements(), frame * 100);
        assert_eq!((layout.n_frames, layout.n_channels, fit), (100, 6, Fit::Exact));
        let (layout, fit) = choose(&statements(), frame * 65_636 + 200);
        assert_eq!((layout.n_frames, fit), (65_636, Fit::Exact));
        let (layout, fit) = choose(&statements(), 160 * 100);
        assert_eq!((layout.n_frames, layout.n_channels, fit), (100, 0, Fit::Exact));
        let (layout, fit) = choose(&statements(), frame * 120);
        assert_eq!((layout.n_frames, fit), (100, Fit::Surplus { bytes: frame * 20 }));
        let (layout, fit) = choose(&statements(), frame * 30 + 5);
        assert_eq!((layout.n_frames, fit), (30, Fit::Truncated { stated: 100 }));
    }
}
