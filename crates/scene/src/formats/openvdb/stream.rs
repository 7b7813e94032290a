//! Bytes of a file, from front to back.

/// Reads little-endian numbers; errors say where the file ends.
pub(super) struct Stream<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Stream<'a> {
    /// From an offset on.
    pub fn new(bytes: &'a [u8], at: usize) -> Self {
        Self { bytes, at }
    }

    /// The offset of the next byte.
    pub fn at(&self) -> usize {
        self.at
    }

    /// The next bytes.
    ///
    /// # Errors
    /// A sentence where there are fewer.
    pub fn take(&mut self, count: u64) -> Result<&'a [u8], String> {
        let end = usize::try_from(count).ok().and_then(|n| self.at.checked_add(n));
        let taken = end.and_then(|end| self.bytes.get(self.at..end));
        let taken = taken.ok_or_else(|| format!("the file ends too early: {count} bytes are missing from byte {} on", self.at))?;
        self.at += taken.len();
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        Ok(self.take(N as u64)?.try_into().unwrap_or([0; N]))
    }

    /// A byte.
    pub fn u8(&mut self) -> Result<u8, String> {
        Ok(u8::from_le_bytes(self.array()?))
    }

    /// A whole number.
    pub fn u32(&mut self) -> Result<u32, String> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    /// A large number, maybe negative.
    pub fn i64(&mut self) -> Result<i64, String> {
        Ok(i64::from_le_bytes(self.array()?))
    }

    /// Double precision.
    pub fn f64(&mut self) -> Result<f64, String> {
        Ok(f64::from_le_bytes(self.array()?))
    }

    /// Indices along x, y and z.
    pub fn coord(&mut self) -> Result<[i64; 3], String> {
        let mut next = || self.u32().map(|v| i64::from(v as i32));
        Ok([next()?, next()?, next()?])
    }

    /// A text, with its length before it.
    pub fn text(&mut self) -> Result<&'a [u8], String> {
        let length = self.u32()?;
        self.take(u64::from(length))
    }

    /// Passes a table of named values.
    pub fn skip_metadata(&mut self) -> Result<(), String> {
        for _ in 0..self.u32()? {
            self.text()?;
            self.text()?;
            self.text()?;
        }
        Ok(())
    }
}
