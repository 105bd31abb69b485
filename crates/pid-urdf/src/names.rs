//! Identifiers from the names of a file, which may hold any character.

/// Words of Rust that cannot be names, and names that mean something in a declaration.
const TAKEN: [&str; 46] = [
    "Self", "abstract", "as", "async", "await", "become", "box", "break", "const", "continue",
    "crate", "do", "dyn", "else", "enum", "extern", "false", "final", "fn", "for", "gen", "if",
    "impl", "in", "let", "loop", "macro", "match", "mod", "move", "mut", "override", "pi", "priv",
    "pub", "ref", "return", "self", "static", "struct", "super", "trait", "true", "try", "type",
    "typeof",
];
/// The rest of them.
const TAKEN_TOO: [&str; 12] = [
    "a", "base", "q", "t", "unsafe", "unsized", "use", "v", "virtual", "where", "while", "yield",
];

/// Makes an identifier of a name: characters other than letters, digits and `_` become `_`, a
/// leading digit gets a `_` before it, reserved words get one after them. The empty name becomes
/// `_0`.
pub fn identifier(name: &str) -> String {
    let mut out: String = name
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c } else { '_' })
        .collect();
    if out.chars().all(|c| c == '_') {
        out.push('0');
    }
    if out.starts_with(|c: char| c.is_ascii_digit()) {
        out.insert(0, '_');
    }
    if TAKEN.contains(&out.as_str()) || TAKEN_TOO.contains(&out.as_str()) {
        out.push('_');
    }
    out
}

/// Identifiers that differ: a later one that equals an earlier one gets `_2`, `_3` and so on.
pub fn make_apart<'a>(identifiers: impl Iterator<Item = &'a mut String>) {
    let mut taken = std::collections::BTreeSet::new();
    for identifier in identifiers {
        let mut number = 1;
        let stem = identifier.clone();
        while !taken.insert(identifier.clone()) {
            number += 1;
            *identifier = format!("{stem}_{number}");
        }
    }
}

/// A name as the name of a type: words begin with a capital, separators go.
pub fn type_name(name: &str) -> String {
    let mut out = String::new();
    for word in name.split(|c: char| !c.is_ascii_alphanumeric()) {
        let mut chars = word.chars();
        out.extend(chars.next().map(|c| c.to_ascii_uppercase()));
        out.extend(chars);
    }
    if !out.starts_with(|c: char| c.is_ascii_alphabetic()) {
        out.insert_str(0, "Robot");
    }
    if out == "Self" {
        out.push('_');
    }
    out
}

#[cfg(test)]
mod tests {
    use super::{identifier, type_name};

    #[test]
    fn names_become_identifiers() {
        for (name, expected) in [
            ("shoulder_pan", "shoulder_pan"),
            ("base-link 1", "base_link_1"),
            ("1st", "_1st"),
            ("type", "type_"),
            ("base", "base_"),
            ("", "_0"),
            ("é", "_0"),
        ] {
            assert_eq!(identifier(name), expected);
        }
        for (name, expected) in [
            ("planar_arm", "PlanarArm"),
            ("ur10e", "Ur10e"),
            ("", "Robot"),
            ("7 dof", "Robot7Dof"),
            ("self", "Self_"),
        ] {
            assert_eq!(type_name(name), expected);
        }
    }
}
