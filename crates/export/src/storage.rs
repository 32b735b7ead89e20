//! The OpenSim storage table: MOT and STO have the same text format.

use crate::number::fixed;

/// Text of a table. `columns` do not include time; `rows` gives time and values of each row.
pub(crate) fn text(
    name: &str,
    in_degrees: bool,
    comments: &[&str],
    columns: &[String],
    rows: impl Iterator<Item = (f64, Vec<f64>)>,
    decimals: usize,
) -> String {
    let mut body = String::new();
    let mut n = 0;
    for (time_s, values) in rows {
        body.push_str(&fixed(time_s, 8));
        for value in values {
            body.push('\t');
            body.push_str(&fixed(value, decimals));
        }
        body.push('\n');
        n += 1;
    }
    let mut out = format!(
        "{}\nversion=1\nnRows={n}\nnColumns={}\ninDegrees={}\n\n",
        name.replace(['\n', '\t'], " "),
        columns.len() + 1,
        if in_degrees { "yes" } else { "no" }
    );
    for comment in comments {
        out.push_str(comment);
        out.push('\n');
    }
    out.push_str("endheader\ntime");
    for column in columns {
        out.push('\t');
        out.push_str(column);
    }
    out.push('\n');
    out + &body
}

/// Range from the first to the last frame with values.
pub(crate) fn extent(values: &[f64], width: usize) -> std::ops::Range<usize> {
    let whole = |row: &[f64]| row.iter().all(|x| x.is_finite());
    let mut rows = values.chunks_exact(width.max(1));
    let Some(first) = rows.position(whole) else { return 0..0 };
    let last = values.chunks_exact(width.max(1)).rposition(whole).unwrap_or(first);
    first..last + 1
}
