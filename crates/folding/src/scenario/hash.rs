//! What a run depends on, as one number.

use serde::Serialize;
use sha2::{Digest, Sha256};

use super::tables::{CaseTable, File};

impl File {
    /// Over what a case depends on when it runs on the published scheme.
    pub(super) fn published_hash(&self, case: &CaseTable) -> Result<String, serde_json::Error> {
        hash(&(&self.solver.published, self.common(case)))
    }

    /// Over what a case depends on when it runs on the default solver.
    pub(super) fn default_hash(&self, case: &CaseTable) -> Result<String, serde_json::Error> {
        let cloth = (self.cloth.shear_n_per_m, self.cloth.internal_damping_s);
        hash(&(&self.solver.default, cloth, self.common(case)))
    }

    fn common<'a>(&'a self, case: &'a CaseTable) -> impl Serialize + 'a {
        (&self.cloth, &self.time, &self.path, &self.squeeze, case)
    }
}

/// SHA-256 of the tables in the order of the file, numbers in shortest form.
fn hash(inputs: &impl Serialize) -> Result<String, serde_json::Error> {
    Ok(sha256(serde_json::to_string(inputs)?.as_bytes()))
}

/// SHA-256 in hexadecimal.
pub(super) fn sha256(bytes: &[u8]) -> String {
    let digest = Sha256::digest(bytes);
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}
