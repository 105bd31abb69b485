//! What the pages of a column claim to hold, from their heads alone.
//!
//! The parser takes a page's word for its size and makes room for it before it unpacks anything. A head is a Thrift
//! struct in the compact protocol (Apache Parquet, `parquet.thrift`, `PageHeader`; Apache Thrift, compact protocol).

/// What one page claims.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Page {
    /// Bytes it unpacks to.
    pub(super) bytes: usize,
    /// Values in it, missing ones included.
    pub(super) values: usize,
}

/// What the pages of a column chunk claim, one after the other; `None` at the end where a head cannot be read or says
/// that its page goes on beyond the chunk.
pub(super) fn claimed(mut chunk: &[u8]) -> impl Iterator<Item = Option<Page>> {
    let mut next = move || {
        let mut head = Head { rest: chunk };
        let (page, packed) = head.page()?;
        chunk = head.rest.get(packed..)?;
        Some((page, chunk.is_empty()))
    };
    let mut ended = chunk.is_empty();
    std::iter::from_fn(move || {
        if ended {
            return None;
        }
        let page = next();
        ended = page.is_none_or(|(_, last)| last);
        Some(page.map(|(page, _)| page))
    })
}

/// Structs within structs at most: a head has two.
const DEEPEST: usize = 8;

/// Kinds of values in the compact protocol.
mod kind {
    pub(super) const STOP: u8 = 0;
    pub(super) const TRUE: u8 = 1;
    pub(super) const FALSE: u8 = 2;
    pub(super) const BYTE: u8 = 3;
    pub(super) const I16: u8 = 4;
    pub(super) const I32: u8 = 5;
    pub(super) const I64: u8 = 6;
    pub(super) const DOUBLE: u8 = 7;
    pub(super) const BINARY: u8 = 8;
    pub(super) const LIST: u8 = 9;
    pub(super) const SET: u8 = 10;
    pub(super) const STRUCT: u8 = 12;
}

/// A head while it is read.
struct Head<'a> {
    rest: &'a [u8],
}

impl Head<'_> {
    /// What a page claims, and its bytes behind the head.
    fn page(&mut self) -> Option<(Page, usize)> {
        let (mut bytes, mut packed, mut values) = (None, None, 0);
        let mut before = 0;
        while let Some((field, kind)) = self.field(&mut before)? {
            match (field, kind) {
                (2, kind::I32) => bytes = Some(self.count()?),
                (3, kind::I32) => packed = Some(self.count()?),
                // Heads of data pages, of dictionaries and of data pages of the second kind.
                (5 | 7 | 8, kind::STRUCT) => values = self.values()?,
                _ => self.skip(kind, 0)?,
            }
        }
        let bytes = bytes?;
        Some((Page { bytes, values }, packed?))
    }

    /// The number of values, the first field of the heads of all kinds of pages.
    fn values(&mut self) -> Option<usize> {
        let (mut values, mut before) = (None, 0);
        while let Some((field, kind)) = self.field(&mut before)? {
            match (field, kind) {
                (1, kind::I32) => values = Some(self.count()?),
                _ => self.skip(kind, 1)?,
            }
        }
        values
    }

    /// Number and kind of the next field behind one of a number; `Some(None)` at the end of the struct.
    fn field(&mut self, before: &mut i64) -> Option<Option<(i64, u8)>> {
        let head = self.byte()?;
        let (step, kind) = (head >> 4, head & 0x0f);
        if kind == kind::STOP {
            return Some(None);
        }
        *before = match step {
            0 => self.integer()?,
            step => before.checked_add(i64::from(step))?,
        };
        Some(Some((*before, kind)))
    }

    fn skip(&mut self, kind: u8, depth: usize) -> Option<()> {
        if depth > DEEPEST {
            return None;
        }
        match kind {
            kind::TRUE | kind::FALSE => Some(()),
            kind::BYTE => self.take(1),
            kind::I16 | kind::I32 | kind::I64 => self.varint().map(|_| ()),
            kind::DOUBLE => self.take(8),
            kind::BINARY => {
                let length = self.varint()?;
                self.take(usize::try_from(length).ok()?)
            }
            kind::LIST | kind::SET => self.skip_list(depth),
            kind::STRUCT => {
                let mut before = 0;
                while let Some((_, kind)) = self.field(&mut before)? {
                    self.skip(kind, depth + 1)?;
                }
                Some(())
            }
            // A head has no maps.
            _ => None,
        }
    }

    fn skip_list(&mut self, depth: usize) -> Option<()> {
        let head = self.byte()?;
        let (short, kind) = (u64::from(head >> 4), head & 0x0f);
        let length = if short == 15 { self.varint()? } else { short };
        for _ in 0..length {
            match kind {
                // In a list each has a byte.
                kind::TRUE | kind::FALSE => self.take(1)?,
                kind => self.skip(kind, depth + 1)?,
            }
        }
        Some(())
    }

    /// A number that is not negative.
    fn count(&mut self) -> Option<usize> {
        usize::try_from(self.integer()?).ok()
    }

    /// A number in zigzag form.
    fn integer(&mut self) -> Option<i64> {
        let x = self.varint()?;
        Some((x >> 1) as i64 ^ -((x & 1) as i64))
    }

    fn varint(&mut self) -> Option<u64> {
        let mut x = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            x |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Some(x);
            }
        }
        None
    }

    fn byte(&mut self) -> Option<u8> {
        let (first, rest) = self.rest.split_first()?;
        self.rest = rest;
        Some(*first)
    }

    fn take(&mut self, bytes: usize) -> Option<()> {
        self.rest = self.rest.get(bytes..)?;
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A number as the protocol writes it.
    fn zigzag(x: i64) -> Vec<u8> {
        let mut left = ((x << 1) ^ (x >> 63)) as u64;
        let mut out = Vec::new();
        while left >= 0x80 {
            out.push(left as u8 | 0x80);
            left >>= 7;
        }
        out.push(left as u8);
        out
    }

    /// A data page with statistics and a checksum, and as many bytes behind its head as that says.
    fn page(bytes: i64, values: i64, packed: usize) -> Vec<u8> {
        let mut out = vec![0x15, 0x00, 0x15];
        out.extend(zigzag(bytes));
        out.push(0x15);
        out.extend(zigzag(packed as i64));
        out.extend([0x15, 0x02]);
        // Field 5: number of values, two encodings, statistics with a text and a flag.
        out.extend([0x1c, 0x15]);
        out.extend(zigzag(values));
        out.extend([
            0x15, 0x00, 0x15, 0x06, 0x2c, 0x18, 0x03, b'a', b'b', b'c', 0x11, 0x00, 0x00,
        ]);
        out.push(0x00);
        out.extend(vec![0xaa; packed]);
        out
    }

    fn claims(chunk: &[u8]) -> Vec<Option<Page>> {
        claimed(chunk).collect()
    }

    #[test]
    fn pages_claim_their_bytes_and_values() {
        let mut chunk = page(320, 40, 7);
        chunk.extend(page(913_103_283, 1 << 30, 0));
        let of = |bytes, values| Some(Page { bytes, values });
        let two = [of(320, 40), of(913_103_283, 1 << 30)];
        assert_eq!(claims(&chunk), two);
        // What the first says is known although the second has no end.
        chunk.pop();
        assert_eq!(claims(&chunk), [two[0], None]);
    }

    #[test]
    fn heads_that_end_early_or_lie_are_refused() {
        let whole = page(320, 40, 7);
        for end in 1..whole.len() {
            assert_eq!(claims(&whole[..end]), [None], "{end} bytes");
        }
        assert_eq!(claims(&page(-1, 40, 0)), [None]);
        assert_eq!(claims(&page(1, -40, 0)), [None]);
        // Structs in structs without end.
        assert_eq!(claims(&[0x1c; 1000]), [None]);
    }
}
