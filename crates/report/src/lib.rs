//! One self-contained page that tells the story
