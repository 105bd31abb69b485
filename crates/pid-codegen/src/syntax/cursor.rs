//! A cursor over token trees with the few questions the grammar asks, and recovery after a bad item.

use proc_macro2::{Delimiter, Group, Ident, Span, TokenStream, TokenTree};

use crate::diag::Loc;

/// Result of parsing one construct.
pub(crate) type Parsed<T> = Result<T, syn::Error>;

/// A position in a sequence of token trees.
pub(crate) struct Cursor {
    tokens: Vec<TokenTree>,
    at: usize,
    /// Where the sequence ends: the closing delimiter, or the macro call.
    end: Span,
}

impl Cursor {
    /// A cursor over a whole stream.
    pub(crate) fn new(stream: TokenStream, end: Span) -> Cursor {
        let mut tokens = Vec::new();
        flatten(stream, &mut tokens);
        Cursor { tokens, at: 0, end }
    }

    /// A cursor over the contents of a group.
    pub(crate) fn inside(group: &Group) -> Cursor {
        Cursor::new(group.stream(), group.span_close())
    }

    /// The next token tree, left in place.
    pub(crate) fn peek(&self) -> Option<&TokenTree> {
        self.peek_at(0)
    }

    /// The token tree after the next one.
    pub(crate) fn peek_second(&self) -> Option<&TokenTree> {
        self.peek_at(1)
    }

    fn peek_at(&self, ahead: usize) -> Option<&TokenTree> {
        self.tokens.get(self.at + ahead)
    }

    /// Takes the next token tree.
    pub(crate) fn bump(&mut self) -> Option<TokenTree> {
        let t = self.tokens.get(self.at).cloned();
        self.at += usize::from(t.is_some());
        t
    }

    /// Puts the token read last back.
    pub(crate) fn back(&mut self) {
        self.at = self.at.saturating_sub(1);
    }

    /// Whether everything has been read.
    pub(crate) fn is_done(&self) -> bool {
        self.at >= self.tokens.len()
    }

    /// Place of the next token, or the end of the sequence.
    pub(crate) fn here(&self) -> Span {
        self.peek().map_or(self.end, start_of)
    }

    /// Place of the token read last.
    pub(crate) fn last(&self) -> Span {
        self.at
            .checked_sub(1)
            .and_then(|i| self.tokens.get(i))
            .map_or(self.end, end_of)
    }

    /// The stretch from `start` to the token read last.
    pub(crate) fn since(&self, start: Span) -> Loc {
        Loc {
            start,
            end: self.last(),
        }
    }

    /// An error at the next token: "expected …, found …".
    pub(crate) fn expected(&self, what: impl std::fmt::Display) -> syn::Error {
        match self.peek() {
            None => Loc::from(self.end).error(format!("expected {what}")),
            Some(t) => {
                let found = match t {
                    TokenTree::Group(g) => match g.delimiter() {
                        Delimiter::Brace => "{".to_string(),
                        Delimiter::Bracket => "[".to_string(),
                        _ => "(".to_string(),
                    },
                    t => t.to_string(),
                };
                Loc::from(start_of(t)).error(format!("expected {what}, found `{found}`"))
            }
        }
    }

    /// The next token, if it is an identifier.
    pub(crate) fn peek_ident(&self) -> Option<&Ident> {
        match self.peek() {
            Some(TokenTree::Ident(i)) => Some(i),
            _ => None,
        }
    }

    /// Whether the next token is this word.
    pub(crate) fn peek_word(&self, word: &str) -> bool {
        self.peek_ident().is_some_and(|i| i == word)
    }

    /// Takes this word if it comes next.
    pub(crate) fn eat_word(&mut self, word: &str) -> Option<Span> {
        self.peek_word(word).then(|| {
            let span = self.here();
            self.at += 1;
            span
        })
    }

    /// Whether the punctuation `p` (one to three characters) comes next.
    pub(crate) fn peek_punct(&self, p: &str) -> bool {
        p.chars()
            .enumerate()
            .all(|(k, c)| matches!(self.peek_at(k), Some(TokenTree::Punct(t)) if t.as_char() == c))
    }

    /// Takes the punctuation `p` if it comes next.
    pub(crate) fn eat_punct(&mut self, p: &str) -> Option<Span> {
        self.peek_punct(p).then(|| {
            let span = self.here();
            self.at += p.chars().count();
            span
        })
    }

    /// Takes the punctuation `p`, which must come next.
    pub(crate) fn punct(&mut self, p: &str, why: &str) -> Parsed<Span> {
        self.eat_punct(p)
            .ok_or_else(|| self.expected(format!("`{p}` {why}")))
    }

    /// Takes the `;` that ends an item.
    pub(crate) fn semicolon(&mut self, item: &str) -> Parsed<()> {
        self.punct(";", &format!("after {item}")).map(drop)
    }

    /// Takes an identifier that the user chooses.
    pub(crate) fn ident(&mut self, what: &str) -> Parsed<Ident> {
        match self.peek_ident() {
            Some(i) if i != "_" => {
                let i = i.clone();
                self.at += 1;
                Ok(i)
            }
            _ => Err(self.expected(what)),
        }
    }

    /// Takes an identifier that becomes the name of a type.
    pub(crate) fn type_name(&mut self, what: &str) -> Parsed<Ident> {
        let name = self.ident(what)?;
        // Raw identifiers could not be joined with `Params`, keywords could not stand after `struct`.
        match syn::parse_str::<Ident>(&name.to_string()) {
            Ok(_) if !name.to_string().starts_with("r#") => Ok(name),
            _ => Err(Loc::from(&name).error(format!(
                "`{name}` cannot be the name of a type: it is a keyword of Rust\nhelp: choose another name"
            ))),
        }
    }

    /// The next token, if it is a group with this delimiter.
    pub(crate) fn peek_group(&self, delimiter: Delimiter) -> bool {
        matches!(self.peek(), Some(TokenTree::Group(g)) if g.delimiter() == delimiter)
    }

    /// Takes a group with this delimiter.
    pub(crate) fn group(&mut self, delimiter: Delimiter, what: &str) -> Parsed<Group> {
        match self.peek() {
            Some(TokenTree::Group(g)) if g.delimiter() == delimiter => {
                let g = g.clone();
                self.at += 1;
                Ok(g)
            }
            _ => Err(self.expected(what)),
        }
    }

    /// Skips to the start of the next item after an error inside one: past the next `;` or `{…}`.
    /// `started` is the position of the item; if the error came after its end already, nothing is skipped.
    pub(crate) fn recover(&mut self, started: usize) {
        if self.at > started && self.ends_item(self.at - 1) {
            return;
        }
        while !self.is_done() {
            self.at += 1;
            if self.ends_item(self.at - 1) {
                // `{…};` belongs to one item.
                self.eat_punct(";");
                return;
            }
        }
    }

    fn ends_item(&self, at: usize) -> bool {
        match &self.tokens[at] {
            TokenTree::Punct(p) => p.as_char() == ';',
            TokenTree::Group(g) => g.delimiter() == Delimiter::Brace,
            _ => false,
        }
    }

    /// Position, for [`Cursor::recover`].
    pub(crate) fn position(&self) -> usize {
        self.at
    }

    /// The contents of a comma-separated group, element by element.
    pub(crate) fn list<T>(
        group: &Group,
        mut element: impl FnMut(&mut Cursor) -> Parsed<T>,
    ) -> Parsed<Vec<T>> {
        let mut inner = Cursor::inside(group);
        let mut out = Vec::new();
        while !inner.is_done() {
            out.push(element(&mut inner)?);
            if !inner.is_done() {
                inner.punct(",", "between entries")?;
            }
        }
        Ok(out)
    }
}

/// First token of a tree.
fn start_of(t: &TokenTree) -> Span {
    match t {
        TokenTree::Group(g) => g.span_open(),
        t => t.span(),
    }
}

/// Last token of a tree.
fn end_of(t: &TokenTree) -> Span {
    match t {
        TokenTree::Group(g) => g.span_close(),
        t => t.span(),
    }
}

/// Opens the invisible groups that `macro_rules!` puts around its fragments.
fn flatten(stream: TokenStream, out: &mut Vec<TokenTree>) {
    for t in stream {
        match t {
            TokenTree::Group(g) if g.delimiter() == Delimiter::None => flatten(g.stream(), out),
            t => out.push(t),
        }
    }
}

/// An exponent: an integer with an optional sign.
pub(super) fn integer(c: &mut Cursor) -> Parsed<i32> {
    let sign = if c.eat_punct("-").is_some() { -1 } else { 1 };
    let at = c.here();
    if let Some(TokenTree::Literal(l)) = c.peek()
        && let Ok(n) = l.to_string().parse::<i32>()
        && n.abs() <= 64
    {
        c.bump();
        return Ok(sign * n);
    }
    Err(Loc::from(at).error(
        "an exponent must be an integer from -64 to 64\nhelp: write `sqrt(x)` for a root, `exp(y*ln(x))` for other powers",
    ))
}
