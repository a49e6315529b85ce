//! Scenes run, are near their references, and their recordings can be read back.

#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use selvedge_folding::Scene;
use selvedge_view::Recording;

#[test]
fn scenes_have_names_of_their_own() {
    let scenes = Scene::all().unwrap();
    let names: Vec<&str> = scenes.iter().map(|scene| scene.name).collect();
    assert_eq!(
        names,
        [
            "free_fall",
            "hanging_strip",
            "catenary",
            "slide",
            "incline_below",
            "incline_above",
            "cantilever_1",
            "cantilever_10",
            "cantilever_100",
            "drape"
        ]
    );
    assert!(scenes.iter().all(|scene| !scene.about.is_empty()));
}

#[test]
fn a_slide_is_read_back_with_its_reference() {
    let scenes = Scene::all().unwrap();
    let scene = scenes.iter().find(|scene| scene.name == "slide").unwrap();
    let recording = scene.run().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("slide.npz");
    recording.write(&path).unwrap();
    let read = Recording::read(&path).unwrap();
    assert_eq!(read, recording);
    assert_eq!((read.frame_count(), read.gripper_count()), (61, 1));

    let meta: serde_json::Value = serde_json::from_str(read.meta()).unwrap();
    assert_eq!(meta["scene"], "slide");
    assert_eq!(meta["material"]["friction_table"], 0.2);
    assert_eq!(meta["settings"]["table"], true);
    let reference = meta["quantities"][0]["reference"].as_f64().unwrap();
    assert!((reference - 0.0503).abs() < 1e-4, "{reference}");
    let measured = scene.quantities[0].measured(scene, &read);
    assert!((measured / reference - 1.0).abs() < 0.01, "{measured}");
}
