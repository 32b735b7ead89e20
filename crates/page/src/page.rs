//! Structure of the page: chapters of sections of blocks.

use crate::{Figure, Ladder, Table};
use serde::Serialize;

/// A traffic light; always shown with its symbol and its word, never by colour alone.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Light {
    /// Neither good nor bad.
    #[default]
    Neutral,
    /// Within the expected limits.
    Good,
    /// Usable, with a remark.
    Fair,
    /// Not reliable.
    Poor,
}

impl Light {
    /// Its word; empty for neutral.
    pub fn word(self) -> &'static str {
        match self {
            Self::Neutral => "",
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Poor => "poor",
        }
    }
    /// Good below `good`, fair below `fair`, else poor; neutral if the value is missing.
    pub fn below(value: f64, good: f64, fair: f64) -> Self {
        if !value.is_finite() {
            Self::Neutral
        } else if value < good {
            Self::Good
        } else if value < fair {
            Self::Fair
        } else {
            Self::Poor
        }
    }
}

/// A card with one figure of merit.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Card {
    /// Name of the figure.
    pub label: String,
    /// Its value with unit.
    pub value: String,
    /// Explanatory line below it, for comparison.
    pub note: String,
    /// Judgement.
    pub light: Light,
    /// The judgement in its own words; empty for the word of the light.
    pub word: String,
}

/// A line of a [`Headline`]: what, and the answer.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Fact {
    /// What it answers, in a word or two.
    pub label: String,
    /// Plain text; parts between backticks are set as code.
    pub text: String,
    /// Command to type, with a button that copies it; empty for none.
    pub command: String,
}

impl Fact {
    /// A line without a command.
    pub fn new(label: &str, text: impl Into<String>) -> Self {
        Self { label: label.to_owned(), text: text.into(), command: String::new() }
    }
}

/// The result in one sentence, and what a reader asks next.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Headline {
    /// Judgement.
    pub light: Light,
    /// The judgement in its own words; empty for the word of the light.
    pub word: String,
    /// The sentence.
    pub sentence: String,
    /// Short answers.
    pub facts: Vec<Fact>,
}

/// One element of a section.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Block {
    /// A paragraph.
    Text {
        /// Plain text.
        text: String,
    },
    /// A remark that should not be overlooked.
    Remark {
        /// Plain text.
        text: String,
        /// Judgement.
        light: Light,
        /// The judgement in its own words; empty for the word of the light.
        word: String,
    },
    /// Remarks or sentences, one per line.
    List {
        /// Plain text of each.
        items: Vec<String>,
    },
    /// The result in one sentence.
    Headline {
        /// The sentence and its details.
        headline: Headline,
    },
    /// Errors of the revisions of a model, falling to the noise floor.
    Ladder {
        /// The ladder.
        ladder: Ladder,
    },
    /// Two columns on wide screens, one below the other on narrow ones.
    Beside {
        /// Left column.
        left: Vec<Block>,
        /// Right column.
        right: Vec<Block>,
    },
    /// Figures of merit, side by side.
    Cards {
        /// The cards.
        cards: Vec<Card>,
    },
    /// A table.
    Table {
        /// The table.
        table: Table,
    },
    /// A chart or a player.
    Figure {
        /// The figure.
        figure: Figure,
    },
    /// Details for some readers, shown on request.
    Folded {
        /// Title of the folded part.
        title: String,
        /// Contents.
        blocks: Vec<Block>,
    },
    /// Text with a button that copies it.
    Copy {
        /// Plain text.
        text: String,
    },
    /// Lines of a file, as they are, with a button that copies them.
    Code {
        /// The lines.
        text: String,
    },
    /// Commands to type.
    Commands {
        /// One command per line.
        lines: Vec<String>,
    },
}

impl Block {
    /// A paragraph.
    pub fn text(text: impl Into<String>) -> Self {
        Self::Text { text: text.into() }
    }
    /// Lines of a file, to be copied as they are.
    pub fn code(text: impl Into<String>) -> Self {
        Self::Code { text: text.into() }
    }
    /// A remark with its judgement.
    pub fn remark(light: Light, text: impl Into<String>) -> Self {
        Self::judged(light, "", text)
    }
    /// A remark with its judgement in words of its own.
    pub fn judged(light: Light, word: impl Into<String>, text: impl Into<String>) -> Self {
        Self::Remark { text: text.into(), light, word: word.into() }
    }
}

impl From<Headline> for Block {
    fn from(headline: Headline) -> Self {
        Self::Headline { headline }
    }
}

impl From<Ladder> for Block {
    fn from(ladder: Ladder) -> Self {
        Self::Ladder { ladder }
    }
}

impl From<Table> for Block {
    fn from(table: Table) -> Self {
        Self::Table { table }
    }
}

impl From<Figure> for Block {
    fn from(figure: Figure) -> Self {
        Self::Figure { figure }
    }
}

/// A section with its heading.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Section {
    /// Identifier in links, unique on the page.
    pub id: String,
    /// Heading.
    pub title: String,
    /// One sentence below the heading.
    pub lead: String,
    /// Contents.
    pub blocks: Vec<Block>,
}

impl Section {
    /// A section.
    pub fn new(id: impl Into<String>, title: &str, lead: &str, blocks: Vec<Block>) -> Self {
        Self { id: id.into(), title: title.to_owned(), lead: lead.to_owned(), blocks }
    }
}

/// A chapter; the reader sees one at a time.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Chapter {
    /// Identifier in links, unique on the page.
    pub id: String,
    /// Title, also shown in the list of chapters.
    pub title: String,
    /// Heading in the list of chapters under which the chapter is listed.
    pub group: String,
    /// Judgement, shown in the list.
    pub light: Light,
    /// The judgement in its own words, for screen readers; empty for the word of the light.
    pub word: String,
    /// Contents.
    pub sections: Vec<Section>,
}

/// A whole page.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Page {
    /// Title.
    pub title: String,
    /// Line below the title.
    pub subtitle: String,
    /// Chapters in order; those of one group are adjacent.
    pub chapters: Vec<Chapter>,
    /// Footer lines: versions, hashes.
    pub footer: Vec<String>,
}

impl Page {
    /// True if a figure on the page is drawn by `drawn_by` (`chart`, `map` or `player`).
    pub fn has(&self, drawn_by: &str) -> bool {
        fn any(blocks: &[Block], drawn_by: &str) -> bool {
            blocks.iter().any(|b| match b {
                Block::Figure { figure } => figure.drawn_by == drawn_by,
                Block::Folded { blocks, .. } => any(blocks, drawn_by),
                Block::Beside { left, right } => any(left, drawn_by) || any(right, drawn_by),
                _ => false,
            })
        }
        self.chapters.iter().flat_map(|c| &c.sections).any(|s| any(&s.blocks, drawn_by))
    }
}
