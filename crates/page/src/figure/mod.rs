//! Figures: a title and a caption in words, and the drawing.
//!
//! Dot plots and maps of few cells are HTML, so that they need no script and print as they are.
//! Line charts, maps of many cells and the player are drawn by the page's scripts from data.
//! Colours are names of the page's theme (`c0` … `c5`, `ink`, `dim`), light or dark.

mod base;
mod chart;
mod dots;
mod heat;
pub(crate) mod html;
mod map;

pub use base::{Figure, Words};
pub use chart::{Band, Chart, Focus, Line, Panel, Series, Shade};
pub use dots::Dots;
pub use heat::Scale;
pub use map::{Columns, HeatMap};
