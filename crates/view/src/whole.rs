//! Files that appear whole or not at all.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::Error;
use crate::error::AnyError;

/// Writes a file so that `path` holds all of it or what it held before: the closure writes to a
/// temporary file beside it, which is then renamed. Whatever fails, the temporary file is removed.
///
/// # Errors
/// [`Error::Write`] names the file, whether the closure or the file system failed.
///
/// ```
/// use std::io::Write;
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("table.csv");
/// selvedge_view::write_whole(&path, |writer| Ok(writeln!(writer, "case,error")?))?;
/// assert_eq!(std::fs::read_to_string(&path)?, "case,error\n");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write_whole(
    path: impl AsRef<Path>,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<(), Box<dyn std::error::Error + Send + Sync>>,
) -> Result<(), Error> {
    let path = path.as_ref();
    replace(path, write).map_err(|reason| Error::Write {
        path: path.to_owned(),
        reason,
    })
}

fn replace(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<(), AnyError>,
) -> Result<(), AnyError> {
    // The process and a count: two writers of one file do not share the temporary one.
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    let name = path.file_name().ok_or("the path must end in a file name")?;
    let mut temporary = OsString::from(name);
    temporary.push(format!(".{}-{count}.tmp", std::process::id()));
    let temporary = path.with_file_name(temporary);

    let file = File::create(&temporary)?;
    let guard = Removed(&temporary);
    let mut writer = BufWriter::new(file);
    write(&mut writer)?;
    writer.flush()?;
    // On the disk before the name is, so that a power cut cannot leave an empty file.
    writer.get_ref().sync_all()?;
    drop(writer);
    fs::rename(&temporary, path)?;
    std::mem::forget(guard);
    Ok(())
}

/// Removes the file when it goes out of scope, also while a panic unwinds.
struct Removed<'a>(&'a Path);

impl Drop for Removed<'_> {
    fn drop(&mut self) {
        // What failed before is what is reported.
        fs::remove_file(self.0).ok();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<OsString> {
        let entries = fs::read_dir(folder).unwrap();
        entries.map(|entry| entry.unwrap().file_name()).collect()
    }

    #[test]
    fn replaces_the_file_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        for text in ["first", "second"] {
            write_whole(&path, |writer| Ok(write!(writer, "{text}")?)).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
            assert_eq!(names(folder.path()), ["a.txt"]);
        }
    }

    #[test]
    fn a_failure_keeps_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        fs::write(&path, "old").unwrap();
        let error = write_whole(&path, |writer| {
            writer.write_all(b"half of the n")?;
            Err("the disk is full".into())
        });
        assert_eq!(
            error.unwrap_err().to_string(),
            format!("{} cannot be written: the disk is full", path.display())
        );
        let panicked = std::panic::catch_unwind(|| write_whole(&path, |_| panic!("on purpose")));
        assert!(panicked.is_err());
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn bad_paths_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let error = |path: &Path| write_whole(path, |_| Ok(())).unwrap_err().to_string();
        let missing = folder.path().join("missing").join("a.txt");
        assert!(error(&missing).contains("a.txt cannot be written"));
        assert!(error(Path::new("..")).contains("must end in a file name"));
        // A folder in the way.
        let taken = folder.path().join("taken");
        fs::create_dir(&taken).unwrap();
        fs::write(taken.join("file"), "").unwrap();
        assert!(error(&taken).contains("taken cannot be written"));
        assert_eq!(names(folder.path()), ["taken"]);
    }
}
