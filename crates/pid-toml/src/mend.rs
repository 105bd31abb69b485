//! What to write instead.

/// The name among `known` that `name` most likely means; `None` if none is near.
pub fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // Two thirds of the letters in place: `masss` means `mass`, `mass` does not mean `com`.
    const NEAR: f64 = 0.65;
    known
        .into_iter()
        .map(|k| (strsim::normalized_damerau_levenshtein(name, k), k))
        .filter(|(likeness, _)| *likeness >= NEAR)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, k)| k)
}

/// Names with commas between them.
pub fn list<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    names.into_iter().collect::<Vec<_>>().join(", ")
}

/// "did you mean `x`?" if a name is near, otherwise "use one of …".
pub fn one_of<'a>(name: &str, known: impl IntoIterator<Item = &'a str> + Clone) -> String {
    match nearest(name, known.clone()) {
        Some(k) => format!("did you mean `{k}`?"),
        None => {
            let known: Vec<String> = known.into_iter().map(|k| format!("`{k}`")).collect();
            format!("use one of {}", known.join(", "))
        }
    }
}

/// The mend of a message of the TOML reader.
pub(crate) fn of(message: &str) -> String {
    let mut quoted = message.split('`').skip(1).step_by(2);
    if message.starts_with("unknown field") || message.starts_with("unknown variant") {
        let Some(name) = quoted.next() else {
            return "leave this key out".to_owned();
        };
        let known: Vec<&str> = quoted.collect();
        return match known.is_empty() {
            true => "leave this key out".to_owned(),
            false => one_of(name, known),
        };
    }
    if message.starts_with("missing field") {
        return match quoted.next() {
            Some(name) => format!("add `{name} = …` to this table"),
            None => "add the key".to_owned(),
        };
    }
    if let Some((_, expected)) = message.split_once("expected ")
        && (message.starts_with("invalid type") || message.starts_with("invalid length"))
    {
        return format!("write {}", value(expected));
    }
    if message.contains("duplicate key") {
        return "keep one of the two".to_owned();
    }
    "write one `key = value` a line, text in quotes, lists in brackets".to_owned()
}

/// A type of Rust in words of the format.
fn value(expected: &str) -> String {
    match expected.trim() {
        "f64" => "a number, such as 1.5".to_owned(),
        "usize" | "u64" | "u32" => "a whole number, zero or above".to_owned(),
        "a string" => "a text in quotes".to_owned(),
        "a boolean" => "true or false".to_owned(),
        "a sequence" => "a list in brackets, or `[[…]]` tables".to_owned(),
        other => match other
            .strip_prefix("an array of length ")
            .or_else(|| other.strip_prefix("a tuple of size "))
        {
            Some(n) => format!("a list of {n} numbers in brackets"),
            None if other.starts_with("struct") || other == "a map" => {
                "a table of keys and values".to_owned()
            }
            None => other.to_owned(),
        },
    }
}
