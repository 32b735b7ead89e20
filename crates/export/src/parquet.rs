//! Writes and reads data frames as Parquet, with polars' own encoder and decoder.
//!
//! They are called directly because polars' reader and writer depend on its query engine and its C
//! codecs, which take most of the time of a first build.

use polars::prelude::*;
use polars_parquet::parquet::compression::Compression as Packing;
use polars_parquet::read::{
    BasicDecompressor, PageReader, ParquetError, column_iter_to_arrays, get_field_pages, infer_schema, read_metadata,
};
use polars_parquet::write::{
    CompressionOptions, Compressor, DynIter, DynStreamingIterator, Encoding, FallibleStreamingIterator, FileWriter,
    StatisticsOptions, Version, WriteOptions, array_to_columns,
};
use std::io::{Cursor, Write};

/// Compression of a data frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compression {
    /// Uncompressed, because noise does not compress.
    None,
    /// Snappy, for repetitive text.
    Snappy,
}

/// Writes a frame as Parquet, without statistics.
///
/// `dictionary(i)` decides whether column `i` is written as a dictionary of its distinct values;
/// numbers of a measurement are better plain.
///
/// # Errors
/// Errors of polars and of the destination.
pub fn write(
    frame: &DataFrame,
    to: impl Write,
    compression: Compression,
    dictionary: impl Fn(usize) -> bool,
) -> PolarsResult<()> {
    let options = WriteOptions {
        statistics: StatisticsOptions::empty(),
        version: Version::V1,
        compression: match compression {
            Compression::None => CompressionOptions::Uncompressed,
            Compression::Snappy => CompressionOptions::Snappy,
        },
        data_page_size: None,
    };
    let schema = frame.schema().to_arrow(CompatLevel::newest());
    let mut writer = FileWriter::try_new(to, schema, options)?;
    let fields = writer.parquet_schema().fields().to_vec();
    for batch in frame.iter_chunks(CompatLevel::newest(), false).filter(|b| !b.is_empty()) {
        let mut columns = Vec::with_capacity(fields.len());
        for (i, (array, field)) in batch.columns().iter().zip(&fields).enumerate() {
            let encoding = if dictionary(i) { Encoding::RleDictionary } else { Encoding::Plain };
            for pages in array_to_columns(array, field.clone(), options, &[encoding])? {
                let pages = pages.map(|page| page.map_err(|e| ParquetError::FeatureNotSupported(e.to_string())));
                let pages = Compressor::new(pages, options.compression, Vec::new()).map_err(PolarsError::from);
                columns.push(Ok(DynStreamingIterator::new(pages)));
            }
        }
        writer.write(batch.len() as u64, DynIter::new(columns.into_iter()))?;
    }
    writer.end(None)?;
    Ok(())
}

/// Reads a frame from the bytes of a Parquet file with flat columns, as written by [`write()`].
///
/// # Errors
/// Another compression than [`Compression`], and errors of polars' decoder.
pub fn read(bytes: Vec<u8>) -> PolarsResult<DataFrame> {
    let mut source = Cursor::new(bytes.as_slice());
    let metadata = read_metadata(&mut source)?;
    let schema = infer_schema(&metadata)?;
    let mut columns = Vec::with_capacity(schema.len());
    for field in schema.iter_values() {
        let mut chunks = Vec::new();
        for group in &metadata.row_groups {
            let of_group = group.parquet_columns();
            let (mut pages, mut types) = (Vec::new(), Vec::new());
            for column in get_field_pages(of_group, of_group, &field.name) {
                let packed = column.compression();
                if !matches!(packed, Packing::Uncompressed | Packing::Snappy) {
                    let packed = format!("{packed:?}").to_lowercase();
                    return Err(PolarsError::ComputeError(
                        format!("compressed with {packed}, expected snappy or no compression").into(),
                    ));
                }
                let range = column.byte_range();
                let range = range.start as usize..range.end as usize;
                let Some(chunk) = bytes.get(range) else {
                    return Err(PolarsError::ComputeError(
                        format!("column `{}` ends beyond the file", field.name).into(),
                    ));
                };
                let reader = PageReader::new(Cursor::new(chunk.to_vec().into()), column, vec![], usize::MAX);
                pages.push(BasicDecompressor::new(reader, vec![]));
                types.push(&column.descriptor().descriptor.primitive_type);
            }
            chunks.extend(column_iter_to_arrays(pages, types, field.clone(), None)?.0);
        }
        // a table without rows has no row group
        let series = if chunks.is_empty() {
            Series::new_empty(field.name.clone(), &DataType::from_arrow_field(field))
        } else {
            Series::try_from((field, chunks))?
        };
        columns.push(series.rechunk().into());
    }
    DataFrame::new(metadata.num_rows, columns)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    #[test]
    fn a_compression_that_is_not_read_is_named() {
        let frame = DataFrame::new(3, vec![Series::new("time_s".into(), [0.0, 0.1, 0.2]).into()]).unwrap();
        let mut bytes = Vec::new();
        write(&frame, &mut bytes, Compression::Snappy, |_| false).unwrap();
        assert_eq!(read(bytes.clone()).unwrap(), frame);
        // in the footer the codec follows the last copy of the column's name; as zigzag numbers
        // snappy (1) is 2 and zstd (6) is 12
        let codec = b"time_s\x15\x02";
        let at = bytes.windows(codec.len()).rposition(|w| w == codec).unwrap();
        bytes[at + codec.len() - 1] = 12;
        let problem = read(bytes).unwrap_err().to_string();
        assert!(problem.contains("compressed with zstd, expected snappy or no compression"), "{problem}");
    }
}
