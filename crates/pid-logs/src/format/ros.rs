//! ROS 2 messages as channels: any message type is read by its definition, so that topics of
//! vendors can be mapped.

mod cdr;
mod definition;
mod flatten;

use std::collections::BTreeMap;

use crate::budget::Budget;
use crate::error::LogError;
use crate::log::{Channel, Clock, Log, RowWord};

use definition::Definition;

/// The messages of one topic with one set of labels, as they come in.
#[derive(Debug, Default)]
struct Table {
    /// Receive stamps, ns.
    received: Vec<i64>,
    /// Stamps in the headers, ns; as many as rows where every message has one.
    header: Vec<i64>,
    /// Names within the topic.
    names: Vec<String>,
    /// Row by row, as many as names.
    values: Vec<f64>,
}

/// One topic.
struct Topic {
    name: String,
    /// How its messages are read; the reason why not.
    definition: Result<Definition, String>,
    /// By labels: publishers of different joints may share a topic.
    tables: BTreeMap<Vec<String>, Table>,
    messages: usize,
    /// Messages that could not be read, and the first fault.
    faults: (usize, Option<LogError>),
}

/// Collects the messages of a bag.
pub(super) struct Bag {
    file: String,
    topics: BTreeMap<String, Topic>,
    budget: Budget,
}

/// Mend of messages that cannot be read.
const MEND: &str =
    "record with the definition of the message in the file (MCAP does), or leave the topic out";

impl Bag {
    /// A bag of a file with so many bytes.
    pub(super) fn new(file: &str, bytes: usize) -> Self {
        Self {
            file: file.to_owned(),
            topics: BTreeMap::new(),
            budget: Budget::of(bytes),
        }
    }

    /// Adds a message. `schema` is the text of the type's definition, where the file has it.
    pub(super) fn add(
        &mut self,
        name: &str,
        message_type: &str,
        schema: Option<&str>,
        received: i64,
        data: &[u8],
    ) -> Result<(), LogError> {
        if !self.topics.contains_key(name) {
            let topic = Topic {
                name: name.to_owned(),
                definition: Definition::of(message_type, schema),
                tables: BTreeMap::new(),
                messages: 0,
                faults: (0, None),
            };
            self.topics.insert(name.to_owned(), topic);
        }
        let Some(topic) = self.topics.get_mut(name) else {
            return Ok(());
        };
        topic.messages += 1;
        let Ok(definition) = &topic.definition else {
            return Ok(());
        };
        let row = match flatten::read(definition, data) {
            Ok(row) => row,
            Err(message) => {
                topic.faults.0 += 1;
                topic.faults.1.get_or_insert_with(|| LogError::Message {
                    file: self.file.clone(),
                    topic: name.to_owned(),
                    row: topic.messages,
                    message,
                    mend: MEND,
                });
                return Ok(());
            }
        };
        if !self.budget.take(32 + 8 * row.values.len()) {
            return Err(super::broken(
                &self.file,
                "bag",
                "it unpacks to far more than its size",
            ));
        }
        let table = topic
            .tables
            .entry(row.names)
            .or_insert_with_key(|names| Table {
                names: names.clone(),
                ..Table::default()
            });
        table.received.push(received);
        table.header.extend(row.stamp);
        table.values.extend(row.values);
        Ok(())
    }

    /// The log of all topics.
    pub(super) fn finish(self) -> Result<Log, LogError> {
        let mut log = Log::new(&self.file);
        let first = self.start();
        let all: usize = self.topics.values().map(|t| t.messages).sum();
        for topic in self.topics.into_values() {
            let known = match &topic.definition {
                Ok(definition) => definition.known,
                Err(reason) => {
                    log.warnings
                        .push(format!("topic `{}` is left out: {reason}", topic.name));
                    continue;
                }
            };
            if let (faults, Some(fault)) = topic.faults {
                if known && faults == topic.messages {
                    // A topic that was said to be readable and is not: never a silent gap.
                    return Err(fault);
                }
                log.warnings.push(format!(
                    "{faults} messages of topic `{}` are broken and left out",
                    topic.name
                ));
            }
            for table in topic.tables.into_values() {
                add_table(&mut log, &topic.name, table, first);
            }
        }
        if log.channels.is_empty() {
            return Err(LogError::Empty {
                file: self.file,
                what: format!(
                    "no numbers in {all} messages{}",
                    log.warnings.iter().fold(String::new(), |a, n| a + "; " + n)
                ),
                mend: "record sensor_msgs/msg/JointState, or another type with its definition"
                    .to_owned(),
            });
        }
        Ok(log)
    }

    /// The first stamp, ns: all times count from it.
    fn start(&self) -> i64 {
        let tables = self.topics.values().flat_map(|t| t.tables.values());
        tables
            .map(|t| t.stamps().0.iter().min().copied().unwrap_or(i64::MAX))
            .min()
            .unwrap_or(0)
    }
}

impl Table {
    /// Stamps of the headers where every message has one, otherwise those of the receiver.
    fn stamps(&self) -> (&[i64], bool) {
        // A header that nobody filled in says 0; a simulation's first one does too.
        let filled = self.header.iter().any(|stamp| *stamp != 0);
        let whole = filled && self.header.len() == self.received.len();
        if whole {
            (&self.header, true)
        } else {
            (&self.received, false)
        }
    }
}

fn add_table(log: &mut Log, topic: &str, table: Table, first: i64) {
    let (stamps, of_header) = table.stamps();
    let which = if of_header {
        "header stamps"
    } else {
        "receive stamps"
    };
    let reason = if of_header {
        "every message has one"
    } else {
        "not every message has a header stamp"
    };
    log.notes.push(format!(
        "topic `{topic}`: time is that of the {which}, since {reason}"
    ));
    let clock = log.clocks.len();
    let seconds = |ns: &i64| ns.wrapping_sub(first) as f64 / 1e9;
    log.clocks.push(Clock {
        name: topic.to_owned(),
        t: Some(stamps.iter().map(seconds).collect()),
        rows: stamps.len(),
        row_word: RowWord::Message,
    });
    let width = table.names.len();
    for (c, name) in table.names.iter().enumerate() {
        let values = table
            .values
            .iter()
            .skip(c)
            .step_by(width)
            .copied()
            .collect();
        let separator = if name.starts_with('[') { "" } else { "/" };
        log.channels.push(Channel::new(
            format!("{topic}{separator}{name}"),
            clock,
            values,
        ));
    }
}
