//! Parquet pages unpacked in memory, with decoders in Rust alone.
//!
//! polars' own codecs for zstd, gzip and lz4 are C libraries, which take longer to build than the
//! rest of the reader. A column chunk is therefore rewritten with uncompressed pages before polars
//! sees it. Sizes that a damaged or hostile file states are checked against what its bytes can hold
//! before any memory is taken for them.

use polars_parquet::parquet::compression::Compression;
use polars_parquet::parquet::page::ParquetPageHeader as PageHeader;
use polars_parquet_format::thrift::protocol::{TCompactInputProtocol, TCompactOutputProtocol};
use polars_parquet_format::{Encoding, PageType};
use std::io::{Cursor, Read};

/// Longest header of a page, with its statistics.
const LONGEST_HEADER: usize = 1 << 24;

/// Unpacks column chunks of one file, up to a number of bytes in all.
#[derive(Debug)]
pub(crate) struct Unpacker {
    left: u64,
}

impl Unpacker {
    /// An unpacker for a file whose pages hold at most `most_bytes`.
    pub fn new(most_bytes: u64) -> Self {
        Self { left: most_bytes }
    }

    /// The pages of a chunk without compression, each with its header.
    ///
    /// # Errors
    /// In words: an unknown compression, damaged pages, pages with another number of values than
    /// `values`, more bytes than allowed.
    pub fn chunk(&mut self, bytes: &[u8], packing: Compression, values: u64) -> Result<Vec<u8>, String> {
        let mut out = Vec::new();
        let mut at = 0_usize;
        let mut found = 0_u64;
        while found < values {
            let rest = bytes.get(at..).unwrap_or_default();
            let mut reader = Cursor::new(rest);
            let mut input = TCompactInputProtocol::new(&mut reader, LONGEST_HEADER);
            let mut header =
                PageHeader::read_from_in_protocol(&mut input).map_err(|_| "the header of a page is damaged")?;
            let begin = reader.position() as usize;
            let size = |n: i32| usize::try_from(n).map_err(|_| "a page states a negative size");
            let (packed, unpacked) = (size(header.compressed_page_size)?, size(header.uncompressed_page_size)?);
            let page = begin.checked_add(packed).and_then(|end| rest.get(begin..end));
            let page = page.ok_or("a page ends beyond its column")?;
            at += begin + packed;
            self.left = self
                .left
                .checked_sub(unpacked as u64)
                .ok_or("the pages hold more bytes than a table may have in memory")?;
            let (plain, count) = match header.type_ {
                PageType::DATA_PAGE => {
                    let of = header.data_page_header.as_ref().ok_or("a page has no header of its data")?;
                    let levels = [of.definition_level_encoding, of.repetition_level_encoding];
                    if !known(of.encoding) || levels.iter().any(|e| !known(*e)) {
                        return Err("a page has an unknown encoding".to_owned());
                    }
                    (unpack(page, packing, unpacked)?, of.num_values)
                }
                PageType::DATA_PAGE_V2 => {
                    let of = header.data_page_header_v2.as_mut().ok_or("a page has no header of its data")?;
                    if !known(of.encoding) {
                        return Err("a page has an unknown encoding".to_owned());
                    }
                    let levels = size(of.definition_levels_byte_length)?
                        .checked_add(size(of.repetition_levels_byte_length)?)
                        .filter(|n| *n <= packed && *n <= unpacked)
                        .ok_or("the levels of a page end beyond it")?;
                    // the levels of such pages are never compressed
                    let (levels, data) = page.split_at(levels);
                    let mut plain = levels.to_vec();
                    if of.is_compressed.unwrap_or(true) && !data.is_empty() {
                        plain.extend(unpack(data, packing, unpacked - levels.len())?);
                    } else {
                        plain.extend_from_slice(data);
                    }
                    of.is_compressed = Some(false);
                    (plain, of.num_values)
                }
                PageType::DICTIONARY_PAGE => (unpack(page, packing, unpacked)?, 0),
                _ => continue,
            };
            if plain.len() != unpacked {
                return Err(format!("a page has {} bytes, expected {unpacked}", plain.len()));
            }
            found += u64::try_from(count).map_err(|_| "a page states a negative number of values")?;
            header.compressed_page_size = header.uncompressed_page_size;
            header.crc = None;
            let mut output = TCompactOutputProtocol::new(&mut out);
            let _ = header.write_to_out_protocol(&mut output).map_err(|e| e.to_string())?;
            out.extend_from_slice(&plain);
        }
        if found == values { Ok(out) } else { Err(format!("the pages have {found} values, expected {values}")) }
    }
}

/// True for encodings of the format; polars panics on others.
fn known(encoding: Encoding) -> bool {
    [
        Encoding::PLAIN,
        Encoding::PLAIN_DICTIONARY,
        Encoding::RLE,
        Encoding::BIT_PACKED,
        Encoding::DELTA_BINARY_PACKED,
        Encoding::DELTA_LENGTH_BYTE_ARRAY,
        Encoding::DELTA_BYTE_ARRAY,
        Encoding::RLE_DICTIONARY,
        Encoding::BYTE_STREAM_SPLIT,
    ]
    .contains(&encoding)
}

/// Data of a page. At most one byte more than `size` is unpacked, so that a page that holds more is
/// noticed.
fn unpack(packed: &[u8], packing: Compression, size: usize) -> Result<Vec<u8>, String> {
    let words = |name: &str| format!("a page compressed with {name} is damaged");
    let streamed = |name: &str, stream: &mut dyn Read| {
        let mut out = Vec::new();
        let most = (size as u64).saturating_add(1);
        let read = stream.take(most).read_to_end(&mut out).map_err(|_| words(name));
        read.map(|_| out)
    };
    // neither lz4 nor snappy makes less than a 256th of its input
    let block = |name: &str| {
        let possible = packed.len().saturating_mul(256).saturating_add(64);
        if size <= possible { Ok(vec![0; size]) } else { Err(words(name)) }
    };
    match packing {
        Compression::Uncompressed => Ok(packed.to_vec()),
        Compression::Zstd => {
            let mut stream = ruzstd::decoding::StreamingDecoder::new(packed).map_err(|_| words("zstd"))?;
            streamed("zstd", &mut stream)
        }
        Compression::Gzip => streamed("gzip", &mut flate2::read::MultiGzDecoder::new(packed)),
        Compression::Lz4Raw => {
            let mut out = block("lz4")?;
            let n = lz4_flex::block::decompress_into(packed, &mut out).map_err(|_| words("lz4"))?;
            out.truncate(n);
            Ok(out)
        }
        Compression::Snappy => {
            let mut out = block("snappy")?;
            let n = snap::raw::Decoder::new().decompress(packed, &mut out).map_err(|_| words("snappy"))?;
            out.truncate(n);
            Ok(out)
        }
        other => {
            let name = format!("{other:?}").to_lowercase();
            Err(format!("compressed with {name}, expected zstd, snappy, gzip, lz4_raw or no compression"))
        }
    }
}
