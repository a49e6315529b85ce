//! A robot of another make.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, ChildStdout, Command as Process, Stdio};
use std::sync::Mutex;

use serde_json::{Value, json};

/// Cyclone DDS on 127.0.0.1, without multicast, which `lo` often has not.
const CYCLONE: &str = "<CycloneDDS><Domain><General><Interfaces><NetworkInterface \
    address=\"127.0.0.1\"/></Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery>\
    <ParticipantIndex>auto</ParticipantIndex><Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery>\
    </Domain></CycloneDDS>";

/// One at a time: timing is looked at, and a machine may have two cores.
pub(crate) static ALONE: Mutex<()> = Mutex::new(());

pub(crate) struct Peer {
    child: Child,
    output: BufReader<ChildStdout>,
}

impl Peer {
    /// A peer that does what it is told, or nothing when it cannot be.
    pub(crate) fn start(
        test: &str,
        domain: u16,
        joints: &[f64],
        names: &[String],
        told: Value,
    ) -> Option<Self> {
        let python =
            std::env::var_os("SELVEDGE_PYTHON").unwrap_or_else(|| OsString::from("python3"));
        let there = Process::new(&python)
            .arg("-c")
            .arg("import cyclonedds")
            .output();
        if !there.is_ok_and(|output| output.status.success()) {
            eprintln!("{test}: skipped, {} has no cyclonedds", python.display());
            return None;
        }
        let mut all = json!({"domain": domain, "joints": joints, "names": names});
        for (key, value) in told.as_object().unwrap() {
            all[key] = value.clone();
        }
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peer/peer.py");
        let mut child = Process::new(&python)
            .arg(script)
            .arg(all.to_string())
            .env("CYCLONEDDS_URI", CYCLONE)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut output = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        output.read_line(&mut line).unwrap();
        assert_eq!(line, "ready\n");
        Some(Self { child, output })
    }

    /// What it has received.
    pub(crate) fn finish(mut self) -> Value {
        drop(self.child.stdin.take());
        let mut text = String::new();
        self.output.read_to_string(&mut text).unwrap();
        self.child.wait().unwrap();
        // Nothing from one that was killed.
        serde_json::from_str(&text).unwrap_or_default()
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        self.child.kill().ok();
    }
}
