//! `show` and `export` as a user sees them, on a recording of a scene.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use std::path::Path;
use std::process::{Command, Output};

fn xtask(arguments: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_xtask"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn a_recording_becomes_a_page_pictures_and_meshes() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let made = xtask(&["scenes", "free_fall", "--out", "."], folder);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
    let good = |arguments: &[&str]| {
        let output = xtask(arguments, folder);
        assert!(output.status.success(), "{}", text(&output.stderr));
    };
    good(&["show", "free_fall.npz"]);
    let page = text(&read("free_fall.html"));
    assert!(page.starts_with("<!doctype html>") && page.contains("id=\"clip-0\""));

    good(&["export", "free_fall.npz", "a.png", "--size", "120x90"]);
    good(&[
        "export",
        "free_fall.npz",
        "b.png",
        "--size",
        "120x90",
        "--time",
        "0",
    ]);
    good(&[
        "export",
        "free_fall.npz",
        "c.png",
        "--size",
        "120x90",
        "--frames",
        "3",
    ]);
    let width = |name: &str| u32::from_be_bytes(read(name)[16..20].try_into().unwrap());
    assert_eq!(
        [width("a.png"), width("b.png"), width("c.png")],
        [120, 120, 360]
    );
    assert_ne!(read("a.png"), read("b.png"), "it fell");
    good(&[
        "export",
        "free_fall.npz",
        "a.gif",
        "--size",
        "64x48",
        "--rate",
        "10",
    ]);
    assert!(read("a.gif").starts_with(b"GIF89a"));
    for name in ["a.obj", "a.ply", "a.mcap"] {
        good(&["export", "free_fall.npz", name]);
    }
    assert!(text(&read("a.obj")).contains("\nf ") && text(&read("a.ply")).starts_with("ply\n"));
    assert!(read("a.mcap").starts_with(b"\x89MCAP0"));
}

#[test]
fn what_cannot_be_is_told_with_status_2_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    xtask(&["scenes", "free_fall", "--out", "."], folder);
    let refused = |arguments: &[&str], reason: &str| {
        let output = xtask(arguments, folder);
        let errors = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{errors}");
        assert!(errors.contains(reason), "{errors}");
        assert_eq!(
            std::fs::read_dir(folder).unwrap().count(),
            1,
            "{arguments:?}"
        );
    };
    refused(&["show", "missing.npz"], "missing.npz");
    refused(
        &["show", "free_fall.npz", "--out", "free_fall.npz"],
        "another name",
    );
    refused(&["export", "free_fall.npz", "a.jpeg"], "must end in .png");
    refused(
        &["export", "free_fall.npz", "a.png", "--time", "99"],
        "--time 99: must be 0 to",
    );
    refused(
        &["export", "free_fall.npz", "a.png", "--size", "3"],
        "must be like 800x600",
    );
    refused(
        &["export", "free_fall.npz", "a.gif", "--rate", "0"],
        "0 pictures a second",
    );
}
