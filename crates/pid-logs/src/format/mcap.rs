//! MCAP files with ROS 2 messages. The library reads records and unpacks chunks; schemas, channels
//! and messages are taken apart here, since it makes room for texts before it knows that they are
//! there. Source of the layout: the MCAP format specification, <https://mcap.dev/spec>.

use std::collections::BTreeMap;

use mcap::McapError;
use mcap::records::op;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::{broken, ros};
use crate::budget::Budget;
use crate::error::LogError;
use crate::log::Log;

/// A topic as the file introduces it.
struct Channel {
    topic: String,
    encoding: String,
    schema: u16,
}

/// The definition of a type.
struct Schema {
    name: String,
    /// Its text, if it is in the language of ROS 2 messages.
    text: Option<String>,
}

struct Message {
    channel: u16,
    log_time: u64,
    data: Vec<u8>,
}

/// What the records of a file hold.
#[derive(Default)]
struct Content {
    schemas: BTreeMap<u16, Schema>,
    channels: BTreeMap<u16, Channel>,
    messages: Vec<Message>,
    /// Why the file ends in the middle.
    cut: Option<String>,
}

/// Reads one MCAP file. Messages are taken in the order of their receive stamps.
pub(super) fn read(file: &str, bytes: &[u8]) -> Result<Vec<Log>, LogError> {
    let mut content = content(file, bytes)?;
    let is_cdr = |m: &Message| {
        content
            .channels
            .get(&m.channel)
            .is_some_and(|c| c.encoding == "cdr")
    };
    if !content.messages.iter().any(is_cdr) {
        let encoding = content.channels.values().next().map(|c| &c.encoding);
        let what = match encoding.filter(|_| !content.messages.is_empty()) {
            Some(encoding) => {
                format!("messages are encoded as `{encoding}`, not as ROS 2 `cdr`")
            }
            None => "the file has no messages".to_owned(),
        };
        return Err(LogError::Empty {
            file: file.to_owned(),
            what,
            mend: "record with `ros2 bag record -s mcap`".to_owned(),
        });
    }
    content.messages.retain(is_cdr);
    content.messages.sort_by_key(|m| m.log_time);
    let mut bag = ros::Bag::new(file, bytes.len());
    for message in &content.messages {
        let Some(channel) = content.channels.get(&message.channel) else {
            continue;
        };
        let schema = content.schemas.get(&channel.schema);
        let name = schema.map_or("", |s| s.name.as_str());
        let text = schema.and_then(|s| s.text.as_deref());
        let received = message.log_time.cast_signed();
        bag.add(&channel.topic, name, text, received, &message.data)?;
    }
    let mut log = bag.finish()?;
    if let Some(cut) = content.cut {
        log.warnings.push(format!(
            "the file ends in the middle ({cut}); what was read before counts"
        ));
    }
    Ok(vec![log])
}

fn content(file: &str, bytes: &[u8]) -> Result<Content, LogError> {
    let mut budget = Budget::of(bytes.len());
    // A record of an honest file is not larger than all that the file may unpack to.
    let options = LinearReaderOptions::default()
        .with_record_length_limit(budget.left())
        .with_validate_chunk_crcs(true);
    let mut reader = LinearReader::new_with_options(options);
    let mut rest = bytes;
    let mut content = Content::default();
    while let Some(event) = reader.next_event() {
        match event {
            Ok(LinearReadEvent::ReadRequest(wanted)) => {
                // Room for what is there, not for what a length asks for.
                let size = wanted.min(rest.len());
                let (now, later) = rest.split_at(size);
                reader.insert(size).copy_from_slice(now);
                reader.notify_read(size);
                rest = later;
            }
            Ok(LinearReadEvent::Record { data, opcode }) => {
                if !budget.take(16 + data.len()) {
                    return Err(broken(file, "MCAP", "it unpacks to far more than its size"));
                }
                let taken = content.take(opcode, data);
                taken.ok_or_else(|| broken(file, "MCAP", "a record ends too early"))?;
            }
            // A recording that was cut off: what was read before counts.
            Err(e @ (McapError::UnexpectedEof | McapError::UnexpectedEoc))
                if !content.messages.is_empty() =>
            {
                content.cut = Some(e.to_string());
                break;
            }
            Err(e) => return Err(broken(file, "MCAP", e)),
        }
    }
    Ok(content)
}

impl Content {
    /// Takes a record apart; `None` if it is too short.
    fn take(&mut self, opcode: u8, data: &[u8]) -> Option<()> {
        let mut fields = Fields(data);
        match opcode {
            op::SCHEMA => {
                let id = fields.u16()?;
                let (name, encoding) = (fields.text()?, fields.text()?);
                let text = fields.text()?;
                let text = Some(text).filter(|_| encoding == "ros2msg");
                self.schemas.insert(id, Schema { name, text });
            }
            op::CHANNEL => {
                let (id, schema) = (fields.u16()?, fields.u16()?);
                let (topic, encoding) = (fields.text()?, fields.text()?);
                let channel = Channel {
                    topic,
                    encoding,
                    schema,
                };
                self.channels.insert(id, channel);
            }
            op::MESSAGE => {
                let channel = fields.u16()?;
                // The number in the sequence does not matter, nor the stamp of the publisher.
                fields.bytes(4)?;
                let log_time = fields.u64()?;
                fields.bytes(8)?;
                let data = fields.0.to_vec();
                self.messages.push(Message {
                    channel,
                    log_time,
                    data,
                });
            }
            _ => {}
        }
        Some(())
    }
}

/// The fields of a record that are left.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (now, later) = self.0.split_at_checked(count)?;
        self.0 = later;
        Some(now)
    }
    fn u16(&mut self) -> Option<u16> {
        Some(u16::from_le_bytes(self.bytes(2)?.try_into().ok()?))
    }
    fn u64(&mut self) -> Option<u64> {
        Some(u64::from_le_bytes(self.bytes(8)?.try_into().ok()?))
    }
    fn text(&mut self) -> Option<String> {
        let length = u32::from_le_bytes(self.bytes(4)?.try_into().ok()?);
        let bytes = self.bytes(usize::try_from(length).ok()?)?;
        Some(String::from_utf8_lossy(bytes).into_owned())
    }
}
