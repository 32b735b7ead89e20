//! One self-contained HTML page with a headline, signals, text, tables, charts and a player for 3-D
//! recordings. Works offline.
//!
//! The page is generic on purpose: its contents and their order are decided in `report`, where the
//! results are known; its appearance is decided here. A [`Page`] has [`Chapter`]s, of which the
//! reader sees one at a time; a chapter has [`Section`]s of [`Block`]s. Numbers are stored packed
//! inside the page ([`pack`]) and drawn when they come into view, so that a page of many recordings
//! opens at once. The numbers of every table and figure can be saved as CSV. A policy in the page
//! allows only the page's own scripts and no access to a network.

mod figure;
mod ladder;
pub mod pack;
mod page;
mod player;
mod render;
pub mod switches;
mod table;

pub use figure::{Band, Chart, Columns, Dots, Figure, Focus, HeatMap, Line, Panel, Scale, Series, Shade, Words};
pub use ladder::{Ladder, Rung};
pub use page::{Block, Card, Chapter, Fact, Headline, Light, Page, Section};
pub use player::{Animation, ArrowOf, Arrows, MassAt, PointOn, Segment};
pub use render::{Live, ReportError, render, render_blocks, render_live};
pub use table::{Cell, Table};
