//! Figures: a title and a caption in words, and the drawing as data for the plotting library or the
//! player.
//!
//! Colours are names (`$c0` … `$c5`, `$ink`, `$dim`, `$grid`), which the page replaces with those
//! of its light or dark theme.

mod base;
mod dots;
mod map;
mod panels;

pub use base::{Figure, Words};
pub use dots::Dots;
pub use map::{Columns, HeatMap};
pub use panels::{Band, Line, Panel, Series, Shade};
