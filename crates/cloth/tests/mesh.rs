//! The meshes in `fixtures/meshes`.

#![allow(clippy::unwrap_used, reason = "a failed set-up fails the test")]

use selvedge_cloth::{Error, Material, Mesh, Projection, Settings, Simulator, project};
use selvedge_math::{ClothSimulator, DVec3, Held};

fn fixture(name: &str) -> Mesh {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/meshes/");
    Mesh::from_obj(format!("{folder}{name}")).unwrap()
}

/// Nodes less edges plus faces is 1 for whatever is like a disc.
fn euler(mesh: &Mesh) -> i64 {
    let faces = mesh.quads().len() + mesh.triangles().len();
    (mesh.node_count() + faces) as i64 - mesh.edges().len() as i64
}

#[test]
fn l_of_quads() {
    let mesh = fixture("l_shape.obj");
    assert_eq!((mesh.node_count(), mesh.quads().len()), (40, 27));
    assert_eq!(euler(&mesh), 1);
    assert!(mesh.triangles().is_empty() && mesh.as_grid().is_none());
    assert!((mesh.diagonal() - 0.3 * 2f64.sqrt()).abs() < 1e-15);
}

#[test]
fn disc_of_triangles() {
    let mesh = fixture("disc.obj");
    assert_eq!((mesh.node_count(), mesh.triangles().len()), (61, 96));
    assert_eq!(euler(&mesh), 1);
    assert!(mesh.edges().is_sorted() && mesh.edges().iter().all(|[p, q]| p < q));
}

#[test]
fn any_mesh_is_projected_but_shear_needs_a_grid() {
    for name in ["l_shape.obj", "disc.obj"] {
        let mesh = fixture(name);
        let n = mesh.node_count();
        let predicted: Vec<DVec3> = (0..n)
            .map(|k| mesh.rest()[k] + 2e-3 * DVec3::new(0.0, (k as f64).cos(), (k as f64).sin()))
            .collect();
        let problem = Projection {
            mesh: &mesh,
            masses: &vec![1e-3; n],
            predicted: &predicted,
            grasp: &[(0, mesh.rest()[0] + 1e-3 * DVec3::Z)],
            shear_compliance: None,
            table: Some(0.0),
        };
        let projected = project(&problem).unwrap();
        assert!(
            projected.miss < 1e-10 && projected.imbalance < 1e-10,
            "{projected:?}"
        );
        for &[p, q] in mesh.edges() {
            let [p, q] = [p as usize, q as usize];
            let length = projected.positions[p].distance(projected.positions[q]);
            assert!((length - mesh.rest()[p].distance(mesh.rest()[q])).abs() < 1e-10);
        }
        let sheared = Projection {
            shear_compliance: Some(1.0),
            ..problem
        };
        assert_eq!(project(&sheared), Err(Error::NoGrid("a shear row")));
    }
}

/// Meshes that are no grid move too: hung by a node above the table they come down, and keep their
/// lengths.
#[test]
fn meshes_from_files_are_simulated() {
    for name in ["l_shape.obj", "disc.obj"] {
        let mesh = fixture(name);
        let mut cloth = Simulator::new(&mesh, Material::default(), Settings::default()).unwrap();
        let raised: Vec<DVec3> = mesh.rest().iter().map(|x| *x + 0.05 * DVec3::Z).collect();
        cloth
            .reset(&raised, &vec![DVec3::ZERO; raised.len()])
            .unwrap();
        cloth.pin(&[0]).unwrap();
        for _ in 0..60 {
            let report = cloth.step(Held::NONE, 1.0 / 60.0).unwrap();
            assert!(report.strain < Some(1e-3), "{name}: {report:?}");
        }
        let lowest = cloth.positions().iter().map(|x| x.z).fold(1.0, f64::min);
        assert!((-1e-6..0.03).contains(&lowest), "{name}: {lowest}");
        assert_eq!(cloth.positions()[0], raised[0], "{name}");
    }
}
