//! Outputs appear whole or not at all.

use std::fs;
use std::io::{self, Write};
use surfel_io::write::{StagedDir, WriteError, write_atomically};

fn listing(folder: &std::path::Path) -> Vec<String> {
    let names = fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

#[test]
fn a_drop_without_commit_leaves_nothing() {
    let home = tempfile::tempdir().unwrap();
    let staged = StagedDir::new(&home.path().join("deep/out")).unwrap();
    staged.write("mesh.ply", |w| w.write_all(b"half")).unwrap();
    drop(staged);
    assert!(listing(home.path()).is_empty());

    let existing = home.path().join("existing");
    fs::create_dir(&existing).unwrap();
    let staged = StagedDir::new(&existing).unwrap();
    staged.write("depth/a.pfm", |w| w.write_all(b"half")).unwrap();
    drop(staged);
    assert!(listing(&existing).is_empty());
}

#[test]
fn a_commit_creates_the_folder_with_its_parents_and_nothing_else() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("deep/out");
    let staged = StagedDir::new(&out).unwrap();
    staged.write("mesh.ply", |w| w.write_all(b"mesh")).unwrap();
    staged.write("depth/a.pfm", |w| w.write_all(b"depth")).unwrap();
    assert!(!out.exists());
    assert_eq!(staged.commit().unwrap(), [out.join("depth/a.pfm"), out.join("mesh.ply")]);
    assert_eq!(fs::read(out.join("depth/a.pfm")).unwrap(), b"depth");
    assert_eq!(listing(home.path()), ["deep"]);
    assert_eq!(listing(&out), ["depth", "mesh.ply"]);
}

#[test]
fn a_commit_replaces_its_own_names_and_keeps_foreign_files() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("out");
    fs::create_dir_all(out.join("depth")).unwrap();
    fs::write(out.join("mesh.ply"), "old").unwrap();
    fs::write(out.join("notes.txt"), "mine").unwrap();
    fs::write(out.join("depth/other.pfm"), "mine too").unwrap();
    let staged = StagedDir::new(&out).unwrap();
    staged.write("mesh.ply", |w| w.write_all(b"new")).unwrap();
    staged.write("depth/a.pfm", |w| w.write_all(b"depth")).unwrap();
    assert_eq!(fs::read_to_string(out.join("mesh.ply")).unwrap(), "old");
    staged.commit().unwrap();
    assert_eq!(fs::read_to_string(out.join("mesh.ply")).unwrap(), "new");
    assert_eq!(fs::read_to_string(out.join("notes.txt")).unwrap(), "mine");
    assert_eq!(listing(&out.join("depth")), ["a.pfm", "other.pfm"]);
    assert_eq!(listing(&out), ["depth", "mesh.ply", "notes.txt"]);
}

#[test]
fn conflicts_are_found_before_anything_is_replaced() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("out");
    fs::create_dir_all(out.join("mesh.ply")).unwrap();
    fs::write(out.join("a.pfm"), "old").unwrap();
    let staged = StagedDir::new(&out).unwrap();
    staged.write("a.pfm", |w| w.write_all(b"new")).unwrap();
    staged.write("mesh.ply", |w| w.write_all(b"new")).unwrap();
    assert!(matches!(staged.commit(), Err(WriteError::FolderInTheWay(path)) if path == out.join("mesh.ply")));
    assert_eq!(fs::read_to_string(out.join("a.pfm")).unwrap(), "old");
    assert_eq!(listing(&out), ["a.pfm", "mesh.ply"]);
}

#[test]
fn a_file_in_place_of_the_folder_is_a_sentence() {
    let home = tempfile::tempdir().unwrap();
    let file = home.path().join("out");
    fs::write(&file, "a file").unwrap();
    for out in [file.clone(), file.join("inside")] {
        let message = StagedDir::new(&out).unwrap_err().to_string();
        assert!(message.contains("it is a file, not a folder") && message.contains("out"), "{message}");
    }
    assert!(matches!(StagedDir::new("".as_ref()), Err(WriteError::EmptyPath)));
    assert_eq!(fs::read_to_string(&file).unwrap(), "a file");
}

#[cfg(unix)]
#[test]
fn a_link_that_leads_nowhere_is_not_written_through() {
    let home = tempfile::tempdir().unwrap();
    let link = home.path().join("out");
    std::os::unix::fs::symlink(home.path().join("missing"), &link).unwrap();
    assert!(matches!(StagedDir::new(&link), Err(WriteError::NotAFolder(path)) if path == link));
}

#[test]
fn a_single_file_is_replaced_whole_or_kept() {
    let home = tempfile::tempdir().unwrap();
    let path = home.path().join("report.json");
    write_atomically(&path, |w| w.write_all(b"first")).unwrap();
    let broken = write_atomically(&path, |w| {
        w.write_all(b"second, cut short")?;
        Err(io::Error::other("the disk is full"))
    });
    let message = broken.unwrap_err().to_string();
    assert_eq!(message, format!("cannot write {}: the disk is full", path.display()));
    assert_eq!(fs::read_to_string(&path).unwrap(), "first");
    write_atomically(&path, |w| w.write_all(b"third")).unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "third");
    assert_eq!(listing(home.path()), ["report.json"]);
    assert!(matches!(write_atomically(home.path(), |_| Ok(())), Err(WriteError::FolderInTheWay(_))));
}
