//! Imports point down the list in `ARCHITECTURE.md`, and the list names every module of the library.
//!
//! The check works on text, so it sees test modules and code for other targets too. Comments and literals are blanked
//! first; what is left is searched for paths that start at the root of the crate: `crate::x`, `crate::{x, y}`, and chains
//! of `super` that are long enough.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{fs, io};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// The layers, lowest first: the lines of the block that is fenced as `layers`.
fn layers(document: &str) -> Vec<Vec<String>> {
    let block = document.lines().skip_while(|line| line.trim() != "```layers").skip(1);
    let lines = block.take_while(|line| line.trim() != "```");
    lines.map(|line| line.split_whitespace().map(String::from).collect()).collect()
}

/// Blanks comments, strings and characters; line breaks stay.
fn blanked(source: &str) -> String {
    let text: Vec<char> = source.chars().collect();
    let at = |i: usize| text.get(i).copied().unwrap_or('\0');
    let starts = |i: usize, word: &str| word.chars().enumerate().all(|(k, c)| at(i + k) == c);
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let mut out = String::with_capacity(source.len());
    let mut i = 0;
    while i < text.len() {
        let end = if starts(i, "//") {
            (i..text.len()).find(|&k| at(k) == '\n').unwrap_or(text.len())
        } else if starts(i, "/*") {
            let mut depth = 1;
            let mut k = i + 2;
            while k < text.len() && depth > 0 {
                let (open, close) = (starts(k, "/*"), starts(k, "*/"));
                depth = if open { depth + 1 } else { depth - usize::from(close) };
                k += if open || close { 2 } else { 1 };
            }
            k
        } else if at(i) == '"' {
            // The hashes of a raw string stand between its `r` and the quote.
            let hashes = (0..i).rev().take_while(|&k| at(k) == '#').count();
            let prefix: String = (0..i - hashes).rev().map(at).take_while(|&c| is_word(c)).collect();
            let raw = matches!(prefix.as_str(), "r" | "rb");
            let closing: String =
                std::iter::once('"').chain(std::iter::repeat_n('#', if raw { hashes } else { 0 })).collect();
            let mut k = i + 1;
            while k < text.len() && !starts(k, &closing) {
                k += if at(k) == '\\' && !raw { 2 } else { 1 };
            }
            k + closing.len()
        } else if at(i) == '\'' && (at(i + 1) == '\\' || at(i + 2) == '\'') {
            let first = if at(i + 1) == '\\' { i + 3 } else { i + 2 };
            (first..text.len()).find(|&k| at(k) == '\'').map_or(text.len(), |k| k + 1)
        } else {
            out.push(at(i));
            i += 1;
            continue;
        };
        let end = end.min(text.len());
        out.extend(text[i..end].iter().map(|&c| if c == '\n' { c } else { ' ' }));
        i = end;
    }
    out
}

/// Words, `::` and single characters, each with its line.
fn tokens(blanked: &str) -> Vec<(usize, &str)> {
    let mut tokens = Vec::new();
    for (number, line) in blanked.lines().enumerate() {
        let mut rest = line.trim_start();
        while let Some(first) = rest.chars().next() {
            let word = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
            let length = match word {
                0 if rest.starts_with("::") => 2,
                0 => first.len_utf8(),
                word => word,
            };
            tokens.push((number + 1, &rest[..length]));
            rest = rest[length..].trim_start();
        }
    }
    tokens
}

/// The modules that a file names from the root of the crate, each with its line. `depth` is how deep in the crate the
/// file's module is: 1 for `solve/mod.rs`, 2 for `solve/cg.rs`.
fn named_modules(source: &str, depth: usize) -> Vec<(usize, String)> {
    let blanked = blanked(source);
    let tokens = tokens(&blanked);
    let text = |i: usize| tokens.get(i).map_or("", |&(_, text)| text);
    let before = |i: usize, n: usize| i.checked_sub(n).map_or("", text);
    let mut found = Vec::new();
    // Whether each open brace is that of a module.
    let mut braces: Vec<bool> = Vec::new();
    for i in 0..tokens.len() {
        let path = match text(i) {
            "{" => {
                braces.push(before(i, 2) == "mod");
                continue;
            }
            "}" => {
                braces.pop();
                continue;
            }
            "crate" => i + 1,
            "super" if !(before(i, 1) == "::" && before(i, 2) == "super") => {
                let chain =
                    (0..).take_while(|&k| text(i + 2 * k) == "super" && (k == 0 || text(i + 2 * k - 1) == "::"));
                let length = chain.count();
                if length < depth + braces.iter().filter(|&&module| module).count() {
                    continue;
                }
                i + 2 * length - 1
            }
            _ => continue,
        };
        if text(path) == "::" {
            found.extend(heads(&tokens[path + 1..]));
        }
    }
    found
}

/// The first segments of a path or of the paths in braces.
fn heads(tokens: &[(usize, &str)]) -> Vec<(usize, String)> {
    let head = |&(line, text): &(usize, &str)| (line, text.to_owned());
    if tokens.first().is_none_or(|&(_, text)| text != "{") {
        return tokens.first().map(head).into_iter().collect();
    }
    let mut depth = 0;
    let mut found = Vec::new();
    for (i, &(_, text)) in tokens.iter().enumerate() {
        match text {
            "{" => depth += 1,
            "}" => depth -= 1,
            _ if depth == 1 && matches!(tokens[i - 1].1, "{" | ",") => found.push(head(&tokens[i])),
            _ => {}
        }
        if depth == 0 {
            break;
        }
    }
    found
}

/// What is wrong with the imports of one file, `file:line: …` each. `path` is relative to `src`.
fn violations(layers: &[Vec<String>], path: &str, source: &str) -> Vec<String> {
    let layer = |module: &str| layers.iter().position(|line| line.iter().any(|name| name == module));
    let parts: Vec<&str> = path.trim_end_matches(".rs").split('/').collect();
    let module = parts[0];
    let depth = parts.len() - usize::from(parts.last() == Some(&"mod"));
    let Some(own) = layer(module) else {
        return vec![format!("{path}:1: the module `{module}` is not in the list of layers")];
    };
    let complaint = |(line, target): (usize, String)| match layer(&target) {
        _ if target == module => None,
        Some(other) if other < own => None,
        Some(_) => Some(format!("{path}:{line}: `{module}` imports `{target}`, which is not below it")),
        None => Some(format!("{path}:{line}: `{target}` at the root of the crate is not in the list of layers")),
    };
    named_modules(source, depth).into_iter().filter_map(complaint).collect()
}

/// Every `.rs` file under a folder, in order of its path.
fn sources(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut entries = fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>()?;
    entries.sort();
    let mut files = Vec::new();
    for entry in entries {
        if entry.is_dir() {
            files.extend(sources(&entry)?);
        } else if entry.extension().is_some_and(|extension| extension == "rs") {
            files.push(entry);
        }
    }
    Ok(files)
}

#[test]
fn imports_point_down_the_list_of_layers() {
    let document = fs::read_to_string(Path::new(ROOT).join("ARCHITECTURE.md")).expect("ARCHITECTURE.md");
    let layers = layers(&document);
    assert!(layers.len() > 3, "ARCHITECTURE.md has no block fenced as `layers`");
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut complaints = String::new();
    for module in layers.iter().flatten() {
        if !src.join(module).join("mod.rs").exists() && !src.join(module).with_extension("rs").exists() {
            writeln!(complaints, "ARCHITECTURE.md: the module `{module}` does not exist").expect("a string");
        }
        if layers.iter().flatten().filter(|other| *other == module).count() > 1 {
            writeln!(complaints, "ARCHITECTURE.md: the module `{module}` is listed twice").expect("a string");
        }
    }
    let mut files = 0;
    for file in sources(&src).expect("the sources") {
        let path = file.strip_prefix(&src).expect("under src").to_string_lossy().replace('\\', "/");
        if path == "lib.rs" {
            continue;
        }
        files += 1;
        for complaint in violations(&layers, &path, &fs::read_to_string(&file).expect("a source")) {
            writeln!(complaints, "crates/hatbox/src/{complaint}").expect("a string");
        }
    }
    assert!(files > 20, "only {files} sources found");
    assert!(complaints.is_empty(), "imports that do not point down (see ARCHITECTURE.md):\n{complaints}");
}

#[test]
fn arrows_that_do_not_point_down_are_caught_where_they_are() {
    let layers = layers("text\n```layers\nlow base\nmiddle\nhigh\n```\n```layers\nlate\n```\n");
    assert_eq!(layers, [vec!["low", "base"], vec!["middle"], vec!["high"]]);
    for (path, source, lines) in [
        // Down, and within the module itself.
        ("middle.rs", "use crate::low::X;\nuse crate::{base, low::{self, Y}};\nuse crate::middle::z;", &[][..]),
        // Up.
        ("middle.rs", "use crate::low::X;\n\nuse crate::high::X;", &[3]),
        ("middle/part.rs", "fn f() {\n    crate::high::g();\n}", &[2]),
        ("middle.rs", "pub(crate) use crate::{\n    low::a,\n    high::{b, c},\n};", &[3]),
        // Sideways.
        ("low.rs", "use crate::base;", &[1]),
        // Through `super`, only as far as the root.
        ("middle/mod.rs", "use super::high::X;\nuse super::low::X;", &[1]),
        ("middle/part.rs", "use super::high::X;\nuse super::super::high::X;", &[2]),
        (
            "middle/part.rs",
            "pub(super) fn f() {}\nmod tests {\n    use super::super::high;\n    use super::super::super::high;\n}",
            &[4],
        ),
        ("middle.rs", "mod tests {\n    use super::*;\n}\nuse super::high;", &[4]),
        // Not in the list: a module, a root item, the whole root.
        ("middle.rs", "use crate::other::X;\nuse crate::*;", &[1, 2]),
        ("other/deep/mod.rs", "use crate::low;", &[1]),
        // Text is not code; code after text is.
        ("low.rs", "//! [`crate::high`]\n/* crate::high /* */ crate::high */\nlet x = \"\\\"crate::high\";", &[]),
        ("low.rs", "let (c, s): (char, &'static str) = ('\"', r#\"a\" crate::high\"#); use crate::high;\n", &[1]),
        ("low.rs", "let c = '\\''; let d = b'{'; // \"\nuse crate::middle;", &[2]),
    ] {
        let found = violations(&layers, path, source);
        let expected: Vec<String> = lines.iter().map(|line: &usize| format!("{path}:{line}: ")).collect();
        assert_eq!(found.len(), expected.len(), "{source}\n{found:?}");
        assert!(found.iter().zip(&expected).all(|(f, e)| f.starts_with(e)), "{source}\n{found:?}");
    }
}
