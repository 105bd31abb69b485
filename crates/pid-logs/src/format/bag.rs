//! ROS 2 bags in SQLite, `.db3`.

use rusqlite::{Connection, MAIN_DB};

use super::{broken, ros};
use crate::error::LogError;
use crate::log::Log;

/// Reads one `.db3` file.
pub(super) fn read(file: &str, mut bytes: Vec<u8>) -> Result<Vec<Log>, LogError> {
    let fault = |e: rusqlite::Error| broken(file, "rosbag2", e);
    // Bytes 18 and 19 of the header say 2 for a database with a write-ahead log, which memory does
    // not have; 1 reads what the file itself holds.
    for byte in bytes.iter_mut().skip(18).take(2) {
        *byte = (*byte).min(1);
    }
    let size = bytes.len();
    let mut connection = Connection::open_in_memory().map_err(fault)?;
    connection
        .deserialize_read_exact(MAIN_DB, bytes.as_slice(), size, true)
        .map_err(fault)?;
    drop(bytes);
    let definitions = definitions(&connection).unwrap_or_default();
    let mut bag = ros::Bag::new(file, size);
    let mut statement = connection
        .prepare(
            "SELECT topics.name, topics.type, topics.serialization_format, messages.timestamp, messages.data \
             FROM messages JOIN topics ON messages.topic_id = topics.id ORDER BY messages.timestamp, messages.id",
        )
        .map_err(fault)?;
    let mut rows = statement.query([]).map_err(fault)?;
    while let Some(row) = rows.next().map_err(fault)? {
        let text = |i: usize| {
            row.get_ref(i)
                .and_then(|v| v.as_str().map_err(Into::into))
                .map_err(fault)
        };
        let (name, message_type, encoding) = (text(0)?, text(1)?, text(2)?);
        if encoding != "cdr" {
            continue;
        }
        let received: i64 = row.get(3).map_err(fault)?;
        let data = row
            .get_ref(4)
            .and_then(|v| v.as_blob().map_err(Into::into))
            .map_err(fault)?;
        let schema = definitions
            .iter()
            .find(|(t, _)| t == message_type)
            .map(|(_, text)| text.as_str());
        bag.add(name, message_type, schema, received, data)?;
    }
    Ok(vec![bag.finish()?])
}

/// Type and text of the definitions that newer bags store.
fn definitions(connection: &Connection) -> rusqlite::Result<Vec<(String, String)>> {
    let mut statement = connection.prepare(
        "SELECT topic_type, encoded_message_definition FROM message_definitions WHERE encoding = 'ros2msg'",
    )?;
    let rows = statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?;
    rows.collect()
}
