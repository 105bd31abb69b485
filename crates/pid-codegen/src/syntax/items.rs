//! Items of a block: their comments and attributes, words that are unknown or given twice.

use proc_macro2::{Delimiter, Ident, Span, TokenStream, TokenTree};
use quote::quote;

use super::cursor::{Cursor, Parsed};
use crate::diag::{Diagnostics, Loc, nearest, one_of};

/// Reads items until the end, each with its `///` lines; a bad one is reported and skipped.
pub(super) fn items(
    c: &mut Cursor,
    diag: &mut Diagnostics,
    mut item: impl FnMut(&mut Cursor, Vec<String>, &mut Diagnostics) -> Parsed<()>,
) {
    while !c.is_done() {
        // `{ … };` and `;;` are harmless.
        if c.eat_punct(";").is_some() {
            continue;
        }
        let started = c.position();
        let result = attributes(c).and_then(|(docs, attrs)| {
            if !attrs.is_empty() {
                return Err(Loc::from(c.here()).error(
                    "only `///` comments may stand here\nhelp: put attributes before `robot`",
                ));
            }
            item(c, docs, diag)
        });
        if let Err(e) = result {
            diag.push(e);
            c.recover(started);
        }
    }
}

/// `///` lines and other outer attributes.
pub(super) fn attributes(c: &mut Cursor) -> Parsed<(Vec<String>, Vec<TokenStream>)> {
    let (mut docs, mut attrs) = (Vec::new(), Vec::new());
    while c.eat_punct("#").is_some() {
        let group = c.group(Delimiter::Bracket, "`[` of an attribute")?;
        let mut inner = Cursor::inside(&group);
        if inner.eat_word("doc").is_some() && inner.eat_punct("=").is_some() {
            if let Some(TokenTree::Literal(l)) = inner.bump()
                && let syn::Lit::Str(text) = syn::Lit::new(l)
            {
                let text = text.value();
                docs.push(
                    text.strip_prefix(' ')
                        .unwrap_or(&text)
                        .trim_end()
                        .to_string(),
                );
                continue;
            }
            return Err(inner.expected("the text of a comment"));
        }
        let attr = quote!(# #group);
        if !is_lint(&attr) {
            return Err(Loc::from(group.span_open()).error(
                "only `///` comments and lint levels such as `#[allow(deprecated)]` may stand before a robot",
            ));
        }
        attrs.push(attr);
    }
    Ok((docs, attrs))
}

/// Whether an attribute sets the level of lints, which are all that a warning understands.
fn is_lint(attr: &TokenStream) -> bool {
    use syn::parse::Parser;
    let parsed = syn::Attribute::parse_outer.parse2(attr.clone());
    let Ok([one]) = parsed.as_deref() else {
        return false;
    };
    let level = ["allow", "expect", "warn", "deny"]
        .iter()
        .any(|l| one.path().is_ident(l));
    let lints = one.parse_args_with(
        syn::punctuated::Punctuated::<syn::Path, syn::Token![,]>::parse_terminated,
    );
    level && lints.is_ok_and(|l| !l.is_empty())
}

/// An unknown word where one of `known` is expected.
pub(super) fn unknown_item(word: &Ident, known: &[&str]) -> syn::Error {
    let text = word.to_string();
    let hint = match nearest(&text, known.iter().copied()) {
        Some(n) => format!("\nhelp: did you mean `{n}`?"),
        None => String::new(),
    };
    Loc::from(word).error(format!(
        "expected one of {}, found `{text}`{hint}",
        one_of(known).replace(" or ", ", ")
    ))
}

/// Refuses a second item of the same kind.
pub(super) fn once(seen: &mut Vec<(String, Span)>, keyword: &Ident) -> Parsed<()> {
    let name = keyword.to_string();
    if let Some((_, first)) = seen.iter().find(|s| s.0 == name) {
        let mut e = Loc::from(keyword).error(format!("`{name}` is given twice"));
        e.combine(Loc::from(*first).error(format!("`{name}` was first given here")));
        return Err(e);
    }
    seen.push((name, keyword.span()));
    Ok(())
}
