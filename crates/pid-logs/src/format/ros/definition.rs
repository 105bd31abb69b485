//! Definitions of ROS 2 messages: the text that MCAP files carry, parsed.

use std::collections::BTreeMap;

/// A type with all types it is made of.
#[derive(Debug, Clone)]
pub(super) struct Definition {
    pub(super) root: usize,
    /// Whether the type is one of those that robots publish their joints with.
    pub(super) known: bool,
    pub(super) structs: Vec<Vec<Field>>,
}

/// One field of a struct.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Field {
    pub(super) name: String,
    pub(super) element: Element,
    pub(super) shape: Shape,
}

/// What a field, or each of its elements, is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Element {
    Bool,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
    Text,
    WideText,
    /// Index into [`Definition::structs`].
    Struct(usize),
}

/// How many elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    One,
    Fixed(usize),
    Sequence,
}

/// Types inside types at most; a definition has no loops.
const DEPTH: usize = 16;

/// Types that are read without a definition in the file, as rosbag2 wrote before it stored
/// definitions. Interfaces as of ROS 2 Humble.
const KNOWN: &[(&str, &str)] = &[
    ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec"),
    ("builtin_interfaces/Duration", "int32 sec\nuint32 nanosec"),
    (
        "std_msgs/Header",
        "builtin_interfaces/Time stamp\nstring frame_id",
    ),
    ("std_msgs/Float64", "float64 data"),
    ("std_msgs/Float32", "float32 data"),
    (
        "std_msgs/MultiArrayDimension",
        "string label\nuint32 size\nuint32 stride",
    ),
    (
        "std_msgs/MultiArrayLayout",
        "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset",
    ),
    (
        "std_msgs/Float64MultiArray",
        "std_msgs/MultiArrayLayout layout\nfloat64[] data",
    ),
    (
        "std_msgs/Float32MultiArray",
        "std_msgs/MultiArrayLayout layout\nfloat32[] data",
    ),
    (
        "sensor_msgs/JointState",
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort",
    ),
    (
        "control_msgs/InterfaceValue",
        "string[] interface_names\nfloat64[] values",
    ),
    (
        "control_msgs/DynamicJointState",
        "std_msgs/Header header\nstring[] joint_names\ncontrol_msgs/InterfaceValue[] interface_values",
    ),
    (
        "trajectory_msgs/JointTrajectoryPoint",
        "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\nfloat64[] effort\nbuiltin_interfaces/Duration time_from_start",
    ),
    (
        "trajectory_msgs/JointTrajectory",
        "std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/JointTrajectoryPoint[] points",
    ),
];

impl Definition {
    /// The definition of a type, from the text of a schema or the known types.
    pub(super) fn of(message_type: &str, schema: Option<&str>) -> Result<Self, String> {
        let root = short(message_type);
        let mut texts: BTreeMap<String, String> = KNOWN
            .iter()
            .map(|(name, text)| ((*name).to_owned(), (*text).to_owned()))
            .collect();
        match schema.filter(|s| !s.trim().is_empty()) {
            Some(schema) => sections(&root, schema, &mut texts),
            None if texts.contains_key(&root) => {}
            None => {
                return Err(format!(
                    "the file has no definition of its type `{message_type}`"
                ));
            }
        }
        let known = KNOWN.iter().any(|(name, _)| *name == root);
        let mut definition = Self {
            root: 0,
            known,
            structs: Vec::new(),
        };
        let mut done = BTreeMap::new();
        definition.root = definition.build(&root, &texts, &mut done, 0)?;
        Ok(definition)
    }

    fn build(
        &mut self,
        name: &str,
        texts: &BTreeMap<String, String>,
        done: &mut BTreeMap<String, usize>,
        depth: usize,
    ) -> Result<usize, String> {
        if let Some(&index) = done.get(name) {
            return Ok(index);
        }
        if depth > DEPTH {
            return Err(format!("its type `{name}` contains itself"));
        }
        let text = texts
            .get(name)
            .ok_or_else(|| format!("the file does not define its type `{name}`"))?;
        let mut fields = Vec::new();
        for line in text.lines() {
            let line = line.split('#').next().unwrap_or("").trim();
            let mut words = line.split_whitespace();
            let (Some(kind), Some(field)) = (words.next(), words.next()) else {
                continue;
            };
            // `uint8 MODE=1` and `uint8 MODE = 1` are constants; a default value follows a blank.
            let after = words.next().unwrap_or("");
            if field.contains('=') || after.starts_with('=') {
                continue;
            }
            let (base, shape) = shape_of(kind)?;
            let element = match primitive(base) {
                Some(element) => element,
                None => {
                    let inner = resolve(base, name, texts);
                    Element::Struct(self.build(&inner, texts, done, depth + 1)?)
                }
            };
            fields.push(Field {
                name: field.to_owned(),
                element,
                shape,
            });
        }
        self.structs.push(fields);
        done.insert(name.to_owned(), self.structs.len() - 1);
        Ok(self.structs.len() - 1)
    }
}

/// `sensor_msgs/msg/JointState` as `sensor_msgs/JointState`.
fn short(name: &str) -> String {
    let parts: Vec<&str> = name.split('/').filter(|p| *p != "msg").collect();
    parts.join("/")
}

/// The full name of a type used within another one.
fn resolve(base: &str, within: &str, texts: &BTreeMap<String, String>) -> String {
    let base = short(base);
    if base.contains('/') {
        return base;
    }
    if base == "Header" {
        return "std_msgs/Header".to_owned();
    }
    let package = within.split('/').next().unwrap_or("");
    let near = format!("{package}/{base}");
    if texts.contains_key(&near) {
        return near;
    }
    let elsewhere = texts
        .keys()
        .find(|k| k.rsplit('/').next() == Some(base.as_str()));
    elsewhere.cloned().unwrap_or(near)
}

/// The sections of a schema: the type itself, then `MSG: package/Type` after a line of `=`.
fn sections(root: &str, schema: &str, texts: &mut BTreeMap<String, String>) {
    let mut name = root.to_owned();
    let mut text = String::new();
    for line in schema.lines() {
        if line.starts_with("====") {
            texts.insert(std::mem::take(&mut name), std::mem::take(&mut text));
        } else if let Some(next) = line.trim().strip_prefix("MSG:") {
            name = short(next.trim());
        } else {
            text.push_str(line);
            text.push('\n');
        }
    }
    texts.insert(name, text);
}

/// Element type and shape: `float64[]`, `float64[6]`, `float64[<=6]`, `string<=5`.
fn shape_of(kind: &str) -> Result<(&str, Shape), String> {
    let (base, shape) = match kind.strip_suffix(']').and_then(|k| k.rsplit_once('[')) {
        None => (kind, Shape::One),
        Some((base, "")) => (base, Shape::Sequence),
        Some((base, bound)) if bound.starts_with("<=") => (base, Shape::Sequence),
        Some((base, count)) => {
            let count = count
                .parse()
                .map_err(|_| format!("`{kind}` in its definition is no type"))?;
            (base, Shape::Fixed(count))
        }
    };
    Ok((base.split("<=").next().unwrap_or(base), shape))
}

fn primitive(name: &str) -> Option<Element> {
    Some(match name {
        "bool" | "boolean" => Element::Bool,
        "int8" => Element::I8,
        "uint8" | "byte" | "char" => Element::U8,
        "int16" => Element::I16,
        "uint16" => Element::U16,
        "int32" => Element::I32,
        "uint32" => Element::U32,
        "int64" => Element::I64,
        "uint64" => Element::U64,
        "float32" => Element::F32,
        "float64" => Element::F64,
        "string" => Element::Text,
        "wstring" => Element::WideText,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn definitions_have_constants_defaults_arrays_and_inner_types() {
        let schema = "# state\nuint8 IDLE=0\nuint8 RUN = 1\nuint8 mode 1\nMotor[2] motors\nfloat64[<=3] gains\nstring<=9 label\n================\nMSG: maker/Motor\nfloat32 q # rad\nbuiltin_interfaces/Time stamp\n";
        let d = Definition::of("maker/msg/State", Some(schema)).unwrap();
        let root: Vec<_> = d.structs[d.root]
            .iter()
            .map(|f| (f.name.as_str(), f.shape))
            .collect();
        assert_eq!(
            root,
            [
                ("mode", Shape::One),
                ("motors", Shape::Fixed(2)),
                ("gains", Shape::Sequence),
                ("label", Shape::One)
            ]
        );
        let Element::Struct(motor) = d.structs[d.root][1].element else {
            panic!("a struct")
        };
        assert_eq!(d.structs[motor][0].element, Element::F32);
    }

    #[test]
    fn what_cannot_be_read_is_said() {
        let told = Definition::of("maker/msg/State", None).unwrap_err();
        assert!(
            told.contains("no definition of its type `maker/msg/State`"),
            "{told}"
        );
        let told = Definition::of("a/msg/A", Some("a/A inner\n")).unwrap_err();
        assert!(told.contains("contains itself"), "{told}");
        let told = Definition::of("a/msg/A", Some("b/B inner\n")).unwrap_err();
        assert!(told.contains("does not define its type `b/B`"), "{told}");
    }
}
