//! A robot of another make.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]
#![allow(dead_code, reason = "not every test needs all of it")]

mod fast;

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read};
use std::net::UdpSocket;
use std::path::Path;
use std::process::{Child, ChildStdout, Command as Process, Stdio};
use std::sync::{RwLock, RwLockReadGuard, RwLockWriteGuard};

use serde_json::{Value, json};

/// Cyclone DDS on 127.0.0.1, without multicast, which `lo` often has not.
const CYCLONE: &str = "<CycloneDDS><Domain><General><Interfaces><NetworkInterface \
    address=\"127.0.0.1\"/></Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery>\
    <ParticipantIndex>auto</ParticipantIndex><Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery>\
    </Domain></CycloneDDS>";

/// Who looks at timing is alone.
static ALONE: RwLock<()> = RwLock::new(());

/// Whether others may run at the same time.
enum Beside {
    Alone(#[allow(dead_code, reason = "held")] RwLockWriteGuard<'static, ()>),
    Others(#[allow(dead_code, reason = "held")] RwLockReadGuard<'static, ()>),
}

/// A domain that no other test on this machine has.
pub(crate) struct Domain {
    pub(crate) id: u16,
    _held: UdpSocket,
    _beside: Beside,
}

impl Domain {
    pub(crate) fn free(alone: bool) -> Self {
        let beside = match alone {
            true => Beside::Alone(ALONE.write().unwrap_or_else(|e| e.into_inner())),
            false => Beside::Others(ALONE.read().unwrap_or_else(|e| e.into_inner())),
        };
        // The last port of a domain, which no participant uses, stands for the whole.
        let hold = |id: u16| {
            let port = 7400 + 250 * id + 249;
            Some((id, UdpSocket::bind(("127.0.0.1", port)).ok()?))
        };
        let (id, held) = (1..=100).find_map(hold).unwrap();
        Self {
            id,
            _held: held,
            _beside: beside,
        }
    }
}

/// The Python with what a test needs, or nothing, and why.
pub(crate) fn python(test: &str, package: &str) -> Option<OsString> {
    let python = std::env::var_os("SELVEDGE_PYTHON").unwrap_or_else(|| OsString::from("python3"));
    let import = format!("import {package}");
    let there = Process::new(&python).arg("-c").arg(import).output();
    if there.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    eprintln!("{test}: skipped, {} has no {package}", python.display());
    None
}

pub(crate) struct Peer {
    child: Child,
    output: BufReader<ChildStdout>,
    _folder: tempfile::TempDir,
}

impl Peer {
    /// A peer that does what it is told, or nothing when it cannot be; on Fast DDS when `dds` says so.
    pub(crate) fn start(
        test: &str,
        domain: &Domain,
        joints: &[f64],
        names: &[String],
        told: &Value,
    ) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        if told["dds"] == "fast" {
            let process = fast::process(test, domain, joints, names, told)?;
            return Some(Self::spawned(process, folder));
        }
        let python = python(test, "cyclonedds")?;
        let mut all = json!({"domain": domain.id, "joints": joints, "names": names});
        for (key, value) in told.as_object().unwrap() {
            all[key] = value.clone();
        }
        let file = folder.path().join("told.json");
        std::fs::write(&file, all.to_string()).unwrap();
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peer/peer.py");
        let mut process = Process::new(&python);
        process.arg("-B").arg(script).arg(file);
        process.env("CYCLONEDDS_URI", CYCLONE);
        process.stdin(Stdio::piped()).stdout(Stdio::piped());
        Some(Self::spawned(process, folder))
    }

    fn spawned(mut process: Process, folder: tempfile::TempDir) -> Self {
        let mut child = process.spawn().unwrap();
        let mut output = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        output.read_line(&mut line).unwrap();
        assert_eq!(line, "ready\n");
        Self {
            child,
            output,
            _folder: folder,
        }
    }

    /// Waits until it is gone by itself.
    pub(crate) fn gone(&mut self) {
        // Waiting itself would close its input, which ends it.
        while self.child.try_wait().unwrap().is_none() {
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
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
