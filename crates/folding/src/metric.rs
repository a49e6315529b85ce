//! How far a fold is from the ideal one.

use selvedge_cloth::Mesh;
use selvedge_math::DVec3;

/// The folding error `E = (1/d) sqrt((1/n) sum_i |p_i - p*_i|^2)` (eq. `fold_error` of the paper):
/// the root mean square distance to a reference, as a share of the sheet's diagonal `d` [m].
///
/// ```
/// use selvedge_folding::fold_error;
/// use selvedge_math::DVec3;
/// let reference = [DVec3::ZERO, DVec3::X];
/// let positions = [DVec3::ZERO, DVec3::X + 0.1 * DVec3::Z];
/// let expected = 0.1 / 2.0_f64.sqrt() / 0.5;
/// assert!((fold_error(&positions, &reference, 0.5) - expected).abs() < 1e-15);
/// ```
///
/// # Panics
/// When the slices differ in length or are empty.
pub fn fold_error(positions: &[DVec3], reference: &[DVec3], diagonal: f64) -> f64 {
    assert_eq!(positions.len(), reference.len(), "one reference a node");
    assert!(!positions.is_empty(), "at least one node");
    let sum: f64 = positions
        .iter()
        .zip(reference)
        .map(|(p, r)| p.distance_squared(*r))
        .sum();
    (sum / positions.len() as f64).sqrt() / diagonal
}

/// The ideal half fold [m]: nodes with `y > 0` lie mirrored at `(x, -y, thickness)`, the others
/// where they were. This is the analytic reference that the paper first used.
pub fn half_fold(mesh: &Mesh, thickness: f64) -> Vec<DVec3> {
    let fold = |p: &DVec3| match p.y > 0.0 {
        true => DVec3::new(p.x, -p.y, thickness),
        false => *p,
    };
    mesh.rest().iter().map(fold).collect()
}

/// The largest and the root mean square edge strain `|length/rest - 1|` over the edges that
/// `counts` says count; zeros when none does.
pub(crate) fn edge_strain(
    mesh: &Mesh,
    positions: &[DVec3],
    counts: impl Fn([u32; 2]) -> bool,
) -> (f64, f64) {
    let rest = mesh.rest();
    let (mut largest, mut squares, mut number) = (0.0_f64, 0.0, 0.0);
    for &edge in mesh.edges() {
        if counts(edge) {
            let [p, q] = edge.map(|node| node as usize);
            let strain = positions[p].distance(positions[q]) / rest[p].distance(rest[q]) - 1.0;
            largest = largest.max(strain.abs());
            squares += strain * strain;
            number += 1.0;
        }
    }
    (largest, (squares / f64::max(number, 1.0)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_fold_keeps_lengths_within_each_half() {
        let mesh = Mesh::grid([3, 4], [0.2, 0.3]).unwrap();
        let folded = half_fold(&mesh, 1e-3);
        assert_eq!(folded[11], DVec3::new(0.1, -mesh.rest()[11].y, 1e-3));
        assert_eq!(folded[0], mesh.rest()[0]);
        let same_half = |[p, q]: [u32; 2]| {
            (mesh.rest()[p as usize].y > 0.0) == (mesh.rest()[q as usize].y > 0.0)
        };
        assert!(edge_strain(&mesh, &folded, same_half).0 < 1e-14);
        // The edges across the fold are all but gone.
        assert!(edge_strain(&mesh, &folded, |_| true).0 > 0.9);
    }

    #[test]
    fn strain_of_a_stretched_sheet() {
        let mesh = Mesh::grid([3, 3], [1.0, 1.0]).unwrap();
        let stretched: Vec<DVec3> = mesh.rest().iter().map(|p| *p * 1.02).collect();
        let (largest, rms) = edge_strain(&mesh, &stretched, |_| true);
        assert!((largest - 0.02).abs() < 1e-14 && (rms - 0.02).abs() < 1e-14);
        assert_eq!(edge_strain(&mesh, &stretched, |_| false), (0.0, 0.0));
    }
}
