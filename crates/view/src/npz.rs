//! Arrays in a zip archive, as numpy's `savez_compressed` writes them. The only file that names
//! `zip`.
//!
//! An entry `name.npy` is the magic `\x93NUMPY`, version 1.0, the length of the header in two
//! bytes, the header `{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }` padded with
//! spaces to a multiple of 64 bytes, and the elements, last index fastest. Only what numpy writes
//! for plain C-ordered arrays is read, so a header is never more than a few words to compare.

use std::io::{self, BufWriter, Read, Seek, Write};

use zip::result::ZipError;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, System, ZipArchive, ZipWriter};

use crate::Error;
use crate::error::AnyError;

const MAGIC: [u8; 8] = *b"\x93NUMPY\x01\x00";
/// A header of numpy has 118 bytes; nothing that is read here needs more.
const MAX_HEADER: usize = 1024;
/// All arrays of a file together, unpacked: what a hostile file can make the reader allocate, and
/// small enough that no entry needs the 64-bit form of zip.
pub const MAX_BYTES: u64 = 4_000_000_000;

/// A number that can stand in an array.
pub(crate) trait Element: Copy {
    const DTYPE: &'static str;
    const SIZE: usize = size_of::<Self>();
    fn put(self, writer: &mut impl Write) -> io::Result<()>;
    /// From `SIZE` bytes.
    fn get(bytes: &[u8]) -> Self;
}

macro_rules! element {
    ($type:ty, $dtype:literal) => {
        impl Element for $type {
            const DTYPE: &'static str = $dtype;
            fn put(self, writer: &mut impl Write) -> io::Result<()> {
                writer.write_all(&self.to_le_bytes())
            }
            fn get(bytes: &[u8]) -> Self {
                let mut raw = [0; Self::SIZE];
                raw.copy_from_slice(bytes);
                Self::from_le_bytes(raw)
            }
        }
    };
}
element!(f64, "<f8");
element!(u32, "<u4");
element!(u8, "|u1");

/// Writes arrays: same arrays in the same order, same bytes.
pub(crate) struct NpzWriter<W: Write + Seek> {
    zip: ZipWriter<W>,
    bytes_left: u64,
}

impl<W: Write + Seek> NpzWriter<W> {
    pub(crate) fn new(writer: W) -> Self {
        Self {
            zip: ZipWriter::new(writer),
            bytes_left: MAX_BYTES,
        }
    }

    pub(crate) fn array<T: Element>(
        &mut self,
        name: &'static str,
        shape: &[usize],
        values: impl IntoIterator<Item = T>,
    ) -> Result<(), AnyError> {
        spend::<T>(&mut self.bytes_left, name, shape)?;
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Deflated)
            .last_modified_time(DateTime::default()) // 1980-01-01
            .system(System::Unix) // on every system
            .unix_permissions(0o644);
        self.zip.start_file(format!("{name}.npy"), options)?;
        let mut writer = BufWriter::with_capacity(1 << 16, &mut self.zip);
        let mut header = format!(
            "{{'descr': '{}', 'fortran_order': False, 'shape': {}, }}",
            T::DTYPE,
            tuple(shape)
        );
        let unpadded = MAGIC.len() + 2 + header.len() + 1;
        header.push_str(&" ".repeat(unpadded.next_multiple_of(64) - unpadded));
        header.push('\n');
        writer.write_all(&MAGIC)?;
        writer.write_all(&u16::try_from(header.len())?.to_le_bytes())?;
        writer.write_all(header.as_bytes())?;
        for value in values {
            value.put(&mut writer)?;
        }
        writer.flush()?;
        Ok(())
    }

    pub(crate) fn finish(self) -> Result<W, AnyError> {
        Ok(self.zip.finish()?)
    }
}

/// Reads arrays by name.
pub(crate) struct NpzReader<R: Read + Seek> {
    zip: ZipArchive<R>,
    bytes_left: u64,
}

impl<R: Read + Seek> NpzReader<R> {
    pub(crate) fn new(reader: R) -> Result<Self, AnyError> {
        Ok(Self {
            zip: ZipArchive::new(reader)?,
            bytes_left: MAX_BYTES,
        })
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.zip.index_for_name(&format!("{name}.npy")).is_some()
    }

    /// The shape of an array, as its header tells it.
    pub(crate) fn shape(&mut self, name: &'static str) -> Result<Vec<usize>, Error> {
        Ok(header(name, &mut self.entry(name)?)?.1)
    }

    /// The elements of an array that must have this shape.
    pub(crate) fn array<T: Element>(
        &mut self,
        name: &'static str,
        shape: &[usize],
    ) -> Result<Vec<T>, Error> {
        let mut bytes_left = self.bytes_left;
        let mut entry = self.entry(name)?;
        let (dtype, found) = header(name, &mut entry)?;
        if dtype != T::DTYPE {
            return Err(Error::value(name, format!("dtype is {dtype}"), T::DTYPE));
        }
        if found != shape {
            let found = format!("shape is {}", tuple(&found));
            return Err(Error::value(name, found, tuple(shape)));
        }
        let mut bytes = spend::<T>(&mut bytes_left, name, shape)?;

        // The vector grows with what is really there.
        let mut values = Vec::new();
        let mut buffer = vec![0; 1 << 16];
        let broken = |error: io::Error| match error.kind() {
            io::ErrorKind::UnexpectedEof => {
                Error::value(name, "cut short", format!("of shape {}", tuple(shape)))
            }
            _ => Error::value(name, format!("damaged ({error})"), "whole"),
        };
        while bytes > 0 {
            let part = bytes.min(buffer.len() as u64) as usize;
            entry.read_exact(&mut buffer[..part]).map_err(broken)?;
            values.extend(buffer[..part].chunks_exact(T::SIZE).map(T::get));
            bytes -= part as u64;
        }
        // The checksum is compared at the end of the entry.
        if entry.read(&mut buffer[..1]).map_err(broken)? > 0 {
            let bound = format!("of shape {}", tuple(shape));
            return Err(Error::value(name, "longer than its header says", bound));
        }
        drop(entry);
        self.bytes_left = bytes_left;
        Ok(values)
    }

    fn entry(&mut self, name: &'static str) -> Result<impl Read, Error> {
        self.zip
            .by_name(&format!("{name}.npy"))
            .map_err(|error| match error {
                ZipError::FileNotFound => Error::value(name, "missing", "in the file"),
                error => Error::value(name, format!("not readable ({error})"), "a deflated entry"),
            })
    }
}

/// The bytes of an array, taken from what is left.
fn spend<T: Element>(left: &mut u64, name: &'static str, shape: &[usize]) -> Result<u64, Error> {
    let bytes = shape.iter().try_fold(T::SIZE as u64, |bytes, &n| {
        bytes.checked_mul(n.try_into().ok()?)
    });
    match bytes.and_then(|bytes| Some((bytes, left.checked_sub(bytes)?))) {
        Some((bytes, rest)) => {
            *left = rest;
            Ok(bytes)
        }
        None => {
            let bound = format!("such that all arrays together have {MAX_BYTES} bytes at most");
            let shape = format!("shape is {}", tuple(shape));
            Err(Error::value(name, shape, bound))
        }
    }
}

/// Type and shape of an array, with the reader left at its first element.
fn header(name: &'static str, entry: &mut impl Read) -> Result<(String, Vec<usize>), Error> {
    let bad = |value: String| {
        let bound = "the .npy header of a plain C-ordered array, version 1.0";
        Error::value(name, value, bound)
    };
    let broken = |error: io::Error| bad(format!("header is not readable ({error})"));
    let mut start = [0; 10];
    entry.read_exact(&mut start).map_err(broken)?;
    let length = usize::from(u16::from_le_bytes([start[8], start[9]]));
    if start[..8] != MAGIC || length > MAX_HEADER {
        return Err(bad(format!("header starts with {start:?}")));
    }
    let mut text = vec![0; length];
    entry.read_exact(&mut text).map_err(broken)?;
    let text = String::from_utf8_lossy(&text);
    parse(&text).ok_or_else(|| bad(format!("header is {:?}", text.trim_end())))
}

fn parse(header: &str) -> Option<(String, Vec<usize>)> {
    let rest = header.trim_end().strip_prefix("{'descr': '")?;
    let (dtype, shape) = rest.split_once("', 'fortran_order': False, 'shape': (")?;
    let shape = shape.strip_suffix("), }")?;
    let shape = shape.strip_suffix(',').unwrap_or(shape);
    let numbers = shape.split(',').filter(|_| !shape.is_empty());
    let shape = numbers
        .map(|n| n.trim().parse().ok())
        .collect::<Option<_>>()?;
    Some((dtype.to_owned(), shape))
}

/// A shape as Python writes it.
fn tuple(shape: &[usize]) -> String {
    match shape {
        [n] => format!("({n},)"),
        _ => {
            let numbers: Vec<String> = shape.iter().map(ToString::to_string).collect();
            format!("({})", numbers.join(", "))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    fn npy(header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    /// An archive with the entry `a.npy`.
    fn archive(entry: &[u8]) -> NpzReader<Cursor<Vec<u8>>> {
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        zip.start_file("a.npy", SimpleFileOptions::default())
            .unwrap();
        zip.write_all(entry).unwrap();
        NpzReader::new(zip.finish().unwrap()).unwrap()
    }

    fn refused(entry: &[u8], shape: &[usize]) -> String {
        archive(entry)
            .array::<f64>("a", shape)
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn arrays_read_back() {
        let mut npz = NpzWriter::new(Cursor::new(Vec::new()));
        npz.array("x", &[2, 3], [0.5, -0.0, 1e300, 1e-300, 3.0, 4.0])
            .unwrap();
        npz.array("i", &[2], [7_u32, u32::MAX]).unwrap();
        npz.array("none", &[0, 4], [0_u8; 0]).unwrap();
        let mut npz = NpzReader::new(npz.finish().unwrap()).unwrap();
        assert!(npz.has("x") && !npz.has("y"));
        assert_eq!(npz.shape("x").unwrap(), [2, 3]);
        assert_eq!(
            npz.array::<f64>("x", &[2, 3]).unwrap()[..3],
            [0.5, -0.0, 1e300]
        );
        assert_eq!(npz.array::<u32>("i", &[2]).unwrap(), [7, u32::MAX]);
        assert_eq!(npz.array::<u8>("none", &[0, 4]).unwrap(), [0; 0]);
        let error = npz.shape("y").unwrap_err().to_string();
        assert_eq!(error, "y: missing, must be in the file");
    }

    /// Another reader of the format as a witness.
    #[test]
    fn npyz_reads_what_is_written() {
        let mut npz = NpzWriter::new(Cursor::new(Vec::new()));
        npz.array("x", &[2, 3], [0.5, -0.0, 1e300, 1e-300, 3.0, 4.0])
            .unwrap();
        let mut zip = ZipArchive::new(npz.finish().unwrap()).unwrap();
        let entry = zip.by_name("x.npy").unwrap();
        assert_eq!(entry.last_modified(), Some(DateTime::default()));
        assert_eq!(entry.compression(), CompressionMethod::Deflated);
        let npy = npyz::NpyFile::new(entry).unwrap();
        assert_eq!(npy.shape(), [2, 3]);
        assert_eq!(npy.order(), npyz::Order::C);
        let values = npy.into_vec::<f64>().unwrap();
        assert_eq!(values, [0.5, -0.0, 1e300, 1e-300, 3.0, 4.0]);
    }

    #[test]
    fn hostile_headers_are_refused() {
        let text = |descr: &str, order: &str, shape: &str| {
            format!("{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}\n")
        };
        let plain = |shape: &str| text("'<f8'", "False", shape);
        for (entry, shape, message) in [
            (
                npy(&plain("(2,)"), &[0; 16]),
                &[3][..],
                "a: shape is (2,), must be (3,)",
            ),
            (
                npy(&plain("()"), &[0; 8]),
                &[1],
                "a: shape is (), must be (1,)",
            ),
            (
                npy(&plain("(2,)"), &[0; 15]),
                &[2],
                "a: cut short, must be of shape (2,)",
            ),
            (
                npy(&plain("(2,)"), &[0; 17]),
                &[2],
                "a: longer than its header says, must be of shape (2,)",
            ),
            (
                npy(&text("'<f4'", "False", "(2,)"), &[0; 8]),
                &[2],
                "a: dtype is <f4, must be <f8",
            ),
            // Shapes whose product overflows, or is large with nothing behind it.
            (
                npy(&plain("(4294967296, 4294967296)"), &[]),
                &[4_294_967_296, 4_294_967_296],
                "a: shape is (4294967296, 4294967296), must be such that all arrays together have \
                 4000000000 bytes at most",
            ),
            (
                npy(&plain("(499999999,)"), &[0; 8]),
                &[499_999_999],
                "a: cut short, must be of shape (499999999,)",
            ),
        ] {
            assert_eq!(refused(&entry, shape), message);
        }
        for (entry, value) in [
            (vec![], "header is not readable"),
            (
                npy(&plain("(2,)"), &[])[..30].to_vec(),
                "header is not readable",
            ),
            (
                b"\x93NUMPY\x02\x00\x10\x00\x00\x00".to_vec(),
                "header starts with",
            ),
            (npy(&" ".repeat(2000), &[]), "header starts with"),
            (npy(&"(".repeat(1000), &[]), "header is"),
            (npy(&plain("(-1,)"), &[]), "header is"),
            (npy(&plain("(1,,2)"), &[]), "header is"),
            (npy(&plain("(99999999999999999999999,)"), &[]), "header is"),
            (npy(&text("'<f8'", "True", "(2, 2)"), &[0; 32]), "header is"),
            (
                npy(&text("[('x', '<f8')]", "False", "(2,)"), &[0; 16]),
                "header is",
            ),
        ] {
            let error = refused(&entry, &[2]);
            assert!(error.starts_with(&format!("a: {value}")), "{error}");
            assert!(
                error.ends_with("plain C-ordered array, version 1.0"),
                "{error}"
            );
        }
    }

    #[test]
    fn damage_is_noticed() {
        let mut npz = NpzWriter::new(Cursor::new(Vec::new()));
        npz.array("a", &[100], (0..100).map(f64::from)).unwrap();
        let bytes = npz.finish().unwrap().into_inner();
        for at in 0..bytes.len() {
            for end in [true, false] {
                let mut damaged = bytes.clone();
                if end {
                    damaged.truncate(at);
                } else {
                    damaged[at] ^= 0x10;
                }
                // Some bytes of a zip carry nothing; what reads must be what was written.
                let values = NpzReader::new(Cursor::new(damaged))
                    .ok()
                    .and_then(|mut npz| npz.array::<f64>("a", &[100]).ok());
                if let Some(values) = values {
                    assert!(!end && values.iter().copied().eq((0..100).map(f64::from)));
                }
            }
        }
    }
}
