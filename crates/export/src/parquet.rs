//! Writes and reads data frames as Parquet, with polars' own encoder and decoder.
//!
//! They are called directly because polars' reader and writer depend on its query engine and its C
//! codecs, which take most of the time of a first build.

use crate::parquet_pages::Unpacker;
use polars::prelude::*;
use polars_parquet::parquet::compression::Compression as Packing;
use polars_parquet::parquet::read::PageMetaData;
use polars_parquet::read::{
    BasicDecompressor, FileMetadata, PageReader, ParquetError, column_iter_to_arrays, get_field_pages, infer_schema,
    read_metadata,
};
use polars_parquet::write::{
    CompressionOptions, Compressor, DynIter, DynStreamingIterator, Encoding, FallibleStreamingIterator, FileWriter,
    StatisticsOptions, Version, WriteOptions, array_to_columns,
};
use std::cell::Cell;
use std::io::{Cursor, Write};
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

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

/// Most bytes of a table in memory: two hours of 40 joints with rates and torques at 250 Hz.
const MOST_BYTES: u64 = 2 << 30;

/// How a column of another program is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// As it is.
    Plain,
    /// Points in time or durations, as whole numbers of this part of a second.
    PerSecond(u32),
    /// Numbers and text that polars is built without, and columns of lists or groups.
    Other,
}

/// The type in which a column is read. Types of times and of short numbers that polars is built
/// without are read as the whole numbers that the file stores.
fn stored(field: &ArrowField) -> (ArrowField, Kind) {
    let per_second = |unit: &ArrowTimeUnit| match unit {
        ArrowTimeUnit::Second => 1,
        ArrowTimeUnit::Millisecond => 1_000,
        ArrowTimeUnit::Microsecond => 1_000_000,
        ArrowTimeUnit::Nanosecond => 1_000_000_000,
    };
    let (dtype, kind) = match &field.dtype {
        ArrowDataType::Timestamp(unit, _) | ArrowDataType::Duration(unit) => {
            (ArrowDataType::Int64, Kind::PerSecond(per_second(unit)))
        }
        ArrowDataType::Int8 | ArrowDataType::Int16 | ArrowDataType::UInt8 | ArrowDataType::UInt16 => {
            (ArrowDataType::Int32, Kind::Plain)
        }
        plain @ (ArrowDataType::Int32
        | ArrowDataType::Int64
        | ArrowDataType::UInt32
        | ArrowDataType::UInt64
        | ArrowDataType::Float32
        | ArrowDataType::Float64
        | ArrowDataType::Boolean
        | ArrowDataType::Utf8
        | ArrowDataType::LargeUtf8
        | ArrowDataType::Utf8View) => (plain.clone(), Kind::Plain),
        other => (other.clone(), Kind::Other),
    };
    (ArrowField::new(field.name.clone(), dtype, field.is_nullable), kind)
}

/// Reads a frame from the bytes of a Parquet file with flat columns, as written by [`write()`].
///
/// # Errors
/// A compression other than zstd, snappy, gzip and lz4_raw, a file that states sizes it cannot
/// hold, and errors of polars' decoder.
pub fn read(bytes: Vec<u8>) -> PolarsResult<DataFrame> {
    let (metadata, schema) = opened(&bytes)?;
    let mut unpacker = Unpacker::new(MOST_BYTES);
    let columns = schema.iter_values().map(|field| column(&bytes, &metadata, field, &mut unpacker));
    DataFrame::new(metadata.num_rows, columns.collect::<PolarsResult<Vec<Column>>>()?)
}

/// Reads the columns of numbers, truth values (0 and 1) and times (s) from the bytes of a Parquet
/// file of another program: name, values with NaN where missing, true for times. Other columns are
/// left out.
///
/// # Errors
/// As [`read`].
pub fn read_numbers(bytes: &[u8]) -> PolarsResult<Vec<(String, Vec<f64>, bool)>> {
    let (metadata, schema) = opened(bytes)?;
    let mut unpacker = Unpacker::new(MOST_BYTES);
    let mut out = Vec::new();
    for field in schema.iter_values() {
        let (field, kind) = stored(field);
        let text = matches!(field.dtype, ArrowDataType::Utf8 | ArrowDataType::LargeUtf8 | ArrowDataType::Utf8View);
        if kind == Kind::Other || text {
            continue;
        }
        let wide = column(bytes, &metadata, &field, &mut unpacker)?.cast(&DataType::Float64)?;
        let mut values: Vec<f64> = wide.f64()?.iter().map(|v| v.unwrap_or(f64::NAN)).collect();
        if let Kind::PerSecond(parts) = kind {
            values.iter_mut().for_each(|v| *v /= f64::from(parts));
        }
        out.push((field.name.to_string(), values, kind != Kind::Plain));
    }
    Ok(out)
}

fn damaged(problem: String) -> PolarsError {
    PolarsError::ComputeError(problem.into())
}

/// Footer and types of a file.
fn opened(bytes: &[u8]) -> PolarsResult<(FileMetadata, ArrowSchema)> {
    let footer = || -> PolarsResult<(FileMetadata, ArrowSchema)> {
        let metadata = read_metadata(&mut Cursor::new(bytes))?;
        let schema = infer_schema(&metadata)?;
        Ok((metadata, schema))
    };
    let (metadata, schema) = guarded(footer).ok_or_else(|| damaged("its footer is damaged".to_owned()))??;
    let groups = metadata.row_groups.iter().map(|g| g.num_rows() as u64).fold(0, u64::saturating_add);
    let rows = metadata.num_rows as u64;
    if rows != groups {
        return Err(damaged(format!("{rows} rows, but {groups} in its parts")));
    }
    if rows.saturating_mul(8 * schema.len() as u64) > MOST_BYTES {
        return Err(damaged(format!(
            "{rows} rows of {} columns are more than a table may have in memory",
            schema.len()
        )));
    }
    Ok((metadata, schema))
}

/// The result of a decoder of another library, `None` where it panics. Its message is not printed.
fn guarded<T>(decode: impl FnOnce() -> T) -> Option<T> {
    thread_local! {
        static GUARDED: Cell<bool> = const { Cell::new(false) };
    }
    static QUIET: Once = Once::new();
    QUIET.call_once(|| {
        let usual = take_hook();
        set_hook(Box::new(move |panic| {
            if !GUARDED.get() {
                usual(panic);
            }
        }));
    });
    GUARDED.set(true);
    let out = catch_unwind(AssertUnwindSafe(decode));
    GUARDED.set(false);
    // none: a file that the reader gives up on is no table, which the caller says
    out.ok()
}

/// One column of a file. polars' decoder panics on some pages whose levels or values are damaged.
fn column(bytes: &[u8], metadata: &FileMetadata, field: &ArrowField, unpacker: &mut Unpacker) -> PolarsResult<Column> {
    guarded(|| decoded(bytes, metadata, field, unpacker))
        .ok_or_else(|| damaged(format!("column `{}`: its pages are damaged", field.name)))?
}

fn decoded(bytes: &[u8], metadata: &FileMetadata, field: &ArrowField, unpacker: &mut Unpacker) -> PolarsResult<Column> {
    let named = |problem: String| damaged(format!("column `{}`: {problem}", field.name));
    let mut chunks = Vec::new();
    for group in &metadata.row_groups {
        let of_group = group.parquet_columns();
        let (mut pages, mut types) = (Vec::new(), Vec::new());
        for column in get_field_pages(of_group, of_group, &field.name) {
            let range = column.byte_range();
            let chunk = usize::try_from(range.start)
                .ok()
                .zip(usize::try_from(range.end).ok())
                .and_then(|(start, end)| bytes.get(start..end))
                .ok_or_else(|| named("ends beyond the file".to_owned()))?;
            let values = u64::try_from(column.num_values()).map_err(|_| named("a negative size".to_owned()))?;
            if values != group.num_rows() as u64 {
                return Err(named(format!("{values} values in {} rows", group.num_rows())));
            }
            let plain = unpacker.chunk(chunk, column.compression(), values).map_err(named)?;
            let of = PageMetaData { compression: Packing::Uncompressed, ..PageMetaData::from(column) };
            let reader = PageReader::new_with_page_meta(Cursor::new(plain.into()), of, vec![], usize::MAX);
            pages.push(BasicDecompressor::new(reader, vec![]));
            types.push(&column.descriptor().descriptor.primitive_type);
        }
        let arrays = column_iter_to_arrays(pages, types, field.clone(), None)?.0;
        if arrays.iter().map(|a| a.len()).sum::<usize>() != group.num_rows() {
            return Err(named("its pages do not have the stated number of rows".to_owned()));
        }
        chunks.extend(arrays);
    }
    // a table without rows has no row group
    let series = if chunks.is_empty() {
        Series::new_empty(field.name.clone(), &DataType::from_arrow_field(field))
    } else {
        Series::try_from((field, chunks))?
    };
    Ok(series.rechunk().into())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    fn fixture(name: &str) -> Vec<u8> {
        std::fs::read(format!("{}/../../fixtures/robot_parquet/{name}.parquet", env!("CARGO_MANIFEST_DIR"))).unwrap()
    }

    const READ: [&str; 10] =
        ["none_1", "none_2", "snappy_1", "snappy_2", "gzip_1", "gzip_2", "zstd_1", "zstd_2", "lz4_1", "lz4_2"];

    #[test]
    fn validate_columns_written_by_pyarrow_with_every_compression() {
        for name in READ {
            let columns = read_numbers(&fixture(name)).unwrap();
            let names: Vec<&str> = columns.iter().map(|c| c.0.as_str()).collect();
            let expected = ["time_s", "q_hip_rad", "tau_hip_nm", "gyro_x_rad_s", "count", "contact_foot"];
            assert_eq!(names, [&expected[..], &["timestamp", "elapsed"]].concat(), "{name}");
            let times: Vec<bool> = columns.iter().map(|c| c.2).collect();
            assert_eq!(times, [false, false, false, false, false, false, true, true]);
            for i in 0..60_u8 {
                let k = f64::from(i);
                let row: Vec<f64> = columns.iter().map(|c| c.1[usize::from(i)]).collect();
                assert_eq!(row[0], 0.004 * k, "{name}");
                assert!((row[1] - (0.1 * k).sin()).abs() < 1e-15, "{name}");
                assert!(if i % 7 == 3 { row[2].is_nan() } else { row[2] == 0.25 * k }, "{name}, row {i}");
                assert_eq!(row[3], (k / 20.0).round_ties_even(), "{name}");
                assert_eq!(row[4], k, "{name}");
                assert_eq!(row[5], f64::from(u8::from(i % 20 < 5)), "{name}");
                // 2026-03-01 10:00 UTC
                assert!((row[6] - 1_772_359_200.0 - 0.004 * k).abs() < 1e-6, "{name}: {}", row[6]);
                assert!((row[7] - 0.004 * k).abs() < 1e-12, "{name}");
            }
        }
    }

    #[test]
    fn compressed_frames_come_back_as_written() {
        let frame = DataFrame::new(3, vec![Series::new("time_s".into(), [0.0, 0.1, 0.2]).into()]).unwrap();
        for compression in [Compression::Snappy, Compression::None] {
            let mut bytes = Vec::new();
            write(&frame, &mut bytes, compression, |_| false).unwrap();
            assert_eq!(read(bytes).unwrap(), frame);
        }
    }

    #[test]
    fn a_compression_that_is_not_read_is_named() {
        let problem = read_numbers(&fixture("brotli_1")).unwrap_err().to_string();
        let expected =
            "column `time_s`: compressed with brotli, expected zstd, snappy, gzip, lz4_raw or no compression";
        assert_eq!(problem, expected);
    }

    #[test]
    fn damaged_files_are_errors_or_tables() {
        for name in READ {
            let whole = fixture(name);
            for end in (0..whole.len()).step_by(37) {
                assert!(read_numbers(&whole[..end]).is_err(), "{name} cut after {end} bytes");
            }
            for at in (0..whole.len()).step_by(5) {
                for flip in [0x01, 0x80, 0xff] {
                    let mut bytes = whole.clone();
                    bytes[at] ^= flip;
                    if let Ok(columns) = read_numbers(&bytes) {
                        assert!(columns.iter().all(|c| c.1.len() == columns[0].1.len()), "{name}, byte {at}");
                    }
                }
            }
        }
    }
}
