//! Reads every C3D file of a folder and writes it again into another: `rewrite IN OUT`.
//!
//! The files in OUT are what foreign readers are asked to read in `tests/peers/c3d_ezc3d.py`. OUT
//! keeps the folders of IN.

#![allow(clippy::print_stderr, reason = "a program for a terminal")]

use std::{
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
};

use aloft_c3d::C3dFile;

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(from), Some(to)) = (arguments.next(), arguments.next()) else {
        eprintln!("usage: rewrite IN OUT");
        return ExitCode::from(2);
    };
    match walk(&from, &to) {
        Ok(0) => ExitCode::SUCCESS,
        Ok(failed) => {
            eprintln!("{failed} files failed");
            ExitCode::from(1)
        }
        Err(problem) => {
            eprintln!("{problem}");
            ExitCode::from(2)
        }
    }
}

/// Files that failed below `from`.
fn walk(from: &Path, to: &Path) -> std::io::Result<usize> {
    let mut failed = 0;
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let path = entry?.path();
        let target = to.join(path.file_name().unwrap_or_default());
        if path.is_dir() {
            failed += walk(&path, &target)?;
        } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("c3d")) {
            match C3dFile::from_bytes(&fs::read(&path)?).and_then(|file| file.to_bytes()) {
                Ok(bytes) => fs::write(target, bytes)?,
                Err(problem) => {
                    eprintln!("{}: {problem}", path.display());
                    failed += 1;
                }
            }
        }
    }
    Ok(failed)
}
