//! How much a packed file may unpack to.

/// Bytes that may still be unpacked from one file: memory stays bounded by the size of the file.
#[derive(Debug)]
pub(crate) struct Budget {
    left: usize,
}

impl Budget {
    /// Motion records of doubles pack to a tenth; constant ones to a hundredth. Beyond this factor
    /// a file is made to fill memory.
    const FACTOR: usize = 500;
    /// Small files may hold long constant records.
    const FLOOR: usize = 16 << 20;

    pub(crate) fn of(bytes: usize) -> Self {
        Self {
            left: bytes
                .saturating_mul(Self::FACTOR)
                .saturating_add(Self::FLOOR),
        }
    }

    /// Bytes that are left.
    #[cfg(any(
        feature = "mcap",
        feature = "npz",
        feature = "mat",
        feature = "parquet"
    ))]
    pub(crate) fn left(&self) -> usize {
        self.left
    }

    /// Takes bytes from the budget; whether there were enough.
    pub(crate) fn take(&mut self, bytes: usize) -> bool {
        let enough = bytes <= self.left;
        self.left = self.left.saturating_sub(bytes);
        enough
    }
}
