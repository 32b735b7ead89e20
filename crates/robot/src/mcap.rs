//! MCAP containers: records, chunks and channels to messages in the order of the file.
//!
//! The container is read here and not by the crate `mcap`, which would add features to libraries
//! that the whole workspace shares. Chunks may be plain or compressed with lz4 or zstd. The index
//! at the end of a file is not needed and not read. Format: <https://mcap.dev/spec>.

use crate::{RobotError, unpack};
use std::collections::BTreeMap;
use std::io::Read;

const MAGIC: [u8; 8] = [0x89, b'M', b'C', b'A', b'P', 0x30, b'\r', b'\n'];

/// A topic of one type in one encoding.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Channel {
    /// Topic.
    pub topic: String,
    /// Name of the message type, for example `sensor_msgs/msg/JointState`.
    pub schema: String,
    /// Encoding of the messages: `cdr` (ROS 2), `ros1`, or others.
    pub encoding: String,
    /// Messages as they were logged: time of logging, ns, and bytes.
    pub messages: Vec<(u64, Vec<u8>)>,
}

/// Cursor over bytes of little-endian numbers and strings.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(n)?;
        self.0 = rest;
        Some(head)
    }
    fn number(&mut self, bytes: usize) -> Option<u64> {
        Some(self.take(bytes)?.iter().rev().fold(0, |n, b| (n << 8) | u64::from(*b)))
    }
    fn text(&mut self) -> Option<String> {
        // none: longer than memory: the caller names a record that is too short
        let n = usize::try_from(self.number(4)?).ok()?;
        String::from_utf8(self.take(n)?.to_vec()).ok()
    }
}

/// Everything read so far.
#[derive(Default)]
struct Reader {
    schemas: BTreeMap<u64, String>,
    channels: BTreeMap<u64, Channel>,
    messages: usize,
    ended: bool,
    /// Bytes of the file, and of its chunks so far.
    packed: usize,
    unpacked: usize,
}

/// True for the first bytes of an MCAP file.
pub fn is_mcap(bytes: &[u8]) -> bool {
    bytes.starts_with(&MAGIC)
}

/// Channels of a file with their messages, in the order of their topics.
///
/// # Errors
/// [`RobotError::Table`] for a file that is no MCAP, is cut off, holds a damaged chunk, or one in
/// an unknown compression.
pub fn channels(file: &str, bytes: &[u8]) -> Result<Vec<Channel>, RobotError> {
    let fail = |problem: String| RobotError::Table { file: file.to_owned(), line: None, problem };
    if !is_mcap(bytes) {
        return Err(fail("its first bytes are not those of an MCAP file".to_owned()));
    }
    let mut reader = Reader { packed: bytes.len(), ..Reader::default() };
    let whole = reader.records(&bytes[MAGIC.len()..]).map_err(&fail)?;
    if !(whole && reader.ended) {
        return Err(fail(format!(
            "the file is cut off after {} whole messages ({} bytes): it was not closed, or not copied completely; \
             `mcap recover` writes what is there into a new file",
            reader.messages,
            bytes.len()
        )));
    }
    let mut out: Vec<Channel> = reader.channels.into_values().collect();
    out.sort_by(|a, b| a.topic.cmp(&b.topic));
    Ok(out)
}

impl Reader {
    /// Reads records until the end of the data; false if the last one is cut off.
    fn records(&mut self, bytes: &[u8]) -> Result<bool, String> {
        let mut rest = Fields(bytes);
        while !rest.0.is_empty() && !self.ended {
            let (Some(op), Some(length)) = (rest.number(1), rest.number(8)) else { return Ok(false) };
            // none: a truncated file, which the caller names
            let Some(body) = usize::try_from(length).ok().and_then(|n| rest.take(n)) else { return Ok(false) };
            self.record(op, body).ok_or_else(|| format!("a record of type {op:#04x} is shorter than it states"))??;
        }
        Ok(true)
    }

    /// One record; none if its fields end before they should.
    fn record(&mut self, op: u64, body: &[u8]) -> Option<Result<(), String>> {
        let mut fields = Fields(body);
        match op {
            0x03 => {
                let id = fields.number(2)?;
                self.schemas.insert(id, fields.text()?);
            }
            0x04 => {
                let (id, schema) = (fields.number(2)?, fields.number(2)?);
                let (topic, encoding) = (fields.text()?, fields.text()?);
                let schema = self.schemas.get(&schema).cloned().unwrap_or_default();
                // a channel is repeated in later chunks and in the summary
                let channel = self.channels.entry(id).or_default();
                (channel.topic, channel.schema, channel.encoding) = (topic, schema, encoding);
            }
            0x05 => {
                let (id, _sequence, time) = (fields.number(2)?, fields.number(4)?, fields.number(8)?);
                let _published = fields.number(8)?;
                self.messages += 1;
                let Some(channel) = self.channels.get_mut(&id) else {
                    return Some(Err(format!("a message is on channel {id}, which the file does not describe")));
                };
                channel.messages.push((time, fields.0.to_vec()));
            }
            0x06 => {
                let (_start, _end) = (fields.number(8)?, fields.number(8)?);
                let (size, crc) = (fields.number(8)?, fields.number(4)?);
                let compression = fields.text()?;
                // none: as for text
                let n = usize::try_from(fields.number(8)?).ok()?;
                let packed = fields.take(n)?;
                self.unpacked = self.unpacked.saturating_add(usize::try_from(size).unwrap_or(usize::MAX));
                if self.unpacked > unpack::most(self.packed) {
                    return Some(Err(unpack::too_much(self.packed)));
                }
                let records = match unpacked(&compression, packed, size) {
                    Ok(records) => records,
                    Err(problem) => return Some(Err(format!("{problem} (after {} messages)", self.messages))),
                };
                if crc != 0 && u64::from(crc32fast::hash(&records)) != crc {
                    return Some(Err(format!("a chunk is damaged (after {} messages)", self.messages)));
                }
                return Some(
                    self.records(&records)
                        .and_then(|whole| if whole { Ok(()) } else { Err("a chunk ends within a record".to_owned()) }),
                );
            }
            // end of the data: only the index follows
            0x0f => self.ended = true,
            _ => {}
        }
        Some(Ok(()))
    }
}

/// The records of a chunk.
fn unpacked(compression: &str, packed: &[u8], size: u64) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    let read = match compression {
        "" => return Ok(packed.to_vec()),
        "lz4" => lz4_flex::frame::FrameDecoder::new(packed).take(size).read_to_end(&mut out).map_err(|e| e.to_string()),
        "zstd" => ruzstd::decoding::StreamingDecoder::new(packed)
            .map_err(|e| e.to_string())
            .and_then(|d| d.take(size).read_to_end(&mut out).map_err(|e| e.to_string())),
        other => return Err(format!("a chunk is compressed with `{other}`, expected lz4, zstd or none")),
    };
    read.map_err(|e| format!("a chunk in {compression} is damaged: {e}"))?;
    if out.len() as u64 != size {
        return Err(format!("a chunk in {compression} has {} bytes, expected {size}", out.len()));
    }
    Ok(out)
}
