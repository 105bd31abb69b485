//! Plain CDR: numbers aligned to their size, texts and sequences with a length before them.
//! Source: OMG, Common Data Representation, as used by DDS-XTypes 1.3, section 7.4.1.

/// Reads values one after the other; never beyond the end.
#[derive(Debug)]
pub(super) struct Reader<'a> {
    data: &'a [u8],
    at: usize,
    little: bool,
}

/// What the reader says at the end of the data.
const SHORT: &str = "the message ends too early";

impl<'a> Reader<'a> {
    /// Reads the encapsulation header of four bytes.
    pub(super) fn new(message: &'a [u8]) -> Result<Self, String> {
        let (header, data) = message.split_at_checked(4).ok_or(SHORT)?;
        let little = match (header[0], header[1]) {
            (0, 0) => false,
            (0, 1) => true,
            (a, b) => {
                return Err(format!(
                    "encoding {a:02x} {b:02x} is not plain CDR (00 00 or 00 01)"
                ));
            }
        };
        Ok(Self {
            data,
            at: 0,
            little,
        })
    }

    /// Bytes that are left.
    pub(super) fn left(&self) -> usize {
        self.data.len().saturating_sub(self.at)
    }

    /// `size` bytes, aligned to `size`, most significant last.
    fn number<const SIZE: usize>(&mut self) -> Result<[u8; SIZE], String> {
        let start = self.at.next_multiple_of(SIZE);
        let end = start.checked_add(SIZE).ok_or(SHORT)?;
        let bytes = self.data.get(start..end).ok_or(SHORT)?;
        self.at = end;
        let mut out = [0; SIZE];
        out.copy_from_slice(bytes);
        if !self.little {
            out.reverse();
        }
        Ok(out)
    }

    pub(super) fn u8(&mut self) -> Result<u8, String> {
        Ok(u8::from_le_bytes(self.number()?))
    }
    pub(super) fn u16(&mut self) -> Result<u16, String> {
        Ok(u16::from_le_bytes(self.number()?))
    }
    pub(super) fn u32(&mut self) -> Result<u32, String> {
        Ok(u32::from_le_bytes(self.number()?))
    }
    pub(super) fn u64(&mut self) -> Result<u64, String> {
        Ok(u64::from_le_bytes(self.number()?))
    }
    pub(super) fn f32(&mut self) -> Result<f32, String> {
        Ok(f32::from_le_bytes(self.number()?))
    }
    pub(super) fn f64(&mut self) -> Result<f64, String> {
        Ok(f64::from_le_bytes(self.number()?))
    }

    /// The number of elements of a sequence, each of which takes at least one byte.
    pub(super) fn length(&mut self) -> Result<usize, String> {
        let length = self.u32()? as usize;
        if length > self.left() {
            return Err(format!(
                "a sequence of {length} elements in {} bytes",
                self.left()
            ));
        }
        Ok(length)
    }

    /// A text; its length counts the zero at the end.
    pub(super) fn text(&mut self) -> Result<String, String> {
        let length = self.length()?;
        let bytes = &self.data[self.at..self.at + length];
        self.at += length;
        let bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        Ok(String::from_utf8_lossy(bytes).into_owned())
    }

    /// A text of 16-bit units.
    pub(super) fn wide_text(&mut self) -> Result<String, String> {
        let length = self.length()?;
        let units = (0..length)
            .map(|_| self.u16())
            .collect::<Result<Vec<_>, _>>()?;
        Ok(String::from_utf16_lossy(&units))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_aligned_after_the_header() {
        // A byte, three of padding, an u32, then a double at 8.
        let mut message = vec![0, 1, 0, 0, 7, 0, 0, 0, 5, 0, 0, 0];
        message.extend(1.5_f64.to_le_bytes());
        let mut r = Reader::new(&message).unwrap();
        assert_eq!((r.u8(), r.u32(), r.f64()), (Ok(7), Ok(5), Ok(1.5)));
        assert_eq!(r.u8(), Err(SHORT.to_owned()));
        let big = [0, 0, 0, 0, 0, 0, 0, 5];
        assert_eq!(Reader::new(&big).unwrap().u32(), Ok(5));
    }

    #[test]
    fn lengths_beyond_the_message_are_refused() {
        let message = [0, 1, 0, 0, 255, 255, 255, 255, 1];
        let told = Reader::new(&message).unwrap().length().unwrap_err();
        assert_eq!(told, "a sequence of 4294967295 elements in 1 bytes");
        assert!(Reader::new(&[0, 7, 0, 0]).unwrap_err().contains("00 07"));
    }
}
