//! Names, and ranges of names.

use proc_macro2::Ident;

use super::cursor::{Cursor, Parsed};
use crate::diag::Loc;

/// A name or a range of names with a common stem, `l1..=l6`.
#[derive(Debug, Clone)]
pub struct Names {
    /// The names, in order; those inside a range carry the place of its first name.
    pub idents: Vec<Ident>,
    /// As written.
    pub loc: Loc,
}

/// Longest range of names; a longer one is a slip of the pen.
const LONGEST_RANGE: u32 = 64;

impl Names {
    /// Reads a name or a range.
    pub(super) fn parse(c: &mut Cursor, what: &str) -> Parsed<Names> {
        let start = c.here();
        let first = c.ident(what)?;
        if c.eat_punct("..=").is_none() {
            return Ok(Names {
                loc: (&first).into(),
                idents: vec![first],
            });
        }
        let last = c.ident("the last name of the range")?;
        let loc = c.since(start);
        let bad = |why: String| {
            Err(loc.error(format!(
                "{why}\nhelp: a range of names looks like `l1..=l6`"
            )))
        };
        let (a, b) = (first.to_string(), last.to_string());
        let (Some((stem, lo)), Some((stem_b, hi))) = (numbered(&a), numbered(&b)) else {
            return bad(
                format!("`{a}..=#{b}` needs a number at the end of both names").replace('#', ""),
            );
        };
        if stem != stem_b {
            return bad(format!("`{a}` and `{b}` have different stems"));
        }
        if hi < lo || hi - lo >= LONGEST_RANGE {
            return bad(format!(
                "the range `{a}..={b}` must go up, over at most {LONGEST_RANGE} names"
            ));
        }
        let idents = (lo..=hi)
            .map(|k| {
                let span = if k == hi { last.span() } else { first.span() };
                Ident::new(&format!("{stem}{k}"), span)
            })
            .collect();
        Ok(Names { idents, loc })
    }
}

/// Stem and number of `l12`.
fn numbered(name: &str) -> Option<(&str, u32)> {
    let stem = name.trim_end_matches(|c: char| c.is_ascii_digit());
    let digits = &name[stem.len()..];
    let canonical = digits == "0" || !digits.starts_with('0');
    (!stem.is_empty() && canonical)
        .then(|| digits.parse().ok())
        .flatten()
        .map(|n| (stem, n))
}
