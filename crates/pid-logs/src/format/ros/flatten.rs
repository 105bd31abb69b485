//! One message as a row of named numbers.
//!
//! A struct with a list of names (`name`, `joint_names`, `interface_names`) gives its labels to all
//! arrays of the same length beside it, also within structs beside it. So `position[1]` of a
//! `JointState` becomes `elbow/position`, and an array of a `DynamicJointState` `elbow/effort`.

use super::cdr::Reader;
use super::definition::{Definition, Element, Field, Shape};

/// The numbers of a message.
#[derive(Debug, Default)]
pub(super) struct Row {
    /// Stamp of the header, ns.
    pub(super) stamp: Option<i64>,
    pub(super) names: Vec<String>,
    pub(super) values: Vec<f64>,
}

/// A value as read.
#[derive(Debug)]
enum Value {
    Number(f64),
    Text(String),
    Struct(Vec<(String, Value)>),
    List(Vec<Value>),
}

/// Arrays longer than this are images or clouds, not joints.
const LONGEST: usize = 512;
/// Values of one message at most, so that nested arrays of a hostile definition stay small.
const MOST: usize = 1 << 16;
/// Fields that name the elements of the arrays beside them.
const LABELS: [&str; 4] = ["name", "names", "joint_names", "interface_names"];

/// Reads a message.
pub(super) fn read(definition: &Definition, message: &[u8]) -> Result<Row, String> {
    let mut reader = Reader::new(message)?;
    let mut budget = MOST;
    let value = structure(definition, definition.root, &mut reader, &mut budget)?;
    let mut row = Row {
        stamp: stamp(&value),
        ..Row::default()
    };
    flatten(&value, "", "", &[], &mut row);
    Ok(row)
}

fn structure(
    d: &Definition,
    index: usize,
    reader: &mut Reader<'_>,
    budget: &mut usize,
) -> Result<Value, String> {
    let fields = d.structs.get(index).map_or(&[][..], Vec::as_slice);
    let mut out = Vec::with_capacity(fields.len());
    for field in fields {
        let value = field_value(d, field, reader, budget).map_err(|e| {
            if e.contains("field") {
                e
            } else {
                format!("field `{}`: {e}", field.name)
            }
        })?;
        out.push((field.name.clone(), value));
    }
    Ok(Value::Struct(out))
}

fn field_value(
    d: &Definition,
    field: &Field,
    reader: &mut Reader<'_>,
    budget: &mut usize,
) -> Result<Value, String> {
    let count = match field.shape {
        Shape::One => return element(d, field.element, reader, budget),
        Shape::Fixed(count) => count,
        Shape::Sequence => reader.length()?,
    };
    if count > LONGEST && !matches!(field.element, Element::Struct(_)) {
        // Every element takes bytes of the message, so this ends with it.
        for _ in 0..count {
            element(d, field.element, reader, &mut 1)?;
        }
        return Ok(Value::List(Vec::new()));
    }
    let mut list = Vec::new();
    for _ in 0..count {
        list.push(element(d, field.element, reader, budget)?);
    }
    if count > LONGEST {
        list.clear();
    }
    Ok(Value::List(list))
}

fn element(
    d: &Definition,
    element: Element,
    r: &mut Reader<'_>,
    budget: &mut usize,
) -> Result<Value, String> {
    *budget = budget
        .checked_sub(1)
        .ok_or("it has more than 65536 values")?;
    Ok(Value::Number(match element {
        Element::Bool | Element::U8 => f64::from(r.u8()?),
        Element::I8 => f64::from(r.u8()?.cast_signed()),
        Element::I16 => f64::from(r.u16()?.cast_signed()),
        Element::U16 => f64::from(r.u16()?),
        Element::I32 => f64::from(r.u32()?.cast_signed()),
        Element::U32 => f64::from(r.u32()?),
        Element::I64 => r.u64()?.cast_signed() as f64,
        Element::U64 => r.u64()? as f64,
        Element::F32 => f64::from(r.f32()?),
        Element::F64 => r.f64()?,
        Element::Text => return Ok(Value::Text(r.text()?)),
        Element::WideText => return Ok(Value::Text(r.wide_text()?)),
        Element::Struct(index) => return structure(d, index, r, budget),
    }))
}

/// `header.stamp` in ns.
fn stamp(value: &Value) -> Option<i64> {
    let field = |value: &Value, name: &str| -> Option<usize> {
        let Value::Struct(fields) = value else {
            return None;
        };
        fields.iter().position(|(n, _)| n == name)
    };
    let inner = |value: &'_ Value, at: usize| -> Option<(f64, f64)> {
        let Value::Struct(fields) = value else {
            return None;
        };
        let stamp = &fields.get(at)?.1;
        let Value::Struct(parts) = stamp else {
            return None;
        };
        match parts.as_slice() {
            [(_, Value::Number(sec)), (_, Value::Number(nanosec))] => Some((*sec, *nanosec)),
            _ => None,
        }
    };
    let Value::Struct(fields) = value else {
        return None;
    };
    let header = &fields.get(field(value, "header")?)?.1;
    let (sec, nanosec) = inner(header, field(header, "stamp")?)?;
    Some(
        (sec as i64)
            .wrapping_mul(1_000_000_000)
            .wrapping_add(nanosec as i64),
    )
}

/// Adds the numbers below a value. `labels` are those of the structs around; `label` is the one
/// already chosen.
fn flatten(value: &Value, label: &str, path: &str, labels: &[String], row: &mut Row) {
    match value {
        Value::Text(_) => {}
        Value::Number(number) => {
            row.names.push(join(label, path));
            row.values.push(*number);
        }
        Value::Struct(fields) => {
            let own = fields
                .iter()
                .find_map(|(name, value)| labels_of(name, value));
            let labels = own.as_deref().unwrap_or(labels);
            for (name, value) in fields {
                if name == "header" || name == "layout" || labels_of(name, value).is_some() {
                    continue;
                }
                // Interfaces carry their own names: `interface_values` and `values` say nothing.
                let path = match name.as_str() {
                    "interface_values" | "values" => path.to_owned(),
                    _ => join(path, name),
                };
                flatten(value, label, &path, labels, row);
            }
        }
        Value::List(list)
            if path.ends_with("points") && matches!(list.first(), Some(Value::Struct(_))) =>
        {
            // Points of a planned motion lie in the future; a single one is a command.
            if let [point] = list.as_slice() {
                flatten(
                    point,
                    label,
                    &join(
                        path.trim_end_matches("points").trim_end_matches('/'),
                        "command",
                    ),
                    labels,
                    row,
                );
            }
        }
        Value::List(list) => {
            let named = list.len() == labels.len();
            for (i, value) in list.iter().enumerate() {
                if named {
                    flatten(value, &join(label, &labels[i]), path, &[], row);
                } else {
                    flatten(value, label, &format!("{path}[{i}]"), labels, row);
                }
            }
        }
    }
}

/// The labels in a field that holds names.
fn labels_of(name: &str, value: &Value) -> Option<Vec<String>> {
    let Value::List(list) = value else {
        return None;
    };
    if !LABELS.contains(&name) || list.is_empty() {
        return None;
    }
    let text = |v: &Value| match v {
        Value::Text(text) => Some(text.clone()),
        _ => None,
    };
    list.iter().map(text).collect()
}

fn join(a: &str, b: &str) -> String {
    match (a.is_empty(), b.is_empty()) {
        (true, _) => b.to_owned(),
        (_, true) => a.to_owned(),
        _ => format!("{a}/{b}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Writes plain little-endian CDR.
    struct Writer(Vec<u8>);

    impl Writer {
        fn align(&mut self, size: usize) {
            while !(self.0.len() - 4).is_multiple_of(size) {
                self.0.push(0);
            }
        }
        fn u32(&mut self, value: u32) {
            self.align(4);
            self.0.extend(value.to_le_bytes());
        }
        fn text(&mut self, text: &str) {
            self.u32(u32::try_from(text.len()).unwrap() + 1);
            self.0.extend(text.bytes().chain([0]));
        }
        fn reals(&mut self, values: &[f64]) {
            self.u32(u32::try_from(values.len()).unwrap());
            for value in values {
                self.align(8);
                self.0.extend(value.to_le_bytes());
            }
        }
    }

    /// A `JointTrajectory` of joints `a` and `b` with points of positions.
    fn trajectory(points: &[[f64; 2]]) -> Row {
        let mut w = Writer(vec![0, 1, 0, 0]);
        w.u32(3);
        w.u32(5);
        w.text("base");
        w.u32(2);
        w.text("a");
        w.text("b");
        w.u32(u32::try_from(points.len()).unwrap());
        for point in points {
            w.reals(point);
            (0..3).for_each(|_| w.reals(&[]));
            w.u32(0);
            w.u32(0);
        }
        let definition = Definition::of("trajectory_msgs/msg/JointTrajectory", None).unwrap();
        read(&definition, &w.0).unwrap()
    }

    #[test]
    fn a_single_point_is_a_command_and_a_planned_motion_is_not() {
        let row = trajectory(&[[0.5, -0.5]]);
        assert_eq!(row.stamp, Some(3_000_000_005));
        let numbers: Vec<(&str, f64)> = row
            .names
            .iter()
            .map(String::as_str)
            .zip(row.values)
            .collect();
        assert_eq!(
            numbers[..2],
            [("a/command/positions", 0.5), ("b/command/positions", -0.5)]
        );
        assert!(trajectory(&[[0.5, -0.5], [0.6, -0.6]]).names.is_empty());
    }

    #[test]
    fn long_arrays_are_passed_over_and_short_messages_refused() {
        let definition = Definition::of("a/msg/A", Some("uint8[] image\nfloat64 q\n")).unwrap();
        let mut w = Writer(vec![0, 1, 0, 0]);
        w.u32(1000);
        w.0.extend([7; 1000]);
        w.align(8);
        w.0.extend(1.5_f64.to_le_bytes());
        let row = read(&definition, &w.0).unwrap();
        assert_eq!((row.names, row.values), (vec!["q".to_owned()], vec![1.5]));
        let told = read(&definition, &w.0[..500]).unwrap_err();
        assert!(
            told.starts_with("field `image`: a sequence of 1000 elements in 492 bytes"),
            "{told}"
        );
    }
}
