//! One self-contained page that tells the story: cards with lights, text, tables, charts, a 3-D player. Works offline.
//!
//! The page is generic on purpose: what is told, and in which order, is decided where the results are known (`pipeline`);
//! how it looks is decided here.

mod figure;
mod page;

pub use figure::{Animation, Band, Figure, HeatMap, Series, Shade};
pub use page::{Block, Card, Light, Page, ReportError, Section, Table, render};
