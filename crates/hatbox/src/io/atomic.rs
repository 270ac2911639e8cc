//! Files that appear whole or not at all.
//!
//! A solve may take hours and be interrupted at any moment; a script that finds an output file must be able to trust
//! it. So the bytes go to a temporary file beside the target, are forced to the disk, and only then take the target's
//! name.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// A file could not be written; the target is as it was before.
#[derive(Debug, thiserror::Error)]
#[error("cannot write `{}`: {source}", path.display())]
pub struct AtomicError {
    /// The file that was to be written.
    pub path: PathBuf,
    /// What the system said.
    pub source: io::Error,
}

/// Writes what `fill` produces to `path`, whole or not at all.
///
/// A symbolic link is followed; a device or a pipe is written to directly.
///
/// # Errors
/// [`AtomicError`] if `fill` fails or the file cannot be created, flushed to the disk or renamed. Nothing is left
/// behind.
pub fn write(path: &Path, fill: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>) -> Result<(), AtomicError> {
    try_write(path, fill).map_err(|source| AtomicError { path: path.to_owned(), source })
}

/// Whether [`write()`] could write to `path`, found out by creating a temporary file beside it.
///
/// # Errors
/// [`AtomicError`] if the path is a folder, or its folder does not exist or may not be written to.
pub fn check(path: &Path) -> Result<(), AtomicError> {
    let try_check = || match Target::of(path)? {
        Target::Stream => Ok(()),
        Target::File(file) => temporary_beside(&file).map(drop),
    };
    try_check().map_err(|source| AtomicError { path: path.to_owned(), source })
}

fn try_write(path: &Path, fill: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>) -> io::Result<()> {
    match Target::of(path)? {
        Target::Stream => fill_file(&File::options().write(true).open(path)?, fill),
        Target::File(path) => {
            let temporary = temporary_beside(&path)?;
            fill_file(temporary.as_file(), fill)?;
            temporary.as_file().sync_all()?;
            temporary.persist(&path).map_err(|error| error.error)?;
            sync_folder(&path);
            Ok(())
        }
    }
}

fn fill_file(file: &File, fill: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>) -> io::Result<()> {
    let mut writer = BufWriter::new(file);
    fill(&mut writer)?;
    writer.flush()
}

/// What a path leads to.
enum Target {
    /// A regular file, or nothing yet.
    File(PathBuf),
    /// A device or pipe, which no rename may replace.
    Stream,
}

impl Target {
    fn of(path: &Path) -> io::Result<Self> {
        match fs::metadata(path) {
            Ok(found) if found.is_dir() => Err(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder")),
            Ok(found) if found.is_file() => fs::canonicalize(path).map(Self::File),
            Ok(_) => Ok(Self::Stream),
            Err(_) if path.file_name().is_none() => {
                Err(io::Error::new(io::ErrorKind::InvalidInput, "it does not name a file"))
            }
            Err(_) => Ok(Self::File(path.to_owned())),
        }
    }
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn temporary_beside(path: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".hatbox-").suffix(".part");
    // A temporary file is private by default; the result is an ordinary file, subject to the user's umask.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let folder = folder(path);
    builder.tempfile_in(folder).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => {
            io::Error::new(error.kind(), format!("the folder `{}` does not exist", folder.display()))
        }
        kind => io::Error::new(kind, format!("no file can be made in the folder `{}` ({kind})", folder.display())),
    })
}

/// Makes the new name survive a power failure where the system can; a system that cannot open folders has nothing to
/// do.
fn sync_folder(path: &Path) {
    if let Ok(folder) = File::open(folder(path)) {
        let _ = folder.sync_all();
    }
}
