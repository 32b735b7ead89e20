//! Markdown for the terminal: paragraphs and lists are wrapped to the width, tables are laid out.

use crate::screen::{Grid, labelled, table};

/// The text as lines that fit the terminal. Headings and code keep their signs, so that the text
/// stays Markdown but for its tables.
pub fn markdown(text: &str) -> String {
    let mut out: Vec<String> = Vec::new();
    let mut rows: Option<Grid> = None;
    let mut code = false;
    for line in text.lines() {
        let cells = cells(line).filter(|_| !code);
        match (&mut rows, cells) {
            (Some(grid), Some(cells)) => {
                if !cells.iter().all(|c| c.bytes().all(|b| b == b'-' || b == b':')) {
                    grid.add_row(cells);
                }
                continue;
            }
            (None, Some(cells)) => {
                let left: Vec<usize> = (1..cells.len()).collect();
                rows = Some(table(&cells).left(&left).wrapped(0));
                continue;
            }
            (_, None) => out.extend(rows.take().map(|grid| grid.to_string())),
        }
        if line.trim_start().starts_with("```") {
            code = !code;
        }
        let start = line.len() - line.trim_start().len();
        out.push(if code || start >= 4 || line.trim().is_empty() {
            line.to_owned()
        } else {
            let rest = &line[start..];
            let sign = ["- ", "* "].into_iter().find(|s| rest.starts_with(s)).map_or(0, str::len);
            labelled(&line[..start + sign], &rest[sign..])
        });
    }
    out.extend(rows.map(|grid| grid.to_string()));
    out.join("\n")
}

/// The cells of a line of a table; none of another line.
fn cells(line: &str) -> Option<Vec<&str>> {
    let inner = line.trim().strip_prefix('|')?.strip_suffix('|')?;
    Some(inner.split('|').map(str::trim).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_laid_out_and_lists_keep_their_sign() {
        let text = "# title\n\n- one\n- two\n\n| on | name |\n|---|---|\n| a link | `k` |\n\nend";
        assert_eq!(markdown(text), "# title\n\n- one\n- two\n\non      name\na link  `k`\n\nend");
        assert_eq!(markdown("```\n| not | a table |\n```"), "```\n| not | a table |\n```");
    }
}
