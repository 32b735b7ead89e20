//! Tables of numbers as robots log them: CSV with a header, plain or compressed with gzip.

use crate::{RobotError, unpack};

/// Columns of equal length with their names. Missing values are NaN.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Columns {
    /// File, for messages.
    pub file: String,
    /// Names, in the order of the file.
    pub names: Vec<String>,
    /// Values of each column.
    pub values: Vec<Vec<f64>>,
    /// True if each row is one line of a text file, after one line of names: messages then give
    /// line numbers.
    pub lines: bool,
}

impl Columns {
    /// Reads CSV with a header line, separated by comma, semicolon or tab; gzip is recognised by
    /// its first bytes. Empty fields and words for a missing value (`nan`, `NULL`, `-`; see
    /// [`aloft_trial::missing`]) are missing.
    ///
    /// # Errors
    /// [`RobotError::Table`] for a damaged archive or one that unpacks to far more than a table
    /// does, a row with another number of fields, a field that is not a number, a column name that
    /// occurs twice, and a file without rows.
    pub fn from_csv(file: &str, bytes: &[u8]) -> Result<Self, RobotError> {
        let problem = |line: Option<u64>, problem: String| RobotError::Table { file: file.to_owned(), line, problem };
        let unpacked;
        let bytes = if bytes.starts_with(&[0x1f, 0x8b]) {
            let stream = flate2::read::MultiGzDecoder::new(bytes);
            unpacked = unpack::all(stream, bytes.len()).map_err(|e| problem(None, e))?;
            unpacked.as_slice()
        } else {
            bytes
        };
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let first = bytes.split(|b| *b == b'\n').next().unwrap_or_default();
        let count = |c: u8| first.iter().filter(|b| **b == c).count();
        let delimiter = [b',', b';', b'\t'].into_iter().max_by_key(|c| count(*c)).unwrap_or(b',');
        let mut reader = csv::ReaderBuilder::new().delimiter(delimiter).trim(csv::Trim::All).from_reader(bytes);
        let names: Vec<String> = reader
            .headers()
            .map_err(|e| problem(Some(1), format!("the header cannot be read: {e}")))?
            .iter()
            .map(str::to_owned)
            .collect();
        if names.len() < 2 {
            return Err(problem(Some(1), format!("{} column, expected a time and values", names.len())));
        }
        for (i, name) in names.iter().enumerate() {
            if names[..i].contains(name) {
                return Err(problem(Some(1), format!("two columns have the name `{name}`")));
            }
        }
        let mut values: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
        let mut row = csv::ByteRecord::new();
        loop {
            match reader.read_byte_record(&mut row) {
                Ok(false) => break,
                Ok(true) => {}
                Err(e) => {
                    let line = e.position().map(csv::Position::line);
                    let words = match e.kind() {
                        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
                            format!("{len} fields, expected {expected_len} as in the header")
                        }
                        _ => e.to_string(),
                    };
                    return Err(problem(line, words));
                }
            }
            for ((field, name), column) in row.iter().zip(&names).zip(&mut values) {
                column.push(number(field).ok_or_else(|| {
                    let line = row.position().map(csv::Position::line);
                    problem(
                        line,
                        format!("column `{name}` holds `{}`, expected a number", String::from_utf8_lossy(field)),
                    )
                })?);
            }
        }
        if values[0].is_empty() {
            return Err(problem(None, "a header and no rows".to_owned()));
        }
        Ok(Self { file: file.to_owned(), names, values, lines: true })
    }

    /// A table that is already in memory, for example from Parquet.
    ///
    /// # Errors
    /// [`RobotError::Table`] if the columns differ in length or have no rows.
    pub fn of(file: &str, columns: Vec<(String, Vec<f64>)>) -> Result<Self, RobotError> {
        let height = columns.first().map_or(0, |c| c.1.len());
        let problem = if columns.is_empty() {
            "no column holds numbers (text is not read as numbers)"
        } else if height == 0 {
            "a table without rows"
        } else if columns.iter().any(|c| c.1.len() != height) {
            "columns of different lengths"
        } else {
            ""
        };
        if !problem.is_empty() {
            return Err(RobotError::Table { file: file.to_owned(), line: None, problem: problem.to_owned() });
        }
        let (names, values) = columns.into_iter().unzip();
        Ok(Self { file: file.to_owned(), names, values, lines: false })
    }

    /// A column by name.
    pub fn get(&self, name: &str) -> Option<&[f64]> {
        self.names.iter().position(|n| n == name).map(|i| self.values[i].as_slice())
    }

    /// The first of several names that is a column.
    pub fn any<'n>(&self, names: impl IntoIterator<Item = &'n str>) -> Option<&[f64]> {
        names.into_iter().find_map(|n| self.get(n))
    }

    /// Number of rows.
    pub fn height(&self) -> usize {
        self.values.first().map_or(0, Vec::len)
    }

    /// Where a row is, in words: the line of a text file, or the row of a table.
    pub fn place(&self, row: usize) -> String {
        if self.lines { format!("line {}", row + 2) } else { format!("row {}", row + 1) }
    }
}

fn number(field: &[u8]) -> Option<f64> {
    // none: a field that is no text is no number, which the caller names
    aloft_trial::missing::number(std::str::from_utf8(field).ok()?)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use std::io::Write;

    #[test]
    fn plain_and_compressed_text_give_the_same_table() {
        let text = b"\xef\xbb\xbftime_s; q_a_rad\n0;1.5\n0.1;\n0.2;nan\n";
        let plain = Columns::from_csv("a.csv", text).unwrap();
        assert_eq!(plain.names, ["time_s", "q_a_rad"]);
        assert_eq!(plain.values[0], [0.0, 0.1, 0.2]);
        assert!(plain.values[1][1].is_nan() && plain.values[1][2].is_nan());
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        packed.write_all(text).unwrap();
        let packed = packed.finish().unwrap();
        assert_eq!(Columns::from_csv("a.csv", &packed).unwrap().values[0], plain.values[0]);
        let cut = Columns::from_csv("a.csv.gz", &packed[..packed.len() - 9]).unwrap_err().to_string();
        assert!(cut.starts_with("a.csv.gz: the gzip archive is damaged"), "{cut}");
    }

    #[test]
    fn damaged_text_names_the_line_and_what_it_holds() {
        for (text, expected) in [
            ("time_s,q\n0,1\n1,x\n", "log.csv, line 3: column `q` holds `x`, expected a number"),
            ("time_s,q\n0,1\n1\n", "log.csv, line 3: 1 fields, expected 2 as in the header"),
            ("time_s,q,q\n0,1,2\n", "log.csv, line 1: two columns have the name `q`"),
            ("time_s,q\n", "log.csv: a header and no rows"),
            ("", "log.csv, line 1: 0 column, expected a time and values"),
        ] {
            assert_eq!(Columns::from_csv("log.csv", text.as_bytes()).unwrap_err().to_string(), expected);
        }
    }
}
