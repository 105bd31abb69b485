//! XML as robot files have it: what stricter parsers refuse and the usual readers of URDF accept is
//! blanked out, byte for byte, so that places stay those of the file.

use roxmltree::{Document, Error, ParsingOptions};

/// Names of namespaces in one file; beyond that it is no robot.
const NAMESPACES: usize = 64;

/// The text as it was, or with some of it blanked, and what was done.
pub(super) struct Xml {
    pub(super) text: String,
    pub(super) warnings: Vec<String>,
}

/// A text that the parser of XML accepts.
///
/// # Errors
/// The first message of the parser, if nothing helps.
pub(super) fn accepted(text: &str) -> Result<Xml, Error> {
    let mut xml = Xml {
        text: text.to_owned(),
        warnings: Vec::new(),
    };
    let Err(first) = parse(&xml.text) else {
        return Ok(xml);
    };
    xml.text = blank_comments(&xml.text);
    if let Some(at) = xml.text.find("<?xml")
        && xml.text[..at]
            .chars()
            .all(|c| c.is_whitespace() || c == '\u{feff}')
        && let Some(end) = xml.text[at..].find("?>")
    {
        blank(&mut xml.text, 0, at + end + 2);
    }
    // Some writers end a file with the zero of its string.
    let end = xml.text.trim_end_matches('\0').len();
    let all = xml.text.len();
    blank(&mut xml.text, end, all);
    for _ in 0..NAMESPACES {
        match parse(&xml.text) {
            Ok(_) => return Ok(xml),
            Err(Error::UnknownNamespace(prefix, at)) if prefix != "xacro" && !prefix.is_empty() => {
                xml.warnings.push(format!(
                    "{}: the namespace `{prefix}` is not declared; its elements are left out",
                    at.row
                ));
                xml.text = without_namespace(&xml.text, &prefix);
            }
            Err(_) => return Err(first),
        }
    }
    Err(first)
}

/// Parses a text; document types are allowed, entities of other files are not read.
pub(super) fn parse(text: &str) -> Result<Document<'_>, Error> {
    let options = ParsingOptions {
        allow_dtd: true,
        ..ParsingOptions::default()
    };
    Document::parse_with_options(text, options)
}

/// Blanks what stands from `start` to `end`, line ends excepted.
fn blank(text: &mut String, start: usize, end: usize) {
    let blanks: String = text[start..end]
        .bytes()
        .map(|b| if b == b'\n' { '\n' } else { ' ' })
        .collect();
    text.replace_range(start..end, &blanks);
}

/// Comments may hold what XML forbids in them: `--`, and characters that are no text.
fn blank_comments(text: &str) -> String {
    let mut out = text.to_owned();
    let mut at = 0;
    while let Some(start) = out[at..].find("<!--").map(|k| at + k) {
        let Some(end) = out[start..].find("-->").map(|k| start + k + 3) else {
            break;
        };
        blank(&mut out, start, end);
        at = end;
    }
    out
}

/// `<a:b` and ` a:b=` as `<a_b` and ` a_b=`: names that mean nothing to a reader of URDF.
fn without_namespace(text: &str, prefix: &str) -> String {
    let mut out = text.to_owned();
    for start in ["<", "</", " ", "\t", "\n"] {
        out = out.replace(&format!("{start}{prefix}:"), &format!("{start}{prefix}_"));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::accepted;

    #[test]
    fn what_other_readers_accept_is_blanked_in_place() {
        for text in [
            "\n <?xml version=\"1.0\"?>\n<robot/>",
            "<robot/>\n\0\0",
            "<robot><!-- a -- b --><link/></robot>",
            "<robot><gz:a b:c=\"1\" ><gz:d/></gz:a></robot>",
        ] {
            let xml = accepted(text).expect(text);
            assert_eq!(xml.text.len(), text.len());
            let place = |text: &str| text.find("<link").or(text.find("<robot"));
            assert_eq!(place(&xml.text), place(text));
        }
        assert!(accepted("<robot>").is_err());
        assert!(accepted("<robot><xacro:if/></robot>").is_err());
    }
}
