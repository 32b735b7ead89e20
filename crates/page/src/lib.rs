//! One self-contained page that tells the story: lights, text, tables, charts, a player for 3-D recordings. Works offline.
//!
//! The page is generic on purpose: what is told, and in which order, is decided where the results are known (`pipeline`);
//! how it looks is decided here. A [`Page`] has [`Chapter`]s, of which the reader sees one at a time; a chapter has
//! [`Section`]s of [`Block`]s. Numbers travel inside the page, packed ([`pack`]), and are drawn when they come into view:
//! a page of many recordings opens at once. Every table and figure saves its numbers as CSV.

mod figure;
pub mod pack;
mod page;
mod player;
mod render;
mod table;

pub use figure::{Band, Columns, Dots, Figure, HeatMap, Line, Panel, Series, Shade, Words};
pub use page::{Block, Card, Chapter, Light, Page, Section};
pub use player::{Animation, Arrows};
pub use render::{ReportError, render};
pub use table::{Cell, Table};
