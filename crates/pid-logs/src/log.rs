//! What every format is read into: channels over clocks, one log per experiment.

/// One recording: its channels, each over one of its clocks.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Log {
    /// The file it comes from, as given.
    pub file: String,
    /// Name of the experiment, from that of the file.
    pub name: String,
    /// Tables or topics.
    pub clocks: Vec<Clock>,
    /// All numeric channels.
    pub channels: Vec<Channel>,
    /// What was decided while reading, such as which stamps count.
    pub notes: Vec<String>,
    /// What was left out.
    pub warnings: Vec<String>,
}

/// Rows that belong together: a table, or the messages of one topic.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Clock {
    /// Topic or table; empty for a file with one table.
    pub name: String,
    /// Times of the rows, s, from a start that all clocks of the log share; `None` if one of the
    /// channels holds them.
    pub t: Option<Vec<f64>>,
    /// Number of rows.
    pub rows: usize,
    /// How rows are named in messages.
    pub row_word: RowWord,
}

/// How the rows of a clock are named and counted.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum RowWord {
    /// `row 1` is the first.
    #[default]
    Row,
    /// `message 1` is the first.
    Message,
    /// Lines of a text file, one for each row.
    Line(Vec<u32>),
}

impl RowWord {
    /// The name of row `index`, which counts from 0.
    pub(crate) fn name(&self, index: usize) -> String {
        match self {
            RowWord::Row => format!("row {}", index + 1),
            RowWord::Message => format!("message {}", index + 1),
            RowWord::Line(lines) => format!("line {}", lines.get(index).copied().unwrap_or(0)),
        }
    }
}

/// One numeric channel.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Channel {
    /// Its name; units in brackets and indices such as `[2]` are part of it.
    pub name: String,
    /// Unit, where the format states it beside the name.
    pub unit: Option<String>,
    /// Which of the clocks.
    pub clock: usize,
    /// One value for each row; NaN where missing.
    pub values: Vec<f64>,
    /// What was taken off all values so that whole numbers beyond 2^53 keep their differences.
    pub offset: f64,
    /// The first cell that is no finite number: row from 0 and text.
    pub bad: Option<(usize, String)>,
    /// What the format says the channel is, where its name does not.
    pub hint: Option<Hint>,
}

/// What a format says of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hint {
    /// A measured position.
    Position,
    /// A commanded position.
    Target,
}

impl Log {
    /// A log with the experiment's name from that of the file.
    pub fn new(file: &str) -> Self {
        let path = std::path::Path::new(file);
        let stem = path.file_stem().and_then(std::ffi::OsStr::to_str);
        Self {
            file: file.to_owned(),
            name: stem.unwrap_or("log").to_owned(),
            ..Self::default()
        }
    }
}

impl Channel {
    /// A channel of finite or missing (NaN) values; the first infinite one is noted.
    pub fn new(name: String, clock: usize, values: Vec<f64>) -> Self {
        let bad = values.iter().position(|v| v.is_infinite());
        Self {
            bad: bad.map(|row| (row, values[row].to_string())),
            name,
            clock,
            values,
            ..Self::default()
        }
    }

    /// Name, unit and the rest.
    #[cfg(feature = "parquet")]
    pub(crate) fn without_values(&self) -> Self {
        Self {
            name: self.name.clone(),
            unit: self.unit.clone(),
            clock: self.clock,
            values: Vec::new(),
            offset: self.offset,
            bad: self.bad.clone(),
            hint: self.hint,
        }
    }

    /// A channel of whole numbers, without loss of their differences.
    pub fn of_integers(name: String, clock: usize, values: &[Option<i64>]) -> Self {
        /// Whole numbers up to this are exact as f64.
        const EXACT: u64 = 1 << 53;
        let large = |v: &Option<i64>| v.is_some_and(|v| v.unsigned_abs() > EXACT);
        let first = values.iter().flatten().next().copied().unwrap_or(0);
        let offset = if values.iter().any(large) { first } else { 0 };
        let number = |v: &Option<i64>| v.map_or(f64::NAN, |v| v.wrapping_sub(offset) as f64);
        Self {
            offset: offset as f64,
            ..Self::new(name, clock, values.iter().map(number).collect())
        }
    }
}
