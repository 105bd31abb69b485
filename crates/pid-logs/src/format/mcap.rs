//! MCAP files with ROS 2 messages.

use std::io::Cursor;

use mcap::io::MessageReader;
use mcap::sans_io::LinearReaderOptions;

use super::{broken, ros};
use crate::error::LogError;
use crate::log::{Budget, Log};

/// Reads one MCAP file. Messages are taken in the order of their receive stamps.
pub(super) fn read(file: &str, bytes: &[u8]) -> Result<Vec<Log>, LogError> {
    let fault = |e: mcap::McapError| broken(file, "MCAP", e);
    let mut bag = ros::Bag::new(file, bytes.len());
    let mut budget = Budget::of(bytes.len());
    let mut messages = Vec::new();
    let mut foreign: Option<String> = None;
    let mut cut = None;
    // A record of an honest file is not larger than all that the file may unpack to.
    let options = LinearReaderOptions::default()
        .with_record_length_limit(budget.left())
        .with_validate_chunk_crcs(true);
    for message in MessageReader::new_with_options(Cursor::new(bytes), options) {
        let message = match message {
            Ok(message) => message,
            // A recording that was cut off: what was read before counts.
            Err(e @ (mcap::McapError::UnexpectedEof | mcap::McapError::UnexpectedEoc))
                if !messages.is_empty() =>
            {
                cut = Some(e.to_string());
                break;
            }
            Err(e) => return Err(fault(e)),
        };
        if !matches!(message.channel.message_encoding.as_str(), "cdr") {
            foreign.get_or_insert_with(|| message.channel.message_encoding.clone());
            continue;
        }
        if !budget.take(64 + message.data.len()) {
            return Err(broken(file, "MCAP", "it unpacks to far more than its size"));
        }
        messages.push(message);
    }
    if messages.is_empty() {
        let what = match foreign {
            Some(encoding) => format!("messages are encoded as `{encoding}`, not as ROS 2 `cdr`"),
            None => "the file has no messages".to_owned(),
        };
        return Err(LogError::Empty {
            file: file.to_owned(),
            what,
            mend: "record with `ros2 bag record -s mcap`".to_owned(),
        });
    }
    messages.sort_by_key(|m| m.log_time);
    for message in &messages {
        let schema = message.channel.schema.as_ref();
        let name = schema.map_or("", |s| s.name.as_str());
        let text = schema
            .filter(|s| s.encoding == "ros2msg")
            .and_then(|s| std::str::from_utf8(&s.data).ok());
        bag.add(
            &message.channel.topic,
            name,
            text,
            message.log_time.cast_signed(),
            &message.data,
        )?;
    }
    let mut log = bag.finish()?;
    if let Some(cut) = cut {
        log.warnings.push(format!(
            "the file ends in the middle ({cut}); what was read before counts"
        ));
    }
    Ok(vec![log])
}
