//! Text tables: CSV and its kin. Separator, decimal mark, comments, header and units are found.

use std::borrow::Cow;

use crate::error::LogError;
use crate::log::{Channel, Clock, Log, RowWord};
use crate::units::Unit;

use super::broken;

/// How cells are parted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Separator {
    Byte(u8),
    /// Runs of blanks.
    Blanks,
}

/// The cells of a line; borrowed from it unless they had quotes.
type Cells<'a> = Vec<Cow<'a, str>>;

/// One line as cells.
struct Row<'a> {
    line: u32,
    cells: Cells<'a>,
}

/// Reads one text file.
pub(super) fn read(file: &str, bytes: &[u8]) -> Result<Vec<Log>, LogError> {
    let text = decode(bytes).ok_or_else(|| LogError::Format {
        file: file.to_owned(),
        found: "is of no kind that is read: CSV or other text, MCAP, db3, Parquet, NPZ, MAT 5"
            .to_owned(),
        mend: "convert it to one of these".to_owned(),
    })?;
    let separator = separator(&text);
    let (comment, mut rows) = split(file, &text, separator)?;
    let empty = |what: &str| LogError::Empty {
        file: file.to_owned(),
        what: what.to_owned(),
        mend: "the file needs a header with names and one row per sample".to_owned(),
    };
    if rows.is_empty() {
        return Err(empty("the file has no rows"));
    }
    let comma = decimal_comma(&rows, separator);
    let header = header(comment, &mut rows, comma)
        .ok_or_else(|| empty("the first row has numbers, not names"))?;
    let mut log = Log::new(file);
    let mut units = vec![None; header.len()];
    if rows.first().is_some_and(|r| is_units(&r.cells)) {
        for (unit, cell) in units.iter_mut().zip(rows.remove(0).cells) {
            let cell = cell.trim_matches(['[', ']', '(', ')', ' ']).to_owned();
            *unit = Some(cell).filter(|c| !c.is_empty());
        }
    }
    drop_torn_row(&mut rows, header.len(), &mut log);
    if rows.is_empty() {
        return Err(empty("the file has a header but no samples"));
    }
    if comma {
        log.notes.push("`,` is the decimal mark".to_owned());
    }
    log.channels = columns(file, &header, &rows, comma)?;
    for (channel, unit) in log.channels.iter_mut().zip(units) {
        channel.unit = unit;
    }
    log.channels.retain(|c| !c.name.is_empty());
    log.clocks = vec![Clock {
        rows: rows.len(),
        row_word: RowWord::Line(rows.iter().map(|r| r.line).collect()),
        ..Clock::default()
    }];
    Ok(vec![log])
}

/// UTF-8, UTF-16 with its mark, or Latin-1; `None` for what is no text.
fn decode(bytes: &[u8]) -> Option<String> {
    let wide = |read: fn([u8; 2]) -> u16| {
        let units = bytes[2..].chunks_exact(2).map(|b| read([b[0], b[1]]));
        char::decode_utf16(units)
            .collect::<Result<String, _>>()
            .ok()
    };
    if bytes.starts_with(&[0xff, 0xfe]) {
        return wide(u16::from_le_bytes);
    }
    if bytes.starts_with(&[0xfe, 0xff]) {
        return wide(u16::from_be_bytes);
    }
    let control = |b: &u8| *b < 32 && !matches!(*b, b'\n' | b'\r' | b'\t' | 12 | 26);
    if bytes.iter().any(control) {
        return None;
    }
    let bytes = bytes.strip_prefix(&[0xef, 0xbb, 0xbf]).unwrap_or(bytes);
    match std::str::from_utf8(bytes) {
        Ok(text) => Some(text.to_owned()),
        Err(_) => Some(bytes.iter().map(|&b| char::from(b)).collect()),
    }
}

/// A comment without its sign.
fn comment_of(line: &str) -> Option<&str> {
    let line = line.trim_start();
    ["#", "%", "//"]
        .iter()
        .find_map(|sign| line.strip_prefix(sign))
}

/// The separator that parts the first lines into the same number of cells, more than one.
fn separator(text: &str) -> Separator {
    let lines: Vec<&str> = text
        .lines()
        .filter(|l| !l.trim().is_empty() && comment_of(l).is_none())
        .take(20)
        .collect();
    // A decimal comma cannot part cells that `;` or a tab parts; blanks part what nothing else does.
    for sign in *b"\t;,|" {
        let counts = |line: &&str| {
            let mut quoted = false;
            let count = line.bytes().filter(|&b| {
                quoted ^= b == b'"';
                b == sign && !quoted
            });
            count.count()
        };
        let first = lines.first().map_or(0, counts);
        let alike = lines.iter().filter(|l| counts(l) == first).count();
        if first > 0 && 2 * alike > lines.len() {
            return Separator::Byte(sign);
        }
    }
    Separator::Blanks
}

/// The last comment before the first row, and all rows that are neither blank nor comments.
fn split<'a>(
    file: &str,
    text: &'a str,
    separator: Separator,
) -> Result<(Option<Cells<'a>>, Vec<Row<'a>>), LogError> {
    let mut comment: Option<&'a str> = None;
    let mut rows: Vec<Row<'a>> = Vec::new();
    for (index, line) in text.split('\n').enumerate() {
        let line = line.trim_end_matches('\r');
        if line.trim().is_empty() {
            continue;
        }
        if let Some(said) = comment_of(line) {
            if rows.is_empty() && !said.trim().is_empty() {
                comment = Some(said);
            }
            continue;
        }
        let line_number = u32::try_from(index + 1).unwrap_or(u32::MAX);
        rows.push(Row {
            line: line_number,
            cells: cells(file, line_number, line, separator)?,
        });
    }
    let comment = match comment {
        Some(said) => Some(cells(file, 1, said, separator)?),
        None => None,
    };
    Ok((comment, rows))
}

/// The cells of one line.
fn cells<'a>(
    file: &str,
    number: u32,
    line: &'a str,
    separator: Separator,
) -> Result<Cells<'a>, LogError> {
    match separator {
        Separator::Byte(sign) if !line.contains('"') => Ok(line
            .split(char::from(sign))
            .map(|c| Cow::Borrowed(c.trim()))
            .collect()),
        Separator::Byte(sign) => {
            let mut reader = csv::ReaderBuilder::new()
                .has_headers(false)
                .delimiter(sign)
                .trim(csv::Trim::All)
                .from_reader(line.as_bytes());
            let record = reader.records().next();
            let record = record
                .transpose()
                .map_err(|e| broken(file, "text", format!("line {number}: {e}")))?;
            // A blank before a quote makes the quote part of the text.
            let bare = |c: &str| Cow::Owned(c.trim_matches('"').trim().to_owned());
            Ok(record.iter().flatten().map(bare).collect())
        }
        Separator::Blanks => Ok(blank_cells(line)),
    }
}

/// Cells between runs of blanks; `q1 [deg]` and `q1 (deg)` are one cell.
fn blank_cells(line: &str) -> Cells<'_> {
    let mut out: Vec<Cow<'_, str>> = Vec::new();
    for cell in line.split_whitespace() {
        let unit = cell.starts_with(['[', '(']) && cell.ends_with([']', ')']);
        match out.last_mut() {
            Some(name) if unit && !name.ends_with([']', ')']) => {
                let name = name.to_mut();
                name.push(' ');
                name.push_str(cell);
            }
            _ => out.push(Cow::Borrowed(cell)),
        }
    }
    out
}

/// Whether `,` is the decimal mark: it does not part cells, and numbers have it.
fn decimal_comma(rows: &[Row<'_>], separator: Separator) -> bool {
    if separator == Separator::Byte(b',') {
        return false;
    }
    let with_comma = |c: &Cow<'_, str>| c.contains(',') && number(c, true).is_some();
    let with_point = |c: &Cow<'_, str>| c.contains('.') && number(c, false).is_some();
    let cells = || rows.iter().take(200).flat_map(|r| &r.cells);
    cells().any(with_comma) && !cells().any(with_point)
}

/// The names: the first row without numbers, or a comment above the first row with as many cells.
fn header(comment: Option<Cells<'_>>, rows: &mut Vec<Row<'_>>, comma: bool) -> Option<Vec<String>> {
    let numeric = |c: &Cow<'_, str>| number(c, comma).is_some();
    let first = rows.first()?;
    if !first.cells.iter().any(numeric) {
        return Some(owned(rows.remove(0).cells));
    }
    comment
        .filter(|c| c.len() == first.cells.len() && !c.iter().any(numeric))
        .map(owned)
}

/// Names outlive their rows.
fn owned(cells: Cells<'_>) -> Vec<String> {
    cells.into_iter().map(Cow::into_owned).collect()
}

/// Whether a row below the header states units: no number in it, at least one unit.
fn is_units(cells: &[Cow<'_, str>]) -> bool {
    let unit = |c: &Cow<'_, str>| Unit::parse(c.trim_matches(['[', ']', '(', ')', ' '])).is_some();
    cells.iter().any(unit)
        && cells
            .iter()
            .all(|c| number(c, false).is_none() && number(c, true).is_none())
}

/// Leaves out a last row that ends in the middle, as after a power cut.
fn drop_torn_row(rows: &mut Vec<Row<'_>>, cells: usize, log: &mut Log) {
    if let Some(last) = rows.last()
        && last.cells.len() < cells
        && rows.len() > 1
    {
        log.warnings.push(format!(
            "line {} ends in the middle and is left out",
            last.line
        ));
        rows.pop();
    }
}

fn columns(
    file: &str,
    header: &[String],
    rows: &[Row<'_>],
    comma: bool,
) -> Result<Vec<Channel>, LogError> {
    for row in rows {
        // A separator at the end of every row makes a cell without a name.
        let tail =
            row.cells.len() == header.len() + 1 && row.cells.last().is_some_and(|c| c.is_empty());
        if row.cells.len() != header.len() && !tail {
            return Err(LogError::Cells {
                file: file.to_owned(),
                row: row.line as usize,
                found: row.cells.len(),
                expected: header.len(),
            });
        }
    }
    Ok(header
        .iter()
        .enumerate()
        .map(|(c, name)| column(name, c, rows, comma))
        .collect())
}

/// One column as a channel.
fn column(name: &str, c: usize, rows: &[Row<'_>], comma: bool) -> Channel {
    let cell = |row: &Row<'_>| row.cells.get(c).map_or("", |c| c.as_ref()).to_owned();
    // Stamps in nanoseconds since 1970 do not fit into a double.
    const DIGITS: usize = 16;
    let whole = |row: &Row<'_>| {
        let cell = cell(row);
        cell.parse::<i64>()
            .map(Some)
            .or(if is_missing(&cell) { Ok(None) } else { Err(()) })
    };
    if rows.first().is_some_and(|r| cell(r).len() >= DIGITS)
        && let Ok(numbers) = rows.iter().map(whole).collect::<Result<Vec<_>, ()>>()
    {
        return Channel::of_integers(name.to_owned(), 0, &numbers);
    }
    let mut bad = None;
    let values = rows.iter().enumerate().map(|(i, row)| {
        let text = row.cells.get(c).map_or("", |c| c.as_ref());
        if is_missing(text) {
            return f64::NAN;
        }
        match number(text, comma) {
            Some(value) if value.is_finite() => value,
            _ => {
                bad.get_or_insert_with(|| (i, text.to_owned()));
                f64::NAN
            }
        }
    });
    let values = values.collect();
    Channel {
        bad,
        ..Channel::new(name.to_owned(), 0, values)
    }
}

/// Cells that programs write for a missing sample.
fn is_missing(cell: &str) -> bool {
    matches!(
        cell,
        "" | "nan" | "NaN" | "NAN" | "-nan" | "null" | "NULL" | "None" | "NA" | "N/A"
    )
}

/// The number in a cell.
fn number(cell: &str, comma: bool) -> Option<f64> {
    let cell = cell.trim();
    if !cell.starts_with(|c: char| c.is_ascii_digit() || matches!(c, '-' | '+' | '.' | ','))
        && !matches!(cell, "inf" | "Inf" | "infinity")
    {
        return None;
    }
    if comma && cell.matches(',').count() == 1 && !cell.contains('.') {
        return cell.replace(',', ".").parse().ok();
    }
    cell.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn log(text: &str) -> Log {
        read("f.csv", text.as_bytes()).unwrap().remove(0)
    }

    fn channel<'a>(log: &'a Log, name: &str) -> &'a Channel {
        let found = log.channels.iter().find(|c| c.name == name);
        found.unwrap_or_else(|| panic!("{name} in {:?}", log.channels))
    }

    #[test]
    fn separators_decimal_marks_and_comments_are_found() {
        for text in [
            "t,q1 [deg],u1\n0,1.5,2\n0.5,2.5,3\n",
            "t;q1 [deg];u1\n0;1,5;2\n0,5;2,5;3\n",
            "t\tq1 [deg]\tu1\n0\t1.5\t2\n0.5\t2.5\t3\n",
            "# made by a rig\nt q1 [deg]  u1\n0   1.5 2\n0.5 2.5 3\n",
            "# t,q1 [deg],u1\n0,1.5,2\n0.5,2.5,3\n",
            "\u{feff}t,q1 [deg],u1\r\n0,1.5,2\r\n0.5,2.5,3\r\n",
            "t, \"q1 [deg]\" ,u1,\n0,1.5,2,\n0.5,\"2.5\",3,\n",
            "t|q1 [deg]|u1\n0|1.5|2\n0.5|2.5|3\n",
        ] {
            let log = log(text);
            assert_eq!(channel(&log, "t").values, [0.0, 0.5], "{text}");
            assert_eq!(channel(&log, "q1 [deg]").values, [1.5, 2.5], "{text}");
            assert_eq!(channel(&log, "u1").values, [2.0, 3.0], "{text}");
        }
    }

    #[test]
    fn a_row_of_units_is_read_as_such() {
        let log = log("t;q1;u1\n[ms];deg;mA\n0;1,5;2\n1;2,5;3\n");
        let units: Vec<_> = log
            .channels
            .iter()
            .map(|c| c.unit.as_deref().unwrap())
            .collect();
        assert_eq!(units, ["ms", "deg", "mA"]);
        assert_eq!(channel(&log, "q1").values, [1.5, 2.5]);
    }

    #[test]
    fn large_stamps_keep_their_differences() {
        let log = log("stamp,q1\n1700000000000000001,1\n1700000000001000002,2\n");
        assert_eq!(channel(&log, "stamp").values, [0.0, 1_000_001.0]);
        assert_eq!(
            channel(&log, "stamp").offset,
            1_700_000_000_000_000_001_i64 as f64
        );
    }

    #[test]
    fn odd_rows_are_named_and_a_torn_last_one_left_out() {
        let torn = log("t,q1,u1\n0,1,2\n1,2,3\n2,3");
        assert_eq!(
            (
                torn.channels[0].values.len(),
                torn.warnings[0].contains("line 4")
            ),
            (2, true)
        );
        let odd = read("f.csv", b"t,q1,u1\n0,1,2\n1,2\n2,3,4\n")
            .unwrap_err()
            .to_string();
        assert!(odd.contains("f.csv: line 3: 2 cells"), "{odd}");
        let words = log("t,q1,mode\n0,1,idle\n1,x,run\n");
        assert_eq!(channel(&words, "q1").bad, Some((1, "x".to_owned())));
        let none = read("f.csv", b"0,1,2\n1,2,3\n").unwrap_err().to_string();
        assert!(none.contains("numbers, not names"), "{none}");
    }

    #[test]
    fn other_encodings_are_text_and_binary_is_not() {
        let wide: Vec<u8> = [0xff, 0xfe]
            .into_iter()
            .chain("t,q1\n0,1\n1,2\n".encode_utf16().flat_map(u16::to_le_bytes))
            .collect();
        assert_eq!(
            read("f.csv", &wide).unwrap()[0].channels[1].values,
            [1.0, 2.0]
        );
        assert_eq!(
            read("f.csv", b"t,q1 [\xb0]\n0,1\n1,2\n").unwrap()[0].channels[1].name,
            "q1 [°]"
        );
        let binary = read("f.bin", b"\x00\x01\x02\x03").unwrap_err().to_string();
        assert!(binary.contains("of no kind that is read"), "{binary}");
    }
}
