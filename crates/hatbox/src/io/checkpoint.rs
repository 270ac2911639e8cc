//! Work that outlives its process: finished steps in a file that is appended to.
//!
//! A header names the work by a hash of all that decides its result. Each record holds one step of one stage, with its
//! length and a checksum; it is written in one piece. Whatever was cut short, at the end, is not read, and is
//! overwritten. A run that goes on takes the steps that are there and does the others: the result is the same, bit for
//! bit, because steps depend on nothing but the input.
//!
//! Stages are told apart by their names, and those of one name by their number in the order in which they begin, which the input
//! decides too: how often rays are cast again is decided by memory.

use super::atomic::AtomicError;
use crate::progress::Progress;
use crate::quadrature::sequence::hash;
use crate::radiosity::Options;
use crate::scene::Scene;
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// The first bytes of such a file; its format has a number.
const MAGIC: [u8; 8] = *b"hatbox\0\x07";
/// Bytes of the header, and of what precedes the bytes of a step.
const HEADER: usize = 16;
const RECORD: usize = 32;

/// Why a checkpoint cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// It is of something else.
    #[error("`{}` is not a checkpoint of this work: the scene, the options or the program are others", path.display())]
    Other {
        /// The file.
        path: PathBuf,
    },
    /// It cannot be read or written.
    #[error(transparent)]
    File(#[from] AtomicError),
}

/// What a checkpoint has from an earlier run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Earlier {
    /// Steps that are finished.
    pub steps: usize,
    /// Their bytes.
    pub bytes: u64,
    /// Bytes after them that were no whole step, and were cut off.
    pub cut: u64,
}

/// Stages that have begun.
#[derive(Default)]
struct Stages {
    /// Those that have not ended, the innermost last.
    open: Vec<u64>,
    /// How many of each name have begun.
    begun: HashMap<&'static str, u64>,
}

/// A listener that keeps what is finished.
pub struct Checkpoint<P> {
    listener: P,
    path: PathBuf,
    /// The file, and where the bytes of each step of each stage lie in it.
    file: Mutex<File>,
    known: Known,
    cut: u64,
    stages: Mutex<Stages>,
    /// Whether something could not be kept, as where a disk is full.
    failed: AtomicBool,
}

impl<P: Progress> Checkpoint<P> {
    /// Opens or makes the file at `path`, for a work of that [`identity`]; `listener` hears of its progress.
    ///
    /// # Errors
    /// [`CheckpointError`]; a file of something else is left as it is.
    pub fn open(path: &Path, identity: u64, listener: P) -> Result<Self, CheckpointError> {
        let failed = |source: io::Error| AtomicError { path: path.to_owned(), source };
        let mut file =
            File::options().read(true).write(true).create(true).truncate(false).open(path).map_err(failed)?;
        let mut header = [0; HEADER];
        header[..8].copy_from_slice(&MAGIC);
        header[8..].copy_from_slice(&identity.to_le_bytes());
        let mut found = Vec::with_capacity(HEADER);
        Read::by_ref(&mut file).take(HEADER as u64).read_to_end(&mut found).map_err(failed)?;
        if !header.starts_with(&found) {
            return Err(CheckpointError::Other { path: path.to_owned() });
        }
        let (known, cut) = if found.len() < HEADER {
            file.set_len(0).and_then(|()| file.rewind()).and_then(|()| file.write_all(&header)).map_err(failed)?;
            (HashMap::new(), 0)
        } else {
            records(&mut file).map_err(failed)?
        };
        Ok(Self {
            listener,
            path: path.to_owned(),
            file: Mutex::new(file),
            known,
            cut,
            stages: Mutex::default(),
            failed: AtomicBool::new(false),
        })
    }

    /// What an earlier run has left.
    pub fn earlier(&self) -> Earlier {
        let bytes = self.known.values().map(|&(_, length)| length as u64).sum();
        Earlier { steps: self.known.len(), bytes, cut: self.cut }
    }

    /// The work is done, and its result is safe: removes the file.
    pub fn remove(self) {
        drop(self.file);
        // Whoever removed it before has saved the work.
        let _ = std::fs::remove_file(&self.path);
    }

    fn key(&self, step: u64) -> [u64; 2] {
        let stage = self.stages.lock().ok().and_then(|stages| stages.open.last().copied());
        [stage.unwrap_or(0), step]
    }
}

impl<P: Progress> Progress for Checkpoint<P> {
    fn begin(&self, stage: &'static str, total: u64) {
        if let Ok(mut stages) = self.stages.lock() {
            let number = stages.begun.entry(stage).or_default();
            *number += 1;
            let key = digest(*number, stage.as_bytes());
            stages.open.push(key);
        }
        self.listener.begin(stage, total);
    }

    fn advance(&self, steps: u64) {
        self.listener.advance(steps);
    }

    fn end(&self) {
        if let Ok(mut stages) = self.stages.lock() {
            stages.open.pop();
        }
        self.listener.end();
    }

    fn warn(&self, text: &str) {
        self.listener.warn(text);
    }

    fn interrupted(&self) -> bool {
        self.listener.interrupted()
    }

    fn keeps(&self) -> bool {
        true
    }

    fn recall(&self, step: u64) -> Option<Vec<u8>> {
        let &(start, length) = self.known.get(&self.key(step))?;
        let mut file = self.file.lock().ok()?;
        let mut bytes = vec![0; length];
        file.seek(SeekFrom::Start(start)).and_then(|_| file.read_exact(&mut bytes)).ok()?;
        Some(bytes)
    }

    /// A disk that is full costs the checkpoint, not the work: it is told once, and no more is kept.
    fn keep(&self, step: u64, bytes: &[u8]) {
        if self.failed.load(Ordering::Relaxed) {
            return;
        }
        let [stage, step] = self.key(step);
        let mut record = Vec::with_capacity(RECORD + bytes.len());
        for number in [stage, step, bytes.len() as u64, checksum([stage, step], bytes)] {
            record.extend_from_slice(&number.to_le_bytes());
        }
        record.extend_from_slice(bytes);
        let Ok(mut file) = self.file.lock() else { return };
        // A record that is not whole is not read.
        let written = file.seek(SeekFrom::End(0)).and_then(|_| file.write_all(&record));
        if let Err(error) = written
            && !self.failed.swap(true, Ordering::Relaxed)
        {
            self.warn(&format!("no more is kept in `{}`: {error}", self.path.display()));
        }
    }
}

/// Where the bytes of each step of each stage lie.
type Known = HashMap<[u64; 2], (u64, usize)>;

/// The whole records of a file, whose rest is cut off, and the length of that; it is read from where it stands.
fn records(file: &mut File) -> io::Result<(Known, u64)> {
    let size = file.metadata()?.len();
    let mut known = HashMap::new();
    let mut at = HEADER as u64;
    let mut bytes = Vec::new();
    while at + RECORD as u64 <= size {
        let mut head = [0; RECORD];
        file.read_exact(&mut head)?;
        let [stage, step, length, sum] = [0, 1, 2, 3].map(|k| {
            let mut number = [0; 8];
            number.copy_from_slice(&head[8 * k..8 * k + 8]);
            u64::from_le_bytes(number)
        });
        let start = at + RECORD as u64;
        if length > size - start {
            break;
        }
        bytes.resize(length as usize, 0);
        file.read_exact(&mut bytes)?;
        if checksum([stage, step], &bytes) != sum {
            break;
        }
        known.insert([stage, step], (start, length as usize));
        at = start + length;
    }
    file.set_len(at)?;
    Ok((known, size - at))
}

fn checksum(key: [u64; 2], bytes: &[u8]) -> u64 {
    digest(hash(key[0], key[1]), bytes)
}

/// A hash of bytes, eight at a time.
fn digest(seed: u64, bytes: &[u8]) -> u64 {
    let (words, rest) = bytes.as_chunks::<8>();
    let mut last = [0; 8];
    last[..rest.len()].copy_from_slice(rest);
    let sum = words.iter().fold(seed, |sum, word| hash(sum, u64::from_le_bytes(*word)));
    hash(hash(sum, u64::from_le_bytes(last)), bytes.len() as u64)
}

/// A number for all that decides the result of a solve: the scene, the options, and the program's version. What memory is allowed
/// does not; what materials that are functions or textures show between the middles of faces is not looked at, and steps must tell
/// whether they are of the same work.
pub fn identity(scene: &Scene, options: &Options, more: &str) -> u64 {
    let Options { basis, continuity, refinement, grading, tolerance, operator, solver, seed, error_points, .. } =
        options;
    let names = [env!("CARGO_PKG_VERSION"), basis.name, operator.name, more];
    let numbers = (grading, tolerance, seed, error_points);
    let text = format!("{names:?} {numbers:?} {continuity:?} {refinement:?} {solver:?} {:?}", scene.materials);
    let mut sum = digest(0, text.as_bytes());
    for corner in scene.surfaces.iter().flat_map(|surface| surface.corners) {
        sum = corner.to_array().iter().fold(sum, |sum, x| hash(sum, x.to_bits()));
    }
    for (index, cell) in scene.mesh.cells.iter().enumerate() {
        let numbers = cell.vertices.iter().chain([&cell.surface, &cell.material]);
        sum = numbers.fold(sum, |sum, &number| hash(sum, u64::from(number)));
        // What textures show there decides which faces are lamps.
        let site = scene.site(index, [1.0 / 3.0, 1.0 / 3.0]);
        let exitances = (0..scene.bands).map(|band| scene.material(index).exitance.at(&site, band));
        sum = exitances.fold(sum, |sum, exitance| hash(sum, exitance.to_bits()));
    }
    scene.mesh.vertices.iter().flat_map(glam::DVec3::to_array).fold(sum, |sum, x| hash(sum, x.to_bits()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    fn open(path: &Path, identity: u64) -> Result<Checkpoint<Silent>, CheckpointError> {
        Checkpoint::open(path, identity, Silent)
    }

    /// Wherever the file is cut, what is read is a part of what was kept, and the rest can be kept again.
    #[test]
    fn a_file_that_was_cut_short_holds_its_whole_records() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("work");
        let steps: Vec<Vec<u8>> = (0..5_u8).map(|k| vec![k; 3 * usize::from(k) + 1]).collect();
        let first = open(&path, 7).expect("a new file");
        first.begin("stage", 5);
        for (step, bytes) in steps.iter().enumerate() {
            first.keep(step as u64, bytes);
        }
        let whole = std::fs::read(&path).expect("the file");
        for length in 0..=whole.len() {
            std::fs::write(&path, &whole[..length]).expect("cut");
            let again = open(&path, 7).expect("it goes on");
            let Earlier { steps: known, bytes, cut } = again.earlier();
            assert_eq!(bytes, steps[..known].iter().map(|step| step.len() as u64).sum::<u64>());
            if length >= HEADER {
                assert_eq!(HEADER + known * RECORD + bytes as usize + cut as usize, length, "cut at {length}");
            }
            again.begin("stage", 5);
            for (step, bytes) in steps.iter().enumerate() {
                match again.recall(step as u64) {
                    Some(found) => assert_eq!(&found, bytes),
                    None => again.keep(step as u64, bytes),
                }
            }
            assert_eq!(std::fs::read(&path).expect("the file"), whole, "cut at {length}");
        }
    }

    /// As rays that are cast again while something else goes on, more or less often, as memory has it.
    #[test]
    fn stages_within_others_change_no_place() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("work");
        let work = |inner: usize| {
            let checkpoint = open(&path, 7).expect("a checkpoint");
            let found: Vec<Option<Vec<u8>>> = (0..2)
                .map(|round| {
                    checkpoint.begin("outer", 1);
                    for _ in 0..inner {
                        checkpoint.begin("inner", 1);
                        checkpoint.end();
                    }
                    let found = checkpoint.recall(0);
                    checkpoint.keep(0, &[round]);
                    checkpoint.end();
                    found
                })
                .collect();
            found
        };
        assert_eq!(work(1), [None, None]);
        for inner in [0, 3] {
            assert_eq!(work(inner), [Some(vec![0]), Some(vec![1])]);
        }
    }

    #[derive(Default)]
    struct Warned(Mutex<Vec<String>>);

    impl Progress for Warned {
        fn warn(&self, text: &str) {
            self.0.lock().expect("no panics").push(text.to_owned());
        }
    }

    /// Nobody heard of it before.
    #[test]
    fn what_cannot_be_kept_is_told_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let (path, warned) = (folder.path().join("work"), Warned::default());
        let mut checkpoint = Checkpoint::open(&path, 7, &warned).expect("a new file");
        checkpoint.keep(0, b"some bytes");
        assert!(warned.0.lock().expect("no panics").is_empty());
        // As a disk that is full, it cannot be written to.
        checkpoint.file = Mutex::new(File::open(&path).expect("the file"));
        checkpoint.keep(1, b"more");
        checkpoint.keep(2, b"more");
        let warned = warned.0.lock().expect("no panics");
        assert!(warned.len() == 1 && warned[0].contains("no more is kept in `"), "{warned:?}");
        assert_eq!(open(&path, 7).expect("it goes on").earlier().steps, 1);
    }

    #[test]
    fn bytes_that_changed_are_not_believed_and_other_work_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("work");
        let first = open(&path, 7).expect("a new file");
        first.begin("stage", 1);
        first.keep(0, b"some bytes");
        assert!(matches!(open(&path, 8), Err(CheckpointError::Other { .. })));
        let mut bytes = std::fs::read(&path).expect("the file");
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        std::fs::write(&path, &bytes).expect("changed");
        assert_eq!(open(&path, 7).expect("it goes on").earlier().steps, 0);
        std::fs::write(&path, "a file of the user's own").expect("written");
        assert!(matches!(open(&path, 7), Err(CheckpointError::Other { .. })));
    }
}
